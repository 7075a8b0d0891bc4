"""What an engine does when nobody tunes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from hcbench.setting import Setting

if TYPE_CHECKING:
    from hcbench.tune.target import Target


@dataclass(frozen=True)
class Stock:
    """The model as authored; nothing set but the step. engine: which engine's."""

    engine: str
    summary: str
    holds: tuple[str, ...]
    name: ClassVar[str] = "stock"

    def __call__(self, target: Target) -> Setting:
        """The setting with nothing in it."""
        return Setting(self.engine, self.name, target.timestep)


MUJOCO = Stock(
    engine="mujoco",
    summary='MuJoCo as it comes, solref "0.02 1": a critically damped contact, e about 0.13 at any speed.',
    holds=("Knows nothing of the law: the contact time, depth and restitution are the engine's defaults.",),
)
PYBULLET = Stock(
    engine="pybullet",
    summary="PyBullet as it loads the model: restitution 0, and no bounce below 0.2 m/s whatever is set.",
    holds=(
        "Knows nothing of the law. Bullet acts on a contact it predicts for the coming step,"
        " so what bounce there is depends on the phase.",
    ),
)
