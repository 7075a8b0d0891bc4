"""Contact parameters for pairs in a user's own MuJoCo model, as <pair> elements, and the model with them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import (
    body_name,
    collision_filter,
    explicit_pairs,
    integrator_name,
    response,
)
from hcbench.engines.mujoco.model.list_pairs import contact_in_force, find_pair
from hcbench.engines.mujoco.model.open import load
from hcbench.engines.mujoco.model.place import PairAtTouch
from hcbench.engines.mujoco.model.tune_rows import Aim, Load, estimated_mobility, max_error, row_choices
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.recipes.compliant_fit import IMPRATIO
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.promises import promise_lines
from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.errors import UserError
from hcbench.impact import Impact
from hcbench.laws.restitution import RestitutionCurve
from hcbench.sim import simulate
from hcbench.sim.model_under_test import ModelSetting, Request
from hcbench.sim.promise import Promise

_PAIRS_MAX = 200
_SEEN_SPEEDS, _SEEN_PHASES = 5, (0.1, 0.4, 0.7)  # of the launches that a setting is mended by
_MENDED, _PATIENCE = 5, 3  # times at most, and times in a row that may bring nothing
_numbers = partial(numbers_text, number="{:.10g}".format)

Rows = tuple[ConstraintRow, ...]


@dataclass(frozen=True)
class _TunedPair:
    """A pair of the user's, and what its contact has to do. request: its launches."""

    request: Request
    place: PairAtTouch
    geoms: tuple[tuple[int, int], ...]
    load: Load

    @cached_property
    def band(self) -> tuple[float, float]:
        """Lowest and highest launch speed, m/s."""
        return min(self.request.speeds), max(self.request.speeds)


def model_settings(
    source: Any, requests: Sequence[Request], goal: RestitutionCurve
) -> Iterator[ModelSetting]:
    """Settings for all pairs at once, the simplest first; the last are mended by how they do in the model."""
    load(source, requests[0])  # says what is wrong with a model that is
    model, label = _spec(source).compile(), _label(source)
    _require_tunable(model)
    pairs = [_read_pair(model, label, request) for request in requests]

    def setting(name: str, rows: Sequence[Rows]) -> ModelSetting:
        return _setting(source, label, name, list(zip(pairs, rows, strict=True)))

    rows: tuple[Rows, ...] = ()
    name = ""
    for choice in zip(*(row_choices(goal, pair.band, pair.load) for pair in pairs), strict=True):
        name, rows = choice[0][0], tuple(each for _, each in choice)
        yield setting(name, rows)
    aims, errors = [Aim(goal, pair.load) for pair in pairs], list[float]()
    while len(rows[0]) > 1 and len(errors) < _MENDED:
        seen = [_impacts_in(setting(name, rows), pair) for pair in pairs]
        errors.append(max(max_error(impacts, goal) for impacts in seen))
        if min(errors[-_PATIENCE:]) > min(errors):
            return
        each = zip(seen, pairs, aims, strict=True)
        if len(errors) == 1:
            aims = [aim.with_measured_load(impacts, pair.place.effective_mass) for impacts, pair, aim in each]
        else:
            aims = [aim.off_by(impacts, goal) for impacts, _, aim in each]
        rows = tuple(aim.rows(pair.band) for pair, aim in zip(pairs, aims, strict=True))
        yield setting(name, rows)


def _impacts_in(setting: ModelSetting, pair: _TunedPair) -> list[Impact]:
    """Some impacts of a pair over its band, in a model with a setting."""
    low, high = pair.band
    speeds = tuple(np.geomspace(low, high, _SEEN_SPEEDS if low < high else 1).tolist())
    with setting.open(pair.request) as model:
        launches = replace(pair.request, speeds=speeds, phases=_SEEN_PHASES).launches()
        return simulate.impacts_in(model, launches)


