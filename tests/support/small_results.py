"""Small Results for tests of the report: impacts integrated here, step by
step, with no engine installed.

Engine "explicit" integrates by semi-implicit Euler, "single" turns the speed around in one step.
"""

from __future__ import annotations

import dataclasses
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from hcbench import scoring
from hcbench.benchmark.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY, ImpactTable, Results
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.sim.read_impact import impact_of
from hcbench.terms.impact import Impact, Launch, Status, Trajectory

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Force = Callable[[float, float], float]

INCH = 0.0254
MASS, STIFFNESS = 0.45359237, 3.4064e10
ALPHAS = (0.004 / INCH, 0.008 / INCH)
SPEEDS = (4 * INCH, 8 * INCH, 16 * INCH)
PHASES = (0.25, 0.75)
SCENE = "steel-plane"


def simulated(force: Force, launch: Launch, step: float) -> Impact:
    """One impact by semi-implicit Euler."""
    x, v = -launch.clearance(step), launch.speed
    samples = []
    for i in range(4000):
        f = force(x, v)
        samples.append((i * step, x, v, f))
        if v < 0 and x < 0:
            break
        v -= step * f / MASS
        x += step * v
    return impact_of(launch, Trajectory(*np.array(samples).T))


def hunt_crossley(alpha: float) -> Force:
    """(16)."""
    law = HuntCrossley(STIFFNESS, alpha)
    return lambda x, v: float(law.force(x, v)) if x > 0 else 0.0


def spring_damper(alpha: float) -> Force:
    """A linear spring and damper, no tension: about one restitution for all speeds."""
    k, c = 1.1e8, 70.0 * alpha
    return lambda x, v: max(0.0, k * x + c * v) if x > 0 else 0.0


def turn_around(restitution: float, step: float) -> Force:
    """A contact that makes the whole bounce in one step."""
    return lambda x, v: MASS * (1 + restitution) * v / step if x > 0 and v > 0 else 0.0


def flights(
    engine: str, setting: str, alpha: float, step: float, speeds: Sequence[float]
) -> list[Impact]:
    """Impacts over speeds and phases."""
    constant, _ = scoring.best_constant(alpha, np.array(SPEEDS))
    forces = {
        "law": hunt_crossley(alpha),
        "spring-damper": spring_damper(alpha),
        "impulse": turn_around(constant, step),
        "stock": turn_around(0.1, step),
    }
    launches = [Launch(v, phase) for v in speeds for phase in PHASES]
    if setting == "broken":
        return [
            Impact(launch, Status.CRASHED, "the engine's process died on it") for launch in launches
        ]
    return [simulated(forces[setting], launch, step) for launch in launches]


RUNS = (
    ("explicit", "law", 1e-6, ALPHAS, SPEEDS),
    ("explicit", "spring-damper", 1e-6, ALPHAS, SPEEDS),
    ("explicit", "broken", 1e-3, ALPHAS, SPEEDS),
    ("single", "stock", 2e-3, ALPHAS, SPEEDS),
    ("single", "impulse", 1e-3, ALPHAS, SPEEDS),
    *(("explicit", "law", step, ALPHAS[1:], SPEEDS[1:2]) for step in (5e-6, 1e-5)),
)


def answer(engine: str, setting: str, step: float, alpha: float, gravity: float) -> dict[str, Any]:
    """Possible answer of `tune`: one e for all speeds, by a setting of these results."""
    within = "e within 0.05 from 0.1 to 0.4 m/s"
    choice = {
        "kind": "constant",
        "setting": setting,
        "line": f"one e for all speeds: {setting}, {within}",
        "within": within,
        "energy": "energy never grew in 88 launches and drops",
        "scenes": 88,
        "text": json.dumps({"number": alpha, "first": "ball", "second": "plate"}),
        "max_error": 0.05,
        "speeds_m_per_s": [0.1, 0.4],
        "max_e": 0.99,
        "passive": {"sphere": True, "flat": None},
        "rests": True,
        "needs": ["the names of geoms"],
    }
    exact = {
        **choice,
        "kind": "exact",
        "setting": "law",
        "within": within.replace("0.05", "1e-7"),
        "text": "<law/>",
    }
    asked = {"engine": engine, "timestep": step, "gravity": gravity, "alpha": alpha}
    never = [{"setting": "spring-damper", "why": "gains energy below 0.2 m/s (e up to 2)"}]
    notes = {"band_note": "Cut.", "caution": "One e would do."}
    return {**asked, "best": "constant", "choices": [exact, choice], "never": never, **notes}


def small_results(runs: Sequence[tuple[Any, ...]] = RUNS, title: str = "A steel ball") -> Results:
    """Results of `runs`: (engine, setting, step, alphas, speeds)."""
    impacts: list[tuple[Any, ...]] = []
    scores: list[tuple[Any, ...]] = []
    loops, settings = [], []
    for engine, setting, step, alphas, speeds in runs:
        for alpha in alphas:
            key = (SCENE, 0.0, 0.0, 0.0, engine, setting, alpha, step)
            found = flights(engine, setting, alpha, step, speeds)
            law = HuntCrossley(STIFFNESS, alpha)
            scores.append((*key, *dataclasses.astuple(scoring.score(found, law, MASS))))
            impacts += [(*key, *_row(impact, alpha)) for impact in found]
            kept = [
                i
                for i in found
                if i.loop is not None and i.launch.phase == PHASES[0] and len(speeds) > 1
            ]
            loops += [_loop(key, impact) for impact in kept]
            options = {} if setting == "stock" else {"number": alpha}
            record = {
                "options": options,
                "summary": f"How {setting} bounces.",
                "notes": ["Holds here."],
            }
            settings.append({**dict(zip(RUN_KEY, key, strict=True)), **record})
    study = _study(title)
    return Results(
        study=study,
        settings=settings,
        versions={"hcbench": "0", "explicit": "1.0"},
        table=ImpactTable.of(pd.DataFrame(impacts, columns=IMPACT_COLUMNS), study),
        loops=pd.concat(loops, ignore_index=True),
        scores=pd.DataFrame(scores, columns=[*RUN_KEY, *scoring.SCORE_FIELDS]),
    )


def _row(impact: Impact, alpha: float) -> tuple[Any, ...]:
    speed = impact.speed_in
    known = np.isfinite(speed)
    e = float(closed_form.restitution(alpha, speed)) if known else np.nan
    start = (impact.launch.speed, impact.launch.phase, impact.status.value, impact.reason, speed)
    bounce = (impact.speed_out, impact.restitution, e, 1 - alpha * speed)
    return (
        *start,
        *bounce,
        impact.duration,
        impact.penetration_max,
        impact.force_max,
        impact.samples,
    )


def _loop(key: tuple[Any, ...], impact: Impact) -> pd.DataFrame:
    assert impact.loop is not None
    head = (*key, impact.launch.speed, impact.launch.phase)
    loop = impact.loop
    columns = (*head, loop.time, loop.penetration, loop.rate, loop.force)
    return pd.DataFrame(dict(zip(LOOP_COLUMNS, columns, strict=True)))


def _study(title: str) -> dict[str, Any]:
    return {
        "title": title,
        "scene": SCENE,
        "form": "plane",
        "gravity": 0.0,
        "mass_kg": MASS,
        "stiffness": STIFFNESS,
        "exponent": 1.5,
        "relative_radius_m": 2 * INCH,
        "alphas": list(ALPHAS),
        "speeds": list(SPEEDS),
        "loop_speeds": list(SPEEDS),
        "phases": len(PHASES),
        "main_alpha": ALPHAS[1],
        "step_speed": SPEEDS[1],
        "runs": [],
    }
