"""The command line: the only place that prints or exits.

Exit codes: 0 done, 1 a limit was passed, 2 a mistake in what was given, 3 could not run, 130 interrupted.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from hcbench.errors import HcbenchError, UserError

app = typer.Typer(
    name="hcbench",
    help="Measures how physics engines really bounce: restitution curves and force loops against the "
    "Hunt-Crossley law. Quantities take units ('0.008 s/in', '16 in/s', '1 lb'); plain numbers are SI.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

CORES = os.cpu_count() or 1

Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
Jobs = Annotated[
    int, typer.Option("--jobs", "-j", min=1, help="Worker processes.", show_default="one a core")
]


@app.callback()
def _options() -> None:
    """Several commands, even while there is one."""


@app.command()
def reference(
    alpha: Annotated[
        list[str], typer.Option(help="α of e = 1 - α v, such as '0.008 s/in'. Repeatable; lists.")
    ],
    speed: Annotated[
        list[str], typer.Option(help="Impact speeds: '16 in/s', '4, 8 in/s', '1:20 in/s'. Repeatable.")
    ],
    mass: Annotated[str, typer.Option(help="Effective mass.")] = "1 lb",
    stiffness: Annotated[str, typer.Option(help="k of F = k x^n; without units N/m^n.")] = "3.1e7 lbf/in^1.5",
    exponent: Annotated[float, typer.Option(help="n of F = k x^n, 1 or more.")] = 1.5,
    as_json: Json = False,
) -> None:
    """What the law says of an impact: restitution, depth, force, duration, loss, stress."""
    import dataclasses

    import numpy as np

    from hcbench import units
    from hcbench.reference.laws import HuntCrossley
    from hcbench.reference.table import PAPER_RELATIVE_RADIUS, describe

    alphas = np.concatenate([units.parse_values(a, "alpha", "--alpha") for a in alpha])
    speeds = np.concatenate([units.parse_values(v, "speed", "--speed") for v in speed])
    units.require_positive(speeds, "speed", "--speed")
    m, k = units.parse(mass, "mass", "--mass"), units.parse(stiffness, "stiffness", "--stiffness", exponent)
    units.require_positive(m, "mass", "--mass")
    rows = [
        describe(HuntCrossley(k, float(a), exponent), m, float(v), PAPER_RELATIVE_RADIUS)
        for a in alphas
        for v in speeds
    ]
    if as_json:
        _print_json([dataclasses.asdict(row) for row in rows])
        return
    header = ("α s/m", "v_i m/s", "e of (16)", "1 - α v_i", "x_m m", "F_max N", "t s", "ΔE J", "τ_max Pa")
    values = [[f"{v:.6g}" for v in dataclasses.astuple(row)[: len(header)]] for row in rows]
    _print_table(header, values)
    for warning in dict.fromkeys(w for row in rows for w in row.warnings):
        print(f"warning: {warning}", file=sys.stderr)


@app.command()
def engines(as_json: Json = False) -> None:
    """The engines there are, their versions and settings, and how to install a missing one."""
    from hcbench.engines import registry
    from hcbench.errors import EngineMissing
    from hcbench.run import RECIPES

    found = []
    for name in registry.names():
        engine = registry.engine(name)
        try:
            version, missing = engine.version(), ""
        except EngineMissing:
            version, missing = "", engine.install
        recipes = [registry.load(RECIPES, r) for r in registry.names(RECIPES) if r.startswith(f"{name}.")]
        settings = {recipe.name: recipe.summary for recipe in recipes}
        found.append({"name": name, "version": version, "install": missing, "settings": settings})
    if as_json:
        _print_json(found)
        return
    for item in found:
        state = item["version"] or f"not installed: {item['install']}"
        print(f"{item['name']}  {state}")
        for setting, summary in item["settings"].items():
            print(f"  {setting:<16} {summary}")


@app.command()
def report(
    study: Annotated[str, typer.Argument(help="A study.toml, its folder, or a built-in name.")] = "steel-1lb",
    out: Annotated[Path | None, typer.Option(help="Folder to write to.", show_default="reports/NAME")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Fewer speeds, phases and steps: a preview.")
    ] = False,
    jobs: Jobs = CORES,
) -> None:
    """Run a study and write its page, tables and figures."""
    from hcbench.report.build import build
    from hcbench.results import filled_folder
    from hcbench.run import run_study
    from hcbench.study import find_study, load_study

    path = find_study(study)
    plan = load_study(path).quick() if quick else load_study(path)
    folder = out or Path("reports") / (path.parent.name if path.name == "study.toml" else path.stem)
    with filled_folder(folder) as scratch:
        with _progress("impacts") as tick:
            results = run_study(plan, jobs, tick)
        with _progress("figures") as tick:
            build(results, scratch, jobs, tick)
    print(folder / "index.html")


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr that stays away where nobody looks; hands out `tick(done, total)`."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _print_json(content: object) -> None:
    print(json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False))


def _print_table(header: tuple[str, ...], rows: list[list[str]]) -> None:
    widths = [max(len(line[i]) for line in [list(header), *rows]) for i in range(len(header))]
    for line in [list(header), *rows]:
        print("  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))


def main() -> None:
    """Run the command line; every way out is an exit code and at most one line."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Run one command and return its exit code; nothing but Ctrl-C's own signal escapes."""
    import click

    try:
        code = app(arguments, standalone_mode=False)
        sys.stdout.flush()
    except HcbenchError as error:
        return _fail(error.exit_code, str(error))
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message())
        return UserError.exit_code
    except click.ClickException as error:
        return _fail(UserError.exit_code, error.format_message() + _hint(error))
    except (KeyboardInterrupt, click.exceptions.Abort):
        return _fail(130, "interrupted; nothing was left half-written")
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if os.environ.get("HCBENCH_DEBUG"):
            raise
        detail = f"{type(error).__name__}: {error}".splitlines()[0]
        return _fail(3, f"unexpected {detail}. Set HCBENCH_DEBUG=1 for the traceback and report it")
    return code if isinstance(code, int) else 0


def _hint(error: Exception) -> str:
    context = getattr(error, "ctx", None)
    return f" Try `{context.command_path} --help`." if context else ""


def _fail(code: int, message: str) -> int:
    print(f"hcbench: {message}", file=sys.stderr)
    return code
