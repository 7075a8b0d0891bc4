"""The pair of geoms that a request means, and all that a MuJoCo model
lets collide, with their poses.
"""

import math
from typing import Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import (
    approach_row,
    body_name,
    collision_filter,
    effective_mass,
    explicit_pairs,
    geom_name,
)
from hcbench.engines.mujoco.model.find_pair import moving_joints, named_pair, only_pair
from hcbench.engines.mujoco.model.pair import ContactPair, NamedGeoms
from hcbench.engines.mujoco.model.start_pose import start_pose
from hcbench.sim.candidate_pairs import CandidatePair, choice_error, in_order
from hcbench.sim.model_under_test import Request
from hcbench.system.text import joined_names
from hcbench.terms.impact import Floats

# Two geoms, in ascending order.
_Geoms = tuple[int, ...]
# In masses of the whole model: along a normal of a larger effective mass
# only round-off moves the two.
_HEAVIEST = 1e4
# Keyframes that are looked at: each takes a collision detection of the whole model.
_POSES_MAX = 50


def find_pair(model: Any, request: Request, state: Any = None) -> ContactPair:
    """The pair of a request; without names, the only body that moves and the only thing it can meet.

    Raises UserError for names that mean no pair, and with a list where there is a choice.
    """
    names = request.pair or only_pair(model)
    if names is None:
        raise choice_error(list_pairs(model, request, state))
    return named_pair(model, names)


def list_pairs(model: Any, request: Request, state: Any = None) -> list[CandidatePair]:
    """Every pair that can meet; those that touch at the start first."""
    mujoco = backend()
    with captured_warnings():
        data, _ = start_pose(model, request, state)
        mujoco.mj_forward(model, data)
        touching = _touching(model)
        here = {tuple(sorted(c.geom.tolist())) for c in data.contact if c.dist <= 0.0}
        return in_order(
            [_described(model, data, a, b, here, touching) for a, b in _collisions(model)]
        )


def _collisions(model: Any) -> list[tuple[int, int]]:
    """Geoms that MuJoCo collides, the one that moves, or moves more freely, first."""
    types = model.geom_contype
    affinities = model.geom_conaffinity
    # (ngeom, ngeom): MuJoCo asks for a common bit of one's type and the
    # other's affinity, either way.
    match = (types[:, None] & affinities[None, :]) | (types[None, :] & affinities[:, None])
    meet = set()
    for first, second in np.argwhere(np.triu(match, 1)).tolist():
        if not collision_filter(model, first, second):
            meet.add((first, second))
    for one, other in zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True):
        meet.add((min(one, other), max(one, other)))
    ordered = []
    for first, second in sorted(meet):
        if _rank(model, first) <= _rank(model, second):
            ordered.append((first, second))
        else:
            ordered.append((second, first))
    return ordered


def _rank(model: Any, geom: int) -> tuple[bool, int]:
    body = int(model.geom_bodyid[geom])
    return not model.body_weldid[body], int(model.geom_type[geom] == backend().mjtGeom.mjGEOM_PLANE)


def _touching(model: Any) -> dict[_Geoms, list[str]]:
    """Names of the poses in which two geoms touch: qpos0 and keyframes."""
    names_of: dict[_Geoms, list[str]] = {}
    poses = ["qpos0", *(str(i) for i in range(min(model.nkey, _POSES_MAX)))]
    for key in poses:
        data, name = start_pose(model, Request(key=key))
        backend().mj_fwdPosition(model, data)
        for contact in data.contact:
            names = names_of.setdefault(tuple(sorted(contact.geom.tolist())), [])
            if contact.dist <= 0.0 and name not in names:
                names.append(name)
    return names_of


