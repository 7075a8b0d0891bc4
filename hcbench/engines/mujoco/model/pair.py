"""Two parts of a MuJoCo model that shall meet: where they are
nearest, and MuJoCo's contact of them.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import approach_row, geom_name
from hcbench.engines.mujoco.model.speed_shares import has_more_than_contacts
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.terms.impact import Floats
from hcbench.terms.resolution import ROUND_OFF_SOLVED

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from hcbench.laws.restitution import RestitutionCurve

# Nearest points that are nearer to each other, m, have no direction but that of rounding.
_LEAST_SPAN = 1e-12
# The first of two parts is moved by this share of the smaller one to see how their distance changes.
_NUDGE = 1e-3
# Change of the distance, of the way that it is moved, below which that tells no direction.
_LEAST_SLOPE = 0.1

# A user's model whose pair bounces by the plug-in hcbench.restitution: what it asks for, and its
# force.

# The keys of an instance's config in the plug-in's order: MuJoCo keeps their values alone.
_KEYS = ("geom1", "geom2", "body1", "body2", "tendon", "alpha", "reading", "restitution")
_FORCE_KEYS = (
    *(*_KEYS[:5], "stiffness", "exponent", "alpha", "law", "restitution", "friction"),
    *("dynamic_friction", "slip_speed"),
)


def restitution_law(model: Any, geoms: Sequence[int]) -> RestitutionCurve | None:
    """e over speed that the plug-in hcbench.restitution gives a contact of two geoms; None if no
    instance of the plug-in names them or their bodies.

    model: compiled MjModel.
    geoms: numbers of the two.
    Raises SettingError for an alpha that no law has.
    """
    config = _config(model, geoms, _KEYS)
    if config is None:
        return None
    if config["alpha"]:
        is_linear = config["reading"] == "linear"
        return Restitution(_number(model, config["alpha"]), "linear" if is_linear else "law")
    return ConstantRestitution(_number(model, config["restitution"]))


def has_force_law(model: Any, geoms: Sequence[int]) -> bool:
    """Say whether the plug-in hcbench.hunt_crossley acts between two geoms, or their bodies."""
    return _config(model, geoms, _FORCE_KEYS) is not None


def _config(model: Any, geoms: Sequence[int], keys: Sequence[str]) -> dict[str, str] | None:
    """Config of the first plug-in instance with these keys that names two geoms or their bodies.

    geoms: numbers of the two.
    keys: in the plug-in's order; their number tells one plug-in from another. Values are texts by
    key, "" where the user wrote none. None without such an instance.
    """
    geom_names = {model.geom(geom).name for geom in geoms}
    body_names = {model.body(model.geom_bodyid[geom]).name for geom in geoms}
    for config in _configs(model, keys):
        if _is_for(config, "geom", geom_names) or _is_for(config, "body", body_names):
            return config
    return None


def _is_for(config: dict[str, str], kind: str, names: set[str]) -> bool:
    # An instance for bodies has "" for its geoms, which is also the name of every geom without one.
    return "" not in names and {config[f"{kind}1"], config[f"{kind}2"]} == names


def _configs(model: Any, keys: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield the config of each plug-in instance of a compiled model that has as many values as
    there are keys: values by key, "" for those that are not set.
    """
    starts = model.plugin_attradr.tolist()
    ends = [*starts[1:], model.npluginattr]
    for start, end in zip(starts, ends, strict=True) if starts else ():
        text = bytes(model.plugin_attr[start:end].astype(np.uint8)).decode()
        # MuJoCo closes each value by a zero.
        values = text.split("\0")[:-1]
        # MuJoCo keeps no keys: the number of values is what tells one plug-in from another.
        if len(values) == len(keys):
            yield dict(zip(keys, values, strict=True))


def _number(model: Any, text: str) -> float:
    """A number in a config, which may be the name of a <numeric>."""
    try:
        return float(text)
    except ValueError:
        return float(model.numeric(text).data[0])


