"""An engine as someone else would write it: a ball on a plane by
Runge-Kutta steps, through the contract.

It needs its own file and one entry point (`rk4_engine-1.dist-info`), nothing in hcbench.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import Recipe, Role
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.world import Record, Simulation, World
from hcbench.system.errors import SceneError, SettingError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.recipes.target import Target
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

    Force = Callable[[Floats, Floats], Floats]


def law(target: Target) -> dict[str, Any]:
    """Eq. (16) of Hunt & Crossley 1975, as the target has it."""
    return {
        "stiffness": target.law.stiffness,
        "alpha": target.law.alpha,
        "exponent": target.law.exponent,
    }


def constant(target: Target) -> dict[str, Any]:
    """The e in the middle of the band."""
    ends = target.restitution(np.array([target.speed_min, target.speed_max]))
    return {"restitution": float(ends.mean())}


class Rk4Engine(SteppedEngine):
    """Integrates the law by Runge-Kutta steps, or turns the ball around within one."""

    name = "rk4"
    title = "Runge-Kutta"

    def version(self) -> str:
        """The version of this file."""
        return "1"

    def recipes(self) -> Sequence[Recipe]:
        """The law, and one e for all speeds."""
        return [
            Recipe(
                "rk4",
                "law",
                Role.LAW_AND_LOOP,
                law,
                "Eq. (16) by Runge-Kutta steps.",
                forms=("plane",),
            ),
            Recipe(
                "rk4",
                "bounce",
                Role.CONSTANT_E,
                constant,
                "One e.",
                one_step=True,
                forms=("plane",),
            ),
        ]

    def load(self, scene: Scene, setting: Setting, fastest: float) -> RkWorld:
        """A plane only. Raises SettingError for options that are not those of a recipe."""
        if scene.form != "plane":
            raise SceneError(f"scene {scene.name!r}", f"a {scene.form}", "a plane")
        options = set(setting.options)
        if options not in ({"restitution"}, {"stiffness", "alpha", "exponent"}):
            raise SettingError(
                "rk4 options", f"{sorted(options)}", "restitution, or stiffness, alpha, exponent"
            )
        return RkWorld(scene, setting)


class RkWorld(World):
    """Balls over a plane; any number at once."""

    places = 64

    def __init__(self, scene: Scene, setting: Setting) -> None:
        self.timestep, self.gravity, self.mass = setting.timestep, scene.gravity, scene.mass
        if "restitution" in setting.options:
            gain = self.mass * (1.0 + setting.options["restitution"]) / self.timestep
            self.force: Force = lambda x, v: np.where((x > 0.0) & (v > 0.0), gain * v, 0.0)
            self.stages = 1
        else:
            sampled = HuntCrossley(**setting.options).force
            self.speed_reading = SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
            self.force = lambda x, v: np.where(x > 0.0, sampled(np.maximum(x, 0.0), v), 0.0)
            self.stages = 4

    def release(self, launches: Sequence[Launch]) -> RkSimulation:
        """Balls at their starting heights."""
        heights = [launch.clearance(self.timestep) for launch in launches]
        return RkSimulation(
            self, -np.array(heights), np.array([launch.speed for launch in launches])
        )


class RkSimulation(Simulation):
    """Penetration x and its rate v, shape (b,)."""

    def __init__(self, world: RkWorld, x: Floats, v: Floats) -> None:
        self.world, self.x, self.v = world, x, v

    def advance(self, steps: int) -> Record:
        """One state a step, and its force; the step's mean where only a stage of it was in contact."""
        seen = []
        for _ in range(steps):
            x, v = self.x, self.v
            self.x, self.v = self._after(x, v)
            gained = self.world.gravity - (self.v - v) / self.world.timestep
            mean = np.where(np.abs(gained) > 1e-9, self.world.mass * gained, 0.0)
            start = self.world.force(x, v)
            seen.append((x, v, np.where(start != 0.0, start, mean)))
        return Record(*np.array(seen).transpose(1, 2, 0))

    def keep(self, which: Flags) -> None:
        """These go on."""
        self.x, self.v = self.x[which], self.v[which]

    def _after(self, x: Floats, v: Floats) -> tuple[Floats, Floats]:
        """The state one step later."""
        world, h = self.world, self.world.timestep

        def rate(x: Floats, v: Floats) -> Floats:
            return world.gravity - world.force(x, v) / world.mass

        a1 = rate(x, v)
        if world.stages == 1:
            return x + h * (v + h * a1), v + h * a1
        v2, v3 = v + h / 2 * a1, v + h / 2 * rate(x + h / 2 * v, v + h / 2 * a1)
        a2, a3 = rate(x + h / 2 * v, v2), rate(x + h / 2 * v2, v3)
        v4 = v + h * a3
        a4 = rate(x + h * v3, v4)
        return x + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
