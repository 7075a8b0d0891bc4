# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Newton's solvers, many worlds at once; SolverMuJoCo bounces by a damper, as MuJoCo's adapter does."""

from functools import partial
from itertools import combinations
from typing import Any

import newton
import numpy as np
import warp


class NewtonBodies:
    """An engine of `hcbench_cases`: one of Newton's solvers.

    gains: stiffness, m/h², and damping, m/h, by its name.
    """

    version = newton.__version__
    # Of a contact, in m/h² and m/h: the damper of 1 stops a body in a step. SemiImplicit and
    # Featherstone are unstable beyond.
    gains = dict.fromkeys(("newton-semiimplicit", "newton-featherstone"), (0.9, 1.0))
    gains["newton-vbd"] = (1e3, 0.0)

    def __init__(
        self, solver: str, combine: str | None, options: dict[str, Any], suffix: str = ""
    ) -> None:
        """Choose a solver, such as "VBD", and its options, keywords of its class.

        combine: how it joins two restitutions, a key of `hcbench_cases.COMBINE`; None where it
        cannot.
        suffix: the end of the engine's name.
        """
        self.name = f"newton-{solver.lower()}{suffix}"
        self.combine = combine
        self.options = options
        self.solver = getattr(newton.solvers, f"Solver{solver}")
        # The damper's numbers are those of pairs, which MuJoCo's own finder of contacts has.
        self.has_pairs = self.name == "newton-mujoco"
        # Steel's own damping of spins is 0.05/s.
        is_steel = self.name == "newton-steel"
        self.of_body = {"steel:rigid_body_angular_damping": 0.0} if is_steel else {}
        self.begin()

    def begin(self) -> None:
        self.builder = newton.ModelBuilder()
        if self.has_pairs or self.of_body:
            self.solver.register_custom_attributes(self.builder)

    def make(self, world: dict[str, Any]) -> None:
        """Add a world to those that `start` will step.

        world: in SI units: timestep, gravity, friction, restitution (or materials: e of the bodies
        and of the floor), bodies, and floor, true or false.
        Raises NotImplementedError for an e above 0 under a solver without restitution.
        """
        self.h = world["timestep"]
        builder = self.builder
        # e of the bodies, and of the floor.
        e, floor = world.get("materials", [world.get("restitution")] * 2)
        if self.combine is None and ((e and not self.has_pairs) or "materials" in world):
            raise NotImplementedError("has no restitution")
        mu = world["friction"]
        common = {"mu": max(mu, 1e-5), "mu_torsional": 0.0, "mu_rolling": 0.0, **self._gains(world)}
        if self.has_pairs:
            # With 1e6 a box does not rest; with less, friction changes a bounce.
            self.options["impratio"] = 1e6 if e else 100.0
        builder.begin_world(gravity=world["gravity"])
        first = builder.shape_count
        for body in world["bodies"]:
            # A shape's body, -1 for the world, and its place there: x y z, and no turn.
            i, at = -1, (*body["position"], 0, 0, 0, 1)
            if not body.get("fixed"):
                i = builder.add_body(xform=at, custom_attributes=self.of_body)
                at = (0.0,) * 6 + (1.0,)
                # Of the free joint that the body just got.
                builder.joint_qd[-6:] = [*body["velocity"], *body["spin"]]
            self._shape(i, at, body, builder.ShapeConfig(restitution=e, **common))
        if world["floor"]:
            builder.add_ground_plane(cfg=builder.ShapeConfig(restitution=floor, **common))
        if self.has_pairs:
            for pair in combinations(range(first, builder.shape_count), 2):
                self._damper(pair, e, mu)
        builder.end_world()

    def _gains(self, world: dict[str, Any]) -> dict[str, float]:
        """Keywords of Newton's ShapeConfig with the stiffness, N/m, and dampings, N s/m, of a contact;
        empty for those of Newton.

        world: of a case.
        They are scaled so that they suit its lightest body, in steps of `self.h`.
        """
        if self.name not in self.gains:
            return {}
        moving = [body for body in world["bodies"] if not body.get("fixed")]
        # Points that share the load of a contact.
        points = max({"sphere": 1, "box": 4, "mesh": 32}[b["shape"]] for b in world["bodies"])
        # The damping, N s/m, that stops the lightest body within a step.
        stopping = min(body["mass"] for body in moving) / (self.h * points)
        stiffness, damping = self.gains[self.name]
        return {"ke": stiffness * stopping / self.h, "kd": damping * stopping, "kf": stopping / 2}

    def _shape(self, i: int, at: Any, body: dict[str, Any], cfg: Any) -> None:
        """Add the shape of a body to the world that has begun.

        i: number of Newton's body, -1 for the world itself.
        at: its place in the body, x y z and quaternion.
        body: of the case, SI.
        cfg: Newton's ShapeConfig, whose density is set here.
        """
        # Half sizes, m; of a mesh its largest coordinates, as of the box around it.
        size = body.get("half", [body.get("radius")] * 3)
        if body["shape"] == "mesh":
            size = np.max(body["vertices"], axis=0)
        volume = np.prod(size) * (4 / 3 * np.pi if body["shape"] == "sphere" else 8)
        cfg.density = float(body["mass"] / volume)
        if body["shape"] == "mesh":
            faces = np.array(body["faces"]).ravel()
            mesh = newton.Mesh(np.array(body["vertices"], np.float32), faces)
            self.builder.add_shape_mesh(body=i, xform=at, mesh=mesh, cfg=cfg)
        else:
            kind = newton.GeoType[body["shape"].upper()]
            self.builder.add_shape(body=i, type=kind, xform=at, scale=size, cfg=cfg)

    def _damper(self, pair: tuple[int, int], e: float, mu: float) -> None:
        """Add a <pair> of two shapes to Newton's MuJoCo solver; MuJoCo's adapter gives the reasons
        for its numbers.

        pair: numbers of the two shapes.
        e: restitution.
        mu: friction; 0 for a contact without.
        """
        # The impedance: a soft row where friction would change a bounce, else a stiff one.
        share = 1e-4 if e and mu else 0.9999
        values: dict[str, Any] = {"geom1": pair[0], "geom2": pair[1], "condim": 3 if mu else 1}
        values |= {
            "friction": [mu, mu, 0.0, 0.0, 0.0],
            "solref": [0.0, -(1 + e) / self.h] if e else [0.02, 1.0],
            "solreffriction": [0.0, -share / self.h],
            "solimp": [share, share, 0.001, 0.5, 2.0],
        }
        self.builder.add_custom_values(**{f"mujoco:pair_{k}": v for k, v in values.items()})

    def start(self) -> None:
        """Start all worlds that were added since the last start, with one step captured as a graph
        of the GPU.
        """
        # VBD solves bodies of one color at once; the other solvers do without.
        self.builder.color()
        self.model = model = self.builder.finalize()
        # A new builder, for the worlds to come.
        self.begin()
        self.worlds = model.world_count
        # Contacts that there is room for: Newton's default is 1000 for one world.
        model.rigid_contact_max = 16 * self.worlds
        self.stepper = self.solver(model, **self.options)
        # The states before and after a step.
        self.at, self.after = model.state(), model.state()
        # Places of the bodies from those of their joints.
        newton.eval_fk(model, model.joint_q, model.joint_qd, self.at)
        self.capture()

    def capture(self) -> None:
        with warp.ScopedCapture() as self.captured:
            self.step_once()

    def step_once(self) -> None:
        self.contacts = self.model.collide(self.at)
        self.stepper.step(self.at, self.after, None, self.contacts, self.h)
        self.at.assign(self.after)

    def step(self) -> None:
        warp.capture_launch(self.captured.graph)

    def state(self) -> Any:
        now = np.hstack([self.at.body_q.numpy()[:, :3], self.at.body_qd.numpy()])
        return now.reshape(self.worlds, -1, 9)


STEEL = {"restitution_velocity_threshold": 0.0, "baumgarte": 0.0}  # else it throws a mesh
# Each solver, how it joins two restitutions, and its options.
ENGINES = [
    partial(NewtonBodies, "XPBD", "average", {"enable_restitution": True, "iterations": 10}),
    partial(NewtonBodies, "Kamino", "minimum", {}),
    partial(NewtonBodies, "Steel", "average", STEEL),
    partial(NewtonBodies, "VBD", None, {"iterations": 50}),
    partial(NewtonBodies, "MuJoCo", None, {"cone": "elliptic"}),
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
