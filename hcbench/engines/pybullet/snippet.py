"""A PyBullet setting as its user writes it: calls to paste, and a script that runs by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench._text import shortest
from hcbench.errors import SettingError
from hcbench.tune.snippet import arguments, law_expression

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.scene import Scene
    from hcbench.setting import Setting


def snippet(setting: Setting) -> str:
    """What to paste; see `Engine.snippet`."""
    if "law" in setting.options:
        law, line = law_expression(setting.options["law"])
        call = f"law = contact.attach([(ball, plate)], {law})\nlaw.step()  # for pybullet.stepSimulation()"
        return f"from hcbench.contact import pybullet as contact\n{line}\n{call}"
    if {"world", "ball", "plate"} & set(setting.options):
        return _calls(setting, lambda body, keyword: f'loadURDF("{body}.urdf"{keyword})')
    return setting.options_text


def script(scene: Scene, setting: Setting) -> str:
    """A Python script that drops the ball; see `Engine.script`."""
    if scene.form != "plane" or not {"world", "ball"} & set(setting.options):
        given = f"pybullet {setting.name!r} in the form {scene.form!r}"
        expected = "a setting of Bullet's own contact, in the form 'plane'"
        raise SettingError("write-scene", given, expected)
    radius = shortest(scene.relative_radius)
    bodies = {
        "ball": f"createMultiBody({shortest(scene.mass)}, pybullet.createCollisionShape("
        f"pybullet.GEOM_SPHERE, radius={radius}), basePosition=[0, 0, {radius}]",
        "plate": "createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE)",
    }
    setup = _calls(setting, lambda body, keyword: f"{bodies[body]}{keyword})")
    return _SCRIPT.format(setup=setup, step=shortest(setting.timestep), radius=radius)


def _calls(setting: Setting, make: Callable[[str, str], str]) -> str:
    """The calls, in the order that works. make: a body and the last argument to the call that makes it."""
    options = setting.options
    world = {"fixedTimeStep": setting.timestep, **options.get("world", {})}
    keyword = ", useMaximalCoordinates=True" if options.get("maximal_coordinates") else ""
    bodies = ("ball", "plate")
    lines = [
        f"pybullet.setPhysicsEngineParameter({arguments(world)})",
        *(f"{body} = pybullet.{make(body, keyword)}" for body in bodies),
        *(f"pybullet.changeDynamics({b}, -1, {arguments(options[b])})" for b in bodies if options.get(b)),
    ]
    return "\n".join(lines)


_SCRIPT = '''"""A ball dropped on a plane in PyBullet: prints restitution against impact speed (m/s)."""

import pybullet

pybullet.connect(pybullet.DIRECT)
{setup}

for speed in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5):
    start = [0, 0, {radius} + 2.5 * {step} * speed]
    pybullet.resetBasePositionAndOrientation(ball, start, [0, 0, 0, 1])
    pybullet.resetBaseVelocity(ball, [0, 0, -speed], [0, 0, 0])
    touched = False
    for _ in range(100000):
        pybullet.stepSimulation()
        up = pybullet.getBaseVelocity(ball)[0][2]
        touched = touched or up > -0.999 * speed
        if touched and pybullet.getBasePositionAndOrientation(ball)[0][2] > {radius} and up > 0:
            break
    print(speed, up / speed)
'''
