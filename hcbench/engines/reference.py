"""The truth as an engine: the laws of the paper, by closed form or ODE,
through the door that engines use.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

import hcbench
from hcbench.laws import closed_form, coulomb, kelvin_voigt
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.laws.published import LAWS, TouchSpeedLaw, law_named
from hcbench.recipes.law_recipes import law_options, published_law_options, published_law_recipes
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target, minimax_constant
from hcbench.sim.engine import Engine
from hcbench.system.errors import SettingError
from hcbench.terms.fields import read_numbers
from hcbench.terms.impact import Floats, Impact, Launch, Status, Trajectory
from hcbench.terms.scene import Scene
from hcbench.terms.setting import Setting

# Successive bounces: flights under gravity joined by impacts.

# A body that touches more slowly than this is at rest, m/s.
_REST_SPEED = 1e-6
# Impacts whose speeds differ by less share one loop: a ball that loses nothing bounces thousands of
# times.
_SAME_IMPACT = 1e-3


def successive_bounces(
    impact_at: Callable[[float], Impact], gravity: float, height: float, speed: float, times: Floats
) -> Trajectory:
    """Follow a body over a plate through flights and impacts: penetration, m, below 0 in flight, its
    rate, m/s, above 0 towards the plate, and the force, N, at each of `times`, (n,) each.

    impact_at: the impact at a touch speed (m/s), with its loop.
    gravity: m/s², 0 for one bounce only.
    height: above the plate at release, m.
    speed: then, m/s, towards the plate.
    times: s after release, rising, (n,).

    At rest penetration, rate and force are 0: the static depth is negligible. An impact
    slower than the last computed one by less than 1e-3 has its loop, and loses speed in the
    ratio of v²: (1 - e) v is α v² there.
    """
    x = np.zeros_like(times)
    v = np.zeros_like(times)
    f = np.zeros_like(times)
    # Of the flight: its start, s, the height there, m, and the rate, m/s.
    start = 0.0
    gap = height
    rate = speed
    impact = None
    while start <= times[-1]:
        if rate > 0 or gap > 0:
            touch = math.sqrt(rate**2 + 2 * gravity * gap)
        else:
            # The body leaves the plate and, without gravity or height to fall, comes back as fast.
            touch = -rate
        if touch < _REST_SPEED:
            return Trajectory(times, x, v, f)
        # First the flight, s, up to the touch: which of `times` lie in it, and their time since.
        flight = (touch - rate) / gravity if gravity > 0 else gap / touch
        flying = slice(*np.searchsorted(times, [start, start + flight]))
        t = times[flying] - start
        x[flying] = -gap + rate * t + 0.5 * gravity * t**2
        v[flying] = rate + gravity * t
        start += flight
        if impact is None or abs(impact.speed_in - touch) > _SAME_IMPACT * touch:
            impact = impact_at(touch)
        # Then the impact, along its loop.
        loop = impact.loop
        assert loop is not None
        end = start + loop.time[-1]
        inside = slice(*np.searchsorted(times, [start, end]))
        since = times[inside] - start
        x[inside] = np.interp(since, loop.time, loop.penetration)
        v[inside] = np.interp(since, loop.time, loop.rate)
        f[inside] = np.interp(since, loop.time, loop.force)
        # Speed that the impact takes, m/s: of a loop that is shared, scaled to this one's speed.
        lost = (impact.speed_in - impact.speed_out) * (touch / impact.speed_in) ** 2
        start = end
        gap = 0.0
        rate = lost - touch
        if gravity == 0:
            # It flies on, and never comes back.
            later = times >= start
            x[later] = rate * (times[later] - start)
            v[later] = rate
            break
    return Trajectory(times, x, v, f)


Law = HuntCrossley | KelvinVoigt | TouchSpeedLaw

# Points of a loop, one a time step, within bounds: enough for a smooth
# curve, and few enough for a file.
_POINTS_MIN = 201
_POINTS_MAX = 2001


class ReferenceEngine(Engine):
    """An engine that solves laws without steps or phases: the time step only says how densely a loop
    is sampled.

    Settings: "hunt-crossley", options alpha (s/m), and stiffness (N/m^n) and exponent where they
    differ from the scene's; "kelvin-voigt", options stiffness (N/m) and damping (N s/m), contact
    ending at x = 0; the laws of `laws.published` by their slugs, such as "flores", options
    restitution (the e asked for), and stiffness and exponent: v_i is the speed at touch of each
    impact. Without gravity by closed form, with gravity by ODE. Along the plate Coulomb's law with
    the scene's friction, in closed form.
    """

    name = "reference"
    title = "Reference"

    def version(self) -> str:
        """The version of hcbench."""
        return str(hcbench.__version__)

    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch, in order."""
        law = law_of(setting, scene)
        return [self._one(law, scene, setting.timestep, launch) for launch in launches]

    def trajectory(
        self, scene: Scene, setting: Setting, launch: Launch, duration: float
    ) -> Trajectory:
        """Flights and impacts in turn over a duration (s), sampled at the setting's step.

        Raises SettingError for a setting that the reference does not have.
        """
        law = law_of(setting, scene)
        h = setting.timestep
        times = h * np.arange(max(2, round(duration / h) + 1), dtype=np.float64)

        def impact_at(speed: float) -> Impact:
            return _impact(law, scene.mass, speed, scene.gravity, h)

        return successive_bounces(
            impact_at, scene.gravity, launch.clearance(h), launch.speed, times
        )

    @staticmethod
    def _one(law: Law, scene: Scene, timestep: float, launch: Launch) -> Impact:
        """The impact of one launch, at the speed that gravity gives it until the touch.

        timestep: s.
        Its status is NO_TOUCH where it never gets there.
        """
        speed = launch.touch_speed(timestep, scene.gravity)
        if speed == 0.0:
            return Impact(launch, Status.NO_TOUCH, "released at rest and without gravity")
        impact = _impact(law, scene.mass, speed, scene.gravity, timestep)
        if not (launch.is_oblique and impact.is_measured):
            return replace(impact, launch=launch)
        return replace(impact, launch=launch, tangential=coulomb.tangential(impact, launch, scene))


