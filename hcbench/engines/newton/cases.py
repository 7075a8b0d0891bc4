# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Newton's solvers, many worlds at once.

SolverMuJoCo bounces by ke and kd, for a contact of 20 steps.
"""

from functools import partial
from typing import Any

import newton
import numpy as np
import warp


class NewtonBodies:
    version = newton.__version__

    def __init__(
        self, solver: str, combine: str | None, options: dict[str, Any], suffix: str = ""
    ) -> None:
        self.name, self.combine, self.options = f"newton-{solver.lower()}{suffix}", combine, options
        self.solver, self.builder = (
            getattr(newton.solvers, f"Solver{solver}"),
            newton.ModelBuilder(),
        )

    def make(self, world: dict[str, Any]) -> None:
        self.h, angle = world["timestep"], 1.5
        e, floor = world.get("materials", [world.get("restitution")] * 2)
        common = {"mu": max(world["friction"], 1e-5), "mu_torsional": 0.0, "mu_rolling": 0.0}
        if e and not self.combine:
            if self.name != "newton-mujoco":
                raise NotImplementedError("has no restitution")
            # The force of the contact ends at e = exp(-2 angle/tan(angle)): solved by iteration.
            for _ in range(99):
                angle = np.arctan2(2 * angle, -np.log(e))
            common |= {
                "ke": (np.pi / 20 / self.h) ** 2,
                "kd": np.pi / 10 / self.h * np.cos(angle) + 1e-6,
            }
        self.builder.begin_world(gravity=world["gravity"])
        for body in world["bodies"]:
            i, at, size = (
                -1,
                (*body["position"], 0, 0, 0, 1),
                body.get("half", [body.get("radius")] * 3),
            )
            if body["shape"] == "mesh":
                size = np.max(body["vertices"], axis=0)
            if not body.get("fixed"):
                i, at = self.builder.add_body(xform=at), (0.0,) * 6 + (1.0,)
                self.builder.joint_qd[-6:] = [*body["velocity"], *body["spin"]]
            kind, volume = (
                body["shape"].upper(),
                np.prod(size) * (4 / 3 * np.pi if body["shape"] == "sphere" else 8),
            )
            cfg = self.builder.ShapeConfig(
                density=float(body["mass"] / volume), restitution=e, **common
            )
            if kind == "MESH":
                faces = np.array(body["faces"]).ravel()
                mesh = newton.Mesh(np.array(body["vertices"], np.float32), faces)
                self.builder.add_shape_mesh(body=i, xform=at, mesh=mesh, cfg=cfg)
                continue
            self.builder.add_shape(body=i, type=newton.GeoType[kind], xform=at, scale=size, cfg=cfg)
        if world["floor"]:
            self.builder.add_ground_plane(cfg=self.builder.ShapeConfig(restitution=floor, **common))
        self.builder.end_world()

    def start(self) -> None:
        self.builder.color()
        model = self.builder.finalize()
        # For the worlds to come.
        self.builder = newton.ModelBuilder()
        self.worlds = model.world_count
        # Contacts that there is room for: Newton's default is 1000 for one world.
        model.rigid_contact_max = 16 * self.worlds
        self.stepper = self.solver(model, **self.options)
        self.at = model.state()
        self.after = model.state()
        newton.eval_fk(model, model.joint_q, model.joint_qd, self.at)
        with warp.ScopedCapture() as self.captured:
            self.contacts = model.collide(self.at)
            self.stepper.step(self.at, self.after, None, self.contacts, self.h)
            self.at.assign(self.after)

    def step(self) -> None:
        warp.capture_launch(self.captured.graph)

    def state(self) -> Any:
        return np.hstack([self.at.body_q.numpy()[:, :3], self.at.body_qd.numpy()]).reshape(
            self.worlds, -1, 9
        )


# Each solver, how it joins two restitutions, and its options.
ENGINES = [
    partial(NewtonBodies, "XPBD", "average", {"enable_restitution": True, "iterations": 10}),
    partial(NewtonBodies, "Kamino", "minimum", {}),
    partial(NewtonBodies, "Steel", "average", {"restitution_velocity_threshold": 0.0}),
    partial(NewtonBodies, "VBD", None, {}),
    partial(NewtonBodies, "MuJoCo", None, {"cone": "elliptic", "impratio": 100.0}),
    partial(NewtonBodies, "SemiImplicit", None, {"angular_damping": 0}),
    partial(NewtonBodies, "Featherstone", None, {"angular_damping": 0}),
    # With nothing chosen but restitution and friction.
    partial(NewtonBodies, "XPBD", "average", {}, "-stock"),
    partial(NewtonBodies, "Kamino", "minimum", {}, "-stock"),
    partial(NewtonBodies, "Steel", "average", {}, "-stock"),
    partial(NewtonBodies, "VBD", None, {}, "-stock"),
    partial(NewtonBodies, "MuJoCo", None, {}, "-stock"),
    partial(NewtonBodies, "SemiImplicit", None, {}, "-stock"),
    partial(NewtonBodies, "Featherstone", None, {}, "-stock"),
]
