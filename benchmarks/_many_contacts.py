"""Cost of a step under the plug-ins, over the engine's own contact: many
contacts, and robots that settle.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pybullet
from test_plugin_robots import ROBOTS

from hcbench.contact import mujoco as in_mujoco
from hcbench.contact import pybullet as in_bullet

FORCE, RESTITUTION = "hcbench.hunt_crossley", "hcbench.restitution"
COUNTS = (1, 10, 100, 400, 1000)
Prepare = Callable[[Any, Any], None]
LEGS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
ALPHA = '<config key="alpha" value=".315"/>'
SETTLES = 3000
"""Steps after a drop, in which robots land, settle and rest."""
BLOCK = 50
"""Steps that native contact and the plug-in take in turns."""
INTEGRATORS = {"Euler": 0, "implicitfast": 3, "RK4": 1}
"""MuJoCo's numbers."""


def _least(pair: list[Callable[[], float]], rounds: int) -> tuple[float, float]:
    """Least CPU time of each of two, taken in turns, s."""
    taken = [[one() for one in pair] for _ in range(rounds)]
    return min(a for a, _ in taken), min(b for _, b in taken)


def _stepper(xml: str, prepare: Prepare, steps: int) -> Callable[[], float]:
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)

    def run() -> float:
        mujoco.mj_resetData(model, data)
        prepare(model, data)
        began = time.process_time()
        mujoco.mj_step(model, data, nstep=steps)
        return (time.process_time() - began) / steps

    return run


def _world(bodies: str, plugin: str, pairs: list[str], rest: str = "", h: float = 2e-3) -> str:
    instances = "".join(f'<instance name="i{i}">{pair}</instance>' for i, pair in enumerate(pairs))
    extension = (
        f'<extension><plugin plugin="{plugin}">{instances}</plugin></extension>' if pairs else ""
    )
    return (
        f'<mujoco><option timestep="{h}"/><size memory="200M"/>{extension}<worldbody>'
        f'<geom name="floor" type="plane" size="50 50 1" friction=".8"/>{bodies}</worldbody>{rest}</mujoco>'
    )


def _balls(at: Any, condim: int) -> str:
    return "".join(
        f'<body name="b{i}" pos="{x} {y} {z}"><freejoint/>'
        f'<geom name="b{i}" type="sphere" size=".05" mass="1" friction=".5" condim="{condim}"/></body>'
        for i, (x, y, z) in enumerate(at)
    )


