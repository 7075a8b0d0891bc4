"""A user's model in Drake, and its bodies placed at touch."""

from __future__ import annotations

import itertools
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.sim.model_under_test import LISTS_PAIRS, choice_error
from hcbench.sim.packages import Packages, find_part, folders_of, suggest_names
from hcbench.sim.touch import LEAST_APPROACH, require_apart
from hcbench.system.errors import PairUnnamed, SceneError, UserError

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# A user's URDF, SDF or MJCF in a Drake plant: its parts by name, and where two of them are
# nearest.

SUFFIXES = (".urdf", ".sdf", ".xml", ".mjcf")
# What a geometry has that says nothing, as Drake's documentation of MultibodyPlant has it.
STIFFNESS = "point_contact_stiffness"
DISSIPATION = "hunt_crossley_dissipation"
_DEFAULTS = {STIFFNESS: 1e6, DISSIPATION: 50.0}
# Component of a direction below which a face or an edge, not a vertex, is farthest along it.
_ALONG = 1e-9


@dataclass(frozen=True, slots=True)
class Part:
    """Body or shape that a name stands for.

    body: Drake's.
    geometries: ids of those of its shapes that count.
    """

    name: str
    body: Any
    geometries: tuple[Any, ...]


class Gap(NamedTuple):
    """Nearest points of two shapes, in the world.

    distance: of the two, m; below 0 where they overlap.
    normal: of length 1, from the first to the second, (3,).
    point: halfway between their nearest points, m, (3,).
    geometries: ids of the first and the second.
    """

    distance: float
    normal: Floats
    point: Floats
    geometries: tuple[Any, Any]


