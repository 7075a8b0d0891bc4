"""Many balls in one MuJoCo model, each with the same bits as alone.

MuJoCo's cost per step is mostly its own housekeeping, so balls that share a model are several
times cheaper. They do not touch each other: their collisions with one another are off, and each
is a constraint island that is solved and judged converged by itself. Two things would still let
one ball change another's bits: a warm start, which is taken or not for the whole model at once,
and a sparse Jacobian, which adds up in another order from ten balls on. The first is off in
every model, the second in a batch. A ball that cannot leave its axis moves on a slide joint,
alone or not (`slide_joint`).
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbench.engines.mujoco.model.bodies import masks_match

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.engines.mujoco.scene.scene_model import SceneModel
    from hcbench.terms.impact import Floats

# A ball that can only go up and down, in place of a free one: the same impact for a third of the
# cost.
#
# A sphere that falls along the axis of what it falls on, and meets no friction there, is never
# pushed aside or turned: five of a free body's six velocities stay 0. On a slide joint the ball
# has the other one alone. MuJoCo computes body_invweight0 from all three directions; a slide joint
# changes it, so the free body's is restored.
#
# Where one row of constraint holds a ball, its force is one division, without Newton's line search
# over all balls of a model: one sweep of Gauss and Seidel, the same to rounding, the same bits in
# any batch.

# Number of the position or velocity that is along the axis.
Z = 2


def stays_on_axis(mujoco: Any, model: Any) -> bool:
    """Say whether the ball of a model, which at qpos0 just touches, cannot leave the vertical.

    mujoco: the module.
    model: compiled, of one ball on a free joint, with contact through explicit <pair>s, tendon
    limits, or one pair of geoms.
    """
    ball = model.jnt_bodyid[0]
    geoms = np.flatnonzero(model.geom_bodyid == ball)
    hangs_on_world = model.body_parentid[ball] == 0
    is_upright = np.array_equal(model.body_quat[ball], [1.0, 0.0, 0.0, 0.0])
    is_sphere = (model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_SPHERE).all()
    is_centred = not model.geom_pos[geoms].any()
    has_air = bool(model.opt.wind.any() or model.opt.density or model.opt.viscosity)
    falls_plainly = (
        hangs_on_world
        and is_upright
        and is_sphere
        and is_centred
        and not has_air
        and not model.body_gravcomp[ball]
        and _solves_well(mujoco, model)
    )
    return bool(falls_plainly and _touches_below(mujoco, model) and _pulls_along(mujoco, model))


def _solves_well(mujoco: Any, model: Any) -> bool:
    """Say whether a model lets the solver iterate until it converges: at least as often, and to as
    small a tolerance, as MuJoCo does by default.

    If it is stopped early, a free ball moves otherwise than one on a slide.
    mujoco: the module.
    model: MjModel.
    """
    option = model.opt
    usual = mujoco.MjOption()
    return bool(
        option.iterations >= usual.iterations
        and option.ls_iterations >= usual.ls_iterations
        and option.tolerance <= usual.tolerance
        and option.ls_tolerance <= usual.ls_tolerance
    )


def _contact_ways(model: Any) -> list[tuple[int, int, int]]:
    """Contacts that the ball of a model can have: (number of the ball's geom, of the other geom,
    condim) of each.

    They are its <pair>s if the model has any; else what contype and conaffinity let collide.
    """
    ball = model.geom_bodyid == model.jnt_bodyid[0]
    if model.npair:
        pairs = zip(
            model.pair_geom1.tolist(),
            model.pair_geom2.tolist(),
            model.pair_dim.tolist(),
            strict=True,
        )
        ways = []
        for one, other, dim in pairs:
            if ball[one]:
                ways.append((one, other, dim))
            else:
                ways.append((other, one, dim))
        return ways
    ways = []
    for own, other in collidable_pairs(model, ball):
        # MuJoCo takes the larger condim of two geoms.
        dim = int(max(model.geom_condim[own], model.geom_condim[other]))
        ways.append((own, other, dim))
    return ways


def collidable_pairs(model: Any, moving: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Numbers of the two geoms, first one that moves, then one that does not, of each pair whose
    masks (contype and conaffinity) let them collide.

    moving: of each geom whether it moves, (ngeom,). Other filters of MuJoCo's, and <pair>s, are not
    looked at.
    """
    still = np.flatnonzero(~moving).tolist()
    pairs: list[tuple[int, int]] = []
    for geom in np.flatnonzero(moving).tolist():
        pairs += [(geom, other) for other in still if masks_match(model, geom, other)]
    return pairs


