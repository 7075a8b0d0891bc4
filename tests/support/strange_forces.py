"""Strange force records with their truth: noise, little quiet, other contacts than the law's.

Shares no code with `hcbench fit`. Contacts are integrated as F(x, v), clipped at 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import hcbench as hb
from hcbench.system.errors import UserError

Rng = np.random.Generator
# Force in N over penetration (m, above 0) and rate (m/s), for m = 1 kg: times are scaled after.
Contact = Callable[[float, float], float]
# Above this e the contacts are one, but for 2 % of the largest force.
_NEARLY_ELASTIC = 0.93
LAWS = ("law", "law", "kelvin-voigt", "kuwabara-kono", "friction")


@dataclass(frozen=True, slots=True)
class StrangeForce:
    """One record. law: of LAWS. alpha: s/m, of the law alone; e: of its fastest impact."""

    kind: str
    law: str
    alpha: float
    e: float
    text: str
    options: dict[str, Any] = field(default_factory=dict)
    what: str = ""


def _contact(law: str, speed: float, loss: float, n: float, stiffness: float) -> Contact:
    """A contact that loses about `loss` of the speed at this speed in m/s."""
    if law == "law":
        alpha = loss / speed
        return lambda x, v: stiffness * x**n * (1 + 1.5 * alpha * v)
    if law == "kelvin-voigt":
        damping = 2 * min(0.7 * loss, 0.6) * math.sqrt(stiffness)
        return lambda x, v: stiffness * x + damping * v
    if law == "kuwabara-kono":
        damping = 1.5 * loss * 2e-4 * stiffness
        return lambda x, v: stiffness * x**1.5 + damping * math.sqrt(x) * v
    share = min(0.5 * loss, 0.4)
    return lambda x, v: stiffness * x**n * (1 + share * math.tanh(v / (1e-3 * speed)))


def _impact(contact: Contact, speed: float, mass: float) -> tuple[np.ndarray, ...]:
    """(time, penetration, rate, force) of one impact, 4000 even times, and until the force ends."""

    def force(x: float, v: float) -> float:
        return max(contact(x, v), 0.0) if x > 0 else 0.0

    def rate(_t: float, y: np.ndarray) -> list[float]:
        return [y[1], -force(y[0], y[1]) / mass]

    def parted(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0 else 1.0

    parted.terminal, parted.direction = True, -1.0  # type: ignore[attr-defined]
    done = solve_ivp(rate, (0, 1.0), [0.0, speed], events=parted, rtol=1e-9, atol=1e-13,
                     max_step=2e-3, dense_output=True)  # fmt: skip
    t = np.linspace(0, float(done.t[-1]), 4000)
    x, v = np.asarray(done.sol(t))  # type: ignore[misc]
    f = np.array([force(float(a), float(b)) for a, b in zip(x, v, strict=True)])
    return t, x, v, f


def strange_force(seed: int) -> StrangeForce:
    """The record of a seed: a pulse over time, or every third a loop over penetration and rate."""
    rng = np.random.default_rng([46, seed])
    law = LAWS[seed % len(LAWS)]
    kind = "loop" if seed // len(LAWS) % 3 == 2 else "force"
    speed = float(rng.uniform(0.2, 3.0))
    loss = float(rng.uniform(0.08, 0.5))
    n = float(rng.choice([1.0, 1.5, 1.5, 2.0]))
    mass = float(rng.uniform(0.05, 1.0))
    stiffness = 10.0 ** float(rng.uniform(4, 6)) * (1.0 if n == 1.0 else 30.0)
    noise = float(rng.choice([2e-3, 5e-3, 1e-2, 2e-2, 5e-2]))
    t, _, v, f = _impact(_contact(law, speed, loss, n, stiffness), speed, mass)
    alpha = loss / speed if law == "law" else math.nan
    e = float(-v[-1] / speed)
    what = f"{kind}, {law}, loss {loss:.2f}, n {n}, noise {noise}"
    if kind == "loop":
        rows = []
        for share in (0.5, 0.75, 1.0):
            # The same contact at three speeds.
            _, a, b, c = _impact(_contact(law, speed, loss, n, stiffness), share * speed, mass)
            c = c + min(noise, 1e-2) * f.max() * rng.standard_normal(len(c))
            picked = slice(20, None, 40)
            rows += list(zip(a[picked], b[picked], c[picked], strict=True))
        text = "penetration [m],rate [m/s],force [N]\n"
        text += "".join(f"{a:.9g},{b:.7g},{c:.6g}\n" for a, b, c in rows)
        return StrangeForce(kind, law, alpha, e, text, what=what)
    # So many samples a pulse, and so many pulse lengths of quiet on either side.
    step = float(t[-1]) / int(rng.integers(40, 400))
    quiet = rng.uniform(1.2, 3.0, 2) * t[-1]
    at = np.arange(-quiet[0], t[-1] + quiet[1], step)
    force = np.interp(at, t, f, left=0.0, right=0.0)
    force = (
        force + noise * f.max() * rng.standard_normal(len(at)) + rng.uniform(-0.1, 0.1) * f.max()
    )
    text = "time [s],force [N]\n" + "".join(
        f"{a:.9f},{b:.6g}\n" for a, b in zip(at - at[0], force, strict=True)
    )
    options = {"mass": f"{mass:.6g} +- {2e-3 * mass:.3g} kg",
               "speed": f"{speed:.6g} +- {3e-3 * speed:.3g} m/s"}  # fmt: skip
    return StrangeForce(kind, law, alpha, e, text, options, what)


def judged_force(one: StrangeForce, folder: Path) -> tuple[str, str]:
    """The outcome and a note: "right", "wrong", "wide" or "refused"."""
    path = folder / "force.csv"
    path.write_text(one.text, encoding="utf-8")
    try:
        found = hb.fit_force(path, **one.options)
    except UserError as error:
        return "refused", str(error)[:150]
    low, high = found.alpha_interval
    note = (
        f"law {found.is_law}, α {found.alpha:.4g} [{low:.4g}, {high:.4g}] of {one.alpha:.4g}, "
        f"n {found.exponent:.3g}, misfit {found.misfit:.3g} {found.systematic:.3g}, e {found.e:.4g} +- "
        f"{found.e_uncertainty:.2g} of {one.e:.4g}, by shape {found.e_by_shape:.4g}"
    )
    if one.kind == "force" and abs(found.e - one.e) > max(3 * found.e_uncertainty, 0.01):
        return "wrong", note
    if one.law != "law" and one.e > _NEARLY_ELASTIC:
        # One pulse hardly shows how so little is lost; its e is what counts.
        return "right", note
    if one.law != "law":
        return ("wrong" if found.is_law else "right"), note
    if not found.is_law:
        return "silent", note
    if not low <= one.alpha <= high and abs(found.alpha / one.alpha - 1) > 0.05:
        return "wrong", note
    if high - low > 0.6 * found.alpha:
        return "wide", note
    return "right", note


def forces(count: int, first: int = 0) -> Iterator[StrangeForce]:
    """The records of so many seeds."""
    return map(strange_force, range(first, first + count))
