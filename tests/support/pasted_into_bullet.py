"""Worlds of others for a text of hcbench for PyBullet: a covering design of how they load their
bodies and what they set before and after the text; and e by a loop of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from covering import covering_rows

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FACTORS: dict[str, Sequence[Any]] = {
    "coordinates": ("reduced", "maximal"),
    "floor": ("plane", "box", "mesh"),
    "gravity": (9.81, 0.0, 1.62, 24.8),
    "before": ("", "ERP 0.1", "restitution 1 of both", "0.2 ms", "4 sub-steps"),
    "after": (
        "",
        "0.5 ms",
        "5 ms",
        "4 sub-steps",
        "damping 0.5",
        "ERP 0.2",
        "threshold 0.5 m/s",
        "processing threshold 0.02",
        "restitution 0.5 of the plate",
        "restitution 0.3 of the ball",
        "no plug-in",
    ),
    "order": ("ball first", "plate first"),
    "others": (0, 2),
}
_CALLS = {
    "": "",
    "0.2 ms": "pybullet.setTimeStep(2e-4)",
    "0.5 ms": "pybullet.setTimeStep(5e-4)",
    "5 ms": "pybullet.setTimeStep(5e-3)",
    "4 sub-steps": "pybullet.setPhysicsEngineParameter(numSubSteps=4)",
    "damping 0.5": "pybullet.changeDynamics(ball, -1, linearDamping=0.5)",
    "ERP 0.1": "pybullet.setPhysicsEngineParameter(contactERP=0.1)",
    "ERP 0.2": "pybullet.setPhysicsEngineParameter(contactERP=0.2)",
    "threshold 0.5 m/s": "pybullet.setPhysicsEngineParameter(restitutionVelocityThreshold=0.5)",
    "processing threshold 0.02": "pybullet.changeDynamics(ball, -1, contactProcessingThreshold=.02)",
    "restitution 0.5 of the plate": "pybullet.changeDynamics(plate, -1, restitution=0.5)",
    "restitution 0.3 of the ball": "pybullet.changeDynamics(ball, -1, restitution=0.3)",
    "restitution 1 of both": "for body in (ball, plate):\n"
    "    pybullet.changeDynamics(body, -1, restitution=1)",
    # Of Bullet's own contact the text has no plug-in; its first law has number 0.
    "no plug-in": "if 'plugin' in globals():\n"
    "    pybullet.executePluginCommand(plugin, 'remove', [0])",
}
_FLOORS = {
    "plane": "pybullet.createCollisionShape(pybullet.GEOM_PLANE)",
    "box": "pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[3, 3, 0.5],"
    " collisionFramePosition=[0, 0, -0.5])",
    "mesh": "pybullet.createCollisionShape(pybullet.GEOM_MESH,"
    " vertices=[[3, 3, 0], [-3, 3, 0], [-3, -3, 0], [3, -3, 0]],"
    " indices=[0, 1, 2, 0, 2, 3])",
}
RADIUS = 0.05
_LOOP = """
import json, math, sys
import pybullet
for script, gravity, launches in json.load(sys.stdin):
    names = {}
    try:
        exec(script, names)
        names["build"]()
    except ValueError as refused:
        print(json.dumps(None))
        pybullet.disconnect()
        continue
    ball, maximal = names["ball"], names["maximal"]
    step = pybullet.getPhysicsEngineParameters()["fixedTimeStep"]
    parts = max(1, pybullet.getPhysicsEngineParameters()["numSubSteps"])
    half = gravity * step / parts / 2
    found = []
    for speed, phase in launches:
        flight = (phase + 1) * step
        while speed < 2 * gravity * flight:
            flight /= 2
        up = speed * flight - gravity * flight**2 / 2
        pybullet.resetBasePositionAndOrientation(ball, [0, 0, RADIUS + up], [0, 0, 0, 1])
        pybullet.resetBaseVelocity(ball, [0, 0, -(speed - gravity * flight - half)], [0, 0, 0])
        e, before = 0.0, 0.0
        for _ in range(4000):
            v = pybullet.getBaseVelocity(ball)[0][2]
            z = pybullet.getBasePositionAndOrientation(ball)[0][2] - RADIUS
            if v > 0 and before < 0:
                at_plane = math.sqrt(max(0.0, (v - half) ** 2 + 2 * gravity * z))
                e = at_plane / speed
                # Bullet's own restitution is that of the speed which a step starts with.
                if maximal and not names["law"]:
                    e = v / -before
                break
            before = v
            pybullet.stepSimulation()
        found.append(e)
    print(json.dumps(found))
    pybullet.disconnect()
""".replace("RADIUS", repr(RADIUS))


def strangers(count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Rows of the design, each the factors of one world."""
    return covering_rows(FACTORS, count, lambda _: True, seed)


def pair_of(row: dict[str, Any]) -> tuple[str, str]:
    """(ball, floor) as `measure` names bodies that no file has: by their numbers."""
    first = min(row["others"], 1)
    ball, floor = f"body:{first}", f"body:{first + 1}"
    return (floor, ball) if row["order"] == "plate first" else (ball, floor)


def script_of(row: dict[str, Any], text: str) -> str:
    """A script whose `build` makes a ball over a floor as the row says, with the text in it."""
    maximal = row["coordinates"] == "maximal"
    ball = (
        "ball = pybullet.createMultiBody(0.45, pybullet.createCollisionShape("
        f"pybullet.GEOM_SPHERE, radius={RADIUS}), basePosition=[0, 0, 1], "
        f"useMaximalCoordinates={maximal})"
    )
    plate = (
        f"plate = pybullet.createMultiBody(0, {_FLOORS[row['floor']]},"
        f" useMaximalCoordinates={maximal})"
    )
    bodies = [ball, plate]
    if row["order"] == "plate first":
        bodies.reverse()
    others = [
        "pybullet.createMultiBody(1, pybullet.createCollisionShape(pybullet.GEOM_SPHERE,"
        f" radius=0.1), basePosition=[{i + 1}, 0, 0.1])"
        for i in range(row["others"])
    ]
    lines = [
        "pybullet.connect(pybullet.DIRECT)",
        f"pybullet.setGravity(0, 0, {-row['gravity']})",
        *others[:1],
        *bodies,
        *others[1:],
        _CALLS[row["before"]],
        text,
        _CALLS[row["after"]],
    ]
    body = "\n".join(f"    {line}" for part in lines for line in part.splitlines())
    law = "executePluginCommand" in text
    head = f"import pybullet\nmaximal, law = {maximal}, {law}\n"
    return f"{head}def build():\n    global pybullet, ball, plate, plugin, body\n{body}\n"


def bounces(
    given: Sequence[tuple[str, float, Sequence[tuple[float, float]]]], folder: Path
) -> list[list[float] | None]:
    """e of the launches (speed at touch m/s, phase) in each (script, gravity m/s², launches); None
    where a text refused its world.
    """
    done = subprocess.run(
        [sys.executable, "-c", _LOOP],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        check=True,
        cwd=folder,
    )
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith(("[", "null"))]