class WithoutContact:
    """Step of the same model with contact off, beside the one that is measured.

    The impulse of a plug-in does not appear in MuJoCo's solver: it is the
    difference of the two velocities.
    """

    def __init__(self, model: Any) -> None:
        mujoco = backend()
        self._step = mujoco.mj_step
        self.data = mujoco.MjData(model)  # a plug-in warns of data that is made with contacts off
        self._model = copy.copy(model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

    def step(self) -> Floats:
        """Step from the state in `data`; returns the velocities after it, shape (nv,)."""
        self._step(self._model, self.data)
        after: Floats = self.data.qvel
        return after

    def force(self, row: Floats, velocity: Floats, mass: float) -> float:
        """Mean force of the contact in a step, N, by the difference that it makes to the approach
        speed; 0 where the difference is only round-off.

        `self.data` has the state before the step; here the same step is taken in it without
        contact.
        row: Jacobian of the approach rate, (nv,).
        velocity: after the step with the contact, (nv,).
        mass: effective mass along the normal, kg.
        """
        # Approach speeds after the step, m/s.
        without_contact = float(row @ self.step())
        with_contact = float(row @ velocity)
        difference = without_contact - with_contact
        scale = abs(without_contact) + abs(with_contact)
        if abs(difference) <= ROUND_OFF_SOLVED * np.finfo(float).eps * scale:
            return 0.0
        return mass * difference / float(self._model.opt.timestep)


# A geom of the pair's first part counts 1, one of the second 2 and others 0: the two geoms of a
# contact add up to this only where it is one of the pair.
BOTH_SIDES = 3


@dataclass(frozen=True, slots=True)
class NamedGeoms:
    """Part of a model that a user names: a body, and those of its geoms that count."""

    name: str
    body: int
    geoms: tuple[int, ...]


class ContactPoint(NamedTuple):
    """One point of MuJoCo's contact: the parameters in force there, and the two geoms."""

    solref: tuple[float, ...]
    solimp: tuple[float, ...]
    geoms: tuple[int, int]


@dataclass(frozen=True, slots=True)
class PairContact:
    """MuJoCo's contact of a pair, averaged over its points; SI.

    normal: from the first part to the second.
    onset: distance at which its force begins to act.
    rows: its points, one or more.
    """

    normal: Floats
    point: Floats
    onset: float
    distance: float
    rows: tuple[ContactPoint, ...]

    @property
    def geoms(self) -> tuple[int, int]:
        """The two geoms that touch, of the first point."""
        return self.rows[0].geoms


class Nearest(NamedTuple):
    """Nearest points of two parts: signed distance (m), unit normal from the first to the second,
    midpoint, and the geoms. The normal is 0 where the two touch and nothing tells a direction.
    """

    distance: float
    normal: Floats
    point: Floats
    geoms: tuple[int, int]


@dataclass(frozen=True)
class ContactPair:
    """Two parts of a model that shall meet.

    model: compiled MjModel.
    first, second: the two parts; of a pair to be launched, the first moves.
    """

    model: Any
    first: NamedGeoms
    second: NamedGeoms

    def swapped(self) -> ContactPair:
        """The same pair with its two parts in the other order."""
        return ContactPair(self.model, self.second, self.first)

    @property
    def geoms(self) -> tuple[int, ...]:
        """The geoms of both parts."""
        return self.first.geoms + self.second.geoms

    @cached_property
    def sides(self) -> NDArray[np.int8]:
        """Side of each geom in the pair, (ngeom + 1,): 1 for those of the first part, 2 for those of
        the second, 0 for others.

        So the two geoms of a contact add up to BOTH_SIDES only if it is the pair's. The last number
        is a 0 for flexes, to which MuJoCo gives the geom -1.
        """
        sides = np.zeros(self.model.ngeom + 1, dtype=np.int8)
        sides[list(self.first.geoms)] = 1
        sides[list(self.second.geoms)] = 2
        return sides

    @cached_property
    def in_trees(self) -> NDArray[np.bool_]:
        """Mask of the geoms in the trees of bodies, such as whole robots, to which the two belong,
        (ngeom + 1,); the last is False, for flexes, to which MuJoCo gives the geom -1.
        """
        # Body 0 is the world, which is not a tree of its own.
        bodies = [body for body in (self.first.body, self.second.body) if body]
        roots = self.model.body_rootid[bodies]
        return np.append(np.isin(self.model.body_rootid[self.model.geom_bodyid], roots), False)

    def names_of_others(self, geoms: Iterable[int]) -> list[str]:
        """Names of geoms that touched the two besides their own contact, sorted.

        geoms: their numbers.
        One of the pair's own, such as the floor under another foot, is named with the part that did
        not touch it then.
        """
        names = []
        for geom in geoms:
            name = geom_name(self.model, geom)
            if self.sides[geom]:
                other = self.second if self.sides[geom] == 1 else self.first
                name += f" (by other parts than {other.name})"
            names.append(name)
        return sorted(names)

    @cached_property
    def more_than_contacts(self) -> bool:
        """True if anything but contacts and gravity can act on the bodies of the model."""
        return has_more_than_contacts(self.model)

    @cached_property
    def size(self) -> float:
        """Bounding radius of the smallest geom, m."""
        return min(
            [r for r in self.model.geom_rbound[list(self.geoms)].tolist() if r > 0], default=0.1
        )

    @cached_property
    def reach(self) -> float:
        """Distance, m, up to which distances are computed: MuJoCo reports it for all beyond."""
        return 10.0 * float(self.model.stat.extent) + 10.0

    @cached_property
    def height_field(self) -> int:
        """Number of the height field among the two, -1 without one.

        Callers ask because MuJoCo's own distance to a height field is not reliable.
        """
        kind = int(backend().mjtGeom.mjGEOM_HFIELD)
        for geom in self.geoms:
            if int(self.model.geom_type[geom]) == kind:
                return geom
        return -1

    def approach_row(self, data: Any, point: Floats, normal: Floats) -> Floats:
        """(nv,) J: the approach rate of the two at a point along a normal is J @ qvel."""
        return approach_row(self.model, data, self.first.body, self.second.body, point, normal)

    def contact(self, data: Any) -> PairContact | None:
        """MuJoCo's contact between the two parts, averaged over its points: normal, place and
        parameters, SI; None where none acts.

        data: MjData after collision detection. The distance is that of the deepest point, the onset
        the widest margin.
        """
        contacts = data.contact
        sides = self.sides
        acting = []
        for number, (a, b) in enumerate(contacts.geom.tolist()):
            is_of_pair = sides[a] + sides[b] == BOTH_SIDES
            if is_of_pair and not contacts.exclude[number]:
                acting.append(number)
        if not acting:
            return None
        # MuJoCo's normal points from a contact's first geom to its second, either of the two parts.
        signs = np.where(sides[contacts.geom[acting, 0]] == 1, 1.0, -1.0)
        normals = contacts.frame[acting, :3] * signs[:, None]
        mean = np.mean(normals, axis=0)
        length = float(np.linalg.norm(mean))
        # Opposite normals have no mean direction.
        normal = normals[0]
        if length > 0:
            normal = mean / length
        points = []
        for number in acting:
            solref = tuple(contacts.solref[number].tolist())
            solimp = tuple(contacts.solimp[number].tolist())
            first, second = contacts.geom[number].tolist()
            points.append(ContactPoint(solref, solimp, (first, second)))
        return PairContact(
            normal=normal,
            point=np.mean(contacts.pos[acting], axis=0),
            onset=float(contacts.includemargin[acting].max()),
            distance=float(contacts.dist[acting].min()),
            rows=tuple(points),
        )

    def narrowed(self, geoms: tuple[int, int]) -> ContactPair:
        """The same two parts with those geoms only that are rigid with `geoms`: of a robot, one
        link.

        geoms: numbers of the nearest geoms, of the first part and of the second.
        """
        weld = self.model.body_weldid
        sides = []
        for side, geom in zip((self.first, self.second), geoms, strict=True):
            body = int(self.model.geom_bodyid[geom])
            rigid = [g for g in side.geoms if weld[self.model.geom_bodyid[g]] == weld[body]]
            sides.append(NamedGeoms(side.name, body, tuple(rigid)))
        return ContactPair(self.model, *sides)

    def nearest(self, data: Any) -> Nearest:
        """Find the nearest points of the two parts, over all their geoms.

        data: MjData with its kinematics. The distance is below 0 where they overlap, and infinite
        where MuJoCo can compute none.
        """
        if self.height_field >= 0:
            return self._above_field(data)
        best = Nearest(
            np.inf, np.zeros(3), np.zeros(3), (self.first.geoms[0], self.second.geoms[0])
        )
        # Nearest point of the one geom, then of the other, m.
        ends = np.zeros(6)
        reach = self.reach
        for a in self.first.geoms:
            for b in self.second.geoms:
                distance = backend().mj_geomDistance(self.model, data, a, b, reach, ends)
                # MuJoCo gives `reach` for what is farther apart.
                if distance < min(best.distance, reach):
                    span = (ends[3:] - ends[:3]) * np.sign(distance)
                    length = float(np.linalg.norm(span))
                    if length > _LEAST_SPAN:
                        normal = span / length
                    else:
                        normal = self._normal_at_touch(data, a, b)
                    best = Nearest(distance, normal, (ends[3:] + ends[:3]) / 2, (a, b))
        return best

    def _normal_at_touch(self, data: Any, a: int, b: int) -> Floats:
        """Normal of two geoms whose nearest points coincide, (3,): the way in which their distance
        falls fastest when the first is moved; 0 where that tells no direction.

        data: MjData with the kinematics.
        a, b: numbers of the geoms.
        """
        moved = copy.copy(data)
        short = _NUDGE * self.size
        ends = np.zeros(6)
        slope = np.zeros(3)
        for axis in range(3):
            for sign in (1.0, -1.0):
                moved.geom_xpos[a] = data.geom_xpos[a]
                moved.geom_xpos[a, axis] += sign * short
                distance = backend().mj_geomDistance(self.model, moved, a, b, self.reach, ends)
                slope[axis] += sign * distance / (2.0 * short)
        length = float(np.linalg.norm(slope))
        return -slope / length if length > _LEAST_SLOPE else np.zeros(3)

    def _above_field(self, data: Any) -> Nearest:
        """Estimate the nearest points of a height field and the other part's first geom: the normal is
        the field's upward axis, the distance the height, m, of the geom's bounding sphere over the
        field's highest possible point.

        data: MjData with the kinematics.
        It is for a pair in which one geom is a height field.
        """
        field = self.height_field
        model = self.model
        up = data.geom_xmat[field].reshape(3, 3)[:, 2]
        is_second = field in self.second.geoms
        other = self.first.geoms[0] if is_second else self.second.geoms[0]
        centre = data.geom_xpos[other]
        # The third size of a height field is its highest elevation, m.
        top = model.hfield_size[model.geom_dataid[field]][2]
        height = (
            float(up @ (centre - data.geom_xpos[field]))
            - float(model.geom_rbound[other])
            - float(top)
        )
        if is_second:
            return Nearest(height, -up, centre.copy(), (other, field))
        return Nearest(height, up.copy(), centre.copy(), (field, other))
