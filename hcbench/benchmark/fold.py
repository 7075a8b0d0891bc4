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

from hcbench.impact import Floats

# What is folded: columns of impacts, and those that only studies with oblique launches have.
FOLDED = (
    "speed_m_per_s",
    "phase",
    "status",
    "speed_in_m_per_s",
    "restitution",
    "restitution_law",
    "penetration_max_m",
    "samples",
)
FOLDED_OBLIQUE = ("angle_rad", "slip_in_m_per_s", "impulse_ratio", "impulse_ratio_coulomb")
MOST_SPEEDS = 1000  # in a curve; of more, neighbours are folded into one
_DIGITS, _DECIMALS, _LEAST = 10, 14, 1e-14  # of measured numbers
# By their exponents, negative ones from the end: the float nearest to each, which no processor may miss.
_POWERS = np.array([float(f"1e{k}") for k in (*range(_DECIMALS + 1), *range(-30, 0))])
_Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class ShownLaunches:
    """One launch of each speed: in one phase, or the nearest to it that there is."""

    phase: float
    restitution: Floats
    speed_in: Floats
    samples: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Curve:
    """e over impact speed of one setting for one α; arrays over the speeds asked for, phases folded.

    asked: m/s, rising. speed: as measured, m/s. low, middle, high: least, median and largest e over the
    phases. error: largest |e - e of (16)| over the phases. loss: median of ½ m (v_i² - v_o²), J. All but
    `asked` are NaN where no impact came back. of_loops, half_way: the launches whose loops are kept, in the
    later of two middle phases; and those nearest to half-way through a step.
    """

    asked: Floats
    speed: Floats
    low: Floats
    middle: Floats
    high: Floats
    error: Floats
    loss: Floats
    of_loops: ShownLaunches
    half_way: ShownLaunches

    def bounced(self) -> Curve:
        """The curve at the speeds from which an impact came back."""
        curve: Curve = _chosen([self], [np.isfinite(self.low)])
        return curve


def _chosen(parts: Sequence[Any], which: Sequence[NDArray[Any]]) -> Any:
    """Join some of the speeds of several parts of a curve, or of what is shown of it."""
    values = []
    for name in type(parts[0]).__dataclass_fields__:
        column = [getattr(part, name) for part in parts]
        if isinstance(column[0], np.ndarray):
            values.append(np.concatenate([c[w] for c, w in zip(column, which, strict=True)]))
        else:
            values.append(_chosen(column, which) if isinstance(column[0], ShownLaunches) else column[0])
    return type(parts[0])(*values)


@dataclass(frozen=True, slots=True)
class Folded:
    """Impacts of one setting, α and step.

    status: how many ended so, in the order in which they came. angle, rad: the smallest, that `curve` and
    `at_step` are of, 0 as a rule. at_step: least, median and largest e at the study's step_speed; None where
    none was launched so. depth: the greatest, m. restitution: the least and the largest e. off: largest
    |e - e of (16)|; off_parted: of those that parted. rested: the fastest that came to rest, m/s. friction:
    largest difference between the ratio of impulses and Coulomb's; None where nothing slid.
    """

    status: Mapping[str, int]
    angle: float
    curve: Curve
    at_step: tuple[float, float, float] | None
    depth: float
    restitution: tuple[float, float]
    off: float
    off_parted: float
    rested: float
    friction: float | None

    def __len__(self) -> int:
        return sum(self.status.values())


