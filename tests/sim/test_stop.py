"""Rest of a body: the rule equals a loop over the steps, however the steps come in."""

from __future__ import annotations

import itertools

import numpy as np

from hcbench.sim.stop import End, StopRule
from hcbench.terms.impact import Floats, Launch


def _path(
    rng: np.random.Generator, steps: int, h: float, g: float, kind: int
) -> tuple[Floats, Floats, Floats]:
    """Penetration, rate and force of a body that lands, and then rests in
    one of several ways or does not.
    """
    step, touch, speed = np.arange(steps), int(rng.integers(0, 6)), 10 ** rng.uniform(-3, 0.5)
    late = np.maximum(0, step - touch)
    rate = (
        speed
        * np.exp(-late * 10 ** rng.uniform(-3, 0))
        * np.cos(10 ** rng.uniform(-2.5, -0.3) * late)
    )
    x = np.where(step < touch, -speed * (touch - step) * h, 0) + np.cumsum(rate) * h
    force = np.where(step >= touch, 1.0 + rng.random(steps), 0.0)
    if kind == 1:  # without force
        force[late > 50], rate[late > 50] = 0.0, rate[late > 50] * 1e-3
    if kind == 2:  # in one place, as fast as gravity makes it
        x[late > 80], rate[late > 80] = x[min(steps - 1, touch + 81)], g * h * rng.uniform(0, 4)
    if kind == 3:
        rate[late > 30] = g * h * rng.uniform(0, 3)
    return x, rate, force


def _first_rest(x: Floats, v: Floats, f: Floats, launch: Launch, h: float, g: float) -> int | None:
    """The step at which a body is at rest, by a loop over the steps."""
    speed_at_touch, touch = launch.touch_speed(h, g), None
    runs = {"still": 0, "idle": 0, "held": 0, "stuck": 0}
    for k in range(len(x)):
        touch = k if touch is None and f[k] != 0.0 else touch
        if touch is None:
            continue
        quiet = {
            "still": abs(v[k]) <= 1e-6 * speed_at_touch,
            "idle": f[k] == 0.0 and abs(v[k]) <= 1e-3 * speed_at_touch,
            "held": g > 0.0 and abs(v[k]) <= 1.5 * g * h,
            "stuck": g > 0.0 and k > 0 and x[k] == x[k - 1],
        }
        for name, met in quiet.items():
            runs[name] = runs[name] + 1 if met else 0
            if runs[name] >= (32 if name == "still" else max(128, (k - touch) // 2)):
                return k
    return None


def test_rest_is_what_a_loop_over_the_steps_finds_in_chunks_of_any_length() -> None:
    rng, rested = np.random.default_rng(0), 0
    for _ in range(40):
        count, steps, h = (
            int(rng.integers(1, 12)),
            int(rng.integers(60, 1200)),
            10 ** rng.uniform(-5, -2.5),
        )
        g = float(rng.choice([0.0, 9.81]))
        paths = [_path(rng, steps, h, g, int(rng.integers(0, 4))) for _ in range(count)]
        launches = [Launch(float(max(1e-4, rate[0]))) for _, rate, _ in paths]
        rule, states, alive = (
            StopRule.for_launches(launches, h, g),
            np.stack(paths, axis=1),
            np.arange(count),
        )
        cuts = np.unique([0, steps, *rng.integers(1, steps, rng.integers(0, 12))])
        ends: dict[int, tuple[int, int]] = {}
        for start, stop in itertools.pairwise(cuts.tolist()):
            counts, whys = rule.add(*states[:, alive, start:stop])
            ends |= {
                int(i): (int(n), int(w)) for i, n, w in zip(alive, counts, whys, strict=True) if n
            }
            rule.keep(counts == 0)
            alive = alive[counts == 0]
            if not len(alive):
                break
        for i, (path, launch) in enumerate(zip(paths, launches, strict=True)):
            at_rest = _first_rest(*path, launch, h, g)
            over, why = ends.get(i, (steps + 1, End.GOING))
            if why == End.RESTED:
                assert at_rest == over - 1
                rested += 1
            else:  # something else ended it before, or nothing did
                assert at_rest is None or at_rest >= over - 1
    assert rested > 60
