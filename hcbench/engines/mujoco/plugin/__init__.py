"""Contact laws as plug-ins of MuJoCo's own kind: `hcbench.hunt_crossley` and `hcbench.restitution`.

    from hcbench.contact import mujoco as contact

    spec = mujoco.MjSpec.from_file("scene.xml")
    contact.add_to_spec(spec, HuntCrossley(stiffness=3.4e10, alpha=0.315), geoms=("ball", "plate"))
    model = spec.compile()

Or name them in MJCF and call `load()` before it is compiled; docs/reference/plugins.md lists
the keys. Force laws are for steps that resolve the contact; `Restitution` and
`ConstantRestitution` set e at any step.
"""

import functools
import math
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.scene.elements import as_text, named, quoted, remove_pairs, section
from hcbench.laws import hertz
from hcbench.laws.contact_law import Friction, Law, is_force, require_law
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim.packages import suggest_names
from hcbench.system import compiler as _compile
from hcbench.system.errors import CannotRun, EngineMissing, OutputError, SettingError
from hcbench.system.files import replace_file
from hcbench.terms.arguments import checked
from hcbench.terms.scene import Material, Scene
from hcbench.terms.setting import PAIR, Pair

FORCE = "hcbench.hunt_crossley"
RESTITUTION = "hcbench.restitution"
INSTALLED = "libhcbench.so"
SOURCE = "engines/mujoco/plugin/plugin.c"
# Shapes whose contacts MuJoCo finds less exactly than steel penetrates.
_INEXACT = {
    "mjGEOM_MESH": "a mesh",
    "mjGEOM_HFIELD": "a height field",
    "mjGEOM_SDF": "a signed distance field",
}


class ContactAccuracyWarning(UserWarning):
    """Error of the engine's own contact geometry that is larger than the law can bear."""


def library() -> Path:
    """The plug-ins' library for the installed MuJoCo, compiled when first asked for.

    CannotRun without a C compiler.
    """
    return _compile.build(SOURCE, *compiler_arguments(Path(backend().__file__).parent))


def compiler_arguments(folder: Path) -> tuple[list[str], list[str], list[Path]]:
    """Arguments for a C compiler that builds against the MuJoCo in a folder: flags, with a macro for
    each feature that differs between versions; what to link; and paths of the headers.

    folder: of the mujoco package.
    Raises CannotRun where it has no headers or no library.
    """
    include = folder / "include"
    headers = sorted((include / "mujoco").glob("*.h"))
    engine: list[Path] = []
    for name in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
        engine += folder.glob(name)
    if not headers or not engine:
        raise CannotRun(
            "MuJoCo's plug-ins", f"no headers or no library in {folder}", "MuJoCo's own wheel"
        )
    text = {header.name: header.read_text(encoding="utf-8") for header in headers}
    data = text["mjdata.h"]
    model = text["mjmodel.h"]
    # Features that differ between versions of MuJoCo.
    differs = {
        "HCB_ADHESION": " qfrc_adhesion;" in data,
        "HCB_PRECONTACT": "mjPreContact;" in data,
        "HCB_ISLAND_ROWS": "iefc_D;" in data,
        "HCB_SURFACE_VELOCITY": "surfacevel[3];" in data,
        "HCB_DAMPER": any("mjDSBL_DAMPER" in one for one in text.values()),
        "HCB_ACTUATOR_DAMPING": " jnt_actuatorid;" in model,
        "HCB_SLEEP": " tree_awake;" in data,
        "HCB_TENDON_ROWS_IN_MODEL": "ten_J_rownnz;" in model,
    }
    flags = [f"-I{include}"]
    flags += [f"-D{name}" for name, is_so in differs.items() if is_so]
    if " nactuator;" in model:  # one may have several controls
        flags.append("-DHCB_ACTUATORS=m->nactuator")
    # The rows of the sparse inertia matrix were once in mjData, by other names, one or the other.
    for name in ("M", "C"):
        if f" {name}_rownnz;" in data and " M_rownnz;" not in model:
            rows = ",".join(f"d->{name}_{part}" for part in ("rownnz", "rowadr", "colind"))
            flags.append(f"-DHCB_M_ROWS={rows}")
            break
    if " D_rownnz;" in data:
        flags.append("-DHCB_D_ROWS=d->D_diag,d->D_rowadr,d->D_colind,d->D_rownnz")
    link = [str(engine[0]), f"-Wl,-rpath,{folder}"]
    return flags, link, headers