class Folder:
    """Folds impacts of one setting, α and step, all of a speed at once."""

    def __init__(self, study: Mapping[str, Any]) -> None:
        """study: as JSON."""
        self._mass, self._step_speed = float(study["mass_kg"]), float(study["step_speed"])
        self._loop_phase = (study["phases"] // 2 + 0.5) / study["phases"]
        self._edges = _edges(study)
        self._status = Counter[str]()
        self._most = dict.fromkeys(
            ("depth", "e", "minus_e", "off", "off_parted", "rested", "friction"), math.nan
        )
        self._slid = False
        self._curves: list[tuple[float, Curve, Floats]] = []

    def place(self, asked: Floats) -> NDArray[Any]:
        """A number that speeds (m/s) share which are folded into one."""
        return asked.round(12) if self._edges is None else np.searchsorted(self._edges, asked)

    def add(self, columns: _Columns) -> None:
        """Add the columns FOLDED of one impact or more, and FOLDED_OBLIQUE where there are such."""
        e, law, speed_in, depth = (
            to_digits(columns[name])
            for name in ("restitution", "restitution_law", "speed_in_m_per_s", "penetration_max_m")
        )
        status, asked = columns["status"], columns["speed_m_per_s"]
        self._status.update(status.tolist())
        off = np.abs(e - law)
        self._reach(depth=depth, e=e, off=off, off_parted=off[status == "parted"])
        self._reach(rested=asked[status == "rested"], minus_e=-e)
        angle = columns.get("angle_rad", np.zeros(len(e)))
        if "angle_rad" in columns:
            slip, ratio, coulomb = (to_digits(columns[name]) for name in FOLDED_OBLIQUE[1:])
            self._slid |= bool((slip != 0).any())
            self._reach(friction=np.abs(ratio - coulomb))
        head_on = angle == angle.min()
        seen = (e, law, speed_in, columns["samples"], columns["phase"], asked)
        e, law, speed_in, samples, phase, asked = (each[head_on] for each in seen)
        curve = self._curve(asked, phase, e, law, speed_in, samples)
        at_step = e[np.isclose(asked, self._step_speed, rtol=1e-9)]
        self._curves.append((float(angle.min()), curve, at_step))

    def _reach(self, **values: Floats) -> None:
        for name, some in values.items():
            self._most[name] = float(np.fmax.reduce(some, initial=self._most[name]))

    def _curve(
        self, asked: Floats, phase: Floats, e: Floats, law: Floats, speed_in: Floats, samples: Any
    ) -> Curve:
        each, group = np.unique(self.place(asked), return_inverse=True)
        good = np.isfinite(e)

        def ordered(values: Floats, rank: str, among: NDArray[np.bool_] = good) -> Floats:
            return _ranked(values[among], group[among], len(each), rank)

        middle_phase = min(np.unique(phase).tolist(), key=lambda p: abs(p - 0.5))

        def shown(wanted: float) -> ShownLaunches:
            order = np.lexsort((phase, np.abs(phase - wanted), group))
            nearest = order[np.unique(group[order], return_index=True)[1]]
            return ShownLaunches(wanted, e[nearest], speed_in[nearest], samples[nearest])

        return Curve(
            asked=ordered(asked, "median", np.ones(len(e), bool)),
            speed=ordered(speed_in, "median"),
            low=ordered(e, "least"),
            middle=ordered(e, "median"),
            high=ordered(e, "largest"),
            error=ordered(np.abs(e - law), "largest"),
            loss=ordered(0.5 * self._mass * speed_in**2 * (1 - e**2), "median"),
            of_loops=shown(self._loop_phase),
            half_way=shown(middle_phase),
        )

    def folded(self) -> Folded:
        """Fold what was added."""
        angle = min(angle for angle, *_ in self._curves)
        parts = [curve for own, curve, _ in self._curves if own == angle]
        at_step = np.concatenate([e for own, _, e in self._curves if own == angle])
        most = self._most
        return Folded(
            status=dict(self._status),
            angle=angle,
            curve=_chosen(parts, [np.ones(len(part.asked), bool) for part in parts]),
            at_step=_span(at_step) if len(at_step) else None,
            depth=most["depth"],
            restitution=(-most["minus_e"], most["e"]),
            off=most["off"],
            off_parted=most["off_parted"],
            rested=most["rested"],
            friction=most["friction"] if self._slid else None,
        )


def _edges(study: Mapping[str, Any]) -> Floats | None:
    """Speeds between those of curves: evenly over those of a study, where they are too many to be shown."""
    bands = [study["speeds"], *(run["speeds"] for run in study["runs"])]
    if max(map(len, bands)) <= MOST_SPEEDS:
        return None
    ends = min(map(min, bands)), max(map(max, bands))
    return np.linspace(*ends, MOST_SPEEDS + 1)[1:-1]


def _ranked(values: Floats, group: NDArray[np.int64], groups: int, rank: str) -> Floats:
    """The least, the largest or the median value of each group, NaN for none."""
    count = np.bincount(group, minlength=groups)
    first = np.cumsum(count) - count
    in_order, some = values[np.lexsort((values, group))], count > 0
    first, count = first[some], count[some]
    ranked = np.full(groups, math.nan)
    if rank == "median":
        ranked[some] = (in_order[first + (count - 1) // 2] + in_order[first + count // 2]) / 2.0
    else:
        ranked[some] = in_order[first if rank == "least" else first + count - 1]
    return ranked


def _span(e: Floats) -> tuple[float, float, float]:
    """The least, the median and the largest; NaN where no impact came back."""
    known = e[np.isfinite(e)]
    if not len(known):
        return math.nan, math.nan, math.nan
    return float(known.min()), float(np.median(known)), float(known.max())


def to_digits(values: Floats) -> Floats:
    """The values as files have them: to so many digits."""
    known = np.isfinite(values) & (np.abs(values) > _LEAST)
    size = np.floor(np.log10(np.abs(values), out=np.zeros_like(values), where=known)).astype(int)
    scale = _POWERS[np.minimum(_DIGITS - 1 - size, _DECIMALS)]
    small = np.where(np.isfinite(values), 0.0, values)
    return np.asarray(np.where(known, np.round(values * scale) / scale, small))
