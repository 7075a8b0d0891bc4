# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo: restitution by a damper alone, which turns the speed round within a step."""

from itertools import combinations
from typing import Any

import mujoco


class MujocoBodies:
    """An engine of `hcbench_cases`: MuJoCo with the best settings that are known."""

    name = "mujoco"
    version = mujoco.__version__
    combine = None
    # Impedance, 0 ... 1, of the rows of a contact with friction. Each row must act by itself, as one
    # of low impedance does: else the friction, which is solved with the normal force, changes the
    # restitution. The damper is as much stronger, so e stays.
    impedance_beside_friction = 1e-4

    def contact(self, e: float, friction: float, h: float) -> str:
        """Attributes of a <pair>, as text, that make it bounce with a restitution e.

        friction: the pair's coefficient. The text does not hold it: it only says whether there is
        any, as then the impedance is `impedance_beside_friction`.
        h: the step, s.
        """
        if e == 0:
            # MuJoCo's default solref, which hardly bounces, and carries weights.
            return f'solref="0.02 1" solreffriction="0 {-1 / h}" solimp=".9999 .9999 .001"'
        # A damper of (1 + e)/h turns v into -e v in a step of any phase.
        share = self.impedance_beside_friction if friction else 1.0
        d = min(share, 0.9999)
        own = f'solref="0 {-(1 + e) / h}" solreffriction="0 {-share / h}"'
        return f'{own} solimp="{d} {d} .001"'

    def option(self) -> str:
        """Attributes of the solver."""
        return 'cone="elliptic" impratio="1e6"'

    def make(self, world: dict[str, Any]) -> None:
        """Compile a model, its bodies at their start, with a <pair> of every two that can meet.

        world: in SI units: timestep, gravity, friction, restitution, bodies, and floor, true or
        false.
        Raises NotImplementedError for `materials`, restitutions of a material each, and in the
        stock setting for an e above 0.
        """
        if "materials" in world:
            raise NotImplementedError("has no restitution of a material")
        h = world["timestep"]
        mu = world["friction"]
        bodies = world["bodies"]
        friction = f'condim="{3 if mu else 1}" friction="{mu} {mu} 0 0 0"'
        contact = self.contact(world["restitution"], mu, h)
        names = [f"geom{i}" for i in range(len(bodies))]
        # Two of these never meet.
        fixed = {f"geom{i}" for i, body in enumerate(bodies) if body.get("fixed")} | {"floor"}
        geoms = "".join(self._body(i, body) for i, body in enumerate(bodies))
        if world["floor"]:
            names.insert(0, "floor")
            geoms += '<geom name="floor" type="plane" size="9 9 1"/>'
        pairs = ""
        for a, b in combinations(names, 2):
            if not {a, b} <= fixed:
                pairs += f'<pair geom1="{a}" geom2="{b}" {contact} {friction}/>'
        meshes = ""
        for i, body in enumerate(bodies):
            if body["shape"] == "mesh":
                corners, faces = _numbers(body["vertices"]), _numbers(body["faces"])
                meshes += f'<mesh name="mesh{i}" vertex="{corners}" face="{faces}"/>'
        pull = f'gravity="{" ".join(map(str, world["gravity"]))}"'
        option = f'<option timestep="{h}" {pull} {self.option()}/><asset>{meshes}</asset>'
        parts = f"<worldbody>{geoms}</worldbody><contact>{pairs}</contact>"
        self.model = mujoco.MjModel.from_xml_string(f"<mujoco>{option}{parts}</mujoco>")
        self.data = mujoco.MjData(self.model)
        moving = [body for body in bodies if not body.get("fixed")]
        # Velocity, m/s, and spin, rad/s, of each free joint.
        for i, body in enumerate(moving):
            self.data.qvel[6 * i : 6 * i + 6] = [*body["velocity"], *body["spin"]]

    def _body(self, i: int, body: dict[str, Any]) -> str:
        size = " ".join(map(str, body.get("half", [body.get("radius")])))
        shape = f'mesh="mesh{i}"' if body["shape"] == "mesh" else f'size="{size}"'
        geom = f'<geom name="geom{i}" type="{body["shape"]}" {shape} mass="{body["mass"]}"/>'
        joint = "" if body.get("fixed") else "<freejoint/>"
        return f'<body pos="{" ".join(map(str, body["position"]))}">{joint}{geom}</body>'

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)

    def state(self) -> list[list[float]]:
        mujoco.mj_kinematics(self.model, self.data)
        q, v = self.data.qpos.reshape(-1, 7), self.data.qvel.reshape(-1, 6)
        turns = self.data.xmat[self.model.jnt_bodyid].reshape(-1, 3, 3)
        return [[*a[:3], *b[:3], *(turn @ b[3:])] for a, b, turn in zip(q, v, turns, strict=True)]


class MujocoStock(MujocoBodies):
    """An engine of `hcbench_cases`: MuJoCo with nothing chosen but the friction."""

    name = "mujoco-stock"

    def contact(self, e: float, friction: float, h: float) -> str:
        if e:
            raise NotImplementedError("has no restitution: a solref must be chosen")
        return ""

    def option(self) -> str:
        return ""


def _numbers(rows: list[list[float]]) -> str:
    return " ".join(str(x) for row in rows for x in row)


ENGINES = [MujocoBodies, MujocoStock]