def _require_tunable(model: Any) -> None:
    """Refuse what keeps <pair>s from having the e that they are given."""
    if integrator_name(model) == "discrete":
        raise UserError(
            "model",
            "the integrator discrete, under which contacts do not keep a set e",
            "Euler, implicit, implicitfast or RK4",
            '<option integrator="implicitfast"/>',
        )
    if model.opt.enableflags & backend().mjtEnableBit.mjENBL_OVERRIDE:
        raise UserError(
            "model",
            "the flag override, which replaces the parameters of every contact",
            "contacts with parameters of their own",
            '<option><flag override="disable"/></option>',
        )


def _read_pair(model: Any, label: str, request: Request) -> _TunedPair:
    place = MujocoModel(_as_asked(model.__copy__(), request), label, None, request).place
    contact = contact_in_force(model, *place.contact.rows[0][2])
    slides = int(contact["condim"]) > 1 and contact["friction"][0] > 0
    h, rk4 = float(request.timestep or model.opt.timestep), integrator_name(model) == "RK4"
    load = Load.at_touch(place, h, rk4, slides)
    return _TunedPair(request, place, tuple(_geom_pairs(model, request)), load)


def _setting(source: Any, label: str, name: str, pairs: Sequence[tuple[_TunedPair, Rows]]) -> ModelSetting:
    spec, lines, notes = _spec(source), [], list[str]()
    model = spec.compile()
    names = _name_geoms(spec, model, [geoms for pair, _ in pairs for geoms in pair.geoms], notes)
    is_soft = any(rows[0].solimp[0] == MIN_IMPEDANCE for _, rows in pairs)
    for pair, rows in pairs:
        for geoms in pair.geoms:
            lines += _write_rows(spec, model, pair, geoms, (names[geoms[0]], names[geoms[1]]), rows)
    option = ""
    if is_soft and any(pair.load.slides for pair, _ in pairs):
        spec.option.cone, spec.option.impratio = backend().mjtCone.mjCONE_ELLIPTIC, IMPRATIO
        option = f'<option cone="elliptic" impratio="{IMPRATIO:g}"/>\n'
        notes.append(
            f"cone and impratio are of the whole model: elliptic and {IMPRATIO:g}, so that friction neither "
            "throws up what slides nor slips; other contacts change a little."
        )
    notes += [note for pair, _ in pairs for note in _mass_note(pair.place)]
    notes.append("friction, condim, margin, masses, step and integrator are as they were.")
    written, compiled = spec.to_xml(), spec.compile()

    def opened(request: Request) -> MujocoModel:
        return MujocoModel(_as_asked(compiled.__copy__(), request), label, None, request)

    def promised(text: str, promises: Sequence[Promise]) -> str:
        each = zip((pair.geoms for pair, _ in pairs), promises, (rows for _, rows in pairs), strict=True)
        for geoms, promise, rows in each:
            called = [(names[first], names[second]) for first, second in geoms]
            section = promise_lines(called, replace(promise, rows=len(rows)))
            head, end, tail = text.rpartition("</mujoco>")
            text = f"{head}{section}\n{end}{tail}" if end else f"{text}\n{section}"
        return text

    paste = f"{option}<contact>\n" + "\n".join(f"  {line}" for line in lines) + "\n</contact>"
    return ModelSetting(name, paste, written, tuple(dict.fromkeys(notes)), opened, promised)


def _mass_note(place: PairAtTouch) -> list[str]:
    model, bodies = place.pair.model, (place.pair.first.body, place.pair.second.body)
    if not all(model.body_weldid[body] for body in bodies):
        return []
    one = body_name(model, bodies[0])
    return [
        f"Both bodies move: the effective mass is {place.effective_mass:.4g} kg, less than that of {one!r}."
    ]