class LoadedPlant:
    """Models from files in a discrete plant with nothing else set.

    drake: the module pydrake.all.
    source: one path or several.
    changes: what fixes have set, "timestep" (s) and "dissipation" (s/m); they win over the request.
    ignored: what Drake said that it leaves out.

    Raises SceneError for what is not there or Drake does not load.
    """

    def __init__(
        self, drake: Any, source: Any, request: Request, changes: Mapping[str, Any]
    ) -> None:
        """Load the files, and finish the plant with the request's step and gravity.

        source: one path or several.
        changes: what fixes have set, "timestep" (s) and "dissipation" (s/m); {} for none.
        Raises SceneError for a file that is missing or that Drake refuses.
        """
        sources = source if isinstance(source, list | tuple) else [source]
        paths = [Path(path) for path in sources]
        self.drake = drake
        self.label = " + ".join(path.name for path in paths)
        # s; None: Drake's own, of a discrete plant.
        step = changes.get("timestep") or request.timestep
        if step is None:
            self.config = drake.MultibodyPlantConfig()
        else:
            self.config = drake.MultibodyPlantConfig(time_step=step)
        builder = drake.DiagramBuilder()
        # Drake logs what of a file it leaves out.
        with _said() as self.ignored:
            self.plant, scene_graph = drake.AddMultibodyPlant(self.config, builder)
            for path in paths:
                self._add(path, request.packages)
            # Nothing of these can be changed once the plant is finalized.
            self._set_dissipation(scene_graph, changes.get("dissipation"))
            if request.gravity is not None:
                self.plant.mutable_gravity_field().set_gravity_vector(request.gravity)
            self.plant.Finalize()
            self.inspector = scene_graph.model_inspector()
            self.diagram = builder.Build()
        # Ids of the shapes that can touch, and every two of them that Drake collides.
        self._geometries = self.inspector.GetAllGeometryIds(drake.Role.kProximity)
        self.collide = {frozenset(both) for both in self.inspector.GetCollisionCandidates()}

    def _add(self, path: Path, packages: Packages) -> None:
        """Add the models of a file to the plant, before that is finalized.

        packages: folders of the packages that the file names.
        Raises SceneError for a file that is missing or that Drake does not load.
        """
        if not path.is_file():
            what = "is a folder" if path.is_dir() else "is not there"
            raise SceneError("model", f"{path} {what}", f"a model file: {', '.join(SUFFIXES)}")
        try:
            parser = self.drake.Parser(self.plant)
            for name, folder in folders_of(path, packages).items():
                if not parser.package_map().Contains(name):
                    parser.package_map().Add(name, str(folder))
            parser.AddModels(str(path))
        except RuntimeError as error:
            words = str(error).partition("error: ")[2] or str(error)
            raise SceneError("model", f"{path.name}: {words}", "a model that Drake loads") from None

    def _set_dissipation(self, scene_graph: Any, dissipation: float | None) -> None:
        """Set the dissipation, s/m, of every shape that collides; None leaves them.

        scene_graph: Drake's, before the plant is finalized.
        """
        if dissipation is None:
            return
        inspector = scene_graph.model_inspector()
        source = self.plant.get_source_id()
        for geometry in inspector.GetAllGeometryIds(self.drake.Role.kProximity):
            properties = self.drake.ProximityProperties(inspector.GetProximityProperties(geometry))
            properties.UpdateProperty("material", DISSIPATION, dissipation)
            scene_graph.AssignRole(source, geometry, properties, self.drake.RoleAssign.kReplace)

    def says(self, geometry: Any, name: str) -> bool:
        """Say whether a shape's file sets this property of its contact."""
        return bool(self.inspector.GetProximityProperties(geometry).HasProperty("material", name))

    def property(self, geometry: Any, name: str) -> float:
        """A property of a shape's contact, from its file or else Drake's default."""
        if not self.says(geometry, name):
            return _DEFAULTS[name]
        properties = self.inspector.GetProximityProperties(geometry)
        return float(properties.GetProperty("material", name))

    def is_hydroelastic(self, geometry: Any) -> bool:
        """Say whether a shape's file asks for a pressure field (hydroelastic contact)."""
        properties = self.inspector.GetProximityProperties(geometry)
        return bool(properties.HasProperty("hydroelastic", "compliance_type"))

    def body_of(self, geometry: Any) -> Any:
        """The body that has a shape."""
        return self.plant.GetBodyFromFrameId(self.inspector.GetFrameId(geometry))

    def part(self, name: str) -> Part:
        """Find the body, else the shape, of this name.

        name: as the model has it, or "body:NAME" or "geom:NAME" to say which.
        Raises UserError for neither, and for a body without shapes.
        """
        indices = self.plant.GetBodyIndices(self.drake.default_model_instance())
        bodies = list(map(self.plant.get_body, indices))
        bodies += [self.plant.world_body(), *map(self.body_of, self._geometries)]
        # Kind, name, and Drake's body or geometry id: each body once, if it has shapes; all shapes.
        parts = [
            ("body", body.name(), body) for body in dict.fromkeys(bodies) if self._shapes(body)
        ]
        parts += [("geom", self.short(g), g) for g in self._geometries]
        kind, found = find_part(parts, name)
        if kind == "geom":
            return Part(name, self.body_of(found), (found,))
        return Part(name, found, tuple(self._shapes(found)))

    def _shapes(self, body: Any) -> list[Any]:
        return [g for g in self._geometries if self.body_of(g).index() == body.index()]

    def short(self, geometry: Any) -> str:
        """Name of a shape without that of its model."""
        return str(self.inspector.GetName(geometry).rpartition("::")[2])

    def nearest(self, context: Any, first: Part, second: Part) -> Gap:
        """Find the nearest points of two parts, over all their shapes.

        first, second: the two parts; the normal leads from the first to the second.
        context: the plant's.
        Raises UserError if Drake filters their contact or does not know the distance of two shapes.
        """
        every = itertools.product(first.geometries, second.geometries)
        meet = [shapes for shapes in every if frozenset(shapes) in self.collide]
        if not meet:
            got = f"{first.name!r} and {second.name!r} never touch: Drake filters their collisions"
            raise UserError("pair", got, "two parts of different bodies, not joined by a joint")
        query = self.plant.get_geometry_query_input_port().Eval(context)
        gaps = [self._gap(query, *shapes) for shapes in meet]
        return min(gaps, key=lambda gap: gap.distance)

    def _gap(self, query: Any, a: Any, b: Any) -> Gap:
        """Nearest points of two shapes, and their distance.

        query: Drake's QueryObject of the pose.
        a, b: ids of the shapes; the normal leads from a to b.
        Raises UserError where Drake does not know their distance.
        """
        half_space = self.drake.HalfSpace
        # Drake knows the distance of spheres only from half-spaces.
        if isinstance(self.inspector.GetShape(b), half_space):
            distance, up, point = self._over_half_space(query, a, b)
            return Gap(distance, -up, point, (a, b))
        if isinstance(self.inspector.GetShape(a), half_space):
            distance, up, point = self._over_half_space(query, b, a)
            return Gap(distance, up, point, (a, b))
        try:
            near = query.ComputeSignedDistancePairClosestPoints(a, b)
        except RuntimeError as error:
            raise UserError("pair", str(error), "two shapes whose distance Drake knows") from None
        # Drake chooses which of the two is its A. The nearest points, m, in the world:
        end_a = query.GetPoseInWorld(near.id_A).multiply(near.p_ACa)
        end_b = query.GetPoseInWorld(near.id_B).multiply(near.p_BCb)
        # From Drake's B to its A, so from a to b if Drake's A is b.
        normal = near.nhat_BA_W
        if near.id_A != b:
            normal = -normal
        return Gap(float(near.distance), np.asarray(normal), (end_a + end_b) / 2, (a, b))

    def _over_half_space(self, query: Any, shape: Any, ground: Any) -> tuple[float, Floats, Floats]:
        """Signed distance, m, of a shape over a half-space, the ground's normal, (3,), and the
        midpoint between the two nearest points, m, (3,).

        query: Drake's QueryObject of the pose.
        shape, ground: ids of the two.
        Raises UserError for a kind of shape whose farthest point along a direction hcbench does not
        know.
        """
        ground_pose = query.GetPoseInWorld(ground)
        pose = query.GetPoseInWorld(shape)
        # A half-space is below the plane z = 0 of its frame.
        up = ground_pose.rotation().matrix()[:, 2]
        to_world = pose.rotation().matrix()
        farthest = self._farthest(self.inspector.GetShape(shape), to_world.T @ -up)
        deepest = pose.translation() + to_world @ farthest
        distance = float(up @ (deepest - ground_pose.translation()))
        return distance, up, deepest - 0.5 * distance * up

    def _farthest(self, shape: Any, along: Floats) -> Floats:
        """The point of a shape that lies farthest along a direction, in the shape's frame, m, (3,);
        the middle where a whole edge or face does.

        along: unit vector in the shape's frame, (3,).
        Raises UserError for a shape of which hcbench does not know this point.
        """
        drake = self.drake
        side = np.where(np.abs(along) < _ALONG, 0.0, np.sign(along))
        if isinstance(shape, drake.Sphere):
            return np.asarray(shape.radius() * along)
        if isinstance(shape, drake.Box):
            return np.asarray(0.5 * shape.size() * side)
        if isinstance(shape, drake.Ellipsoid):
            # The support point of an ellipsoid: its normal there is along the direction.
            axes = np.array([shape.a(), shape.b(), shape.c()])
            return np.asarray(axes**2 * along / np.linalg.norm(axes * along))
        if isinstance(shape, drake.Capsule | drake.Cylinder):
            # Of a capsule's end the farthest point is on a sphere, of a cylinder's on the rim.
            outwards = along
            if isinstance(shape, drake.Cylinder):
                outwards = _unit(np.array([*along[:2], 0.0]))
            # Both have their axis along z.
            end = [0.0, 0.0, 0.5 * shape.length() * side[2]]
            return np.asarray(shape.radius() * outwards + end)
        got = f"a {type(shape).__name__} on a HalfSpace, whose distance Drake does not know"
        raise UserError("pair", got, "a sphere, box, cylinder, capsule or ellipsoid on it")