def _touches_below(mujoco: Any, model: Any) -> bool:
    """Say whether all that the ball can touch are fixed horizontal planes, without friction.

    mujoco: the module.
    model: MjModel.
    """
    for _, other, dim in _contact_ways(model):
        is_plane = model.geom_type[other] == mujoco.mjtGeom.mjGEOM_PLANE
        is_fixed = model.geom_bodyid[other] == 0
        # A quaternion w x y z without x and y turns about the vertical alone.
        is_horizontal = not model.geom_quat[other][1:3].any()
        has_friction = dim > 1
        if not (is_plane and is_fixed and is_horizontal) or has_friction:
            return False
    return True


def _pulls_along(mujoco: Any, model: Any) -> bool:
    """Say whether all tendons hold the ball, and run along the axis: between sites on it.

    mujoco: the module.
    model: MjModel, whose first joint is the ball's.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    sites = model.wrap_objid[model.wrap_type == mujoco.mjtWrap.mjWRAP_SITE]
    if len(sites) != model.nwrap or data.site_xpos[sites, :Z].any():
        return False
    on_ball = model.site_bodyid[sites] == model.jnt_bodyid[0]
    # The sites of each tendon, one after the other.
    spans = zip(model.tendon_adr.tolist(), model.tendon_num.tolist(), strict=True)
    return all(on_ball[start : start + count].any() for start, count in spans)


def has_one_constraint(model: Any) -> bool:
    """Say whether a ball is never in more than one constraint.

    model: one that `stays_on_axis` accepts.
    """
    return len(_contact_ways(model)) + int(model.ntendon) == 1


def island_flag(mujoco: Any) -> int:
    """The flag that keeps constraints from being solved island by
    island; 0 where it is not the rule.
    """
    flag = getattr(mujoco.mjtDisableBit, "mjDSBL_ISLAND", None)
    return 0 if flag is None else int(flag)


def replace_free_joint(mujoco: Any, spec: Any, height: float) -> None:
    """Turn the free joints of a spec into slides along z, whose position is the height of the body's
    centre.

    mujoco: the module.
    spec: MjSpec, changed.
    height: of the centre at qpos0, m.
    It is done in the spec and not in the MJCF, where a slide would take numbers from default
    classes, as a <freejoint> does not.
    """
    for joint in spec.joints:
        joint.type = mujoco.mjtJoint.mjJNT_SLIDE
        joint.axis = [0.0, 0.0, 1.0]
        joint.ref = height


def press_as_free_balls(mujoco: Any, model: Any, free: Any) -> None:
    """Make balls on slides feel the same contact forces as a free ball: they get the vertical axis
    and the inverse masses that MuJoCo computes of it.

    model: of balls on slides; changed.
    free: of one free ball.
    If a ball is never in more than one constraint, the solver is set to one sweep of Gauss and
    Seidel, which gives the same forces but for round-off, and is faster.
    """
    body = int(free.jnt_bodyid[0])
    size = model.njnt
    # A <frame> around the joint may have turned its axis.
    model.jnt_axis[:] = 0.0, 0.0, 1.0
    model.body_invweight0[model.jnt_bodyid] = free.body_invweight0[body]
    model.dof_invweight0[:] = free.dof_invweight0[Z]
    if free.ntendon:
        model.tendon_invweight0[:] = np.tile(free.tendon_invweight0, size)
    if has_one_constraint(free):
        model.opt.solver = mujoco.mjtSolver.mjSOL_PGS
        model.opt.iterations = 1
        model.opt.disableflags |= island_flag(mujoco)
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE


Kind = Literal["alone", "free", "sliding"]
# Islands judge their convergence by their own inertia from here on;
# before, by that of the whole model.
_SINCE = (3, 17)
# Numbers of a ball's position and of its velocity on a free joint, and on a slide joint.
_FREE = (7, 6)
_SLIDING = (1, 1)
# Attributes that refer to something by name, and to what kind of thing.
_REFERENCES = {
    **dict.fromkeys(("body", "body1", "body2", "target"), "body"),
    **dict.fromkeys(("geom", "geom1", "geom2"), "geom"),
    **dict.fromkeys(("site", "sidesite"), "site"),
    # The one sensor that a model may have is our own, of a body.
    "objname": "body",
}
# What a model may have beside a ball on a joint and what it meets.
_MORE_SIZES = ("nmocap", "na", "nu", "neq", "nflex", "nplugin", "nuserdata")
_MORE_ELEMENTS = ("equality", "actuator", "deformable", "extension", "compiler[@settotalmass]")
# Mark before the number in a copy's name.
_COPY = "#"
# Bits of contype and conaffinity that may be in use: two such numbers fit into one.
_BITS = 15
_MASK = (1 << _BITS) - 1


class _Span(NamedTuple):
    """Places of the positions of the balls, or of their velocities, in states.

    start: their first place in a state of the batch.
    width: numbers of one ball.
    inner: their first place in a state of one free ball.
    """

    start: int
    width: int
    inner: int


@dataclass(frozen=True, slots=True)
class BatchedModel:
    """A compiled model of `size` balls, each free or on a slide along z.

    at: where position and velocity of the ball start in a full state of the model of one, which is
    free, (nstate,). A state of the batch is time, then the positions of each ball, then the
    velocities of each.
    sliding: on a slide a ball has one position and one velocity, along z; the others stay what they
    are.
    """

    model: Any
    size: int
    at: tuple[int, int]
    sliding: bool

    def pack(self, states: Floats) -> Floats:
        """Pack states of one ball each into states of the batch, of `size` balls each: (rows, nstate
        of the batch), with rows = b/size rounded up.

        states: (b, nstate).
        What is left over of the last row repeats the last ball.
        """
        if self.whole:
            return states
        rows = -(-len(states) // self.size)  # rounded up
        # The ball of each place; the last one again where there are more places than balls.
        ball_of_place = np.minimum(np.arange(rows * self.size), len(states) - 1)
        packed = np.empty((rows, 1 + sum(self._widths) * self.size))
        packed[:, 0] = states[0, 0]  # the time
        for start, width, inner in self._spans():
            balls = states[ball_of_place, inner : inner + width]
            packed[:, start : start + width * self.size] = balls.reshape(rows, -1)
        return packed

    def unpack(self, packed: Floats, states: Floats) -> Floats:
        """Copy the time, positions and velocities of states of the batch into states of one ball
        each: the inverse of `pack`.

        packed: (rows, nstate of the batch), several balls in each row.
        states: (b, nstate), not changed; the result is a copy of them with these numbers.
        """
        if self.whole:
            return packed.copy()
        states = states.copy()
        states[:, 0] = packed[0, 0]
        for start, width, inner in self._spans():
            balls = packed[:, start : start + width * self.size].reshape(-1, width)
            states[:, inner : inner + width] = balls[: len(states)]
        return states

    def columns(self, path: Floats, component: tuple[int, int], count: int) -> Floats | None:
        """One number of each ball over a path of states of the batch, (count, n); None for a number
        that does not change, since the balls are on slides.

        path: (rows, n, nstate of the batch), SI.
        component: (0, 0 ... 6) for a position or part of the quaternion, (1, 0 ... 5) for a
        velocity or part of the spin.
        count: of balls, the first in the rows.
        """
        kind, i = component
        if self.whole:
            return path[:, :, self.at[kind] + i]
        if self.sliding and i != Z:
            return None
        start, width, _ = self._spans()[kind]
        # On a slide a ball has one number, the vertical one.
        first = start
        if not self.sliding:
            first += i
        # Every `width`-th number is that of the next ball: (rows, n, size).
        picked = path[:, :, first : start + width * self.size : width]
        return picked.transpose(0, 2, 1).reshape(-1, path.shape[1])[:count]

    @property
    def whole(self) -> bool:
        """True if states are those of the model of one ball, unchanged, with all else it has."""
        return self.size == 1 and not self.sliding

    @property
    def _widths(self) -> tuple[int, int]:
        return _SLIDING if self.sliding else _FREE

    def _spans(self) -> tuple[_Span, _Span]:
        """Spans of the positions and of the velocities. A state of the batch begins with the time."""
        nq, nv = self._widths
        # Of a ball on a slide only the vertical number counts.
        inner = Z if self.sliding else 0
        position, velocity = self.at
        return (
            _Span(1, nq, position + inner),
            _Span(1 + nq * self.size, nv, velocity + inner),
        )


def batch_kind(loaded: SceneModel) -> Kind:
    """Choose how the ball of a scene can share a model with other balls without a change of any bit
    of its motion: "alone" (not at all), "free" (with its free joint), or "sliding" (on a slide
    along z, as it cannot leave its axis).

    Before MuJoCo 3.17 the convergence of one ball's forces is judged by the inertia of the whole
    model: then a ball shares a model only where a single division gives its force.
    """
    mujoco = loaded.mujoco
    model = loaded.model
    if not (
        _solves_as_usual(mujoco, model.opt) and _moves_alone(loaded) and _touches_in_one_way(model)
    ):
        return "alone"
    # A <joint type="free"> may bring along what a slide would act on.
    sliding = loaded.root.find(".//freejoint") is not None and stays_on_axis(mujoco, model)
    version = tuple(map(int, mujoco.__version__.split(".")[:2]))
    if version < _SINCE and not (sliding and has_one_constraint(model)):
        return "alone"
    if sliding:
        return "sliding"
    return "free"


def _solves_as_usual(mujoco: Any, option: Any) -> bool:
    """Say whether the solver treats the contacts of each ball separately."""
    changed = (
        option.disableflags & island_flag(mujoco) or option.enableflags or option.noslip_iterations
    )
    is_dense = option.jacobian != mujoco.mjtJacobian.mjJAC_SPARSE
    return not changed and is_dense and option.solver == mujoco.mjtSolver.mjSOL_NEWTON


def _moves_alone(loaded: SceneModel) -> bool:
    """Say whether the ball's joint is all that moves in the model, and the model has nothing, such
    as actuators, that acts on the ball or would have to be repeated for more balls.
    """
    if loaded.plugged or loaded.model.njnt != 1 or loaded.model.nsensor > 1:
        return False
    has_more = any(getattr(loaded.model, size) for size in _MORE_SIZES)
    return not has_more and all(loaded.root.find(element) is None for element in _MORE_ELEMENTS)


def _touches_in_one_way(model: Any) -> bool:
    """Say whether the ball's contacts are all written as <pair>s, or, without <pair>s, only one pair
    of geoms can touch.

    Pairs of geoms are those of one that moves with one that does not. False also for a contype or
    conaffinity above 15 bits, as `_disable_mutual_collisions` packs two into one number.
    """
    if ((model.geom_contype | model.geom_conaffinity) & ~_MASK).any():
        return False
    moving = model.body_weldid[model.geom_bodyid] != 0
    possible = set(map(frozenset, collidable_pairs(model, moving)))
    if not model.npair:
        return len(possible) <= 1
    pairs = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    return possible <= set(map(frozenset, pairs))


def compile_batch(loaded: SceneModel, size: int, sliding: bool) -> BatchedModel:
    """Compile a model with several balls that do not touch each other, each like the one of `loaded`.

    loaded: a scene whose `batch_kind` is not "alone".
    size: number of balls.
    sliding: each on a slide along z.
    """
    mujoco = loaded.mujoco
    one = loaded.model
    root = _repeated(copy.deepcopy(loaded.root), size)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    if sliding:
        replace_free_joint(mujoco, spec, float(loaded.origin[loaded.at[0] + Z]))
    _disable_mutual_collisions(spec)
    model = spec.compile()
    model.opt.disableflags = one.opt.disableflags
    # A sparse one adds up in another order from ten balls on: other bits.
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    if sliding:
        press_as_free_balls(mujoco, model, one)
    _, dofs = _SLIDING if sliding else _FREE
    assert model.nv == size * dofs
    return BatchedModel(model, size, loaded.at, sliding)


def _ball(root: ET.Element) -> ET.Element:
    return next(body for body in root.iter("body") if body.get("name") == "ball")


def _repeated(root: ET.Element, size: int) -> ET.Element:
    """Add copies of the ball to an MJCF, and of all contacts, tendons and sensors that refer to it by
    name.

    root: changed, and returned.
    size: number of balls in the end.
    Names in a copy end in a mark and its number.
    """
    # Keyframes are made for one ball.
    for keyframe in root.findall("keyframe"):
        root.remove(keyframe)
    ball = _ball(root)
    # Names for which a copy gets one of its own, by tag.
    names = {}
    for tag in ("body", "geom", "site"):
        names[tag] = {element.get("name") for element in ball.iter(tag)} - {None}
    mark = _unused_mark(root)
    # Elements whose children are copied: the ball's parent, and all that may refer to the ball.
    holders = [next(element for element in root.iter() if ball in list(element))]
    for tag in ("contact", "tendon", "sensor"):
        holders += root.findall(tag)
    for holder in holders:
        elements = [element for element in holder if element is ball or _any_refers(element, names)]
        for i in range(1, size):
            for element in elements:
                holder.append(_renamed(copy.deepcopy(element), names, f"{mark}{i}"))
    return root


def _unused_mark(root: ET.Element) -> str:
    """A mark for copies that stands in no name of the file."""
    taken = [element.get("name", "") for element in root.iter()]
    mark = _COPY
    while any(mark in name for name in taken):
        mark += _COPY
    return mark


def _any_refers(element: ET.Element, names: Mapping[str, set[str | None]]) -> bool:
    """Say whether an element, or one in it, refers to one of the names."""
    return any(_refers(part, names) for part in element.iter())


def _refers(element: ET.Element, names: Mapping[str, set[str | None]]) -> bool:
    return any(element.get(key) in names[kind] for key, kind in _REFERENCES.items())


def _renamed(element: ET.Element, names: Mapping[str, set[str | None]], suffix: str) -> ET.Element:
    """Add a suffix to the names that an element and its children have, and to the names of the
    ball's parts to which they refer.

    element: changed, and returned.
    names: of the ball's parts, by tag.
    """
    for part in element.iter():
        if "name" in part.attrib:
            part.set("name", part.attrib["name"] + suffix)
        for key, kind in _REFERENCES.items():
            if part.get(key) in names[kind]:
                part.set(key, part.attrib[key] + suffix)
    return element


def _disable_mutual_collisions(spec: Any) -> None:
    """Change the collision masks of a spec so that balls collide with fixed geoms as before, but
    never with each other.

    A ball gets both its masks into its contype, a fixed geom both into its conaffinity: then the
    masks of two balls have no bit in common.
    spec: MjSpec, changed.
    """
    # The <pair>s are all ways to touch, or the model would not be batched: collisions need not be
    # looked for, which would cost a sixth of a step.
    if spec.pairs:
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
        return
    for geom in spec.geoms:
        geom.conaffinity |= geom.contype << _BITS
        geom.contype = 0
    for body in spec.bodies:
        if body.joints:  # a ball
            for geom in body.find_all("geom"):
                geom.contype = geom.conaffinity >> _BITS | (geom.conaffinity & _MASK) << _BITS
                geom.conaffinity = 0
