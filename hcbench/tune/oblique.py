"""What a setting does where the body slides and spins: e and friction against Coulomb's law."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.impact import Launch
from hcbench.laws.coulomb import friction_impulse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.impact import Impact
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.engine import Engine
    from hcbench.tune.target import Target

FRICTION = 0.5
SPEEDS, PHASES = 4, (0.12, 0.37, 0.62, 0.87)
# (slip m/s, spin rad/s): slow to fast sliding, backspin and topspin, and all at once out of the plane.
MOTIONS = (
    ((0.1, 0.0), (0.0, 0.0, 0.0)),
    ((0.5, 0.0), (0.0, 0.0, 0.0)),
    ((2.0, 0.0), (0.0, 0.0, 0.0)),
    ((3.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0), (0.0, 40.0, 0.0)),
    ((1.0, 0.0), (0.0, -40.0, 0.0)),
    ((0.7, -0.4), (25.0, 10.0, 30.0)),
)


@dataclass(frozen=True, slots=True)
class ObliqueResult:
    """What the engine did with a setting where bodies slide and spin.

    friction: μ. max_error: largest |e - target|, e of the normal direction; at: the launch that has it, None
    where nothing was measured. impulse_error: largest distance of friction's impulse from Coulomb's law, over
    that of sliding, μ J_n. energy_gained: largest share of the kinetic energy, 0 or below where none was.
    failed: impacts that gave no restitution, with the first reason.
    """

    friction: float
    max_error: float
    at: Launch | None
    impulse_error: float
    energy_gained: float
    failed: int
    reason: str


def oblique_launches(target: Target) -> list[Launch]:
    """Launches over the target's band: each speed and phase with each of MOTIONS."""
    speeds = np.geomspace(target.speed_min, target.speed_max, SPEEDS).tolist()
    return [
        Launch(v, phase, slip=slip, spin=spin)
        for v, phase, (slip, spin) in itertools.product(speeds, PHASES, MOTIONS)
    ]


def evaluate_oblique(
    engine: Engine, scene: Scene, setting: Setting, target: Target, friction: float = FRICTION
) -> ObliqueResult:
    """Launch obliquely with Coulomb's friction and compare with the target and with Coulomb's law.

    scene: its gravity counts. friction: μ. Raises SettingError for a scene that can have no friction.
    """
    rough = dataclasses.replace(scene, friction=friction)
    return judge_oblique(engine.run(rough, setting, oblique_launches(target)), rough, target)


def judge_oblique(impacts: Sequence[Impact], scene: Scene, target: Target) -> ObliqueResult:
    """Compare oblique impacts in a scene with friction with the target and with Coulomb's law."""
    good = [i for i in impacts if i.is_measured]
    failed = [i for i in impacts if not i.is_measured]
    errors = [abs(i.restitution - float(target.restitution(np.array(i.speed_in)))) for i in good]
    worst = int(np.argmax(errors)) if good else 0
    along = [i.tangential for i in good if i.tangential is not None]
    off = [
        math.dist(t.impulse, friction_impulse(t.slip_in, t.normal_impulse, scene))
        / (scene.friction * t.normal_impulse)
        for t in along
        if scene.friction * t.normal_impulse > 0.0
    ]
    return ObliqueResult(
        friction=scene.friction,
        max_error=errors[worst] if good else math.nan,
        at=good[worst].launch if good else None,
        impulse_error=max(off, default=math.nan),
        energy_gained=max((-t.energy_lost for t in along), default=math.nan),
        failed=len(failed),
        reason=failed[0].reason if failed else "",
    )