def _unit(vector: Floats) -> Floats:
    """The unit vector along a vector; 0 for one that is as good as 0."""
    length = float(np.linalg.norm(vector))
    return vector / length if length > _ALONG else 0.0 * vector


@contextmanager
def _said() -> Iterator[list[str]]:
    """Collect the messages that Drake logs in the block in a list, instead of printing them."""
    lines: list[str] = []
    log = logging.getLogger("drake")
    handler = logging.Handler()
    handler.emit = lambda record: lines.append(record.getMessage())  # type: ignore[method-assign]
    before = log.propagate
    log.addHandler(handler)
    log.propagate = False
    try:
        yield lines
    finally:
        log.removeHandler(handler)
        log.propagate = before


_ATTRIBUTE = re.compile(r"The attribute '(\w+)' found in an? '(\w+)'.*")
_TAG = re.compile(r"The tag '(\w+)' found.*")
# Nothing to do with contact
_LOOKS = ("visual", "light", "asset", "statistic")


def ignored_in_words(lines: Sequence[str]) -> str:
    """One sentence on everything of a model's contact and motion that Drake leaves out; "" for
    nothing.

    lines: what Drake logged while it read the model; only its warnings count, and not those about
    looks.
    """
    # A dict keeps each phrase once, in order.
    left_out: dict[str, None] = {}
    for line in lines:
        _, is_warning, text = line.partition("warning: ")
        if not is_warning:
            continue
        named = _ATTRIBUTE.sub(r"<\2> \1", text.rstrip("."))
        named = _TAG.sub(r"<\1>", named)
        if named.strip("<>") not in _LOOKS:
            left_out[named] = None
    return f"Drake leaves out: {'; '.join(left_out)}." if left_out else ""


