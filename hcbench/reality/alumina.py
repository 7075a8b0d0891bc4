"""Alumina balls of 5 mm thrown obliquely onto glass at 3.9 m/s: 31
points digitised from three figures.

Kharaz, Gorham and Salman, Powder Technology 120 (2001) 281; digitised in Kratos Multiphysics,
commit 650ccb2,
applications/DEMApplication/test_examples/basic_benchmarks/paper_data/benchmark4_graph1..3.dat. e
and the friction are the paper's, as benchmarks quote them.
"""

from pathlib import Path

import numpy as np

from hcbench.reality.motion import MeasuredBounces, SettingErrors, bounced
from hcbench.sim.toss import Body, ContactSetting, TossModule
from hcbench.terms.impact import Floats

TITLE = "alumina on glass"
UNIT = "of e_t"
# No tosses to learn from: e and the friction are published.
TRAINING: tuple[int, ...] = ()
VALIDATION = (0,)
TIMESTEP = 5e-5
DURATION = 0.06  # s
RADIUS = 0.0025  # m
DENSITY = 4000.0  # kg/m³
SPEED = 3.9  # m/s
MASS = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3
INERTIA = 0.4 * MASS * RADIUS**2
FIXED = {"restitution": 0.98, "friction": 0.092}
# Degrees: below, the surfaces' compliance along the plate shows, which no engine here has.
FINE_FROM = 30.0
# Angle of incidence from the normal in degrees against the ratio of the tangential speeds, ...
TANGENTIAL = np.array([
    [2.238, 0.7965], [4.218, 0.7463], [9.842, 0.6755], [20.218, 0.5988], [30.356, 0.6903],
    [39.545, 0.7743], [49.604, 0.8476], [71.069, 0.9366], [79.228, 0.9695], [85.168, 0.9794],
])  # fmt: skip
# ... against the spin after, rad/s, ...
SPIN_AFTER = np.array([
    [5.897, 134.9], [10.868, 261.2], [21.124, 573.7], [31.144, 612.2], [38.955, 595.1],
    [50.237, 449.5], [60.099, 375.7], [69.961, 243.0], [78.560, 142.4], [84.320, 70.6],
])  # fmt: skip
# ... and against the angle at which the contact's point leaves, degrees.
REBOUND = np.array([
    [2.100, 0.770], [3.943, 0.770], [9.718, -1.057], [20.310, -8.535], [30.161, -2.553], [39.120, 9.909],
    [49.512, 30.015], [59.904, 49.955], [70.460, 66.903], [78.860, 78.867], [84.782, 85.680],
])  # fmt: skip


def body() -> Body:
    """The ball."""
    return Body("sphere", (RADIUS,) * 3, MASS, (INERTIA,) * 3)


def cases(parts: tuple[int, ...], folder: Path | None = None, variant: str = "") -> MeasuredBounces:
    """All throws, of the three figures one after the other, without spin; parts, folder and variant
    change nothing.

    Velocities are in m/s, x along the plate and z up; those after the bounce are unknown, NaN, as
    the spins are.
    """
    angle = np.radians(np.concatenate([TANGENTIAL[:, 0], SPIN_AFTER[:, 0], REBOUND[:, 0]]))
    zero = np.zeros_like(angle)
    velocity = SPEED * np.stack([np.sin(angle), zero, -np.cos(angle)], axis=1)
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(angle), 1))
    nothing = np.full_like(velocity, np.nan)
    return MeasuredBounces(
        numbers=np.arange(len(angle), dtype=np.float64),
        attitude=attitude,
        velocity=velocity,
        spin=np.zeros_like(velocity),
        velocity_after=nothing,
        spin_after=nothing,
    )


def outcome(
    module: TossModule, setting: ContactSetting, values: tuple[float, ...], bounces: MeasuredBounces
) -> SettingErrors:
    """Errors of an engine's setting, of the ratio of tangential speeds after and before, over the
    throws of the first figure.

    module: `toss` of the engine.
    values: of the setting's parameters.
    bounces: all throws. Raises what the engine raises.
    """
    later, spin = bounced(module, setting, values, body(), bounces, TIMESTEP, DURATION)
    return judged(bounces, later, spin)


def rigid(bounces: MeasuredBounces, e: float, friction: float) -> SettingErrors:
    """Errors of a rigid ball with a constant e and Coulomb's friction, in the ratio of tangential
    speeds after and before, over the throws of the first figure.

    bounces: velocities at the touch, m/s, with z up, without spin.
    friction: μ.
    """
    # Impulses over the mass, m/s: of the normal force, and of friction, which slides, or stops the
    # slip, at 2/7 of it for a solid ball.
    push = -(1.0 + e) * bounces.velocity[:, 2]
    pull = np.minimum(friction * push, bounces.velocity[:, 0] * 2.0 / 7.0)
    later = bounces.velocity * [1.0, 1.0, -e]
    later[:, 0] -= pull
    spin = np.zeros_like(later)
    spin[:, 1] = pull * MASS * RADIUS / INERTIA
    return judged(bounces, later, spin)


def judged(bounces: MeasuredBounces, later: Floats, spin: Floats) -> SettingErrors:
    """Errors over the throws of the first figure alone: difference of the tangential speed after
    over that before from the measured ratio.

    bounces: all throws.
    later, spin: velocities (m/s) and spins (rad/s) after them, shape (n, 3); spins count nothing.
    """
    n = len(TANGENTIAL)
    away = np.abs(later[:n, 0] / bounces.velocity[:n, 0] - TANGENTIAL[:, 1])
    return SettingErrors(away, away)
