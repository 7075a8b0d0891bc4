"""Many balls in one MuJoCo model, each with the same bits as alone.

MuJoCo's cost per step is mostly its own housekeeping, so balls that share a model are several times cheaper.
They do not touch each other: their collisions with one another are off, and each is a constraint island of
its own, solved and judged converged by itself. Two things would still let balls be felt by others: a warm
start, which is taken or not for the whole model at once, and a sparse Jacobian, which adds up in another
order from ten balls on. The first is off in every model that is flown, the second in a crowd.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.impact import Floats

# Islands judge their convergence by their own inertia from here on; before, by that of the whole model.
_SINCE = (3, 17)
_NQ, _NV = 7, 6  # of a free body
# Attributes that refer to something by name, and to what kind of thing.
_REFERENCES = {
    **dict.fromkeys(("body", "body1", "body2", "target"), "body"),
    **dict.fromkeys(("geom", "geom1", "geom2"), "geom"),
    **dict.fromkeys(("site", "sidesite"), "site"),
    "objname": "body",  # of the one sensor there may be, our own
}
_BITS = 15  # of contype and conaffinity that may be in use: two such numbers fit into one
_MASK = (1 << _BITS) - 1


@dataclass(frozen=True, slots=True)
class Crowd:
    """A compiled model of `size` balls.

    at: where position and velocity of the ball start in a full state of the model of one. A state of more is
    time, then 7 positions a ball, then 6 velocities a ball.
    """

    model: Any
    size: int
    at: tuple[int, int]

    def pack(self, states: Floats) -> Floats:
        """States of one ball each, shape (b, nstate), as states of `size`; the last one fills up."""
        if self.size == 1:
            return states
        rows = -(-len(states) // self.size)
        fill = np.minimum(np.arange(rows * self.size), len(states) - 1)
        packed = np.empty((rows, 1 + (_NQ + _NV) * self.size))
        packed[:, 0] = states[0, 0]
        for start, width, inner in self._spans():
            packed[:, start : start + width * self.size] = states[fill, inner : inner + width].reshape(
                rows, -1
            )
        return packed

    def unpack(self, packed: Floats, states: Floats) -> Floats:
        """Back from `pack`: `states` with the time, positions and velocities of `packed`."""
        if self.size == 1:
            return packed.copy()
        states = states.copy()
        states[:, 0] = packed[0, 0]
        for start, width, inner in self._spans():
            own = packed[:, start : start + width * self.size].reshape(-1, width)
            states[:, inner : inner + width] = own[: len(states)]
        return states

    def columns(self, path: Floats, component: tuple[int, int], count: int) -> Floats:
        """One number of each of `count` balls over a path of states (rows, n, nstate), shape (count, n).

        component: 0 and 0 ... 6 for positions, 1 and 0 ... 5 for velocities.
        """
        kind, i = component
        if self.size == 1:
            return path[:, :, self.at[kind] + i]
        start, width, _ = self._spans()[kind]
        picked = path[:, :, start + i : start + width * self.size : width]
        return picked.transpose(0, 2, 1).reshape(-1, path.shape[1])[:count]

    def _spans(self) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """Of positions and of velocities: where in a packed state, how many a ball, where in one's state."""
        return (1, _NQ, self.at[0]), (1 + _NQ * self.size, _NV, self.at[1])


def can_crowd(mujoco: Any, model: Any, root: ET.Element) -> bool:
    """Whether several of the one ball of a model would keep its bits."""
    version = tuple(int(part) for part in mujoco.__version__.split(".")[:2])
    option = model.opt
    solved_apart = (
        version >= _SINCE
        and not option.disableflags & mujoco.mjtDisableBit.mjDSBL_ISLAND
        and not option.enableflags
        and option.solver == mujoco.mjtSolver.mjSOL_NEWTON
        and not option.noslip_iterations
        and option.jacobian != mujoco.mjtJacobian.mjJAC_SPARSE
    )
    sizes = ("nmocap", "na", "nu", "neq", "nflex", "nplugin", "nuserdata")
    sections = ("equality", "actuator", "deformable", "extension")
    moves_alone = (
        model.njnt == 1
        and model.nsensor <= 1
        and not any(getattr(model, size) for size in sizes)
        and not any(True for tag in sections for _ in root.iterfind(tag))
    )
    return bool(solved_apart and moves_alone and _touches_in_one_way(model))


def _touches_in_one_way(model: Any) -> bool:
    """Whether the ball can touch by pairs that are written out, or else by one pair of geoms at most."""
    contype, conaffinity = model.geom_contype, model.geom_conaffinity
    if ((contype | conaffinity) & ~_MASK).any():
        return False
    moving = model.body_weldid[model.geom_bodyid] != 0
    found = {
        frozenset((int(b), int(o)))
        for b in np.flatnonzero(moving)
        for o in np.flatnonzero(~moving)
        if contype[b] & conaffinity[o] or contype[o] & conaffinity[b]
    }
    written = {frozenset((int(a), int(b))) for a, b in zip(model.pair_geom1, model.pair_geom2, strict=True)}
    return not found - written if written else len(found) <= 1


def crowd(mujoco: Any, root: ET.Element, disable: int, size: int, at: tuple[int, int]) -> Crowd:
    """`size` times the ball of a model that can be, compiled with these flags disabled."""
    spec = mujoco.MjSpec.from_string(ET.tostring(_repeated(root, size), encoding="unicode"))
    _part(spec)
    model = spec.compile()
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model.opt.disableflags = disable
    assert (model.nq, model.nv) == (_NQ * size, _NV * size)
    return Crowd(model, size, at)


def _repeated(root: ET.Element, size: int) -> ET.Element:
    """MJCF with copies of the ball, and of what refers to it by name."""
    root = copy.deepcopy(root)
    for keyframe in root.findall("keyframe"):  # made for one ball
        root.remove(keyframe)
    ball = next(body for body in root.iter("body") if body.get("name") == "ball")
    names = {tag: {e.get("name") for e in ball.iter(tag)} - {None} for tag in ("body", "geom", "site")}
    holders = [next(e for e in root.iter() if ball in list(e))]
    holders += [e for tag in ("contact", "tendon", "sensor") for e in root.findall(tag)]
    for holder in holders:
        own = [e for e in holder if e is ball or any(_refers(part, names) for part in e.iter())]
        for i in range(1, size):
            for element in own:
                holder.append(_renamed(copy.deepcopy(element), names, f"#{i}"))
    return root


def _refers(element: ET.Element, names: Mapping[str, set[str | None]]) -> bool:
    return any(element.get(key) in names[kind] for key, kind in _REFERENCES.items())


def _renamed(element: ET.Element, names: Mapping[str, set[str | None]], suffix: str) -> ET.Element:
    for part in element.iter():
        if "name" in part.attrib:
            part.set("name", part.attrib["name"] + suffix)
        for key, kind in _REFERENCES.items():
            if part.get(key) in names[kind]:
                part.set(key, part.attrib[key] + suffix)
    return element


def _part(spec: Any) -> None:
    """Let balls collide with what does not move as before, and never with each other."""
    for geom in spec.geoms:
        geom.conaffinity |= geom.contype << _BITS
        geom.contype = 0
    for body in spec.bodies:
        if body.name == "ball" or body.name.startswith("ball#"):
            for geom in body.find_all("geom"):
                geom.contype = geom.conaffinity >> _BITS | (geom.conaffinity & _MASK) << _BITS
                geom.conaffinity = 0
