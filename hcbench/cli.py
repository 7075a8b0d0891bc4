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
from typing import Any

import click

from hcbench.errors import HcbenchError, UserError

PAPER_STIFFNESS = "3.1e7 lbf/in^1.5"
CORES = os.cpu_count() or 1

as_json = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
jobs_option = click.option(
    "--jobs", "-j", type=click.IntRange(min=1), default=CORES, help="Worker processes.  [default: one a core]"
)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="hcbench", message="hcbench %(version)s")
def app() -> None:
    """Measure how physics engines really bounce, against the Hunt-Crossley law.

    Quantities take units ('0.008 s/in', '16 in/s', '1 lb'); plain numbers are SI.
    """


@app.command()
@click.option(
    "--alpha", multiple=True, required=True, help="α of e = 1 - α v, such as '0.008 s/in'. Repeatable."
)
@click.option(
    "--speed",
    multiple=True,
    required=True,
    help="Impact speeds: '16 in/s', '4, 8 in/s', '1:20 in/s'. Repeatable.",
)
@click.option("--mass", default="1 lb", show_default=True, help="Effective mass.")
@click.option("--stiffness", help=f"k of F = k x^n; plain: N/m^n.  [default for n = 1.5: {PAPER_STIFFNESS}]")
@click.option("--exponent", default="1.5", show_default=True, help="n of F = k x^n, 1 or more.")
@as_json
def reference(
    alpha: tuple[str, ...],
    speed: tuple[str, ...],
    mass: str,
    stiffness: str | None,
    exponent: str,
    as_json: bool,
) -> None:
    """Say what the law says of an impact: restitution, depth, force, duration, loss, stress."""
    import dataclasses

    import numpy as np

    from hcbench import units
    from hcbench.reference.laws import HuntCrossley
    from hcbench.reference.table import PAPER_RELATIVE_RADIUS, describe

    alphas = np.concatenate([units.parse_values(a, "alpha", "--alpha") for a in alpha])
    speeds = np.concatenate([units.parse_values(v, "speed", "--speed") for v in speed])
    units.require_positive(speeds, "speed", "--speed")
    n = units.parse(exponent, "number", "--exponent")
    if stiffness is None and n >= 1 and n != 1.5:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    m = units.parse(mass, "mass", "--mass")
    k = units.parse(stiffness or PAPER_STIFFNESS, "stiffness", "--stiffness", 1.5 if stiffness is None else n)
    units.require_positive(m, "mass", "--mass")
    rows = [
        describe(HuntCrossley(k, float(a), n), m, float(v), PAPER_RELATIVE_RADIUS)
        for a in alphas
        for v in speeds
    ]
    if as_json:
        _print_json([dataclasses.asdict(row) for row in rows])
        return
    header = ("α s/m", "v_i m/s", "e of (16)", "1 - α v_i", "x_m m", "F_max N", "t s", "ΔE J", "τ_max Pa")
    values = [
        ["-" if v is None else f"{v:.6g}" for v in dataclasses.astuple(row)[: len(header)]] for row in rows
    ]
    _print_table(header, values)
    for warning in dict.fromkeys(w for row in rows for w in row.warnings):
        print(f"warning: {warning}", file=sys.stderr)


@app.command()
@as_json
def engines(as_json: bool) -> None:
    """List the engines there are, their versions and settings, and how to install a missing one."""
    from hcbench.engines import registry
    from hcbench.errors import EngineMissing
    from hcbench.run import RECIPES

    found: list[dict[str, Any]] = []
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
@click.argument("study", default="steel-1lb")
@click.option("--out", type=click.Path(path_type=Path), help="Folder to write to.  [default: reports/NAME]")
@click.option("--quick", is_flag=True, help="Fewer speeds, phases and steps: a preview.")
@jobs_option
def report(study: str, out: Path | None, quick: bool, jobs: int) -> None:
    """Run a study and write its page, tables and figures.

    STUDY is a study.toml, its folder, or a built-in name.
    """
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
        build(results, scratch)
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
    try:
        code = app(arguments, standalone_mode=False, prog_name="hcbench")
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
