"""A robot over the parts of the world that it can land on: which one falls, by which joint, and how
far it is above them.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name
from hcbench.engines.mujoco.model.find_pair import named_pair, only_pair
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from hcbench.sim.model_under_test import Request
    from hcbench.terms.impact import Floats

# Cosine of the angle to gravity below which a slide does not carry a base down.
_VERTICAL = 0.9
_EXPECTED = "pairs of a robot, which has actuators and can fall, with what stands still"
# A floor is looked for this far below a robot, and as far above one that starts inside it, m.
_FARTHEST = 10.0
# Step of that search, m, and halvings of it afterwards: after 40 the height is exact to rounding.
_SCAN = 0.01
_ROUNDS = 40


class OverFloor:
    """A robot in a compiled model, and what stands still around it.

    root: number of the robot's base body; all that hangs on it is the robot.
    gravity: m/s²; up: unit vector against it, (3,). mass: kg; weight: N.
    of_robot, of_floor: of each geom whether it is the robot's, and whether it stands still,
    (ngeom + 1,). A contact of a flex has the geom -1, which finds the False at their ends.
    """

    def __init__(self, model: Any, root: int) -> None:
        """Read the robot whose base has this number; the model must have gravity."""
        self.model = model
        self.root = root
        self.gravity = float(np.linalg.norm(model.opt.gravity))
        self.up: Floats = -np.asarray(model.opt.gravity) / self.gravity
        self.mass = float(model.body_subtreemass[root])
        self.weight = self.mass * self.gravity
        body_of_geom = np.asarray(model.geom_bodyid)
        self.of_robot = np.append(model.body_rootid[body_of_geom] == root, False)
        # MuJoCo welds what stands still to the world, whose number is 0.
        self.of_floor = np.append(model.body_weldid[body_of_geom] == 0, False)

    @property
    def name(self) -> str:
        """Name of the robot's base."""
        return body_name(self.model, self.root)

    def between(self, geoms: NDArray[Any]) -> NDArray[np.bool_]:
        """Say of each contact whether it is one of the robot with what stands still, (n,).

        geoms: numbers of the two geoms of each contact, (n, 2), in either order.
        """
        touches_robot = self.of_robot[geoms].any(axis=1)
        touches_floor = self.of_floor[geoms].any(axis=1)
        return np.asarray(touches_robot & touches_floor)

    def is_touching(self, data: Any) -> bool:
        """Say whether the robot touches what stands still in the pose that `data` has."""
        backend().mj_fwdPosition(self.model, data)
        contacts = data.contact
        acts = (contacts.dist <= 0.0) & (contacts.exclude == 0)
        return bool((self.between(contacts.geom) & acts).any())

    def way_up(self, data: Any, address: int, way: Floats) -> float:
        """Height by which to raise the robot of a pose until it just clears the floor, m; below 0
        to lower it.

        data: MjData with the pose, which stays as it is.
        address, way: where in qpos the joint begins by which the robot falls, and the change of its
        numbers, (k,), that raises the robot by 1 m.
        Raises UserError where the robot meets nothing within _FARTHEST.
        """
        raised = copy.copy(data)
        numbers = slice(address, address + len(way))

        def is_touching_at(height: float) -> bool:
            raised.qpos[:] = data.qpos
            raised.qpos[numbers] += height * way
            return self.is_touching(raised)

        return _way_up(is_touching_at, self.name)


def _way_up(is_touching_at: Callable[[float], bool], robot: str) -> float:
    """Height by which to raise a robot until it just clears the floor, m; below 0 to lower it.

    is_touching_at: whether the robot touches the floor when it is raised by a height, m. robot: its
    name in errors. Raises UserError where nothing is below it.
    """
    # Up, out of the floor that it is in, or down to where it first touches.
    is_in_floor = is_touching_at(0.0)
    step = _SCAN if is_in_floor else -_SCAN
    for i in range(1, round(_FARTHEST / _SCAN)):
        end = step * i
        if is_touching_at(end) is not is_in_floor:
            break
    else:
        raise UserError(
            "model",
            f"{robot!r} has nothing below to land on, down to {_FARTHEST:g} m",
            "a floor",
            'Add a floor: <geom type="plane" size="0 0 1"/> in the worldbody',
        )
    # Between the two heights the touch begins: it touches at the lower one alone.
    low = end
    high = end + _SCAN
    if is_in_floor:
        low = end - _SCAN
        high = end
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        if is_touching_at(middle):
            low = middle
        else:
            high = middle
    return high


