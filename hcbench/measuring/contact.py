"""Meaning of a contact in a robot's words: its stiffness and damping, the loads that it carries,
its landings, and the steps at which it is stable.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.measuring.curve import CurvePoint, curve_of
from hcbench.sim import simulate
from hcbench.sim.passivity import MOST_E
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.rest import Carried, LandingPeak
from hcbench.system.errors import HcbenchError
from hcbench.system.text import number, time_step
from hcbench.terms.impact import Launch, Status
from hcbench.terms.records import (
    CONTACT,
    CONTACT_IMPACT,
    CONTACT_LOAD,
    CONTACT_STEP,
    LANDING_PEAK,
    record,
)

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import ModelUnderTest, Request
    from hcbench.terms.impact import Floats, Impact

# Multiples of the model's step at which it is launched again, rising; the search for the largest
# stable step ends at the first that is not stable.
SHARES_OF_STEP = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
# A spring and a damper are read from touches of at least so many steps each.
_STEPS_TO_FIT = 3
# A force that differs from all springs with dampers by more than this share is none of them.
_MISFIT_MAX = 0.1
# A launch that gains energy may be one of few phases.
_PHASES = 32
# A touch is followed for so many steps at a time, and at most.
_ADVANCED = 32
_FOLLOWED = 1024


@dataclass(frozen=True, slots=True)
class ContactImpact:
    """The contact in impacts at one launch speed, means over their phases, SI; NaN without a number.

    point: e of them.
    duration: of the contact.
    penetration, force: the largest.
    stiffness, damping: of the spring and damper whose force is nearest to the contact's in the
    first touch, with a constant force beside them.
    misfit: what that leaves, rms over the largest force.
    damping_ratio: damping over that of the aperiodic limit, 2 √(stiffness · effective mass); NaN
    where joints and servos act, too.
    """

    point: CurvePoint
    duration: float
    penetration: float
    force: float
    stiffness: float
    damping: float
    damping_ratio: float
    misfit: float


@dataclass(frozen=True, slots=True)
class ContactStep:
    """The fastest launches at another time step, s.

    point: e of them; None where the model cannot be launched at this step.
    """

    timestep: float
    point: CurvePoint | None

    @property
    def is_stable(self) -> bool:
        """True if every launch has an e, and none leaves faster than it came."""
        point = self.point
        return point is not None and not point.failed and point.highest <= MOST_E

    @property
    def restitution(self) -> float:
        """Mean e; NaN without one."""
        return math.nan if self.point is None else self.point.restitution

    @property
    def lowest(self) -> float:
        """The least e."""
        return math.nan if self.point is None else self.point.lowest

    @property
    def highest(self) -> float:
        """The largest e."""
        return math.nan if self.point is None else self.point.highest

    @property
    def samples(self) -> int:
        """Fewest steps in contact; 0 without a launch."""
        return 0 if self.point is None else self.point.samples


@dataclass(frozen=True, slots=True)
class ContactMeaning:
    """Numbers of a contact that its parameters do not show, SI.

    impacts: at the slowest and the fastest launch speed.
    carried: at rest.
    peaks: of landings of the whole body; () where it cannot fall.
    steps: rising, one of them the model's own.
    """

    impacts: tuple[ContactImpact, ...]
    carried: Carried
    peaks: tuple[LandingPeak, ...]
    steps: tuple[ContactStep, ...]

    @property
    def largest_stable_step(self) -> float:
        """The largest step, s, that was tried, up to which all are stable; NaN where none is."""
        largest = math.nan
        for step in self.steps:
            if not step.is_stable:
                break
            largest = step.timestep
        return largest

    @property
    def record(self) -> dict[str, Any]:
        """The numbers as `--json` prints them, SI: those of the contact, then lists of impacts,
        loads, landings and steps.
        """
        numbers = record(CONTACT, self)
        # Of each list its key, the table of its fields, and its items.
        parts: dict[str, tuple[Any, Sequence[Any]]] = {
            "impacts": (CONTACT_IMPACT, self.impacts),
            "loads": (CONTACT_LOAD, self.carried.loads),
            "landings": (LANDING_PEAK, self.peaks),
            "steps": (CONTACT_STEP, self.steps),
        }
        for key, (fields, items) in parts.items():
            numbers[key] = [record(fields, item) for item in items]
        return numbers


def contact_in(model: ModelUnderTest, request: Request) -> ContactMeaning:
    """Measure a contact in impacts along the normal and at rest; landings and steps are left out."""
    impacts = [_impact(model, _straight(request, speed)) for speed in _ends(request)]
    return ContactMeaning(tuple(impacts), model.carried(), (), ())


def contact_over_steps(
    meaning: ContactMeaning,
    request: Request,
    timestep: float,
    at_step: Callable[[float], ModelUnderTest],
) -> ContactMeaning:
    """The meaning of a contact with its `steps` filled in: e of the fastest launches at the model's
    time step and at shorter and longer ones.

    request: its highest speed is launched.
    timestep: the model's, s; steps are its multiples by SHARES_OF_STEP, up to the first above 1
    that is not stable.
    at_step: opens the same pair at a time step, s. A step at which the pair cannot be opened has no
    point; errors that are not hcbench's are raised.
    """
    many = replace(request, phases=tuple((k + 0.5) / _PHASES for k in range(_PHASES)))
    launches = _straight(many, max(request.speeds))
    steps = []
    for share in SHARES_OF_STEP:
        steps.append(_at_another_step(share * timestep, launches, at_step))
        if share > 1.0 and not steps[-1].is_stable:
            break
    return replace(meaning, steps=tuple(steps))


def _ends(request: Request) -> list[float]:
    """The slowest and the fastest launch speed, m/s; one where they are the same."""
    return sorted({min(request.speeds), max(request.speeds)})


def _straight(request: Request, speed: float) -> list[Launch]:
    """Launches at a speed, m/s, along the normal, at each phase of a request."""
    straight = replace(request, speeds=(speed,), angle=(0.0,), spin=(0.0, 0.0, 0.0))
    return straight.launches()


def _at_another_step(
    timestep: float, launches: Sequence[Launch], at_step: Callable[[float], ModelUnderTest]
) -> ContactStep:
    """Launch a pair at another time step: e of launches of one speed, or no point where the model
    cannot be launched at this step.

    timestep: s.
    at_step: opens the pair at a time step, s. An HcbenchError, such as for a step beyond all
    bounds, means that it cannot; other errors are raised.
    """
    try:
        with at_step(timestep) as model:
            return ContactStep(timestep, _point(simulate.impacts_in(model, launches)))
    except HcbenchError:
        # Such as a step beyond all bounds, or one in which the two pass each other.
        return ContactStep(timestep, point=None)


def _point(impacts: Sequence[Impact]) -> CurvePoint:
    """e of launches that differ in phase alone."""
    (point,) = curve_of(impacts)
    return point


def _impact(model: ModelUnderTest, launches: Sequence[Launch]) -> ContactImpact:
    """Measure the contact in launches of one speed, one or more, that differ in phase alone: means
    of e, duration, depth and force, and the spring and damper nearest to its force.

    The spring and damper are fitted to all first touches together. They are NaN unless each touch
    has steps enough and the force is nearly that of a spring with a damper; so is any other number
    that no launch shows.
    """
    impacts = simulate.impacts_in(model, launches)
    touches = [_first_touch(model, launch) for launch in launches]
    fit = SpringFit()
    if min(touch.shape[1] for touch in touches) >= _STEPS_TO_FIT:
        fit = spring_and_damper(*np.concatenate(touches, axis=1))
        # RK4 tells the force of a stage beside the depth of the step.
        of_stages = model.speed_reading is SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
        # Impulses that stop a body within a step are like no spring.
        is_like_one = fit.stiffness > 0.0 and fit.misfit <= _MISFIT_MAX
        if of_stages or not is_like_one:
            fit = SpringFit(misfit=fit.misfit)
    facts = model.facts()
    ratio = math.nan
    if fit.stiffness > 0.0 and not facts.shares:
        ratio = fit.damping / (2.0 * math.sqrt(fit.stiffness * facts.effective_mass))
    parted = [impact for impact in impacts if impact.status is Status.PARTED]
    return ContactImpact(
        point=_point(impacts),
        duration=_mean([impact.duration for impact in parted]),
        penetration=_mean([impact.penetration_max for impact in impacts]),
        force=_mean([impact.force_max for impact in impacts]),
        stiffness=fit.stiffness,
        damping=fit.damping,
        damping_ratio=ratio,
        misfit=fit.misfit,
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else math.nan


def _first_touch(model: ModelUnderTest, launch: Launch) -> Floats:
    """Follow a launch until its first touch is over, and return the steps in which a force acts:
    rows of penetration (m), rate (m/s) and force (N), shape (3, n).

    n is 0 for a launch that never touches. At most _FOLLOWED steps are followed; those with numbers
    that are not finite are left out.
    """
    parts: list[Floats] = []
    with closing(model.follow(launch)) as simulation:
        for _ in range(_FOLLOWED // _ADVANCED):
            parts.append(simulation.advance(_ADVANCED).rows()[:3, 0])
            force = np.concatenate(parts, axis=1)[2]
            acts = np.flatnonzero(force)
            # A step without force after one with force: the touch is over.
            has_parted = acts.size > 0 and not force[acts[0] :].all()
            if has_parted or not np.isfinite(force).all():
                break
    rows = np.concatenate(parts, axis=1)
    is_acting = rows[2] != 0.0
    if not is_acting.any():
        return rows[:, :0]
    begin = int(is_acting.argmax())
    end = len(is_acting)
    is_over = ~is_acting[begin:]
    if is_over.any():
        end = begin + int(is_over.argmax())
    touch: Floats = rows[:, begin:end]
    return touch[:, np.isfinite(touch).all(axis=0)]


class SpringFit(NamedTuple):
    """The spring and damper nearest to a force; NaN where there is none.

    stiffness: k, N/m.
    damping: c, N s/m.
    misfit: rms of the force that they leave, over the largest force.
    """

    stiffness: float = math.nan
    damping: float = math.nan
    misfit: float = math.nan


def spring_and_damper(penetration: Floats, rate: Floats, force: Floats) -> SpringFit:
    """Fit force = k penetration + c rate + constant by least squares; all NaN where the steps do
    not tell k, c and the constant apart.

    penetration (m), rate (m/s) and force (N): of the steps in contact, (n,) each.
    The constant, which is left out of the result, is part of a soft constraint's force: its share
    of what else accelerates the body.
    """
    columns = np.array([penetration, rate, np.ones(len(force))])
    # Metres and metres a second differ by orders: columns of like size keep the digits.
    sizes = np.abs(columns).max(axis=1)
    if not sizes.all():
        return SpringFit()
    scaled = (columns / sizes[:, None]).T
    solution, _, rank, _ = np.linalg.lstsq(scaled, force, rcond=1e-9)
    if rank < len(columns):
        return SpringFit()
    residual = force - scaled @ solution
    misfit = float(np.sqrt(np.mean(residual**2)) / np.abs(force).max())
    stiffness, damping, _ = (solution / sizes).tolist()
    return SpringFit(stiffness, damping, misfit)


def as_lines(meaning: ContactMeaning) -> list[str]:
    """Lines of a table for a terminal: the contact in impacts, at rest, in landings, over steps."""
    rows = [*_impact_rows(meaning), *_load_rows(meaning.carried)]
    for peak in meaning.peaks:
        title = f"peak force over weight, dropped from {100 * peak.height:g} cm"
        rows.append((title, _from_to(peak.lowest, peak.highest, ".3g")))
    rows += _step_rows(meaning.steps)
    speed = f"{_speed(meaning.impacts[-1].point):.3g}"
    rows.append((f"at {speed} m/s no launch gains up to a step of, s", _largest(meaning)))
    return _two_columns(rows)


def _largest(meaning: ContactMeaning) -> str:
    """The largest stable step as text."""
    largest = meaning.largest_stable_step
    if math.isnan(largest):
        return "none"
    is_last = largest == meaning.steps[-1].timestep
    return f"{time_step(largest)} or more" if is_last else time_step(largest)


# A title and its value; of impacts, the value at the slowest and at the fastest.
_Row = tuple[str, ...]


def _impact_rows(meaning: ContactMeaning) -> Iterator[_Row]:
    """Rows of the slowest and the fastest launches, which head the table."""
    impacts = meaning.impacts

    def row(title: str, text: Callable[[ContactImpact], str]) -> _Row:
        return title, *map(text, impacts)

    yield row("what the contact means", lambda i: f"at {_speed(i.point):.3g} m/s")
    yield row("e", lambda i: number(i.point.restitution, ".3f"))
    yield row("contact time, ms", _duration)
    yield row("steps in contact", lambda i: str(i.point.samples))
    yield row("largest penetration, mm", lambda i: number(1e3 * i.penetration, ".3g"))
    yield row("largest force, N", lambda i: number(i.force, ".3g"))
    if any(math.isfinite(impact.stiffness) for impact in impacts):
        yield row("stiffness, N/m", lambda i: number(i.stiffness, ".3g"))
        yield row("damping, N s/m", lambda i: number(i.damping, ".3g"))
        # Joints and servos that act, too, leave no ratio.
        if any(math.isfinite(impact.damping_ratio) for impact in impacts):
            yield row("damping ratio", lambda i: number(i.damping_ratio, ".2g"))
        yield row("misfit of spring and damper, %", lambda i: number(100 * i.misfit, ".2g"))


def _speed(point: CurvePoint) -> float:
    """Impact speed, m/s; of launches without an e, their launch speed."""
    return point.speed_in if math.isfinite(point.speed_in) else point.speed


def _duration(impact: ContactImpact) -> str:
    """Contact time in ms, as text."""
    if math.isnan(impact.duration) and impact.point.restitution == 0.0:
        return "stays"
    return number(1e3 * impact.duration, ".3g")


def _load_rows(carried: Carried) -> Iterator[_Row]:
    """Rows of what the contact carries at rest; none where the two do not rest on each other."""
    if not carried.loads:
        return
    times = ", ".join(f"{load.times:g}" for load in carried.loads)
    depths = ", ".join(number(1e3 * load.penetration, ".3g") for load in carried.loads)
    yield "force at rest, N", number(carried.load, ".4g")
    yield "stiffness at rest, N/m", number(carried.stiffness, ".3g")
    yield f"penetration under {times} times that force, mm", depths
    if math.isfinite(carried.weakest):
        holds = number(math.degrees(carried.holds), ".3g")
        most = number(math.degrees(carried.holds_most), ".3g")
        if holds != most:
            holds += f" (in the best direction {most})"
        yield "steepest slope that it holds, deg", holds
    if math.isfinite(carried.creep):
        title = f"creep on a slope of {math.degrees(carried.slope):.3g} deg, mm/s"
        yield title, number(1e3 * carried.creep, ".3g")


def _step_rows(steps: Sequence[ContactStep]) -> Iterator[_Row]:
    """Rows of e over time steps; steps that follow each other with the same e have one row."""

    def said(step: ContactStep) -> str:
        if step.point is None:
            return "cannot be launched"
        value = _from_to(step.lowest, step.highest, ".3f")
        if step.point.failed:
            value += f", {step.point.failed} launches without an e"
        return value

    for value, group in itertools.groupby(steps, said):
        first, *others = group
        title = time_step(first.timestep)
        if others:
            title += f" ... {time_step(others[-1].timestep)}"
        yield f"e at a step of {title} s", value


def _from_to(lowest: float, highest: float, digits: str) -> str:
    """A range, or its one value, as text."""
    low, high = number(lowest, digits), number(highest, digits)
    return low if low == high else f"{low} ... {high}"


def _two_columns(rows: Sequence[_Row]) -> list[str]:
    """Lines of rows: titles at the left, then the values, aligned in two columns.

    rows: (title, value) or (title, first value, second value); a lone value, which may be long,
    does not widen the first column.
    """
    title_width = max(len(title) for title, *_ in rows)
    value_width = 0
    for _title, value, *others in rows:
        if others:
            value_width = max(value_width, len(value))
    lines = []
    for title, value, *others in rows:
        cells = [value]
        if others:
            cells = [value.ljust(value_width), *others]
        lines.append(f"{title:<{title_width}}  {'  '.join(cells)}".rstrip())
    return lines
