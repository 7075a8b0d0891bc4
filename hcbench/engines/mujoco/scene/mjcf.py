"""MJCF as text in, text out, without MuJoCo: a scene with a setting in it,
and what to paste into a model.

Edited as XML, as MuJoCo's own writer rounds to six digits. scenes/README.md says what a
scene's MJCF must have: a body `ball` with a free joint, geoms `ball` and `plate`, and
in a cup the tendon `contact`.
"""

from __future__ import annotations

import copy
import itertools
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from hcbench.engines.mujoco.plugin import write_law
from hcbench.engines.mujoco.scene.elements import as_text, named, quoted, remove_pairs, section
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.laws.contact_law import Law, is_force, law_of
from hcbench.system.errors import SceneError, SettingError
from hcbench.system.text import shortest
from hcbench.terms.fields import Finite, OptionTable, mistake, validate
from hcbench.terms.scene import Scene
from hcbench.terms.setting import PAIR, Pair, Setting

# Options of a MuJoCo setting, checked strictly: MuJoCo itself clamps, warns or ignores in silence.

_Integrator = Literal["Euler", "implicit", "implicitfast", "RK4", "discrete"]
_Cone = Literal["pyramidal", "elliptic"]
INTEGRATORS: tuple[str, ...] = get_args(_Integrator)


class _RowTable(OptionTable):
    """One contact constraint of a setting's option `rows`, as a user or a file states it.

    solref, solimp, solreffriction: MuJoCo's numbers; solreffriction () for that of solref.
    onset: depth at which it starts, m.
    adhesion: force with which it may pull, N.
    friction: μ, 0 for none.
    """

    solref: tuple[Finite, Finite] = Field(
        None, validate_default=True, description="a list of 2 numbers"
    )
    solimp: tuple[Finite, Finite, Finite, Finite, Finite] = Field(description="a list of 5 numbers")
    onset: Finite = 0.0
    adhesion: Finite = 0.0
    friction: Finite = 0.0
    solreffriction: tuple[Finite, Finite] | tuple[()] = Field((), description="a list of 2 numbers")

    @field_validator("solref")
    @classmethod
    def _one_form(cls, solref: tuple[float, float]) -> tuple[float, float]:
        first, second = solref
        if (first > 0) != (second > 0):
            forms = "two numbers above 0 (time constant and damping ratio) or none (-stiffness and -damping)"
            raise mistake(forms)
        return solref

    @field_validator("adhesion", "friction")
    @classmethod
    def _not_negative(cls, value: float, info: ValidationInfo) -> float:
        if value < 0:
            unit = " N" if info.field_name == "adhesion" else ""
            raise mistake(f"0{unit} or more", f"{value!r}{unit}")
        return value


class _Table(OptionTable):
    """Options of a setting as a user or a file states them, to be checked.

    integrator, cone, impratio: MuJoCo's; None: the model's own.
    rows: of the contact.
    corners: how many points land together.
    law: of a plug-in, in place of rows; friction: its μ.
    """

    integrator: _Integrator | None = Field(None, description=f"one of: {', '.join(INTEGRATORS)}")
    cone: _Cone | None = Field(None, description=f"one of: {', '.join(get_args(_Cone))}")
    impratio: Finite | None = Field(None, gt=0, description="a number above 0")
    rows: tuple[_RowTable, ...] = Field((), description="a list of contact constraints")
    corners: int = Field(1, ge=1, description="a whole number above 0")
    law: Any = None
    friction: Finite = Field(0.0, ge=0, description="a number of 0 or more")


