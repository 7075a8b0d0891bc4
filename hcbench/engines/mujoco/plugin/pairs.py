"""Which pairs of a MuJoCo model a law is for, checked: names to ids, and what cannot work refused."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.model import collision_filter, geoms_of
from hcbench.errors import SettingError
from hcbench.laws import hertz
from hcbench.laws.contact_law import STEPS_PER_CONTACT, Friction, Law, coarse, contact_time, is_force
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim.names import suggest_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from hcbench.scene import Material

FORCE, RESTITUTION = 1, 2
LINEAR, CONSTANT = 1, 2  # readings of e that are not the law's own
FIXED, FREE, JOINTED = 0, 1, 2


class ContactAccuracyWarning(UserWarning):
    """The engine's own contact geometry of this pair is wrong by more than the law can bear."""


@dataclass(frozen=True, slots=True)
class PairSpec:
    """One attached pair, in the words of the C table: geom1 < geom2, or a tendon and a side of its range.

    alpha: α; α v_i = χ/(3/2) where own says that each impact has its own v_i; or e itself where the reading
    is CONSTANT.
    """

    kind: int
    geom1: int
    geom2: int
    tendon: int
    side: int
    slot: int
    reading: int
    own: int
    stiffness: float
    alpha: float
    exponent: float
    static_friction: float
    dynamic_friction: float
    slip_speed: float

    @property
    def key(self) -> tuple[int, int, int, int]:
        """Equal for equal pairs, and in the order of the table: tendons last."""
        return (0 if self.tendon < 0 else 1, self.geom1, self.geom2, 2 * self.tendon + (self.side > 0))


def alpha_of(law: Law) -> float:
    """What `PairSpec.alpha` holds."""
    if isinstance(law, TouchSpeedLaw):
        return law.chi / 1.5
    return law.restitution if isinstance(law, ConstantRestitution) else law.alpha


def spec(law: Law, friction: Friction | None, slot: int, key: tuple[int, int, int, int]) -> PairSpec:
    """The pair (geom1, geom2, tendon, side) of a law."""
    return PairSpec(
        kind=FORCE if is_force(law) else RESTITUTION,
        geom1=key[0],
        geom2=key[1],
        tendon=key[2],
        side=key[3],
        slot=slot,
        reading=CONSTANT
        if isinstance(law, ConstantRestitution)
        else int(isinstance(law, Restitution) and law.reading == "linear"),
        own=int(isinstance(law, TouchSpeedLaw)),
        stiffness=law.stiffness if is_force(law) else 0.0,
        alpha=alpha_of(law),
        exponent=law.exponent if is_force(law) else 1.5,
        static_friction=friction.static if friction else 0.0,
        dynamic_friction=friction.dynamic if friction else 0.0,
        slip_speed=friction.slip_speed if friction else 1.0,
    )


def identify(model: Any, kind: str, what: str | int) -> int:
    """Id of a "geom", "body" or "tendon" given by name or id; SettingError names what is there instead."""
    count = int(getattr(model, f"n{kind}"))
    if isinstance(what, (int, np.integer)) and not isinstance(what, bool):
        if 0 <= what < count:
            return int(what)
        raise SettingError(f"{kind} {what}", "not in the model", f"an id from 0 to {count - 1}")
    found = _id_of(model, kind, what) if isinstance(what, str) else -1
    if found >= 0:
        return found
    expected, nearest = suggest_names(str(what), (getattr(model, kind)(i).name for i in range(count)))
    todo = f"{nearest} Unnamed ones go by id, 0 to {count - 1}".lstrip()
    raise SettingError(f"{kind} {what!r}", "not in the model", expected, todo)


def _id_of(model: Any, kind: str, name: str) -> int:
    import mujoco

    return (
        int(mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name)) if name else -1
    )


