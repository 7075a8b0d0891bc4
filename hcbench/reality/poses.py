"""A user's own tosses: impacts read from poses, and how far each engine's settings are from them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from xml.etree import ElementTree

import numpy as np

from hcbench.fitting.read import LEAST_PAIRS
from hcbench.reality.data_sets import (
    Cell,
    Tick,
    best_values,
    outcome_of,
    run_each,
    search,
    settings_of,
)
from hcbench.reality.impacts import ImpactRead, read_impacts
from hcbench.reality.motion import LEAST_FLIGHT, Tosses, motion
from hcbench.reality.study import SettingScore, of_cell
from hcbench.sim.toss import Body
from hcbench.system.errors import UserError
from hcbench.system.files import read_text
from hcbench.terms.bounds import positive
from hcbench.terms.impact import Floats
from hcbench.workers import WorkerPool

# File of the good impacts, for `hcbench fit`.
PAIRS = "pairs.csv"
COLUMNS = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
# Frames of a file, at least.
_LEAST = 12
# kg/m³: MJCF's own default.
_DENSITY = 1000.0
# The length of a quaternion may differ from 1 by so much.
_UNIT = 0.02


@dataclass(frozen=True, slots=True)
class OwnCell(Cell):
    """A setting on a user's tosses, which are judged as the cube's are."""

    tosses: Tosses | None = None

    @property
    def cases(self) -> Tosses:
        """The tosses."""
        assert self.tosses is not None
        return self.tosses


@dataclass(frozen=True, slots=True)
class Own:
    """Results of a user's tosses: impacts, and a score and the parameters of each setting."""

    tosses: Tosses
    impacts: Sequence[ImpactRead]
    scores: Sequence[tuple[SettingScore, dict[str, float]]]


def box(size: Sequence[float], mass: float, inertia: Sequence[float] = ()) -> Body:
    """Build a box from its three edges and its mass.

    size: edges, m.
    mass: kg.
    inertia: three about its axes, kg m², or one for all; that of a solid box where none is given.
    Raises UserError for another number of edges or moments, and unless all numbers are above 0.
    """
    if len(size) != 3:
        raise UserError("--size", f"{len(size)} numbers", "three edges, such as '0.1 0.1 0.1' (m)")
    for edge in size:
        positive("--size", edge, "m")
    positive("--mass", mass, "kg")
    half = (size[0] / 2.0, size[1] / 2.0, size[2] / 2.0)
    for moment in inertia:
        positive("--inertia", moment, "kg m²")
    if inertia:
        if len(inertia) not in (1, 3):
            raise UserError("--inertia", f"{len(inertia)} numbers", "one or three, kg m²")
        if len(inertia) == 1:
            return Body("box", half, mass, (inertia[0], inertia[0], inertia[0]))
        return Body("box", half, mass, (inertia[0], inertia[1], inertia[2]))
    squares = np.array(size) ** 2
    x, y, z = (float(mass * (squares.sum() - square) / 12.0) for square in squares)
    return Body("box", half, mass, (x, y, z))


def box_of(path: Path) -> Body:
    """The first box of an MJCF file: sizes in m, mass in kg, inertia in kg m².

    A box without a mass has MJCF's density.
    Raises UserError for a file that cannot be read, has no box, or has numbers that no box has.
    """
    try:
        root = ElementTree.fromstring(read_text(path))
        owner, geom = _first_box(root)
        # MJCF has half of each side.
        size = [2.0 * float(part) for part in geom.get("size", "").split()]
        inertial = owner.find("inertial")
        if inertial is not None:
            moments = list(map(float, inertial.get("diaginertia", "").split()))
            return box(size, float(inertial.get("mass", "")), moments)
        density = float(geom.get("density", _DENSITY))
        return box(size, float(geom.get("mass", density * float(np.prod(size)))))
    except (OSError, UnicodeDecodeError, ElementTree.ParseError, ValueError) as error:
        raise UserError("--model", f"{path}: {error}", "MJCF with a box") from None


def _first_box(root: ElementTree.Element) -> tuple[ElementTree.Element, ElementTree.Element]:
    """The first body with a box, and its box. Raises ValueError without one."""
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            if geom.get("type") == "box":
                return body, geom
    raise ValueError("no body with a geom of type box")


def read(paths: Sequence[Path], body: Body) -> Tosses:
    """A toss of each CSV file, a row for each frame.

    paths: files with COLUMNS: time in s, place in m, and quaternion, w first.
    body: that was tossed.
    Raises UserError for a file that cannot be read, other columns, times that do not rise,
    quaternions that are not rotations, and fewer than five frames of flight before the first touch.
    """
    motions = []
    for number, path in enumerate(paths):
        rows = _rows(path)
        time = rows[:, 0]
        place = rows[:, 1:4]
        turn = rows[:, 4:]
        length = np.linalg.norm(turn, axis=1, keepdims=True)
        if (np.abs(length - 1.0) > _UNIT).any():
            raise UserError(
                f"{path}", "a quaternion that is not a rotation", "qw, qx, qy, qz of length 1"
            )
        if (np.diff(time) <= 0.0).any():
            raise UserError(
                f"{path}", "times that do not increase", "seconds, a row for each frame"
            )
        toss = motion(number, body, time, place, turn / length)
        if toss.flight < LEAST_FLIGHT:
            got = f"{toss.flight} frames before the first touch"
            raise UserError(
                f"{path}", got, f"{LEAST_FLIGHT} or more of free flight, at 100 Hz or faster"
            )
        motions.append(toss)
    return Tosses(body, motions)