@dataclass(frozen=True, slots=True)
class Options:
    """A setting's options, checked. None, no rows and no law: the model as authored.

    cone, impratio: of MuJoCo's friction; None: its own.
    friction: Coulomb's μ of a force law, to paste; a scene has its own.
    corners: points at which a body of the scene meets the plate at once, each with these rows.
    """

    integrator: str | None
    rows: tuple[ConstraintRow, ...]
    law: Law | None = None
    cone: str | None = None
    impratio: float | None = None
    friction: float = 0.0
    corners: int = 1

    @property
    def all_rows(self) -> tuple[ConstraintRow, ...]:
        """The rows of all points at which a body of the scene meets the plate at once."""
        return self.rows * self.corners

    def attributes(self, number: Callable[[float], str] = repr) -> dict[str, str]:
        """Attributes of a model's <option> that the setting sets, but for the time step: texts by
        name.

        number: makes the text of a number.
        """
        ratio = None if self.impratio is None else number(self.impratio)
        texts = {"integrator": self.integrator, "cone": self.cone, "impratio": ratio}
        return {key: text for key, text in texts.items() if text is not None}


def read_options(options: Mapping[str, Any]) -> Options:
    """Check the options of a setting, and read them.

    options: by name, as a setting has them.
    Raises SettingError for the first that MuJoCo does not have, for a law together with rows, and
    for a friction without a force law.
    """
    table = validate(_Table, options, SettingError, "mujoco option '{}'")
    law = None
    if table.law is not None:
        law = law_of(table.law)
        if table.rows:
            raise SettingError("mujoco option 'law'", "given with rows", "one of the two")
    rows = tuple(ConstraintRow(**row.model_dump()) for row in table.rows)
    if table.friction and (law is None or not is_force(law)):
        raise SettingError("mujoco option 'friction'", "given without a force law", "one")
    return Options(
        integrator=table.integrator,
        rows=rows,
        law=law,
        cone=table.cone,
        impratio=table.impratio,
        friction=table.friction,
        corners=table.corners,
    )


# Of a text to paste.
LAST = "paste it at the end of the model: the last <option> counts, of each attribute"
# MuJoCo's viewer does not draw this group: coincident copies would flicker.
_HIDDEN = "3"


def model_path(scene: Scene) -> Path:
    """Path of the MJCF file that a scene names for MuJoCo; it need not exist. Raises SceneError for a
    scene without one.
    """
    try:
        return scene.models["mujoco"]["scene"]
    except KeyError:
        raise SceneError(
            f"scene {scene.name!r}",
            "no MuJoCo model",
            "its MJCF",
            'Add [models.mujoco] scene = "scene.xml" to its scene.toml',
        ) from None


# XML allows no two hyphens in a comment: the option is written as a word.
_LOAD = """It needs the plug-in of hcbench, or MuJoCo does not open it. Run `hcbench plugin mujoco` with the
option "install" once, and every MuJoCo program of this Python loads it. Or load it in a script, first:
  mujoco.mj_loadPluginLibrary(path)  with the path that `hcbench plugin mujoco` prints"""


def model_xml(scene: Scene, setting: Setting) -> str:
    """The complete MJCF of a scene under a setting, as text; it is what is simulated, and plain
    MuJoCo runs it.

    At qpos0 the ball just touches the plate.
    Raises SettingError for options that MuJoCo does not have and for friction or adhesion in a cup,
    SceneError for a scene without a model, or whose model lacks ball or plate.
    """
    head = f"{scene.name} with the contact setting {setting.name!r} at a step of {setting.timestep!r} s."
    options = read_options(setting.options)
    body = as_text(scene_tree(scene, setting.timestep, options))
    # XML allows no two hyphens in a row there.
    head = re.sub(r"-(?=-)", "- ", head)
    comment = f"{head} At qpos0 the ball just touches the plate."
    if options.law is not None:
        comment = f"{comment}\n{_LOAD}"
    return f"<!-- {comment} -->\n{body}"