def law_of(setting: Setting, scene: Scene) -> Law:
    """The law that a setting of the reference names, with its options' numbers.

    scene: its stiffness and exponent hold where the options have none.
    Raises SettingError for another name, and for options that the law does not have or that are
    missing.
    """
    if setting.name == "hunt-crossley":
        defaults = {"stiffness": scene.stiffness, "exponent": scene.exponent}
        return HuntCrossley(**_numbers(setting, defaults, required=("alpha",)))
    if setting.name == "kelvin-voigt":
        return KelvinVoigt(**_numbers(setting, {}, required=("stiffness", "damping")))
    slugs = [law.slug for law in LAWS.values()]
    if setting.name in slugs:
        defaults = {"stiffness": scene.stiffness, "exponent": scene.exponent}
        return TouchSpeedLaw(
            law_named(setting.name), **_numbers(setting, defaults, required=("restitution",))
        )
    names = ", ".join(map(repr, ["hunt-crossley", "kelvin-voigt", *slugs]))
    raise SettingError("setting", f"{setting.name!r} of the reference", f"one of: {names}")


def _numbers(
    setting: Setting, defaults: Mapping[str, float], required: Sequence[str]
) -> dict[str, float]:
    """Options as numbers, with defaults for those left out. Raises SettingError."""
    slot = f"{setting.name} option '{{}}'"
    return {**defaults, **read_numbers(setting.options, required, [*defaults], SettingError, slot)}


# A study asks for every speed at several phases, which the truth does not depend on.
@lru_cache(maxsize=512)
def _impact(law: Law, mass: float, speed: float, gravity: float, timestep: float) -> Impact:
    """The impact of a mass on a law, with its loop of force over penetration sampled at a time step;
    by a closed form where there is one, else by an ODE.

    Its arrays are read-only, as all who ask for the same impact share them.

    mass: kg.
    speed: at touch, m/s.
    gravity: m/s².
    timestep: s.
    """
    # Published laws whose damping depends on the speed at touch: of one impact a plain law.
    if isinstance(law, TouchSpeedLaw):
        law = law.at(speed)
    if gravity == 0.0 and isinstance(law, HuntCrossley):
        impact = _closed_hunt_crossley(law, mass, speed, timestep)
    # An overdamped spring and damper has no closed form here.
    elif gravity == 0.0 and kelvin_voigt.damping_ratio(law, mass) < 1.0:  # type: ignore[arg-type]
        impact = _closed_kelvin_voigt(law, mass, speed, timestep)  # type: ignore[arg-type]
    else:
        from hcbench.laws import ode

        impact = ode.impact(law, mass, speed, gravity=gravity, count=2 * _POINTS_MIN - 1)
    if impact.loop is not None:
        for array in (
            impact.loop.time,
            impact.loop.penetration,
            impact.loop.rate,
            impact.loop.force,
        ):
            # Shared by every impact that asks for the same.
            array.flags.writeable = False
    return impact