def _described(
    model: Any, data: Any, a: int, b: int, here: set[_Geoms], touching: dict[_Geoms, list[str]]
) -> CandidatePair:
    """Two geoms as a candidate: names, effective mass (kg), signed
    distance (m) and contact in force.

    here: pairs of geoms that touch in `data`.
    touching: names of the poses in which they do.
    """
    body_a = int(model.geom_bodyid[a])
    body_b = int(model.geom_bodyid[b])
    name_a = geom_name(model, a)
    name_b = geom_name(model, b)
    first = NamedGeoms(name_a, body_a, (a,))
    second = NamedGeoms(name_b, body_b, (b,))
    near = ContactPair(model, first, second).nearest(data)
    key = tuple(sorted((a, b)))
    normal = near.normal
    # The nearest points coincide; the effective mass is the same for either
    # sign of the contact's normal.
    if not normal.any():
        for contact in data.contact:
            if tuple(sorted(contact.geom.tolist())) == key:
                normal = contact.frame[:3]
                break
    distance = math.nan
    mass = math.nan
    if np.isfinite(near.distance):
        distance = float(near.distance)
        if normal.any():
            mass = _mass_along(model, data, (body_a, body_b), near.point, normal)
    joints = moving_joints(model, body_a) + moving_joints(model, body_b)
    moved = "nothing"
    if joints:
        moved = joints[0].description
    return CandidatePair(
        bodies=(body_name(model, body_a), body_name(model, body_b)),
        geoms=(name_a, name_b),
        types=(_shape(model, a), _shape(model, b)),
        pair=joined_names([_unmistakable(model, a), _unmistakable(model, b)]),
        joint=moved,
        effective_mass=mass,
        distance=distance,
        touching=key in here,
        touching_in=tuple(touching.get(key, ())),
        settings=contact_in_force(model, a, b),
    )


def _shape(model: Any, geom: int) -> str:
    """A geom's type as XML spells it."""
    return str(backend().mjtGeom(int(model.geom_type[geom])).name).removeprefix("mjGEOM_").lower()


def _mass_along(
    model: Any, data: Any, bodies: tuple[int, int], point: Floats, normal: Floats
) -> float:
    """Effective mass of two bodies along a normal, kg; NaN where no joint moves one along it."""
    first, second = bodies
    mass = effective_mass(model, data, approach_row(model, data, first, second, point, normal))
    heaviest = _HEAVIEST * float(model.body_mass.sum())
    return mass if mass < heaviest else math.nan


def _unmistakable(model: Any, geom: int) -> str:
    """Name of a geom, with the word "geom:" before it if a body has the same name."""
    name = str(geom_name(model, geom))
    bodies = {body_name(model, body) for body in range(model.nbody)}
    return f"geom:{name}" if name in bodies or "," in name else name


def contact_in_force(model: Any, a: int, b: int) -> dict[str, Any]:
    """solref, solimp, friction (sliding, torsional, rolling) and condim of two geoms' contact.

    A <pair> has its own; else they are MuJoCo's mixture of the two geoms'
    (Modeling, "Contact parameters").
    """
    if pairs := explicit_pairs(model, (a, b)):
        number = pairs[0]
        return {
            "solref": model.pair_solref[number].tolist(),
            "solimp": model.pair_solimp[number].tolist(),
            "friction": model.pair_friction[number][:3].tolist(),
            "condim": model.pair_dim[number].tolist(),
        }
    one, two = (a, b) if model.geom_priority[a] >= model.geom_priority[b] else (b, a)
    if model.geom_priority[one] > model.geom_priority[two]:
        # The geom of higher priority decides alone.
        two = one
    both = [one, two]
    # mjMINVAL, as MuJoCo keeps a sum of two zeros from dividing by 0.
    weights = np.maximum(model.geom_solmix[both], 1e-15)
    share = float(weights[0] / weights.sum())
    solrefs = model.geom_solref[both]
    solimps = model.geom_solimp[both]
    is_direct = (solrefs[:, 0] <= 0.0).any()
    # MuJoCo averages two time constants, but takes the smaller of each
    # number where one is in direct form.
    solref = solrefs.min(axis=0) if is_direct else share * solrefs[0] + (1 - share) * solrefs[1]
    solimp = share * solimps[0] + (1 - share) * solimps[1]
    return {
        "solref": solref.tolist(),
        "solimp": solimp.tolist(),
        "friction": model.geom_friction[both].max(axis=0).tolist(),
        "condim": model.geom_condim[both].max().tolist(),
    }