def turn_base(data: Any, address: int, turn: Floats) -> None:
    """Turn a robot's base about its own origin, in the pose that `data` has.

    address: where its free joint begins in qpos: place (3), then quaternion w x y z.
    turn: quaternion, w x y z, (4,), in the world.
    """
    attitude = slice(address + 3, address + 7)
    turned = np.zeros(4)
    backend().mju_mulQuat(turned, turn, data.qpos[attitude].copy())
    data.qpos[attitude] = turned


def robot_in(model: Any, requests: Sequence[Request]) -> int:
    """Number of the root body of the robot of which each pair has one part.

    model: compiled. requests: of the pairs; without names, the only pair that the model has.
    Raises UserError where the robot has no actuators, and what `falling_root` raises.
    """
    root = falling_root(model, requests)
    if not _is_driven(model, root):
        raise UserError("pair", "no actuator drives the body", _EXPECTED)
    return root


def falling_root(model: Any, requests: Sequence[Request]) -> int:
    """Number of the root body of the one tree of which each pair has one part.

    model: compiled. requests: of the pairs; without names, the only pair that the model has.
    Raises UserError where a pair is missing or unknown, where both or none of its parts move, for
    parts of several trees, without gravity, and for a base that cannot fall.
    """
    roots = set()
    for request in requests:
        names = request.pair or only_pair(model)
        if names is None:
            raise UserError("pair", "missing", _EXPECTED)
        pair = named_pair(model, names)
        one, two = pair.first.body, pair.second.body
        moving = [body for body in (one, two) if model.body_weldid[body]]
        if len(moving) != 1:
            raise UserError("pair", ",".join(names), _EXPECTED)
        roots.add(int(model.body_rootid[moving[0]]))
    if len(roots) != 1:
        raise UserError("pair", "parts of several robots", _EXPECTED, "Tune them one by one")
    root = roots.pop()
    gravity = np.asarray(model.opt.gravity)
    off = model.opt.disableflags & backend().mjtDisableBit.mjDSBL_GRAVITY
    if off or not gravity.any():
        raise UserError("gravity", "the model has none", _EXPECTED, "Try --gravity 9.81")
    falling_joint(model, root, -gravity / np.linalg.norm(gravity))
    return root


def _is_driven(model: Any, root: int) -> bool:
    """Say whether an actuator moves a joint in the tree of a root body, by its number."""
    kinds = backend().mjtTrn
    in_tree = model.body_rootid[model.jnt_bodyid] == root
    for actuator in range(model.nu):
        kind = int(model.actuator_trntype[actuator])
        if kind in (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)):
            if in_tree[model.actuator_trnid[actuator, 0]]:
                return True
        # Tendons, sites and bodies: of a tree with joints of its own beside its base.
        elif in_tree.sum() > 1:
            return True
    return False


def falling_joint(model: Any, root: int, up: Floats) -> tuple[int, Floats]:
    """(where in qpos the joint begins by which a robot falls; change of its numbers that raises the
    robot by 1 m: (3,) of a free joint, (1,) of a slide).

    root: number of the robot's base. up: unit vector, (3,).
    Raises UserError for a base with neither a free joint nor a slide within 26 degrees of up.
    """
    kinds = backend().mjtJoint
    first = int(model.body_jntadr[root])
    for joint in range(first, first + int(model.body_jntnum[root])):
        address = int(model.jnt_qposadr[joint])
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_FREE):
            return address, up
        along = float(model.jnt_axis[joint] @ up)
        if int(model.jnt_type[joint]) == int(kinds.mjJNT_SLIDE) and abs(along) > _VERTICAL:
            return address, np.array([1.0 / along])
    name = str(model.body(root).name)
    got = f"the base {name!r} cannot fall"
    raise UserError("pair", got, "a robot whose base has a free joint or a vertical slide")
