"""Commands to type after a fit, complete as printed."""

from __future__ import annotations

import math
import shlex
from typing import TYPE_CHECKING

from hcbench.fitting.result import limit_of, with_uncertainty
from hcbench.sim import registry
from hcbench.sim.capabilities import OpensModels

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.replay import Replay
    from hcbench.fitting.result import FitResult


# Names in a scene that hcbench writes.
_POINTS = "points.csv"
_PAIR = "ball,plate"
# Scatter of e, relative, above which a train is not one ball's, so that none is simulated by it.
_MOST_SCATTER = 0.1


def next_lines(
    result: FitResult, engine: str, given: Sequence[str], scene: tuple[Replay, str] | None = None
) -> list[str]:
    """Commands that make a scene with this contact and check it, as lines; empty without an engine,
    and where e scatters far more than a ball's.

    engine: "" where none can run.
    given: the words after `hcbench` that led here.
    scene: a scene that was written, and its path; then it is checked, and no other is made.
    Engines whose scenes are scripts get no line that checks.
    """
    is_of_flights = any(s.needs_gravity for s in result.sets)
    if not engine or (is_of_flights and result.fits[0].scatter > _MOST_SCATTER):
        return []
    low, high = _inwards(*result.speeds)
    speeds = f'--speeds "{low:g}:{high:g} m/s"'
    # Options of a target, and those that `tune` takes besides.
    besides = ""
    if result.is_plain and result.alpha is not None:
        alpha = with_uncertainty(result.alpha.value, result.alpha.uncertainty)
        target = f'--alpha "{alpha} s/m"'
        besides = " --plugin"
    elif result.law == "constant" and result.restitution is not None:
        target = f"--restitution {result.restitution.value:.6g}"
    else:
        target = f"--points {_POINTS}"
        # A ball was measured: settings for balls alone will do.
        besides = " --corners 1"
    lines = ["next:"]
    if _POINTS in target and "--write-points" not in given:
        lines.append(f"  hcbench {shlex.join(given)} --write-points {_POINTS}")
    if scene is not None:
        replayed, file = scene
        engine = replayed.setting.engine
        limit = limit_of(result, replayed.e_off)
    else:
        file = "scene.xml" if _reads_xml(engine) else "scene.py"
        limit = limit_of(result)
        tune = f"  hcbench tune {engine} {target}{besides} --timestep 1e-3 {speeds}"
        lines.append(f"{tune} --write-scene {file}")
    if _reads_xml(engine):
        check = f"  hcbench check {shlex.quote(file)} --pair {_PAIR} {target} {speeds}"
        lines.append(f"{check} --max-error {limit:.2g}")
    return lines


def _inwards(low: float, high: float) -> tuple[float, float]:
    """Both ends rounded inwards to three digits: pairs that were measured hold for no other speeds.

    low, high: m/s, above 0.
    A band that is narrower than that keeps more digits, up to the six that a command has: its ends
    never change places.
    """
    for digits in (3, 4, 5, 6):
        # The last digit of each, m/s.
        of_low = 10.0 ** (math.floor(math.log10(low)) - digits + 1)
        of_high = 10.0 ** (math.floor(math.log10(high)) - digits + 1)
        inner_low = math.ceil(low / of_low - 1e-9) * of_low
        inner_high = math.floor(high / of_high + 1e-9) * of_high
        if inner_low <= inner_high:
            return inner_low, inner_high
    return low, high


def _reads_xml(engine: str) -> bool:
    """Say whether scenes of an engine are models that `check` opens; those of others are scripts."""
    adapter = registry.engine(engine)
    return isinstance(adapter, OpensModels) and ".xml" in adapter.suffixes
