"""Writes contact rows into a model of the user's, as <pair> elements."""

from __future__ import annotations

import html
import itertools
import math
import os
import re
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name, can_meet, explicit_pairs, response
from hcbench.engines.mujoco.model.find_pair import contact_in_force
from hcbench.engines.mujoco.model.open import compiled
from hcbench.engines.mujoco.recipes.common import SPRING_SOLIMP
from hcbench.engines.mujoco.recipes.compliant import (
    IMPRATIO,
    half_period_steps,
    spring_and_damper_rows,
)
from hcbench.engines.mujoco.scene.elements import quoted
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.rows import (
    MAX_IMPEDANCE,
    MIN_IMPEDANCE,
    STIFF_SOLIMP,
    ConstraintRow,
)
from hcbench.sim.model_under_test import Texts
from hcbench.system.errors import UserError
from hcbench.system.text import gravity_text, time_step

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.model.pair import ContactPair
    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.engines.mujoco.scene.rows import Solimp
    from hcbench.sim.model_under_test import Output, Request, Vector

# Load on a contact of a user's model, and rows for it that need no search in the model.

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.laws.restitution import RestitutionCurve

    Band = tuple[float, float]

Rows = tuple[ConstraintRow, ...]
# Pairs of geoms that are written, at most.
_PAIRS_MAX = 200
# Name of the row that turns a body back in one step.
ONE_STEP = "one step"
# Steps of a spring and damper in contact under RK4.
_RK4_STEPS = 8
# K h² of a contact that stops a body: it pushes out what is inside, and no more.
_STOP = 0.005
# Time constants of critically damped contacts that stop a body, in steps, and their impedance.
_GENTLE_STEPS = (5, 10, 20)
_GENTLE_SOLIMP = (0.99, 0.99, 1e-3, 0.5, 2.0)
# A row of at most this impedance is a spring that MuJoCo scales by its estimate of the mass.
SOFT_IMPEDANCE = 0.01
# A target e below this is met by a stop.
NO_BOUNCE = 0.02
# No spring and damper is made for a smaller e.
_LEAST_E = 1e-3


@dataclass(frozen=True, slots=True)
class Load:
    """The load on a contact, and the integrator that steps it.

    strength: what all its points together do, over what one does on a free ball: MuJoCo scales a
    soft row by an estimate of the mass (body_invweight0), at each point.
    points: their number.
    gravity: acceleration of the approach, m/s².
    timestep: s.
    rk4: true under the integrator RK4.
    slides: whether the contact has friction.
    """

    strength: float
    points: int
    gravity: float
    timestep: float
    rk4: bool
    slides: bool

    @classmethod
    def at_touch(cls, place: PairAtTouch, timestep: float, rk4: bool, slides: bool) -> Load:
        """Read the load on the contact of a pair that just touches.

        place: the pair at touch.
        timestep: s.
        rk4: the integrator is RK4.
        slides: the contact has friction.
        """
        mobility = estimated_mobility(
            place.pair.model, place.pair.first.body, place.pair.second.body
        )
        points = len(place.contact.rows)
        strength = points / (mobility * place.effective_mass) if mobility > 0 else 1.0
        return cls(
            strength=strength,
            points=points,
            gravity=place.gravity,
            timestep=timestep,
            rk4=rk4,
            slides=slides,
        )


def estimated_mobility(model: object, first: int, second: int) -> float:
    """MuJoCo's estimate of 1/mass of a contact of two bodies, 1/kg."""
    weights = model.body_invweight0  # type: ignore[attr-defined]
    return float(weights[first][0] + weights[second][0])


