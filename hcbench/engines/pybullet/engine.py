"""PyBullet: Bullet's own contact, from stock to matched, through the contract.

Options of a setting (all optional; none means as loaded):
    world: keywords of setPhysicsEngineParameter. ball, plate: keywords of changeDynamics.
    law: a plug-in of hcbench.contact in place of Bullet's own contact, as
        `hcbench.laws.contact_law.law_of` reads it: {"kind": "force", "alpha": s/m, "stiffness": N/m^n,
        "exponent": n}, {"kind": "restitution", "alpha": s/m}, or with {"law": a later law's slug,
        "restitution": e} in place of alpha.
    maximal_coordinates: true for rigid bodies proper instead of Bullet's default, multibodies.

Bullet keeps contactBreakingThreshold in a global of the process, shared by all of its clients, and some
settings outlive resetSimulation. So nothing here ever steps in the user's process: see hcbench.workers.
"""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, ClassVar

from hcbench.engines.pybullet import world
from hcbench.engines.pybullet.options import read_options
from hcbench.errors import EngineMissing
from hcbench.impact import Impact, Status
from hcbench.sim.engine import Engine
from hcbench.workers import call, map_surviving_crashes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Launch, Trajectory
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.recipe import Recipe

_LIMIT_S = 30.0  # for one impact: hundreds of times what the longest takes
_LIMIT_STEP_S = 1e-3  # for one step, likewise


class PybulletEngine(Engine):
    """Bullet 3 behind its Python module."""

    name: ClassVar[str] = "pybullet"
    title: ClassVar[str] = "PyBullet"
    install: ClassVar[str] = "pip install 'pybullet>=3.2.7'  # wheels for CPython up to 3.11"

    def version(self) -> str:
        """The wheel's version; the module itself is not imported, it prints."""
        try:
            return metadata.version("pybullet")
        except metadata.PackageNotFoundError:
            raise EngineMissing(
                "engine 'pybullet'", "not installed", "its wheel", f"Try: {self.install}"
            ) from None

    def recipes(self) -> Sequence[Recipe]:
        """What makes its settings."""
        from hcbench.engines.pybullet.recipes import RECIPES

        return RECIPES

    def fly(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch; a launch that PyBullet dies on is CRASHED."""
        options = read_options(setting.options)
        self.version()
        # Alike together: they take equally long.
        order = sorted(range(len(launches)), key=lambda i: (launches[i].height or 0.0, launches[i].speed))
        found = map_surviving_crashes(
            world.fly_here,
            [launches[i] for i in order],
            scene,
            setting.timestep,
            options,
            lost=_lost,
            limit=_LIMIT_S,
            together=world.TOGETHER,
            give_up=world.TOGETHER,
        )
        back = dict(zip(order, found, strict=True))
        return [back[i] for i in range(len(launches))]

    def follow(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """Every step of `duration` s after release; EngineFailed where PyBullet dies on it."""
        options = read_options(setting.options)
        self.version()
        steps = max(1, round(duration / setting.timestep))
        return call(
            world.follow_here,
            scene,
            setting.timestep,
            options,
            launch,
            steps,
            limit=_LIMIT_S + steps * _LIMIT_STEP_S,
        )


def _lost(launch: Launch, reason: str) -> Impact:
    return Impact(launch, Status.CRASHED, reason)
