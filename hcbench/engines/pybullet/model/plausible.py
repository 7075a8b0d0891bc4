"""Refuses a world whose numbers no bouncing body has, as PyBullet read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.engines.pybullet.model.causes import BODY_TYPE, MAXIMAL_COORDINATES
from hcbench.system.errors import SceneError
from hcbench.terms.units import require_bounds

if TYPE_CHECKING:
    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.open import BodyPart
    from hcbench.engines.pybullet.model.place import BulletPlacement

# Quantity, its place in getDynamicsInfo, and its unit.
_CHECKED = (("mass", 0, "kg"), ("friction", 1, ""), ("restitution", 5, ""))
# Place in getDynamicsInfo.
_INERTIA = 2
# Places in getCollisionShapeData.
_SHAPE = 2
_SIZES = 3
# Kinds of shapes that have no sizes.
_PLANE = 6
_MESH = 5


def require_plausible(bullet: BulletClient, place: BulletPlacement) -> None:
    """Look at the time step, gravity and the two that meet. Raises SceneError and QuantityError."""
    parameters = bullet.getPhysicsEngineParameters()
    require_bounds("timestep", [parameters["fixedTimeStep"]], "timestep", "s")
    gravity = [parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"]
    require_bounds("gravity", gravity, "acceleration", "m/s^2")
    for side in (place.first, place.second):
        _require_plausible_part(bullet, side)


def _require_plausible_part(bullet: BulletClient, side: BodyPart) -> None:
    """Look at the mass, friction, restitution, inertia and shapes of one of the two.

    Raises SceneError and QuantityError.
    """
    info = bullet.getDynamicsInfo(side.body, side.link)
    for quantity, place, unit in _CHECKED:
        slot = f"{quantity} of {side.name!r}"
        value = float(info[place])
        # Written so that NaN is refused, too.
        if not value >= 0:
            raise SceneError(slot, f"{value:g}", "a number of 0 or more")
        require_bounds(slot, [value], quantity, unit)
    if not all(value >= 0 for value in info[_INERTIA]):
        raise SceneError(f"inertia of {side.name!r}", f"{info[_INERTIA]}", "numbers of 0 or more")
    if info[BODY_TYPE] == MAXIMAL_COORDINATES:
        # PyBullet has no shapes to read of such bodies.
        return
    for shape in bullet.getCollisionShapeData(side.body, side.link):
        if shape[_SHAPE] not in (_PLANE, _MESH):
            require_bounds(f"size of {side.name!r}", shape[_SIZES], "length", "m", smallest=0.0)