@functools.cache
def load() -> None:
    """Make the plug-ins known to MuJoCo, for this process: before a model that has them is read.

    Raises CannotRun where another version is installed beside MuJoCo, or without a C compiler.
    """
    mujoco = backend()
    built = library()
    if (there := _installed()).exists() and there.read_bytes() != built.read_bytes():
        advice = "Run `hcbench plugin mujoco --install` again, or delete it"
        raise CannotRun(
            str(there), "of another version of hcbench or MuJoCo", "this one's plug-ins", advice
        )
    mujoco.mj_loadPluginLibrary(str(built))


def _installed() -> Path:
    return Path(backend().__file__).parent / "plugin" / INSTALLED


def install() -> Path:
    """Put the library where MuJoCo, whoever imports it, loads its own
    plug-ins from; returns its path.

    Raises OutputError for a folder that cannot be written to, CannotRun without a C compiler.
    """
    path = _installed()
    try:
        path.parent.mkdir(exist_ok=True)
        # A process that has the earlier library loaded keeps it: written over in place, it would crash.
        replace_file(path, library().read_bytes())
    except OSError as error:
        raise OutputError(
            str(path), str(error.strerror or error), "a folder that can be written to"
        ) from None
    return path


@checked
def config(law: Law, friction: Friction | None = None, **more: str) -> tuple[str, dict[str, str]]:
    """Return the name of a law's plug-in, and the config of its instance, texts by key, but for the
    keys that name the pair.

    friction: of a force law; None: without.
    more: other keys, unchanged.

    Raises SettingError for friction with a restitution law, and for what is not a contact law.
    """
    require_law(law)
    if not is_force(law):
        if friction is not None:
            raise SettingError(
                "friction", "given for a restitution law", "none", "MuJoCo's own friction stays"
            )
        if isinstance(law, ConstantRestitution):
            return RESTITUTION, {"restitution": repr(law.restitution)} | more
        assert isinstance(law, Restitution)
        return RESTITUTION, {"alpha": repr(float(law.alpha)), "reading": law.reading} | more
    keys = {"stiffness": repr(float(law.stiffness)), "exponent": repr(float(law.exponent))}
    if isinstance(law, TouchSpeedLaw):
        keys |= {"law": law.family.slug, "restitution": repr(float(law.restitution))}
    else:
        keys["alpha"] = repr(float(law.alpha))
    if friction is not None:
        keys |= {"friction": repr(friction.static), "dynamic_friction": repr(friction.dynamic)}
        keys["slip_speed"] = repr(friction.slip_speed)
    return FORCE, keys | more


@checked
def add_to_spec(
    spec: Any,
    law: Law,
    *,
    geoms: tuple[str, str] | None = None,
    bodies: tuple[str, str] | None = None,
    tendon: str | None = None,
    friction: Friction | None = None,
    name: str = "",
    **more: str,
) -> str:
    """Add a law to an MjSpec, for one pair by names; returns the name of the plug-in's instance.

    geoms, bodies, tendon: one of them; of a tendon its upper limit is the contact.
    friction: of a force law; a restitution law keeps MuJoCo's.
    more: further keys of the config, such as alpha="name of a numeric". A force law turns MuJoCo's
    own contact between the two bodies off, or the tendon's limit.

    Raises SettingError for what cannot be a pair, CannotRun without a C compiler.
    """
    if not isinstance(spec, backend().MjSpec):
        raise SettingError("spec", f"{spec!r:.80}", "a mujoco.MjSpec")
    plugin, keys = config(law, friction, **more)
    pairs = {"geoms": geoms, "bodies": bodies, "tendon": tendon}
    given = [kind for kind, names in pairs.items() if names]
    if len(given) != 1:
        raise SettingError("pair", " and ".join(given) or "none", "one of geoms, bodies and tendon")
    if tendon is not None:
        limited = _element(spec, "tendon", tendon)
        keys["tendon"] = tendon
        if is_force(law):
            limited.limited = 0
    else:
        kind, pair = ("geom", geoms) if geoms else ("body", bodies)
        parts = _parts(spec, kind, pair)
        keys |= {f"{kind}{i}": part.name for i, part in enumerate(parts, 1)}
        if is_force(law):
            _exclude(spec, kind, parts)
    if not hasattr(spec, "activate_plugin"):
        version = backend().__version__
        advice = "Or name the plug-in in MJCF: docs/reference/plugins.md"
        raise EngineMissing(
            f"mujoco {version}", "its MjSpec takes no plug-ins", "a later version", advice
        )
    load()
    name = name or f"{plugin} {len(spec.plugins) + 1}"
    spec.activate_plugin(plugin)
    instance = spec.add_plugin(name=name, plugin_name=plugin, active=True)
    instance.config = keys
    return name


