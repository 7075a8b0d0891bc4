"""Landing of a robot before and after `hcbench tune MODEL`: its table, its sentences, its JSON."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hcbench.cli.terminal import show, show_code
from hcbench.system.errors import LimitPassed
from hcbench.system.text import time_step

if TYPE_CHECKING:
    from hcbench.tuning.tuned_model import LandingChange, TunedModel

_DROPS = "drops of 2, 5 and 10 cm at 4 phases of the step, flat and tilted by 5 degrees"


def print_landing(tuned: TunedModel, change: LandingChange) -> None:
    """Print the answer to a rebound: both landings, what is possible, and text to paste."""
    robot = change.before.robot
    gravity = " ".join(f"{g + 0.0:.4g}" for g in robot.gravity)
    show(f"{robot.model}, step {time_step(robot.timestep)} s, gravity {gravity} m/s^2")
    show(f"{robot.name}, {robot.mass:.4g} kg; {robot.controller}")
    show(f"setting: {tuned.name}")
    show("\n" + "\n".join(landing_table(change)))
    for sentence in landing_sentences(change):
        show(f"\n{sentence}")
    if not tuned.text:
        return
    show("\npaste:\n" if tuned.gains else "\nthe nearest setting, which is not written:\n")
    show_code(tuned.text)
    show("\nNotes:")
    for note in tuned.notes:
        show(f"- {note}")


def landing_table(change: LandingChange) -> list[str]:
    """The robot's landing before and after, a line each; the worst of all drops, but the rebound."""
    from hcbench.sim.landing import QUANTITIES

    was = change.before
    now = change.after
    spread = f"{1e3 * now.rebound:.3g} +- {1e3 * now.spread:.2g}"
    rows = [
        ("landing of the robot", "before", "after"),
        ("rebound from 10 cm, mm", f"{1e3 * was.rebound:.3g}", spread),
    ]
    for each in QUANTITIES:
        old = getattr(was, each.name) / each.si
        new = getattr(now, each.name) / each.si
        if math.isnan(old) and math.isnan(new):
            continue
        title = ", ".join(filter(None, (each.title, each.unit)))
        rows.append((title, _number(old), _number(new)))
    first = max(len(title) for title, _, _ in rows)
    second = max(len(old) for _, old, _ in rows)
    return [f"{title:<{first}}  {old:>{second}}  {new}" for title, old, new in rows]


def _number(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.3g}"


def landing_sentences(change: LandingChange) -> list[str]:
    """Sentences on a landing: what it was, what is worse, and what would help."""
    before = change.before
    sentences = [f"The worst of 24 drops: {_DROPS}."]
    if before.fell:
        sentences = ["The robot falls over by itself: hcbench compares the first second only."]
    if change.rebound is not None and change.is_met and change.after is before:
        sentences.append("The model as it is has this rebound already: there is nothing to paste.")
    if change.worse:
        sentences.append(f"Worse than before: {'; '.join(change.worse)}.")
    if change.reach is not None and change.rebound:
        largest = f"{1e3 * change.reach.rebound:.3g} mm"
        sentences.append(
            f"The largest rebound at this step without a worse landing is {largest}, of the "
            "contacts that were tried."
        )
        if not math.isnan(before.frequency):
            sag = 1e3 * math.hypot(*before.robot.gravity) / before.frequency**2
            sentences.append(
                f"The robot sags {sag:.2g} mm on its legs, a frequency of {before.frequency:.3g} "
                "rad/s: the contact and the legs together throw it up."
            )
        sentences += _stiffer(change)
    if change.worse or change.reach is not None:
        sentences += change.advice or [
            f"A smaller step, such as {time_step(before.robot.timestep / 4)} s, may help."
        ]
    else:
        sentences += change.advice
    return sentences


def _stiffer(change: LandingChange) -> list[str]:
    """A sentence on the gains of the servos that the target would take."""
    assert change.reach is not None
    assert change.rebound is not None
    if not change.reach.stiffer:
        return []
    factor, largest = max(change.reach.stiffer, key=lambda one: one[1])
    reached = f"with kp times {factor:g} (kv times {math.sqrt(factor):.2g}) {1e3 * largest:.3g} mm"
    if largest >= change.rebound:
        return [f"Stiffer servos would do: at the touch, {reached}."]
    return [f"Stiffer servos do not reach it either: at the touch, {reached} at most."]


def landing_record(change: LandingChange | None) -> dict[str, Any] | None:
    """The landing in SI units for `--json`; None for None."""
    if change is None:
        return None
    reach = None
    if change.reach is not None:
        stiffer = [
            {"kp_factor": factor, "rebound_m": rebound} for factor, rebound in change.reach.stiffer
        ]
        reach = {"rebound_m": change.reach.rebound, "stiffer": stiffer}
    return {
        "target_rebound_m": change.rebound,
        "before": change.before.record,
        "after": change.after.record,
        "worse": change.worse,
        "largest": reach,
        "advice": list(change.advice),
    }


def landing_error(tuned: TunedModel, change: LandingChange) -> LimitPassed:
    """The error where the robot lands worse, or has not the rebound."""
    slot = "landing" if change.rebound is None else "rebound"
    expected = "no worse landing"
    if change.rebound is not None:
        expected = f"{1e3 * change.rebound:.3g} mm with no worse landing"
    advice = change.advice[0] if change.advice else "The output says what would help."
    return LimitPassed(slot, tuned.no_gain, expected, f"Nothing is written. {advice}")
