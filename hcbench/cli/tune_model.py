"""hcbench tune MODEL: a setting for pairs of a user's own model, tuned in it, and how wrong it is; or for
the feet of a robot, with its landing before and after.
"""

from __future__ import annotations

import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

from hcbench.cli.console import print_json, show, show_code, status, typed_again
from hcbench.measuring.request import is_python
from hcbench.sim.passivity import MOST_E
from hcbench.system.errors import LimitPassed
from hcbench.system.text import as_bound, joined_names, sanitized, time_step

if TYPE_CHECKING:
    from hcbench.measuring.curve import CurvePoint
    from hcbench.sim.landing import DropTest
    from hcbench.tuning.tuned_model import LandingChange, TunedModel, TunedPair


def tune_model(
    models: tuple[str, ...],
    *,
    alpha: tuple[float, float] | None,
    max_error: float | None,
    strict: bool,
    write_model: Path | None,
    write_include: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Tune pairs of a model, print the lines and how wrong they are, and write the model with them.

    models: files, or FILE.py:FUNCTION.
    alpha: α and its standard uncertainty, s/m.
    max_error: limit of the error of e, None for the default.
    strict: whether a worse rest is an error.
    write_model, write_include: files to write.
    given: other options of the command, by name.
    Raises LimitPassed where no setting helps or one is beyond a limit, after all is printed.
    """
    from hcbench.measuring.measure import begin_measuring
    from hcbench.tuning import ask
    from hcbench.tuning.answer import MAX_ERROR

    begin_measuring(models, None)
    limit = MAX_ERROR if max_error is None else max_error
    files: dict[str, Any] = {"write_model": write_model, "write_include": write_include}
    # The uncertainty of α plays no part in a model's own setting.
    value = None if alpha is None else alpha[0]
    source = models[0] if len(models) == 1 else models
    with status(f"trying settings in {sanitized(' + '.join(models))}"):
        tuned = ask.tune_model(source, alpha=value, max_error=limit, **files, **given)
    of_material = _material_line(given["material"])
    landing = tuned.landing
    # Nothing is written of a model that needs no setting.
    written = write_model if tuned.text else None
    if as_json:
        print_json(_record(tuned) | of_material)
    elif landing is not None and landing.rebound is not None:
        print_landing(tuned, landing)
        _show_files(tuned, files)
        if tuned.gains:
            launches = _same_drops(landing, models) + typed_again(given, _kept_by_land(tuned))
            model = _tested(tuned, written, models)
            show(f"\n{_next_title(tuned, written, models)}\n  hcbench land {model}{launches}")
    else:
        for name, line in of_material.items():
            show(f"{name}: {line}")
        _print(tuned, limit)
        _show_files(tuned, files)
        if tuned.gains:
            line = _next_line(tuned, limit, _tested(tuned, written, models), value, given)
            show(f"\n{_next_title(tuned, written, models)}\n  {line}")
    _require(tuned, limit, strict)


def _require(tuned: TunedModel, limit: float, strict: bool) -> None:
    """Raise LimitPassed where no setting helps, or where the one that was found is beyond a limit.

    limit: largest error of e that passes.
    strict: whether a worse rest of the model is an error.
    """
    landing = tuned.landing
    # Of a robot's landing e is not the target, and its error no reason to fail.
    if landing is not None and (landing.worse or landing.rebound is not None):
        if tuned.gains:
            return
        raise landing_error(tuned, landing)
    if not tuned.gains:
        raise _nothing_gained(tuned)
    if tuned.max_e > MOST_E:
        got = f"e up to {tuned.max_e:.4g} of the model as it is: it gains energy"
        raise LimitPassed("restitution", got, "1 at most", _cure(tuned))
    if not tuned.max_error <= limit:
        got = f"{tuned.max_error:.3g}, of the best setting that was found"
        raise LimitPassed("max-error", got, f"{limit:g} or less", _cure(tuned))
    if strict and tuned.worse:
        raise LimitPassed("strict", "; ".join(tuned.worse), "at most 1.2 times what it was")


def _show_files(tuned: TunedModel, asked: dict[str, Any]) -> None:
    """Print the files that were written, or that none was, where any was asked for.

    asked: paths, by their options; None for those that were not. A setting that gains is written
    even where its error is beyond the limit.
    """
    if not any(asked.values()):
        return
    show("")
    for path in tuned.files:
        show(f"written: {sanitized(str(path))}")
    if not tuned.files:
        show("nothing written")


def _material_line(name: str | None) -> dict[str, str]:
    """The material of the target, with its numbers and source; empty without one."""
    if name is None:
        return {}
    from hcbench.catalogue.find import find

    return {"material": find(name).line}


def _next_line(
    tuned: TunedModel,
    limit: float,
    model: str,
    alpha: float | None,
    given: dict[str, Any],
) -> str:
    """The command to type next: it holds the first pair to the limit, in CI too; where the error of
    the setting is beyond the limit, it measures the pair.

    limit: largest error of e that passes.
    model: the tuned model, as a shell takes it.
    alpha: s/m.
    given: the other options, by their names.
    """
    pair = tuned.pairs[0]
    # Speeds at launch, as --speeds are; gravity makes those at touch higher.
    low, high = (f"{pair.curve[place].speed:.3g}" for place in (0, -1))
    speeds = low if low == high else f"{low}:{high}:5"
    # The target, as an option; none of pairs v:e, for which `check` needs a file.
    asked = []
    if given.get("restitution") is not None:
        asked = [f"--restitution {given['restitution']:g}"]
    elif alpha is not None:
        asked = [f'--alpha "{alpha:.10g} s/m"']
    elif given["material"] is not None:
        asked = [f"--material {quote(given['material'])}"]
    names = joined_names(pair.facts.pair)
    if given["pair"]:
        # As the user typed it.
        names = given["pair"][0]
    words = [
        model,
        f"--pair {quote(names)}",
        typed_again(given, (*_not_written(tuned), *_POSE, "coming_from", "actuators")).strip(),
        *asked,
        f'--speeds "{speeds} m/s"',
    ]
    # A limit that is the setting's own error would be a gate that cannot fail.
    if tuned.max_error > limit:
        return " ".join(filter(None, ["hcbench measure", *words]))
    return " ".join(filter(None, ["hcbench check", *words, f"--max-error {limit:g}"]))


def _tested(tuned: TunedModel, written: Path | None, models: tuple[str, ...]) -> str:
    """The tuned model as a shell takes it: the file that was written, or the user's own, into which
    the lines go; a function of Python where they are lines of a script.

    models: the user's own.
    """
    if written is None and _are_lines_of_a_script(tuned, models):
        return "--python FILE.py:FUNCTION"
    return _model(written, models)


def _are_lines_of_a_script(tuned: TunedModel, models: tuple[str, ...]) -> bool:
    """Say whether the lines of a tuned model go into a script, and the user has given none yet.

    models: the user's own.
    """
    return bool(tuned.text) and not tuned.written and not is_python(models[0])


def _next_title(tuned: TunedModel, written: Path | None, models: tuple[str, ...]) -> str:
    """The line over the command to type next: it says where the lines go that were not written.

    written: the file with the tuned model.
    models: the user's own.
    """
    if written is not None or not tuned.text:
        return "next:"
    if _are_lines_of_a_script(tuned, models):
        return "next, with these lines in FILE.py, whose FUNCTION returns World(client, first, second):"
    file = models[0].partition(":")[0] if is_python(models[0]) else models[0]
    return f"next, with these lines in {sanitized(file)}:"


# Options of the pose, which no model keeps.
_POSE = ("key", "qpos", "state")


def _not_written(tuned: TunedModel) -> tuple[str, ...]:
    """Names of the options that the lines leave out: step and gravity, unless they are lines of a
    model or nothing was changed.
    """
    return () if tuned.written else ("timestep", "gravity")


def _kept_by_land(tuned: TunedModel) -> tuple[str, ...]:
    """Names of the options with which `land` drops the robot as `tune` did."""
    return (*_POSE, *_not_written(tuned))


def _tilt() -> str:
    """The tilt of the drops that judge a robot, as `land` takes it."""
    from hcbench.sim.landing import TILT_AXIS, TILTS

    axis = " ".join(f"{along:g}" for along in TILT_AXIS)
    return f"{math.degrees(TILTS[-1]):g} deg about {axis}"


def _same_drops(change: LandingChange, models: tuple[str, ...]) -> str:
    """Options with which `land` makes the drops of a table, each with a space before it.

    models: the user's own.
    """
    words = ' --heights "2, 5, 10 cm"'
    # A base that cannot turn is dropped flat.
    if change.before.flat < change.before.drops:
        words += f' --tilt "0, {_tilt()}"'
    # Motors that a world of Python has are left as they are.
    if change.before.robot.controller.startswith("the motors of the world"):
        words += " --controller ctrl"
    return words


def _model(written: Path | None, models: tuple[str, ...]) -> str:
    """Words of a command for the file that was written, or for the models that the user named."""
    if written is not None:
        return quote(str(written))
    if is_python(models[0]):
        return f"--python {quote(models[0])}"
    return " ".join(map(quote, models))


def _nothing_gained(tuned: TunedModel) -> LimitPassed:
    """The error where no setting is better than the model's own."""
    return LimitPassed(
        "restitution", tuned.no_gain, "a gain", f"Nothing is written. {_cure(tuned)}"
    )


def _cure(tuned: TunedModel) -> str:
    """Advice for a target that no setting reaches."""
    from hcbench.sim import registry
    from hcbench.sim.capabilities import HasPlugin

    facts = tuned.pairs[0].facts
    step = f"a smaller step, such as --timestep {time_step(facts.timestep / 4)}"
    if not isinstance(registry.engine(facts.engine), HasPlugin):
        return f"Try {step}"
    names = joined_names(facts.in_text or facts.pair)
    where = f"--timestep {time_step(facts.timestep)} --pair {quote(names)}"
    plugin = f"the exact plug-in, `hcbench tune {facts.engine} --plugin {where}` and your target"
    return f"Try {plugin}; or {step}"


def _reasons(tuned: TunedModel, limit: float) -> list[str]:
    """Reasons why e misses the target, a sentence each.

    limit: largest error of e that is allowed. Empty where e is within it and nothing is worse than
    before.
    """
    reasons = []
    if tuned.max_error > limit and abs(tuned.taken) > limit:
        verb = "take" if tuned.taken > 0.0 else "add"
        reasons.append(
            f"Joints and servos {verb} up to {100 * abs(tuned.taken):.0f} % of the impact speed between the "
            "last force of the contact and the touch plane, by where in a step the contact starts (chance), "
            f"which the search did not overcome. {_cure(tuned)}."
        )
    elif tuned.max_error > limit:
        reasons.append(f"{_cure(tuned)}.")
    if tuned.worse:
        reasons.append(f"Worse than before by more than 1.2 times: {'; '.join(tuned.worse)}.")
    return reasons


def _record(tuned: TunedModel) -> dict[str, Any]:
    """The tuned model as `--json` prints it, SI."""
    if tuned.landing is None:
        facts = tuned.pairs[0].facts
        timestep, gravity = facts.timestep, facts.gravity
    else:
        robot = tuned.landing.before.robot
        timestep, gravity = robot.timestep, robot.gravity
    return {
        "schema": 1,
        "kind": "hcbench tuned model",
        "model": tuned.model,
        "engine": tuned.engine,
        "timestep_s": timestep,
        "gravity_m_per_s2": list(gravity),
        "setting": tuned.name,
        "max_error": tuned.max_error,
        "gains": tuned.gains,
        "passive": {"flat": tuned.flat},
        "pairs": list(map(_pair_record, tuned.pairs)),
        "before": tuned.before.record | {"pairs": list(map(_pair_record, tuned.untuned))},
        "after": tuned.after.record,
        "worse": tuned.worse,
        "taken_by_joints": tuned.taken,
        "landing": landing_record(tuned.landing),
        "paste": tuned.text,
        "notes": list(tuned.notes),
    }


def _pair_record(tuned: TunedPair) -> dict[str, Any]:
    """A pair as `--json` prints it, SI."""
    return {
        "pair": list(tuned.facts.pair),
        "attitude": tuned.attitude,
        "effective_mass_kg": tuned.facts.effective_mass,
        "max_error": tuned.max_error,
        "curve": [point.record(is_oblique=False) for point in tuned.curve],
    }


def _print(tuned: TunedModel, limit: float) -> None:
    """Print the answer: pairs with their errors and curves, the model before and after, text to
    paste.

    limit: largest error of e that passes.
    """
    facts = tuned.pairs[0].facts
    gravity = " ".join(f"{g + 0.0:.4g}" for g in facts.gravity)
    if tuned.flat is False:
        show("for spheres: a flat face gains energy")
    show(f"{facts.model}, step {time_step(facts.timestep)} s, gravity {gravity} m/s^2")
    show(f"setting: {tuned.name}")
    for pair in tuned.pairs:
        _print_pair(pair)
    show("\n" + "\n".join(_table(tuned)))
    for sentence in _reasons(tuned, limit):
        show(f"\n{sentence}")
    if tuned.landing is not None:
        show("\n" + "\n".join(landing_table(tuned.landing)))
        for sentence in landing_sentences(tuned.landing):
            show(f"\n{sentence}")
        show("\nThe target is e of a foot alone; --rebound is a target of the whole robot.")
    if tuned.gains and not tuned.text:
        show("\nThe model as it is has this e already: there is nothing to paste.")
    elif tuned.gains:
        show("\npaste:\n")
        show_code(tuned.text)
    elif tuned.landing is not None and tuned.landing.worse:
        show("\nthe nearest setting, which is not written:\n")
        show_code(tuned.text)
    _print_notes(tuned, limit)


def _print_pair(pair: TunedPair) -> None:
    """Print how a pair bounces with the setting: the two, how they meet, the largest error of e,
    and at each speed at touch the target and the range of e over the phases.
    """
    facts = pair.facts
    attitude = ""
    if pair.attitude:
        attitude = f", on its {pair.attitude}"
    first, second = facts.pair
    show(f"\n{first} on {second}{attitude}, effective mass {facts.effective_mass:.4g} kg")
    show(f"contact {facts.meeting}; moved by {facts.moved}")
    low, high = pair.band
    band = f"from {low:.2g} to {high:.2g} m/s"
    error = as_bound(pair.max_error)
    show(f"largest error of e: {error} {band}, tuned, in {pair.launches} launches")
    show("at touch:")
    for point in pair.curve:
        least_most = f"{point.lowest:.4f} ... {point.highest:.4f}"
        show(f"  {point.speed_in:.3g} m/s: target {point.target:.4f}, {least_most}")


def _print_notes(tuned: TunedModel, limit: float) -> None:
    """Print the setting's notes, and that a gate needs the limit of the error where its own is less.

    limit: largest error of e that passes.
    """
    from hcbench.checking.spec import MAX_ERROR

    notes = list(tuned.notes)
    if tuned.gains and tuned.text and MAX_ERROR < tuned.max_error <= limit:
        gate = f"`hcbench check` and the fixture allow an error of {MAX_ERROR:g}"
        notes.append(f"{gate} by default: this setting needs {limit:g}.")
    if notes:
        show("\nNotes:")
    for note in notes:
        show(f"- {note}")


def _table(tuned: TunedModel) -> list[str]:
    """The model before and after, a line each.

    Speeds are m/s; the other quantities in the units that are printed. Rows that neither model has
    a number for are left out.
    """
    from hcbench.sim.rest import QUANTITIES

    rows = [("", "before", "after")]
    for untuned, pair in zip(tuned.untuned, tuned.pairs, strict=True):
        title = f"e of {pair.facts.pair[0]}"
        if pair.attitude:
            title += f" on {pair.attitude}"
        # The ends of the band.
        for place in (0, -1):
            old = untuned.curve[place]
            new = pair.curve[place]
            rows.append((f"{title} at {new.speed_in:.2g} m/s", _ends(old), _ends(new)))
    before = tuned.before.record
    after = tuned.after.record
    for quantity in QUANTITIES:
        was, now = before[quantity.key], after[quantity.key]
        if math.isnan(was) and math.isnan(now):
            continue
        title = f"{quantity.title}, {quantity.unit}"
        rows.append((title, quantity.shown(was), quantity.shown(now)))
    first = max(len(name) for name, _, _ in rows)
    second = max(len(was) for _, was, _ in rows)
    return [f"{name:<{first}}  {was:>{second}}  {now}" for name, was, now in rows]


def _ends(point: CurvePoint) -> str:
    """The lowest and the highest e of a point; of one that never bounced "no e"."""
    if math.isnan(point.lowest):
        return "no e"
    return f"{point.lowest:.2f} ... {point.highest:.2f}"


# The landing of a robot before and after.

# Energy gain over m g h from which no contact is worth a search before the step is smaller.
_LIVELY = 0.05
# The output names the chance in a rebound that varies over the phases by more of itself.
_WIDE = 0.25
_DROPS = "from 2, 5 and 10 cm at 4 phases of the step"


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
    """The landing before and after, a line each: the rebound, then the worst of all drops of each
    quantity that was measured; each line says which of the two it is.

    The rebound is the mean over the phases of the flat drops from the largest height, in mm, +- the
    largest difference from it. Where a drop diverged, every value is "diverged".
    """
    from hcbench.sim.landing import QUANTITIES

    was = change.before
    now = change.after
    rebound = _landed(was, f"{1e3 * was.rebound:.3g}")
    with_spread = _landed(now, f"{1e3 * now.rebound:.3g} +- {1e3 * now.spread:.2g}")
    phases = max(was.phases, now.phases)
    rows = [
        (f"worst of {was.drops} drops, except rebound", "before", "after"),
        (f"rebound from 10 cm, mm, mean of {phases} flat", rebound, with_spread),
    ]
    for each in QUANTITIES:
        old, new = getattr(was, each.name), getattr(now, each.name)
        if math.isnan(old) and math.isnan(new):
            continue
        # A robot that falls over lands on more than its feet.
        of_parts = "of any part" if each.name == "peak" and was.falls else ""
        title = ", ".join(filter(None, (each.title, of_parts, each.unit)))
        rows.append((title, _landed(was, each.shown(old)), _landed(now, each.shown(new))))
    first = max(len(title) for title, _, _ in rows)
    second = max(len(old) for _, old, _ in rows)
    return [f"{title:<{first}}  {old:>{second}}  {new}" for title, old, new in rows]


def _landed(test: DropTest, value: str) -> str:
    """A value of a drop test as its table has it."""
    return "diverged" if test.diverged else value


def landing_sentences(change: LandingChange) -> list[str]:
    """Sentences on a landing before and after: which drops it was, what is worse, and what would
    help; lengths in mm.
    """
    before = change.before
    tilted = f"flat and tilted by {_tilt()}"
    if before.flat == before.drops:
        tilted = "flat alone, as the base cannot turn"
    sentences = [f"The drops are {_DROPS}, {tilted}."]
    # `settled` counts the drops that are long enough to show how the robot rests.
    if before.falls:
        sentences = [
            "The robot falls over or rolls down by itself: hcbench compares the first second only."
        ]
    elif 0 < before.settled < before.drops:
        sentences.append(
            f"Rest, penetration at rest, travel, creep, vibration and late flights are those of "
            f"{before.settled} of them, which last {before.seconds:.0f} s."
        )
    after = change.after
    if change.rebound and after.spread > _WIDE * after.rebound:
        sentences.append(
            f"The rebound varies by {1e3 * after.spread:.2g} mm with where in a step the contact "
            "starts (chance): a smaller step narrows it."
        )
    if change.rebound is not None and change.is_met and change.after is before:
        sentences.append("The model as it is has this rebound already: there is nothing to paste.")
    if change.worse or after is not before:
        sentences.append(f"Worse than before: {'; '.join(change.worse) or 'nothing'}.")
    if change.reach is not None:
        reached = f"{1e3 * change.reach.rebound:.3g} mm"
        sentences.append(
            f"The {change.extreme} at this step without a worse landing is {reached}, of the contacts "
            "that were tried."
        )
        if not math.isnan(before.frequency):
            # A spring sags by g/ω² under the weight that it bears; mm.
            sag = 1e3 * math.hypot(*before.robot.gravity) / before.frequency**2
            sentences.append(
                f"The robot sags {sag:.2g} mm on its legs, a frequency of {before.frequency:.3g} "
                "rad/s: the contact and the legs together throw it up."
            )
        sentences += _stiffer(change)
    if (change.worse or change.reach is not None) and before.gain > _LIVELY:
        smaller = f"a smaller step, such as {time_step(before.robot.timestep / 4)} s"
        gained = f"The robot as it is gains {before.gain:.2g} times m g h as it lands"
        sentences.append(f"{gained}: first take {smaller}.")
    return [*sentences, *change.advice]


def _stiffer(change: LandingChange) -> list[str]:
    """A sentence on whether servos with larger gains have the rebound that is asked for; none where
    no other gains were tried. change: with the `reach` of settings.
    """
    from hcbench.sim.landing import kv_factor

    assert change.reach is not None
    if not change.reach.stiffer:
        return []
    *_, (factor, rebound) = change.reach.stiffer
    gains = f"kp times {factor:g} and kv times {kv_factor(factor):g}"
    if math.isnan(rebound):
        return [f"No contact that was found has it with stiffer servos, up to {gains}, either."]
    return [
        f"Stiffer servos would do: with {gains} a contact has {1e3 * rebound:.3g} mm, and in all "
        "drops nothing is worse than with these servos alone. Change the gains and tune again."
    ]


def landing_record(change: LandingChange | None) -> dict[str, Any] | None:
    """The landing for `--json`, SI units in the keys; None where the model was not dropped.

    change: the landing before and after, with what is worse.
    """
    if change is None:
        return None
    reach = None
    if change.reach is not None:
        stiffer = []
        for factor, rebound in change.reach.stiffer:
            stiffer.append({"kp_factor": factor, "rebound_m": rebound})
        reach = {"rebound_m": change.reach.rebound, "stiffer": stiffer}
    return {
        "target_rebound_m": change.rebound,
        "before": change.before.record,
        "after": change.after.record,
        "worse": change.worse,
        "reach": reach,
        "advice": list(change.advice),
    }


def landing_error(tuned: TunedModel, change: LandingChange) -> LimitPassed:
    """The error for a setting that was not written: with it the robot lands worse, or has not the
    rebound that was asked for.
    """
    slot = "landing" if change.rebound is None else "rebound"
    expected = "no worse landing"
    if change.rebound is not None:
        expected = f"{1e3 * change.rebound:.3g} mm with no worse landing"
        if change.reach is None and not change.worse:
            expected = f"{1e3 * change.rebound:.3g} mm at every phase of the step"
    nearest = "The output has the nearest setting." if tuned.text else ""
    advice = change.advice[0] if change.advice else nearest
    return LimitPassed(slot, tuned.no_gain, expected, f"Nothing is written. {advice}".strip())