def row_choices(
    goal: RestitutionCurve, band: Band, load: Load, adhesive: bool
) -> Iterator[tuple[str, Rows]]:
    """Yield (name, rows) of each setting of a contact to try for a target, the simplest first.

    For a target that hardly bounces: a stop within a step, and gentle ones of more steps; else a
    bounce in one step, if nothing slides. Then a spring and damper of one e; then, if e is neither
    0 nor 1 anywhere, two rows whose e depends on speed as the target's, if `adhesive` with the
    pull that they may have, and without.

    goal: e over speed.
    band: lowest and highest impact speed, m/s.
    load: on the contact that the rows serve.
    adhesive: whether the two rows may pull.

    Raises SearchInterrupted, with the best so far, where the user stops the fit of the two.
    """
    h = load.timestep
    # The one e that is least wrong over the band.
    constant = goal.best_constant(*band)
    if constant < NO_BOUNCE:
        stop = ConstraintRow.direct(_STOP / h**2, 1.0 / h, STIFF_SOLIMP)
        yield "stop", (stop,)
        # Friction throws up what slides less, the more steps a stop takes.
        for steps in _GENTLE_STEPS:
            yield f"stop of {steps} steps", (ConstraintRow((steps * h, 1.0), _GENTLE_SOLIMP),)
    elif not load.slides and not load.rk4:
        yield ONE_STEP, one_step(constant, h)
    steps = _RK4_STEPS if load.rk4 else half_period_steps(load.points)
    yield f"spring of {steps} steps", (spring_row(constant, steps, load),)
    e = goal.at(np.geomspace(*band, 50))
    # Two rows need an e to work at: without a bounce, or without a loss, there is nothing to fit.
    if e.min() > NO_BOUNCE and e.max() < 1.0:
        # Two digits: two feet whose loads differ by rounding share one fit.
        strength = float(f"{load.strength:.2g}")
        rounded = replace(load, strength=strength)
        # The fit of rows that pull may end farther from the target than that of rows that do not.
        if adhesive:
            yield "spring and damper", _fitted(goal, band, rounded, adhesive=True)
        yield "spring and damper", _fitted(goal, band, rounded, adhesive=False)


def one_step(e: float, timestep: float) -> Rows:
    """A row that turns a body back with this e in one time step (s), as `check` advises.

    Its spring hardly changes e, but lifts a body that lies too deep.
    """
    spring = min(1e4, 1e-3 / timestep**2)
    return (ConstraintRow.direct(spring, (1.0 + e) / timestep, STIFF_SOLIMP),)


def spring_row(e: float, steps: int, load: Load, solimp: Solimp = SPRING_SOLIMP) -> ConstraintRow:
    """One row with this e and a half period of `steps` steps, for the load.

    e: at least _LEAST_E is made.
    solimp: of one impedance.
    Euler's steps are matched exactly, so the steps are whole; RK4 follows continuous time, in which
    the half period lasts as long.
    """
    loss = -math.log(max(e, _LEAST_E))
    half_period = steps * load.timestep  # s
    # Per unit mass: a damper b, 1/s, and a half period T, s, have e = exp(-b T/2), and the stiffness
    # (π/T)² + (b/2)², 1/s².
    if load.rk4:
        stiffness = (math.pi**2 + loss**2) / half_period**2
        damping = 2.0 * loss / half_period
    else:
        # Semi-implicit Euler: a step multiplies the oscillation by √c and turns it by π/steps.
        c = math.exp(-2.0 * loss / steps)
        stiffness = (1.0 + c - 2.0 * math.sqrt(c) * math.cos(math.pi / steps)) / load.timestep**2
        damping = (1.0 - c) / load.timestep
    return ConstraintRow.direct(stiffness / load.strength, damping / load.strength, solimp)


@lru_cache(maxsize=16)
def _fitted(goal: RestitutionCurve, band: Band, load: Load, adhesive: bool) -> Rows:
    """Fit two rows to a target: a spring, and a damper whose strength grows with depth, which become
    two <pair>s of the same two geoms.

    goal: e over speed.
    band: lowest and highest impact speed, m/s.
    load: on the contact that the rows serve.
    adhesive: whether the rows may pull.
    Raises SearchInterrupted with the best so far, where the user stops the fit.
    """
    h = load.timestep
    gravity = round(load.gravity, 2)
    rows = spring_and_damper_rows(
        goal, band, h, gravity, load.strength, adhesive, load.rk4, points=load.points
    )
    return tuple(rows)


# A user's model with pairs in it, as text: the user's own and a few lines, or else MuJoCo's own of
# it.

