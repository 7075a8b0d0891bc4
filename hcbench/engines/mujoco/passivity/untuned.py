"""Side effects of a setting's cone and impratio, which are of the whole
model, on its other contacts.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings

if TYPE_CHECKING:
    from collections.abc import Mapping

_SLOPE = math.radians(10.0)
_SECONDS = 1.0
# Speeds of an oblique impact along the normal and along the plane, m/s, at so many phases.
_SPEED = 1.0
_SLIP = 0.5
_LAUNCHES = 8
_RADIUS = 0.05  # m


def effect_on_others(option: Mapping[str, str], timestep: float, gravity: float) -> str:
    """One sentence: drift, solver iterations and e of a contact that is not tuned, with MuJoCo's
    default cone and with the setting's options.

    option: attributes of the setting's <option>, such as cone and impratio.
    timestep: s. gravity: m/s².
    """
    before = {"cone": "pyramidal"}
    after = option
    with captured_warnings():
        drift, count, e = _measured(before, timestep, gravity)
        drift_after, count_after, e_after = _measured(after, timestep, gravity)
    change = max(abs(a - b) for a, b in zip(e, e_after, strict=True))
    return (
        f"Other contacts of the model: drift on 10 degrees {drift:.2g} -> {drift_after:.2g} mm/s, "
        f"solver iterations {count:.2g} -> {count_after:.2g}, e changes by at most {change:.2g}."
    )


def _measured(
    option: Mapping[str, str], timestep: float, gravity: float
) -> tuple[float, float, list[float]]:
    """(drift on a slope mm/s, solver iterations a step there, e of oblique impacts) of one contact.

    option: attributes of <option>. The e are of impacts at _LAUNCHES phases of a step.
    """
    mujoco = backend()
    model = _model(option, timestep, gravity, "0.02 1")
    model.opt.gravity[:] = gravity * np.array([math.sin(_SLOPE), 0.0, -math.cos(_SLOPE)])
    data = mujoco.MjData(model)
    iterations = 0
    half = 0.0
    steps = round(_SECONDS / timestep)
    for step in range(steps):
        if step == steps // 2:
            half = float(data.qpos[0])
        mujoco.mj_step(model, data)
        iterations += int(data.solver_niter[0])
    drift = 1e3 * (float(data.qpos[0]) - half) / (_SECONDS / 2)
    bouncing = _model(option, timestep, gravity, "0.02 0.2")
    e = [_bounce(bouncing, i / _LAUNCHES) for i in range(_LAUNCHES)]
    return drift, iterations / steps, e


def _model(option: Mapping[str, str], timestep: float, gravity: float, solref: str) -> Any:
    """Compiled model of a ball of 1 kg that may not turn, on a plane, in a contact by this solref.

    option: attributes of <option>. timestep: s. gravity: m/s², down.
    """
    slides = ""
    for axis in ("1 0 0", "0 1 0", "0 0 1"):
        slides += f'<joint type="slide" axis="{axis}"/>'
    options = " ".join(f'{key}="{value}"' for key, value in option.items())
    return backend().MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep!r}" gravity="0 0 {-gravity!r}" {options}/>'
        f'<default><geom solref="{solref}" friction="0.5"/></default><worldbody>'
        f'<geom type="plane" size="9 9 1"/><body pos="0 0 {_RADIUS}">{slides}'
        f'<geom size="{_RADIUS}" mass="1"/></body></worldbody></mujoco>'
    )


def _bounce(model: Any, phase: float) -> float:
    """Speed out over speed in of an impact that slides, 0 where the ball stays down.

    phase: of a step, from 0 to 1, by which it touches later. Speed out: after the first step that
    ends above the plane on the way up.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    step = model.opt.timestep
    data.qpos[2] = (1.0 + phase) * step * _SPEED
    data.qvel[0] = _SLIP
    data.qvel[2] = -_SPEED
    for _ in range(round(0.3 / step)):
        mujoco.mj_step(model, data)
        rate_up = float(data.qvel[2])
        if rate_up > 0.0 and data.qpos[2] > 0.0:
            return rate_up / _SPEED
    return 0.0
