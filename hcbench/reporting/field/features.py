"""Table of the engines' features: each cell from the run, or from the engine's own folder with its
source.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import closing, nullcontext
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, cast

from hcbench.reporting.field.view import NO_BOUNCE
from hcbench.reporting.wording import NBSP
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.remote import adapter_of, interpreter_of
from hcbench.system.errors import HcbenchError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import load_scene
from hcbench.workers import call, redirect_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.reporting.field.view import FieldView
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Probes of a field report besides the impacts: repeatability to the bit, alone and together, and
# cost.

BALLS = (1, 100)
_LAUNCHES = (Launch(0.1, 0.25), Launch(0.2, 0.5), Launch(0.4, 0.75))
# Launch speed of the balls whose cost is measured, m/s.
_SPEED = 0.4
# Steps of one measurement of the cost.
_STEPS = 100
# Processor time of a probe, s: an engine that runs longer counts as hung.
_LIMIT_S = 240.0
# Duration of one measurement, about, s.
_REPEAT_S = 0.3


@dataclass(frozen=True, slots=True)
class Probe:
    """Probe of one setting.

    repeats: whether the same launches give the same bits again.
    alone: whether each launch alone gives the same bits as together with the others.
    cost: number of balls that were simulated together -> s a ball and step.
    """

    repeats: bool
    alone: bool
    cost: dict[int, float]


def probe(setting: Setting, scene: Scene) -> Probe | None:
    """Probe a setting in the worker process of its engine; None for an engine that hcbench does not
    step, and where it fails: missing, refusing, crashed or slower than _LIMIT_S.
    """
    engine = registry.engine(setting.engine)
    if not isinstance(adapter_of(engine), SteppedEngine):
        return None
    try:
        return call(_probe_here, setting, scene, limit=_LIMIT_S, at=interpreter_of(engine))
    except HcbenchError:
        return None


def _probe_here(setting: Setting, scene: Scene) -> Probe:
    """Probe of a setting, in this process, which is the engine's worker. Raises what the engine
    raises.
    """
    engine = cast("SteppedEngine", registry.engine(setting.engine))
    first = list(map(_bits, engine.run(scene, setting, _LAUNCHES)))
    again = list(map(_bits, engine.run(scene, setting, _LAUNCHES)))
    alone = []
    for launch in _LAUNCHES:
        (impact,) = engine.run(scene, setting, [launch])
        alone.append(_bits(impact))
    cost: dict[int, float] = {}
    # An engine with a process of its own prints from native code.
    quiet = redirect_output() if engine.own_process else nullcontext()
    with quiet:
        for balls in BALLS:
            cost |= _cost(engine, setting, scene, balls)
    return Probe(first == again, first == alone, cost)


def _bits(impact: object) -> bytes:
    import pickle

    return pickle.dumps(replace(impact, loop=None, launch=None))  # type: ignore[type-var]


def _cost(engine: SteppedEngine, setting: Setting, scene: Scene, balls: int) -> dict[int, float]:
    """Number of balls that were simulated together -> s a ball and
    step, the least of several times.

    balls: how many are wanted; a world that has fewer places takes as many as it has. Each ball is
    launched in another phase. Raises what the engine raises.
    """
    with engine.load(scene, setting, _SPEED) as world:
        together = min(balls, world.places)
        launches = [Launch(_SPEED, (i + 0.5) / together) for i in range(together)]
        # The least is that which other programs of the machine disturbed least.
        least = float("inf")
        begun = time.perf_counter()
        while least == float("inf") or time.perf_counter() - begun < _REPEAT_S:
            with closing(world.release(launches)) as simulation:
                start = time.perf_counter()
                done = 0
                while done < _STEPS:
                    steps = simulation.advance(_STEPS - done).force.shape[1]
                    done += steps
                seconds = time.perf_counter() - start
            least = min(least, seconds / (_STEPS * together))
    return {together: least}


def scene_of(view: FieldView) -> Scene:
    """Load the study's own scene, without gravity."""
    return replace(load_scene(str(view.study["scene"])), gravity=0.0)


