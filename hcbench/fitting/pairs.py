"""Impacts measured one by one: pairs of speed and e, or of the speeds in and out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.fitting.datasets import Dataset
from hcbench.fitting.linear import LinearModel

if TYPE_CHECKING:
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.fitting.which_law import FittedCurve
    from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class SpeedPairs(Dataset):
    """Impacts measured one by one.

    speed, restitution: (n,), m/s and 1.

    speed_uncertainty, restitution_uncertainty: (n,), standard, 0 where none is given.
    twice: whether e is v_out/v_in, so that an error of v_in counts in both; then without
    uncertainties the relative error of both speeds is to be found.
    """

    name: str
    setup: MeasurementSetup
    speed: Floats
    restitution: Floats
    speed_uncertainty: Floats
    restitution_uncertainty: Floats
    twice: bool = False
    noise_scale: ClassVar[float] = 0.01
    noise_unit: ClassVar[str] = ""

    @property
    def kind(self) -> str:
        """Name of this kind of data."""
        if self.twice:
            return "speeds"
        return "pairs"

    @property
    def _is_given(self) -> bool:
        return bool((self.speed_uncertainty > 0).any() or (self.restitution_uncertainty > 0).any())

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        if self.twice and not self._is_given:
            return None
        return 1.0

    @property
    def needs_gravity(self) -> bool:
        """False: the speeds are given."""
        return False

    def pairs(self) -> tuple[Floats, Floats]:
        """The given impact speeds (m/s) and e."""
        return self.speed, self.restitution

    def start(self) -> Floats:
        """Own parameters to start from."""
        return np.zeros(0)

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """Linear model of the relative errors of e about a law, one row for each of n impacts.

        curve: the law with its parameters.
        own, latent: unused, since the model has no own parameters and is linear in the changes of
        e.

        Each row is weighted by the relative uncertainties of the speed and of e.
        """
        n = len(self.speed)
        # Of the law at each speed: ln e, its slope over ln v, its derivatives by the parameters.
        log_e = np.empty(n)
        slope = np.empty(n)
        by_law = np.empty((n, curve.count))
        for i, v in enumerate(self.speed):
            log_e[i], slope[i], by_law[i] = curve.local(v)
        e = np.exp(log_e)
        of_e = self.restitution_uncertainty / e
        if not self.twice:
            shape = np.hypot(slope * self.speed_uncertainty / self.speed, of_e)
        elif self._is_given:
            # e is v_out/v_in: an error of v_in changes e itself, too.
            shape = np.hypot((1.0 + slope) * (self.speed_uncertainty / self.speed), of_e)
        else:
            # Both speeds have the same uncertainty.
            shape = np.hypot(1.0 + slope, np.ones(n))
        return LinearModel(
            residual=self.restitution / e - 1.0,
            by_own=np.zeros((n, 0)),
            by_law=by_law,
            by_scatter=np.eye(n),
            shape=np.maximum(shape, 1e-9),
            prior=np.zeros((0, 2)),
            speed=self.speed,
        )

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        return [f"the pair at {v:.4g} m/s" for v in self.speed]
