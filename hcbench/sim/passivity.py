"""Test whether a contact adds energy: drops and slow launches in any engine,
and the limits they must keep.

In free flight each integrator keeps an energy of its own. Semi-implicit Euler, which moves by the
new velocity, keeps (v + g h/2)² - 2 g x exactly, penetration x, rate v; exact flight and RK4 keep
v² - 2 g x. So e is the square root of what an impact leaves of it, whichever step sees the touch.
"""

from __future__ import annotations

import math
from contextlib import closing, nullcontext
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.sim.entry_points import here
from hcbench.sim.read_impact import SpeedReading
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY
from hcbench.workers import call, redirect_output

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.engine import Engine, SteppedEngine
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Heights of the drops, m.
HEIGHTS = tuple(np.geomspace(2e-4, 0.2, 40).tolist())
# Simulated time of a drop, s; what bounces then must be allowed to by the target.
LASTS = 30.0
# A larger e gains energy; searches aim at 1.0005.
MOST_E = 1.002
MOST_ENERGY = MOST_E**2
# Largest drift down a slope below the friction angle, m/s.
MOST_DRIFT = 1e-4
# Time before the end, s, in which a body still bounces.
_STILL = 1.0
# A train of bounces has ended at this speed, m/s, in hops of 50 nm; the law's own
# never ends, as its e nears 1.
_SLOWEST = 1e-3
# Speeds of a table from _SLOWEST on, each less than 0.2 % above the one before.
_TABLE = 5000
# Steps of drops that are taken at once.
_CHUNK = 1000
# Between this share of the band's lowest speed and this speed, m/s, no impact may gain energy.
_SLOW = 0.1
_FAST = 2.0
# In g h: a ball that falls by a step at all arrives faster.
_FALLS = 0.6
# Launches: so many speeds below the band, at so many phases each.
_SPEEDS = 8
_PHASES = 8


@dataclass(frozen=True, slots=True)
class LongestTrain:
    """The longest train of bounces that a target allows after a drop.

    A target with e near 1 bounces for minutes: e = 0.99 ends 40 s after a drop of 0.2 m. So an
    engine's train is compared with the target's own, and not with a time that is the same for all.

    curve: the target.
    error: the error of e that the setting promises.
    fastest: the band's highest speed, m/s; nothing is promised above it, and e may be as large
    there as at that speed.
    """

    curve: RestitutionCurve
    error: float
    fastest: float

    def restitution(self, speed: Floats) -> Floats:
        """Largest e that is allowed: the target's plus the error; same shape as `speed`.

        speed: of the impacts, m/s.
        An impact takes at least half of what the target takes. Without that bound an error of the
        size of 1 - e would allow a body to bounce for ever.
        """
        e = np.clip(self.curve.at(np.minimum(speed, self.fastest)), 0.0, 1.0)
        return np.asarray(e + np.minimum(self.error, (1.0 - e) / 2.0))

    def rebounds_after(self, heights: Sequence[float], gravity: float, seconds: float) -> Floats:
        """Speeds with which bodies still bounce `seconds` after they were dropped, if each impact
        has the largest e that is allowed: m/s, (d,); 0 where the bouncing ended.

        heights: of the d drops, m.
        gravity: m/s², above 0.
        """
        speed = np.sqrt(2.0 * gravity * np.asarray(heights, dtype=np.float64))
        # A train has thousands of bounces: e from a table takes a tenth of
        # the time of the law's series.
        speeds = np.geomspace(min(_SLOWEST, speed.min()), speed.max(), _TABLE)
        restitutions = self.restitution(speeds)
        next_touch = speed / gravity  # s
        # Of the drops that touch again in time: indices, speeds and times of the next touch.
        going = np.flatnonzero(next_touch <= seconds)
        bouncing = speed[going]
        touch = next_touch[going]
        while going.size:
            bouncing *= np.interp(bouncing, speeds, restitutions)
            bouncing[bouncing < _SLOWEST] = 0.0
            # A flight up and down.
            touch += 2.0 * bouncing / gravity
            goes_on = (touch <= seconds) & (bouncing > 0.0)
            if not goes_on.all():
                speed[going] = bouncing
                going = going[goes_on]
                bouncing = bouncing[goes_on]
                touch = touch[goes_on]
        return speed