def _parts(spec: Any, kind: str, pair: Any) -> list[Any]:
    if isinstance(pair, str) or len(pair) != 2:
        raise SettingError(f"{kind} pair", repr(pair), "two names, such as ('ball', 'plate')")
    return [_element(spec, kind, one) for one in pair]


def _exclude(spec: Any, kind: str, parts: Sequence[Any]) -> None:
    """Turn MuJoCo's own contact between the bodies of two parts off, in a spec; a body without a
    name gets one.

    kind: "geom" or "body", of the parts. Warns of shapes whose contact is not exact enough for a
    force law.
    """
    if kind == "geom":
        geoms = list(parts)
        bodies = [geom.parent for geom in parts]
    else:
        geoms = [geom for body in parts for geom in body.geoms]
        bodies = list(parts)
    _warn_of_shapes(geoms)
    for body, part in zip(bodies, parts, strict=True):
        # An exclusion names bodies.
        body.name = body.name or f"body of {part.name}"
    first, second = (body.name for body in bodies)
    # Several laws of the same two bodies share one exclusion.
    excluded = [{one.bodyname1, one.bodyname2} for one in spec.excludes]
    if {first, second} not in excluded:
        spec.add_exclude(bodyname1=first, bodyname2=second)


def _element(spec: Any, kind: str, name: str) -> Any:
    """The element of a spec of this kind and name. Raises SettingError, with names that are like
    it, where there is none.
    """
    element = None
    if isinstance(name, str):
        # A spec finds one by `geom(name)`, and has all in `geoms`; a tendon and a body alike.
        element = getattr(spec, kind)(name)
    if element is None:
        every = getattr(spec, "bodies" if kind == "body" else f"{kind}s")
        names = [one.name for one in every if one.name]
        raise SettingError(f"{kind} {name!r}", "not in the model", *suggest_names(str(name), names))
    return element


def _warn_of_shapes(geoms: Sequence[Any]) -> None:
    """Warn of geoms whose contact MuJoCo finds less exactly than a stiff force law needs, by a
    ContactAccuracyWarning for each: meshes, height fields and distance fields.

    geoms: of a spec.
    """
    mujoco = backend()
    for geom in geoms:
        for shape, words in _INEXACT.items():
            if geom.type == getattr(mujoco.mjtGeom, shape):
                warnings.warn(
                    f"geom {geom.name!r} is {words}: MuJoCo's contact with it is wrong by more than 1e-6 to"
                    " 2e-5 m, the depth of steel contacts. Use primitive geoms (sphere, plane, capsule,"
                    " cylinder, box) or a tendon's limit where that matters",
                    ContactAccuracyWarning,
                    stacklevel=4,
                )


@checked
def hertz_stiffness(
    model: Any, geom1: str, geom2: str, material1: Material, material2: Material
) -> float:
    """Stiffness k of Hertz's contact F = k x^(3/2), eq. (5), N/m^1.5, from the radii of two geoms:
    spheres, or a sphere and a plane.

    model: MjModel.
    geom1, geom2: names in it.
    material1, material2: their elasticity, in the same order.
    Raises SettingError for another model, name or shape.
    """
    mujoco = backend()
    shapes = mujoco.mjtGeom
    radii = []  # m
    if not isinstance(model, mujoco.MjModel):
        raise SettingError("model", f"{model!r:.80}", "a mujoco.MjModel")
    for name in (geom1, geom2):
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
        if geom < 0:
            raise SettingError(f"geom {name!r}", "not in the model", "the name of a geom")
        kind = shapes(int(model.geom_type[geom]))
        if kind == shapes.mjGEOM_PLANE:
            radii.append(math.inf)
        elif kind == shapes.mjGEOM_SPHERE:
            radii.append(float(model.geom_size[geom, 0]))
        else:
            got = "neither a sphere nor a plane"
            raise SettingError(f"geom {name!r}", got, "a stiffness of your own")
    first, second = radii
    return hertz.spheres(first, second, material1, material2).stiffness


