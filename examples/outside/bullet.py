"""Worlds as people posted them in Bullet's issues: `hcbench measure --python bullet.py:wall`."""

from __future__ import annotations

from pathlib import Path

import pybullet as p
import pybullet_data

from hcbench.engines.pybullet.model.open import LiveWorld as World

DATA = Path(pybullet_data.getDataPath())


def drop() -> World:
    """bulletphysics/bullet3 issue 1530: an ideally bouncy ball that loses height, or gains it."""
    c = p.connect(p.DIRECT)
    p.setGravity(0, 0, -10, physicsClientId=c)
    p.setPhysicsEngineParameter(restitutionVelocityThreshold=0.2, physicsClientId=c)
    plane = p.loadURDF(str(DATA / "plane.urdf"), physicsClientId=c)
    sphere = p.loadURDF(str(DATA / "sphere_with_restitution.urdf"), [0, 0, 10], physicsClientId=c)
    for body in (plane, sphere):
        p.changeDynamics(body, -1, restitution=1, physicsClientId=c)
    return World(c, sphere, plane)


def wall() -> World:
    """bulletphysics/bullet3 issue 3094, "Sticky walls": a ball that is
    thrown at a wall and stays there.
    """
    return _wall(settled=False)


def wall_as_answered() -> World:
    """The same with the settings of the answer given there."""
    return _wall(settled=True)


def _wall(settled: bool) -> World:
    c = p.connect(p.DIRECT)
    if settled:
        p.setPhysicsEngineParameter(
            restitutionVelocityThreshold=0,
            warmStartingFactor=0,
            useSplitImpulse=True,
            contactSlop=0,
            enableConeFriction=False,
            physicsClientId=c,
        )
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 1, 1], physicsClientId=c)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.2, physicsClientId=c)
    ids = [
        p.createMultiBody(
            m, shape, basePosition=at, useMaximalCoordinates=settled, physicsClientId=c
        )
        for m, shape, at in ((0, box, [1.1, 0, 0]), (1, ball, [0, 0, 0]))
    ]
    for body in ids:
        p.changeDynamics(
            body, -1, restitution=1, linearDamping=0, angularDamping=0, physicsClientId=c
        )
        if settled:
            p.changeDynamics(body, -1, contactProcessingThreshold=0, physicsClientId=c)
    return World(c, ids[1], ids[0])