_SUFFIXES = (".xml", ".mjcf", ".urdf")
_END = "</mujoco>"
_INCLUDE = re.compile(r"(<include\s[^>]*?file\s*=\s*)([\"'])(.*?)\2", re.DOTALL)
_DIRECTORY = re.compile(r'\b(meshdir|texturedir|assetdir)="(/[^"]*)"')
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
# What MuJoCo's parser reads as a character; it leaves an & before anything else as it is.
_ESCAPE = re.compile(r"&(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);")


def spec_of(source: Any) -> Any:
    """A new MjSpec of the user's model, whose assets are found from any folder.

    source: an MjSpec, MJCF text, or the path of an MJCF or URDF file.
    Raises UserError for a source that cannot be written, such as a compiled model, and for MJCF
    that is not in UTF-8; SceneError for one that does not parse.
    """
    mujoco = backend()
    if isinstance(source, mujoco.MjSpec):
        return source.copy()
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return compiled(partial(mujoco.MjSpec.from_string, source), label_of(source))
    if (path := _path(source)) is None:
        got = str(source) if isinstance(source, str | Path) else f"a {type(source).__name__}"
        raise UserError("model", got, "an MJCF file or an MjSpec, which can be written")
    # Before any search: a text that cannot be read cannot be written again either.
    if path.suffix.lower() != ".urdf":
        _read_utf8(path)
    spec = compiled(partial(mujoco.MjSpec.from_file, str(path)), str(path))
    if _has_assets(spec):
        for name in ("meshdir", "texturedir"):
            setattr(spec, name, str((path.parent / getattr(spec, name)).resolve()))
    return spec


def label_of(source: Any) -> str:
    """Name of the model in outputs: its file, or "model"."""
    is_file = isinstance(source, str | Path) and not str(source).lstrip().startswith("<")
    return Path(source).name if is_file else "model"


def _path(source: Any) -> Path | None:
    if isinstance(source, str | Path) and Path(source).suffix.lower() in _SUFFIXES:
        return Path(source)
    return None