# Brings two parts of a Drake plant just to touch, and finds how to launch one at the other.

# Steps of the way to the touch, at most.
_ROUNDS = 60
# Distance that counts as touching, m.
_CLOSE = 1e-13
# Distance, m, at the end of a way from which the two do not meet.
_MISSED = 1e-6


@dataclass(frozen=True, slots=True)
class PlacedPair:
    """Two parts that just touch, the moving body first; SI.

    moved: what moves it, in words.
    positions: (nq,), at touch.
    direction: (nv,), the velocity that approaches at 1 m/s.
    gravity: acceleration of the approach in free flight.
    overlap: at the start.
    """

    first: Part
    second: Part
    moved: str
    positions: Floats
    direction: Floats
    gap: Gap
    effective_mass: float
    gravity: float
    overlap: float


def set_pose(loaded: LoadedPlant, context: Any, request: Request) -> None:
    """Put joints where the request says.

    context: the plant's; changed.
    Raises UserError for a keyframe, which Drake does not read, for unknown joints and for another
    number of values.
    """
    plant = loaded.plant
    if request.key is not None:
        raise UserError("key", repr(request.key), "none: Drake reads no keyframes", "Try --qpos")
    joints = {plant.get_joint(i).name(): plant.get_joint(i) for i in plant.GetJointIndices()}
    positions = plant.GetPositions(context)
    for name, values in request.pose:
        # Where the numbers begin in the plant's positions, and how many there are.
        if name == "qpos":
            start = 0
            count = plant.num_positions()
        elif name in joints:
            start = joints[name].position_start()
            count = joints[name].num_positions()
        else:
            raise UserError("qpos", f"no joint {name!r}", *suggest_names(name, joints))
        if len(values) != count:
            slot = "state" if name == "qpos" else "qpos"
            raise UserError(
                slot, f"{name}: {len(values)} numbers", f"{count}: m, rad, quaternion w x y z"
            )
        positions[start : start + count] = values
    plant.SetPositions(context, positions)


