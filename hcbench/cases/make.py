"""Writes hcbench-cases-1.json, by `python -m hcbench.cases.make`.

After the first release that file never changes. Each true value is a closed form here; tests find
it by another route.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

Json = dict[str, Any]
# Time steps of the runs, s.
STEPS = (1 / 60, 1 / 240, 1 / 1000)
# m/s², and the radius of the balls, m.
GRAVITY = 9.81
RADIUS = 0.05
# Steps of flight before the touch: the impact speed is read from three positions.
CLEAR = 2.0625
# Time that a launch lasts, s: a soft contact has ended by then.
AFTER = 0.5
CLOSE = {"value": 0.02, "reason": "Two drops of one material differ by more"}
FILE = Path(__file__).with_name("hcbench-cases-1.json")

# Kharaz, Gorham & Salman 2001: balls of alumina, 5 mm wide, on glass at 3.9 m/s. Degrees from the
# normal, and tangential speed after over before, as Kratos Multiphysics digitised their figure
# (benchmark 4). Below 30 degrees the surfaces' compliance shows, which is in no rigid contact.
ALUMINA = (
    (30.356, 0.6903), (39.545, 0.7743), (49.604, 0.8476),
    (71.069, 0.9366), (79.228, 0.9695), (85.168, 0.9794),
)  # fmt: skip


def ball(position: Sequence[float], velocity: Sequence[float] = (0, 0, 0), **more: Any) -> Json:
    """A solid ball."""
    body = {
        "shape": "sphere",
        "radius": RADIUS,
        "mass": 1.0,
        "position": [*position],
        "velocity": [*velocity],
    }
    return {**body, "spin": [0.0, 0.0, 0.0], **more}


def box(
    half: Sequence[float],
    position: Sequence[float],
    velocity: Sequence[float] = (0, 0, 0),
    **more: Any,
) -> Json:
    """A solid box of the density of water, its edges along the axes."""
    mass = 8000.0 * math.prod(half)
    body = {
        "shape": "box",
        "half": [*half],
        "mass": mass,
        "position": [*position],
        "velocity": [*velocity],
    }
    return {**body, "spin": [0.0, 0.0, 0.0], **more}


def world(
    timestep: float,
    bodies: Sequence[Json],
    e: float,
    gravity: Sequence[float] | float = 0.0,
    **more: Any,
) -> Json:
    """Bodies over a floor, the half-space z < 0. e and friction are those of every pair."""
    pull = [0.0, 0.0, -gravity] if isinstance(gravity, float) else [*gravity]
    common = {
        "timestep": timestep,
        "gravity": pull,
        "floor": True,
        "restitution": e,
        "friction": 0.0,
    }
    return {**common, **more, "bodies": [*bodies]}


def run(world: Json, steps: int, record: Sequence[Sequence[int]], **expected: Any) -> Json:
    """One simulation. record: the first and last of the steps after which the state is kept."""
    return {
        "world": world,
        "steps": steps,
        "record": list(map(list, record)),
        "expected": expected,
    }


def launch(h: float, v: float, phase: float, e: float, **more: Any) -> Json:
    """A ball without gravity that meets the floor at v. phase: share of a step before the touch."""
    start = ball((0, 0, RADIUS + (CLEAR + phase) * v * h), (0, 0, -v), **more.pop("body", {}))
    last = 3 + max(40, round(AFTER / h))
    return run(world(h, [start], e, **more), last, [(0, 2), (last - 2, last)], restitution=e)


NEWTON = "Closed form: Newton's law of restitution, v_out = e v_in"
STILL = {"value": 1e-4, "reason": "0.1 mm/s moves a cup by 1 cm in 100 s"}
_CASES: list[tuple[Json, Callable[[], Iterator[Json]]]] = []


def case(
    source: str, **tolerance: Json
) -> Callable[[Callable[[], Iterator[Json]]], Callable[[], Iterator[Json]]]:
    """The next case of the set: a function that makes its runs, with the title as its docstring."""

    def register(runs: Callable[[], Iterator[Json]]) -> Callable[[], Iterator[Json]]:
        title = (runs.__doc__ or "").rstrip(".")
        number = f"C{len(_CASES) + 1:02d}"
        _CASES.append(
            ({"id": number, "title": title, "source": source, "tolerance": tolerance}, runs)
        )
        return runs

    return register


def fall(h: float, v: float, phase: float, e: float) -> Json:
    """A ball under gravity that meets the floor at v, by the positions
    of semi-implicit Euler's steps.
    """
    time = (CLEAR + phase) * h
    gap = v * time - GRAVITY * time**2 / 2 + GRAVITY * h * time / 2
    start = ball((0, 0, RADIUS + gap), (0, 0, GRAVITY * time - v))
    return run(world(h, [start], e, GRAVITY), 80, [(0, 80)], restitution=e)


@case(NEWTON, restitution=CLOSE)
def every_speed_and_phase() -> Iterator[Json]:
    """Restitution is that asked for, at any speed, step and phase."""
    for h, v, eighth in product(STEPS, (0.1, 0.3, 1.0, 3.0), range(8)):
        yield launch(h, v, eighth / 8, 0.8)
    for h, v, e in product(STEPS, (0.1, 1.0), (0.3, 1.0)):
        yield launch(h, v, 0.4, e)


@case(
    f"{NEWTON}; JoltPhysics 1403",
    restitution={"value": 0.25, "reason": "A step of gravity is up to a quarter of these speeds"},
)
def slow_impacts() -> Iterator[Json]:
    """Slow impacts bounce too."""
    for h, times, quarter in product(STEPS, (4, 8, 16), range(4)):
        yield fall(h, times * GRAVITY * h, quarter / 4, 0.8)


@case(
    "Closed form: energy is kept; JoltPhysics 1286, newton 2602",
    height_share={"value": 0.1, "reason": "0.05 % of the speed a bounce"},
)
def hundred_bounces() -> Iterator[Json]:
    """Restitution 1 keeps the height for 100 bounces."""
    h = 1 / 240
    height = 0.1
    period = 2 * math.sqrt(2 * height / GRAVITY) / h
    last = round(100 * period)
    start = ball((0, 0, RADIUS + height))
    yield run(
        world(h, [start], 1.0, GRAVITY),
        last,
        [(0, 0), (last - round(1.2 * period), last)],
        height_share=1.0,
    )


@case("Coulomb: tan 10° < μ = 0.5; mujoco_warp 1555", drift=STILL, vibration=STILL)
def rest_on_a_slope() -> Iterator[Json]:
    """A box rests on the flat, and on a slope below its angle of friction."""
    for degrees in (0, 10):
        angle = math.radians(degrees)
        pull = (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))
        at = world(1 / 240, [box((0.05,) * 3, (0, 0, 0.05))], 0.0, pull, friction=0.5)
        yield run(at, 480, [(240, 480)], drift=0.0, vibration=0.0)


def after_sliding_or_sticking(
    v: Sequence[float], rim: float, e: float, friction: float
) -> tuple[list[float], list[float]]:
    """Velocity and surface speed by spin after a rigid ball's impact
    on a floor, Coulomb's friction.

    v: of its centre, (x, 0, z < 0). rim: surface speed by spin about y. Friction's impulse is μ
    times the normal one, or 2/7 of the slip, which it then stops (Walton 1993, eqs. 4 ... 6).
    """
    x, _, z = v
    slip = x - rim
    stopped = min(2 / 7 * abs(slip), friction * (1 + e) * -z)
    change = -math.copysign(stopped, slip)
    return [x + change, 0.0, -e * z], [0.0, rim - 2.5 * change, 0.0]


@case("Closed form: a rigid ball with Coulomb's friction (Walton 1993)", velocity=CLOSE, spin=CLOSE)
def oblique() -> Iterator[Json]:
    """An oblique impact slides or sticks."""
    for h, degrees, rim in product((1 / 240, 1 / 1000), (15, 30, 45, 60, 75), (-1.0, 0.0, 1.0)):
        angle = math.radians(degrees)
        v = [math.sin(angle), 0.0, -math.cos(angle)]
        out, rims = after_sliding_or_sticking(v, rim, 0.8, 0.2)
        yield oblique_run(h, v, rim, 0.8, 0.2, RADIUS, velocity=out, spin=rims)


def oblique_run(
    h: float,
    v: Sequence[float],
    rim: float,
    e: float,
    friction: float,
    radius: float,
    **out: list[float],
) -> Json:
    """A ball that meets the floor at an angle.

    h: time step, s. v: velocity, m/s. rim: surface speed by spin about y, m/s. radius: m. out:
    velocity and surface speed by spin after, m/s.
    """
    speed = math.hypot(*v)
    start = ball(
        (0, 0, radius - (CLEAR + 0.4) * v[2] * h), v, radius=radius, spin=[0.0, rim / radius, 0.0]
    )
    last = 3 + round(AFTER / h / 5)
    expected = {}
    for name, values in out.items():
        expected[name] = [x / speed for x in values]
    return run(
        world(h, [start], e, friction=friction), last, [(0, 2), (last - 2, last)], **expected
    )


@case(
    "Kharaz, Gorham & Salman 2001, Powder Technology 120, 281",
    velocity={
        "value": 0.03,
        "reason": "The points are read off a figure; rigid bodies lie within 0.011",
    },
)
def alumina_on_glass() -> Iterator[Json]:
    """Alumina meets glass as it was measured."""
    for degrees, tangential in ALUMINA:
        angle = math.radians(degrees)
        x = 3.9 * math.sin(angle)
        z = -3.9 * math.cos(angle)
        out = [tangential * x, 0.0, -0.98 * z]
        yield oblique_run(2e-4, [x, 0.0, z], 0.0, 0.98, 0.092, 0.0025, velocity=out)


@case("Closed form: momentum and Newton's law; JoltPhysics 1403", velocity=CLOSE)
def two_balls() -> Iterator[Json]:
    """A ball hits one at rest."""
    for h, (m1, m2), quarter in product((1 / 240, 1 / 1000), ((1, 1), (1, 3), (3, 1)), range(4)):
        gap = (CLEAR + quarter / 4) * h
        bodies = [
            ball((0, 0, 0), (1, 0, 0), mass=float(m1)),
            ball((2 * RADIUS + gap, 0, 0), mass=float(m2)),
        ]
        e = 0.9
        last = 3 + round(AFTER / h)
        out = [(m1 - e * m2) / (m1 + m2), 0.0, 0.0, (1 + e) * m1 / (m1 + m2), 0.0, 0.0]
        yield run(world(h, bodies, e, floor=False), last, [(last, last)], velocity=out)


@case("Closed form: by symmetry; box3d 83", velocity=CLOSE, spin=CLOSE)
def box_on_a_smaller_box() -> Iterator[Json]:
    """A box with restitution 1 on a smaller box neither turns nor gains speed."""
    for h, quarter in product((1 / 240, 1 / 1000), range(4)):
        lower = box((0.05,) * 3, (0, 0, 0.05), fixed=True)
        upper = box((0.1, 0.1, 0.05), (0, 0, 0.15 + (CLEAR + quarter / 4) * h), (0, 0, -1))
        last = 3 + round(AFTER / h)
        yield run(
            world(h, [upper, lower], 1.0),
            last,
            [(last, last)],
            velocity=[0.0, 0.0, 1.0],
            spin=[0.0, 0.0, 0.0],
        )


@case(f"{NEWTON}; newton 1137", restitution=CLOSE)
def zero_means_zero() -> Iterator[Json]:
    """Restitution 0 does not bounce."""
    for h, v, quarter in product(STEPS, (0.5, 1.0, 2.0), range(4)):
        yield fall(h, v, quarter / 4, 0.0)


@case("The engine's documentation; IsaacLab 1784, sdformat 396", restitution=CLOSE)
def two_materials() -> Iterator[Json]:
    """Two restitutions become one by the rule that the engine states."""
    for quarter, materials in product(range(4), ([0.9, 0.4], [0.4, 0.9])):
        made = launch(1 / 240, 1.0, quarter / 4, 0.0, materials=materials)
        del made["world"]["restitution"]
        yield made


@case(f"{NEWTON}; newton 2009", restitution=CLOSE)
def any_mass() -> Iterator[Json]:
    """Restitution does not depend on mass."""
    for mass, quarter in product((0.001, 1.0, 1000.0), range(4)):
        yield launch(1 / 240, 1.0, quarter / 4, 0.5, body={"mass": mass})


@case(
    "Rigid bodies; mujoco_warp 1430", depth={"value": 0.01, "reason": "1 % of the edge can be seen"}
)
def depth_over_size() -> Iterator[Json]:
    """Boxes of any size rest on the floor, not in it."""
    for half in (0.01, 0.05, 0.25, 1.0):
        at = world(1 / 240, [box((half,) * 3, (0, 0, half))], 0.0, GRAVITY, friction=0.5)
        yield run(at, 480, [(480, 480)], depth=0.0)


@case(
    "Statics; mujoco_warp 441, mujoco 1545",
    force_noise={"value": 0.01, "reason": "1 % is the noise of a good force plate"},
    vibration=STILL,
)
def force_at_rest() -> Iterator[Json]:
    """The force on a box at rest is its weight."""
    for h in (1 / 240, 1 / 1000):
        at = world(h, [box((0.05,) * 3, (0, 0, 0.05))], 0.0, GRAVITY, friction=0.5)
        last = round(2 / h)
        yield run(at, last, [(last // 2, last)], force_noise=0.0, vibration=0.0)


@case("Closed form: four impacts of equal balls, one after another", velocity=CLOSE)
def cradle() -> Iterator[Json]:
    """A cradle hands the speed on."""
    for h in (1 / 240, 1 / 1000):
        bodies = []
        # The first of five balls moves, along x; the gaps are of 0.02 m.
        for i, speed in enumerate((1, 0, 0, 0, 0)):
            x = i * (2 * RADIUS + 0.02)
            bodies.append(ball((x, 0, 0), (speed, 0, 0)))
        last = round(1 / h)
        out = [0.0] * 12 + [1.0, 0.0, 0.0]
        yield run(world(h, bodies, 1.0, floor=False), last, [(last, last)], velocity=out)


@case(
    "Closed form: 5/7 of the speed is left, by angular momentum about the floor",
    velocity=CLOSE,
    spin=CLOSE,
)
def rolling() -> Iterator[Json]:
    """A ball slides, then rolls, and rolls on."""
    for rim, share in ((0.0, 5 / 7), (1.0, 1.0)):
        start = ball((0, 0, RADIUS), (1, 0, 0), spin=[0.0, rim / RADIUS, 0.0])
        at = world(1 / 240, [start], 0.0, GRAVITY, friction=0.3)
        yield run(at, 720, [(720, 720)], velocity=[share, 0.0, 0.0], spin=[0.0, share, 0.0])


def text() -> str:
    """Return the content of the file: a run a line."""
    cases = []
    for about, runs in _CASES:
        # The object of the case, without the bracket that closes it: its runs follow.
        opened = json.dumps(about, ensure_ascii=False)[:-1]
        lines = [json.dumps(run, separators=(",", ":"), ensure_ascii=False) for run in runs()]
        listed = ",\n".join(lines)
        cases.append(f'{opened}, "runs": [\n{listed}]}}')
    head = json.dumps({"set": "hcbench-cases-1", "status": "draft", "units": "SI"})
    return f'{head[:-1]}, "cases": [\n' + ",\n".join(cases) + "]}\n"


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
