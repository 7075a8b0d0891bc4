"""Launches of the ball of section 3.1 over a plane, at speeds and phases that no search uses."""

from __future__ import annotations

import dataclasses

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.recipes.target import Target
from hcbench.sim import registry
from hcbench.terms import units
from hcbench.terms.impact import Floats, Impact, Launch
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Setting

PLANE = load_scene("steel-plane")
WITH_GRAVITY = dataclasses.replace(PLANE, gravity=9.80665)
SPEEDS, PHASES = (0.031, 0.13, 0.37, 0.5), (0.07, 0.31, 0.62, 0.88)  # of no search or other test
ALPHAS = (0.002, 0.004, 0.008, 0.016)  # s/in


def target(alpha: float, timestep: float) -> Target:
    law = HuntCrossley(PLANE.stiffness, alpha / units.INCH)
    return Target(law, PLANE.mass, timestep, 0.0254, 0.508)


def run(
    setting: Setting, scene: object = PLANE, speeds: tuple[float, ...] = SPEEDS
) -> list[Impact]:
    launches = [Launch(v, p) for v in speeds for p in PHASES]
    return registry.engine(setting.engine).run(scene, setting, launches)  # type: ignore[arg-type]


def restitutions(impacts: list[Impact]) -> tuple[Floats, Floats]:
    return np.array([i.speed_in for i in impacts]), np.array([i.restitution for i in impacts])
