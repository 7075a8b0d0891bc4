# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""pymunk, an engine in two dimensions: python hcbench_cases.py
pymunk_adapter.py. Its y is z of the cases.
"""

import pymunk


class PymunkBodies:
    name, version, combine = "pymunk", pymunk.version, "product"

    def make(self, world):
        self.h = world["timestep"]
        self.space = pymunk.Space()
        self.space.gravity = world["gravity"][0], world["gravity"][2]
        e = world.get("restitution")
        e_body, e_floor = world["materials"] if e is None else (e**0.5, e**0.5)
        mu = world["friction"] ** 0.5
        self.moving = []
        for b in world["bodies"]:
            x, _, z = b["position"]
            if b["shape"] == "sphere":
                body = pymunk.Body(b["mass"], 0.4 * b["mass"] * b["radius"] ** 2)
                shape = pymunk.Circle(body, b["radius"])
            elif b["shape"] == "mesh":
                raise NotImplementedError("has no meshes")
            else:
                hx, _, hz = b["half"]
                body = pymunk.Body(b["mass"], b["mass"] / 3 * (hx * hx + hz * hz))
                shape = pymunk.Poly.create_box(body, (2 * hx, 2 * hz))
            if b.get("fixed"):
                body.body_type = pymunk.Body.STATIC
            body.position = x, z
            body.velocity = b["velocity"][0], b["velocity"][2]
            body.angular_velocity = -b["spin"][1]
            shape.elasticity, shape.friction = e_body, mu
            self.space.add(body, shape)
            if not b.get("fixed"):
                self.moving.append(body)
        if world["floor"]:
            floor = pymunk.Segment(self.space.static_body, (-99, -1), (99, -1), 1)
            floor.elasticity, floor.friction = e_floor, mu
            self.space.add(floor)

    def step(self):
        self.space.step(self.h)

    def state(self):
        return [
            [*self._at(b.position), *self._at(b.velocity), 0, -b.angular_velocity, 0]
            for b in self.moving
        ]

    @staticmethod
    def _at(v):
        return v.x, 0, v.y


ENGINES = [PymunkBodies]
