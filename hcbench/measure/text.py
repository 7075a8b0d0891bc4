"""A measurement as text and as JSON. No clock in it: the same model gives the same bytes."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench._text import number, sanitized, table, without_empty
from hcbench.impact import Status
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution

if TYPE_CHECKING:
    from hcbench import scoring
    from hcbench.impact import Impact
    from hcbench.measure.measurement import Cause, Measurement

SCHEMA = 1
_LOOP_STEPS = 8  # in contact, from which there is a loop to show
_LOOP_SAMPLES = 200
_LOSSY = 1e-3  # α v from which a loop of the law has an area to compare with


def effective_mass(found: Measurement) -> float:
    """Of the model, or else of the momentum that the first resolved impact turned round, kg."""
    mass = found.facts.effective_mass
    if math.isfinite(mass):
        return mass
    for impact in found.impacts:
        if impact.status is Status.PARTED and impact.loop is not None:
            change = impact.speed_in + impact.speed_out
            return float(impact.loop.force.sum()) * found.facts.timestep / change
    return math.nan


def law_of(found: Measurement) -> HuntCrossley | None:
    """The law to compare with: α as wanted, or else as fitted; k so that the hardest impact goes as deep.

    None where nothing was measured that a law could be fitted to.
    """
    from hcbench import scoring

    good = found.measured
    if isinstance(found.wanted, Restitution):
        alpha = found.wanted.alpha
    elif len(good) > 1:
        speeds, e = np.array([i.speed_in for i in good]), np.array([i.restitution for i in good])
        alpha, _ = scoring.fit_alpha(speeds, e)
    else:
        return None
    resolved = [i for i in good if i.samples >= scoring.RESOLVED and i.penetration_max > 0]
    mass = effective_mass(found)
    if not resolved or not math.isfinite(mass):
        return HuntCrossley(1.0, alpha)
    hardest = max(resolved, key=lambda i: i.speed_in)
    unit = HuntCrossley(1.0, alpha)
    depth = float(closed_form.penetration_max(unit, mass, hardest.speed_in))
    return HuntCrossley((depth / hardest.penetration_max) ** (unit.exponent + 1), alpha)


def score_of(found: Measurement) -> scoring.Score | None:
    """Every comparator figure against `law_of`; None without a law."""
    from hcbench import scoring

    law, mass = law_of(found), effective_mass(found)
    if law is None or not found.measured or not math.isfinite(mass):
        return None
    return scoring.score(found.impacts, law, mass)


def as_record(found: Measurement) -> dict[str, Any]:
    """JSON-able; NaN stands for nothing to say."""
    facts, score, law = found.facts, score_of(found), law_of(found)
    fitted = not isinstance(found.wanted, Restitution)
    return {
        "schema": SCHEMA,
        "kind": "hcbench measurement",
        "model": facts.model,
        "engine": facts.engine,
        "version": facts.version,
        "pair": list(facts.pair),
        "moved": facts.moved,
        "timestep_s": facts.timestep,
        "gravity_m_per_s2": list(facts.gravity),
        "effective_mass_kg": effective_mass(found),
        "normal": list(facts.normal),
        "settings": dict(facts.settings),
        "asked": {"restitution": list(facts.asked), "words": facts.asked_words},
        "wanted": found.wanted.description if found.wanted else None,
        "curve": [
            {
                "speed_m_per_s": p.speed,
                "speed_in_m_per_s": p.speed_in,
                "restitution": p.restitution,
                "restitution_min": p.lowest,
                "restitution_max": p.highest,
                "samples": p.samples,
                "failed": p.failed,
            }
            for p in found.curve
        ],
        "phase_spread": found.spread,
        "energy_gained": found.energy_gained,
        "law": None
        if law is None
        else {
            "alpha_s_per_m": law.alpha,
            "stiffness_n_per_m_n": law.stiffness,
            "exponent": law.exponent,
            "alpha_fitted": fitted,
        },
        "score": None if score is None else dataclasses.asdict(score),
        "impacts": [_impact(i) for i in found.impacts],
        "loops": [_loop(impact) for impact in kept_loops(found)],
        "causes": [dataclasses.asdict(c) for c in found.causes],
        "remedy": found.remedy,
        "notes": list(facts.notes),
    }


def _impact(impact: Impact) -> dict[str, Any]:
    return {
        "speed_m_per_s": impact.launch.speed,
        "phase": impact.launch.phase,
        "status": impact.status.value,
        "reason": impact.reason,
        "speed_in_m_per_s": impact.speed_in,
        "speed_out_m_per_s": impact.speed_out,
        "restitution": impact.restitution,
        "duration_s": impact.duration,
        "penetration_max_m": impact.penetration_max,
        "force_max_n": impact.force_max,
        "samples": impact.samples,
    }


def kept_loops(found: Measurement) -> list[Impact]:
    """One impact a speed, of those whose contact took steps enough to be a loop."""
    kept: dict[float, Impact] = {}
    for impact in found.impacts:
        if impact.status is Status.PARTED and impact.loop is not None and impact.samples >= _LOOP_STEPS:
            kept.setdefault(impact.launch.speed, impact)
    return list(kept.values())


def _loop(impact: Impact) -> dict[str, Any]:
    loop = impact.loop
    assert loop is not None
    count = len(loop.time)
    every = np.unique(np.linspace(0, count - 1, min(_LOOP_SAMPLES, count)).round().astype(int))
    return {
        "speed_m_per_s": impact.launch.speed,
        "phase": impact.launch.phase,
        "time_s": loop.time[every].tolist(),
        "penetration_m": loop.penetration[every].tolist(),
        "rate_m_per_s": loop.rate[every].tolist(),
        "force_n": loop.force[every].tolist(),
    }


def headline(found: Measurement) -> list[str]:
    """What was measured, in two lines."""
    facts = found.facts
    gravity = float(np.linalg.norm(facts.gravity))
    return [
        f"{sanitized(facts.model)}: {sanitized(facts.pair[0])} on {sanitized(facts.pair[1])}",
        f"{facts.engine} {facts.version}, step {facts.timestep:.6g} s, gravity {gravity:.4g} m/s^2, "
        f"effective mass {effective_mass(found):.4g} kg, {sanitized(facts.moved)}",
    ]


def as_text(found: Measurement) -> str:
    """For a terminal."""
    lines = [*headline(found)]
    lines += [f"{name}: {sanitized(setting_text(value))}" for name, value in found.facts.settings.items()]
    if found.facts.asked_words:
        lines.append(f"the model asks for: {sanitized(found.facts.asked_words)}")
    lines += [f"note: {sanitized(note)}" for note in found.facts.notes]
    asked = found.facts.asked or (math.nan,) * len(found.curve)
    rows = [
        (
            f"{p.speed:.4g}",
            number(p.speed_in, ".4g"),
            number(p.restitution),
            number(p.highest - p.lowest, ".1e"),
            number(a),
            str(p.samples),
            str(p.failed or ""),
        )
        for p, a in zip(found.curve, asked, strict=True)
    ]
    header = ("launched m/s", "at touch m/s", "e", "spread", "asked", "steps", "failed")
    lines += ["", *table(*without_empty(header, rows, "failed")), ""]
    for impact in found.failed[:3]:
        where = f"{impact.launch.speed:.4g} m/s, phase {impact.launch.phase:.3g}"
        lines.append(f"{impact.status.value} at {where}: {sanitized(impact.reason)}")
    lines += _score_lines(found)
    lines += cause_lines(found.causes, found.remedy)
    return "\n".join(lines).rstrip() + "\n"


def setting_text(value: Any) -> str:
    """A setting of the engine's, as the model has it."""
    return " ".join(f"{v:.6g}" for v in value) if isinstance(value, list) else str(value)


