"""Commands to type after a fit, complete as printed."""

from __future__ import annotations

import math
import shlex
from typing import TYPE_CHECKING

from hcbench.fitting.text import limit_of, with_uncertainty
from hcbench.sim import registry
from hcbench.sim.capabilities import OpensModels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.replay import Replay
    from hcbench.fitting.result import FitResult

# The names in a scene that hcbench writes
_POINTS, _PAIR = "points.csv", "ball,plate"


def next_lines(
    result: FitResult, engine: str, given: Sequence[str], scene: tuple[Replay, str] | None = None
) -> list[str]:
    """Make a scene with this contact, and check it; none without an engine.

    engine: "" where none can run. given: the words after `hcbench` that led here.
    scene: a scene that was written, and its path; it is checked then.
    """
    if not engine:
        return []
    low, high = _inwards(*result.speeds)
    speeds = f'--speeds "{low:g}:{high:g} m/s"'
    if result.is_plain and result.alpha is not None:
        check = f'--alpha "{with_uncertainty(result.alpha.value, result.alpha.uncertainty)} s/m"'
        what = f"{check} --plugin"
    elif result.law == "constant" and result.restitution is not None:
        what = check = f"--restitution {result.restitution.value:.6g}"
    else:
        what, check = f"--points {_POINTS}", f"--pairs {_POINTS}"
    lines = ["next:"]
    if _POINTS in what and "--write-points" not in given:
        lines.append(f"  hcbench {shlex.join(given)} --write-points {_POINTS}")
    limit = limit_of(result, scene[0].e_off if scene else 0.0)
    if scene is not None:
        replayed, file = scene
        engine = replayed.setting.engine
    else:
        file = "scene.xml" if _reads_xml(engine) else "scene.py"
        lines.append(f"  hcbench tune {engine} {what} --timestep 1e-3 {speeds} --write-scene {file}")
    if _reads_xml(engine):
        lines.append(
            f"  hcbench check {shlex.quote(file)} --pair {_PAIR} {check} {speeds} --max-error {limit:.2g}"
        )
    return lines


def _inwards(low: float, high: float) -> tuple[float, float]:
    """Both ends rounded inwards to three digits: pairs that were measured hold for no other speeds."""
    first, last = (10.0 ** (math.floor(math.log10(v)) - 2) for v in (low, high))
    return math.ceil(low / first - 1e-9) * first, math.floor(high / last + 1e-9) * last


def _reads_xml(engine: str) -> bool:
    """Say whether scenes of an engine are models that `check` opens; those of others are scripts."""
    adapter = registry.engine(engine)
    return isinstance(adapter, OpensModels) and ".xml" in adapter.suffixes
