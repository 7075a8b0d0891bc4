"""Random questions to `tune mujoco` with friction, and a judge of its answers in plain MuJoCo.

`python tests/support/friction_questions.py SEED FIRST COUNT` prints the faults of some questions.
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

import hcbench as hb
from hcbench.contact.mujoco import load

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.tuning.answer import Choice

SLOPE = math.radians(5)
# Half height, m, and shape of each body, which lies on the plane.
BODIES = {
    "ball": (0.05, 'type="sphere" size="0.05"'),
    "box": (0.02, 'type="box" size="0.06 0.06 0.02"'),
    "capsule": (0.03, 'type="capsule" size="0.03 0.05" euler="0 90 0"'),
}
# Velocity along the plane, m/s, and spin, rad/s, of launches.
STRAIGHT = ((0.0, 0.0), (0.0, 0.0, 0.0))
SLIDING = ((0.8, 0.2), (5.0, -20.0, 8.0))
PHASES = (0.13, 0.37, 0.61, 0.89)
# An e above 1 by so much gains energy; a body that holds drifts by less, m/s.
MOST_GAIN = 1e-3
MOST_CREEP = 1e-4
# Below so many g h a rebound is back within the step, and a body may stay down.
STAYS_DOWN = 1.6


def question(seed: int, number: int) -> dict[str, Any]:
    """The question of a number: arguments of `hb.tune("mujoco", ...)`, the same for a seed."""
    random = np.random.default_rng([seed, number])
    step = round(10 ** random.uniform(math.log10(2.5e-4), math.log10(5e-3)), 6)
    gravity = random.choice([0.0, 1.62, 9.81, 9.81, 24.8])
    slow = round(10 ** random.uniform(-1.6, -0.3), 4)
    fast = round(slow * 10 ** random.uniform(0.2, 1.2), 4)
    asked: dict[str, Any] = {
        "timestep": step,
        "gravity": float(gravity),
        "speeds": [slow, fast],
        "friction": round(random.uniform(0.1, 1.4), 2),
        "mass": round(10 ** random.uniform(-2.5, 2), 5),
    }
    if random.uniform() < 0.5:
        asked["alpha"] = round(10 ** random.uniform(-2, math.log10(0.9 / fast)), 4)
    else:
        any_e = round(random.uniform(), 3)
        asked["restitution"] = float(random.choice([0, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0, any_e]))
    return asked


def faults(asked: dict[str, Any]) -> Iterator[str]:
    """Yield each promise of the answer to a question that plain MuJoCo breaks; a refusal is none."""
    load()
    try:
        answer = hb.tune("mujoco", **asked)
    except hb.HcbenchError:
        return
    for choice in answer.choices:
        for fault in _faults_of(choice, asked):
            yield f"{asked}: {choice.line}: {fault}"


def _faults_of(choice: Choice, asked: dict[str, Any]) -> Iterator[str]:
    """Yield what a choice does otherwise than it says: e, energy, hops, creep."""
    assert choice.promise is not None
    model = _model(choice.text, "ball", asked)
    slow, fast = choice.speeds
    for motion, slack in ((STRAIGHT, 0.002), (SLIDING, 0.005)):
        for speed in np.geomspace(slow, fast, 5).tolist():
            for phase in PHASES:
                came, e = _bounce(model, speed, phase, motion)
                target = float(choice.promise.curve.at(came))
                slowest = STAYS_DOWN * asked["gravity"] * asked["timestep"]
                if target * came <= slowest and e <= target:
                    continue
                if not e <= 1.0 + MOST_GAIN:
                    yield f"e {e:.4f} at {came:.4g} m/s"
                if not abs(e - target) <= 1.02 * choice.max_error + slack:
                    yield f"e {e:.4f} for {target:.4f} at {came:.4g} m/s"
    if asked["gravity"] == 0.0:
        return
    hop = _hop(model, "ball")
    if hop > max(1.2 * _hop(_model("", "ball", asked), "ball"), 1e-4):
        yield f"a sliding ball hops {1e3 * hop:.3g} mm"
    holds = asked["friction"] > 1.1 * math.tan(SLOPE)
    # A setting for one point says that boxes gain energy with it.
    if not holds or choice.flat is False:
        return
    for body in ("box", "capsule"):
        creep = _creep(_model(choice.text, body, asked), asked["gravity"])
        if creep > MOST_CREEP > _creep(_model("", body, asked), asked["gravity"]):
            yield f"a {body} creeps {1e3 * creep:.3g} mm/s"


def _model(text: str, body: str, asked: dict[str, Any]) -> Any:
    """A body on a plane with the question's friction, step, mass and gravity, and a text."""
    height, shape = BODIES[body]
    friction = f'friction="{asked["friction"]} 0.005 0.0001"'
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{asked["timestep"]!r}" gravity="0 0 {-asked["gravity"]!r}"/>'
        f'<worldbody><geom name="plate" type="plane" size="9 9 1" {friction}/>'
        f'<body pos="0 0 {height}"><freejoint/><geom name="ball" {shape} mass="{asked["mass"]!r}"'
        f" {friction}/></body></worldbody>{text}</mujoco>"
    )


def _bounce(model: Any, speed: float, phase: float, motion: Any) -> tuple[float, float]:
    """Impact speed, m/s, and e of a launch of the ball, both at the touch plane.

    A step keeps (v - g h/2)²/2 + g z in free flight, so both are read from that. e is 0 where the
    ball stays down.
    """
    data, h, g = mujoco.MjData(model), model.opt.timestep, -model.opt.gravity[2]
    radius = BODIES["ball"][0]
    height = (2.0 + phase) * h * speed
    if g > 0.0:
        height = min(height, 0.375 * speed**2 / g)
    data.qpos[2] = radius + height
    slip, spin = motion
    data.qvel[:] = [*slip, 0.5 * g * h - math.sqrt(speed**2 - 2.0 * g * height), *spin]
    came = speed
    touched = False
    for _ in range(4000):
        at_plane = (data.qvel[2] - 0.5 * g * h) ** 2 + 2.0 * g * (data.qpos[2] - radius)
        # No contact acts from above the plane, and a slow rebound is above it for one step alone.
        apart = data.qpos[2] > radius
        if apart and data.qvel[2] > 0.0:
            return came, math.sqrt(max(at_plane, 0.0)) / came
        touched = touched or not apart
        if not touched:
            came = math.sqrt(max(at_plane, 0.0))
        mujoco.mj_step(model, data)
        if not np.isfinite(data.qpos).all():
            return came, math.inf
    return came, 0.0


def _hop(model: Any, body: str) -> float:
    """The largest height, m, of a body that is laid down sliding at 1 m/s, in 0.7 s."""
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0
    highest = 0.0
    for _ in range(round(0.7 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        highest = max(highest, float(data.qpos[2]) - BODIES[body][0])
    return highest


def _creep(model: Any, gravity: float) -> float:
    """Drift, m/s, down 5 degrees in the second second of a body that was laid there."""
    model.opt.gravity[:] = gravity * math.sin(SLOPE), 0.0, -gravity * math.cos(SLOPE)
    data = mujoco.MjData(model)
    steps = round(1.0 / model.opt.timestep)
    mujoco.mj_step(model, data, steps)
    start = data.qpos[:2].copy()
    mujoco.mj_step(model, data, steps)
    return float(np.linalg.norm(data.qpos[:2] - start))


if __name__ == "__main__":
    seed, first, count = map(int, sys.argv[1:])
    for number in range(first, first + count):
        found = list(faults(question(seed, number)))
        print(number, *(found or ["kept"]), sep="\n  ", flush=True)
