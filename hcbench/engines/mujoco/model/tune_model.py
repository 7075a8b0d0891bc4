"""Contact parameters for pairs in a user's own MuJoCo model, as <pair> elements, and the model with them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from hcbench.engines.mujoco.backend import backend, can_pull
from hcbench.engines.mujoco.model.attitudes import attitudes
from hcbench.engines.mujoco.model.bodies import collision_filter, explicit_pairs, integrator_name
from hcbench.engines.mujoco.model.list_pairs import contact_in_force, find_pair
from hcbench.engines.mujoco.model.open import load
from hcbench.engines.mujoco.model.row_search import RowSearch, starting_rows
from hcbench.engines.mujoco.model.speed_shares import has_more_than_contacts
from hcbench.engines.mujoco.model.tune_rows import Load, row_choices
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.model.write_pairs import PairToTune, Rows, mass_note, needed_impratio, written
from hcbench.engines.mujoco.model.written_model import included, label_of, own_text, spec_of, whole_text
from hcbench.engines.mujoco.scene.promises import option_in_force, promise_lines
from hcbench.errors import UserError
from hcbench.laws.restitution import RestitutionCurve
from hcbench.sim.model_under_test import ModelSetting, Output, Request, Texts
from hcbench.sim.promise import Promise
from hcbench.sim.standing import Standing

_PAIRS_MAX = 200
_HEAVY = 12  # degrees of freedom
_SAME_MASS, _SAME_GRAVITY = 0.1, 2.0  # share, and m/s², within which two contacts of one shape are alike


def attitudes_of(source: Any, request: Request) -> list[tuple[str, Request]]:
    """(attitude, request) of each way in which the two can meet."""
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

    requests: several of a pair are its attitudes. was: the model at rest as it is. version: of MuJoCo that
    has to load it; () for any.
    """
    load(source, requests[0])  # says what is wrong with a model that is
    model, label = spec_of(source).compile(), label_of(source)
    _require_tunable(model)
    asked = dict.fromkeys(request.pair for request in requests)
    pairs = _grouped([_read_pair(model, label, [r for r in requests if r.pair == pair]) for pair in asked])
    adhesive = can_pull(version)

    def setting(name: str, rows: Sequence[Rows]) -> ModelSetting:
        return _setting(source, label, name, list(zip(pairs, rows, strict=True)))

    leaders = {pair.like: pair for pair in reversed(pairs)}
    # Servos and damped joints take what a soft contact of many steps gives.
    eaten = model.nv > _HEAVY and has_more_than_contacts(model)
    choices = [row_choices(goal, pair.band, pair.load, adhesive) for pair in leaders.values()]
    for choice in itertools.islice(zip(*choices, strict=True), 1 if eaten else None):
        rows = dict(zip(leaders, (each for _, each in choice), strict=True))
        yield setting(choice[0][0], [rows[pair.like] for pair in pairs])
    if all(math.isfinite(pair.place.gap) for pair in pairs):
        rows_of = _searched(source, pairs, goal, was, adhesive)
        yield setting("stiff spring and damper", [rows_of[pair.like] for pair in pairs])


def _searched(
    source: Any, pairs: Sequence[PairToTune], goal: RestitutionCurve, was: Standing, adhesive: bool
) -> dict[tuple[object, ...], Rows]:
    """Rows for each kind of pair, rows_of in the model one after the other."""
    plain = spec_of(source).compile()
    rows_of: dict[tuple[object, ...], Rows] = {pair.like: starting_rows(adhesive) for pair in pairs}
    for like in rows_of:
        alike = [pair for pair in pairs if pair.like == like]
        spec = written(source, [(pair, rows_of[pair.like]) for pair in pairs]).spec

        def set_rows(model: Any, rows: Rows, alike: Sequence[PairToTune] = alike, like: Any = like) -> None:
            tried = [(pair, rows if pair.like == like else rows_of[pair.like]) for pair in pairs]
            if (impratio := needed_impratio(plain, tried)) > 0.0:
                model.opt.cone, model.opt.impratio = int(backend().mjtCone.mjCONE_ELLIPTIC), impratio
            else:
                model.opt.cone, model.opt.impratio = plain.opt.cone, plain.opt.impratio
            for geoms in (geoms for pair in alike for geoms in pair.geoms):
                for number, row in zip(explicit_pairs(model, geoms), rows, strict=True):
                    model.pair_solref[number], model.pair_solimp[number] = row.solref, row.solimp

        seen = [*alike[0].opened, *(alike[-1].opened if len(alike) > 1 else ())]
        rows_of[like] = RowSearch(spec, seen, goal, alike[0].band, was, set_rows).best(adhesive)
    return rows_of


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


