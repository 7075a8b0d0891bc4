"""Plain MuJoCo, nothing of hcbench's engines: rows pasted as pairs of a
fresh scene, simulated and read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from mujoco import rollout

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

STEEL_MASS = 0.45359237
STEEL_STIFFNESS = 3.4064e10
INCH = 0.0254


def pasted(
    options: dict[str, Any],
    timestep: float,
    mass: float,
    gravity: float = 0.0,
    radius: float = 2 * INCH,
) -> str:
    """A scene of a ball that slides along z over a plane, with one massless copy of its geom a row."""
    rows = options["rows"]
    balls = "".join(
        f'<geom name="ball{i}" type="sphere" size="{radius!r}" mass="{0.0 if i else mass!r}"'
        ' contype="0" conaffinity="0"/>'
        for i in range(len(rows))
    )
    pairs = "".join(
        f'<pair geom1="plate" geom2="ball{i}" condim="1" margin="{-row["onset"]!r}"'
        f' solref="{" ".join(map(repr, row["solref"]))}" solimp="{" ".join(map(repr, row["solimp"]))}"'
        + (f' adhesion="{row["adhesion"]!r}"/>' if row["adhesion"] else "/>")
        for i, row in enumerate(rows)
    )
    return (
        f'<mujoco><option timestep="{timestep!r}" integrator="{options["integrator"]}"'
        f' gravity="0 0 {-gravity!r}"/><worldbody>'
        '<geom name="plate" type="plane" size="1 1 .1" contype="0" conaffinity="0"/>'
        f'<body name="ball" pos="0 0 {radius!r}"><joint type="slide" axis="0 0 1"/>{balls}</body>'
        f"</worldbody><contact>{pairs}</contact></mujoco>"
    )


@dataclass(frozen=True)
class Flight:
    """restitution: (speeds, phases), NaN where still closed. x, v:
    (speeds, phases, steps), m and m/s.
    """

    restitution: Floats
    x: Floats
    v: Floats


def simulated(
    xml: str, timestep: float, speeds: Floats, duration: float, phases: int = 8
) -> Flight:
    model = mujoco.MjModel.from_xml_string(xml)
    phase = (np.arange(phases) + 0.37) / phases
    v_i, before = (grid.ravel() for grid in np.meshgrid(speeds, phase, indexing="ij"))
    state = np.zeros((len(v_i), mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    state[:, 1], state[:, 2] = (1 + before) * timestep * v_i, -v_i
    steps = int(duration / timestep) + 4
    states, _ = rollout.rollout(model, mujoco.MjData(model), state, nstep=steps)
    path = np.concatenate([state[:, None], states], axis=1)
    x, v = -path[:, :, 1], -path[:, :, 2]
    apart = (x[:, -1] < 0) & (v[:, -1] < 0)
    e = np.where(apart, -v[:, -1] / v_i, np.nan)
    shape = (len(speeds), phases)
    return Flight(e.reshape(shape), x.reshape(*shape, -1), v.reshape(*shape, -1))