def rows_snippet(setting: Setting, form: str, pair: Pair = PAIR) -> str:
    """Return the MJCF of a setting with rows, to paste into a user's model.

    <option>, and <pair>s of the two geoms `pair` or, in the form "cup", limits of a tendon.
    Raises SettingError for an option that MuJoCo does not have.
    """
    options = read_options(setting.options)
    option = f"<option {_written(option_attributes(setting))}/>"
    head = f"<!-- {LAST} -->\n{option}"
    if form != "cup":
        return f"{head}\n<contact>\n{pairs_text(options.rows, pair, '  ')}</contact>"
    lines = [head, '<!-- on the tendon "contact"; more rows are copies of it -->']
    for row in options.rows:
        line = _written(limit_attributes(row, shortest))
        if row.onset:
            line += f" <!-- upper end of range: {shortest(row.onset)} m more -->"
        lines.append(line)
    return "\n".join(lines)


def option_attributes(setting: Setting) -> dict[str, str]:
    """Attributes of the model's <option> that a setting has: the step, and what else it needs."""
    return {
        "timestep": shortest(setting.timestep),
        **read_options(setting.options).attributes(shortest),
    }


def pairs_text(rows: Sequence[ConstraintRow], pair: tuple[str, str], indent: str = "") -> str:
    """MJCF text of contact rows: one line for each, a <pair> of the same two geoms.

    pair: names of the geoms.
    indent: blanks before each line.
    Each attribute that matters is written even where it is MuJoCo's default, as a model's
    <default><pair> may have another.
    """
    pulls = any(row.adhesion for row in rows)
    lines = []
    for row in rows:
        attributes = {"geom1": pair[0], "geom2": pair[1]} | pair_attributes(row, shortest)
        attributes["gap"] = "0"
        # MuJoCo before 3.11 knows no adhesion, in defaults neither.
        if pulls:
            attributes.setdefault("adhesion", "0")
        if row.friction:
            attributes.setdefault("solreffriction", "0 0")
        lines.append(f"{indent}<pair {_written(attributes)}/>\n")
    return "".join(lines)


def _written(attributes: Mapping[str, str]) -> str:
    return " ".join(f"{key}={quoted(value)}" for key, value in attributes.items())


def scene_tree(scene: Scene, timestep: float, options: Options) -> ET.Element:
    """The complete MJCF of a scene under a setting, as a tree of XML: the scene's file with step,
    gravity, mass, contact and friction written into it.

    timestep: s.
    Raises SceneError for a scene without a model, or whose model lacks ball or plate; SettingError
    for friction or adhesion in a cup.
    """
    path = model_path(scene)
    root = _parse(path, path.parent, ())
    _anchor_files(root, path.parent)
    option = section(root, "option")
    option.set("timestep", numbers_text([timestep]))
    option.set("gravity", numbers_text([0.0, 0.0, -scene.gravity]))
    option.attrib.update(options.attributes())
    ball = named(root, "body", "ball", path)
    set_mass(ball, scene.mass, path)
    # The setting's rows take the place of the model's own contact.
    if options.rows and scene.form == "plane":
        geom = named(ball, "geom", "ball", path)
        # For its error where the model has no plate.
        named(root, "geom", "plate", path)
        remove_pairs(root)
        for pair in add_pairs(root, geom, ["plate"], options.all_rows):
            pair.set("gap", "0")
    elif options.rows:
        _write_limits(root, scene, options.rows, path)
    if scene.friction:
        _write_friction(root, scene, path, any(row.friction for row in options.rows))
    if options.law is not None:
        write_law(root, scene, options.law, path)
    return root