def _read_pair(model: Any, label: str, requests: Sequence[Request]) -> PairToTune:
    opened = tuple(MujocoModel(_as_asked(model.__copy__(), r), label, None, r) for r in requests)
    request, place = requests[0], opened[0].place
    first, second = place.contact.rows[0][2]
    contact = contact_in_force(model, first, second)
    slides = int(contact["condim"]) > 1 and contact["friction"][0] > 0
    h, rk4 = float(request.timestep or model.opt.timestep), integrator_name(model) == "RK4"
    load = Load.at_touch(place, h, rk4, slides)
    shapes = [(int(model.geom_type[g]), *model.geom_size[g].round(6).tolist()) for g in (first, second)]
    points, onset = len(place.contact.rows), place.contact.onset
    like = (*shapes, points, *contact["friction"], contact["condim"], onset)
    return PairToTune(tuple(requests), opened, tuple(_geom_pairs(model, request)), load, like)


def _grouped(pairs: Sequence[PairToTune]) -> list[PairToTune]:
    """Pairs with one `like` for all that have the same load, too, as the four feet of a robot."""
    return [replace(a, like=(next(i for i, b in enumerate(pairs) if _is_like(a, b)),)) for a in pairs]


def _is_like(one: PairToTune, other: PairToTune) -> bool:
    mass = one.place.effective_mass / other.place.effective_mass - 1.0
    gravity = one.place.gravity - other.place.gravity
    return one.like == other.like and abs(mass) < _SAME_MASS and abs(gravity) < _SAME_GRAVITY


def _setting(source: Any, label: str, name: str, pairs: Sequence[tuple[PairToTune, Rows]]) -> ModelSetting:
    made = written(source, pairs)
    notes = [*made.notes, *(note for pair, _ in pairs for note in mass_note(pair.place))]
    notes.append("friction, condim, margin, masses, step and integrator are as they were.")
    if any(row.adhesion for _, rows in pairs for row in rows):
        notes.append("The lines need MuJoCo 3.11 or later; --for mujoco@3.5 asks for lines without adhesion.")
    compiled = made.spec.compile()
    option = option_in_force(_as_asked(compiled.__copy__(), pairs[0][0].requests[0]))

    def opened(request: Request) -> MujocoModel:
        return MujocoModel(_as_asked(compiled.__copy__(), request), label, None, request)

    def texts(promises: Sequence[Promise], output: Output) -> Texts:
        each = zip((pair.geoms for pair, _ in pairs), promises, (rows for _, rows in pairs), strict=True)
        sections = []
        for geoms, promise, rows in each:
            names = [(made.names[a], made.names[b]) for a, b in geoms]
            sections.append(promise_lines(names, replace(promise, rows=len(rows), option=option)))
        paste = "\n".join(filter(None, [made.lines, *sections]))
        lines = f'<include file="{output.include}"/>' if output.include else paste
        whole = own_text(source, output.folder, lines) if made.own else ""
        if not whole:
            head, end, tail = whole_text(made.spec, output.folder).rpartition("</mujoco>")
            whole = "\n".join([head, *filter(None, sections), f"{end}{tail}"])
        return Texts(paste, whole, included(paste))

    return ModelSetting(name, tuple(dict.fromkeys(notes)), opened, texts)


def _called(geoms: Sequence[tuple[int, int]], names: dict[int, str]) -> list[tuple[str, str]]:
    return [(names[first], names[second]) for first, second in geoms]


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
