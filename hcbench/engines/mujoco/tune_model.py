"""Contact parameters for a pair in a user's own MuJoCo model, as <pair> elements, and the model with them."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.find_pair import find_pair
from hcbench.engines.mujoco.list_pairs import contact_in_force
from hcbench.engines.mujoco.mjcf import numbers_text
from hcbench.engines.mujoco.model import body_name, effective_mass, integrator_name
from hcbench.engines.mujoco.model_under_test import MujocoModel
from hcbench.engines.mujoco.place import PairAtTouch
from hcbench.engines.mujoco.rows import STIFF_SOLIMP
from hcbench.errors import UserError
from hcbench.sim.model_under_test import ModelSetting, Request

_IMPEDANCE, _IMPRATIO = 1e-3, 1e3  # soft rows, by which friction adds next to nothing to the bounce
_STEPS = (2, 3, 4, 6, 8, 12)  # in contact, of a spring and damper with a half period of whole steps
_RK4_STEPS = (8, 12, 20, 30)
_STOP = 0.005  # K h² of a contact that stops a body: it pushes out what is inside, and no more
_PAIRS_MAX = 200
_numbers = partial(numbers_text, number="{:.10g}".format)


def model_settings(source: Any, request: Request, e: float) -> Iterator[ModelSetting]:
    """Settings for one e, to be tried: spring and damper over n steps, or one step where that is safe."""
    model, label = _spec(source).compile(), _label(source)
    place = MujocoModel(_as_asked(model, request), label, None, request).place
    geoms = _geom_pairs(model, request)
    contact = contact_in_force(model, *place.contact.rows[0][2])
    slides = int(contact["condim"]) > 1 and contact["friction"][0] > 0
    h, rk4 = float(request.timestep or model.opt.timestep), integrator_name(model) == "RK4"
    rows = _rows(e, h, _strength(place), slides, rk4)
    if integrator_name(model) == "discrete":
        raise UserError(
            "model",
            "the integrator discrete, under which contacts do not keep a set e",
            "Euler, implicit, implicitfast or RK4",
            '<option integrator="implicitfast"/>',
        )
    for name, solref, impedance in rows:
        yield _setting(source, label, request, geoms, place, (name, solref, impedance))


def _rows(
    e: float, h: float, strength: float, slides: bool, rk4: bool
) -> Iterator[tuple[str, tuple[float, float], tuple[float, ...]]]:
    """(name, solref, solimp). strength: of all points that touch at once, in that of one at their middle."""
    soft = (_IMPEDANCE, _IMPEDANCE, 0.001, 0.5, 1.0)
    if e < 0.02:
        yield "stop", (-_STOP / h**2, -1.0 / h), STIFF_SOLIMP
    elif not slides and not rk4:
        yield "one step", (-min(1e4, 1e-3 / h**2), -(1.0 + e) / h), STIFF_SOLIMP
    for n in _RK4_STEPS if rk4 else ():  # in continuous time, which RK4 follows
        loss, lasts = -math.log(max(e, 1e-3)), n * h
        stiffness = (math.pi**2 + loss**2) / lasts**2
        yield f"{n} steps", (-stiffness / strength, -2.0 * loss / lasts / strength), soft
    for n in () if rk4 else _STEPS:
        c = max(e, 1e-3) ** (2.0 / n)
        stiffness = (1.0 + c - 2.0 * math.sqrt(c) * math.cos(math.pi / n)) / h**2
        yield f"{n} steps", (-stiffness / strength, -(1.0 - c) / h / strength), soft


def _setting(
    source: Any,
    label: str,
    request: Request,
    geoms: list[tuple[int, int]],
    place: PairAtTouch,
    row: tuple[str, tuple[float, float], tuple[float, ...]],
) -> ModelSetting:
    name, solref, solimp = row
    spec, lines, notes = _spec(source), [], list[str]()
    model = spec.compile()
    h = float(request.timestep or model.opt.timestep)
    soft = solimp[0] == _IMPEDANCE
    names = _name_geoms(spec, model, geoms, notes)
    for a, b in geoms:
        before = contact_in_force(model, a, b)
        friction = before["friction"]
        values: dict[str, Any] = {
            "condim": int(before["condim"]),
            "friction": [friction[0], friction[0], friction[1], friction[2], friction[2]],
            "solref": list(solref),
            "solimp": list(solimp),
        }
        if soft and values["condim"] > 1:
            values["solreffriction"] = [0.0, -_friction_damping(place, h)]
        if place.contact.onset:
            values["margin"] = place.contact.onset
        lines.append(_add_pair(spec, names[a], names[b], values))
    option = ""
    if soft and any(contact_in_force(model, a, b)["condim"] > 1 for a, b in geoms):
        spec.option.cone, spec.option.impratio = backend().mjtCone.mjCONE_ELLIPTIC, _IMPRATIO
        option = f'<option cone="elliptic" impratio="{_IMPRATIO:g}"/>\n'
        notes.append(
            f"cone and impratio are of the whole model: elliptic and {_IMPRATIO:g}, so that friction neither "
            "throws up what slides nor slips; other contacts change a little."
        )
    if model.body_weldid[place.pair.first.body] and model.body_weldid[place.pair.second.body]:
        mass, one = place.effective_mass, body_name(model, place.pair.first.body)
        notes.append(f"Both bodies move: the effective mass is {mass:.4g} kg, less than that of {one!r}.")
    notes.append("friction, condim, margin, masses, step and integrator are as they were.")
    written = spec.to_xml()
    compiled = spec.compile()

    def opened() -> MujocoModel:
        return MujocoModel(_as_asked(compiled.__copy__(), request), label, None, request)

    paste = f"{option}<contact>\n" + "\n".join(f"  {line}" for line in lines) + "\n</contact>"
    return ModelSetting(name, paste, written, tuple(notes), request, opened)


def _strength(place: PairAtTouch) -> float:
    """How much all points of contact together do of what one on the effective mass would: a soft row acts as
    on 1 / (sum of body_invweight0), MuJoCo's own estimate, at each point.
    """
    model, pair = place.pair.model, place.pair
    mobility = sum(float(model.body_invweight0[part.body][0]) for part in (pair.first, pair.second))
    return len(place.contact.rows) / (mobility * place.effective_mass) if mobility > 0 else 1.0


def _friction_damping(place: PairAtTouch, h: float) -> float:
    """1/s, of a friction row that stops a slip in one step: its mobility over the normal one's is s."""
    model, data = place.pair.model, backend().MjData(place.pair.model)
    data.qpos[:] = place.qpos
    backend().mj_forward(model, data)
    normal = place.contact.normal
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    row = place.pair.approach_row(data, place.contact.point, across / np.linalg.norm(across))
    s = place.effective_mass / effective_mass(model, data, row)
    if s < 1e-6:  # nothing slides
        return 1.0 / h
    w = _IMPEDANCE / (1.0 - _IMPEDANCE) * _IMPRATIO * s
    return float(_IMPEDANCE * (1.0 + w) / w / h)


