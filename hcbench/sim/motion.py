"""A recorded motion of a model: its states as they are given, and which contacts in them are new."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.landing import PARTED_S
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Hashable, Mapping

    from hcbench.terms.impact import Floats

# A gap between two states may hide a contact: parts touch anew only after more than this many.
_STATES_APART = 1.5


@dataclass(frozen=True, slots=True)
class RecordedMotion:
    """States of a recording, SI: qpos (n, nq), qvel (n, nv) and the time of each, (n,)."""

    qpos: Floats
    qvel: Floats
    time: Floats

    @classmethod
    def read(
        cls, recorded: Mapping[str, Floats], nq: int, nv: int, timestep: float, layout: str = ""
    ) -> RecordedMotion:
        """The states of a recording with `qpos`, `qvel` and, where it is known, `time`; without it
        they are a time step, s, apart.

        nq, nv: numbers in a state. layout: what they are, in words. Raises UserError for other
        shapes, times that do not rise, and numbers that are not finite.
        """
        arrays = []
        for name, width in (("qpos", nq), ("qvel", nv)):
            if (array := recorded.get(name)) is None:
                expected = "qpos and qvel of each state, and time"
                raise UserError("trajectory", f"no {name!r} in it", expected)
            if array.ndim != 2 or array.shape[1] != width or len(array) < 2:
                got = f"{name}: {' x '.join(map(str, array.shape))} numbers"
                expected = f"n x {width}, for this model, with n of 2 or more"
                raise UserError("trajectory", got, expected, layout)
            arrays.append(array)
        qpos, qvel = arrays
        steps: Floats = timestep * np.arange(len(qpos), dtype=np.float64)
        time = recorded.get("time", steps).reshape(-1)
        if not len(qpos) == len(qvel) == len(time):
            got = f"{len(qpos)} states in qpos, {len(qvel)} in qvel and {len(time)} in time"
            raise UserError("trajectory", got, "as many in each")
        for name, array in (("qpos", qpos), ("qvel", qvel), ("time", time)):
            if not np.isfinite(array).all():
                got = f"{name}: numbers that are not finite"
                raise UserError("trajectory", got, "finite numbers")
        if not (np.diff(time) > 0).all():
            raise UserError("trajectory", "time does not rise", "a later time for each state")
        return cls(qpos, qvel, time)

    @property
    def interval(self) -> float:
        """Time between two states, the median, s."""
        return float(np.median(np.diff(self.time)))


@dataclass
class NewTouches:
    """Tells which contacts of a recording are touchdowns. time: of its states, s, (n,).

    _last_seen: when each contact was there last, s, by its parts.
    """

    time: Floats
    _last_seen: dict[Hashable, float] = field(default_factory=dict)

    def begins(self, parts: Hashable, state: int) -> bool:
        """Say whether two parts that touch in a state were apart before it; of several contacts in one
        state, the first tells.

        Parts that touch in the first state have not come down, and one state without contact may be
        a gap between two recorded states only.
        """
        now = float(self.time[state])
        apart = now - self._last_seen.get(parts, -np.inf)
        self._last_seen[parts] = now
        if not state:
            return False
        return apart > max(PARTED_S, _STATES_APART * (now - float(self.time[state - 1])))
