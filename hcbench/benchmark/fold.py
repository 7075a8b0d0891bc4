"""Summary of one setting's impacts for pages, folded part by part, so that any number of them fits
in memory.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.measuring.curve import Curve, CurvePoint, curve_of_columns
from hcbench.terms.impact import Floats
from hcbench.terms.records import (
    ANGLE,
    COULOMB,
    IMPULSE_RATIO,
    LAW,
    PENETRATION_MAX,
    PHASE,
    RESTITUTION,
    SAMPLES,
    SLIP_IN,
    SPEED,
    SPEED_IN,
    STATUS,
    keys,
)

# Columns of impacts that are folded, and those that only studies with oblique launches have.
FOLDED = keys((SPEED, PHASE, STATUS, SPEED_IN, RESTITUTION, LAW, PENETRATION_MAX, SAMPLES))
FOLDED_OBLIQUE = keys((ANGLE, SLIP_IN, IMPULSE_RATIO, COULOMB))
# Speeds of a curve; of more, one stands for its neighbours.
MOST_SPEEDS = 1000
# Significant digits of measured numbers in files.
_DIGITS = 10
# Decimals of measured numbers in files, at most.
_DECIMALS = 14
# Measured numbers below this are written as 0.
_LEAST = 1e-14
# Powers of ten by their exponent, negative ones from the end. Parsing gives the nearest float on
# every processor; computing may not.
_POWERS = np.array([float(f"1e{k}") for k in (*range(_DECIMALS + 1), *range(-30, 0))])
_Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class ShownLaunches:
    """One launch of each speed: in one phase, or the nearest to it that there is."""

    phase: float
    restitution: Floats
    speed_in: Floats
    samples: NDArray[np.int64]

    @classmethod
    def joined(cls, parts: Sequence[ShownLaunches]) -> ShownLaunches:
        """Launches of several parts of a curve, one part after another; at least one part."""
        return cls(
            parts[0].phase,
            np.concatenate([part.restitution for part in parts]),
            np.concatenate([part.speed_in for part in parts]),
            np.concatenate([part.samples for part in parts]),
        )


@dataclass(frozen=True, slots=True)
class Folded:
    """Impacts of one setting, α and step.

    status: how many ended so, in the order in which they came. angle, rad: the smallest, that
    `curve` and `at_step` are of, 0 as a rule.
    curve: e over launch speed against e of (16), speeds rising.
    of_loops, half_way: one launch of each speed of the curve: in the phase whose loops are kept,
    the later of two middle ones; and in the phase nearest to half-way through a step.
    at_step: the point of the study's step_speed; None where none was launched so.
    depth: the greatest, m.
    restitution: the least and the largest e.
    off: largest |e - e of (16)|; off_parted: of those that parted.
    rested: the fastest that came to rest, m/s.
    friction: largest difference between the ratio of impulses and Coulomb's; None where nothing
    slid.
    """

    status: Mapping[str, int]
    angle: float
    curve: Curve
    of_loops: ShownLaunches
    half_way: ShownLaunches
    at_step: CurvePoint | None
    depth: float
    restitution: tuple[float, float]
    off: float
    off_parted: float
    rested: float
    friction: float | None

    def __len__(self) -> int:
        return sum(self.status.values())


@dataclass(frozen=True, slots=True)
class _Part:
    """The curve of some speeds at one angle (rad), and what is shown of it."""

    angle: float
    curve: Curve
    of_loops: ShownLaunches
    half_way: ShownLaunches
    at_step: CurvePoint | None


class Folder:
    """Folds impacts of one setting, α and step, all of a speed at once."""

    def __init__(self, study: Mapping[str, Any]) -> None:
        """A folder without impacts yet, for one study.

        study: as JSON.
        """
        self._step_speed = float(study["step_speed"])
        self._loop_phase = (study["phases"] // 2 + 0.5) / study["phases"]
        self._edges = _edges(study)
        self._status = Counter[str]()
        self._most = dict.fromkeys(
            ("depth", "e", "minus_e", "off", "off_parted", "rested", "friction"), math.nan
        )
        self._slid = False
        self._parts: list[_Part] = []

    def place(self, asked: Floats) -> NDArray[Any]:
        """A number that speeds (m/s) share of which one is shown."""
        return asked.round(12) if self._edges is None else np.searchsorted(self._edges, asked)

    def add(self, columns: _Columns) -> None:
        """Add the columns FOLDED of one impact or more, and FOLDED_OBLIQUE if the study has oblique
        launches.

        columns: arrays of shape (n,), SI, for all phases of their speeds.
        """
        e = to_digits(columns[RESTITUTION.key])
        law = to_digits(columns[LAW.key])
        speed_in = to_digits(columns[SPEED_IN.key])
        depth = to_digits(columns[PENETRATION_MAX.key])
        status = columns[STATUS.key]
        asked = columns[SPEED.key]
        angle = columns.get(ANGLE.key, np.zeros(len(e)))
        self._status.update(status.tolist())
        off = np.abs(e - law)
        self._reach(depth=depth, e=e, off=off, off_parted=off[status == "parted"])
        self._reach(rested=asked[status == "rested"], minus_e=-e)
        if ANGLE.key in columns:
            slip = to_digits(columns[SLIP_IN.key])
            ratio = to_digits(columns[IMPULSE_RATIO.key])
            coulomb = to_digits(columns[COULOMB.key])
            self._slid |= bool((slip != 0).any())
            self._reach(friction=np.abs(ratio - coulomb))
        head_on = angle == angle.min()
        part = self._part(
            e=e[head_on],
            law=law[head_on],
            speed_in=speed_in[head_on],
            samples=columns[SAMPLES.key][head_on],
            phase=columns[PHASE.key][head_on],
            asked=asked[head_on],
            angle=angle[head_on],
        )
        self._parts.append(part)

    def _reach(self, **values: Floats) -> None:
        """Raise the largest values so far, by name, to those of some
        more impacts; NaN counts as none.
        """
        for name, some in values.items():
            self._most[name] = float(np.fmax.reduce(some, initial=self._most[name]))

    def _part(
        self,
        e: Floats,
        law: Floats,
        speed_in: Floats,
        samples: NDArray[np.int64],
        phase: Floats,
        asked: Floats,
        angle: Floats,
    ) -> _Part:
        """Fold the impacts of one angle, arrays of shape (n,).

        law: e of the law.
        speed_in, asked: impact speed and the speed asked for, m/s.
        samples: steps in contact.
        phase: 0 ... 1.
        angle: rad, the same for all.
        """
        group = np.unique(asked.round(12), return_inverse=True)[1]
        curve = curve_of_columns(
            group,
            speed=asked,
            angle=angle,
            phase=phase,
            speed_in=speed_in,
            restitution=e,
            target=law,
            samples=samples,
        )
        is_at_step = np.isclose(curve.speed, self._step_speed, rtol=1e-9)
        at_step = next(iter(curve.take(is_at_step)), None)
        shown = self._one_for_neighbours(curve)

        def nearest_to(wanted: float) -> ShownLaunches:
            order = np.lexsort((phase, np.abs(phase - wanted), group))
            nearest = order[np.unique(group[order], return_index=True)[1]][shown]
            return ShownLaunches(wanted, e[nearest], speed_in[nearest], samples[nearest])

        middle_phase = min(np.unique(phase).tolist(), key=lambda p: abs(p - 0.5))
        return _Part(
            angle=float(angle.min()),
            curve=curve.take(shown),
            of_loops=nearest_to(self._loop_phase),
            half_way=nearest_to(middle_phase),
            at_step=at_step,
        )

    def _one_for_neighbours(self, curve: Curve) -> NDArray[np.int64]:
        """Indices of the points that are shown: of each place, the one with the largest error."""
        place = self.place(curve.speed)
        worst_first = np.lexsort((-np.abs(curve.worst_phase), place))
        return worst_first[np.unique(place[worst_first], return_index=True)[1]]

    def folded(self) -> Folded:
        """Fold what was added; at least one part was."""
        angle = min(part.angle for part in self._parts)
        curves = []
        of_loops = []
        half_way = []
        at_step = None
        for part in self._parts:
            # Parts at other angles have a curve of their own, which is not shown.
            if part.angle != angle:
                continue
            curves.append(part.curve)
            of_loops.append(part.of_loops)
            half_way.append(part.half_way)
            if at_step is None:
                at_step = part.at_step
        most = self._most
        friction = None
        if self._slid:
            friction = most["friction"]
        return Folded(
            status=dict(self._status),
            angle=angle,
            curve=Curve.joined(curves),
            of_loops=ShownLaunches.joined(of_loops),
            half_way=ShownLaunches.joined(half_way),
            at_step=at_step,
            depth=most["depth"],
            restitution=(-most["minus_e"], most["e"]),
            off=most["off"],
            off_parted=most["off_parted"],
            rested=most["rested"],
            friction=friction,
        )


def _edges(study: Mapping[str, Any]) -> Floats | None:
    """Speeds between those of curves: evenly over those of a study, where
    they are too many to be shown.
    """
    bands = [study["speeds"], *(run["speeds"] for run in study["runs"])]
    if max(map(len, bands)) <= MOST_SPEEDS:
        return None
    ends = min(map(min, bands)), max(map(max, bands))
    return np.linspace(*ends, MOST_SPEEDS + 1)[1:-1]


def to_digits(values: Floats) -> Floats:
    """The values rounded to so many digits, for files."""
    known = np.isfinite(values) & (np.abs(values) > _LEAST)
    size = np.floor(np.log10(np.abs(values), out=np.zeros_like(values), where=known)).astype(int)
    scale = _POWERS[np.minimum(_DIGITS - 1 - size, _DECIMALS)]
    small = np.where(np.isfinite(values), 0.0, values)
    return np.asarray(np.where(known, np.round(values * scale) / scale, small))