def approach_row(loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], gap: Gap) -> Floats:
    """Jacobian J of the approach rate of two parts, (nv,): J @ v is the rate, m/s, at which their
    material points at the contact approach.

    context: the plant's, with the pose.
    pair: the two parts.
    gap: their nearest points, with the normal from the first part to the second.
    """
    plant = loaded.plant
    world = plant.world_frame()
    by_velocity = loaded.drake.JacobianWrtVariable.kV
    row = np.zeros(plant.num_velocities())
    # The first part approaches by its motion along the normal, the second by one against it.
    for part, sign in zip(pair, (1.0, -1.0), strict=True):
        frame = part.body.body_frame()
        # The contact point in the body's own frame, m, as Drake asks for it.
        point = plant.CalcPointsPositions(context, world, gap.point, frame)
        jacobian = plant.CalcJacobianTranslationalVelocity(
            context, by_velocity, frame, point, world, world
        )
        row += sign * (gap.normal @ jacobian)
    return row


def bring_to_touch(loaded: LoadedPlant, context: Any, request: Request) -> PlacedPair:
    """Bring the request's pair just to touch, by moving the first part, or else the second, along
    their common normal: the pair as it is to be launched.

    context: the plant's, with everything at rest where it starts; changed, it ends at touch.

    Raises SceneError where the two start deep in each other, UserError for names that the model
    does not have and where no joint brings the two together.
    """
    first_name, second_name = request.pair or _only_pair(loaded)
    first = loaded.part(first_name)
    second = loaded.part(second_name)
    near = loaded.nearest(context, first, second)
    start = loaded.plant.GetPositions(context)
    require_apart(near.distance, _size(loaded, near), first.name, second.name)
    overlap = max(0.0, -near.distance)
    for pair in ((first, second), (second, first)):
        moving, _ = pair
        # Indices of the velocities that may change, and a phrase for what moves.
        for dofs, words in movers(loaded, moving.body):
            gap = _touch(loaded, context, pair, dofs)
            if gap is not None:
                return _placed(loaded, context, pair, dofs, words, gap, overlap)
            # That one did not lead there: the next begins from the start again.
            loaded.plant.SetPositions(context, start)
    got = f"no joint moves {first.name!r} and {second.name!r} to each other"
    raise UserError(
        "pair", got, "two that meet along their common normal", "Start from another --qpos"
    )


def _only_pair(loaded: LoadedPlant) -> tuple[str, str]:
    """Names of the only two shapes that can meet, as "geom:NAME", one that moves first.

    Raises UserError where none can, and PairUnnamed where there is a choice.
    """
    if not loaded.collide:
        raise choice_error([])
    if len(loaded.collide) != 1:
        got = f"none given, and the model leaves a choice of {len(loaded.collide)}"
        raise PairUnnamed("pair", got, "the names of two bodies or geoms", LISTS_PAIRS)
    (both,) = loaded.collide
    first, second = sorted(
        both, key=lambda g: (loaded.plant.IsAnchored(loaded.body_of(g)), loaded.short(g))
    )
    return f"geom:{loaded.short(first)}", f"geom:{loaded.short(second)}"


def _size(loaded: LoadedPlant, gap: Gap) -> float:
    """Half of the smaller shape's longest side, m; 0.1 of shapes that have no end."""
    boxes = [loaded.inspector.GetObbInGeometryFrame(geometry) for geometry in gap.geometries]
    return min((float(max(box.half_width())) for box in boxes if box is not None), default=0.1)


def movers(loaded: LoadedPlant, body: Any) -> Iterator[tuple[list[int], str]]:
    """Yield what can move a body, the nearest first: (indices in the plant's velocities,
    description) of each.

    These are its own free or prismatic joint and those of the bodies that it hangs on, each alone;
    then, if joints among them turn, all velocities of the plant together.
    """
    plant = loaded.plant
    # The joint on which each body hangs, by the body's index.
    joint_of = {
        plant.get_joint(i).child_body().index(): plant.get_joint(i) for i in plant.GetJointIndices()
    }
    # Names of the joints that turn, nearest first.
    chain = []
    joint = joint_of.get(body.index())
    while joint is not None:
        start = joint.velocity_start()
        count = joint.num_velocities()
        if count == 6:
            # Of a free joint's velocities the rotations are first.
            translations = list(range(start + 3, start + 6))
            yield translations, f"body {body.name()!r} on its free joint"
        elif joint.type_name() == "prismatic":
            yield [start], f"body {body.name()!r} on its slide"
        elif count:
            chain.append(joint.name())
        body = joint.parent_body()
        joint = joint_of.get(body.index())
    if chain:
        yield list(range(plant.num_velocities())), f"on its joints ({', '.join(chain)})"


