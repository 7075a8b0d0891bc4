"""A setting's passivity: a screen of a second, or the whole gate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hcbench.engines.mujoco.passivity.in_rows import bounces_in_rows
from hcbench.engines.mujoco.passivity.plain import (
    Contact,
    Stepping,
    certify,
    is_flat_passive,
    rest_on_slope,
)
from hcbench.engines.mujoco.passivity.untuned import effect_on_others
from hcbench.engines.mujoco.scene.mjcf import pairs_text
from hcbench.engines.mujoco.scene.options import read_options
from hcbench.sim.passivity import Passivity
from hcbench.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from hcbench.scene import Scene
    from hcbench.setting import Setting

_LIKE_EULER = ("Euler", "implicit", "implicitfast")  # a free ball takes the same steps under each
_FINEST = 2e-4  # s: at finer steps a slope takes too long for a screen
_SOLVERS = ("Newton", "CG", "PGS")
_CONES = ("elliptic", "pyramidal")


def screened(scene: Scene, setting: Setting, speeds: tuple[float, float]) -> Passivity | None:
    """In the model of its rows, and boxes in plain MuJoCo; None for what is not rows on a plane."""
    options = read_options(setting.options)
    if not options.rows or scene.form != "plane" or (options.integrator or "Euler") not in _LIKE_EULER:
        return None
    bounces = bounces_in_rows(options.rows, setting.timestep, scene.gravity, speeds)
    if not scene.gravity:
        return Passivity(bounces)
    contact, runs = tried(scene, setting)
    slides = any(row.friction for row in options.rows) and setting.timestep >= _FINEST
    drift = rest_on_slope(contact, runs[0]).drift if slides else math.nan
    others = ""
    if options.impratio:
        others = effect_on_others(contact.option, setting.timestep, scene.gravity)
    return Passivity(bounces, is_flat_passive(contact, runs[0]), drift, others=others)


def certified(scene: Scene, setting: Setting) -> Passivity | None:
    """By the whole gate in plain MuJoCo, under all that the setting says it takes; None as `screened`."""
    options = read_options(setting.options)
    if not options.rows or scene.form != "plane":
        return None
    contact, runs = tried(scene, setting)
    return certify(contact, any(row.friction for row in options.rows), runs)


def tried(scene: Scene, setting: Setting) -> tuple[Contact, list[Stepping]]:
    """What is tried, and under which options: each integrator, cone and solver once."""
    options = read_options(setting.options)
    written = options.attributes(repr)
    integrator = written.pop("integrator", "Euler")
    contact = Contact(
        setting.timestep,
        scene.gravity or STANDARD_GRAVITY,
        written,
        lambda first, second: pairs_text(options.rows, (first, second)),
        scene.touch_radius,
    )
    integrators = _LIKE_EULER if integrator in _LIKE_EULER else (integrator,)
    cones = (options.cone,) if options.cone else _CONES
    first = Stepping(integrator, cones[0])
    others = [
        *(Stepping(other, cones[0]) for other in integrators if other != integrator),
        *(Stepping(integrator, cone) for cone in cones[1:]),
        *(Stepping(integrator, cones[0], solver) for solver in _SOLVERS[1:]),
    ]
    return contact, [first, *others]