def _read_utf8(path: Path) -> str:
    """Read the text of a model's file in UTF-8.

    Raises UserError for another encoding: MuJoCo takes any bytes in comments, but its own writer
    then gives a text that Python cannot read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        got = f"{path.name} has a byte that is not UTF-8"
        raise UserError("model", got, "a file in UTF-8", "Save it in UTF-8") from None


def _has_assets(spec: Any) -> bool:
    return any(asset.file for asset in (*spec.meshes, *spec.hfields, *spec.textures, *spec.skins))


def whole_text(spec: Any, folder: Path | None) -> str:
    """MuJoCo's own text of a changed spec.

    folder: of the file that is to be written, from which paths of assets then lead; None keeps
    them absolute.
    """
    text = str(spec.to_xml())
    if folder is None:
        return text

    def moved(match: re.Match[str]) -> str:
        way = os.path.relpath(_plain(match[2]), folder.resolve())
        return f"{match[1]}={quoted(way)}"

    return _DIRECTORY.sub(moved, text)


def _plain(attribute: str) -> str:
    """The value of an XML attribute, with characters for its escapes, such as & for &amp;."""
    return _ESCAPE.sub(lambda escape: html.unescape(escape[0]), attribute)


def own_text(source: Any, folder: Path | None, lines: str) -> str:
    """Return the user's text, comments and includes and all, with more lines at its end.

    source: as the user gave it; "" is returned unless it is MJCF text.
    folder: of the file that is to be written, from which its paths then lead; None: they stay.
    lines: XML for the end of <mujoco>.

    Also "" for a text that does not end with </mujoco>, and for one that is to be found from
    another folder and includes a file that includes another.
    Raises UserError for a file that is not in UTF-8.
    """
    path = _path(source)
    if path is not None and path.suffix.lower() != ".urdf":
        text = _read_utf8(path)
    elif isinstance(source, str) and source.lstrip().startswith("<mujoco"):
        text = source
    else:
        return ""
    # Comments as blanks of the same length: one after the model may also say </mujoco>.
    without_comments = _COMMENT.sub(lambda comment: " " * len(comment[0]), text)
    end = without_comments.rfind(_END)
    if end < 0:
        return ""
    head = text[:end]
    tail = text[end + len(_END) :]
    if path is not None and folder is not None and folder.resolve() != path.parent.resolve():
        if _includes_twice(without_comments, path):
            return ""
        head = _moved(head, path, folder)
        lines = f"{_directories(path, folder)}{lines}"
    return f"{head.rstrip()}\n\n{lines}\n{_END}{tail}"


def _includes_twice(text: str, path: Path) -> bool:
    """Say whether a file that a model includes has an <include> of its own.

    text: of the model, without comments.
    path: of its file.

    MuJoCo looks for the inner file from the folder of the model first, so its name, which stays, may
    lead nowhere from another folder, or to another file.
    """
    for match in _INCLUDE.finditer(text):
        # Its comments may be in any encoding.
        inner = _included_file(match, path).read_text(encoding="utf-8", errors="replace")
        if _INCLUDE.search(_COMMENT.sub("", inner)):
            return True
    return False


def _included_file(match: re.Match[str], path: Path) -> Path:
    """The file of a match of _INCLUDE in the model at a path."""
    return (path.parent / _plain(match[3])).resolve()


def _moved(text: str, path: Path, folder: Path) -> str:
    """A model's text with its includes as they are found from another folder.

    path: of the file that the text is from.
    folder: where the text will be.
    """

    def moved(match: re.Match[str]) -> str:
        """The <include> of one match: its begin, up to the "=", and the new path in quotes."""
        way = os.path.relpath(_included_file(match, path), folder.resolve())
        return f"{match[1]}{quoted(way)}"

    return _INCLUDE.sub(moved, text)


def _directories(path: Path, folder: Path) -> str:
    """A <compiler> line by which a model finds its assets from another folder; "" without assets.

    path: of the model.
    folder: of the file that is to be written.
    """
    spec = spec_of(path)
    if not _has_assets(spec):
        return ""
    attributes = []
    for name in ("meshdir", "texturedir"):
        way = os.path.relpath(getattr(spec, name), folder.resolve())
        attributes.append(f"{name}={quoted(way)}")
    return f"<compiler {' '.join(attributes)}/>\n"


def included(lines: str) -> str:
    """A file of these lines, to be included."""
    return f"<mujocoinclude>\n{lines}\n</mujocoinclude>\n"


def taken_pairs(model: Any, geoms: Sequence[tuple[int, int]]) -> bool:
    """Say whether the model has <pair>s of its own for any of these geoms."""
    own = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    # In a frozenset the order of the two does not matter.
    return not set(map(frozenset, own)).isdisjoint(map(frozenset, geoms))


_numbers = partial(numbers_text, number="{:.10g}".format)


@dataclass(frozen=True)
class PairToTune:
    """Pair in the user's model, with the launches and the load that its contact has to serve.

    requests: its launches, one for each attitude.
    opened: the model under each.
    geoms: numbers of every two geoms that get the <pair>s.
    load: on its contact in the first attitude.
    like: equal for pairs that are alike, such as the feet of a robot.
    """

    requests: tuple[Request, ...]
    opened: tuple[MujocoModel, ...]
    geoms: tuple[tuple[int, int], ...]
    load: Load
    like: tuple[object, ...]

    @property
    def place(self) -> PairAtTouch:
        """The pair at touch in its first attitude."""
        return self.opened[0].place

    @cached_property
    def band(self) -> tuple[float, float]:
        """Lowest and highest launch speed, m/s."""
        return min(self.requests[0].speeds), max(self.requests[0].speeds)

    @cached_property
    def sliding_mobility(self) -> float:
        """Mobility of the pair along the plate; see the function of this name."""
        return sliding_mobility(self.place, self.load)


class Written(NamedTuple):
    """A spec with rows in it, what was written, and what to know.

    lines: XML to paste.
    notes: sentences for the user.
    names: of each geom of the pairs, by its number.
    own: whether the user's text can stay, with the lines added.
    step: that the lines set in place of the model's own, s; None where they set none.
    gravity: the same, m/s^2.
    """

    spec: Any
    lines: str
    notes: list[str]
    names: dict[int, str]
    own: bool
    step: float | None = None
    gravity: Vector | None = None

    @property
    def kept(self) -> str:
        """Clause on what of the model is as it was, and on step and gravity where they are not."""
        step = "" if self.step else ", step"
        clause = f"friction, condim, margin, masses{step} and integrator are as they were"
        changes = []
        if self.step is not None:
            changes.append(f"the step is now {time_step(self.step)} s")
        if self.gravity is not None:
            changes.append(f"gravity is now {gravity_text(self.gravity)} m/s^2")
        if not changes:
            return clause
        return f"{clause}; {' and '.join(changes)}, at which this was tuned"


def texts_of(source: Any, made: Written, sections: Sequence[str], output: Output) -> Texts:
    """The lines to paste, the whole model with them, and a file of the lines to be included.

    source: as the user gave it.
    made: the source with rows in it.
    sections: further XML sections of the model.
    output: where the model and the included file are to be written. The whole is the user's own
    text with the lines, or an <include> of them, at its end where that can be; else MuJoCo's text
    of the model, which holds the lines itself and includes no file.
    Raises UserError for a file that is not in UTF-8.
    """
    # An empty section would leave an empty line.
    paste = "\n".join(filter(None, (made.lines, *sections)))
    lines = paste
    if output.include:
        lines = f'<include file="{output.include}"/>'
    whole = ""
    if made.own:
        whole = own_text(source, output.folder, lines)
    if not whole:
        head, end, tail = whole_text(made.spec, output.folder).rpartition("</mujoco>")
        whole = "\n".join([head, *sections, f"{end}{tail}"])
    return Texts(paste, whole, included(paste))


def written(
    source: Any, pairs: Sequence[tuple[PairToTune, Rows]], impratio: float | None = None
) -> Written:
    """Write contact rows for pairs into a copy of a user's model.

    source: a file, MJCF text or an MjSpec; it stays as it is.
    pairs: each with its rows; a row becomes one <pair> for every two geoms of the pair.
    impratio: of the whole model, with elliptic cones; 0 to leave both; None for what the rows need.
    Raises UserError for a source that cannot be written, such as a compiled model or a file that is
    not in UTF-8.
    """
    spec = spec_of(source)
    model = spec.compile()
    lines: list[str] = []
    notes: list[str] = []
    geoms: list[tuple[int, int]] = []
    for pair, _ in pairs:
        geoms += pair.geoms
    names = name_geoms(spec, model, geoms, notes)
    # The user's own text can stay, with lines added, if its geoms have names (a note says which do
    # not) and it has no <pair>s of them, which the new ones would stand beside.
    own = not notes and not taken_pairs(model, geoms)
    for pair, rows in pairs:
        for one, other in pair.geoms:
            lines += _write_rows(spec, model, pair, (one, other), (names[one], names[other]), rows)
    # All pairs are tuned at one step and under one gravity.
    first_pair, _ = pairs[0]
    request = first_pair.requests[0]
    step = new_step(spec, request)
    gravity = new_gravity(spec, request)
    option = options_of(spec, step, gravity)
    if impratio is None:
        impratio = needed_impratio(model, pairs)
    if impratio > 0.0:
        what_for = "friction neither throws up what slides nor slips"
        option += elliptic_option(spec, impratio, what_for, notes)
    return Written(
        spec=spec,
        lines=contact_text(option, lines),
        notes=notes,
        names=names,
        own=own,
        step=step,
        gravity=gravity,
    )


def colliding_geoms(model: Any, pairs: Sequence[ContactPair]) -> list[tuple[int, int]]:
    """Numbers of every two geoms of some pairs that MuJoCo collides, each two once.

    Raises UserError for more than _PAIRS_MAX, which are too many to write.
    """
    geoms: list[tuple[int, int]] = []
    for pair in pairs:
        every = itertools.product(pair.first.geoms, pair.second.geoms)
        geoms += [both for both in every if can_meet(model, both)]
    if len(geoms) > _PAIRS_MAX:
        got = f"{len(geoms)} pairs of geoms"
        raise UserError("pair", got, f"{_PAIRS_MAX} at most", "Name single geoms")
    return list(dict.fromkeys(geoms))


def friction_values(model: Any, geoms: tuple[int, int]) -> dict[str, Any]:
    """The condim and friction in force between two geoms, as attributes of a new <pair>."""
    contact = contact_in_force(model, *geoms)
    sliding, torsional, rolling = contact["friction"]
    return {
        "condim": int(contact["condim"]),
        "friction": [sliding, sliding, torsional, rolling, rolling],
    }


def new_step(spec: Any, request: Request) -> float | None:
    """The step of a request, s; None where it asks for none, or for the model's own."""
    if request.timestep is None or request.timestep == float(spec.option.timestep):
        return None
    return request.timestep


