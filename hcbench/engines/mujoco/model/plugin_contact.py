"""A user's model whose pair bounces by the plug-in hcbench.restitution: what it asks for, and its force."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.resolution import ROUND_OFF_SOLVED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Floats
    from hcbench.laws.restitution import RestitutionCurve

# The keys of an instance's config in the plug-in's order: MuJoCo keeps their values alone.
_KEYS = ("geom1", "geom2", "body1", "body2", "tendon", "alpha", "reading", "restitution")
_FORCE_KEYS = (
    *(*_KEYS[:5], "stiffness", "exponent", "alpha", "law", "restitution", "friction"),
    *("dynamic_friction", "slip_speed"),
)


def restitution_law(model: Any, geoms: Sequence[int]) -> RestitutionCurve | None:
    """What the plug-in makes of a contact of two geoms; None where it has none of them."""
    config = _config(model, geoms, _KEYS)
    if config is None:
        return None
    if config["alpha"]:
        is_linear = config["reading"] == "linear"
        return Restitution(_number(model, config["alpha"]), "linear" if is_linear else "law")
    return ConstantRestitution(_number(model, config["restitution"]))


def has_force_law(model: Any, geoms: Sequence[int]) -> bool:
    """Whether the plug-in hcbench.hunt_crossley acts between two geoms, or their bodies."""
    return _config(model, geoms, _FORCE_KEYS) is not None


def _config(model: Any, geoms: Sequence[int], keys: Sequence[str]) -> dict[str, str] | None:
    """The config of the plug-in with these keys for two geoms or their bodies; None without one."""
    ends = [*model.plugin_attradr.tolist(), model.npluginattr][1:]
    for start, end in zip(model.plugin_attradr.tolist(), ends, strict=True):
        values = bytes(model.plugin_attr[start:end].astype(np.uint8)).decode().split("\0")[:-1]
        if len(values) != len(keys):  # another plug-in
            continue
        config = dict(zip(keys, values, strict=True))
        for kind, ids in (("geom", geoms), ("body", model.geom_bodyid[list(geoms)].tolist())):
            if {config[f"{kind}1"], config[f"{kind}2"]} == {getattr(model, kind)(i).name for i in ids}:
                return config
    return None


def _number(model: Any, text: str) -> float:
    """A number in a config, which may be the name of a <numeric>."""
    try:
        return float(text)
    except ValueError:
        return float(model.numeric(text).data[0])


class WithoutContact:
    """The model's own step with contact off, beside the one that is measured.

    A plug-in's impulse is no row of MuJoCo's solver: it is read off the velocities.
    """

    def __init__(self, model: Any) -> None:
        mujoco = backend()
        self._step, self._model = mujoco.mj_step, copy.copy(model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.data = mujoco.MjData(self._model)

    def force(self, row: Floats, velocity: Floats, mass: float) -> float:
        """Mean force of the step from the state in `data` to `velocity`, N.

        row: of the approach rate, shape (nv,). mass: effective, kg.
        """
        self._step(self._model, self.data)
        apart, together = float(row @ self.data.qvel), float(row @ velocity)
        if abs(apart - together) <= ROUND_OFF_SOLVED * np.finfo(float).eps * (abs(apart) + abs(together)):
            return 0.0
        return mass * (apart - together) / float(self._model.opt.timestep)
