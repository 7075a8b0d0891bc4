"""`land`: one call from a robot's model to how it lands, dropped on its floor under its controller;
and `measure_trajectory`: at which speeds a recorded motion met the floor.
"""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hcbench.measuring.measure import Job, run_job, source_of
from hcbench.measuring.measurement import NOTABLE_GAIN, TOLERANCE
from hcbench.measuring.request import (
    is_python,
    make_request,
    python_function,
    read_limit,
    read_named,
)
from hcbench.sim.capabilities import LandsRobots
from hcbench.sim.landing import (
    ENOUGH_STEPS,
    LAND_AXIS,
    WINDOW_S,
    DropPlan,
    Landing,
    Landings,
    few_steps,
)
from hcbench.sim.touch import PARTED_S, Touchdowns, TrajectoryTouchdowns
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.text import LONGEST_NOTE, number, sanitized, table, time_step, without_empty
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.impact import Floats
from hcbench.terms.options import (
    BodyPair,
    Controller,
    Folders,
    Joints,
    LaunchOptions,
    ModelSource,
    PoseState,
    Quantities,
    Quantity,
)
from hcbench.terms.records import LANDING, LANDING_FORCE, LANDING_SPEED_OUT, LANDING_TIME, record
from hcbench.terms.units import real_array

HEIGHTS = "1:20:5 cm"
# In the text of tilts, before the axis.
_ABOUT = " about "
# Highest drop that `land` simulates, m.
_HIGHEST = 100.0
# A step (s) is too long for a fall of fewer than ten.
_SHARE_OF_FALL = 0.1
# Printed in place of a contact time if the body stays on the floor until the end of the window.
_STAYS = "stays"
# Printed between two ends, and what they are.
_SPAN = " ... "
CHANCE = (
    "Two numbers are the least and the largest of four drops, which differ in where in a time step "
    "the first foot touches: by chance. The other numbers are those of the first drop."
)
_WIDTH = 100
_HEADER = (
    *("drop m", "deg", "model", "impact m/s", "e", "peak/weight", "impulse N s"),
    *("contact ms", "slip mm", "depth mm", "feet", "bounce"),
)
_FEET = (
    *("drop m", "deg", "foot", "at ms", "impact m/s", "slide m/s", "contact ms"),
    *("peak N", "slip mm", "depth mm", "bounces"),
)


@checked
def land(
    model: ModelSource,
    heights: Quantities = HEIGHTS,
    *,
    tilt: Quantities = 0.0,
    controller: Controller = "pd",
    engine: str | None = None,
    limit: Quantity | None = None,
    key: str | None = None,
    qpos: Joints | None = None,
    state: PoseState | None = None,
    timestep: Quantity | None = None,
    gravity: Quantities | None = None,
    package: Folders | None = None,
    move: str | None = None,
) -> Landings:
    """Drop the robot of a model on its floor, from each height at
    each tilt, as `hcbench land` does.

    Parameters
    ----------
    model : path, text or object
        As `measure` takes it; a robot that can fall, over a floor. Its base has a free joint, or a
        slide of 45 degrees or steeper. It is the heaviest that actuators drive, else the heaviest
        that has joints of its own.
    heights : float, text, quantity of Pint's, or several
        Of its lowest point over the floor, m or with a unit.
    tilt : float, text, quantity of Pint's, or several
        Of its base about the world's y axis, rad or with a unit; text may name another axis:
        "0, 5 deg about 0.6 0.8 0".
    controller : text or function
        What drives the joints: "pd" (position servos and motors hold the pose), "pd:KP,KD" (gains of the
        motors, N m/rad and N m s/rad), "ctrl" (the controls of the pose), "file.py:function", or a function
        of (model, data) that returns the controls or sets them itself.
    engine, limit, key, qpos, state, timestep, gravity, package : optional
        The pose and the conditions, as `measure` takes them.
    move : text, optional
        "body:NAME" or "joint:NAME", of the tree of bodies to drop in place of the robot.

    Returns
    -------
    Landings
        `drops`: e of the centre of mass, the peak force, and what each foot does.

    Raises
    ------
    UserError
        With the reason for what cannot be dropped.

    """
    start: LaunchOptions = {
        "key": key,
        "qpos": qpos,
        "state": state,
        "timestep": timestep,
        "gravity": gravity,
        "package": package,
        "move": move,
    }
    request = make_request(None, **start)
    job = Job(model, engine, request, None, TOLERANCE, diagnose=False)
    return land_job(job, make_drops(heights, tilt, controller), read_limit(limit))