def new_gravity(spec: Any, request: Request) -> Vector | None:
    """The gravity of a request, m/s^2; None where it asks for none, or for the model's own."""
    if request.gravity is None or request.gravity == tuple(spec.option.gravity.tolist()):
        return None
    return request.gravity


def options_of(spec: Any, step: float | None, gravity: Vector | None) -> str:
    """Set step, s, and gravity, m/s^2, in a spec, and return the <option> that says so; of None:
    "", and it stays.

    A contact tuned at one step, or under one gravity, bounces otherwise at another. Of two
    <option>s MuJoCo takes each attribute from the later one, so the line holds at the end of a
    model that has a step.
    """
    attributes = ""
    if step is not None:
        spec.option.timestep = step
        attributes += f' timestep="{step!r}"'
    if gravity is not None:
        spec.option.gravity = gravity
        attributes += f' gravity="{_numbers(gravity)}"'
    return f"<option{attributes}/>\n" if attributes else ""


def elliptic_option(spec: Any, impratio: float, what_for: str, notes: list[str]) -> str:
    """Set elliptic cones with an impratio in a spec, and return the line of XML with the <option>
    that states them.

    what_for: the reason, a clause for the note that is added to `notes`.
    """
    spec.option.cone = backend().mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = impratio
    notes.append(
        f"cone and impratio are of the whole model: elliptic and {impratio:g}, so that {what_for}; "
        "other contacts change a little."
    )
    return f'<option cone="elliptic" impratio="{impratio:g}"/>\n'


