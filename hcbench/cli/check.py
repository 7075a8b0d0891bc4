"""hcbench measure, check and land: measure a user's model; fail CI when its restitution is
wrong.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import (
    as_json,
    force_option,
    jobs_option,
    model_source,
    options,
    output_option,
    print_json,
    progress,
    show,
    status,
    typed_again,
)
from hcbench.cli.help import command
from hcbench.system.errors import EngineFailed, PairUnnamed, UserError
from hcbench.system.text import joined_names, sanitized, split_names
from hcbench.terms.options import LAUNCHES, OPTIONS, renamed

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hcbench.checking.spec import CheckSpec
    from hcbench.measuring.measure import Job
    from hcbench.measuring.measurement import Measurement
    from hcbench.sim.model_under_test import CandidatePair

# Suffixes of files that make one world together.
_PARTS = (".urdf", ".sdf")
# A bounce with a lower e cannot be seen.
_NO_BOUNCE = 0.01
# α of steel.
_EXAMPLE_ALPHA = "0.3 s/m"


_PAIR = click.option("--pair", help="Two bodies or geoms, first the one that moves: 'ball,plate'.")


def _spec(
    models: tuple[str, ...], python: str | None, options: dict[str, object], required: bool = False
) -> CheckSpec:
    """The check that the options describe; the worker process of its engine is started, so that it
    imports the engine meanwhile.

    models: files as typed.
    python: "FILE:FUNCTION" in their place.
    options: others, by the names of `CheckOptions`.
    required: whether a model or a function must be given.
    Raises UserError for both, for neither if required, and for options without meaning.
    """
    from hcbench.checking.spec import CheckSpec
    from hcbench.measuring.measure import begin_measuring

    begin_measuring(models, options["engine"])
    if python is not None and models:
        raise UserError("--python", f"given with {' '.join(models)}", "one of the two")
    if python is None and not models and required:
        raise UserError("model", "none given", "a file, two URDF files, or --python FILE:FUNCTION")
    return CheckSpec.model_validate({"model": models if python is None else (python,), **options})


@command()
@_PAIR
@options(*LAUNCHES)
@model_source
@options("material", "alpha", "restitution")
@click.option("--all", "each", is_flag=True, help="Measure each pair that touches at the start.")
@options("trajectory")
@click.option(
    "--contact",
    is_flag=True,
    help="Also report what the contact means: stiffness, loads, friction, landings, steps.",
)
@output_option("--page", help="Also write a one-page report (HTML).")
@force_option
@as_json
def measure(
    models: tuple[str, ...],
    python: str | None,
    each: bool,
    trajectory: Path | None,
    contact: bool,
    page: Path | None,
    force: bool,
    as_json: bool,
    **options: object,
) -> None:
    """Measure how a pair bounces in your own model.

    Report restitution over speed, force loops, and why it differs from the target. Without --pair,
    list which parts of the model can meet, if several do.
    """
    with status("opening the model"):
        from hcbench.checking.spec import plan
        from hcbench.measuring.measure import Job, measure_job
        from hcbench.measuring.measurement import TOLERANCE
        from hcbench.measuring.rest import RestLimits
        from hcbench.measuring.text import as_record, as_text
        from hcbench.system.outputs import write_output

    if page is not None and (each or trajectory is not None):
        option = "--all" if each else "--trajectory"
        raise UserError("--page", f"given with {option}", "one --pair: a page shows one")
    if contact and trajectory is not None:
        raise UserError("--contact", "given with --trajectory", "one of the two")
    asked = plan(_spec(models, python, options, required=True))
    job = Job(
        asked.source,
        asked.engine,
        asked.request,
        asked.wanted,
        TOLERANCE,
        diagnose=True,
        rest=RestLimits(),
        contact=contact,
    )
    # One of four things: a recorded motion, all pairs that touch, one pair, or a list of pairs.
    if trajectory is not None:
        _measure_trajectory(job, trajectory, asked.limit, as_json)
        return
    if each:
        _measure_each(job, asked.limit, as_json)
        return
    try:
        with status("measuring"):
            measurement = measure_job(job, asked.limit)
    except PairUnnamed:
        # Whoever asks for more than a list has to name a pair.
        if page is not None or contact or asked.wanted is not None:
            raise
        _list_pairs(job, asked.limit, as_json, models, python, options)
        return
    if measurement.failure:
        raise EngineFailed("model", measurement.failure, "a bounce")
    if page is not None:
        from hcbench.reporting.measurement_page import measurement_page

        write_output(page, measurement_page(measurement), "--page", force)
    if as_json:
        print_json(as_record(measurement))
    else:
        show(as_text(measurement).rstrip())
        show(f"\nnext:\n  {_next_line(measurement, models, python, options)}")


def _next_line(
    measurement: Measurement, models: tuple[str, ...], python: str | None, options: Any
) -> str:
    """The command to type next: `tune` where the target is missed, else `check`.

    It repeats the options of the launches, as far as the command has them: a baseline of another
    step or pose is another gate.
    models, python: as they were typed.
    options: of `check`, by their names.
    """
    from hcbench.cli.tune import tune
    from hcbench.sim import registry
    from hcbench.sim.capabilities import TunesModels

    facts = measurement.facts
    source = _typed(models, python)
    pair = quote(options["pair"] or joined_names(facts.pair))
    targets = []
    for name in ("material", "alpha", "restitution"):
        value = options[name]
        if value is not None:
            targets.append(f"--{name} {quote(str(value))}")
    target = " ".join(targets)
    engine = registry.engine(facts.engine)
    # Settings go into files; a function's model has none.
    if _misses(measurement) and python is None and isinstance(engine, TunesModels):
        target = target or f"--alpha '{_EXAMPLE_ALPHA}'"
        taken = {parameter.name for parameter in tune.params}
        launches = typed_again(options, [name for name in LAUNCHES if name in taken])
        line = f"hcbench tune {source} --pair {pair}{launches} {target}"
        if engine.writes_models:
            line += f" --write-model tuned{Path(models[0]).suffix}"
        return line
    launches = typed_again(options, [*LAUNCHES, "engine", "limit"])
    target = target or "--write-baseline bounce.json"
    return f"hcbench check {source} --pair {pair}{launches} {target}"


def _misses(measurement: Measurement) -> bool:
    """Say whether e misses the target by more than TOLERANCE; without a target, whether nothing
    bounces or a cause was found, which a baseline would keep.
    """
    from hcbench.measuring.measurement import TOLERANCE

    if measurement.wanted is not None:
        errors = measurement.errors(measurement.wanted)
        return any(abs(error) > TOLERANCE for _speed, error in errors)
    nothing_bounces = all(impact.restitution < _NO_BOUNCE for impact in measurement.measured)
    return nothing_bounces or bool(measurement.causes)


def _measure_trajectory(job: Job, trajectory: Path, limit: float | None, as_json: bool) -> None:
    """Read the touchdowns of a recorded motion, a file, and print them.

    job: its model, engine and pair.
    limit: s, after which the worker counts as hung.
    Raises UserError for other arrays, for an engine that reads no recordings and for a model that
    cannot be opened; EngineFailed where the worker died or hung.
    """
    from hcbench.measuring.landing import touchdowns_job, touchdowns_record, touchdowns_text

    with status("reading the motion"):
        motion = touchdowns_job(job, trajectory, limit)
    if as_json:
        print_json(touchdowns_record(motion))
    else:
        show(touchdowns_text(motion).rstrip())


def _list_pairs(
    job: Job,
    limit: float | None,
    as_json: bool,
    models: tuple[str, ...],
    python: str | None,
    options: Mapping[str, object],
) -> None:
    """Print which parts of a model can meet, and the command that measures the first as it was
    asked for.

    job: its model, engine and pose.
    limit: s, after which the worker counts as hung.
    models, python: as they were typed.
    options: of the command, by their names; the printed one repeats them.
    Raises UserError for a model that cannot be opened, and EngineFailed.
    """
    from hcbench.measuring.measure import list_pairs
    from hcbench.sim.model_under_test import as_records, as_table

    with status("listing the pairs"):
        parts = list_pairs(job, limit)
    if as_json:
        print_json(as_records(parts))
        return
    show(as_table(parts).rstrip())
    if parts:
        pair = quote(_to_launch(parts).pair)
        launches = typed_again(options, [*LAUNCHES, "engine", "limit"])
        show(f"\nnext:\n  hcbench measure {_typed(models, python)} --pair {pair}{launches}")


def _to_launch(parts: Sequence[CandidatePair]) -> CandidatePair:
    """Choose the pair to launch first: one that touches, else one with a part of the world, which a
    body can fall on; two legs may only slide past each other.

    parts: one or more, those that touch first. Parts of one body never approach each other, and
    have no effective mass.
    """
    launched = [each for each in parts if math.isfinite(each.effective_mass)]
    if not launched:
        return parts[0]
    first = launched[0]
    if first.touching or first.touching_in:
        return first
    return next((each for each in launched if "world" in each.bodies), first)


def _typed(models: tuple[str, ...], python: str | None) -> str:
    """A model as it was typed: its files, or --python."""
    return " ".join(map(quote, models)) if python is None else f"--python {quote(python)}"


def _measure_each(job: Job, limit: float | None, as_json: bool) -> None:
    """Measure and print every pair that touches at the start; pairs that cannot be measured are
    reported and skipped.

    limit: s, after which a worker counts as hung.
    Raises UserError where nothing touches, and EngineFailed.
    """
    from hcbench.measuring.measure import list_pairs, measure_job
    from hcbench.measuring.text import as_record, as_text

    with status("listing the pairs"):
        pairs = [pair for pair in list_pairs(job, limit) if pair.touching]
    if not pairs:
        advice = (
            "Without --all it lists what can meet; name one by --pair, or start from another --key"
        )
        raise UserError("all", "no two parts touch at the start", "a pose in which some do", advice)
    records: list[object] = []
    for pair in pairs:
        one, two = split_names(pair.pair)
        request = dataclasses.replace(job.request, pair=(one, two))
        try:
            with status(f"measuring {sanitized(pair.pair)}"):
                measurement = measure_job(dataclasses.replace(job, request=request), limit)
        except UserError as error:
            records.append({"pair": [one, two], "refused": str(error)})
            lines = f"{pair.pair}: not measured: {error}\n"
        else:
            records.append(as_record(measurement))
            lines = as_text(measurement)
        if not as_json:
            show(lines)
    if as_json:
        print_json(records)


@command(hidden=True)
@options("key", "qpos", "state", "package")
@model_source
@as_json
def pairs(models: tuple[str, ...], python: str | None, as_json: bool, **options: object) -> None:
    """Old name of `hcbench measure` without --pair, which this version still takes."""
    from hcbench.checking.spec import plan
    from hcbench.measuring.measure import Job
    from hcbench.measuring.measurement import TOLERANCE

    print(f"hcbench: {renamed('pairs', 'measure, without --pair')}", file=sys.stderr)
    asked = plan(_spec(models, python, options, required=True))
    job = Job(asked.source, asked.engine, asked.request, None, TOLERANCE, diagnose=False)
    _list_pairs(job, asked.limit, as_json, models, python, options)


@command()
@_PAIR
@model_source
@options(*(name for name in OPTIONS if name not in ("engine", "limit")))
@click.option("--measure-only", is_flag=True, help="Measure without a target; nothing can fail.")
@output_option("--write-baseline", help="Write the result as a baseline for later versions.")
@output_option("--junit", help="Write JUnit XML.")
@output_option("--markdown", help="Write a Markdown summary, for a CI step.")
@output_option("--png", help="Write the error curve.")
@force_option
@as_json
@jobs_option
def check(
    models: tuple[str, ...],
    python: str | None,
    write_baseline: Path | None,
    junit: Path | None,
    markdown: Path | None,
    png: Path | None,
    force: bool,
    measure_only: bool,
    as_json: bool,
    jobs: int,
    **options: object,
) -> int:
    """Fail when restitution is wrong, for your CI.

    MODELS are a model, a study, or a TOML file with a [tool.hcbench] table.
    Exit 0 within limits, 1 a limit exceeded, 2 a mistake, 3 could not run.
    """
    from hcbench.checking.command import Outputs, run_spec
    from hcbench.checking.text import as_record_of, as_text

    outputs = Outputs(junit, markdown, png, write_baseline, force)
    with progress("checks") as tick:
        report = run_spec(_spec(models, python, options), outputs, jobs, tick, measure_only)
    if as_json:
        print_json(as_record_of(report))
    else:
        show(as_text(report).rstrip())
        if write_baseline is not None:
            print(f"written: {write_baseline}: compare later versions with --baseline")
    return report.exit_code


# hcbench land: drop a robot on its floor under its controller, and report how it lands.


@command()
@model_source
@options(
    *("heights", "tilt", "controller", "key", "qpos", "state", "timestep", "gravity", "package"),
    "move",
)
@output_option("--page", help="Also write a one-page report with the force over time (HTML).")
@force_option
@as_json
def land(
    models: tuple[str, ...],
    python: str | None,
    heights: str | None,
    tilt: str | None,
    controller: str | None,
    engine: str | None,
    limit: str | None,
    page: Path | None,
    force: bool,
    as_json: bool,
    **pose: object,
) -> None:
    """Drop a robot on its floor, and measure how it lands.

    Report e of its centre of mass, the peak force, and what each foot does. Of two MODELS, such as
    before and after `hcbench tune`, the drops stand side by side; two URDFs are a robot and its floor.
    """
    from hcbench.measuring.landing import as_record, as_text, land_job, make_drops
    from hcbench.measuring.measure import Job, begin_measuring
    from hcbench.measuring.measurement import TOLERANCE
    from hcbench.measuring.request import make_request, read_limit
    from hcbench.system.outputs import write_output

    begin_measuring(models, engine)
    if not models and python is None:
        raise UserError("model", "none given", "a file with a robot, or --python FILE:FUNCTION")
    sources: list[str | tuple[str, ...]] = [*models]
    if len(models) > 1 and all(Path(model).suffix.lower() in _PARTS for model in models):
        # A robot and its floor, which make one world.
        sources = [models]
    if python is not None:
        sources.append(python)
    given = {"heights": heights, "tilt": tilt, "controller": controller}
    drops = make_drops(**{name: value for name, value in given.items() if value is not None})
    request = make_request(None, **pose)  # type: ignore[arg-type]
    seconds = read_limit(limit)
    robots = []
    with status("dropping the robot"):
        for source in sources:
            job = Job(source, engine, request, None, TOLERANCE, diagnose=False)
            robots.append(land_job(job, drops, seconds))
    if page is not None:
        from hcbench.reporting.measurement_page import landing_page

        write_output(page, landing_page(robots), "--page", force)
    if not as_json:
        show(as_text(robots).rstrip())
    elif len(robots) == 1:
        print_json(as_record(robots[0]))
    else:
        print_json(list(map(as_record, robots)))