def body_kinds(model: Any) -> list[int]:
    """FIXED, FREE or JOINTED for each body: a FREE one is a rigid body of its own, nothing hangs on it."""
    import mujoco

    free = int(mujoco.mjtJoint.mjJNT_FREE)
    kinds = []
    for body in range(model.nbody):
        if model.body_weldid[body] == 0:
            kinds.append(FIXED)
            continue
        dof = int(model.body_dofadr[body])
        alone = (
            model.body_parentid[body] == 0
            and model.body_jntnum[body] == 1
            and model.jnt_type[model.body_jntadr[body]] == free
            and not (model.body_parentid == body).any()
            and not model.dof_armature[dof : dof + 6].any()
        )
        kinds.append(FREE if alone else JOINTED)
    return kinds


def pairs_between(model: Any, body1: str | int, body2: str | int) -> list[tuple[int, int]]:
    """All pairs of geoms of two bodies (names or ids) that the model lets collide."""
    first, second = (geoms_of(model, identify(model, "body", body)) for body in (body1, body2))
    return [(g1, g2) for g1 in first for g2 in second if not collision_filter(model, g1, g2)]


def pairs_of(model: Any, body: str | int) -> list[tuple[int, int]]:
    """All pairs of one body's geoms (name or id) with all others that the model lets them collide with."""
    own = geoms_of(model, identify(model, "body", body))
    return [
        (g, o) for g in own for o in range(model.ngeom) if o not in own and not collision_filter(model, g, o)
    ]


def hertz_stiffness(
    model: Any, geom1: str | int, geom2: str | int, material1: Material, material2: Material
) -> float:
    """K of F = k x^(3/2) in N/m^1.5, eq. (5), from the radii of two geoms: spheres, or one and a plane."""
    import mujoco

    sphere, plane = int(mujoco.mjtGeom.mjGEOM_SPHERE), int(mujoco.mjtGeom.mjGEOM_PLANE)
    radii = []
    for name in (geom1, geom2):
        geom = identify(model, "geom", name)
        kind = int(model.geom_type[geom])
        if kind not in (sphere, plane):
            raise SettingError(f"geom {name!r}", "neither a sphere nor a plane", "a stiffness of your own")
        radii.append(float(model.geom_size[geom, 0]) if kind == sphere else math.inf)
    return hertz.spheres(radii[0], radii[1], material1, material2).stiffness


def resolve(
    model: Any, pairs: Iterable[Sequence[str | int]], tendons: Iterable[str | int]
) -> list[tuple[int, int, int, int]]:
    """(geom1, geom2, tendon, side) of each pair; SettingError for what cannot be a pair."""
    keys: list[tuple[int, int, int, int]] = []
    for pair in pairs:
        if isinstance(pair, str) or len(pair) != 2:
            raise SettingError("contact pair", repr(pair), "two geoms, such as ('ball', 'plate')")
        g1, g2 = sorted(identify(model, "geom", geom) for geom in pair)
        _check_geoms(model, g1, g2, f"contact pair {tuple(pair)!r}")
        keys.append((g1, g2, -1, 0))
    for name in tendons:
        tendon = identify(model, "tendon", name)
        if not model.tendon_limited[tendon]:
            raise SettingError(
                f"tendon {name!r}", "has no limit", "a tendon with a range, whose end is the contact"
            )
        keys.append((-1, -1, tendon, 1))
    seen: set[tuple[int, int, int, int]] = set()
    for key in keys:
        if key in seen:
            raise SettingError("contact pair", f"{named(model, key)} given twice", "each pair once")
        seen.add(key)
    if not keys:
        raise SettingError("contact pairs", "none", "at least one pair of geoms")
    return keys


def named(model: Any, key: tuple[int, int, int, int]) -> str:
    """A pair in words."""
    if key[2] >= 0:
        return f"tendon {model.tendon(key[2]).name or key[2]!r}"
    return " and ".join(repr(model.geom(g).name or g) for g in key[:2])


