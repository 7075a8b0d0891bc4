"""e over speed: the impacts of each launch speed and angle, all phases
of the time step in one point.

Every e over speed that hcbench prints, draws or compares is made here, so that the same impacts
give the same numbers to the last bit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.sim import simulate
from hcbench.sim.columns import Columns, Whole
from hcbench.sim.model_under_test import ModelUnderTest, Request
from hcbench.sim.tangential import AlongPlate, along_plate
from hcbench.terms.impact import Floats, Impact, Launch
from hcbench.terms.records import ALONG, CURVE_POINT, record
from hcbench.terms.resolution import STEPS_BY_CHANCE, STEPS_WITHOUT_CHANCE

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator


_UNKNOWN = AlongPlate(*(math.nan,) * len(ALONG))


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """All phases of one launch speed and angle; NaN where nothing parted or rested.

    A mean weighs each phase by the share of the time step that it stands for.

    speed: at launch, m/s.
    speed_in: mean at touch, m/s; gravity makes the two differ.
    restitution: mean e.
    lowest, highest: e.
    target: mean of the e wanted at each impact's speed; NaN without a target.
    worst_phase: e - target of the one impact in which it is largest, with its sign.
    samples: fewest steps in contact.
    failed: impacts without an e.
    angle: from the normal, rad.
    restitution_after_force: mean of the ratio once the contact force has ceased; e differs where
    joints or servos act until the bodies part.
    along: means of what it does along the plate; NaN if not known.
    """

    speed: float
    speed_in: float
    restitution: float
    lowest: float
    highest: float
    target: float
    worst_phase: float
    samples: int
    failed: int
    angle: float
    restitution_after_force: float = math.nan
    along: AlongPlate = _UNKNOWN

    @property
    def error(self) -> float:
        """Mean e less the mean target."""
        return self.restitution - self.target

    @property
    def spread(self) -> float:
        """Difference between the highest and the lowest e."""
        return self.highest - self.lowest

    @property
    def place(self) -> str:
        """Speed, and the angle of an oblique launch, in words."""
        place = f"{self.speed_in:.4g} m/s"
        if self.angle:
            place += f" and {math.degrees(self.angle):.4g} deg"
        return place

    def record(self, is_oblique: bool) -> dict[str, Any]:
        """The point as JSON and data frames have it.

        is_oblique: whether any launch of the curve is.
        """
        return record(CURVE_POINT, self, is_oblique)


@dataclass(frozen=True, slots=True, eq=False)
class Curve(Columns[CurvePoint]):
    """A sequence of `CurvePoint`; each column has its attribute of that name, in the same unit,
    shape (n,).

    along: shape (n, 6), the columns of `AlongPlate`.
    """

    speed: Floats
    speed_in: Floats
    restitution: Floats
    lowest: Floats
    highest: Floats
    target: Floats
    worst_phase: Floats
    samples: Whole
    failed: Whole
    angle: Floats
    restitution_after_force: Floats
    along: Floats

    def __len__(self) -> int:
        return len(self.speed)

    def __iter__(self) -> Iterator[CurvePoint]:
        *numbers, along = (column.tolist() for column in self._values())
        plates = [AlongPlate(*plate) for plate in along]
        for values in zip(*numbers, plates, strict=True):
            yield CurvePoint(*values)

    def measured(self) -> Curve:
        """The points that have an e."""
        return self.take(np.isfinite(self.restitution))


def curve_of(impacts: Iterable[Impact], wanted: Callable[[Impact], float] | None = None) -> Curve:
    """One point for each launch speed and angle, in the order of the launches.

    wanted: e that an impact should have; NaN for an impact that is held against nothing. It is
    called for impacts with an e alone; None: no target.
    The points hold speeds in m/s, angles in rad, and e over the phases: mean, lowest, highest.
    """
    every = list(impacts)
    count = len(every)
    group = np.zeros(count, dtype=np.int64)
    samples = np.zeros(count, dtype=np.int64)
    speed, angle, phase = np.zeros((3, count))
    speed_in, restitution, after_force = np.zeros((3, count))
    along = np.zeros((count, len(ALONG)))
    target = np.full(count, math.nan)
    # Number of the point of a launch, by the launch without its phase.
    number_of: dict[Launch, int] = {}
    for i, impact in enumerate(every):
        launch = impact.launch
        group[i] = number_of.setdefault(launch.at_any_phase, len(number_of))
        samples[i] = impact.samples
        speed[i] = launch.speed
        angle[i] = launch.angle
        phase[i] = launch.phase
        speed_in[i] = impact.speed_in
        restitution[i] = impact.restitution
        after_force[i] = impact.restitution_after_force
        along[i] = along_plate(impact)
        if wanted is not None and impact.is_measured:
            target[i] = wanted(impact)
    return curve_of_columns(
        group,
        speed=speed,
        angle=angle,
        phase=phase,
        speed_in=speed_in,
        restitution=restitution,
        target=target,
        samples=samples,
        after_force=after_force,
        along=along,
    )


def worst_of(points: Iterable[CurvePoint]) -> CurvePoint | None:
    """The point with the largest error of any phase; None where no point has one."""
    known = [point for point in points if not math.isnan(point.worst_phase)]
    return max(known, key=lambda point: abs(point.worst_phase), default=None)


@dataclass(frozen=True, slots=True)
class _Phases:
    """Impacts that count for the numbers of k points, in the order of points and their phases.

    count: k.
    rows: numbers of these m impacts among all, (m,).
    known: points that have any, rising, (p,).
    starts, sizes: where each of these begins in `rows`, and how many of its impacts count, (p,).
    share: of the time step that each impact stands for, (m,); a point's add up to 1.
    """

    count: int
    rows: Whole
    known: Whole
    starts: Whole
    sizes: Whole
    share: Floats

    def mean(self, values: Floats | None, width: int = 1) -> Floats:
        """Means of each point, weighed by the shares, (k,), or (k, width) if width > 1; NaN for a
        point without an impact that counts.

        values: of all impacts, (n,) or (n, width); None: not known, all NaN.
        """
        means = np.full((self.count, width), math.nan)
        if values is not None:
            ordered = values[self.rows].reshape(-1, width)
            # Mean = first value + mean of the differences from it: then the mean of equal values is
            # their value, to the last bit.
            first = ordered[self.starts]
            differences = ordered - np.repeat(first, self.sizes, axis=0)
            weighed = self.share[:, np.newaxis] * differences
            means[self.known] = first + np.add.reduceat(weighed, self.starts, axis=0)
        if width > 1:
            return means
        return means[:, 0]

    def of_points(self, values: Floats) -> Floats:
        """A number of each point, (k,), from those of the known ones, (p,); NaN for the others."""
        column = np.full(self.count, math.nan)
        column[self.known] = values
        return column


def curve_of_columns(
    group: Whole,
    *,
    speed: Floats,
    angle: Floats,
    phase: Floats,
    speed_in: Floats,
    restitution: Floats,
    target: Floats,
    samples: Whole,
    after_force: Floats | None = None,
    along: Floats | None = None,
) -> Curve:
    """One point for each group of impacts that are given as columns, shape (n,), in the order of
    groups.

    group: number of the point that an impact belongs to, each of 0 to k - 1 at least once.
    speed: at launch, m/s.
    angle: from the normal, rad.
    phase: share of a step; each impact of a group has its own phase.
    speed_in: at the touch, m/s.
    restitution: NaN for an impact without an e.
    target: NaN for an impact that is held against nothing.
    samples: steps in contact.
    after_force: the ratio of speeds once the contact force has ceased; None where it was not
    recorded.
    along: the numbers ALONG of oblique impacts, shape (n, 6); None without any.
    Where some impacts of a group have a target, only those count for its means.
    """
    _, first_of_group = np.unique(group, return_index=True)
    count = len(first_of_group)
    has_e = ~np.isnan(restitution)
    has_target = has_e & ~np.isnan(target)
    # A baseline may lack some phases. e and target are means over the
    # same ones, so that they compare.
    compares = np.bincount(group[has_target], minlength=count) > 0
    counts = np.where(compares[group], has_target, has_e)
    by_phase = np.lexsort((phase, group))
    # Numbers of the impacts that count, by groups and then phases; from here on arrays are of these.
    rows = by_phase[counts[by_phase]]
    known, starts, sizes = np.unique(group[rows], return_index=True, return_counts=True)
    share = step_shares(phase[rows], starts)
    phases = _Phases(count=count, rows=rows, known=known, starts=starts, sizes=sizes, share=share)

    e = restitution[rows]
    error = e - target[rows]
    # Within each group the largest error first, so that `starts` are the places of the largest.
    worst_first = np.lexsort((-np.abs(error), group[rows]))
    # A group without any e keeps the largest number, in place of which it gets 0.
    fewest = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(fewest, group[has_e], samples[has_e])
    failed = np.bincount(group[~has_e], minlength=count)
    has_any_e = failed < np.bincount(group, minlength=count)
    return Curve(
        speed=speed[first_of_group],
        speed_in=phases.mean(speed_in),
        restitution=phases.mean(restitution),
        lowest=phases.of_points(np.minimum.reduceat(e, starts)),
        highest=phases.of_points(np.maximum.reduceat(e, starts)),
        target=phases.mean(target),
        worst_phase=phases.of_points(error[worst_first][starts]),
        samples=np.where(has_any_e, fewest, 0),
        failed=failed,
        angle=angle[first_of_group],
        restitution_after_force=phases.mean(after_force),
        along=phases.mean(along, len(ALONG)),
    )


def step_shares(phases: Floats, starts: Whole) -> Floats:
    """The share of a step that each phase stands for, (n,); those of a group add up to 1.

    phases: where in a step each contact starts, 0 to 1, (n,); rising within each group.
    starts: index at which each of the k groups begins, (k,).
    The share is half of the gaps to the two neighbours; the first phase follows the last one, as
    one step follows another. `measure` launches at more phases where e differs between neighbours,
    so the phases are not even.
    """
    # Index of the last phase of each group; the cut is for no phases at all.
    ends = np.append(starts[1:], len(phases))[: len(starts)] - 1
    following = np.roll(phases, -1)
    # After the last phase of a group comes its first, a step later.
    following[ends] = phases[starts] + 1.0
    gap_after = following - phases
    gap_before = np.roll(gap_after, 1)
    gap_before[starts] = gap_after[ends]
    return (gap_after + gap_before) / 2


# Two phases nearer than this share of a step are not simulated apart.
_NARROWEST = 1 / 256
# Between neighbours whose e differ by less nothing is looked for.
_SAME_E = 2e-3
# The same, as a share of the scatter found so far.
_SAME_SHARE = 0.2
# Phases of one speed, at most.
_PHASES_MAX = 32


def impacts_of(model: ModelUnderTest, request: Request) -> list[Impact]:
    """Launch what a request asks for: impacts by speed, angle and phase (where in a step the
    contact starts, 0 to 1).

    If the user gave no phases (`request.adapt_phases`), they are chosen: a contact of many steps is
    launched at one phase, others at those of the request; then, where few steps decide, the gap
    between two neighbours whose e differ is halved until the scatter of e is found, up to
    _PHASES_MAX phases.
    Raises what the model raises at a launch.
    """
    if not request.adapt_phases:
        return simulate.impacts_in(model, request.launches())
    # One list for each speed and angle, with a launch at each phase asked for.
    wanted: list[list[Launch]] = []
    for speed, angle in itertools.product(request.speeds, request.angle):
        wanted.append(replace(request, speeds=(speed,), angle=(angle,)).launches())
    # All speeds together in each round, for engines that take as long for many as for one.
    first = simulate.impacts_in(model, [launches[0] for launches in wanted])
    groups = [[impact] for impact in first]
    # Launches of the next round, by the place of their group.
    new: dict[int, list[Launch]] = {}
    for place, impact in enumerate(first):
        if impact.samples < STEPS_WITHOUT_CHANCE:
            new[place] = wanted[place][1:]
    while new:
        of_round = list(itertools.chain.from_iterable(new.values()))
        impacts = iter(simulate.impacts_in(model, of_round))
        tried = new
        new = {}
        for place, launches in tried.items():
            # The impacts come group by group, as the launches were sent.
            groups[place] += itertools.islice(impacts, len(launches))
            groups[place].sort(key=lambda impact: impact.launch.phase)
            more = _between(groups[place])
            if more:
                new[place] = more
    return list(itertools.chain.from_iterable(groups))


def _between(impacts: Sequence[Impact]) -> list[Launch]:
    """Launches at phases half-way between neighbours whose e differ, the most different first; empty
    once no neighbours differ by much, and where a contact takes so many steps that its phase hardly
    matters.

    impacts: of one speed and angle, in the order of their phases, one or more. The first phase
    follows the last one, as one step follows another.
    """
    room = _PHASES_MAX - len(impacts)
    if room <= 0 or min(impact.samples for impact in impacts) > STEPS_BY_CHANCE:
        return []
    e = [impact.restitution for impact in impacts]
    known = [value for value in e if math.isfinite(value)]
    scatter = max(known, default=0.0) - min(known, default=0.0)
    notable = max(_SAME_E, _SAME_SHARE * scatter)
    phases = [impact.launch.phase for impact in impacts]
    e.append(e[0])
    phases.append(phases[0] + 1.0)
    # Pairs of (minus the difference in e, the phase half-way): sorting puts the largest first.
    gaps: list[tuple[float, float]] = []
    for i in range(len(impacts)):
        difference = abs(e[i + 1] - e[i])
        if difference > notable and phases[i + 1] - phases[i] > _NARROWEST:
            middle = (phases[i] + phases[i + 1]) / 2
            gaps.append((-difference, middle % 1.0))
    return [replace(impacts[0].launch, phase=phase) for _, phase in sorted(gaps)[:room]]