def attach(*_: Any, **__: Any) -> NoReturn:
    """Raise SettingError with what takes the place of this function of earlier versions: the law is
    part of the model now.
    """
    raise SettingError(
        "attach",
        "gone: the law is a plug-in of the model, which copies, saved models and threads keep",
        'add_to_spec(spec, law, geoms=("ball", "plate")) and model = spec.compile(), with a mujoco.MjSpec',
        "docs/reference/plugins.md shows it in MJCF",
    )


# The law in MJCF: its plug-in in a scene, and as text to paste.

# Keys of the config that say of what, by the form of the scene.
_PAIRS = {"cup": {"tendon": "contact"}, "plane": dict(zip(("geom1", "geom2"), PAIR, strict=True))}


def write_law(root: ET.Element, scene: Scene, law: Law, path: Path) -> None:
    """Add the law's plug-in to a scene's MJCF, for the two geoms or, in a cup, for the tendon; a
    force law turns MuJoCo's own contact, or the tendon's limit, off.

    path: of the model, for errors.
    Raises SceneError where the model lacks a part that the form has.
    """
    form = scene.form
    # A force acts in place of the model's own contact.
    if is_force(law) and form == "cup":
        named(root, "spatial", "contact", path).set("limited", "false")
    elif is_force(law):
        plate = named(root, "geom", "plate", path)
        # The body that has the plate; without one it is the world's own.
        holder = next((body for body in root.iter("body") if plate in list(body)), None)
        other = "world" if holder is None else holder.get("name", "")
        remove_pairs(root)
        ET.SubElement(section(root, "contact"), "exclude", body1=other, body2="ball")
    root.append(extension(law, _PAIRS[form], scene.friction))
    named(root, "body", "ball", path).insert(0, ET.Element("plugin", instance="contact"))


def extension(law: Law, pair: Mapping[str, str], friction: float = 0.0) -> ET.Element:
    """Return the <extension> of MJCF that declares a law's plug-in, with one instance, "contact".

    pair: the keys of its config that name the pair, such as geom1 and geom2.
    friction: μ that goes with a force law; 0: none.
    A restitution law keeps MuJoCo's.
    """
    of_force = None
    if friction and is_force(law):
        of_force = Friction(friction, friction)
    name, keys = config(law, of_force)
    made = ET.Element("extension")
    instance = ET.SubElement(ET.SubElement(made, "plugin", plugin=name), "instance", name="contact")
    for key, value in (*pair.items(), *keys.items()):
        ET.SubElement(instance, "config", key=key, value=value)
    return made


def law_instances(law: Law, pairs: Sequence[Pair]) -> str:
    """MJCF text of one plug-in instance of a law for each pair, each in an <extension> of its own.

    pairs: names of two geoms each.
    The instances are called "contact0", "contact1" and so on.
    """
    text = ""
    for i, (first, second) in enumerate(pairs):
        made = extension(law, {"geom1": first, "geom2": second})
        instance = made.find("plugin/instance")
        assert instance is not None
        instance.set("name", f"contact{i}")
        text += as_text(made)
    return text


def law_snippet(law: Law, form: str, pair: Pair = PAIR, friction: float = 0.0) -> str:
    """Return the MJCF of a law, to paste into a user's model.

    form: "cup" for the upper limit of a tendon named "contact", else two geoms.
    pair: names of the geoms, the first of which moves.
    friction: μ that goes with a force law; 0 for none.
    """
    first, second = pair
    keys = {"geom1": first, "geom2": second}
    if form == "cup":
        keys = _PAIRS[form]
    lines = ["<!-- load the plug-in first: see `hcbench plugin mujoco` -->"]
    # A force acts in place of the model's own contact, which is turned off.
    if is_force(law) and form == "cup":
        lines.append(
            '<!-- limited="false" on the tendon "contact": the force takes the place of its limit -->'
        )
    lines.append(as_text(extension(law, keys, friction)).strip())
    if is_force(law) and form != "cup":
        lines.append(f'<contact><exclude body1="world" body2={quoted(first)}/></contact>')
    return "\n".join(lines)
