"""A measurement as text and as JSON. It has no dates in it: the same model gives the same bytes."""

import dataclasses
import math
import re
from typing import Any

import numpy as np

from hcbench import scoring
from hcbench.laws.restitution import Restitution
from hcbench.measuring import contact
from hcbench.measuring.curve import CurvePoint
from hcbench.measuring.measurement import Cause, Measurement
from hcbench.sim.model_under_test import CONTACT
from hcbench.system.text import LONGEST_NOTE, number, sanitized, table, without_empty
from hcbench.terms.impact import Impact
from hcbench.terms.records import IMPACT, LOOP, PHASE, REST, SPEED, record
from hcbench.terms.resolution import NOTABLE_SHARE

SCHEMA = 1
_LOOP_SAMPLES = 200
# From this α v on a loop of the law has an area to compare with.
_LOSSY = 1e-3
# A warning names impact speeds above this multiple of the launch speed.
_FASTER = 1.5
# Steps of a launch: two to three of flight, and as many again for the fall under gravity.
_FLIGHT_STEPS = 5
# Impacts without an e that are listed, at most.
_FAILURES = 3


def as_record(measurement: Measurement) -> dict[str, Any]:
    """The measurement for JSON, in SI units; NaN for a number that does not apply."""
    facts = measurement.facts
    score = measurement.score
    is_oblique = measurement.request.is_oblique
    target = None
    if measurement.wanted is not None:
        target = measurement.wanted.description
    score_record = None
    if score is not None:
        score_record = dataclasses.asdict(score)
    rest = None
    if measurement.rest is not None:
        rest = record(REST, measurement.rest)
    meaning = None
    if measurement.contact is not None:
        meaning = measurement.contact.record
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
        "effective_mass_kg": measurement.effective_mass,
        "normal": list(facts.normal),
        "point_m": list(facts.point),
        "speed_shares": dict(facts.shares),
        "settings": dict(facts.settings),
        "model_asks": {"restitution": list(facts.asked), "description": facts.asked_description},
        "target": target,
        "curve": [point.record(is_oblique) for point in measurement.curve],
        "phase_spread": measurement.spread,
        "energy_gained": measurement.energy_gained,
        "law": _law(measurement),
        "score": score_record,
        "impacts": list(map(_impact, measurement.impacts)),
        "loops": list(map(_loop, measurement.loops)),
        "causes": list(map(dataclasses.asdict, measurement.causes)),
        "remedy": measurement.remedy,
        "rest": rest,
        "rest_causes": list(map(dataclasses.asdict, measurement.rest_causes)),
        "contact": meaning,
        "notes": list(facts.notes),
    }


def _law(measurement: Measurement) -> dict[str, Any] | None:
    """The law for comparison as JSON, SI; None without one."""
    law = measurement.law
    if law is None:
        return None
    return {
        "alpha_s_per_m": law.alpha,
        "stiffness_n_per_m_n": law.stiffness,
        "exponent": law.exponent,
        "alpha_fitted": not isinstance(measurement.wanted, Restitution),
    }


def _impact(impact: Impact) -> dict[str, Any]:
    along = impact.tangential
    if along is None:
        return record(IMPACT, impact, oblique=False)
    return record(IMPACT, impact) | {"tangential": dataclasses.asdict(along)}


def _loop(impact: Impact) -> dict[str, Any]:
    """The loop of an impact that has one: its launch, and its columns as lists, in SI units."""
    assert impact.loop is not None
    loop = impact.loop.thinned(_LOOP_SAMPLES)
    columns: dict[str, Any] = {SPEED.key: impact.launch.speed, PHASE.key: impact.launch.phase}
    for field in LOOP:
        columns[field.key] = field.of(loop).tolist()
    return columns