def make_drops(
    heights: Quantities = HEIGHTS, tilt: Quantities = 0.0, controller: Controller = "pd"
) -> DropPlan:
    """Drops from what a user writes: heights, m, tilts, rad, and a controller; text may have units.

    tilt: text may end in "about X Y Z", an axis of the world in place of y.
    Raises QuantityError for a height outside 0 ... 100 m, for an axis that is none and for text
    that is not a quantity, UserError for a controller that is neither text nor a function.
    """
    high = tuple(units.parse_values(heights, "length", "heights", above=0).tolist())
    if max(high) > _HIGHEST:
        raise QuantityError("heights", f"{max(high):g} m", f"up to {_HIGHEST:g} m")
    axis = LAND_AXIS
    if isinstance(tilt, str) and _ABOUT in tilt:
        tilt, _, named = tilt.partition(_ABOUT)
        axis = _axis(named)
    tilts = tuple(units.parse_values(tilt, "angle", "tilt").tolist())
    if not isinstance(controller, str) and not callable(controller):
        raise UserError(
            "controller", f"{controller!r:.60}", "pd, ctrl, file.py:function, or a function"
        )
    return DropPlan(high, tilts, controller, axis)


def _axis(text: str) -> tuple[float, float, float]:
    """The unit vector along three numbers. Raises QuantityError for other text, and for zeros."""
    try:
        x, y, z = map(float, text.replace(",", " ").split())
    except ValueError:
        x = y = z = math.nan
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        raise QuantityError(
            "tilt", f"about {text!r:.60}", "three numbers, such as 5 deg about 1 0 0"
        )
    return x / length, y / length, z / length


def land_job(job: Job, drops: DropPlan, limit: float | None = None) -> Landings:
    """Drop the robot of a job: a model in a file in a worker process, unless the controller is a
    function of this process, which no other process could call.

    limit: s, after which a worker counts as hung; None: the default of `run_job`.
    Raises UserError for what cannot be dropped, EngineFailed where the worker died or hung.
    """
    work = partial(_landed, drops)
    return work(job) if callable(drops.controller) else run_job(work, job, limit)


def _landed(drops: DropPlan, job: Job) -> Landings:
    """Drop the robot of a job in this process, and add notes on a step that is too long.

    A controller "file.py:function" is read here.
    Raises UserError for an engine in which hcbench drops no robots, for a controller or a model in
    a Python file that cannot be used, and for a model that no engine opens; SceneError for a file
    that no engine opens.
    """
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, LandsRobots):
        raise UserError(
            "engine", engine.title, "an engine in which hcbench drops robots", "Give MJCF"
        )
    if isinstance(drops.controller, str) and is_python(drops.controller):
        drops = dataclasses.replace(drops, controller=python_function(drops.controller))
    landings = engine.land(source, job.request, drops, rebuild)
    tilted = []
    if any(drops.tilts) and drops.axis != LAND_AXIS:
        tilted = [f"The base is tilted about {' '.join(f'{one:g}' for one in drops.axis)}."]
    notes = (*landings.notes, *tilted, *unresolved(landings), *_few_steps(landings))
    return dataclasses.replace(landings, notes=notes)