def _add_pair(spec: Any, one: str, two: str, values: dict[str, Any]) -> str:
    """Set or add the <pair> of two geoms; its line."""
    known = [pair for pair in spec.pairs if {pair.geomname1, pair.geomname2} == {one, two}]
    pair = known[0] if known else spec.add_pair(geomname1=one, geomname2=two)
    for name, value in values.items():
        field = getattr(pair, name)
        if isinstance(value, list):
            field[: len(value)] = value
        else:
            setattr(pair, name, value)
    attributes = " ".join(
        f'{name}="{_numbers(value) if isinstance(value, list) else f"{value:g}"}"'
        for name, value in values.items()
    )
    return f'<pair geom1="{one}" geom2="{two}" {attributes}/>'


def _name_geoms(spec: Any, model: Any, geoms: list[tuple[int, int]], notes: list[str]) -> dict[int, str]:
    """Names by which a <pair> calls geoms; those without one get one."""
    names = {}
    by_id = {geom.id: geom for geom in spec.geoms}
    for geom in dict.fromkeys(g for pair in geoms for g in pair):
        names[geom] = str(model.geom(geom).name)
        if not names[geom]:
            names[geom] = by_id[geom].name = f"geom_{geom}"
            body = body_name(model, int(model.geom_bodyid[geom]))
            notes.append(f'Geom {geom}, of body {body!r}, has no name: give it name="geom_{geom}".')
    return names


def _geom_pairs(model: Any, request: Request) -> list[tuple[int, int]]:
    """All pairs of geoms of the two that MuJoCo collides."""
    pair = find_pair(model, request)
    geoms = [(a, b) for a in pair.first.geoms for b in pair.second.geoms]
    if len(geoms) > _PAIRS_MAX:
        raise UserError("pair", f"{len(geoms)} pairs of geoms", f"{_PAIRS_MAX} at most", "Name single geoms")
    return geoms


def _as_asked(model: Any, request: Request) -> Any:
    if request.timestep is not None:
        model.opt.timestep = request.timestep
    if request.gravity is not None:
        model.opt.gravity[:] = request.gravity
    if not request.actuators:
        model.opt.disableflags |= backend().mjtDisableBit.mjDSBL_ACTUATION
    return model


def _spec(source: Any) -> Any:
    """A new MjSpec of the model."""
    mujoco = backend()
    if isinstance(source, mujoco.MjSpec):
        return source.copy()
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return mujoco.MjSpec.from_string(source)
    if isinstance(source, str | Path) and Path(source).suffix.lower() in (".xml", ".mjcf", ".urdf"):
        return mujoco.MjSpec.from_file(str(source))
    raise UserError("model", f"a {type(source).__name__}", "an MJCF file or an MjSpec, which can be written")


def _label(source: Any) -> str:
    is_file = isinstance(source, str | Path) and not str(source).lstrip().startswith("<")
    return Path(source).name if is_file else "model"
