"""hcbench fit: measured bounces in, α with its uncertainty and the lines to type next out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import (
    EXPONENT,
    PathType,
    QuantityType,
    UncertainType,
    as_json,
    force_option,
    output_option,
    print_json,
    show,
    status,
)
from hcbench.cli.help import Command, command
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.fitting.replay import Replay
    from hcbench.fitting.result import FitResult
    from hcbench.fitting.setup import MeasurementSetup

_LAWS = ("auto", "hunt-crossley", "constant", "viscoelastic", "plastic")


# Key of the words that the user typed after `hcbench`.
_TYPED = "hcbench.fit"


class _FilesAfterAgainst(Command):
    """Lets --against take all files that follow it, as a shell expands `b*.wav`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read `--against b1 b2` as `--against b1 --against b2`; what was typed is kept, for the
        next lines.

        args: words after "fit".
        Returns those that are left.
        """
        ctx.meta[_TYPED] = ("fit", *args)
        spread: list[str] = []
        # Whether the words are files of --against, and whether the last --against has none yet.
        is_after_against = False
        lacks_file = False
        # The "--" at the end is a mark, an option like any other, and is taken out again.
        for word in [*args, "--"]:
            # A "-" alone is a file: standard input.
            is_option = re.match("-.", word) is not None
            if is_option and lacks_file:
                # Click says what it lacks.
                spread.append("--against")
                lacks_file = False
            if word == "--against":
                is_after_against = True
                lacks_file = True
                continue
            if is_option:
                is_after_against = False
            if is_after_against:
                spread.append("--against")
                lacks_file = False
            spread.append(word)
        spread.pop()
        return super().parse_args(ctx, spread)


@command(cls=_FilesAfterAgainst)
@click.argument("files", nargs=-1, type=PathType(path_type=Path, allow_dash=True))
@click.option(
    "--as",
    "kind",
    help="Kind of data, in place of what the header says: times, heights, pairs, ...",
)
@click.option("--height", type=UncertainType("length"), help="Height of release: '30 +- 0.1 cm'.")
@click.option("--gravity", help="g, such as '9.81 m/s^2'.  [default: 9.80665 +- 0.02 m/s^2]")
@click.option(
    "--mass", type=UncertainType("mass"), help="Mass of the ball, for air drag or for forces."
)
@click.option(
    "--diameter", type=UncertainType("length"), help="Diameter of the ball, for air drag."
)
@click.option(
    "--drag-coefficient",
    type=UncertainType("number"),
    help="Drag coefficient.  [default: 0.47 +- 0.05, a sphere]",
)
@click.option(
    "--contact-time",
    type=UncertainType("timestep"),
    help="Duration of the first impact.  [default: 0]",
)
@click.option(
    "--timing",
    type=QuantityType("timestep", positive=True),
    help="Standard uncertainty of a time reading, if you know it.",
)
@click.option("--speed", type=UncertainType("speed"), help="Approach speed, for forces over time.")
@click.option("--exponent", type=EXPONENT, help="n of the law, for forces.")
@click.option("--touches", help="Touches of a recording to use: '2:14', train 'B', or 'B2:14'.")
@click.option(
    "--against",
    multiple=True,
    type=PathType(path_type=Path, allow_dash=True),
    help="Files of another material to compare.",
)
@click.option(
    "--from", "begin", type=QuantityType("time"), help="Begin of the part to read: '12 s'."
)
@click.option(
    "--to", "end", type=QuantityType("time", positive=True), help="End of the part to read: '18 s'."
)
@click.option("--engine", help="Engine in which to make a scene that bounces as the recording did.")
@click.option(
    "--timestep", type=QuantityType("timestep", positive=True), help="Step of that scene."
)
@output_option("--write-scene", help="Write that scene.")
@click.option("--law", type=click.Choice(_LAWS), default="auto", show_default=True)
@output_option("--page", help="Also write a one-page report (HTML).")
@output_option("--picture", help="Also write e over speed with its 95 % band (PNG or SVG).")
@output_option("--write-points", help="Write e over speed, for --points of `tune` and `check`.")
@output_option(
    "--write-material",
    help="Write the pair for `--material`; the file's name is the pair's: rubber-on-concrete.json.",
)
@force_option
@as_json
def fit(
    files: tuple[Path, ...],
    kind: str | None,
    touches: str | None,
    against: tuple[Path, ...],
    begin: float | None,
    end: float | None,
    engine: str | None,
    timestep: float | None,
    write_scene: Path | None,
    law: str,
    page: Path | None,
    picture: Path | None,
    write_points: Path | None,
    write_material: Path | None,
    force: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Find α of your material from a measurement of bounces.

    FILES hold what was measured, with units in their headers: times of impacts (time [s]),
    heights of bounces (height [cm]), pairs (speed [m/s],restitution or v_in [m/s],v_out
    [m/s]); a sound recording (.wav); a track (time [s],height [m], or an export of Tracker or
    phyphox); or forces: time [ms],force [N], or penetration [um],rate [m/s],force [N].
    Several files of bounces share one α.
    """
    with status("starting"):
        from hcbench.fitting.ask import fit_files, read_excerpt
        from hcbench.fitting.setup import read_setup

    _require_together(files, kind, engine, timestep, write_scene)
    setup = read_setup(**options)
    # A file of forces is fitted and printed here, and takes none of the options of bounces.
    if len(files) == 1 and _fit_force(
        files[0],
        kind,
        setup,
        as_json,
        page=page,
        picture=picture,
        write_points=write_points,
        write_material=write_material,
        engine=engine,
        against=against or None,
    ):
        return
    part = read_excerpt(begin, end, touches)
    with status("fitting"):
        result = fit_files(files, against, law, kind, setup, part)
    with status("tuning a scene"):
        scene = None if engine is None or timestep is None else result.scene(engine, timestep)
    lines = []
    # JSON has no lines to type next; a page has.
    if not as_json or page is not None:
        lines = _next(result, engine, scene, write_scene)
    _write(
        result,
        scene,
        lines,
        force,
        page=page,
        picture=picture,
        write_points=write_points,
        write_material=write_material,
        write_scene=write_scene,
    )
    if as_json:
        _print_json(result, scene, lines)
    else:
        _print(result, scene, lines)