def _direction(loaded: LoadedPlant, context: Any, row: Floats, dofs: list[int]) -> Floats | None:
    """Velocity with which a mover makes the pair approach at 1 m/s, (nv,): for translations the
    smallest one, for a whole robot that by a push; None where it does not lead to the other part.

    row: Jacobian of the approach rate, (nv,).
    dofs: indices of the velocities that may change.
    """
    # A plant of 1 or 3 velocities is taken for a slide or three of them, not for a robot.
    moves_all = len(dofs) == len(row) and len(row) not in (1, 3)
    if moves_all:
        move = np.linalg.solve(loaded.plant.CalcMassMatrix(context), row)
    else:
        # Translations alone: the least velocity is along the row itself.
        move = np.zeros_like(row)
        move[dofs] = row[dofs]
    approach = float(row @ move)
    # A mover that hardly changes the approach rate leads nowhere.
    if approach > LEAST_APPROACH**2:
        return np.asarray(move / approach)
    return None


def _touch(
    loaded: LoadedPlant, context: Any, pair: tuple[Part, Part], dofs: list[int]
) -> Gap | None:
    """Move a part until it touches the other, and return their nearest points there; None where the
    mover does not bring them together.

    context: the plant's; it ends at touch.
    pair: the moving part first.
    dofs: indices of the velocities that may change.
    Raises UserError for two parts that Drake does not let collide, or whose distance it does not
    know.
    """
    for _ in range(_ROUNDS):
        gap = loaded.nearest(context, *pair)
        move = _direction(loaded, context, approach_row(loaded, context, pair, gap), dofs)
        if move is None or not np.isfinite(gap.distance):
            return None
        if abs(gap.distance) < _CLOSE:
            return gap
        # At 1 m/s the distance is the time left, s: exact for flat shapes, a Newton step for others.
        move_on(loaded, context, move * gap.distance)
    return gap if abs(gap.distance) < _MISSED else None


def move_on(loaded: LoadedPlant, context: Any, motion: Floats) -> None:
    """Add a motion, (nv,), to the positions; also where it turns a free body."""
    plant = loaded.plant
    positions = plant.GetPositions(context) + plant.MapVelocityToQDot(context, motion)
    plant.SetPositions(context, positions)


def _placed(
    loaded: LoadedPlant,
    context: Any,
    pair: tuple[Part, Part],
    dofs: list[int],
    words: str,
    gap: Gap,
    overlap: float,
) -> PlacedPair:
    """Describe a pair at touch as it is to be launched: direction, effective mass and acceleration of
    the approach.

    context: the plant's, at touch.
    pair: the moving part first.
    dofs: indices of the velocities that move it.
    words: a phrase for them.
    gap: the nearest points.
    overlap: of the two at the start, m.
    """
    plant = loaded.plant
    row = approach_row(loaded, context, pair, gap)
    direction = _direction(loaded, context, row, dofs)
    assert direction is not None
    mass = plant.CalcMassMatrix(context)
    # What gravity, springs and dampers do to the plant at rest: the accelerations, (nv,), are minus
    # those by the forces that would keep it at rest.
    forces = loaded.drake.MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    at_rest = np.zeros(plant.num_velocities())
    accelerations = -np.linalg.solve(mass, plant.CalcInverseDynamics(context, at_rest, forces))
    first, second = pair
    return PlacedPair(
        first=first,
        second=second,
        moved=words,
        positions=plant.GetPositions(context),
        direction=direction,
        gap=gap,
        effective_mass=1.0 / float(row @ np.linalg.solve(mass, row)),
        gravity=float(row @ accelerations),
        overlap=overlap,
    )
