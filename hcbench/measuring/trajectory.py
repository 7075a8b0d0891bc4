"""`measure --trajectory`: at which speeds a recorded motion met the floor,
and the bands of the settings.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hcbench.measuring.measure import Job, run_job, source_of
from hcbench.measuring.measurement import TOLERANCE
from hcbench.measuring.request import make_request, read_limit, read_named
from hcbench.sim.capabilities import LandsRobots
from hcbench.sim.landing import PARTED_S
from hcbench.sim.touch import Touchdowns, TrajectoryTouchdowns
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized, table, without_empty
from hcbench.terms.arguments import checked
from hcbench.terms.impact import Floats
from hcbench.terms.options import BodyPair, ModelSource, Quantity
from hcbench.terms.units import real_array

_HEADER = (
    *("part", "on", "times", "normal m/s", "95 %", "most", "slide m/s", "most"),
    *("valid m/s", "outside", "setting"),
)

# Arrays of a recording, and what each has.
_ARRAYS = {
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
    engine: name of one; None: the first that opens such a model. limit: s or with a unit, after
    which the worker counts as hung.

    Raises UserError for other arrays, for an engine that reads no recordings, and for a model that
    cannot be opened; EngineFailed where the worker died or hung.
    """
    job = Job(model, engine, make_request(pair), None, TOLERANCE, diagnose=False)
    return touchdowns_job(job, trajectory, read_limit(limit))


def touchdowns_job(job: Job, trajectory: Any, limit: float | None = None) -> TrajectoryTouchdowns:
    """The touchdowns of one model."""
    return run_job(partial(_touchdowns, _arrays(trajectory)), job, limit)


def _arrays(trajectory: Any) -> dict[str, Floats]:
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
    for name, expected in _ARRAYS.items():
        if name in trajectory:
            try:
                arrays[name] = real_array(trajectory[name])
            except (TypeError, ValueError):
                got = f"{name}: not numbers alone"
                raise UserError("trajectory", got, expected) from None
    return arrays


def _touchdowns(recorded: dict[str, Floats], job: Job) -> TrajectoryTouchdowns:
    """Touchdowns of a robot in a recorded motion.

    recorded: qpos (n, nq), qvel (n, nv) and, where it is known, time (n,), s. job: of the model;
    its request's pair is the one to read, None: each part that moves, on what does not.
    Raises UserError for an engine in which hcbench reads no recordings, for other shapes, and as
    `source_of` does; SceneError for a file that no engine opens.
    """
    engine, source, _ = source_of(job)
    if not isinstance(engine, LandsRobots):
        raise UserError(
            "engine", engine.title, "an engine in which hcbench reads recorded motions", "Give MJCF"
        )
    return engine.touchdowns(source, job.request, recorded)


def as_record(motion: TrajectoryTouchdowns) -> dict[str, Any]:
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


def as_text(motion: TrajectoryTouchdowns) -> str:
    """The touchdowns as lines for a terminal, with advice on a coarse recording and on settings
    without a band.
    """
    lines = [
        f"{sanitized(motion.model)}: {motion.states} states, one every {1e3 * motion.interval:.4g} ms",
        f"{motion.engine} {motion.version}",
    ]
    if not motion.feet:
        return "\n".join([*lines, "nothing that moves met anything that does not"]) + "\n"
    rows = [_row(foot) for foot in motion.feet]
    lines += ["", *table(*without_empty(_HEADER, rows, "outside"))]
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


def _row(foot: Touchdowns) -> tuple[str, ...]:
    """Cells of one foot: speeds in m/s, the share outside the band in per cent, "" without a band."""
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
