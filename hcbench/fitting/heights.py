"""Heights of successive bounces as a linear model about parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.fitting.datasets import Dataset, bounce_train, drop_prior, pairs_of_launches
from hcbench.fitting.linear import LinearModel

if TYPE_CHECKING:
    from hcbench.fitting.candidates import FittedCurve
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class Heights(Dataset):
    """heights: (n,), m, of successive bounces; the first may be where the ball was let go.

    Own parameter: ln of the speed of the first touch where the drop height is given, else of the first
    launch.
    """

    name: str
    setup: MeasurementSetup
    heights: Floats
    uncertainty: float | None = None
    noise_scale: ClassVar[float] = 1e-3
    noise_unit: ClassVar[str] = "m"

    @property
    def kind(self) -> str:
        """Name of this kind of data."""
        return "heights"

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        return self.uncertainty

    def _launches(self) -> Floats:
        g, drag = self.setup.ballistics.gravity, self.setup.ballistics.drag
        if not drag:
            return np.sqrt(2.0 * g * self.heights)
        return np.sqrt(np.expm1(2.0 * drag * g * self.heights) / drag)

    def pairs(self) -> tuple[Floats, Floats]:
        """Rough impact speeds (m/s) and e, without the law."""
        return pairs_of_launches(self._launches(), self.setup, self.setup.drop)

    def start(self) -> Floats:
        """Own parameters to start from."""
        height = self.setup.height
        if height is None:
            return np.log(self._launches()[:1])
        return np.log([self.setup.ballistics.dropped(height.value)[0]])

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """The linear model about a law, own parameters and relative changes of each e, `latent` (m,).

        Its residual is that at no changes: what the ones given do is added back to first order.
        """
        dropped, ballistics = self.setup.height is not None, self.setup.ballistics
        train = bounce_train(curve, ballistics, math.exp(own[0]), latent, dropped)
        apex = np.array([ballistics.apex(w) for w in train.launch])
        by = apex[:, 1:] * train.by
        q = curve.count
        return LinearModel(
            residual=self.heights - apex[:, 0] + by[:, 1 + q :] @ latent,
            by_own=by[:, :1],
            by_law=by[:, 1 : 1 + q],
            by_scatter=by[:, 1 + q :],
            shape=np.ones(len(self.heights)),
            prior=np.array([drop_prior(self.setup, own[0]) if dropped else (0.0, math.inf)]),
            speed=train.touch,
        )

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        count = len(self.heights) - (self.setup.height is None)
        return [f"bounce {i + 1}" for i in range(count)]

    def rows(self) -> list[str]:
        """Labels for the rows of the residual."""
        return [f"height {i + 1}" for i in range(len(self.heights))]