def contact_text(option: str, lines: Sequence[str]) -> str:
    """The <contact> section of lines, after an <option> or ""."""
    return f"{option}<contact>\n" + "\n".join(f"  {line}" for line in lines) + "\n</contact>"


def needed_impratio(model: Any, pairs: Sequence[tuple[PairToTune, Rows]]) -> float:
    """The impratio of the whole model with which no pair drifts faster under a load than in the
    model as it is, one digit; 0 where the model's own will do.

    model: compiled, as the user has it.
    pairs: each with the rows that it gets. A friction row holds a load by a slip of R_t/(A b),
    where R_t = R_n/impratio is its regularisation, R_n/A = (1 - d)/d, and d and b are the impedance
    and damping.
    """
    own = float(model.opt.impratio)
    needed = 0.0
    for pair, rows in pairs:
        if not pair.load.slides:
            continue
        # Friction acts by the first row.
        first = rows[0]
        # As soft as MuJoCo lets a row be: the impratio of the recipe, not one by the user's contact.
        if first.solimp[0] == MIN_IMPEDANCE:
            return IMPRATIO
        now = contact_in_force(model, *pair.geoms[0])
        # The user's contact is judged where it lies deep, at its full impedance.
        slip_before = slip_under_load(now["solref"], now["solimp"], now["solimp"][1])
        slip = slip_under_load(first.solref, first.solimp, first.solimp[0])
        needed = max(needed, own * slip / slip_before)
    # A tenth more, for the rounding to one digit.
    return float(f"{1.1 * needed:.1g}") if needed > own else 0.0