def _check_geoms(model: Any, g1: int, g2: int, slot: str) -> None:
    b1, b2 = int(model.geom_bodyid[g1]), int(model.geom_bodyid[g2])
    if model.body_weldid[b1] == model.body_weldid[b2]:
        raise SettingError(slot, "both geoms are fixed to the same body", "geoms that can move apart")
    if any(int(model.geom_type[g]) == 0 for g in (g1, g2)) and model.geom_type[g1] == model.geom_type[g2]:
        raise SettingError(slot, "two planes", "a pair that MuJoCo has a collision function for")


def check_step(model: Any, law: Law, keys: Iterable[tuple[int, int, int, int]], speed: float) -> None:
    """Refuse a step that cannot resolve a contact of the force law at `speed` m/s."""
    if not is_force(law):
        return
    inverse = {}
    for key in keys:
        if key[2] >= 0:
            inverse[key] = float(model.tendon_invweight0[key[2]])
        else:
            inverse[key] = sum(float(model.body_invweight0[model.geom_bodyid[g], 0]) for g in key[:2])
        if not inverse[key] > 0:
            raise SettingError(f"contact pair {named(model, key)}", "nothing can move", "a body with a joint")
    quickest = max(inverse, key=inverse.__getitem__)  # the lightest
    lasts, step = contact_time(law, 1.0 / inverse[quickest], speed), float(model.opt.timestep)
    if step > lasts / STEPS_PER_CONTACT:
        raise SettingError(
            f"timestep {step:g} s",
            f"too coarse for the force law: {named(model, quickest)} touch for {lasts:.2g} s"
            f" at {speed:g} m/s",
            f"a step of {lasts / 20:.1g} s (at most {lasts / STEPS_PER_CONTACT:.1g} s)",
            f"For coarser steps attach {coarse(law)} instead",
        )


def warn_of_shapes(model: Any, keys: Iterable[tuple[int, int, int, int]]) -> None:
    """Warn of geoms whose contact MuJoCo reports less exactly than the law needs, with the error's size."""
    import mujoco

    kinds = {
        int(mujoco.mjtGeom.mjGEOM_MESH): ("a mesh", _mesh_error),
        int(mujoco.mjtGeom.mjGEOM_HFIELD): ("a height field", _hfield_error),
        int(mujoco.mjtGeom.mjGEOM_SDF): ("a signed distance field", _sdf_error),
    }
    for geom in sorted({g for key in keys for g in key[:2] if g >= 0}):
        words, error = kinds.get(int(model.geom_type[geom]), ("", None))
        if error is None:
            continue
        warnings.warn(
            f"geom {model.geom(geom).name or geom!r} is {words}: MuJoCo's contact with it is off by about"
            f" {error(model, geom):.1g} m, and steel at these speeds penetrates 1e-6 to 2e-5 m. Use primitive"
            " geoms (sphere, plane, capsule, cylinder, box) or a tendon's limit where that matters",
            ContactAccuracyWarning,
            stacklevel=4,
        )


def _mesh_error(model: Any, geom: int) -> float:
    """Typical sagitta of the facets against the round surface that they stand for, m."""
    mesh = int(model.geom_dataid[geom])
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]].astype(float)
    faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    radius = float(np.linalg.norm(vertices, axis=1).max())
    return float(np.median(edges)) ** 2 / (8.0 * radius)


def _hfield_error(model: Any, geom: int) -> float:
    """Typical distance of a cell's facets from the surface through its samples, m."""
    field = int(model.geom_dataid[geom])
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = int(model.hfield_adr[field])
    data = model.hfield_data[start : start + rows * columns].reshape(rows, columns).astype(float)
    bends = [np.abs(np.diff(data, 2, axis=axis)).mean() for axis in (0, 1) if data.shape[axis] > 2]
    return float(max(bends, default=0.0) * model.hfield_size[field, 2] / 8.0)


def _sdf_error(model: Any, geom: int) -> float:
    """What MuJoCo misses of the overlap of a ball with its own bowl plug-in: 9e-5 m at a rim of 1.8 m."""
    return 5e-5 * float(model.geom_rbound[geom])
