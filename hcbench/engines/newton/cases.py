"""Newton's solvers, many worlds at once. SolverMuJoCo bounces by ke and kd, for a contact of 20 steps."""

from typing import Any

import newton
import numpy as np

VARIANTS = [  # solver, how it joins two restitutions, options
    ("XPBD", "average", {"enable_restitution": True, "iterations": 10}), ("Kamino", "minimum", {}),
    ("Steel", "average", {"restitution_velocity_threshold": 0.0}), ("VBD", None, {}),
    ("MuJoCo", None, {"cone": "elliptic", "impratio": 100.0}),
    ("SemiImplicit", None, {"angular_damping": 0.0}), ("Featherstone", None, {"angular_damping": 0.0}),
]  # fmt: skip


class Engine:
    version = newton.__version__

    def __init__(self, solver: str, combine: str | None, options: dict[str, Any]) -> None:
        self.name, self.combine, self.options = f"newton-{solver.lower()}", combine, options
        self.solver, self.builder = getattr(newton.solvers, f"Solver{solver}"), newton.ModelBuilder()

    def make(self, world: dict[str, Any]) -> None:
        self.h, angle = world["timestep"], 1.5
        e, floor = world.get("materials", [world.get("restitution")] * 2)
        common = {"mu": max(world["friction"], 1e-5), "mu_torsional": 0.0, "mu_rolling": 0.0}
        if e and not self.combine:
            if self.name != "newton-mujoco":
                raise NotImplementedError("has no restitution")
            for _ in range(99):  # the force of the contact ends at e = exp(-2 angle/tan(angle))
                angle = np.arctan2(2 * angle, -np.log(e))
            common |= {"ke": (np.pi / 20 / self.h) ** 2, "kd": np.pi / 10 / self.h * np.cos(angle) + 1e-6}
        self.builder.begin_world(gravity=world["gravity"])
        for body in world["bodies"]:
            i, at, half = -1, (*body["position"], 0.0, 0.0, 0.0, 1.0), body.get("half")
            if not body.get("fixed"):
                i, at = self.builder.add_body(xform=at), (0.0,) * 6 + (1.0,)
                self.builder.joint_qd[-6:] = [*body["velocity"], *body["spin"]]
            kind, size = ("BOX", half) if half else ("SPHERE", (body["radius"], 0.0, 0.0))
            density = body["mass"] / (8 * float(np.prod(half)) if half else 4 / 3 * np.pi * size[0] ** 3)
            cfg = newton.ModelBuilder.ShapeConfig(density=density, restitution=e, **common)
            self.builder.add_shape(body=i, type=newton.GeoType[kind], xform=at, scale=size, cfg=cfg)
        if world["floor"]:
            self.builder.add_ground_plane(cfg=newton.ModelBuilder.ShapeConfig(restitution=floor, **common))
        self.builder.end_world()

    def start(self) -> None:
        _, self.model, self.builder = self.builder.color(), self.builder.finalize(), newton.ModelBuilder()
        self.stepper, self.contacts = self.solver(self.model, **self.options), self.model.contacts()
        self.now, self.after = self.model.state(), self.model.state()
        newton.eval_fk(self.model, self.model.joint_q, self.model.joint_qd, self.now)

    def step(self) -> None:
        self.model.collide(self.now, self.contacts)
        self.stepper.step(self.now, self.after, None, self.contacts, self.h)
        self.now, self.after = self.after, self.now

    def state(self) -> Any:
        bodies = np.hstack([self.now.body_q.numpy()[:, :3], self.now.body_qd.numpy()])
        return bodies.reshape(self.model.world_count, -1, 9)