def slip_under_load(solref: Sequence[float], solimp: Sequence[float], impedance: float) -> float:
    """Slip of a friction row under a load, s, but for factors that all rows have in common: (1 -
    d)/(d b) at an impedance d, where MuJoCo's damping b is 2/(dmax timeconst), or -solref[1]/dmax
    (MuJoCo, "Computation": solver parameters).

    solref, solimp: of the row, in either of MuJoCo's formats.
    impedance: d, held within MuJoCo's bounds.
    A row without damping counts as one of 1e-6 1/s.
    """
    d = min(max(impedance, MIN_IMPEDANCE), MAX_IMPEDANCE)
    dmax = min(max(solimp[1], MIN_IMPEDANCE), MAX_IMPEDANCE)
    # b dmax, 1/s: solref holds minus the damping, or the time constant, s.
    damping = -solref[1] if solref[0] <= 0.0 else 2.0 / max(solref[0], 1e-6)
    return (1.0 - d) / d * dmax / max(damping, 1e-6)


def mass_note(place: PairAtTouch) -> list[str]:
    """A list of one sentence on the effective mass, if both bodies of a pair move; else empty.

    place: the pair at touch.
    """
    model = place.pair.model
    bodies = (place.pair.first.body, place.pair.second.body)
    if not all(model.body_weldid[body] for body in bodies):
        return []
    one = body_name(model, bodies[0])
    return [
        f"Both bodies move: the effective mass is {place.effective_mass:.4g} kg, less than that of {one!r}."
    ]


def _write_rows(
    spec: Any,
    model: Any,
    pair: PairToTune,
    geoms: tuple[int, int],
    names: tuple[str, str],
    rows: Rows,
) -> list[str]:
    """Set or add the <pair>s of two geoms in a spec, one for each row, the first with friction.

    rows: of the contact, one <pair> each.
    spec: changed; of <pair>s that it has for the two, the first is used and the others go.
    model: compiled, as it was before.
    geoms, names: of the two, in one order.

    Returns the lines of XML that a user can paste, one for each row.
    """
    known = [p for p in spec.pairs if {p.geomname1, p.geomname2} == set(names)]
    for extra in known[1:]:
        spec.delete(extra)
    onset = pair.place.contact.onset
    scale = _soft_scale(model, pair, geoms) if _is_soft(rows[0]) else 1.0
    lines = []
    for i, row in enumerate(rows):
        values: dict[str, Any] = {
            "solref": [number * scale for number in row.solref],
            "solimp": list(row.solimp),
        }
        # Friction acts by the first row alone: of two <pair>s each would have all of it.
        if i == 0:
            values |= _own_friction(model, geoms) if known else friction_values(model, geoms)
            if solreffriction := _solreffriction(pair, row):
                values["solreffriction"] = solreffriction
        else:
            values["condim"] = 1
        if row.adhesion:
            values["adhesion"] = row.adhesion
        if onset or known:
            values |= {"margin": onset, "gap": 0.0}
        if known and i == 0:
            element = known[0]
            # What an earlier setting wrote and this one does not: the line has neither.
            element.solreffriction = [0.0, 0.0]
            if hasattr(element, "adhesion"):
                element.adhesion = 0.0
        else:
            element = spec.add_pair(geomname1=names[0], geomname2=names[1])
        lines.append(set_pair(element, names, values))
    return lines


def _is_soft(row: ConstraintRow) -> bool:
    """True for a row whose spring MuJoCo scales by its estimate of the mass; a stiff one sets the
    acceleration.
    """
    return row.solimp[0] <= SOFT_IMPEDANCE


def _soft_scale(model: Any, pair: PairToTune, geoms: tuple[int, int]) -> float:
    """Factor of solref with which a soft row acts between two geoms of a pair as it does between the
    pair's own bodies: MuJoCo's estimate of 1/mass of the first over that of the second.

    MuJoCo scales a soft row by its estimate, which differs between the links of a body that bounces
    as one.
    geoms: numbers of the two.
    """
    first, second = model.geom_bodyid[list(geoms)].tolist()
    own = pair.place.pair
    of_pair = estimated_mobility(model, own.first.body, own.second.body)
    return estimated_mobility(model, first, second) / of_pair


