"""Refuses a MuJoCo model, pose or contact whose numbers no bouncing body has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import geom_name
from hcbench.system.errors import QuantityError, SceneError, UserError
from hcbench.terms.units import BOUNDS, STANDARD_GRAVITY, admits_beyond_bounds, require_bounds

if TYPE_CHECKING:
    from hcbench.engines.mujoco.model.place import PairAtTouch


# Other units of length, and how many are in a metre.
_OTHER_UNITS = {"millimetres": 1000.0, "centimetres": 100.0}
# A gravity within this share of the Earth's is taken for the Earth's.
_EARTH = 0.02
# Length of the shortest quaternion that still names an attitude.
_LEAST_QUATERNION = 1e-3


def require_plausible_model(model: Any, label: str) -> None:
    """Refuse what the compiler lets through and no simulation survives.

    Raises SceneError and QuantityError.
    """
    for kind, field in (
        ("body", "mass"),
        ("body", "inertia"),
        ("geom", "size"),
        ("geom", "friction"),
    ):
        values = getattr(model, f"{kind}_{field}")
        bad = np.argwhere(~(np.isfinite(values) & ((values >= 0) | (field == "size"))))
        if bad.size:
            number = int(bad[0][0])
            value = float(values[tuple(bad[0])])
            got = f"{label}: {field} {value:g} of {kind} {getattr(model, kind)(number).name or number}"
            raise SceneError("model", got, "numbers of 0 or more")
    require_bounds(f"{label}: timestep", [float(model.opt.timestep)], "timestep", "s")
    if model.opt.timestep <= 0:
        raise SceneError(f"{label}: timestep", f"{model.opt.timestep:g} s", "a step above 0 s")
    _require_metres(label, float(np.linalg.norm(model.opt.gravity)))
    require_bounds(f"{label}: gravity", model.opt.gravity.tolist(), "acceleration", "m/s^2")
    require_bounds(f"{label}: mass", model.body_mass.tolist(), "mass", "kg", smallest=0.0)
    for kind in ("body", "geom", "site"):
        positions = getattr(model, f"{kind}_pos").ravel().tolist()
        require_bounds(f"{label}: position of a {kind}", positions, "position", "m")
    kinds = backend().mjtGeom
    flat = np.isin(model.geom_type, [int(kinds.mjGEOM_PLANE), int(kinds.mjGEOM_HFIELD)])
    require_bounds(
        f"{label}: size", model.geom_size[~flat].ravel().tolist(), "length", "m", smallest=0.0
    )


def _require_metres(label: str, gravity: float) -> None:
    """Refuse a model whose gravity is the Earth's in another unit of length. Raises QuantityError."""
    for unit, per_metre in _OTHER_UNITS.items():
        looks_like_it = abs(gravity / (STANDARD_GRAVITY * per_metre) - 1.0) < _EARTH
        if looks_like_it and not admits_beyond_bounds():
            raise QuantityError(
                f"{label}: gravity",
                f"{gravity:g}, the Earth's in {unit}",
                "a model in metres, kilograms and seconds",
                "Scale its lengths to metres; --beyond-bounds reads the numbers as metres",
            )


def require_plausible_state(model: Any, data: Any) -> None:
    """Refuse a pose of which a quaternion is 0 or a position is nowhere.

    Raises UserError, QuantityError.
    """
    kinds = backend().mjtJoint
    if not np.isfinite(data.qpos).all():
        raise UserError("qpos", "a number that is not finite", "finite numbers")
    for joint in range(model.njnt):
        kind = int(model.jnt_type[joint])
        at = int(model.jnt_qposadr[joint])
        name = model.joint(joint).name or str(joint)
        turns = {int(kinds.mjJNT_FREE): at + 3, int(kinds.mjJNT_BALL): at}.get(kind)
        if turns is not None and np.linalg.norm(data.qpos[turns : turns + 4]) < _LEAST_QUATERNION:
            raise QuantityError(
                "qpos", f"the quaternion of {name!r} is 0", "one of length 1, w x y z"
            )
        places = {int(kinds.mjJNT_FREE): 3, int(kinds.mjJNT_SLIDE): 1}.get(kind, 0)
        require_bounds(f"qpos: {name}", data.qpos[at : at + places].tolist(), "position", "m")


def require_plausible_contact(model: Any, place: PairAtTouch) -> None:
    """Refuse a contact that MuJoCo replaces, or whose friction no surface has."""
    if admits_beyond_bounds():
        return
    touching: set[int] = set()
    for row in place.contact.rows:
        touching.update(row.geoms)
        first, second, *_ = row.solref
        if (first > 0) != (second > 0):
            names = " and ".join(geom_name(model, geom) for geom in row.geoms)
            got = f"{first:g} {second:g} of {names}, which MuJoCo replaces by its default"
            expected = "both positive (time, damping ratio), or none above 0 (-stiffness, -damping)"
            raise QuantityError("solref", got, expected)
    _, largest = BOUNDS["friction"]
    for geom in touching:
        friction = float(model.geom_friction[geom, 0])
        if friction > largest:
            got = f"{friction:g} of geom {geom_name(model, geom)}"
            advice = "--beyond-bounds admits it, if it is meant"
            raise QuantityError("friction", got, f"0 ... {largest:g}", advice)