@dataclass(frozen=True, slots=True)
class Bounces:
    """Results of drops from HEIGHTS and of launches below and above the band.

    max_e: the largest e of all impacts.
    gains_below: the highest impact speed with an e above MOST_E, m/s; 0 where there is none.
    still_bouncing: drops that go on after LASTS, faster than the target allows.
    tried: how many of both.
    """

    max_e: float
    gains_below: float
    still_bouncing: int
    tried: int

    @property
    def passive(self) -> bool:
        """True where no impact gained energy and all drops came to rest as the target does."""
        return self.max_e <= MOST_E and not self.still_bouncing

    def joined(self, other: Bounces) -> Bounces:
        """Join the results of two sets of launches: the larger extremes, and the sums of counts."""
        return Bounces(
            max(self.max_e, other.max_e),
            max(self.gains_below, other.gains_below),
            self.still_bouncing + other.still_bouncing,
            self.tried + other.tried,
        )


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one scene in which a setting was tried.

    name: what it is.
    under: options it ran with.
    value, limit: in `unit`.
    tried: launches of which the value is the worst.
    """

    name: str
    under: str
    value: float
    limit: float
    unit: str = ""
    tried: int = 1

    @property
    def passed(self) -> bool:
        """True if the value stays within its limit."""
        return self.value <= self.limit

    @property
    def failure(self) -> str:
        """The value beside its limit, as a phrase; lengths in mm, speeds in mm/s."""
        if self.unit in ("m", "m/s"):
            value, limit, unit = 1e3 * self.value, 1e3 * self.limit, f"m{self.unit}"
            return f"{self.name}: {value:.3g} {unit}, at most {limit:.4g} {unit} allowed"
        shown = f"{self.value:.3g} {self.unit}".rstrip()
        return f"{self.name}: {shown}, at most {self.limit:.4g} allowed"


@dataclass(frozen=True, slots=True)
class Passivity:
    """Energy and rest of a setting, as far as they were tested.

    bounces: of a ball.
    flat: whether bodies that touch at several points, such as a box on its face, passed all tests;
    None where none was tried.
    slope_drift: of a ball that may not turn, on 10 degrees, m/s; NaN without friction.
    findings: of the whole gate, empty for a screen.
    others: what the setting does to other contacts of the model, a sentence; "" for nothing.
    sliding: of a ball that slides, spins and rolls with friction.
    boxes: of boxes and a capsule that fall and, with friction, slide and spin; those after the
    first that fails may be missing.
    """

    bounces: Bounces
    flat: bool | None = None
    slope_drift: float = math.nan
    findings: tuple[Finding, ...] = ()
    others: str = ""
    sliding: tuple[Finding, ...] = ()
    boxes: tuple[Finding, ...] = ()

    @property
    def sphere(self) -> bool:
        """True if a ball never gains energy, comes to rest, and holds on a slope."""
        holds = not self.slope_drift > MOST_DRIFT
        slides = all(finding.passed for finding in self.sliding)
        return self.bounces.passive and holds and slides

    @property
    def worst_of_boxes(self) -> str:
        """The finding for boxes and a capsule that is furthest above its limit, as a phrase; "" where
        they passed, or none was tried.
        """
        failed = [finding for finding in self.boxes if not finding.passed]
        if not failed:
            return ""
        return max(failed, key=lambda finding: finding.value / finding.limit).failure

    @property
    def scenes(self) -> int:
        """Number of launches and drops in which energy was tested, of boxes if they passed."""
        passed = self.sliding
        if self.flat:
            passed += self.boxes
        return self.bounces.tried + sum(finding.tried for finding in passed)

    @property
    def warning(self) -> str:
        """Faults that speak against recommending the setting, as a phrase; "" if it has none."""
        bounces = self.bounces
        words = []
        if bounces.max_e > MOST_E:
            words.append(
                f"gains energy below {bounces.gains_below:.2g} m/s (e up to {bounces.max_e:.4g})"
            )
        if bounces.still_bouncing:
            counted = f"{bounces.still_bouncing} of {bounces.tried}"
            words.append(
                f"does not come to rest ({counted} bounce on longer than the target would)"
            )
        if self.slope_drift > MOST_DRIFT:
            words.append(f"slides down a slope of 10 degrees at {1e3 * self.slope_drift:.2g} mm/s")
        words += [finding.failure for finding in self.sliding if not finding.passed]
        return "; ".join(words)


@dataclass(slots=True)
class DropReader:
    """Reads the impacts of drops, a chunk of steps after another.

    timestep: s.
    gravity: m/s², into the plate.
    allowed: rebound speeds at the end that the target allows, m/s, one for each drop.
    reading: which energy the integrator keeps.
    max_e: largest e so far.
    gains_below: highest speed so far, m/s, at which one gained energy.
    _last: penetration, m, and rate, m/s, in each drop's last step.
    _speed_in, _speed_out: of each drop's last impact, m/s.
    _parted: the step in which it ended.
    _steps: read so far.
    """

    timestep: float
    gravity: float
    allowed: Floats
    reading: SpeedReading = SpeedReading.TOUCH_PLANE
    max_e: float = 0.0
    gains_below: float = 0.0
    _last: Floats | None = None
    _speed_in: Floats = field(default_factory=lambda: np.zeros(0))
    _speed_out: Floats = field(default_factory=lambda: np.zeros(0))
    _parted: Floats = field(default_factory=lambda: np.zeros(0))
    _steps: int = 0

    def add(self, penetration: Floats, rate: Floats) -> None:
        """Read the next steps of each drop; penetration and rate at their starts, (d, n), m and
        m/s.

        The first call says how many drops there are. An impact is judged in the step in which its
        body parts; a chunk may end within it.
        """
        chunk = np.stack([penetration, rate])
        if self._last is None:
            self._last = chunk[..., :1]
            count = len(penetration)
            self._speed_in = np.full(count, np.nan)
            self._speed_out = np.zeros(count)
            self._parted = np.full(count, -math.inf)
        # With the last step of the chunk before, in case the body touches or parts just between.
        x, v = np.concatenate([self._last, chunk], axis=2)
        self._last = chunk[..., -1:]
        # Speed at the touch plane, by the energy that the integrator keeps in free flight.
        half = self.reading.share * self.gravity * self.timestep
        at_plane = np.sqrt(np.maximum(0.0, (v + half) ** 2 - 2.0 * self.gravity * x))
        apart = x <= 0.0
        changed = apart[:, :-1] != apart[:, 1:]
        # Steps after which a body touches or parts, drop by drop, each in order.
        for drop, step in zip(*np.nonzero(changed), strict=True):
            if apart[drop, step]:
                self._speed_in[drop] = at_plane[drop, step]
            # A body that is lifted out of the plate while it sinks has not parted.
            elif v[drop, step + 1] < 0.0:
                self._parted[drop] = self._steps + step
                self._speed_out[drop] = at_plane[drop, step + 1]
                self._judge(self._speed_in[drop], at_plane[drop, step + 1])
        self._steps += penetration.shape[1]

    def _judge(self, speed_in: float, speed_out: float) -> None:
        """Update the largest e, and the fastest impact that gained energy, by one bounce.

        speed_in, speed_out: m/s.
        A bounce whose speed in is 0 or NaN does not count.
        """
        if not speed_in > 0.0:
            return
        e = float(speed_out / speed_in)
        self.max_e = max(self.max_e, e)
        if e > MOST_E:
            self.gains_below = max(self.gains_below, float(speed_in))

    @property
    def bounces(self) -> Bounces:
        """Return the results of the steps read so far."""
        late = self._steps - _STILL / self.timestep
        bounces_on = (self._parted > late) & (self._speed_out > self.allowed)
        return Bounces(self.max_e, self.gains_below, int(bounces_on.sum()), len(self._parted))


def allowed_rebounds(
    train: LongestTrain | None, heights: Sequence[float], gravity: float
) -> Floats:
    """Speeds with which bodies may still bounce in the last _STILL seconds of drops that last LASTS:
    m/s, (d,) for d heights.

    train: the longest train of bounces that the target allows; None: all speeds are 0, as the body
    has to rest.
    heights: m.
    gravity: m/s², above 0.
    """
    if train is None:
        return np.zeros(len(heights))
    return train.rebounds_after(heights, gravity, LASTS - _STILL)


def passivity_of(
    engine: Engine,
    scene: Scene,
    setting: Setting,
    speeds: tuple[float, float],
    whole: bool,
    train: LongestTrain | None = None,
) -> Passivity:
    """Test whether a setting adds energy, by impacts below and above a band of speeds, and, if
    `whole`, by drops as well: the `bounces` of the result; nothing else is tested.

    speeds: the band, lowest and highest, m/s.
    train: the longest train of bounces that its target allows; None for a setting that must rest in
    LASTS seconds.
    An engine without time steps has no drops.
    Raises SettingError for a setting that the engine cannot have, SceneError for a scene that it
    cannot load, EngineMissing, EngineFailed.
    """
    # An engine in an environment of its own answers by its adapter.
    adapter = getattr(engine, "adapter", engine)
    controlled = getattr(adapter, "error_controlled", None)
    has_steps = hasattr(adapter, "load")
    phases = _PHASES
    # Without steps that the engine keeps to, the phase within a step means nothing.
    if controlled is None and not has_steps:
        phases = 1
    if controlled is not None and controlled(setting):
        phases = 1
    launches = _around_band(speeds, phases, setting.timestep, scene.gravity)
    largest_e = 0.0
    # The fastest impact that gained energy, m/s.
    gains_below = 0.0
    measured = 0
    for impact in engine.run(scene, setting, launches):
        if not impact.is_measured or not impact.speed_in > 0.0:
            continue
        measured += 1
        largest_e = max(largest_e, impact.restitution)
        if impact.restitution > MOST_E:
            gains_below = max(gains_below, impact.speed_in)
    bounces = Bounces(max_e=largest_e, gains_below=gains_below, still_bouncing=0, tried=measured)
    if whole and has_steps:
        bounces = bounces.joined(drops_in(engine, scene, setting, train=train))  # type: ignore[arg-type]
    return Passivity(bounces)


def _around_band(
    speeds: tuple[float, float], phases: int, timestep: float, gravity: float
) -> list[Launch]:
    """Launches below and above a band of impact speeds, at its ends too, each speed at several
    phases.

    speeds: lowest and highest of the band, m/s.
    phases: evenly over a step.
    timestep: s.
    gravity: m/s².
    """
    low, high = speeds
    slowest = max(_SLOW * low, _FALLS * gravity * timestep)
    below_band = np.geomspace(min(slowest, low), low, _SPEEDS)
    above_band = np.geomspace(high, max(high, _FAST), 3)
    launches = []
    # Each speed once: both ends of a band of one speed are one, and so are all speeds beside an end
    # that lies at the limit of what is tried.
    for v in dict.fromkeys((*below_band, *above_band)):
        for number in range(phases):
            phase = (number + 0.5) / phases
            launches.append(Launch.touching(v, phase, timestep, gravity))
    return launches


def drops_in(
    engine: SteppedEngine,
    scene: Scene,
    setting: Setting,
    heights: Sequence[float] = HEIGHTS,
    train: LongestTrain | None = None,
) -> Bounces:
    """Drop the scene's body in an engine from each height, simulate it for LASTS s by the engine's
    own steps, and read how it bounces.

    The scene's gravity acts, or the standard one where it has none.

    heights: m, the highest last.
    train: the longest train of bounces that the setting's target allows; None: it must rest.
    Raises SettingError for a setting that the engine cannot have, SceneError for a scene that it
    cannot load, EngineMissing, EngineFailed for a worker process that died or hung.
    """
    with_gravity = replace(scene, gravity=scene.gravity or STANDARD_GRAVITY)
    if not engine.own_process:
        return _drops_here(engine.name, with_gravity, setting, heights, train)
    steps = LASTS / setting.timestep * len(heights)
    limit = engine.limit + steps * 1e-3
    return call(_drops_here, engine.name, with_gravity, setting, heights, train, limit=limit)


def _drops_here(
    name: str, scene: Scene, setting: Setting, heights: Sequence[float], train: LongestTrain | None
) -> Bounces:
    """Drop the scene's body in an engine from each height, simulate it for LASTS s in this process,
    and read how it bounces.

    name: of the engine.
    heights: m, the highest last.
    train: the longest train of bounces that the setting's target allows; None: it must rest.
    """
    engine: SteppedEngine = here(name)  # type: ignore[assignment]
    launches = [Launch(0.0, height=height) for height in heights]
    fastest = launches[-1].touch_speed(setting.timestep, scene.gravity)
    steps = round(LASTS / setting.timestep)
    allowed = allowed_rebounds(train, heights, scene.gravity)
    bounces = Bounces(max_e=0.0, gains_below=0.0, still_bouncing=0, tried=0)
    with (
        redirect_output() if engine.own_process else nullcontext(),
        engine.load(scene, setting, fastest) as world,
    ):
        # As many at a time as the world carries; the last group may be smaller.
        for start in range(0, len(launches), world.places):
            together = slice(start, start + world.places)
            reader = DropReader(
                world.timestep, world.gravity, allowed[together], world.speed_reading
            )
            done = 0
            with closing(world.release(launches[together])) as simulation:
                while done < steps:
                    record = simulation.advance(min(_CHUNK, steps - done))
                    reader.add(record.penetration, record.rate)
                    done += record.force.shape[1]
            bounces = bounces.joined(reader.bounces)
    return bounces
