"""A setting as its user would write it: what to paste into a model or a script."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from hcbench._text import shortest
from hcbench.errors import SettingError
from hcbench.laws.published import law_named

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.scene import Scene
    from hcbench.setting import Setting


def paste(setting: Setting, form: str, radius: float) -> str:
    """Text to paste for a setting; "" where there is nothing to set.

    form: the scene's, "plane" or "cup". radius: of the sphere that meets the plane, m. Options of an engine
    not known here are shown as JSON.
    """
    options = setting.options
    if not options:
        return ""
    if setting.engine in _PLUGGED and "law" in options:
        return _plug_in(setting, form)
    if setting.engine == "mujoco" and options.get("rows"):
        from hcbench.engines.mujoco import mjcf

        return mjcf.snippet(setting, form, radius)
    if setting.engine == "pybullet" and {"world", "ball", "plate"} & set(options):
        return _pybullet(setting.timestep, options)
    return json.dumps(options, indent=1, ensure_ascii=False)


_PLUGGED = ("mujoco", "pybullet")


def _plug_in(setting: Setting, form: str) -> str:
    """The lines that attach a law of hcbench.contact in a simulation of one's own."""
    law, head = _law(dict(setting.options["law"]))
    head = f"from hcbench.contact import {setting.engine} as contact{head}"
    if setting.engine == "pybullet":
        call = f"law = contact.attach([(ball, plate)], {law})"
        return f"{head}\n\n{call}\nlaw.step()  # for pybullet.stepSimulation()"
    where = f'law={law}, tendons=["contact"]' if form == "cup" else f'[("ball", "plate")], {law}'
    return f"{head}\n\nlaw = contact.attach(model, {where})"


def _law(given: dict[str, Any]) -> tuple[str, str]:
    """A plug-in's law as an expression, and the import that it needs besides."""
    force = given.pop("kind") == "force"
    if "law" not in given:
        return f"contact.{'HuntCrossley' if force else 'Restitution'}({_arguments(given)})", ""
    family = law_named(given.pop("law")).__name__
    head = f"\nfrom hcbench.laws.published import {family}"
    if force:
        return f"contact.TouchSpeedLaw({family}, {_arguments(given)})", head
    return f"contact.ConstantRestitution({family}.delivered({shortest(given['restitution'])}))", head


def script(scene: Scene, setting: Setting) -> str:
    """A whole file that runs in the plain engine: MJCF for MuJoCo, a Python script for PyBullet.

    Raises SettingError where there is none.
    """
    if setting.engine == "mujoco":
        from hcbench.engines.mujoco.mjcf import model_xml

        return model_xml(scene, setting)
    if setting.engine == "pybullet" and scene.form == "plane" and {"world", "ball"} & set(setting.options):
        lines = _pybullet(setting.timestep, setting.options).splitlines()
        made = {
            "ball": f"pybullet.createMultiBody({shortest(scene.mass)}, pybullet.createCollisionShape("
            f"pybullet.GEOM_SPHERE, radius={shortest(scene.relative_radius)}), "
            f"basePosition=[0, 0, {shortest(scene.relative_radius)}]",
            "plate": "pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE)",
        }
        for i, line in enumerate(lines):
            for body, call in made.items():
                if line.startswith(f"{body} = "):
                    maximal = ", useMaximalCoordinates=True" if "Maximal" in line else ""
                    lines[i] = f"{body} = {call}{maximal})"
        return _SCRIPT.format(
            setup="\n".join(lines), step=shortest(setting.timestep), radius=shortest(scene.relative_radius)
        )
    raise SettingError(
        "write-scene",
        f"{setting.engine} {setting.name!r} in the form {scene.form!r}",
        "MuJoCo, or PyBullet in the form 'plane'",
    )


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


def _pybullet(timestep: float, options: Mapping[str, Any]) -> str:
    """The calls, in the order that works."""
    world = {"fixedTimeStep": timestep, **options.get("world", {})}
    maximal = ", useMaximalCoordinates=True" if options.get("maximal_coordinates") else ""
    bodies = ("ball", "plate")
    lines = [
        f"pybullet.setPhysicsEngineParameter({_arguments(world)})",
        *(f'{body} = pybullet.loadURDF("{body}.urdf"{maximal})' for body in bodies),
        *(f"pybullet.changeDynamics({b}, -1, {_arguments(options[b])})" for b in bodies if options.get(b)),
    ]
    return "\n".join(lines)


def _arguments(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{k}={shortest(v) if isinstance(v, float) else repr(v)}" for k, v in values.items())