def _score_lines(found: Measurement) -> list[str]:
    from hcbench import scoring

    score, law = score_of(found), law_of(found)
    if score is None or law is None or score.rested:
        return []
    lines = [f"fitted α {score.alpha_fit:.4g} s/m (rms {score.alpha_fit_rms:.2g})"]
    if math.isfinite(score.energy_exponent):
        powers = f"v^{score.energy_exponent:.3g}, the law's as v^{number(score.energy_exponent_law, '.3g')}"
        lines.append(f"energy lost goes as {powers}")
    if score.loops:
        lossy = law.alpha * max(i.speed_in for i in found.measured) > _LOSSY
        area = f"area x {number(score.area_ratio, '.3g')}, " if lossy else ""
        lines.append(
            f"loops against eq. (16) of that α: force {score.loop_rms:.2g} rms of the largest, {area}largest "
            f"force x {score.force_ratio:.3g}, duration x {score.duration_ratio:.3g}, first force "
            f"{score.touch_force:.2g} of the largest"
        )
    verdicts = {claim: getattr(score, name) for name, claim in scoring.CLAIMS.items()}
    lines += [f"{claim}: {'yes' if seen else 'no'}" for claim, seen in verdicts.items() if seen is not None]
    if score.energy_gained:
        lines.append("ENERGY IS GAINED: some impacts leave faster than they came")
    return lines


def cause_lines(causes: tuple[Cause, ...], remedy: str) -> list[str]:
    """Causes as indented text."""
    lines = []
    for cause in causes:
        lines += [
            "",
            f"{cause.code}: {sanitized(cause.title)}",
            f"  found  {sanitized(cause.evidence)}",
            f"  fix    {sanitized(cause.fix)}",
        ]
        if math.isfinite(cause.alone):
            words = f"with this alone fixed e is off by {cause.alone:.2g}"
            if len(causes) > 1 and math.isfinite(cause.without):
                words += f", with the others fixed and not this by {cause.without:.2g}"
            lines.append(f"  tried  {words}")
    if remedy:
        lines += ["", remedy]
    return lines