def _rows(path: Path) -> Floats:
    """The frames of a CSV file, in COLUMNS, shape (n, 8): time, s, position, m, and quaternion.

    Raises UserError for a file that cannot be read, lacks a column, has text or no finite number in
    one, or has fewer than _LEAST frames.
    """
    try:
        frames = csv.DictReader(read_text(path, "utf-8-sig").splitlines(), skipinitialspace=True)
        numbers = []
        for frame in frames:
            row = [float(frame[name]) for name in COLUMNS]
            numbers.append(row)
    except (OSError, UnicodeDecodeError) as error:
        raise UserError("--poses", f"{path}: {error}", "a CSV file") from None
    except (KeyError, TypeError, ValueError):
        raise UserError(
            "--poses", f"{path} has no {', '.join(COLUMNS)}", "these columns, s and m"
        ) from None
    rows = np.array(numbers)
    if len(rows) < _LEAST or not np.isfinite(rows).all():
        raise UserError(
            "--poses", f"{path} has {len(rows)} frames", f"{_LEAST} or more, all finite"
        )
    return rows


def judge(
    tosses: Tosses, pool: WorkerPool, identify: bool = False, tick: Tick | None = None
) -> Own:
    """Read the impacts, and run each setting with the e and the friction that were read.

    identify: search the parameters of all settings on the tosses themselves.
    Settings with other parameters are left out unless they are searched.
    tick: called with (cells done, cells in all), for the search and again for the runs.

    Engines that are not installed are left out: without any there are no scores. Raises what an
    engine raises.
    """
    impacts = read_impacts(tosses.body, tosses.motions)
    known = read_values(impacts)
    cells = []
    for engine, setting in settings_of("cube"):
        if identify or all(parameter.name in known for parameter in setting.parameters):
            start = tuple(known.get(p.name, p.starts[0]) for p in setting.parameters)
            cells.append(OwnCell("cube", engine, setting.key, start, (), tosses=tosses))
    if identify:
        searched = [cell for cell in cells if cell.values]
        best = {}
        for cell, tries in zip(searched, run_each(pool, search, searched, tick), strict=True):
            best[cell.key] = best_values(cell, tries)
        cells = [replace(cell, values=best.get(cell.key, ())) for cell in cells]
    scores = []
    for cell, outcome in zip(cells, run_each(pool, outcome_of, cells, tick), strict=True):
        names = [parameter.name for parameter in cell.contact.parameters]
        values = dict(zip(names, cell.values, strict=True))
        scores.append((of_cell(cell, outcome), values))
    return Own(tosses, impacts, scores)


def read_values(impacts: Sequence[ImpactRead]) -> dict[str, float]:
    """Median e, within 0 to 1, and friction, 0 or more, of the good impacts, by the names of an
    engine's parameters; empty if no impact is good.
    """
    sure = [(impact.e, impact.friction) for impact in impacts if impact.good]
    if not sure:
        return {}
    e, friction = np.median(sure, axis=0).tolist()
    return {"restitution": min(max(e, 0.0), 1.0), "friction": max(friction, 0.0)}


def text(own: Own, folder: Path) -> Iterator[str]:
    """Lines to print: each impact that was read, the mean error of each setting in per cent of the
    body's width, and the commands to type next.

    folder: where `page.build_own` wrote the tables.
    """
    yield f"{len(own.tosses.motions)} tosses, {len(own.impacts)} impacts read"
    if own.impacts:
        yield f"{'time, s':>9} {'speed, m/s':>11} {'e':>15} {'friction':>15} {'contact, ms':>12}"
    for impact in own.impacts:
        e = f"{impact.e:.3f} ± {impact.u_e:.3f}"
        friction = f"{impact.friction:.3f} ± {impact.u_friction:.3f}"
        contact = f"{1e3 * impact.duration:12.1f}"
        note = ""
        if not impact.good:
            note = "  not sure, or more than one corner"
        yield f"{impact.time:9.3f} {impact.speed_in:11.3f} {e:>15} {friction:>15} {contact}{note}"
    yield ""
    yield f"{'engine':<10} {'setting':<34} {'error, % of a width':>20} {'rotation, °':>12}"
    for score, values in sorted(own.scores, key=lambda pair: pair[0].error):
        name = score.setting
        if score.cone:
            name += f", {score.cone}"
        given = ", ".join(f"{parameter} {value:.3g}" for parameter, value in values.items())
        rotation = score.rotation_deg or 0.0
        yield f"{score.engine:<10} {name:<34} {score.error:20.1f} {rotation:12.1f}  {given}"
    known = read_values(own.impacts)
    if known:
        target = f"--restitution {known['restitution']:.3g} --friction {known['friction']:.3g}"
        yield ""
        yield "next:"
        # Of fewer impacts `hcbench fit` makes no law.
        if sum(impact.good for impact in own.impacts) >= LEAST_PAIRS:
            yield f"  hcbench fit {quote(str(folder / PAIRS))}"
        yield f"  hcbench tune MODEL --pair BODY,FLOOR {target}"
