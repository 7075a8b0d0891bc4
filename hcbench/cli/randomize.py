"""hcbench randomize: contacts for many worlds, whose measured e and friction are as asked."""

from __future__ import annotations

import math
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import (
    as_json,
    force_option,
    model_source,
    options,
    output_option,
    print_json,
    show,
    show_code,
    status,
    typed_again,
)
from hcbench.cli.help import command
from hcbench.system.errors import UserError
from hcbench.system.text import as_bound, time_step

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats
    from hcbench.tuning.random_worlds import RandomWorlds

# Options of a launch that no written model keeps.
_LAUNCH = ("key", "qpos", "state", "move", "coming_from", "actuators")

# Smaller differences are rounding.
_FINEST = 1e-6


@command()
@click.option(
    "--pair",
    multiple=True,
    metavar="PAIR",
    help="Two bodies or geoms, first the one that moves: 'foot,floor'. Repeatable: all share e.",
)
@click.option(
    "--restitution",
    metavar="BAND",
    required=True,
    help="Band of e: '0.3:0.6'; one e for all worlds.",
)
@click.option("--friction", metavar="BAND", help="Band of μ.  [default: the model's own μ]")
@click.option(
    "--worlds",
    type=click.IntRange(min=1),
    default=4096,
    show_default=True,
    help="Number of worlds.",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of what is drawn.",
)
@options("speeds", "timestep", "gravity", "key", "qpos", "state", "package", "move")
@options("coming_from", "actuators")
@model_source
@output_option("--out", help="Write the parameters of all worlds (.npz).")
@output_option("--write-model", help="Write the model to which the parameters belong.")
@force_option
@as_json
def randomize(
    models: tuple[str, ...],
    python: str | None,
    pair: tuple[str, ...],
    out: Path | None,
    write_model: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Draw contacts for many worlds, with a range of e and friction.

    Write the engine's own parameters, an array each. hcbench measures e in your model, at its step
    and mass, and launches the pair in a tenth of the worlds to certify it.
    """
    from hcbench.measuring.measure import begin_measuring
    from hcbench.tuning.randomize import randomize as draw

    begin_measuring(models, given["engine"])
    if python is not None and models:
        raise UserError("--python", f"given with {' '.join(models)}", "one of the two")
    if python is None and len(models) != 1:
        raise UserError("model", f"{len(models)} given", "one file, or --python FILE:FUNCTION")
    source = models[0] if python is None else python
    with status("measuring contacts"):
        drawn = draw(source, list(pair), out=out, write_model=write_model, **given)
    if as_json:
        print_json(_record(drawn))
        return
    _print(drawn)
    if write_model is not None:
        launch = typed_again(given, _LAUNCH)
        next_line = (
            f"hcbench measure {quote(str(write_model))} --pair {quote(drawn.pairs[0])}{launch}"
        )
        show(f"\nnext:\n  {next_line}")


def _record(drawn: RandomWorlds) -> dict[str, Any]:
    """The worlds as `--json` prints them: what was drawn, the certificate's errors of e and μ with
    their p-values, and the pair at rest; SI.
    """
    return {
        "schema": 1,
        **drawn.about,
        "worlds": len(drawn),
        "parameters": list(drawn.parameters),
        "certified": len(drawn.certificate.worlds),
        "launches": drawn.certificate.launches,
        "speeds_m_per_s": drawn.certificate.speeds.tolist(),
        "restitution_minus_mean": drawn.by_speed.tolist(),
        "restitution_error": float(abs(drawn.errors).max()),
        "restitution_p": drawn.p_restitution,
        "restitution_of_one_launch": drawn.chance,
        "friction_error": _largest(drawn.friction_errors),
        "friction_p": drawn.p_friction,
        "energy_gained": drawn.certificate.energy_gained,
        "before": drawn.before.record,
        "after": [after.record for after in drawn.after],
        "notes": list(drawn.notes),
    }


def _largest(errors: Floats) -> float:
    return float(abs(errors).max()) if len(errors) else math.nan


def _print(drawn: RandomWorlds) -> None:
    """Print what was drawn, how well it was measured, how it rests, and the lines of the model."""
    first = drawn.facts[0]
    certificate = drawn.certificate
    show(
        f"{first.model}: {len(drawn)} worlds, step {time_step(first.timestep)} s, seed {drawn.seed}"
    )
    show(f"contact: {drawn.name}")
    for facts in drawn.facts:
        show(f"{facts.pair[0]} on {facts.pair[1]}, effective mass {facts.effective_mass:.4g} kg")
    count = len(certificate.worlds)
    show(f"\nmeasured in {count} worlds, {certificate.launches} launches:")
    low, high = drawn.restitution_band
    within = as_bound(float(abs(drawn.errors).max()))
    show(f"  e {low:g} ... {high:g}: within {within} of what was drawn{_p(drawn.p_restitution)}")
    for speed, change in zip(certificate.speeds, drawn.by_speed, strict=True):
        show(f"    at {speed:.3g} m/s: {change:+.3f} from the mean of the speeds")
    show(
        f"    one launch: within {as_bound(drawn.chance)}, by speed and where in a step it touches"
    )
    if drawn.friction_band is not None:
        low, high = drawn.friction_band
        measured = "set as drawn, not measured"
        if len(drawn.friction_errors):
            within = as_bound(max(_largest(drawn.friction_errors), _FINEST))
            measured = f"within {within} of what was drawn{_p(drawn.p_friction)}"
        show(f"  μ {low:g} ... {high:g}: {measured}")
    show(f"  largest e of one launch {certificate.highest.max():.3f}: no launch gains energy")
    show("\n" + "\n".join(_table(drawn)))
    show("\nthe parameters belong to the model with these lines:\n")
    show_code(drawn.text)
    if drawn.notes:
        show("\nNotes:")
        for note in drawn.notes:
            show(f"- {note}")
    for path in drawn.files:
        show(f"written: {path}")


def _p(chance: float) -> str:
    """The result of the test as words; "" where one number was drawn for all worlds."""
    if math.isnan(chance):
        return ""
    return f", uniform (Kolmogorov-Smirnov p = {chance:.2g})"


def _table(drawn: RandomWorlds) -> list[str]:
    """Lines of a table of the pair at rest: each quantity in the model as it was, and in the worst
    of the worlds at the ends of the band of friction, in the unit that is printed.
    """
    from hcbench.sim.rest import QUANTITIES

    lines = [f"{'':<28} {'before':<8} worst world"]
    for quantity in QUANTITIES:
        was = drawn.before.record[quantity.key]
        worlds = [after.record[quantity.key] for after in drawn.after]
        # NaN is a world that does not come to rest, the worst of all; `max` may pass it over.
        worst = math.nan if any(map(math.isnan, worlds)) else max(worlds)
        title = f"{quantity.title}, {quantity.unit}"
        if not math.isnan(was) and math.isfinite(quantity.enough):
            lines.append(f"{title:<28} {quantity.shown(was):<8} {quantity.shown(worst)}")
    return lines
