"""Contact parameters for pairs in a user's own MuJoCo model, as <pair>
elements, and the model with them.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, can_pull
from hcbench.engines.mujoco.model.bodies import (
    FREE_DOFS,
    explicit_pairs,
    integrator_name,
    masks_match,
)
from hcbench.engines.mujoco.model.find_pair import contact_in_force, find_pair
from hcbench.engines.mujoco.model.open import as_requested, load
from hcbench.engines.mujoco.model.promises import option_in_force, promise_lines
from hcbench.engines.mujoco.model.row_search import RowSearch, starting_rows
from hcbench.engines.mujoco.model.speed_shares import has_more_than_contacts
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.model.write_pairs import (
    NO_BOUNCE,
    ONE_STEP,
    Load,
    PairToTune,
    Rows,
    colliding_geoms,
    label_of,
    mass_note,
    needed_impratio,
    one_step,
    row_choices,
    spec_of,
    texts_of,
    written,
)
from hcbench.laws.restitution import RestitutionCurve
from hcbench.sim.model_under_test import ModelSetting, Output, Request, Texts
from hcbench.sim.promise import Promise
from hcbench.sim.rest import Standing
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

# The attitudes in which a loose body can meet a face: on its own faces, edges and vertices.

# Directions in a geom that point at the other body, by shape: see `_ways_of_shape`.
_BOX = {"face": (0.0, 0.0, 1.0), "edge": (0.0, 1.0, 1.0), "vertex": (1.0, 1.0, 1.0)}
_ROUND = {"face": (0.0, 0.0, 1.0), "side": (1.0, 0.0, 0.0), "rim": (1.0, 0.0, 1.0)}
_NEAR = 1e-3  # m


def attitudes(model: Any, label: str, state: Any, request: Request) -> list[tuple[str, Request]]:
    """Ways in which a pair can meet: (attitude, request) of each; one of ("", request) where there
    is only one.

    model: compiled MjModel.
    label: its name in errors.
    state: MjData to start from, or None.
    Attitudes are "face", "edge" and "vertex" of a box, "face", "side" and "rim" of a cylinder. A
    body of one box or cylinder, on a free joint of its own, has several against a flat geom of what
    stands still, where nothing else touches it. The requests differ in their pose, qpos in m and
    quaternions.
    Raises UserError or SceneError where the pair cannot be brought to touch.
    """
    placed = MujocoModel(model, label, state, request)
    # The geom of the body that moves, and what it meets.
    geom, other = placed.place.contact.geoms
    if int(model.geom_bodyid[geom]) != placed.place.pair.first.body:
        geom, other = other, geom
    ways = _ways_of_shape(int(model.geom_type[geom]))
    can_turn = (
        not request.pose
        and _is_flat_and_fixed(model, other)
        and _is_loose(model, int(model.geom_bodyid[geom]))
        and not _is_touched(model, placed.start, geom, other)
    )
    if not ways or not can_turn:
        return [("", request)]
    turned = []
    for name, way in ways.items():
        qpos = _turned(placed, geom, way)
        pose = (("qpos", tuple(qpos.tolist())),)
        turned.append((name, replace(request, pose=pose)))
    return turned


def _ways_of_shape(kind: int) -> dict[str, tuple[float, float, float]]:
    """Directions in a geom of this type that point at the other body, by attitude; {} for a type
    that has one attitude only. They are in half sizes along the geom's own axes.
    """
    kinds = backend().mjtGeom
    return {int(kinds.mjGEOM_BOX): _BOX, int(kinds.mjGEOM_CYLINDER): _ROUND}.get(kind, {})


def _is_flat_and_fixed(model: Any, geom: int) -> bool:
    """Say whether a geom is a plane or a box that stands still."""
    kinds = backend().mjtGeom
    is_flat = int(model.geom_type[geom]) in (int(kinds.mjGEOM_PLANE), int(kinds.mjGEOM_BOX))
    return is_flat and not model.body_weldid[model.geom_bodyid[geom]]


def _turned(placed: MujocoModel, geom: int, way: tuple[float, float, float]) -> Floats:
    """qpos of the model with its loose body turned so that a part of its surface points at the other
    body, (nq,), and backed off.

    placed: the model, with the pair at touch.
    geom: number of the loose body's geom.
    way: direction to that part, in half sizes along the geom's own axes: (0, 0, 1) is its upper
    face, (1, 1, 1) a vertex of a box.
    """
    model = placed.model
    start = placed.start
    normal = placed.place.contact.normal
    half_sizes = model.geom_size[geom]
    if int(model.geom_type[geom]) == int(backend().mjtGeom.mjGEOM_CYLINDER):
        # A cylinder has its radius first and half its length second.
        radius, half_length, _ = half_sizes
        half_sizes = np.array([radius, radius, half_length])
    data = copy.copy(start)
    backend().mj_kinematics(model, data)
    frame = data.geom_xmat[geom].reshape(3, 3)
    # The way in the world, at the start, and the turn that leads it into the normal.
    way_now = frame @ _unit(half_sizes * np.array(way))
    turn = _turn(way_now, normal)
    # A free joint in qpos: position (3), then quaternion w x y z.
    address = int(model.jnt_qposadr[model.body_jntadr[model.geom_bodyid[geom]]])
    attitude = slice(address + 3, address + 7)
    qpos: Floats = start.qpos.copy()
    # Backed off by its bounding radius: no attitude starts inside the other body.
    qpos[address : address + 3] -= model.geom_rbound[geom] * normal
    backend().mju_mulQuat(qpos[attitude], turn, start.qpos[attitude])
    return qpos


def _is_loose(model: Any, body: int) -> bool:
    """Say whether a body has one geom and a free joint, and no other body hangs on it."""
    tree = np.flatnonzero(model.body_rootid == body)
    return (
        len(tree) == 1
        and int(model.body_geomnum[body]) == 1
        and int(model.body_dofnum[body]) == FREE_DOFS
    )


def _is_touched(model: Any, start: Any, geom: int, other: int) -> bool:
    """Say whether a third geom touches a geom at the start, or is within _NEAR m of it.

    start: MjData of the start.
    geom, other: numbers of the geom, and of the one that it may touch. Only geoms count whose masks
    let them collide.
    """
    mujoco = backend()
    data = copy.copy(start)
    mujoco.mj_kinematics(model, data)
    ends = np.zeros(6)
    for third in range(model.ngeom):
        if third in (geom, other) or not masks_match(model, geom, third):
            continue
        if mujoco.mj_geomDistance(model, data, geom, third, _NEAR, ends) < _NEAR:
            return True
    return False


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _turn(start: Floats, end: Floats) -> Floats:
    """Quaternion w x y z, (4,), of the smallest turn from one unit vector, (3,), to another."""
    axis = np.cross(start, end)
    cosine = float(start @ end)
    # Half a turn: every axis across the start will do, and 1 + cosine
    # would vanish in the quaternion.
    if cosine < -1.0 + 1e-12:
        _, _, start_and_across = np.linalg.svd(start[None])
        return np.array([0.0, *start_and_across[1]])
    # (1 + cos, sin) of an angle is a multiple of (cos, sin) of its half, which a quaternion has.
    return _unit(np.array([1.0 + cosine, *axis]))


_Kind = tuple[object, ...]  # equal for pairs that are alike
# Degrees of freedom from which a model counts as a robot.
_HEAVY = 12
# Two contacts of one shape are alike within this share of their effective mass, and within so many
# m/s² of the acceleration of their approach.
_SAME_MASS = 0.1
_SAME_GRAVITY = 2.0


def attitudes_of(source: Any, request: Request) -> list[tuple[str, Request]]:
    """Ways in which a pair of a user's model can meet, such as the face, edge and vertex of a box:
    (attitude, request) of each; one of ("", request) where there is only one.

    source: as of `load`.
    Raises what `load` raises; UserError or SceneError where the pair cannot be brought to touch.
    """
    model, label, state = load(source, request)
    return attitudes(model, label, state, request)


def model_settings(
    source: Any,
    requests: Sequence[Request],
    goal: RestitutionCurve,
    was: Standing,
    version: tuple[int, ...] = (),
) -> Iterator[ModelSetting]:
    """Settings for all pairs at once, the simplest first; the last is searched for in the model.

    source: a file, MJCF text or an MjSpec.
    requests: of the pairs; several of one pair are its attitudes.
    goal: e over speed.
    was: the model at rest as it is.
    version: of MuJoCo that has to load it; () for any.

    Raises, as the settings are asked for, SceneError for a model that does not compile, UserError
    where a pair cannot be measured, the model cannot be written or no <pair> keeps its e, and
    SearchInterrupted with the best so far.
    """
    # Opened first as for a measurement, whose errors say what is wrong with a model.
    load(source, requests[0])
    model = spec_of(source).compile()
    label = label_of(source)
    attitudes_of_pair: dict[Any, list[Request]] = {}
    for request in requests:
        attitudes_of_pair.setdefault(request.pair, []).append(request)
    pairs = pairs_to_tune(model, label, list(attitudes_of_pair.values()))
    adhesive = can_pull(version)

    def setting(name: str, rows_of: Mapping[_Kind, Rows]) -> ModelSetting:
        """The setting of this name in which each pair has the rows of its kind."""
        return _setting(source, label, name, _with_rows(pairs, rows_of))

    # First those that need no search: by the first pair of each kind.
    leaders = {pair.like: pair for pair in reversed(pairs)}
    choices = [row_choices(goal, pair.band, pair.load, adhesive) for pair in leaders.values()]
    # Servos and damped joints of a robot take what a soft contact of many steps gives: only the
    # first choice is offered.
    is_eaten = model.nv > _HEAVY and has_more_than_contacts(model)
    most_choices = 1 if is_eaten else None
    # The kinds' choices go in step: (name, rows) of each kind, under one name.
    for choice in itertools.islice(zip(*choices, strict=True), most_choices):
        name, _ = choice[0]
        rows_of = {}
        for like, (_, rows) in zip(leaders, choice, strict=True):
            rows_of[like] = rows
        yield setting(name, rows_of)
    # Then one that `row_choices` leaves out where pairs slide: friction changes the e of a row of
    # one step, by how much the launches say.
    constant = goal.best_constant(*pairs[0].band)
    slides = any(pair.load.slides for pair in pairs)
    is_rk4 = any(pair.load.rk4 for pair in pairs)
    if slides and not is_eaten and not is_rk4 and constant >= NO_BOUNCE:
        rows_of = {pair.like: one_step(constant, pair.load.timestep) for pair in pairs}
        yield replace(setting(ONE_STEP, rows_of), slides=True)
    # Last the search, which reads the distance of the geoms.
    if all(math.isfinite(pair.place.gap) for pair in pairs):
        yield setting("stiff spring and damper", _searched(source, pairs, goal, was, adhesive))


def _searched(
    source: Any, pairs: Sequence[PairToTune], goal: RestitutionCurve, was: Standing, adhesive: bool
) -> dict[_Kind, Rows]:
    """Search the rows of each kind of pair in the user's model, one kind after the other; by
    `PairToTune.like`.

    source: a file, MJCF text or an MjSpec.
    pairs: all that get rows.
    goal: e over speed.
    was: the model at rest as it is.
    adhesive: whether rows may pull.
    Kinds that are still to be searched have the starting rows meanwhile, as a robot stands and
    bounces on all of its feet.
    Raises EngineFailed for a fatal error of MuJoCo's.
    """
    plain = spec_of(source).compile()
    rows_of: dict[_Kind, Rows] = {pair.like: starting_rows(adhesive) for pair in pairs}
    for like in rows_of:
        alike = [pair for pair in pairs if pair.like == like]
        spec = written(source, _with_rows(pairs, rows_of)).spec
        launched = list(alike[0].opened)
        # Two of the pairs speak for all of their kind: the first and the last.
        if len(alike) > 1:
            launched += alike[-1].opened
        set_rows = _row_setter(plain, pairs, rows_of, like)
        search = RowSearch(
            spec=spec, opened=launched, goal=goal, band=alike[0].band, was=was, set_rows=set_rows
        )
        rows_of[like] = search.best(adhesive)
    return rows_of


def _with_rows(
    pairs: Sequence[PairToTune], rows_of: Mapping[_Kind, Rows]
) -> list[tuple[PairToTune, Rows]]:
    """Each pair with the rows of its kind."""
    return [(pair, rows_of[pair.like]) for pair in pairs]


def _row_setter(
    plain: Any, pairs: Sequence[PairToTune], rows_of: Mapping[_Kind, Rows], like: _Kind
) -> Callable[[Any, Rows], None]:
    """Make a function (model, rows) that writes rows into the pairs of one kind in a compiled model,
    and leaves those of other kinds as they are.

    plain: the model as it is, whose cone and impratio hold where no row needs others.
    pairs: of every kind.
    rows_of: their rows by kind.
    like: the kind whose <pair>s the function writes.
    """
    # Every two geoms of the pairs of this kind.
    geoms_alike: list[tuple[int, int]] = []
    for pair in pairs:
        if pair.like == like:
            geoms_alike += pair.geoms

    def set_rows(model: Any, rows: Rows) -> None:
        """Write the rows into a compiled model, with the cone and impratio that all rows need."""
        tried = {**rows_of, like: rows}
        impratio = needed_impratio(plain, _with_rows(pairs, tried))
        if impratio > 0.0:
            model.opt.cone = int(backend().mjtCone.mjCONE_ELLIPTIC)
            model.opt.impratio = impratio
        else:
            model.opt.cone = plain.opt.cone
            model.opt.impratio = plain.opt.impratio
        for geoms in geoms_alike:
            # A <pair> for each row, in their order.
            for number, row in zip(explicit_pairs(model, geoms), rows, strict=True):
                model.pair_solref[number] = row.solref
                model.pair_solimp[number] = row.solimp

    return set_rows


def pairs_to_tune(
    model: Any, label: str, requests: Sequence[Sequence[Request]]
) -> list[PairToTune]:
    """Read the pairs of a user's model that are to be tuned; `like` is the same for those that can
    have the same rows, being of one shape and nearly one load.

    model: compiled.
    label: its name in errors.
    requests: of each pair, one for each attitude.
    Raises UserError for a model in which no <pair> keeps its e, UserError or SceneError where a
    pair cannot be measured.
    """
    _require_tunable(model)
    return _grouped([_read_pair(model, label, of_pair) for of_pair in requests])


def _require_tunable(model: Any) -> None:
    """Raise UserError for a model in which a <pair> does not have the e that it is given: under the
    integrator discrete, and with the flag that overrides every contact's parameters.
    """
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


def _read_pair(model: Any, label: str, requests: Sequence[Request]) -> PairToTune:
    """Read one pair of a user's model that is to be tuned, opened under each of its requests.

    model: compiled; only copies of it are changed.
    label: its name in errors.
    requests: of the pair, one for each attitude, one or more.

    Raises UserError or SceneError where the pair cannot be brought to touch, or has too many geoms.
    """
    opened = []
    for each in requests:
        asked = as_requested(model.__copy__(), each)
        opened.append(MujocoModel(asked, label, None, each))
    # All but the attitude is the same in each.
    request = requests[0]
    place = opened[0].place
    geoms = place.contact.geoms
    contact = contact_in_force(model, *geoms)
    # condim 1 has no friction; else the first number is the sliding μ.
    slides = int(contact["condim"]) > 1 and contact["friction"][0] > 0
    timestep = float(request.timestep or model.opt.timestep)
    load_at_touch = Load.at_touch(place, timestep, integrator_name(model) == "RK4", slides)
    # Type and sizes, m, of the two that touch.
    shapes = []
    for geom in geoms:
        size = model.geom_size[geom].round(6).tolist()
        shapes.append((int(model.geom_type[geom]), *size))
    # Exact here; `_grouped` also compares the loads, and puts a number in its place.
    like = (
        *shapes,
        len(place.contact.rows),
        *contact["friction"],
        contact["condim"],
        place.contact.onset,
    )
    return PairToTune(
        requests=tuple(requests),
        opened=tuple(opened),
        geoms=tuple(colliding_geoms(model, [find_pair(model, request)])),
        load=load_at_touch,
        like=like,
    )


def _grouped(pairs: Sequence[PairToTune]) -> list[PairToTune]:
    """The pairs with the same `like` for all of one shape and nearly one load, such as the feet of a
    robot: the index of the first pair that is alike, in a tuple.
    """
    grouped = []
    for pair in pairs:
        first_alike = next(number for number, other in enumerate(pairs) if _is_like(pair, other))
        grouped.append(replace(pair, like=(first_alike,)))
    return grouped


def _is_like(one: PairToTune, other: PairToTune) -> bool:
    """Say whether two pairs have one shape and contact, and nearly one load: one setting for both."""
    mass = one.place.effective_mass / other.place.effective_mass - 1.0
    gravity = one.place.gravity - other.place.gravity
    return one.like == other.like and abs(mass) < _SAME_MASS and abs(gravity) < _SAME_GRAVITY


def _setting(
    source: Any, label: str, name: str, pairs: Sequence[tuple[PairToTune, Rows]]
) -> ModelSetting:
    """Write rows into a copy of a user's model, and describe it as a setting: its notes, and how to
    open it and to write its texts.

    source: the user's model.
    label: its name in errors.
    name: the setting's, for the user.
    pairs: each pair with the rows that it gets.
    """
    made = written(source, pairs)
    notes = list(made.notes)
    for pair, _ in pairs:
        notes += mass_note(pair.place)
    notes.append(f"{made.kept}.")
    written_rows = itertools.chain.from_iterable(rows for _, rows in pairs)
    if any(row.adhesion for row in written_rows):
        notes.append(
            "The lines need MuJoCo 3.11 or later; --for mujoco@3.5 asks for lines without adhesion."
        )
    compiled = made.spec.compile()
    # Time step, integrator, cone and impratio under which all is tuned: the promise names them.
    first_pair, _ = pairs[0]
    option = option_in_force(as_requested(compiled.__copy__(), first_pair.requests[0]))

    def opened(request: Request) -> MujocoModel:
        """The model with the rows under a request, with its pair at touch."""
        return MujocoModel(as_requested(compiled.__copy__(), request), label, None, request)

    def texts(promises: Sequence[Promise], output: Output) -> Texts:
        """The lines to paste, the whole model with them, and the lines that a model includes.

        promises: one a pair, of what was measured.
        output: where the model and the included file are to be written. The whole is the user's own
        text where it can stay, else MuJoCo's.
        """
        sections = []
        for (pair, rows), promise in zip(pairs, promises, strict=True):
            names = [(made.names[first], made.names[second]) for first, second in pair.geoms]
            kept = replace(promise, rows=len(rows), option=option)
            section = promise_lines(names, kept)
            if section:
                sections.append(section)
        return texts_of(source, made, sections, output)

    return ModelSetting(name, tuple(dict.fromkeys(notes)), opened, texts, source=made.spec)