def _points(duration: float, timestep: float) -> int:
    """Number of points of a loop of this duration (s): odd, so that the
    turning point is one of them.
    """
    return int(min(max(duration / timestep, _POINTS_MIN), _POINTS_MAX)) // 2 * 2 + 1


def _closed_hunt_crossley(law: HuntCrossley, mass: float, speed: float, timestep: float) -> Impact:
    """The impact of a mass on a law by the closed forms of eq. (16), without gravity, with its loop.

    mass: kg.
    speed: m/s.
    timestep: s, of the loop's points.
    """
    duration = float(closed_form.duration(law, mass, speed))
    count = _points(duration, timestep)
    return Impact(
        launch=Launch(speed),
        status=Status.PARTED,
        speed_in=speed,
        speed_out=float(closed_form.restitution(law.alpha, speed)) * speed,
        duration=duration,
        penetration_max=float(closed_form.penetration_max(law, mass, speed)),
        force_max=float(closed_form.force_max(law, mass, speed)),
        samples=count,
        loop=closed_form.loop(law, mass, speed, count),
    )


def _closed_kelvin_voigt(law: KelvinVoigt, mass: float, speed: float, timestep: float) -> Impact:
    """The impact of an underdamped spring and damper that ends at the surface, without gravity.

    mass: kg.
    speed: m/s.
    timestep: s, of the loop's points.
    """
    ending = kelvin_voigt.Ending.SURFACE
    bounce = kelvin_voigt.bounce(law, mass, speed, ending)
    count = _points(bounce.duration, timestep)
    return Impact(
        launch=Launch(speed),
        status=Status.PARTED,
        speed_in=speed,
        speed_out=bounce.restitution * speed,
        duration=bounce.duration,
        penetration_max=bounce.penetration_max,
        force_max=bounce.force_max,
        samples=count,
        loop=kelvin_voigt.loop(law, mass, speed, ending, count),
    )


_SAMPLING = "The step only says how densely the loop is sampled."


def kelvin_voigt_setting(target: Target) -> dict[str, float]:
    """Options of a setting: eq. (4) with the best constant restitution of the band and the
    law's contact time in its middle.

    k and c from e = exp(-β t) and t = π/ω, contact ending at x = 0.
    Raises SettingError for an e of 0, for which c would be infinite.
    """
    e, _ = minimax_constant(target)
    if e == 0.0:
        raise SettingError(
            "restitution", "0", "e above 0: c is infinite at e = 0", "Take a small e, such as 0.01"
        )
    middle = math.sqrt(target.speed_min * target.speed_max)
    duration = float(closed_form.duration(target.law, target.mass, middle))
    decay = -math.log(e) / duration
    stiffness = target.mass * ((math.pi / duration) ** 2 + decay**2)
    return {"stiffness": stiffness, "damping": 2 * target.mass * decay}


RECIPES = (
    Recipe(
        "reference",
        "hunt-crossley",
        Role.LAW_AND_LOOP,
        lambda target: law_options(target.law),
        "The law itself, in closed form: restitution falls with impact speed.",
        (_SAMPLING,),
        native=False,
    ),
    Recipe(
        "reference",
        "kelvin-voigt",
        Role.CONSTANT_E,
        kelvin_voigt_setting,
        "A linear spring and damper: one e for all speeds, a force jump at touch, tension at the end.",
        ("Matches the law's restitution and contact time at one speed only.",),
        native=False,
    ),
    *published_law_recipes("reference", published_law_options, _SAMPLING),
)