def unresolved(landings: Landings) -> list[str]:
    """Sentences on a step that is too long for the fall or the contact, with the step to take.

    Empty where the step is short enough. Where it is too long, no number of the landings holds.
    """
    h = landings.timestep
    found = []
    # Duration of the shortest fall, s.
    shortest = min(math.sqrt(2.0 * drop.height / landings.gravity) for drop in landings.drops)
    if h > _SHARE_OF_FALL * shortest:
        error = f"its speed may be wrong by {landings.gravity * h:.2g} m/s"
        evidence = f"a fall lasts {shortest / h:.2g} steps, and {error}"
        fix = f"a step of {_SHARE_OF_FALL * shortest:.1g} s"
        found.append(f"The step is too long for the fall: {evidence}. Use {fix} or less.")
    gains = [drop for drop in landings.drops if drop.restitution > 1.0 + NOTABLE_GAIN]
    coarse = [drop for drop in gains if _steps(drop, h) < ENOUGH_STEPS]
    if coarse:
        worst = max(coarse, key=lambda drop: drop.restitution)
        steps = _steps(worst, h)
        evidence = f"e up to {worst.restitution:.4g} with {steps:.0f} steps in contact"
        # With it this contact takes 200 steps; it is a twentieth of the present one at most.
        fix = f"a step of {h * min(0.05, steps / 200):.1g} s"
        found.append(
            f"The contact adds energy: the step does not resolve it: {evidence}. Use {fix}."
        )
    return found


def _few_steps(landings: Landings) -> tuple[str, ...]:
    """The sentence of `few_steps` on the drop with the shortest contact; () where `unresolved` has a
    worse warning.
    """
    if unresolved(landings):
        return ()
    shortest = min(_steps(drop, landings.timestep) for drop in landings.drops)
    return few_steps(shortest * landings.timestep, landings.timestep)


def _steps(drop: Landing, timestep: float) -> float:
    """Steps, of some s, of the longest first contact of a foot; infinite where impulses act."""
    return drop.contact / timestep if math.isnan(drop.impulse) else math.inf


def as_record(landings: Landings) -> dict[str, Any]:
    """The landings as `--json` prints them, in SI units."""
    about = {}
    for field in dataclasses.fields(landings):
        if field.name != "drops":
            about[field.name] = getattr(landings, field.name)
    drops = [_drop_record(drop) for drop in landings.drops]
    return {"schema": 1, "kind": "hcbench landing", **about, "window_s": WINDOW_S, "drops": drops}


def _drop_record(drop: Landing) -> dict[str, Any]:
    """One landing in SI units, by JSON key: its numbers, each foot's, and force (N) over time (s) as
    lists.

    "other_phases" has the numbers alone of the same drop with its first touch at other places in a
    time step.
    """
    return {
        **record(LANDING, drop),
        LANDING_SPEED_OUT.key: drop.speed_out,
        "other_phases": [record(LANDING, one) for one in drop.others],
        "feet": list(map(dataclasses.asdict, drop.feet)),
        LANDING_TIME.key: drop.time.tolist(),
        LANDING_FORCE.key: drop.force.tolist(),
    }


def as_text(robots: Sequence[Landings]) -> str:
    """The robots, one after the other in each drop, as lines for a terminal.

    All have the same drops; raises ValueError for another number of them.
    """
    lines = []
    for landings in robots:
        lines += headline(landings)
    names = labels(robots)
    rows = [_row(drop, name) for name, drop in by_drop(robots, names)]
    header, rows = _without_model(_HEADER, rows, len(robots) > 1)
    header, rows = without_empty(header, rows, "impulse N s")
    lines += ["", *table(header, rows)]
    if any(_SPAN in cell for row in rows for cell in row):
        lines += ["", *textwrap.wrap(CHANCE, _WIDTH)]
    for name, landings in zip(names, robots, strict=True):
        title = f"each foot of {name}" if len(robots) > 1 else "each foot"
        lines += ["", title, ""]
        is_tilted = any(drop.tilt for drop in landings.drops)
        feet = []
        for drop in landings.drops:
            feet += _foot_rows(drop, is_tilted)
        lines += table(*without_empty(_FEET, feet, "deg"))
    return "\n".join(lines) + "\n"