def _write_rows(
    spec: Any, model: Any, pair: _TunedPair, geoms: tuple[int, int], names: tuple[str, str], rows: Rows
) -> list[str]:
    """Set or add the <pair>s of two geoms, one for each row, the first with friction; their lines."""
    before, place = contact_in_force(model, *geoms), pair.place
    first, second = (int(model.geom_bodyid[geom]) for geom in geoms)
    # MuJoCo's estimates of mass differ between links, though these bounce as one.
    share = estimated_mobility(model, first, second)
    share /= estimated_mobility(model, place.pair.first.body, place.pair.second.body)
    known = [p for p in spec.pairs if {p.geomname1, p.geomname2} == set(names)]
    for extra in known[1:]:
        spec.delete(extra)
    lines = []
    for i, row in enumerate(rows):
        is_soft = row.solimp[0] < 0.5
        values: dict[str, Any] = {
            "solref": [number * (share if is_soft else 1.0) for number in row.solref],
            "solimp": list(row.solimp),
        }
        if i > 0:
            values["condim"] = 1
        elif not known:
            friction = before["friction"]
            values["condim"] = int(before["condim"])
            values["friction"] = [friction[0], friction[0], friction[1], friction[2], friction[2]]
        if i == 0 and is_soft and pair.load.slides:
            values["solreffriction"] = [0.0, -_friction_damping(place, pair.load)]
        if row.adhesion:
            values["adhesion"] = row.adhesion
        if place.contact.onset or known:
            values |= {"margin": place.contact.onset, "gap": 0.0}
        element = known[0] if known and i == 0 else spec.add_pair(geomname1=names[0], geomname2=names[1])
        lines.append(_set(element, names, values))
    return lines


def _set(element: Any, names: tuple[str, str], values: dict[str, Any]) -> str:
    """Set a <pair>'s attributes; its line."""
    for name, value in values.items():
        field = getattr(element, name)
        if isinstance(value, list):
            field[: len(value)] = value
        else:
            setattr(element, name, value)
    attributes = " ".join(
        f'{name}="{_numbers(value) if isinstance(value, list) else f"{value:g}"}"'
        for name, value in values.items()
    )
    first, second = (quoteattr(name) for name in names)
    return f"<pair geom1={first} geom2={second} {attributes}/>"


def _friction_damping(place: PairAtTouch, load: Load) -> float:
    """1/s, of friction rows that together stop a slip in one step, along the way that slides most easily."""
    model, data = place.pair.model, backend().MjData(place.pair.model)
    data.qpos[:] = place.qpos
    backend().mj_forward(model, data)
    normal = place.contact.normal
    across = np.linalg.svd(normal[None])[2][1:]
    rows = np.array([place.pair.approach_row(data, place.contact.point, way) for way in across])
    mobility = rows @ np.array([response(model, data, row) for row in rows]).T
    weight = MIN_IMPEDANCE / (1.0 - MIN_IMPEDANCE) * IMPRATIO * load.strength
    weight *= place.effective_mass * float(np.linalg.eigvalsh(mobility)[-1])
    return MIN_IMPEDANCE * (1.0 + weight) / max(weight, 1e-3) / load.timestep


def _name_geoms(spec: Any, model: Any, geoms: Sequence[tuple[int, int]], notes: list[str]) -> dict[int, str]:
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
    geoms = [each for each in geoms if explicit_pairs(model, each) or not collision_filter(model, *each)]
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
        spec = mujoco.MjSpec.from_file(str(source))
        folder = Path(source).parent
        if any(asset.file for asset in (*spec.meshes, *spec.hfields, *spec.textures, *spec.skins)):
            # The model that is written may stand elsewhere.
            spec.meshdir = str((folder / spec.meshdir).resolve())
            spec.texturedir = str((folder / spec.texturedir).resolve())
        return spec
    got = str(source) if isinstance(source, str | Path) else f"a {type(source).__name__}"
    raise UserError("model", got, "an MJCF file or an MjSpec, which can be written")


def _label(source: Any) -> str:
    is_file = isinstance(source, str | Path) and not str(source).lstrip().startswith("<")
    return Path(source).name if is_file else "model"