def _write_friction(root: ET.Element, scene: Scene, path: Path, in_rows: bool) -> None:
    """Write the scene's Coulomb friction into an MJCF: into the geoms of ball and plate, and into
    <pair>s that state no friction of their own.

    root: changed.
    path: of the model, for errors.
    in_rows: rows of the setting have friction, so <pair>s stay as they are.
    The ball also gets the scene's mass (kg) and inertia (kg m²), so that it turns as the scene's
    does.
    Raises SettingError for a cup, whose contact has no friction.
    """
    if scene.form == "cup":
        given = f"{scene.friction!r} in the form 'cup'"
        advice = "Use the same pair in the form 'plane'"
        raise SettingError(
            "friction", given, "0: a cup's contact is a tendon's limit, without friction", advice
        )
    sliding = numbers_text([scene.friction])
    ball = named(root, "body", "ball", path)
    # MuJoCo would compute the inertia of the geom, which on a plane has the relative radius.
    for inertial in ball.findall("inertial"):
        ball.remove(inertial)
    mass = numbers_text([scene.mass])
    inertia = numbers_text([scene.inertia] * 3)
    ball.insert(0, ET.Element("inertial", pos="0 0 0", mass=mass, diaginertia=inertia))
    for name in ("ball", "plate"):
        geom = named(root, "geom", name, path)
        geom.attrib.update(condim="3", friction=sliding)
    for pair in root.iterfind("contact/pair"):
        if not in_rows and pair.get("condim") == "1" and pair.get("friction") is None:
            pair.attrib.update(condim="3", friction=f"{sliding} {sliding}")


def add_acceleration_sensor(root: ET.Element) -> None:
    """Add a sensor to an MJCF, as the last one: the ball's acceleration without gravity's, m/s², three
    numbers, as an accelerometer feels it.

    root: changed.
    """
    ET.SubElement(
        ET.SubElement(root, "sensor"),
        "framelinacc",
        name="ball felt",
        objtype="xbody",
        objname="ball",
    )


def set_mass(body: ET.Element, mass: float, path: Path) -> None:
    """Give a body of an MJCF this mass, kg, and scale its inertia by as much; with the mass that it
    has the inertia stays as it is, to the bit.

    body: its element, changed. Without an <inertial>, its geom "ball" gets the mass.
    path: of the model, for errors.
    Raises SceneError for an <inertial> without a finite mass above 0, and where there is neither an
    <inertial> nor that geom.
    """
    inertial = body.find("inertial")
    if inertial is None:
        named(body, "geom", "ball", path).set("mass", numbers_text([mass]))
        return
    try:
        before = float(inertial.get("mass", "nan"))
        if not 0 < before < math.inf:
            raise ValueError(before)
        ratio = mass / before
        for key in ("diaginertia", "fullinertia"):
            inertia = inertial.get(key)
            if ratio != 1.0 and inertia is not None:
                scaled = [float(number) * ratio for number in inertia.split()]
                inertial.set(key, numbers_text(scaled))
    except ValueError:
        raise SceneError(
            str(path),
            f"the <inertial> of {body.get('name')!r} has mass {inertial.get('mass')!r}",
            "a mass in kg above 0",
        ) from None
    inertial.set("mass", numbers_text([mass]))


def add_pairs(
    root: ET.Element, ball: ET.Element, others: Iterable[str], rows: Sequence[ConstraintRow]
) -> list[ET.Element]:
    """Add each row to an MJCF as a <pair> of the ball's geom with each of the geoms named `others`.

    rows: one <pair> with each of the others.
    ball: the geom.
    Returns the <pair>s, those of the first row first.
    """
    contact = section(root, "contact")
    pairs = []
    for row, other in itertools.product(rows, others):
        attributes = {"geom1": ball.get("name", ""), "geom2": other} | pair_attributes(row)
        pairs.append(ET.SubElement(contact, "pair", attributes))
    return pairs


def pair_attributes(row: ConstraintRow, number: Callable[[float], str] = repr) -> dict[str, str]:
    """Attributes of a <pair> with which it is this row, texts by name; those of geoms and gap are
    left out, and those that would be MuJoCo's default.

    number: makes the text of a number.
    """
    values = {"solref": row.solref, "solimp": row.solimp, "margin": [-row.onset]}
    if row.adhesion:
        values["adhesion"] = [row.adhesion]
    if row.friction:
        values |= {"friction": [row.friction] * 2, "solreffriction": row.solreffriction}
    attributes = {"condim": "3" if row.friction else "1"}
    for key, numbers in values.items():
        if numbers:
            attributes[key] = numbers_text(numbers, number)
    return attributes