def csv_of(costs: Sequence[tuple[str, str, float, dict[int, float]]], machine: str) -> str:
    """The costs as CSV: a line for each number of balls, in µs a ball and step.

    costs: (engine, setting, step in s, as `Probe.cost`). machine: a description, for a comment at
    the top.
    """
    lines = [
        f"# CPU and load of one machine at one time: {machine}",
        "engine,setting,timestep_s,balls,us_a_ball_step",
    ]
    lines += [
        f"{engine},{name},{step:g},{balls},{1e6 * s:.3g}"
        for engine, name, step, cost in costs
        for balls, s in cost.items()
    ]
    return "\n".join(lines) + "\n"


RUN = "this run"
_FOLDER = "hcbench's adapter"
FEATURES = {
    "law": "its own law",
    "exponent": "exponent",
    "threshold": "bounces from",
    "numbers": "numbers",
    "bits": "same bits again",
    "licence": "licence",
}


def energy_note(engine: str) -> Feature | None:
    """Note on an e above 1 in an engine, from the engine's folder; None without one."""
    adapter = registry.adapter(registry.base_name(engine))
    if not isinstance(adapter, DescribesContact) or adapter.features is None:
        return None
    return adapter.features.energy


def features(
    view: FieldView, probes: Mapping[str, Probe | None]
) -> list[tuple[str, list[Feature]]]:
    """(engine, its cells in the order of FEATURES) of each engine of the page.

    probes: by engine; None, or none, for one that could not be probed.
    """
    return [(engine, _cells(view, engine, probes.get(engine))) for engine in view.engines]


def _cells(view: FieldView, engine: str, probe: Probe | None) -> list[Feature]:
    """Cells of an engine, in the order of FEATURES; "–" for one that nothing is known of.

    engine: with its version. probe: None where it could not run.
    """
    base = registry.base_name(engine)
    adapter = registry.adapter(base)
    # An engine that steps another's models has that engine's contact, except what its notes say.
    contact = registry.adapter(getattr(adapter, "model_engine", base))
    cells: dict[str, Feature] = {}
    if isinstance(contact, DescribesContact) and contact.features is not None:
        for field in fields(Features):
            stated = getattr(contact.features, field.name)
            if stated is not None:
                cells[field.name] = stated
    nothing = Feature("–", "")
    cells["numbers"] = Feature(f"float{adapter.bits}", _FOLDER)
    # Without a probe nothing ran here that could be the source.
    source = ""
    if probe is not None:
        source = RUN
    cells["bits"] = Feature(_bits_text(probe), source)
    cells["threshold"] = _threshold(cells.get("threshold", nothing), _slowest_bounce(view, engine))
    return [cells.get(name, nothing) for name in FEATURES]


def _threshold(stated: Feature, seen: str) -> Feature:
    """Slowest bounce: the stated one, followed by the one seen in this run."""
    if not seen:
        return stated
    return Feature(
        f"{stated.text}; {seen}".removeprefix("–; "), f"{stated.source}; {RUN}".strip("; ")
    )


def _bits_text(probe: Probe | None) -> str:
    """Text of the cell on whether a run repeats to the bit; "–" without a probe."""
    if probe is None:
        return "–"
    if not probe.repeats:
        return "no"
    if probe.alone:
        return "yes, alone or together"
    return "yes; alone others"


def _slowest_bounce(view: FieldView, engine: str) -> str:
    """From which speed on the engine bounces with nothing set, at the step of 1 ms or the nearest.

    "" where it did not run so, or bounces at every speed.
    """
    gravity = view.gravities[0]
    steps = [step for step in view.steps if view.stock(engine, gravity, step)]
    if not steps:
        return ""
    nearest = min(steps, key=lambda step: abs(math.log(step / 1e-3)))
    case = view.stock(engine, gravity, nearest)
    assert case is not None
    curve = view.curve(case)
    bounces = curve.speed[curve.highest >= NO_BOUNCE]
    if not len(bounces):
        return "nothing set: at no speed"
    slowest = float(bounces.min())
    lowest = float(view.speeds(case.timestep)[0])
    if slowest <= lowest * (1 + 1e-9):
        return ""
    return f"nothing set: {slowest:.2g}{NBSP}m/s"
