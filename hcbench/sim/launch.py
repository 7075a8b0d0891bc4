"""What an engine refuses to launch."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from hcbench.errors import SettingError
from hcbench.scene import Scene
from hcbench.setting import Setting

if TYPE_CHECKING:
    from hcbench.impact import Launch


def require_types(scene: object, setting: object, launches: object) -> None:
    """Raises SettingError for what is of another type than a run takes, by the argument's name."""
    for slot, value, kind in (("scene", scene, Scene), ("setting", setting, Setting)):
        if not isinstance(value, kind):
            raise SettingError(slot, f"{value!r:.80}", f"a {kind.__name__}")
    if not isinstance(launches, list | tuple):
        raise SettingError("launches", f"{launches!r:.80}", "a list of Launch")


def require_launch(launch: Launch, engine: str, oblique: bool) -> None:
    """Raises SettingError for a launch without meaning; oblique: whether the engine sends bodies so too."""
    try:
        height = launch.height or 0.0
        finite = math.isfinite(sum((launch.speed, launch.phase, height, *launch.slip, *launch.spin)))
    except (TypeError, AttributeError, OverflowError):
        finite = False
    if not finite:
        raise SettingError("launch", f"{launch!r:.200}", "finite numbers")
    if height < 0:
        raise SettingError("height", f"{height!r} m", "0 m or more over the plate")
    if launch.speed < 0 or (launch.speed == 0 and not launch.height):
        raise SettingError("speed", f"{launch.speed!r} m/s", "a speed above 0, or a height to fall from")
    if not oblique and launch.is_oblique:
        raise SettingError("launch", f"oblique, in {engine!r}", "one along the normal, without spin")
