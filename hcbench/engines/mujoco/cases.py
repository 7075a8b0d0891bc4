"""MuJoCo: restitution by a spring and a damper, which a step of Euler's does not shift."""

import math
from itertools import combinations
from typing import Any

import mujoco

# Steps of a contact.
CONTACT_STEPS = 20


def solref(e: float, h: float) -> str:
    """The solref with which a contact in discrete steps leaves at e, where the force is zero again."""
    if e == 0:
        # MuJoCo's default, which hardly bounces.
        return "0.02 1"
    # Bounds of the damping ratio.
    low, high = 0.0, 0.99
    for _ in range(60):
        z = (low + high) / 2
        w = math.sqrt(1 - z**2)
        is_too_high = math.exp(-z / w * math.atan2(2 * z * w, 2 * z * z - 1)) > e
        low, high = (z, high) if is_too_high else (low, z)
    # Angle of the undamped motion in a step.
    turn = math.pi / CONTACT_STEPS
    decay = math.exp(-z * turn)
    stiffness = (1 + decay**2 - 2 * decay * math.cos(w * turn)) / h**2
    damping = (1 - decay**2) / h
    return f"{-stiffness} {-damping}"


class MujocoBodies:
    name, version, combine = "mujoco", mujoco.__version__, None

    def make(self, world: dict[str, Any]) -> None:
        if "materials" in world:
            raise NotImplementedError("has no restitution of a material")
        h = world["timestep"]
        mu = world["friction"]
        bounce = solref(world["restitution"], h)
        pair = f'solref="{bounce}" solreffriction="0 {-1 / h}" solimp=".9999 .9999 .001"'
        names = []
        geoms = ""
        if world["floor"]:
            names.append("floor")
        for i, body in enumerate(world["bodies"]):
            names.append(f"geom{i}")
            geoms += self._body(i, body)
        if world["floor"]:
            geoms += '<geom name="floor" type="plane" size="9 9 1"/>'
        condim = 3 if mu else 1
        friction = f'condim="{condim}" friction="{mu} {mu} 0 0 0"'
        pairs = ""
        for a, b in combinations(names, 2):
            pairs += f'<pair geom1="{a}" geom2="{b}" {pair} {friction}/>'
        pull = f'gravity="{" ".join(map(str, world["gravity"]))}"'
        option = f'<option timestep="{h}" {pull} cone="elliptic" impratio="1e6"/>'
        parts = f"<worldbody>{geoms}</worldbody><contact>{pairs}</contact>"
        self.model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}{parts}</mujoco>")
        self.data = mujoco.MjData(self.model)
        moving = [body for body in world["bodies"] if not body.get("fixed")]
        for i, body in enumerate(moving):
            self.data.qvel[6 * i : 6 * i + 6] = body["velocity"] + body["spin"]

    def _body(self, i: int, body: dict[str, Any]) -> str:
        size = " ".join(map(str, body.get("half", [body.get("radius")])))
        geom = f'<geom name="geom{i}" type="{body["shape"]}" size="{size}" mass="{body["mass"]}"/>'
        joint = "" if body.get("fixed") else "<freejoint/>"
        return f'<body pos="{" ".join(map(str, body["position"]))}">{joint}{geom}</body>'

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)

    def state(self) -> list[list[float]]:
        mujoco.mj_kinematics(self.model, self.data)
        q, v = self.data.qpos.reshape(-1, 7), self.data.qvel.reshape(-1, 6)
        turns = self.data.xmat[self.model.jnt_bodyid].reshape(-1, 3, 3)
        return [[*a[:3], *b[:3], *(turn @ b[3:])] for a, b, turn in zip(q, v, turns, strict=True)]


ENGINES = [MujocoBodies]