def as_text(measurement: Measurement) -> str:
    """The measurement as lines for a terminal: conditions, notes, e over speed, score and causes."""
    facts = measurement.facts
    lines = list(measurement.headline)
    for name, value in facts.settings.items():
        lines.append(f"{name}: {sanitized(setting_text(value))}")
    if measurement.wanted is not None and measurement.wanted.of:
        lines.append(f"material: {measurement.wanted.of}")
    if facts.asked_description:
        lines.append(f"the model asks for: {sanitized(facts.asked_description)}")
    if measurement.rest is not None:
        lines.append(f"at rest: {measurement.rest.text}")
    notes = (*facts.notes, *motion_notes(measurement))
    lines += [f"note: {sanitized(note, LONGEST_NOTE)}" for note in notes]
    lines += ["", *_curve_lines(measurement), *_along_lines(measurement), ""]
    if measurement.contact is not None:
        lines += [*contact.as_lines(measurement.contact), ""]
    for impact in measurement.failed[:_FAILURES]:
        where = f"{impact.launch.speed:.4g} m/s, phase {impact.launch.phase:.3g}"
        lines.append(f"{impact.status.value} at {where}: {sanitized(impact.reason)}")
    lines += _score_lines(measurement)
    lines += all_cause_lines(measurement)
    # One empty line between parts.
    return re.sub("\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def _curve_lines(measurement: Measurement) -> list[str]:
    """Lines of the table of e over speed: a row for each launch speed and angle, in m/s and
    degrees. Columns of the angle, of e after the force and of failures are left out if empty.
    """
    asked = measurement.asked_at
    rows = []
    for point in measurement.curve:
        angle = ""
        if measurement.request.is_oblique:
            angle = f"{math.degrees(point.angle):.4g}"
        after_force = ""
        if _acts_on(measurement, point):
            after_force = number(point.restitution_after_force)
        row = (
            f"{point.speed:.4g}",
            angle,
            number(point.speed_in, ".4g"),
            number(point.restitution),
            after_force,
            number(point.spread, ".1e"),
            number(asked[point.speed]),
            str(point.samples),
            str(point.failed or ""),
        )
        rows.append(row)
    header = (
        "launch m/s",
        "deg",
        "impact m/s",
        "e",
        "after force",
        "varies by",
        "model asks",
        "steps",
        "failed",
    )
    shown = without_empty(header, rows, "deg")
    shown = without_empty(*shown, "after force")
    shown = without_empty(*shown, "failed")
    return list(table(*shown))


def motion_notes(measurement: Measurement) -> list[str]:
    """Sentences on how joints, servos, gravity and other contacts changed the speed before, during
    and after the contact; none where they did little.
    """
    return [*_approach_note(measurement), *_shares_note(measurement), *_parting_note(measurement)]


def _approach_note(measurement: Measurement) -> list[str]:
    """One sentence where joints or servos sped up a launch that was not meant to fall; else none."""
    if measurement.request.height is not None:
        return []
    # Points that are much faster at touch than at launch, and by more than gravity explains.
    sped_up = []
    for point in measurement.curve:
        is_faster = point.speed > 0 and not point.speed_in < _FASTER * point.speed
        if is_faster and point.speed_in - point.speed > _gained(measurement):
            sped_up.append(point)
    if not sped_up:
        return []
    worst = max(sped_up, key=lambda point: point.speed_in / point.speed)
    return [
        f"Launched at {worst.speed:.4g} m/s, the bodies meet at {worst.speed_in:.4g} m/s: joints or"
        " servos speed them up on the way. Start from a pose in which they are at rest."
    ]


def _gained(measurement: Measurement) -> float:
    """Speed that gravity gives within the steps of flight before a touch, m/s."""
    gravity = float(np.linalg.norm(measurement.facts.gravity))
    return _FLIGHT_STEPS * gravity * measurement.facts.timestep


def _acts_on(measurement: Measurement, point: CurvePoint) -> bool:
    """True where joints or servos change the speed between the contact's force and the touch plane."""
    change = abs(point.restitution_after_force - point.restitution)
    return bool(measurement.facts.shares) and change >= NOTABLE_SHARE


def _parting_note(measurement: Measurement) -> list[str]:
    """One sentence where joints or servos act on until the bodies part; else none."""
    points = [p for p in measurement.curve if _acts_on(measurement, p)]
    if not points:
        return []
    worst = max(points, key=lambda p: abs(p.restitution_after_force - p.restitution))
    return [
        "Joints, servos or gravity change the speed between the contact's force and the touch plane: "
        f"at {worst.speed:.4g} m/s from {worst.restitution_after_force:.3g} to e = {worst.restitution:.3g}."
    ]


def _shares_note(measurement: Measurement) -> list[str]:
    """A list of one sentence on what else pushed or pulled while the two touched, in per cent of
    the contact's impulse; empty where all other causes but gravity did less than NOTABLE_SHARE of
    the speed at touch, and where none did so much of what the contact did.

    `facts.shares` has the approach speed that each cause took, over the speed at touch; below 0
    for one that worked against the contact. The sentence compares with the contact, since a body
    that stays is pushed for hundreds of steps: the shares themselves would then say nothing.
    """
    facts = measurement.facts
    if not facts.more_than_contact >= NOTABLE_SHARE:
        return []
    contact = facts.shares.get(CONTACT, 0.0)
    others = {name: share for name, share in facts.shares.items() if name != CONTACT}
    if contact <= 0.0:
        strong = [name for name, share in others.items() if abs(share) >= NOTABLE_SHARE]
        if not strong:
            # Each is small, and together they are not.
            strong = [name for name, share in others.items() if share]
        return [f"While the two touch, more than their contact acts: {', '.join(strong)}."]
    pressing: list[str] = []
    parting: list[str] = []
    for name, of_speed in others.items():
        share = of_speed / contact
        if abs(share) >= NOTABLE_SHARE:
            kind = pressing if share < 0.0 else parting
            kind.append(f"{name} {abs(100 * share):.0f} %")
    parts = []
    if pressing:
        parts.append(f"they press the two together: {', '.join(pressing)}")
    if parting:
        parts.append(f"they push the two apart: {', '.join(parting)}")
    if not parts:
        return []
    shares = "; ".join(parts)
    return [
        f"Other forces act while the two touch. In % of the impulse of their contact, {shares}."
    ]


def _along_lines(measurement: Measurement) -> list[str]:
    """Lines of the table of motion along the plate in oblique impacts; empty without any."""
    if not measurement.request.is_oblique:
        return []
    friction = measurement.facts.friction
    limit = "" if math.isnan(friction) else f"; by Coulomb's law at most the friction, {friction:g}"
    words = f"along the plate, J the impulse of friction over the normal one{limit}"
    header = ("launch m/s", "deg", "slip m/s", "after", "spin rad/s", "after", "J", "energy lost")
    rows = []
    for point in measurement.curve:
        along = point.along
        row = (
            f"{point.speed:.4g}",
            f"{math.degrees(point.angle):.4g}",
            number(along.slip_in, ".4g"),
            number(along.slip_out, ".4g"),
            number(along.spin_in, ".4g"),
            number(along.spin_out, ".4g"),
            number(along.impulse_ratio, ".3f"),
            number(along.energy_lost, ".3f"),
        )
        rows.append(row)
    return ["", words, "", *table(header, rows)]


def setting_text(value: Any) -> str:
    """A setting of the engine, written as in the model."""
    if not isinstance(value, list):
        return str(value)
    return " ".join(f"{each:.6g}" for each in value)


def _score_lines(measurement: Measurement) -> list[str]:
    """Lines on how the impacts compare with the law: fitted α, energy lost over speed, loops of
    force, claims of the law, gain of energy. Empty without a law, or if an impact came to rest.
    """
    score = measurement.score
    law = measurement.law
    if score is None or law is None or score.rested:
        return []
    lines = []
    # NaN for one speed.
    if math.isfinite(score.alpha_fit):
        lines.append(f"fitted α {score.alpha_fit:.4g} s/m (rms {score.alpha_fit_rms:.2g})")
    if math.isfinite(score.energy_exponent):
        powers = f"v^{score.energy_exponent:.3g}, the law's as v^{number(score.energy_exponent_law, '.3g')}"
        lines.append(f"energy lost goes as {powers}")
    if score.loops:
        fastest = max(impact.speed_in for impact in measurement.measured)
        area = ""
        if law.alpha * fastest > _LOSSY:
            area = f"area x {number(score.area_ratio, '.3g')}, "
        lines.append(
            f"loops against the law with that α: force {score.loop_rms:.2g} rms of the largest, {area}"
            f"largest force x {score.force_ratio:.3g}, duration x {score.duration_ratio:.3g}, first force "
            f"{score.touch_force:.2g} of the largest"
        )
    for name, claim in scoring.CLAIMS.items():
        holds = getattr(score, name)
        if holds is not None:
            lines.append(f"{claim}: {'yes' if holds else 'no'}")
    if score.energy_gained:
        lines.append("ENERGY IS GAINED: some impacts leave faster than they came")
    return lines


def all_cause_lines(measurement: Measurement) -> list[str]:
    """Causes of the bounce with the remedy, then those of what is too much at rest; of one that is
    both, at rest the evidence alone.
    """
    causes = measurement.causes
    lines = cause_lines(causes, measurement.remedy)
    titles = {cause.code: cause.title for cause in causes}
    only_at_rest = []
    for cause in measurement.rest_causes:
        if titles.get(cause.code) == cause.title:
            lines += ["", f"{cause.code} acts at rest, too: {sanitized(cause.evidence)}"]
        else:
            only_at_rest.append(cause)
    return lines + cause_lines(tuple(only_at_rest), "")


def cause_lines(causes: tuple[Cause, ...], remedy: str) -> list[str]:
    """Causes as indented lines, each with evidence, fix and where to read more; then the remedy.

    remedy: a sentence, or "".
    """
    lines = []
    for cause in causes:
        lines += [
            "",
            f"{cause.code}: {sanitized(cause.title)}",
            f"  found  {sanitized(cause.evidence)}",
            f"  fix    {sanitized(cause.fix)}",
        ]
        if math.isfinite(cause.alone):
            tried = f"with this alone put right e is wrong by {cause.alone:.2g}"
            if len(causes) > 1 and math.isfinite(cause.without):
                tried += f", with all others by {cause.without:.2g}"
            lines.append(f"  tried  {tried}")
        lines.append(f"  more   hcbench docs causes#{cause.code}")
    if remedy:
        lines += ["", remedy]
    return lines
