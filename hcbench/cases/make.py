"""Writes hcbench-cases-1.json, by `python -m hcbench.cases.make`.

That file is frozen: a test holds its digest. Each true value is a closed form here; tests find
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
# Speeds of normal impacts, m/s.
SPEEDS = (0.1, 0.3, 1.0, 3.0)
# m/s², and the radius of the balls, m.
GRAVITY = 9.81
RADIUS = 0.05
# Steps of flight before the touch, at least: an engine sees the ball come.
CLEAR = 2.0625
# Time that a launch lasts after its touch, s, at least: a soft contact has ended by then. With long
# steps it lasts longer, 40 of them.
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
    """A solid ball of 1 kg and RADIUS at a position, m, with a velocity, m/s, and without spin.

    more: other keys of the body, such as mass, or others in place of these.
    """
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
    """A solid box of the density of water, its edges along the axes, without spin.

    half: half edges, m.
    position: of its centre, m.
    velocity: m/s.
    more: other keys of the body.
    """
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
    """The world of a run: bodies over a floor, the half-space z < 0. e and friction are those of
    every pair.

    timestep: s.
    gravity: m/s², a vector, or a number that acts downwards.
    more: other keys, or others in place of these; friction is 0 by default.
    """
    pull = [0.0, 0.0, -gravity] if isinstance(gravity, float) else [*gravity]
    common = {
        "timestep": timestep,
        "gravity": pull,
        "floor": True,
        "restitution": e,
        "friction": 0.0,
    }
    return {**common, **more, "bodies": [*bodies]}


def run(world: Json, record: Sequence[Sequence[int]], **expected: Any) -> Json:
    """One simulation as the file of cases states it, with the true values that are expected of it,
    by quantity.

    world: as `world` makes it.
    record: spans of steps (first, last) after which the state is kept; the simulation ends with the
    last.
    """
    return {
        "world": world,
        "record": list(map(list, record)),
        "expected": expected,
    }


def launch(h: float, v: float, phase: float, e: float, **more: Any) -> Json:
    """A run of a ball without gravity that meets the floor at v, with the e expected of it; the
    first and the last three states are kept.

    h: time step, s.
    v: m/s.
    phase: share of a step before the touch.
    more: other keys of the world; `body` has those of the ball.
    """
    start = ball((0, 0, RADIUS + (CLEAR + phase) * v * h), (0, 0, -v), **more.pop("body", {}))
    last = 3 + max(40, round(AFTER / h))
    return run(world(h, [start], e, **more), [(0, 2), (last - 2, last)], restitution=e)


NEWTON = "Closed form: Newton's law of restitution"
LAW = "v_out = e v_in"
# Engines apply the law to the speed at the start of the step that meets the floor, or at its end.
BOTH = "v_out = e v_in or e (v_in + g h): v_in is the speed at the start of the step of the impact"
WALTON = "v_t - u_t after = v_t - u_t before - 7/2 min(2/7 |v_t - u_t|, μ (1 + e) |v_n|); u_t = ω r"
STILL = {"value": 1e-4, "reason": "0.1 mm/s moves a cup by 1 cm in 100 s"}
_CASES: list[tuple[Json, Callable[[], Iterator[Json]]]] = []


def case(
    source: str, equation: str, **tolerance: Json
) -> Callable[[Callable[[], Iterator[Json]]], Callable[[], Iterator[Json]]]:
    """Decorator that adds a case to the set: of a function that makes its runs, with the title as
    its docstring.

    source: of the true value.
    equation: the true value in words, for a comment in an engine's test.
    tolerance: by quantity {"value": ..., "reason": ...}.
    """

    def register(runs: Callable[[], Iterator[Json]]) -> Callable[[], Iterator[Json]]:
        """Add the case to the set, by the next id, and return the function as it is."""
        title = (runs.__doc__ or "").rstrip(".")
        about = {
            "id": f"C{len(_CASES) + 1:02d}",
            "title": title,
            "source": source,
            "equation": equation,
            "tolerance": tolerance,
        }
        _CASES.append((about, runs))
        return runs

    return register


def fall(h: float, v: float, phase: float, e: float) -> Json:
    """A run of a ball under gravity that meets the floor at v, with the e expected of it; 81 states
    are kept.

    h: time step, s.
    v: at the touch, m/s.
    phase: share of a step before the touch.
    The height is by the positions of semi-implicit Euler's steps.
    """
    time = (CLEAR + phase) * h
    # Its steps fall g h t/2 more than exact flight in the time t.
    gap = v * time - GRAVITY * time**2 / 2 + GRAVITY * h * time / 2
    start = ball((0, 0, RADIUS + gap), (0, 0, GRAVITY * time - v))
    return run(world(h, [start], e, GRAVITY), [(0, 80)], restitution=e)


@case(NEWTON, LAW, restitution=CLOSE)
def every_speed_and_phase() -> Iterator[Json]:
    """Restitution is that asked for, at any speed, step and phase."""
    for (i, h), (j, v), quarter in product(enumerate(STEPS), enumerate(SPEEDS), range(4)):
        # Eight phases in all; the odd and the even eighths take turns.
        phase = quarter / 4 + (i + j) % 2 / 8
        yield launch(h, v, phase, 0.8)
    for h, v, e in product(STEPS, (0.1, 1.0), (0.3, 1.0)):
        yield launch(h, v, 0.4, e)


@case(
    f"{NEWTON}; JoltPhysics 1403",
    BOTH,
    restitution={"value": 0.25, "reason": "A step of gravity is up to a quarter of these speeds"},
)
def slow_impacts() -> Iterator[Json]:
    """Slow impacts bounce too."""
    # From 4 g h on: what gravity gives in a step, g h, is a quarter of that speed.
    for h, times, quarter in product(STEPS, (4, 8, 16), range(4)):
        yield fall(h, times * GRAVITY * h, quarter / 4, 0.8)


@case(
    "Closed form: energy is kept; JoltPhysics 1286, newton 2602",
    "height after 100 bounces = height of the drop",
    height_share={"value": 0.1, "reason": "0.05 % of the speed a bounce"},
)
def hundred_bounces() -> Iterator[Json]:
    """Restitution 1 keeps the height for 100 bounces."""
    h = 1 / 240  # s
    height = 0.1  # m
    period = 2 * math.sqrt(2 * height / GRAVITY) / h  # of a bounce, in steps
    last = round(100 * period)
    start = ball((0, 0, RADIUS + height))
    # The start, and a little more than the last bounce, in which it is highest once.
    record = [(0, 0), (last - round(1.2 * period), last)]
    yield run(world(h, [start], 1.0, GRAVITY), record, height_share=1.0)


@case(
    "Coulomb: tan 10° < μ = 0.5; mujoco_warp 1555",
    "v = 0 while tan(slope) < μ",
    drift=STILL,
    vibration=STILL,
)
def rest_on_a_slope() -> Iterator[Json]:
    """A box rests on the flat, and on a slope below its angle of friction."""
    for degrees in (0, 10):
        angle = math.radians(degrees)
        pull = (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))
        at = world(1 / 240, [box((0.05,) * 3, (0, 0, 0.05))], 0.0, pull, friction=0.5)
        yield run(at, [(240, 480)], drift=0.0, vibration=0.0)


def after_sliding_or_sticking(
    v: Sequence[float], rim: float, e: float, friction: float
) -> tuple[list[float], list[float]]:
    """Velocity and surface speed by spin, m/s, after a rigid ball's impact on a floor with
    friction.

    v: of its centre, (x, 0, z < 0), m/s.
    rim: surface speed by spin about y, m/s.
    friction: Coulomb's μ.
    Friction's impulse is μ times the normal one, or 2/7 of the slip, which it then stops (Walton
    1993, eqs. 4 ... 6).
    """
    x, _, z = v
    slip = x - rim
    stopped = min(2 / 7 * abs(slip), friction * (1 + e) * -z)
    change = -math.copysign(stopped, slip)
    return [x + change, 0.0, -e * z], [0.0, rim - 2.5 * change, 0.0]


@case(
    "Closed form: a rigid ball with Coulomb's friction (Walton 1993)",
    f"{LAW} along the normal; {WALTON}",
    velocity=CLOSE,
    spin=CLOSE,
)
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
    """A run of a ball that meets the floor at an angle, with what is expected of it.

    h: time step, s.
    v: velocity, m/s.
    rim: surface speed by spin about y, m/s.
    e: restitution that is asked for.
    friction: Coulomb's μ.
    radius: m.
    out: velocity and surface speed by spin after, m/s, by the names of the quantities.
    """
    speed = math.hypot(*v)
    # It touches within the third step.
    height = radius - (CLEAR + 0.4) * v[2] * h
    start = ball((0, 0, height), v, radius=radius, spin=[0.0, rim / radius, 0.0])
    last = 3 + round(AFTER / h / 5)
    # The quantities are shares of the first speed.
    expected = {}
    for name, values in out.items():
        expected[name] = [x / speed for x in values]
    return run(world(h, [start], e, friction=friction), [(0, 2), (last - 2, last)], **expected)


@case(
    "Kharaz, Gorham & Salman 2001, Powder Technology 120, 281",
    "measured: e = 0.98, μ = 0.092, and the tangential speed after over before at six angles",
    velocity={
        "value": 0.03,
        "reason": "The points are read off a figure; rigid bodies lie within 0.011",
    },
)
def alumina_on_glass() -> Iterator[Json]:
    """Alumina meets glass as it was measured."""
    e = 0.98
    for degrees, tangential in ALUMINA:
        angle = math.radians(degrees)
        x = 3.9 * math.sin(angle)
        z = -3.9 * math.cos(angle)
        out = [tangential * x, 0.0, -e * z]
        # In steps of 0.2 ms, without spin; μ = 0.092, and a radius of 2.5 mm.
        yield oblique_run(2e-4, [x, 0.0, z], 0.0, e, 0.092, 0.0025, velocity=out)


@case(
    "Closed form: momentum and Newton's law; JoltPhysics 1403",
    "v1 = (m1 - e m2) v/(m1 + m2), v2 = (1 + e) m1 v/(m1 + m2)",
    velocity=CLOSE,
)
def two_balls() -> Iterator[Json]:
    """A ball hits one at rest."""
    # Steps, s; masses, kg; and phases of a step, in quarters.
    for h, (m1, m2), quarter in product((1 / 240, 1 / 1000), ((1, 1), (1, 3), (3, 1)), range(4)):
        # m: at 1 m/s it is closed within the third or fourth step.
        gap = (CLEAR + quarter / 4) * h
        bodies = [
            ball((0, 0, 0), (1, 0, 0), mass=float(m1)),
            ball((2 * RADIUS + gap, 0, 0), mass=float(m2)),
        ]
        e = 0.9
        last = 3 + round(AFTER / h)
        # Velocities after, of the one that moved and of the other, along the line of the two.
        first = (m1 - e * m2) / (m1 + m2)
        second = (1 + e) * m1 / (m1 + m2)
        out = [first, 0.0, 0.0, second, 0.0, 0.0]
        yield run(world(h, bodies, e, floor=False), [(last, last)], velocity=out)


@case(
    "Closed form: by symmetry; box3d 83",
    "v_out = v_in, no spin",
    velocity=CLOSE,
    spin=CLOSE,
)
def box_on_a_smaller_box() -> Iterator[Json]:
    """A box with restitution 1 on a smaller box neither turns nor gains speed."""
    for h, quarter in product((1 / 240, 1 / 1000), range(4)):
        lower = box((0.05,) * 3, (0, 0, 0.05), fixed=True)
        # At 1 m/s, from where it touches within the third or fourth step.
        height = 0.15 + (CLEAR + quarter / 4) * h
        upper = box((0.1, 0.1, 0.05), (0, 0, height), (0, 0, -1))
        last = 3 + round(AFTER / h)
        yield run(
            world(h, [upper, lower], 1.0),
            [(last, last)],
            velocity=[0.0, 0.0, 1.0],
            spin=[0.0, 0.0, 0.0],
        )


@case(NEWTON, "v_out = 0", restitution=CLOSE)
def zero_means_zero() -> Iterator[Json]:
    """Restitution 0 does not bounce."""
    for h, v, quarter in product(STEPS, (0.5, 1.0, 2.0), range(4)):
        yield fall(h, v, quarter / 4, 0.0)


@case(
    "The engine's documentation; IsaacLab 1784, sdformat 396",
    "v_out = e v_in, e = combine(0.9, 0.4)",
    restitution=CLOSE,
)
def two_materials() -> Iterator[Json]:
    """Two restitutions become one by the rule that the engine states."""
    for quarter, materials in product(range(4), ([0.9, 0.4], [0.4, 0.9])):
        made = launch(1 / 240, 1.0, quarter / 4, 0.0, materials=materials)
        del made["world"]["restitution"]
        yield made


@case(f"{NEWTON}; newton 2009", LAW, restitution=CLOSE)
def any_mass() -> Iterator[Json]:
    """Restitution does not depend on mass."""
    for mass, quarter in product((0.001, 1.0, 1000.0), range(4)):
        yield launch(1 / 240, 1.0, quarter / 4, 0.5, body={"mass": mass})


@case(
    "Rigid bodies; mujoco_warp 1430",
    "depth = 0",
    depth={"value": 0.01, "reason": "1 % of the edge can be seen"},
)
def depth_over_size() -> Iterator[Json]:
    """Boxes of any size rest on the floor, not in it."""
    for half in (0.01, 0.05, 0.25, 1.0):
        at = world(1 / 240, [box((half,) * 3, (0, 0, half))], 0.0, GRAVITY, friction=0.5)
        yield run(at, [(480, 480)], depth=0.0)


@case(
    "Statics; mujoco_warp 441, mujoco 1545",
    "force = m g in every step",
    force_noise={"value": 0.01, "reason": "1 % is the noise of a good force plate"},
    vibration=STILL,
)
def force_at_rest() -> Iterator[Json]:
    """The force on a box at rest is its weight."""
    for h in (1 / 240, 1 / 1000):
        at = world(h, [box((0.05,) * 3, (0, 0, 0.05))], 0.0, GRAVITY, friction=0.5)
        last = round(2 / h)
        yield run(at, [(last // 2, last)], force_noise=0.0, vibration=0.0)


@case(
    "Closed form: four impacts of equal balls, one after another",
    "the last ball leaves at v, the others rest",
    velocity=CLOSE,
)
def cradle() -> Iterator[Json]:
    """A cradle hands the speed on."""
    for h in (1 / 240, 1 / 1000):
        bodies = []
        # The first of five balls moves, along x; the gaps are of 0.02 m.
        for i, speed in enumerate((1, 0, 0, 0, 0)):
            x = i * (2 * RADIUS + 0.02)
            bodies.append(ball((x, 0, 0), (speed, 0, 0)))
        # After 1 s: four gaps of 0.02 m take 0.08 s at 1 m/s.
        last = round(1 / h)
        # Velocities of four balls at rest, then that of the last one.
        out = [0.0] * 12 + [1.0, 0.0, 0.0]
        yield run(world(h, bodies, 1.0, floor=False), [(last, last)], velocity=out)


@case(
    "Closed form: 5/7 of the speed is left, by angular momentum about the floor",
    "v = ω r = 5/7 v_0",
    velocity=CLOSE,
    spin=CLOSE,
)
def rolling() -> Iterator[Json]:
    """A ball slides, then rolls, and rolls on."""
    for rim, share in ((0.0, 5 / 7), (1.0, 1.0)):
        start = ball((0, 0, RADIUS), (1, 0, 0), spin=[0.0, rim / RADIUS, 0.0])
        at = world(1 / 240, [start], 0.0, GRAVITY, friction=0.3)
        yield run(at, [(720, 720)], velocity=[share, 0.0, 0.0], spin=[0.0, share, 0.0])


@case(
    "Rigid bodies: a step's travel is what discrete contact cannot see",
    "depth <= v h",
    sink={"value": 0.1, "reason": "A tenth of the radius can be seen"},
)
def depth_in_an_impact() -> Iterator[Json]:
    """A ball bounces on the floor, not in it."""
    for h, v, half in product(STEPS, SPEEDS, range(2)):
        deep = launch(h, v, half / 2, 0.8)
        # Longer than any contact that does not sink: v T/π < r/10 + v h.
        yield {**deep, "record": [[0, 60]], "expected": {"sink": 0.0}}


def mesh(half: Sequence[float], position: Sequence[float], **more: Any) -> Json:
    """A solid box as a mesh of 12 triangles, its edges along the axes; of the density of water.

    half: half edges, m.
    position: of its centre, m.
    more: other keys of the body.
    """
    corners = [[x, y, z] for x, y, z in product(*((-side, side) for side in half))]
    # Of each face two triangles, counter-clockwise from outside. A corner's number is 4x + 2y + z.
    faces = (
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    )  # fmt: skip
    body = box(half, position, **more)
    del body["half"]
    return {**body, "shape": "mesh", "vertices": corners, "faces": [*map(list, faces)]}


# Height, m, from which a body falls onto a mesh.
DROP = 0.09
FLAT = {"value": 0.02, "reason": "2 mm of a fall of 90 mm can be seen"}


def onto_a_mesh(make_upper: Callable[..., Json]) -> Iterator[Json]:
    """Runs of a cube that falls onto a mesh, which rests on the floor or is fixed, and must not
    rebound.

    make_upper: makes the cube from its half edges and position: `box` or `mesh`.
    """
    for h, is_fixed in product((1 / 240, 1 / 1000), (False, True)):
        fixed = {"fixed": True} if is_fixed else {}
        lower = mesh((0.1, 0.1, 0.05), (0, 0, 0.05), **fixed)
        upper = make_upper((0.05,) * 3, (0, 0, 0.15 + DROP))
        at = world(h, [upper, lower], 0.0, GRAVITY, friction=0.5)
        landing = math.sqrt(2 * DROP / GRAVITY)
        # From before the landing on, for as long as it would take to return from a bounce.
        span = [round(0.9 * landing / h), round(2.5 * landing / h)]
        yield {**run(at, [span], rise=0.0), "fall": DROP}


@case(f"{NEWTON}; newton 1137", "v_out = 0", rise=FLAT)
def mesh_on_mesh() -> Iterator[Json]:
    """A mesh with restitution 0 does not bounce off a mesh."""
    yield from onto_a_mesh(mesh)


@case(f"{NEWTON}; newton 1137", "v_out = 0", rise=FLAT)
def box_on_mesh() -> Iterator[Json]:
    """A box with restitution 0 does not bounce off a mesh."""
    yield from onto_a_mesh(box)


def text(only: Sequence[str] = ()) -> str:
    """Content of the file of cases, JSON: each run is a line, and what all runs of a case share
    stands before them.

    only: ids of the cases; all where it is empty, and unknown ones are passed over.
    """
    cases = []
    for about, make_runs in _CASES:
        if only and about["id"] not in only:
            continue
        runs = [*make_runs()]
        worlds = [each["world"] for each in runs]
        bodies: list[Json] = []
        for one in worlds:
            bodies += one["bodies"]
        shared = {"world": _shared(worlds), "body": _shared(bodies)}
        lines = [_line(each, shared["world"], shared["body"]) for each in runs]
        # The object of the case, without the bracket that closes it: its runs follow.
        opened = _compact(_rounded({**about, **shared}))[:-1]
        listed = ",\n".join(lines)
        cases.append(f'{opened},"runs":[\n{listed}]}}')
    head = json.dumps({"set": "hcbench-cases-1", "status": "frozen", "units": "SI"})
    return f'{head[:-1]}, "cases": [\n' + ",\n".join(cases) + "]}\n"


def _shared(parts: Sequence[Json]) -> Json:
    """Keys and values that are alike in all parts.

    parts: worlds or bodies of a case's runs, one or more.
    """
    first, *others = parts
    alike = dict(first)
    for other in others:
        for key in first:
            if key not in other or other[key] != first[key]:
                alike.pop(key, None)
    return alike


def _line(each: Json, world: Json, body: Json) -> str:
    """A run as a line of JSON, without what is in the world and the body that its case shares."""
    bodies = [_without(one, body) for one in each["world"]["bodies"]]
    own = {**_without(each["world"], world), "bodies": bodies}
    return _compact(_rounded({**each, "world": own}))


def _compact(value: Json) -> str:
    """Value as JSON without spaces."""
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False)


def _without(whole: Json, shared: Json) -> Json:
    """A world or a body, less what is shared."""
    return {key: value for key, value in whole.items() if key not in shared}


def _rounded(value: Any) -> Any:
    """Data for JSON with its numbers to seven digits, far below any tolerance; whole numbers in lists
    become integers.

    value: a dict, a list, a number, or anything else, which stays as it is.
    """
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    if isinstance(value, list):
        parts = []
        for each in value:
            part = _rounded(each)
            # Whole numbers of a vector are short.
            if isinstance(part, float) and part.is_integer():
                part = int(part)
            parts.append(part)
        return parts
    if isinstance(value, float):
        return float(f"{value:.7g}")
    return value


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