def limit_attributes(row: ConstraintRow, number: Callable[[float], str] = repr) -> dict[str, str]:
    """Attributes of a tendon with which its limit is this row, texts by name; the row's onset is in
    the tendon's range, which is not among them.

    number: makes the text of a number.
    """
    return {
        "solreflimit": numbers_text(row.solref, number),
        "solimplimit": numbers_text(row.solimp, number),
    }


def numbers_text(numbers: Iterable[float], number: Callable[[float], str] = repr) -> str:
    """Numbers as an attribute has them.

    number: writes one.
    """
    # Adding 0.0 leaves no "-0.0" for a user to read.
    return " ".join(number(float(one) + 0.0) for one in numbers)


def _parse(path: Path, folder: Path, above: tuple[Path, ...]) -> ET.Element:
    """Parse an MJCF file, and put the content of the files that it includes in their place.

    folder: of the main file, from which all includes lead.
    above: files that include this one.
    Raises SceneError for what cannot be read, and for an include of itself.
    """
    try:
        parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        root = ET.parse(path, parser).getroot()
    except ET.ParseError as error:
        raise SceneError(str(path), f"not XML: {error}", "MJCF", "Mend that line") from None
    except (OSError, UnicodeDecodeError, LookupError) as error:
        raise SceneError(str(path), f"{error}", "a readable MJCF") from None
    including = (*above, path.resolve())
    # A list, as the tree changes meanwhile.
    for parent in list(root.iter()):
        for child in parent.findall("include"):
            inner = (folder / child.get("file", "")).resolve()
            if inner in including:
                raise SceneError(str(path), f"{inner} includes itself", "includes without a circle")
            at = list(parent).index(child)
            # The children of the file's root element stand where the <include> was.
            parent[at : at + 1] = list(_parse(inner, folder, including))
    return root


def _anchor_files(root: ET.Element, folder: Path) -> None:
    """Write the folders of meshes and textures into an MJCF as absolute paths, since its text, once
    written, has no folder of its own; nothing where it names no files.

    root: changed.
    folder: of the file that the MJCF was read from.
    """
    assets = list(root.iterfind("asset/*[@file]"))
    if not assets:
        return
    compiler = section(root, "compiler")
    for key in ("assetdir", "meshdir", "texturedir"):
        # assetdir holds for meshes and textures alike; the others go before it where they are set.
        if key == "assetdir" or compiler.get(key) is not None:
            compiler.set(key, str((folder / compiler.get(key, "")).resolve()))


def _write_limits(
    root: ET.Element, scene: Scene, rows: Sequence[ConstraintRow], path: Path
) -> None:
    """Write each row into the MJCF of a cup as the limit of a tendon between the two centres: the
    first into the scene's tendon `contact`, the others into copies of it.

    rows: of the setting, one limit each.
    root: changed.
    path: of the model, for errors.

    Raises SettingError for adhesion, as a limit only pushes; SceneError where the model has no
    tendon `contact`.
    """
    original = named(root, "spatial", "contact", path)
    holder = next(section for section in root.findall("tendon") if original in list(section))
    # |R2| - R1, m, the length of the tendon at touch: a cup's radius is below 0.
    clearance = -scene.plate_radius - scene.ball_radius
    for i, row in enumerate(rows):
        if row.adhesion:
            raise SettingError(
                f"mujoco option 'rows[{i}].adhesion'",
                f"{row.adhesion!r} N in the form 'cup'",
                "0 N: a cup's contact is a tendon's limit, and MuJoCo lets limits only push",
                "Use the same pair in the form 'plane'",
            )
        tendon = original
        if i > 0:
            tendon = ET.SubElement(holder, "spatial", name=f"contact.{i + 1}", group=_HIDDEN)
            tendon.extend(copy.deepcopy(list(original)))
        tendon.attrib.update(limit_attributes(row))
        tendon.attrib.update(
            limited="true", range=numbers_text([0.0, clearance + row.onset]), margin="0"
        )
