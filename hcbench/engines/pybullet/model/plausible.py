"""Refuses a world whose numbers no bouncing body has, as PyBullet read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.engines.pybullet.model.causes import BODY_TYPE, MAXIMAL_COORDINATES
from hcbench.system.errors import SceneError
from hcbench.terms.bounds import require_bounds

if TYPE_CHECKING:
    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.place import BulletPlacement

# Places in getDynamicsInfo
_MASS, _FRICTION, _INERTIA, _RESTITUTION = 0, 1, 2, 5
_PLANE, _MESH = 6, 5  # kinds of shapes


def require_plausible(bullet: BulletClient, place: BulletPlacement) -> None:
    """Look at the time step, gravity and the two that meet. Raises SceneError and QuantityError."""
    parameters = bullet.getPhysicsEngineParameters()
    require_bounds("timestep", [parameters["fixedTimeStep"]], "timestep", "s")
    gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
    require_bounds("gravity", gravity, "acceleration", "m/s^2")
    for side in (place.first, place.second):
        info = bullet.getDynamicsInfo(side.body, side.link)
        for quantity, at in (("mass", _MASS), ("friction", _FRICTION), ("restitution", _RESTITUTION)):
            slot, value = f"{quantity} of {side.name!r}", float(info[at])
            if not value >= 0:
                raise SceneError(slot, f"{value:g}", "a number of 0 or more")
            require_bounds(slot, [value], quantity, "kg" if quantity == "mass" else "")
        if not all(value >= 0 for value in info[_INERTIA]):
            raise SceneError(f"inertia of {side.name!r}", f"{info[_INERTIA]}", "numbers of 0 or more")
        # PyBullet has no shapes to read of bodies with maximal coordinates.
        has_shapes = info[BODY_TYPE] != MAXIMAL_COORDINATES
        for shape in bullet.getCollisionShapeData(side.body, side.link) if has_shapes else ():
            if shape[2] not in (_PLANE, _MESH):
                require_bounds(f"size of {side.name!r}", shape[3], "length", "m", smallest=0.0)
