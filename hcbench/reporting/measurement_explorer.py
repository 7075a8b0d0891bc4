"""Explorer in a measurement's page: e over speed, and each impact beside the law."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hcbench.laws import closed_form
from hcbench.measuring.curve import CurvePoint
from hcbench.measuring.measurement import Measurement
from hcbench.reporting.explorer import TABS, Explorer, LoopStore, as_json, digits, places
from hcbench.reporting.plot_style import LIMIT, MEASURED
from hcbench.terms.impact import LOOP_TOLERANCE, Impact


def explorer_of(measurement: Measurement) -> Explorer | None:
    """Build the explorer; None without a law to compare with, or if no contact has steps enough for
    a loop.
    """
    law = measurement.law
    facts = measurement.facts
    points = [p for p in measurement.curve if not math.isnan(p.restitution) and not p.angle]
    if law is None or not points or not measurement.loops:
        return None
    loops = LoopStore()
    gravity = float(np.linalg.norm(facts.gravity))
    where = {"engine": facts.engine, "step": facts.timestep, "gravity": gravity, "alpha": law.alpha}
    runs = [{**where, **_measured(measurement, points, loops)}]
    if facts.asked:
        asked = dict(zip(measurement.request.speeds, facts.asked, strict=True))
        runs.append({**where, **_asked(points, [asked[p.speed] for p in points])})
    for run in runs:
        error = np.abs(np.array(run["e"]) - closed_form.restitution(law.alpha, np.array(run["v"])))
        run["error"] = digits(error, 3)
        run["largest"] = float(f"{error.max():.3g}")
    shown = [f"{facts.engine} {run['setting']}" for run in runs]
    data = {
        "body": {"k": law.stiffness, "n": law.exponent, "m": measurement.effective_mass},
        "alphas": [law.alpha],
        "gravities": [gravity],
        "band": [0.0, 1.02 * max(p.speed_in for p in points)],
        "engines": [[facts.engine, facts.engine]],
        "start": where,
        "answers": [{**where, "choices": [{"kind": "", "shown": shown}]}],
        "runs": runs,
        "loops": loops.stored,
        "scans": [],
        "dropHeight": None,
        "drops": [],
    }
    return Explorer(as_json(data), {name: TABS[name] for name in ("loop", "numbers")})


def _measured(measurement: Measurement, points: Sequence[CurvePoint], loops: LoopStore) -> dict[str, Any]:
    """The curve, by the impacts whose loops there are."""
    with_loop = {impact.launch.speed: impact for impact in measurement.loops}
    phases = []
    e = []
    samples = []
    loop_numbers = []
    for point in points:
        impact = with_loop.get(point.speed)
        if impact is None:
            e.append(point.restitution)
            samples.append(0)
            loop_numbers.append(-1)
        else:
            phases.append(impact.launch.phase)
            e.append(impact.restitution)
            samples.append(impact.samples)
            loop_numbers.append(_add(loops, impact))
    return {
        **_line("measured", MEASURED.colour, points),
        "phase": phases[0],
        "e": places(e, 5),
        "low": places([point.lowest for point in points], 5),
        "high": places([point.highest for point in points], 5),
        "samples": samples,
        "loops": loop_numbers,
    }


def _asked(points: Sequence[CurvePoint], e: Sequence[float]) -> dict[str, Any]:
    """Curve of e that the model's settings ask for, without loops."""
    values = places(e, 5)
    return {
        **_line("what the model asks for", LIMIT, points),
        "phase": 0.5,
        "samples": [0] * len(e),
        "loops": [-1] * len(e),
        "e": values,
        "low": values,
        "high": values,
        "dashes": "6 3",
    }


def _line(name: str, colour: str, points: Sequence[CurvePoint]) -> dict[str, Any]:
    """Names, colour and speeds of a curve."""
    return {
        "setting": name,
        "label": name,
        "title": name,
        "colour": colour,
        "dashes": "",
        "asked": digits([p.speed for p in points], 4),
        "v": digits([p.speed_in for p in points], 5),
    }


def _add(loops: LoopStore, impact: Impact) -> int:
    assert impact.loop is not None
    loop = impact.loop.simplified(LOOP_TOLERANCE)
    return loops.add((loop.time.tolist(), loop.penetration.tolist(), loop.force.tolist()))
