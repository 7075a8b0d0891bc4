"""hcbench sweep of a user's model: rows of contact parameters, measured into a Parquet dataset."""

from __future__ import annotations

import sys
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import options, progress, show
from hcbench.system.errors import UserError
from hcbench.terms.options import LAUNCHES

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.benchmark.model_sweep import ModelSweep

_OPTIONS = (
    click.option("--pair", help="Two bodies or geoms, first the one that moves: 'foot,floor'."),
    click.option(
        "--vary",
        multiple=True,
        metavar="NAME=VALUES",
        help="Vary a parameter: 'friction=0.3:1:5', 'solref.0=-1e5:-1e3:20 log', 'timestep=1, 2 ms'."
        " Repeatable.",
    ),
    click.option(
        "--samples",
        type=click.IntRange(min=1),
        help="Draw so many rows at random, at most.  [default: every row of the grid]",
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=0,
        show_default=True,
        help="Seed of what is drawn.",
    ),
    click.option("--shard", metavar="N/OF", help="Measure a share of the parts: '3/20'."),
    click.option(
        "--part-rows",
        type=click.IntRange(min=1),
        help="Rows of parameters in a file.  [default: 100]",
    ),
    click.option("--rest", is_flag=True, help="Measure the pair at rest, too: more columns."),
    options(*LAUNCHES, "engine", "limit"),
)


def model_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give `sweep` the options that a MODEL alone has."""
    return reduce(lambda made, option: option(made), reversed(_OPTIONS), command)


def require_study(given: dict[str, Any], study: str) -> None:
    """Raise UserError where a study is swept with options of a model, or a model without --vary.

    given: options of a model, by their names.
    study: as typed.
    """
    context = click.get_current_context()
    for name in given:
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            flag = next(p.opts[0] for p in context.command.params if p.name == name)
            raise UserError(flag, "given without --vary", "--vary with a MODEL, or a study alone")
    if Path(study).suffix.lower() in (".xml", ".mjcf", ".urdf"):
        expected = "--vary with what a model's contact shall have"
        raise UserError("study", f"{study} is a model", expected, "Try --vary friction=0.3:1:5")


def sweep_a_model(
    model: str,
    out: str | None,
    jobs: int,
    scheduler: str | None,
    device: str | None,
    **given: Any,
) -> None:
    """Measure a model under the contacts that --vary asks for, and print where the rows are, and
    how many there are.

    out: folder; None: sweeps/ and the model's name.
    scheduler: address of Dask's.
    device: has to be None.
    given: other options of the command, by name, as `sweep_model` takes them.
    Raises UserError for --device, and what `sweep_model` raises.
    """
    if device is not None:
        raise UserError("--device", "given with a model", "--engine")
    with progress("opening the model"):
        from hcbench.benchmark.model_sweep import PART_ROWS, sweep_model
    shard = given.pop("shard") or "1/1"
    given["part_rows"] = given["part_rows"] or PART_ROWS
    folder = out or str(Path("sweeps") / Path(model).stem)
    with progress("rows") as tick:
        done = sweep_model(
            model,
            given.pop("pair"),
            given.pop("vary"),
            folder,
            shard=shard,
            jobs=jobs,
            scheduler=scheduler,
            progress=lambda now: tick(now.rows, now.of),
            **given,
        )
    for name in done.damaged:
        print(f"{name} was cut short: its rows are measured again", file=sys.stderr)
    share = "" if shard == "1/1" else f"shard {shard}: "
    show(f"{folder}: {share}{_text(done)}")


def _text(done: ModelSweep) -> str:
    """Number of rows, parts and points of a sweep, and the range of e, in one line."""
    count = done.parts + done.there
    parts = f"{count} part{'s' if count != 1 else ''}"
    if done.there:
        parts += f", {done.there} of them from before"
    text = f"{done.rows} rows in {parts}; {done.points} points"
    if done.lowest <= done.highest:
        text += f", e from {done.lowest:.3g} to {done.highest:.3g}"
    if done.without_e:
        text += f"; {done.without_e} without an e (see `status` and `reason`)"
    return text
