"""Promises of `hcbench tune` that a PyBullet world keeps as user data of a body, and causes that
it does not keep them.
"""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.model_under_test import Suspect
from hcbench.sim.promise import Promise
from hcbench.system.text import time_step

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.pybullet.backend import BulletClient
    from hcbench.engines.pybullet.model.open import BodyPart
    from hcbench.terms.setting import Pair

# Relative difference of two numbers that digits of a text make.
_SAME = 1e-6


def promise_line(pair: Pair, promise: Promise) -> str:
    """The call that keeps a promise for two bodies, variables of a script; "" for a target that a
    text cannot say.
    """
    if not promise.text:
        return ""
    first, second = pair
    # Braces of an f-string: the script's own number of the second body.
    key = f'f"{_key("{" + second + "}", -1)}"'
    # Parts of one text, which Python joins, in lines that a page can show.
    words = [f"{part}; " for part in promise.text.split("; ")]
    words[-1] = words[-1].removesuffix("; ")
    half = len(words) // 2
    parts = [json.dumps("".join(some)) for some in (words[:half], words[half:])]
    return f"pybullet.addUserData({first}, {key},\n    {parts[0]}\n    {parts[1]})"


def promise_in(bullet: BulletClient, sides: tuple[BodyPart, BodyPart]) -> Promise | None:
    """Read hcbench's promise for the two that meet; None without one."""
    for first, second in (sides, sides[::-1]):
        # A text sets whole bodies, by their base.
        number = bullet.getUserDataId(first.body, _key(str(second.body), second.link))
        if number >= 0:
            return Promise.read(bullet.getUserData(number).decode())
    return None


def _key(body: str, link: int) -> str:
    return f"hcbench:{body}:{link}"


def broken_promise(
    bullet: BulletClient, promise: Promise, has_law: bool, gravity: Sequence[float]
) -> Iterator[Suspect]:
    """Yield each difference by which the pair is no longer the one that was tuned.

    has_law: whether a law of the plug-in acts between the two now. gravity: (3,), m/s².
    """
    parameters = bullet.getPhysicsEngineParameters()
    is_plugin = not promise.rows
    if is_plugin and not has_law:
        yield Suspect(
            "promised-plugin",
            "hcbench wrote a plug-in for these two, and none of its laws acts between them.",
            "resetSimulation and the command remove end a law",
            "paste all that `hcbench tune pybullet` printed again, after the bodies are loaded",
            always_reported=True,
        )
    step = float(parameters["fixedTimeStep"])
    promised = float(dict(promise.option).get("fixedTimeStep", step))
    # The plug-in holds up to its step, Bullet's own contact at it.
    is_other = step > (1.0 + _SAME) * promised
    if not is_plugin:
        is_other = abs(step - promised) > _SAME * promised
    if is_other:
        yield Suspect(
            "promised-timestep",
            "The world has another time step than hcbench wrote this setting for.",
            f"{time_step(step)} s now, tuned for {time_step(promised)} s",
            f"p.setPhysicsEngineParameter(fixedTimeStep={promised:.6g})",
            partial(_set_parameter, fixedTimeStep=promised),
            always_reported=True,
        )
    if parameters["numSubSteps"]:
        yield Suspect(
            "promised-substeps",
            "Bullet takes sub-steps, and hcbench wrote this setting for whole steps.",
            f"numSubSteps {parameters['numSubSteps']} now, 0 when it was tuned",
            "p.setPhysicsEngineParameter(numSubSteps=0)",
            partial(_set_parameter, numSubSteps=0),
            always_reported=True,
        )
    strength = float(np.linalg.norm(gravity))
    if not is_plugin and promise.is_other_gravity(strength):
        yield Suspect(
            "promised-gravity",
            "The world has another gravity than hcbench wrote this setting for.",
            f"{strength:.4g} m/s^2 now; tuned under {promise.gravity:.4g} m/s^2",
            f'hcbench tune pybullet with --gravity "{strength:.4g} m/s^2"',
            always_reported=True,
        )


def _set_parameter(bullet: BulletClient, **settings: float) -> None:
    bullet.setPhysicsEngineParameter(**settings)