def _spread(count: int) -> Any:
    side = int(np.ceil(count**0.5))
    return [(0.2 * (i % side), 0.2 * (i // side), 0.0499) for i in range(count)]


def _heap(contacts: int) -> Any:
    """Balls in layers, about 3 contacts to 2 of them."""
    side, at = int(np.ceil((contacts / 3) ** (1 / 3))), []
    for layer in range(99):
        shift = 0.05 * (layer % 2)
        grid = [(i, j) for i in range(side) for j in range(side)]
        at += [(0.1 * i + shift, 0.1 * j + shift, 0.05 + 0.0707 * layer) for i, j in grid]
        if 3 * len(at) > contacts:
            return at
    return at


def _pair(one: str, two: str = "world", key: str = "body") -> str:
    return f'<config key="{key}1" value="{one}"/><config key="{key}2" value="{two}"/>'


def _falling(speed: float, steps: int = 0) -> Prepare:
    def prepare(model: Any, data: Any) -> None:
        rng = np.random.default_rng(1)
        data.qvel[2::6] = -speed * rng.uniform(0.2, 1.0, model.nv // 6)
        data.qvel[0::6] = 0.1 * speed * rng.normal(size=model.nv // 6)
        if steps:
            mujoco.mj_step(model, data, nstep=steps)

    return prepare


def _robot() -> str:
    """A trunk on four legs of six hinges: 30 degrees of freedom, feet of one sphere."""
    axes, legs = ("1 0 0", "0 1 0", "0 0 1", "0 1 0", "1 0 0", "0 1 0"), ""
    for leg, (x, y) in enumerate(LEGS):
        for k, axis in enumerate(axes):
            at = f"{0.25 * x} {0.15 * y} 0" if k == 0 else "0 0 -.07"
            legs += (
                f'<body name="l{leg}{k}" pos="{at}"><joint name="j{leg}{k}" axis="{axis}" damping="1"'
                ' armature=".01"/><geom type="capsule" fromto="0 0 0 0 0 -.06" size=".02" mass=".5"'
                ' contype="0" conaffinity="0"/>'
            )
        legs += (
            f'<geom name="f{leg}" type="sphere" size=".03" pos="0 0 -.07" mass=".2"/>'
            + "</body>" * 6
        )
    trunk = '<geom type="box" size=".3 .15 .05" mass="12"/>'
    return f'<body name="trunk" pos="0 0 .4499"><freejoint/>{trunk}{legs}</body>'


def _humanoids() -> Iterator[tuple[str, str, list[tuple[str, str]]]]:
    """Gymnasium's humanoid, where that package is installed: by its own solver and by Newton."""
    found = find_spec("gymnasium")
    if found is None or found.origin is None:
        return
    text = (Path(found.origin).parent / "envs/mujoco/assets/humanoid.xml").read_text(
        encoding="utf-8"
    )
    feet = [(foot, "floor") for foot in ("right_foot", "left_foot")]
    yield "gymnasium's humanoid, PGS", text, feet
    yield "gymnasium's humanoid, Newton", text.replace('solver="PGS"', ""), feet


def _under_pgs(text: str) -> str:
    """A robot's MJCF, solved by PGS with elliptic cones."""
    return text.replace("<option ", '<option solver="PGS" cone="elliptic" ')


def _settle(models: list[Any], rounds: int) -> list[float]:
    """CPU time of a step of each after a drop of 10 cm, in turns, s: the least of each block."""
    taken = np.empty((rounds, SETTLES // BLOCK, len(models)))
    for one in taken:
        data = [mujoco.MjData(model) for model in models]
        for each in data:
            each.qpos[2] += 0.1
        for block in one:
            for k, model in enumerate(models):
                began = time.process_time()
                mujoco.mj_step(model, data[k], nstep=BLOCK)
                block[k] = time.process_time() - began
    return [float(least) / SETTLES for least in taken.min(axis=0).sum(axis=0)]


def robots_settle(rounds: int) -> Iterator[tuple[str, float, float]]:
    """Rows (name, must, ratio): robots dropped on their feet, by
    integrator; what RK4 costs over Euler.
    """
    in_mujoco.load()
    known = [
        ("README's quadruped", *ROBOTS["quadruped"]),
        ("a biped on box feet", *ROBOTS["biped"]),
        (
            "a biped on box feet, PGS, elliptic cones",
            _under_pgs(ROBOTS["biped"][0]),
            ROBOTS["biped"][1],
        ),
        *_humanoids(),
    ]
    for name, text, pairs in known:
        took: dict[str, list[float]] = {}
        for integrator, number in INTEGRATORS.items():
            models = []
            for law in (None, in_mujoco.Restitution(0.315)):
                spec = mujoco.MjSpec.from_string(text)
                spec.option.integrator = number
                for pair in pairs if law else []:
                    in_mujoco.add_to_spec(spec, law, geoms=pair)
                models.append(spec.compile())
            took[integrator] = native, own = _settle(models, rounds)
            yield (
                f"mujoco restitution, {name}, {integrator}, {SETTLES} steps after a drop of 10 cm:"
                f" {1e6 * own:.1f} us a step, over native",
                1.5,
                own / native,
            )
        native, own = (b / a for a, b in zip(took["Euler"], took["RK4"], strict=True))
        yield (
            f"mujoco restitution, {name}: a step of RK4 over one of Euler (native: {native:.1f})",
            np.inf,
            own,
        )


def in_mujoco_steps(rounds: int) -> Iterator[tuple[str, float, float]]:
    """Rows (name, must, ratio): the first step in which all contacts approach, or steps at rest."""
    in_mujoco.load()
    for count in COUNTS:
        pairs = [_pair(f"b{i}") + ALPHA for i in range(count)]
        force = [
            _pair(f"b{i}", "floor", "geom") + ALPHA + '<config key="stiffness" value="1e7"/>'
            for i in range(count)
        ]
        off = "<contact>" + "".join(f'<exclude body1="world" body2="b{i}"/>' for i in range(count))
        steps = max(2, 200 // count)
        frictionless, rubbing = _balls(_spread(count), 1), _balls(_spread(count), 3)
        own = _world(frictionless, "", [], h=1e-4), _world(rubbing, "", [])
        for what, must, native, text, prepare, several in (
            (
                "force law",
                1.0,
                own[0],
                _world(frictionless, FORCE, force, off + "</contact>", 1e-4),
                _falling(0.3),
                1,
            ),
            (
                "restitution, approach",
                2.0,
                own[0],
                _world(frictionless, RESTITUTION, pairs, "", 1e-4),
                _falling(0.3),
                1,
            ),
            (
                "restitution, rest",
                1.5,
                own[1],
                _world(rubbing, RESTITUTION, pairs),
                _falling(0, 20),
                steps,
            ),
        ):
            a, b = _least([_stepper(one, prepare, several) for one in (native, text)], 3 * rounds)
            yield (
                f"mujoco {what}, {count} contacts: {1e6 * b:.1f} us a step, over native contact",
                must,
                b / a,
            )
    for contacts in (100, 400):
        balls = _heap(contacts)
        names = ["world", *(f"b{i}" for i in range(len(balls)))]
        pairs = [_pair(one, two) + ALPHA for i, one in enumerate(names) for two in names[i + 1 :]]
        texts = _world(_balls(balls, 3), "", []), _world(_balls(balls, 3), RESTITUTION, pairs)
        a, b = _least([_stepper(one, _falling(0.3), 1) for one in texts], rounds)
        yield (
            f"mujoco restitution, a pile of {contacts}: {1e6 * b:.0f} us a step, over native",
            5.0,
            b / a,
        )
    feet = [_pair(f"l{leg}5") + ALPHA for leg in range(4)]
    servos = [
        f'<position joint="j{leg}{k}" kp="400" kv="5"/>' for leg in range(4) for k in range(6)
    ]
    actuators = f"<actuator>{''.join(servos)}</actuator>"
    texts = _world(_robot(), "", [], actuators), _world(_robot(), RESTITUTION, feet, actuators)
    a, b = _least([_stepper(one, _falling(0, 300), 100) for one in texts], rounds)
    yield (
        f"mujoco restitution, a robot stands on four feet: {1e6 * b:.1f} us a step, over native",
        1.5,
        b / a,
    )
    a, b = _least([_stepper(one, _falling(1.0), 1) for one in texts], 9 * rounds)
    yield (
        f"mujoco restitution, the step in which its feet land: {1e6 * b:.1f} us, over native",
        1.5,
        b / a,
    )
    a, b = _least([_stepper(one, _falling(1.0), 30) for one in texts], rounds)
    yield (
        f"mujoco restitution, the robot lands, 30 steps: {1e6 * b:.1f} us a step, over native",
        1.5,
        b / a,
    )


def _bullet(count: int, kind: str, law: str | None, h: float, speed: float) -> Callable[[], float]:
    client = pybullet.connect(pybullet.DIRECT)
    own = {"physicsClientId": client}
    pybullet.setTimeStep(h, **own)
    pybullet.setGravity(0, 0, 0 if speed else -9.81, **own)
    floor = pybullet.createMultiBody(
        0, pybullet.createCollisionShape(pybullet.GEOM_PLANE, **own), **own
    )
    size = {"radius": 0.05} if kind == "spheres" else {"halfExtents": [0.05] * 3}
    shape = pybullet.GEOM_SPHERE if kind == "spheres" else pybullet.GEOM_BOX
    made = pybullet.createCollisionShape(shape, **size, **own)
    at = [(1.5 * x, 1.5 * y, z) for x, y, z in _spread(count)]
    bodies = [pybullet.createMultiBody(1, made, basePosition=one, **own) for one in at]
    for body in bodies:
        pybullet.changeDynamics(body, -1, linearDamping=0, angularDamping=0, restitution=0, **own)
        if law:
            plugin = in_bullet.load(client)
            pybullet.executePluginCommand(plugin, law, [body, -1, floor, -1], **own)
    steps = 1 if speed else 20

    def run() -> float:
        for body, place in zip(bodies, at, strict=True):
            pybullet.resetBasePositionAndOrientation(body, place, [0, 0, 0, 1], **own)
            pybullet.resetBaseVelocity(body, [0, 0, -speed], [0, 0, 0], **own)
        for _ in range(0 if speed else 3):
            pybullet.stepSimulation(**own)
        began = time.process_time()
        for _ in range(steps):
            pybullet.stepSimulation(**own)
        return (time.process_time() - began) / steps

    return run


def in_bullet_steps(rounds: int) -> Iterator[tuple[str, float, float]]:
    """Rows (name, must, ratio): bodies apart from each other on a plane, a law for each."""
    force, restitution = "hunt_crossley stiffness=1e7 alpha=0.3", "restitution alpha=0.315"
    for count in COUNTS:
        for what, kind, law, h, speed in (
            ("force law, spheres", "spheres", force, 1e-4, 0.1),
            ("restitution, spheres approach", "spheres", restitution, 1e-3, 0.3),
            ("restitution, spheres rest", "spheres", restitution, 1e-3, 0.0),
            ("restitution, boxes approach", "boxes", restitution, 1e-3, 0.3),
            ("restitution, boxes rest", "boxes", restitution, 1e-3, 0.0),
        ):
            pair = [_bullet(count, kind, one, h, speed) for one in (None, law)]
            a, b = _least(pair, rounds)
            yield (
                f"pybullet {what}, {count}: {1e6 * b:.1f} us a step, over stepSimulation",
                2.0,
                b / a,
            )