def _own_friction(model: Any, geoms: tuple[int, int]) -> dict[str, Any]:
    """condim and friction of the first <pair> that the model has for two geoms: a line that takes
    its place keeps them.
    """
    (own, *_) = explicit_pairs(model, geoms)
    return {"condim": int(model.pair_dim[own]), "friction": model.pair_friction[own].tolist()}


def set_pair(element: Any, names: tuple[str, str], values: dict[str, Any]) -> str:
    """Set attributes of a <pair>, and return its line of XML, which has these attributes alone.

    element: of the spec.
    names: of its geoms.
    values: a number or list by attribute.
    """
    attributes = []
    for name, value in values.items():
        field = getattr(element, name)
        if isinstance(value, list):
            field[: len(value)] = value
            text = _numbers(value)
        else:
            setattr(element, name, value)
            text = f"{value:g}"
        attributes.append(f'{name}="{text}"')
    first, second = map(quoted, names)
    return f"<pair geom1={first} geom2={second} {' '.join(attributes)}/>"


def _solreffriction(pair: PairToTune, row: ConstraintRow) -> list[float]:
    """MuJoCo's solreffriction of a row; empty where its friction has the row's solref."""
    if row.solreffriction or not (_is_soft(row) and pair.load.slides):
        return list(row.solreffriction)
    return [0.0, -_friction_damping(pair.place, pair.load)]


def _friction_damping(place: PairAtTouch, load: Load) -> float:
    """Damping, 1/s, of friction rows that together stop a slip in one step, in the direction in
    which the pair slides most easily.

    place: the pair at touch.
    load: on its contact.

    MuJoCo's row of regularisation R and mobility A takes A/(A + R) of what its damping asks for; at
    the least impedance d, A/R is `weight`: d/(1 - d) times impratio, and the true mobility over the
    estimated one.
    """
    weight = MIN_IMPEDANCE / (1.0 - MIN_IMPEDANCE) * IMPRATIO * sliding_mobility(place, load)
    return MIN_IMPEDANCE * (1.0 + weight) / max(weight, 1e-3) / load.timestep


def sliding_mobility(place: PairAtTouch, load: Load) -> float:
    """Mobility (1/mass) of a pair in the direction in which it slides most easily, relative to the
    one along the normal that MuJoCo estimates for a single point of the contact; without unit.

    The former is the largest eigenvalue of J M^-1 J^T over the directions in the plate.
    place: the pair at touch.
    load: on the contact; strength times effective mass is the number of points over the estimated
    mobility.
    """
    model = place.pair.model
    data = backend().MjData(place.pair.model)
    data.qpos[:] = place.qpos
    backend().mj_forward(model, data)
    normal = place.contact.normal
    # Two directions in the plate, at right angles: unit vectors, (2, 3).
    _, _, normal_and_across = np.linalg.svd(normal[None])
    across = normal_and_across[1:]
    rows = np.array([place.pair.approach_row(data, place.contact.point, way) for way in across])
    # (2, 2), 1/kg; eigenvalues are sorted, the largest last.
    mobility = rows @ np.array([response(model, data, row) for row in rows]).T
    return load.strength * place.effective_mass * float(np.linalg.eigvalsh(mobility)[-1])


def name_geoms(
    spec: Any, model: Any, geoms: Sequence[tuple[int, int]], notes: list[str]
) -> dict[int, str]:
    """Names of geoms by their numbers, as a <pair> needs them; a geom without a name gets
    "geom_NUMBER" in the spec.

    model: compiled of the spec.
    geoms: numbers of every two.
    notes: gets a sentence for each new name, which the user's own text lacks.
    """
    names = {}
    # By number: MuJoCo 3.3 gives the geoms of a spec no .id.
    by_id = list(spec.geoms)
    # A dict keeps each geom once, in order.
    for geom in dict.fromkeys(itertools.chain.from_iterable(geoms)):
        names[geom] = str(model.geom(geom).name)
        if not names[geom]:
            names[geom] = by_id[geom].name = f"geom_{geom}"
            body = body_name(model, int(model.geom_bodyid[geom]))
            notes.append(f'Geom {geom}, of body {body!r}, has no name: give it name="geom_{geom}".')
    return names