def headline(landings: Landings) -> list[str]:
    """Lines of the model, its floor and start; the engine, its step, gravity and controller; notes."""
    return [
        f"{sanitized(landings.model)}: {sanitized(landings.robot)} ({landings.mass:.4g} kg), from"
        f" {sanitized(landings.start)}, on {sanitized(landings.floor)}",
        f"{landings.engine} {landings.version}, step {time_step(landings.timestep)} s, gravity"
        f" {landings.gravity:.4g} m/s^2; {sanitized(landings.controller)}",
        *(f"note: {sanitized(note, LONGEST_NOTE)}" for note in landings.notes),
    ]


def labels(robots: Sequence[Landings]) -> list[str]:
    """A name for each robot: that of its model's file, with a number where two have the same."""
    names = [sanitized(landings.model, 40) for landings in robots]
    unique: list[str] = []
    for name in names:
        label = name
        number = 0
        while label in unique or (not number and names.count(name) > 1):
            number += 1
            label = f"{name} ({number})"
        unique.append(label)
    return unique


def by_drop(robots: Sequence[Landings], names: Sequence[str]) -> Iterator[tuple[str, Landing]]:
    """(name, drop): the same drop of all robots, then the next."""
    for drops in zip(*(landings.drops for landings in robots), strict=True):
        yield from zip(names, drops, strict=True)


def _row(drop: Landing, name: str) -> tuple[str, ...]:
    """Cells of one landing: height in m, tilt in degrees, speed in m/s, e, peak force, impulse in
    N s, contact time in ms, slip and penetration in mm, numbers of feet and of feet that bounce.

    name: of the robot. e, the peak force and the penetration are spans over all places of the touch
    in a step.
    """
    # Only an engine without forces has an impulse.
    impulse = ""
    if not math.isnan(drop.impulse):
        impulse = f"{drop.impulse:.4g}"
    contact = number(1e3 * drop.contact, ".3g")
    if drop.contact >= WINDOW_S:
        contact = _STAYS
    return (
        f"{drop.height:.4g}",
        f"{math.degrees(drop.tilt):.4g}",
        name,
        number(drop.speed_in, ".4g"),
        span(drop, "restitution", 1.0, 3),
        span(drop, "peak", 1.0, 2),
        impulse,
        contact,
        number(1e3 * drop.slip, ".2f"),
        span(drop, "penetration", 1e3, 2),
        str(len(drop.feet)),
        str(drop.bouncing),
    )


def span(drop: Landing, name: str, scale: float, digits: int) -> str:
    """Text of a number of a landing over all places of the touch in a step: one number with
    `digits` decimals where they agree, else the lowest and the highest with one decimal less.

    name: attribute of `drop`.
    scale: from its unit to the one that is printed.
    """
    low, high = (scale * value for value in drop.over_phases(name))
    least, most = number(low, f".{digits - 1}f"), number(high, f".{digits - 1}f")
    if least == most:
        return number(scale * getattr(drop, name), f".{digits}f")
    return f"{least}{_SPAN}{most}"


def _foot_rows(drop: Landing, is_tilted: bool) -> list[tuple[str, ...]]:
    """Cells of each foot of one landing: times in ms, slip and penetration in mm, forces in N.

    is_tilted: whether any drop is; else the cell of the tilt is "".
    """
    rows: list[tuple[str, ...]] = []
    tilt = ""
    if is_tilted:
        tilt = f"{math.degrees(drop.tilt):.4g}"
    for foot in drop.feet:
        contact = number(1e3 * foot.contact, ".3g")
        if foot.touch + foot.contact >= WINDOW_S:
            contact = _STAYS
        row = (
            f"{drop.height:.4g}",
            tilt,
            sanitized(foot.part, 30),
            f"{1e3 * foot.touch:.3g}",
            f"{foot.speed:.3g}",
            f"{foot.slide:.2f}",
            contact,
            number(foot.force_max, ".4g"),
            f"{1e3 * foot.slip:.2f}",
            f"{1e3 * foot.penetration:.2f}",
            str(foot.bounces),
        )
        rows.append(row)
    return rows


