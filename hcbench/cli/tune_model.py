"""hcbench tune FILE: a pair in a user's own model, its own step, gravity and names."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from hcbench.cli.console import launch_options, print_json
from hcbench.cli.outputs import output_option
from hcbench.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from hcbench.tuning.model import TunedModel, TunedPair

_SPEEDS = (0.1, 2.0)  # m/s, the band where none is given


_REQUEST = ("key", "qpos", "state", "coming_from", "actuators")
_OF_MODELS = {*_REQUEST, "pair", "write_model"}
_OF_ENGINES = {
    "match",
    "recipe",
    "integrator",
    "scene",
    "mass",
    "stiffness",
    "exponent",
    "friction",
    "corners",
    "write_scene",
}


def tunes_models(command: Callable[..., None]) -> Callable[..., None]:
    """`tune` with a model in place of an engine's name, and the options that speak of models."""

    @wraps(command)
    def tune(pair: tuple[str, ...], write_model: Path | None, **options: Any) -> None:
        request = {name: options.pop(name) for name in _REQUEST}
        if options["max_error"] is not None and not 0 <= options["max_error"] <= 1:
            raise UserError("--max-error", f"{options['max_error']:g}", "0 ... 1, a difference in e")
        if is_model(options["engine"]):
            _require_no(_OF_ENGINES, f"given beside the model {options['engine']}", "an engine's name")
            tune_and_print(pair, write_model, request, options)
            return
        _require_no(_OF_MODELS, f"given beside the engine {options['engine']!r}", "a model's file")
        if options["timestep"] is None:
            raise UserError("--timestep", "missing", "the engine's step, such as '1 ms'")
        command(**options)

    decorated: Callable[..., None] = tune
    for option in (
        output_option("--write-model", help="Write the model with the setting in it."),
        launch_options(*_REQUEST),
        click.option(
            "--pair",
            multiple=True,
            help="Two bodies or geoms, the moving one first. Repeatable.",
        ),
    ):
        decorated = option(decorated)
    return decorated


def _require_no(names: set[str], got: str, expected: str) -> None:
    """Raises UserError for an option on the command line that would be ignored."""
    context = click.get_current_context()
    for option in context.command.params:
        given = context.get_parameter_source(option.name or "") is ParameterSource.COMMANDLINE
        if given and option.name in names:
            raise UserError(option.opts[0], got, f"it beside {expected}")


def is_model(name: str) -> bool:
    """Whether what stands where an engine's name would is a model: a file, or FILE.py:FUNCTION."""
    from hcbench.sim import registry

    if registry.base_name(name) in registry.names():  # whose version may look like a suffix
        return False
    return Path(name).suffix != "" or Path(name).is_file() or ".py:" in name


def tune_and_print(
    pairs: tuple[str, ...], write_model: Path | None, where: dict[str, Any], options: dict[str, Any]
) -> None:
    """Tune, print the lines and how wrong they are, and write the model with them."""
    from hcbench._outputs import write_output
    from hcbench.cli.tune import parse_points
    from hcbench.measuring.measurement import Wanted
    from hcbench.measuring.request import make_request
    from hcbench.tuning.model import tune_model
    from hcbench.tuning.tune import MAX_ERROR

    source, max_error = options["engine"], options["max_error"]
    if not pairs:
        raise UserError("--pair", "missing", "two bodies or geoms", f"`hcbench pairs {source}` lists them")
    points = () if options["points"] is None else parse_points(options["points"])
    alpha = None if options["alpha"] is None else options["alpha"][0]
    wanted = Wanted(alpha, options["restitution"], points, options["reading"])
    given = click.get_current_context().get_parameter_source("gravity") is ParameterSource.COMMANDLINE
    if options["speeds"] is not None:
        speeds = options["speeds"].tolist()
    else:
        speeds = [v for v, _ in points] if len(points) > 1 else _SPEEDS
    requests = [
        make_request(
            pair,
            speeds=sorted({min(speeds), max(speeds)}),
            timestep=options["timestep"],
            gravity=options["gravity"] if given else None,
            **where,
        )
        for pair in pairs
    ]
    if len({frozenset(request.pair or ()) for request in requests}) < len(requests):
        raise UserError("--pair", " and ".join(pairs), "each pair once")
    tuned = tune_model(source, requests, wanted, max_error=MAX_ERROR if max_error is None else max_error)
    if write_model is not None:
        if not tuned.written:
            got = f"a model of {tuned.pairs[0].facts.engine}"
            raise UserError("--write-model", got, "a model that is one file")
        write_output(write_model, tuned.written, "--write-model", options["force"])
    if options["as_json"]:
        print_json(_record(tuned))
    else:
        _print(tuned)
    if max_error is not None and not tuned.max_error <= max_error:
        raise LimitPassed("max-error", f"{tuned.max_error:.3g}", f"{max_error:g} or less")


def _record(tuned: TunedModel) -> dict[str, Any]:
    facts = tuned.pairs[0].facts
    return {
        "schema": 1,
        "kind": "hcbench tuned model",
        "model": facts.model,
        "engine": facts.engine,
        "timestep_s": facts.timestep,
        "gravity_m_per_s2": list(facts.gravity),
        "setting": tuned.name,
        "max_error": tuned.max_error,
        "pairs": [_pair_record(pair) for pair in tuned.pairs],
        "paste": tuned.paste,
        "notes": list(tuned.notes),
    }


def _pair_record(tuned: TunedPair) -> dict[str, Any]:
    names = ("speed_in_m_per_s", "wanted", "restitution_min", "restitution_max")
    return {
        "pair": list(tuned.facts.pair),
        "effective_mass_kg": tuned.facts.effective_mass,
        "max_error": tuned.max_error,
        "curve": [dict(zip(names, point, strict=True)) for point in tuned.points],
    }


def _print(tuned: TunedModel) -> None:
    facts = tuned.pairs[0].facts
    gravity = " ".join(f"{g + 0.0:.4g}" for g in facts.gravity)
    print(f"{facts.model}, step {facts.timestep:g} s, gravity {gravity} m/s^2")
    print(f"setting: {tuned.name}")
    for pair in tuned.pairs:
        facts = pair.facts
        print(f"\n{facts.pair[0]} on {facts.pair[1]}, effective mass {facts.effective_mass:.4g} kg")
        print(f"they meet {facts.meeting}; what moves: {facts.moved}")
        print(f"largest error of e: {pair.max_error:.2g}, in the model with it, held-out speeds, 8 phases")
        print("at touch:")
        for speed, wanted, low, high in pair.points:
            print(f"  {speed:.3g} m/s: wanted {wanted:.4f}, {low:.4f} ... {high:.4f}")
    print(f"\npaste:\n\n{tuned.paste}\n\nknow:")
    for note in tuned.notes:
        print(f"- {note}")
