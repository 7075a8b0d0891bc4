"""The laws as a plug-in for PyBullet; their code is in `hcbench.engines.pybullet.plugin`."""

from typing import NoReturn

from hcbench.engines.pybullet.plugin import add, command, force, library, load, remove
from hcbench.errors import SettingError
from hcbench.laws.contact_law import Friction
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import OwnSpeedLaw, TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

__all__ = [
    "ConstantRestitution",
    "Friction",
    "HuntCrossley",
    "OwnSpeedLaw",
    "Restitution",
    "TouchSpeedLaw",
    "add",
    "command",
    "force",
    "library",
    "load",
    "remove",
]


def __getattr__(name: str) -> NoReturn:
    if name in {"attach", "Contact", "Touch", "cup", "pairs_between"}:
        raise SettingError(
            f"hcbench.contact.pybullet.{name}",
            "gone: the law is a plug-in of Bullet's now, and pybullet.stepSimulation() all there is to call",
            "contact.add(law, ball, plate) once, then pybullet.stepSimulation()",
            "contact.force(number) is what the touches said; docs/howto/plugins.md has the rest",
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