def _without_model(
    header: tuple[str, ...], rows: list[tuple[str, ...]], several: bool
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Leave the column of the model out of a table for one robot; header and rows as they are for
    several.

    several: whether the table has more than one robot.
    """
    if several:
        return header, rows
    at = header.index("model")
    return header[:at] + header[at + 1 :], [row[:at] + row[at + 1 :] for row in rows]


# `measure --trajectory`: at which speeds a recorded motion met the floor, and the bands of the
# settings.

_TOUCHDOWNS_HEADER = (
    *("part", "on", "times", "normal m/s", "95 %", "most", "slide m/s", "most"),
    *("valid m/s", "outside", "setting"),
)

# Arrays of a recording, and what each has.
_RECORDED = {
    "qpos": "positions, a row a state",
    "qvel": "velocities, a row a state",
    "time": "seconds, one a state",
}


@checked
def measure_trajectory(
    model: ModelSource,
    trajectory: str | Path | Mapping[str, npt.ArrayLike],
    pair: BodyPair | None = None,
    *,
    engine: str | None = None,
    limit: Quantity | None = None,
) -> TrajectoryTouchdowns:
    """Measure at which speeds the parts of a robot met the floor in a recorded motion.

    model: a path, text or object, as `measure` takes it.
    trajectory: an .npz or JSON file, or a mapping, with qpos (n, nq), qvel (n, nv) and time (n,),
    s, of the states; without time, one a time step of the model.
    pair: the two to read; None: each part that moves, on what does not.
    engine: name of one; None: the first that opens such a model.
    limit: s or with a unit, after which the worker counts as hung.

    Raises UserError for other arrays, for an engine that reads no recordings, and for a model that
    cannot be opened; EngineFailed where the worker died or hung.
    """
    job = Job(model, engine, make_request(pair), None, TOLERANCE, diagnose=False)
    return touchdowns_job(job, trajectory, read_limit(limit))


def touchdowns_job(job: Job, trajectory: Any, limit: float | None = None) -> TrajectoryTouchdowns:
    """The touchdowns of one model in a recorded motion; of a file in a worker.

    trajectory: a file, or a mapping with qpos, qvel and time, s.
    limit: s, after which the worker counts as hung; None: LIMIT_S of processor time, or the
    engine's own where that is longer.
    Raises UserError for other arrays, for an engine that reads no recordings and for a model that
    cannot be opened; EngineFailed where the worker died or hung.
    """
    return run_job(partial(_touchdowns, _recorded_arrays(trajectory)), job, limit)


def _recorded_arrays(trajectory: Any) -> dict[str, Floats]:
    """The arrays qpos, qvel and time of a trajectory, a file's or a mapping's, those that it has.

    Raises UserError for anything else, and for values that are not numbers. Shapes are not checked
    here.
    """
    if isinstance(trajectory, str | Path):
        trajectory = read_named(Path(trajectory), "trajectory", "qpos and qvel")
    if not isinstance(trajectory, Mapping):
        got = f"a {type(trajectory).__name__}"
        raise UserError("trajectory", got, "a file or a mapping with qpos and qvel of each state")
    arrays: dict[str, Floats] = {}
    for name, expected in _RECORDED.items():
        if name in trajectory:
            try:
                arrays[name] = real_array(trajectory[name])
            except (TypeError, ValueError):
                got = f"{name}: not numbers alone"
                raise UserError("trajectory", got, expected) from None
    return arrays


def _touchdowns(recorded: dict[str, Floats], job: Job) -> TrajectoryTouchdowns:
    """Touchdowns of a robot in a recorded motion.

    recorded: qpos (n, nq), qvel (n, nv) and, where it is known, time (n,), s.
    job: of the model; its request's pair is the one to read, None: each part that moves, on what
    does not.
    Raises UserError for an engine in which hcbench reads no recordings, for other shapes, and as
    `source_of` does; SceneError for a file that no engine opens.
    """
    engine, source, _ = source_of(job)
    if not isinstance(engine, LandsRobots):
        raise UserError(
            "engine", engine.title, "an engine in which hcbench reads recorded motions", "Give MJCF"
        )
    return engine.touchdowns(source, job.request, recorded)


def touchdowns_record(motion: TrajectoryTouchdowns) -> dict[str, Any]:
    """The touchdowns as `--json` prints them, in SI units."""
    about = {}
    for field in dataclasses.fields(motion):
        if field.name != "feet":
            about[field.name] = getattr(motion, field.name)
    feet = [_foot_record(foot) for foot in motion.feet]
    return {"schema": 1, "kind": "hcbench touchdowns", **about, "feet": feet}


def _foot_record(foot: Touchdowns) -> dict[str, Any]:
    """One foot as JSON: times, s, and speeds, m/s, of its touchdowns as lists, a number a
    touchdown.
    """
    return {
        "part": foot.part,
        "other": foot.other,
        "setting": foot.setting,
        "valid_m_per_s": foot.band,
        "share_outside": foot.outside,
        "time_s": foot.time.tolist(),
        "normal_speed_m_per_s": foot.speed.tolist(),
        "sliding_speed_m_per_s": foot.slide.tolist(),
    }


def touchdowns_text(motion: TrajectoryTouchdowns) -> str:
    """The touchdowns of a recorded motion as lines for a terminal: a row for each foot, in m/s,
    then advice on a recording with too few states and on settings without a band of speeds.
    """
    lines = [
        f"{sanitized(motion.model)}: {motion.states} states, one every {1e3 * motion.interval:.4g} ms",
        f"{motion.engine} {motion.version}",
    ]
    if not motion.feet:
        return "\n".join([*lines, "nothing that moves met anything that does not"]) + "\n"
    rows = [_touchdowns_row(foot) for foot in motion.feet]
    lines += ["", *table(*without_empty(_TOUCHDOWNS_HEADER, rows, "outside"))]
    if motion.interval > PARTED_S:
        shown = f"{1e3 * motion.interval:.3g} ms"
        lines += [
            "",
            f"States {shown} apart miss contacts that are shorter. Record every step for all of them.",
        ]
    loose = [foot for foot in motion.feet if foot.band is None]
    if loose:
        low = min(f.speed.min() for f in loose)
        high = max(f.speed.max() for f in loose)
        lines += [
            "",
            "Settings that hcbench did not write have no band. `hcbench tune` writes one that is valid for"
            f" --speeds '{max(low, 1e-3):.2g}:{high:.2g}:8 m/s'.",
        ]
    return "\n".join(lines) + "\n"


def _touchdowns_row(foot: Touchdowns) -> tuple[str, ...]:
    """Cells of one foot: names of the two, number of touchdowns, speeds along the normal (median,
    95 %, largest) and sliding (median, largest) in m/s, band, share outside of it, and setting.

    Without a band of speeds for which the setting is valid, the band is "—" and the share "".
    """
    valid = "—"
    outside = ""
    if foot.band is not None:
        low, high = foot.band
        valid = f"{low:.3g} ... {high:.3g}".replace("0 ... inf", "any")
        outside = f"{100 * foot.outside:.3g} %"
    return (
        sanitized(foot.part, 30),
        sanitized(foot.other, 30),
        str(len(foot.time)),
        f"{np.median(foot.speed):.3g}",
        f"{np.quantile(foot.speed, 0.95):.3g}",
        f"{foot.speed.max():.3g}",
        f"{np.median(foot.slide):.3g}",
        f"{foot.slide.max():.3g}",
        valid,
        outside,
        sanitized(foot.setting),
    )