def _require_together(
    files: tuple[Path, ...],
    kind: str | None,
    engine: str | None,
    timestep: float | None,
    write_scene: Path | None,
) -> None:
    """Raise UserError without files, for an unknown kind of data, and where only one of --engine
    and --timestep is given, or neither for a scene to write.
    """
    from hcbench.fitting.read import KINDS

    if not files:
        raise UserError(
            "files", "none given", "a file of measured bounces", "`hcbench fit --help` shows what"
        )
    if kind is not None and kind not in KINDS:
        raise UserError("--as", repr(kind), f"one of {', '.join(KINDS)}")
    if (engine is None) != (timestep is None) or (write_scene is not None and engine is None):
        raise UserError("--engine", "given in part", "--engine and --timestep, for a scene")


def _fit_force(
    file: Path, kind: str | None, setup: MeasurementSetup, as_json: bool, **of_bounces: object
) -> bool:
    """Fit a file of contact forces and print the result; return False, and print nothing, where
    the file has none.

    kind: of data, in place of what the header says.
    of_bounces: options that apply to bounces, by name.
    Raises UserError for one of these that is given for forces, and for a file that cannot be read.
    """
    from hcbench.fitting import force as forces_of
    from hcbench.fitting.read import read_force
    from hcbench.fitting.result import with_uncertainty

    forces = read_force(file, setup, kind)
    if forces is None:
        return False
    for name, value in of_bounces.items():
        if value is not None:
            raise UserError(f"--{name.replace('_', '-')}", "given for forces", "bounces")
    if as_json:
        print_json(forces_of.as_record(forces))
    else:
        show(forces_of.as_text(forces, with_uncertainty, _engine()).rstrip())
    return True


def _next(
    result: FitResult, engine: str | None, scene: Replay | None, write_scene: Path | None
) -> list[str]:
    """Commands to type next, after a fit.

    engine: that the user named; None: the installed one with the most recipes.
    scene: one that bounces as the recording did, None without.
    write_scene: where it is written, None if nowhere.
    """
    from hcbench.fitting.next_lines import next_lines

    written = None if scene is None or write_scene is None else (scene, str(write_scene))
    return next_lines(result, engine or _engine(), _typed(), written)


def _typed() -> tuple[str, ...]:
    """The words after `hcbench`."""
    return tuple(click.get_current_context().meta[_TYPED])


def _print(result: FitResult, scene: Replay | None, lines: list[str]) -> None:
    """Print the fit, the comparison with another material, the scene, and lines to type next."""
    from hcbench.fitting.replay import replay_text
    from hcbench.fitting.result import as_text, comparison_text

    show(as_text(result).rstrip())
    if result.against is not None:
        show(comparison_text(result.against).rstrip("\n"))
    if scene is not None:
        show(replay_text(scene).rstrip("\n"))
    show("\n".join(["", *lines]))


def _print_json(result: FitResult, scene: Replay | None, _: list[str]) -> None:
    """Print the fit as JSON, with the scene, if one was made."""
    from hcbench.fitting.replay import replay_record
    from hcbench.fitting.result import as_record

    print_json(as_record(result) | ({} if scene is None else {"scene": replay_record(scene)}))


def _write(
    result: FitResult, scene: Replay | None, lines: list[str], force: bool, **files: Path | None
) -> None:
    """Write the files that the options ask for: page, picture, points, material and scene.

    lines: to type next, for the page.
    force: whether to replace files that hcbench did not write.
    files: paths by the option's name, None for one that is not given.
    Raises UserError and OutputError in the option's name.
    """
    from hcbench.fitting.result import points_text
    from hcbench.system.outputs import write_output

    if (page := files["page"]) is not None:
        from hcbench.reporting.fit_page import fit_page

        write_output(page, fit_page(result, lines, _typed(), scene), "--page", force)
    if (picture := files["picture"]) is not None:
        from hcbench.reporting.fit_page import curve_picture

        write_output(picture, curve_picture(result, picture.suffix), "--picture", force)
    if (points := files["write_points"]) is not None:
        write_output(points, points_text(result), "--write-points", force)
    if (path := files["write_material"]) is not None:
        from hcbench.catalogue.find import as_record
        from hcbench.system.files import json_text

        pair = result.material(path.stem.replace("-", " ").replace("_", " "))
        write_output(path, json_text(as_record(pair)), "--write-material", force)
    if scene is not None and (script := files["write_scene"]) is not None:
        write_output(script, scene.script, "--write-scene", force)


def _engine() -> str:
    """The engine for the lines to type next: of those that can run, the
    one with the most recipes; or "".
    """
    from hcbench.sim import registry

    there = [name for name in registry.names() if registry.is_there(name)]
    return max(there, key=lambda name: len(registry.recipes(name)), default="")
