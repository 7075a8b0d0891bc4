"""The contract of an engine, stated once.

An adapter is one required method, `fly`; `follow` is for engines that can go on after a bounce. Nothing of
the engine's own types leaves it. Engines import their backend when used, never when the module is imported.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, final

from hcbench.errors import EngineFailed, SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Impact, Launch, Trajectory
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.recipe import Recipe


class Engine(ABC):
    """A physics engine, or anything else that can drop a body on a plate.

    name: as registered, and as settings name it. title: as reports print it; "" for the name.
    install: the command that installs the backend; "" for one that needs none.
    """

    name: ClassVar[str]
    title: ClassVar[str] = ""
    install: ClassVar[str] = ""

    @abstractmethod
    def version(self) -> str:
        """Version of the installed backend; raises EngineMissing where there is none."""

    def recipes(self) -> Sequence[Recipe]:
        """What makes its settings, of each role the preferred one first; modules are imported when called."""
        return ()

    @abstractmethod
    def fly(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch, in order. An impact that went wrong is a record with a status.

        Raises SettingError for options the engine does not have, SceneError for a scene it cannot load.
        """

    def follow(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """Every step of `duration` s after release, however often the body bounces: for trains and rest.

        Raises EngineFailed where an engine knows single impacts only.
        """
        raise EngineFailed(self.name, "knows single impacts only", "an engine that can go on after one")

    @final
    def drop(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """Check the request, fly it, and hand back one impact for each launch, in order."""
        if setting.engine != self.name:
            raise SettingError("setting", f"made for {setting.engine!r}", f"one for {self.name!r}")
        if not setting.timestep > 0:
            raise SettingError("timestep", f"{setting.timestep!r} s", "a step above 0 s")
        for launch in launches:
            height = launch.height or 0.0
            if not math.isfinite(launch.speed + launch.phase + height):
                raise SettingError("launch", f"{launch!r}", "finite numbers")
            if height < 0:
                raise SettingError("height", f"{height!r} m", "0 m or more over the plate")
            if launch.speed < 0 or (launch.speed == 0 and not launch.height):
                raise SettingError(
                    "speed", f"{launch.speed!r} m/s", "a speed above 0, or a height to fall from"
                )
        return self.fly(scene, setting, launches)
