"""A user's model whose pair bounces by the plug-in hcbench.restitution:
what it asks for, and its force.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.terms.resolution import ROUND_OFF_SOLVED

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.terms.impact import Floats

# The keys of an instance's config in the plug-in's order: MuJoCo keeps their values alone.
_KEYS = ("geom1", "geom2", "body1", "body2", "tendon", "alpha", "reading", "restitution")
_FORCE_KEYS = (
    *(*_KEYS[:5], "stiffness", "exponent", "alpha", "law", "restitution", "friction"),
    *("dynamic_friction", "slip_speed"),
)


def restitution_law(model: Any, geoms: Sequence[int]) -> RestitutionCurve | None:
    """Restitution that the plug-in gives a contact of two geoms; None if no instance names them."""
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
    """The config of the plug-in with these keys that names two geoms or
    their bodies; None without one.
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
    """The config of each plug-in instance that has as many values as there are keys."""
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
        self._model = copy.copy(model)
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self.data = mujoco.MjData(self._model)

    def step(self) -> Floats:
        """Step from the state in `data`; returns the velocities after it, shape (nv,)."""
        self._step(self._model, self.data)
        after: Floats = self.data.qvel
        return after

    def force(self, row: Floats, velocity: Floats, mass: float) -> float:
        """Mean force of the step from the state in `data` to `velocity`,
        N; 0 where rounding made it.

        row: (nv,), Jacobian of the approach rate.
        velocity: (nv,), after the step with the contact.
        mass: effective mass along the normal, kg.
        """
        apart = float(row @ self.step())
        together = float(row @ velocity)
        if abs(apart - together) <= ROUND_OFF_SOLVED * np.finfo(float).eps * (
            abs(apart) + abs(together)
        ):
            return 0.0
        return mass * (apart - together) / float(self._model.opt.timestep)
