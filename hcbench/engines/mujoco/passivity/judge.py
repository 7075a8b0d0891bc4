"""A setting's passivity: a screen of a second, with drops in the model of its rows, or the whole
gate; and what its cone and impratio, which are of the whole model, do to other contacts.
"""

from __future__ import annotations

import ctypes
import math
from dataclasses import replace
from functools import cache, lru_cache, partial
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.passivity.plain import (
    Contact,
    Stepping,
    ball_slides,
    boxes,
    boxes_slide,
    certify,
    rest_on_slope,
)
from hcbench.engines.mujoco.scene.mjcf import Options, pairs_text, read_options
from hcbench.engines.mujoco.scene.rows import acceleration
from hcbench.laws.contact_law import is_force
from hcbench.sim.passivity import (
    HEIGHTS,
    LASTS,
    MOST_E,
    Bounces,
    Finding,
    LongestTrain,
    Passivity,
    allowed_rebounds,
)
from hcbench.system.compiler import build
from hcbench.system.errors import HcbenchError
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from hcbench.engines.mujoco.scene.rows import ConstraintRow
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting


# Drops in the model of the rows: Euler's steps in contact, and each flight in one go.

# A drop rests after so many steps in contact without a parting.
_RESTED = 200
# Steps in contact of each drop: of finer time steps the rest is left to the whole gate.
_MOST_STEPS = 6000
# The most rows of a setting in drops.c; of others NumPy takes the steps.
_MOST_ROWS = 64
# Single launches start at this share of the band's lowest speed; so many
# speeds, at so many phases each.
_SLOW = 0.1
_SPEEDS = 24
_PHASES = 24


def bounces_in_rows(
    rows: Sequence[ConstraintRow],
    timestep: float,
    gravity: float,
    speeds: tuple[float, float],
    train: LongestTrain | None = None,
) -> Bounces:
    """Simulate a ball on contact rows, in hcbench's own model of MuJoCo's step: single impacts at
    many speeds and phases, and drops from HEIGHTS.

    timestep: s.
    gravity: m/s²; for 0 the single impacts alone.
    speeds: lowest and highest of the band, m/s, above 0. Single impacts go from _SLOW times the
    lowest up to the highest, and to the speed of the highest drop if that is faster.
    train: the longest train of bounces that the target allows; None: none goes on.
    """
    low, high = speeds
    fastest = max(high, math.sqrt(2.0 * gravity * HEIGHTS[-1]))
    grid = np.geomspace(_SLOW * low, fastest, _SPEEDS)
    phases = (np.arange(_PHASES) + 0.5) / _PHASES
    # Each speed at each phase, phases of one speed after another.
    speed = np.repeat(grid, _PHASES)
    phase = np.tile(phases, _SPEEDS)
    drops = _Drops(rows, timestep, gravity)
    single = drops.run(drops.touching(speed, phase), is_single=True)
    impacts = Bounces(single.max_e, single.gains_below, still_bouncing=0, tried=speed.size)
    if gravity == 0.0:
        return impacts
    dropped = drops.run(drops.from_rest(np.array(HEIGHTS)), is_single=False)
    bouncing = 0
    # The target's own trains take longer to compute than the drops, and most drops rest.
    if dropped.rebounds.any():
        allowed = allowed_rebounds(train, HEIGHTS, gravity)
        bouncing = int((dropped.rebounds > allowed).sum())
    of_drops = Bounces(dropped.max_e, dropped.gains_below, bouncing, tried=len(HEIGHTS))
    return impacts.joined(of_drops)


class _DropBounces(NamedTuple):
    """Bounces of n drops.

    max_e: the largest e.
    gains_below: speed of the fastest touch that gained energy, m/s; 0 where none did.
    rebounds: speed of the bounce under way at the end, m/s, (n,); 0 of a drop that rests.
    """

    max_e: float
    gains_below: float
    rebounds: Floats


class _Drops:
    """Balls over a plate, each with a clock of its own, under Euler's steps of a setting's rows.

    timestep: s.
    gravity: m/s².
    Penetration x, m, is above 0 in contact, its rate v, m/s, on approach; flights are advanced in
    closed form.
    """

    def __init__(self, rows: Sequence[ConstraintRow], timestep: float, gravity: float) -> None:
        self._rows = rows
        self._h = timestep
        self._g = gravity

    def touching(self, speeds: Floats, phases: Floats) -> Floats:
        """States of drops in their first step in contact, (3, n): penetration, m, rate, m/s, and
        speed at touch, m/s.

        speeds: at touch, m/s, (n,).
        phases: where in a step each touches, 0 to 1, (n,).
        """
        time = self._h * (1.0 - phases)
        x = speeds * time + self._g * time**2 / 2.0
        return np.stack([x, speeds + self._g * (time - self._h / 2.0), speeds])

    def from_rest(self, heights: Floats) -> Floats:
        """States of drops that fall from these heights, m."""
        at_rest = np.zeros(len(heights))
        x, v, _ = self._flown(-heights, at_rest)
        return np.stack([x, v, self._kept(-heights, at_rest)])

    def _kept(self, x: Floats, v: Floats) -> Floats:
        """Speed at the touch plane of a flight, m/s."""
        squared = (v + self._g * self._h / 2.0) ** 2 - 2.0 * self._g * x
        return np.asarray(np.sqrt(np.maximum(0.0, squared)))

    def _flown(self, x: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """Advance drops in flight to their first state in contact, in closed form: penetration x, m,
        rate v, m/s, and the duration of the flight, s, (n,) each.

        x, v: at the flight's start, m and m/s, (n,).
        """
        g = self._g
        h = self._h
        half = v + g * h / 2.0
        steps = np.floor((-half + np.sqrt(half**2 - 2.0 * g * x)) / (g * h)) + 1.0
        fallen = x + steps * h * half + g * h**2 * steps**2 / 2.0
        return fallen, v + g * h * steps, steps * h

    def run(self, states: Floats, is_single: bool) -> _DropBounces:
        """Simulate until each drop has rested, or LASTS (s) are over, and look at its bounces.

        states: penetration, m, its rate, m/s, and the speed at the last touch, m/s, (3, n);
        changed.
        is_single: true where each drop ends with its first rebound.
        """
        library = _library()
        if library is None or len(self._rows) > _MOST_ROWS:
            return self._run_by_arrays(states, is_single)
        rows = (_Row * len(self._rows))(*map(_Row.of, self._rows))
        goal = _DropGoal.of(self._h, self._g, len(self._rows), is_single)
        rebounds = np.empty(states.shape[1])
        extremes = np.empty(2)
        arrays = [array.ctypes.data for array in (*states, rebounds, extremes)]
        library.run_drops(ctypes.byref(goal), rows, states.shape[1], *arrays)
        max_e, gains_below = extremes.tolist()
        return _DropBounces(max_e, gains_below, rebounds)

    def _run_by_arrays(self, states: Floats, is_single: bool) -> _DropBounces:
        """Simulate drops until each has rested, or for LASTS s, without the compiled library: a step of
        all drops after the other.

        states: penetration, m, its rate, m/s, and the speed at the last touch, m/s, (3, n).
        is_single: true where each drop ends with its first rebound.
        """
        count = states.shape[1]
        max_e = 0.0
        gains_below = 0.0
        rebounds = np.zeros(count)
        # Of those under way: index among all; state, time, and steps since the last flight.
        number = np.arange(count)
        states = np.concatenate([states, np.zeros((2, count))])
        x, v, speed_in, clock, still = states
        for _ in range(_MOST_STEPS):
            v -= self._h * acceleration(self._rows, x, v, self._g)
            x += self._h * v
            clock += self._h
            still += 1.0
            parted = np.flatnonzero((x <= 0.0) & (v < 0.0))
            if parted.size:
                speed_out = self._kept(x[parted], v[parted])
                came = speed_in[parted]
                e = speed_out / came
                max_e = max(max_e, float(e.max()))
                gains_below = max(gains_below, float(came[e > MOST_E].max(initial=0.0)))
                if is_single:
                    clock[parted] = math.inf
                else:
                    # The next touch is as fast: flight keeps the energy.
                    speed_in[parted] = speed_out
                    still[parted] = 0.0
                    x[parted], v[parted], lasts = self._flown(x[parted], v[parted])
                    clock[parted] += lasts
            going = (clock <= LASTS) & (still < _RESTED)
            if not going.all():
                bounces_on = np.isfinite(clock) & (clock > LASTS)
                rebounds[number[bounces_on]] = speed_in[bounces_on]
                number = number[going]
                states = states[:, going]
                x, v, speed_in, clock, still = states
                if not states.size:
                    break
        return _DropBounces(max_e, gains_below, rebounds)


class _Row(ctypes.Structure):
    """`Row` of drops.c, which says what its fields are."""

    _names = "onset d0 dw width midpoint power early late stiffness squared damping may_pull"
    _fields_ = tuple((name, ctypes.c_double) for name in _names.split())

    @classmethod
    def of(cls, row: ConstraintRow) -> _Row:
        """The numbers of a row for C, combined in the same order as in `acceleration`, so that both
        round alike.
        """
        d0, dw, width, midpoint, power = row.solimp
        return cls(
            onset=row.onset,
            d0=d0,
            dw=dw,
            width=width,
            midpoint=midpoint,
            power=power,
            early=midpoint ** (power - 1.0),
            late=(1.0 - midpoint) ** (power - 1.0),
            stiffness=row.stiffness,
            squared=dw**2,
            damping=row.damping / dw,
            may_pull=row.adhesion != 0.0,
        )


class _DropGoal(ctypes.Structure):
    """`Goal` of drops.c, which says what its fields are."""

    _names = "h g half_gain twice_g gain fall most_e lasts rested"
    _fields_ = (
        *((name, ctypes.c_double) for name in _names.split()),
        ("rows", ctypes.c_int),
        ("most_steps", ctypes.c_int),
        ("is_single", ctypes.c_int),
    )

    @classmethod
    def of(cls, h: float, g: float, rows: int, is_single: bool) -> _DropGoal:
        """Constants of drops for C.

        h: time step, s.
        g: gravity, m/s².
        rows: their number.
        is_single: each drop ends with its first rebound.
        """
        return cls(
            h=h,
            g=g,
            half_gain=g * h / 2.0,
            twice_g=2.0 * g,
            gain=g * h,
            fall=g * h**2,
            most_e=MOST_E,
            lasts=LASTS,
            rested=_RESTED,
            rows=rows,
            most_steps=_MOST_STEPS,
            is_single=is_single,
        )


@cache
def _library() -> ctypes.CDLL | None:
    """Compile and load the loop of drops in C; None where that cannot be done."""
    try:
        library = ctypes.CDLL(str(build("engines/mujoco/passivity/drops.c")))
    # Without a compiler or on a full disk NumPy does it.
    except (HcbenchError, OSError):
        return None
    pointer = ctypes.c_void_p
    library.run_drops.argtypes = [pointer, pointer, ctypes.c_int, *[pointer] * 5]
    library.run_drops.restype = None
    return library


# A contact that is not tuned, beside the setting: the slope, rad, and time, s, of a ball at rest on
# it, and the ball's radius, m.
_OTHERS_SLOPE = math.radians(10.0)
_OTHERS_S = 1.0
_RADIUS = 0.05
# Its oblique impact: speeds along the normal and along the plane, m/s, at so many phases.
_SPEED = 1.0
_SLIP = 0.5
_LAUNCHES = 8


def effect_on_others(option: Mapping[str, str], timestep: float, gravity: float) -> str:
    """A sentence on what a setting's options of the whole model do to other contacts: drift, solver
    iterations and e of one, with MuJoCo's default cone and with the options.

    option: attributes of the setting's <option>, such as cone and impratio.
    timestep: s.
    gravity: m/s².
    """
    before = (("cone", "pyramidal"),)
    after = tuple(sorted(option.items()))
    with captured_warnings():
        own = _untuned_contact(before, timestep, gravity)
        now = _untuned_contact(after, timestep, gravity)
    change = max(abs(a - b) for a, b in zip(own.e, now.e, strict=True))
    return (
        "Other contacts of the model: "
        f"drift on 10 degrees {own.drift:.2g} -> {now.drift:.2g} mm/s, "
        f"solver iterations {own.iterations:.2g} -> {now.iterations:.2g}, "
        f"e changes by at most {change:.2g}."
    )


class _UntunedContact(NamedTuple):
    """Motion of a ball in a contact that is not tuned.

    drift: down a slope, mm/s.
    iterations: of the solver, in a step there.
    e: of oblique impacts, one at each of _LAUNCHES phases of a step.
    """

    drift: float
    iterations: float
    e: list[float]


# An answer judges several settings of one step: all have MuJoCo's defaults before, most the same
# options after.
@lru_cache(maxsize=4)
def _untuned_contact(
    option: tuple[tuple[str, str], ...], timestep: float, gravity: float
) -> _UntunedContact:
    """Simulate a ball in a contact that is not tuned: at rest on a slope, then in oblique impacts.

    option: attributes of <option>.
    timestep: s.
    gravity: m/s².
    """
    mujoco = backend()
    attributes = dict(option)
    model = _untuned_ball(attributes, timestep, gravity, "0.02 1")
    model.opt.gravity[:] = gravity * np.array(
        [math.sin(_OTHERS_SLOPE), 0.0, -math.cos(_OTHERS_SLOPE)]
    )
    data = mujoco.MjData(model)
    iterations = 0
    half = 0.0
    steps = round(_OTHERS_S / timestep)
    # Views of what a step changes: looked up anew, they would take as long as it.
    place = data.qpos
    count = data.solver_niter
    for step in range(steps):
        if step == steps // 2:
            half = float(place[0])
        mujoco.mj_step(model, data)
        iterations += int(count[0])
    drift = 1e3 * (float(place[0]) - half) / (_OTHERS_S / 2)
    bouncing = _untuned_ball(attributes, timestep, gravity, "0.02 0.2")
    e = [_untuned_e(bouncing, i / _LAUNCHES) for i in range(_LAUNCHES)]
    return _UntunedContact(drift, iterations / steps, e)


def _untuned_ball(option: Mapping[str, str], timestep: float, gravity: float, solref: str) -> Any:
    """Compiled model of a ball of 1 kg that may not turn, on a plane, in a contact by this solref.

    option: attributes of <option>.
    timestep: s.
    gravity: m/s², down.
    """
    slides = ""
    for axis in ("1 0 0", "0 1 0", "0 0 1"):
        slides += f'<joint type="slide" axis="{axis}"/>'
    options = " ".join(f'{key}="{value}"' for key, value in option.items())
    return backend().MjModel.from_xml_string(
        f'<mujoco><option timestep="{timestep!r}" gravity="0 0 {-gravity!r}" {options}/>'
        f'<default><geom solref="{solref}" friction="0.5"/></default><worldbody>'
        f'<geom type="plane" size="9 9 1"/><body pos="0 0 {_RADIUS}">{slides}'
        f'<geom size="{_RADIUS}" mass="1"/></body></worldbody></mujoco>'
    )


def _untuned_e(model: Any, phase: float) -> float:
    """e of an impact of a ball that slides, 0 where the ball stays down: the speed after the first
    step that ends above the plane on the way up, over the speed at launch.

    model: compiled, of the ball.
    phase: where in a step it touches, 0 to 1.
    """
    mujoco = backend()
    data = mujoco.MjData(model)
    step = model.opt.timestep
    data.qpos[2] = (1.0 + phase) * step * _SPEED
    data.qvel[0] = _SLIP
    data.qvel[2] = -_SPEED
    place = data.qpos
    motion = data.qvel
    for _ in range(round(0.3 / step)):
        mujoco.mj_step(model, data)
        rate_up = float(motion[2])
        if rate_up > 0.0 and place[2] > 0.0:
            return rate_up / _SPEED
    return 0.0


# A free ball takes the same steps under each of them.
_LIKE_EULER = ("Euler", "implicit", "implicitfast")
# Time step, s, below which a slope takes too long for a screen.
_FINEST = 2e-4
_SOLVERS = ("Newton", "CG", "PGS")
_CONES = ("elliptic", "pyramidal")


def screened(
    scene: Scene, setting: Setting, speeds: tuple[float, float], train: LongestTrain | None = None
) -> Passivity | None:
    """Test in about a tenth of a second whether a setting adds energy: bounces and drops in hcbench's
    own model of its rows, and what slides in plain MuJoCo.

    speeds: lowest and highest of the band, m/s.
    train: the longest train of bounces that the target allows; None: none.

    None for a setting without rows, in a cup, or under RK4 or discrete, which the model of rows
    cannot step.
    Raises SettingError for an option that MuJoCo does not have.
    """
    if not _is_screened(scene, setting):
        return None
    options = read_options(setting.options)
    bounces = bounces_in_rows(options.all_rows, setting.timestep, scene.gravity, speeds, train)
    passivity = _with_sliding(scene, setting, Passivity(bounces))
    if not scene.gravity:
        return passivity
    contact, runs = tried(scene, setting)
    drift = math.nan
    if any(row.friction for row in options.rows) and setting.timestep >= _FINEST:
        drift = rest_on_slope(contact, runs[0]).drift
    others = ""
    if options.impratio:
        others = effect_on_others(contact.option, setting.timestep, scene.gravity)
    return replace(passivity, slope_drift=drift, others=others)


def with_law(scene: Scene, setting: Setting, passivity: Passivity) -> Passivity:
    """The passivity of a setting, with what slides under its restitution law; as it is for other
    laws.
    """
    if not _is_restitution_law(scene, setting):
        return passivity
    return _with_sliding(scene, setting, passivity)


def _with_sliding(scene: Scene, setting: Setting, passivity: Passivity) -> Passivity:
    """Add to a passivity the findings of a ball that slides, spins and rolls, in plain MuJoCo; it is
    returned as it is for a scene without friction.
    """
    if not scene.friction:
        return passivity
    contact, runs = tried(scene, setting)
    # A plug-in warns of bodies that turn far in a step: these are ours, and judged.
    with captured_warnings():
        return replace(passivity, sliding=tuple(ball_slides(contact, runs[0])))


def with_boxes(
    scene: Scene, setting: Setting, passivity: Passivity, whole: bool = False
) -> Passivity:
    """Add to a passivity the findings of boxes and a capsule, in plain MuJoCo: of boxes that fall
    under the scene's gravity, and, with friction, of bodies that slide and spin; up to the first
    that fails.

    whole: all findings, also after one that fails.
    It is returned as it is for a setting with neither rows nor a restitution law, in a cup, and
    under RK4 or discrete without such a law.
    """
    if not (_is_screened(scene, setting) or _is_restitution_law(scene, setting)):
        return passivity
    contact, runs = tried(scene, setting)
    flat: list[Finding] = []
    tests: Iterable[Finding] = ()
    if scene.gravity:
        tests = boxes(contact, runs[0])
    if scene.friction:
        tests = chain(tests, boxes_slide(contact, runs[0]))
    with captured_warnings():
        # Each test is run as it is asked for.
        for finding in tests:
            flat.append(finding)
            if not (finding.passed or whole):
                break
    is_flat = all(finding.passed for finding in flat) if flat else None
    return replace(passivity, flat=is_flat, boxes=tuple(flat))


def _is_screened(scene: Scene, setting: Setting) -> bool:
    """Say whether the model of rows steps a setting: it has rows, on a plane, as Euler steps."""
    options = read_options(setting.options)
    is_like_euler = (options.integrator or "Euler") in _LIKE_EULER
    return bool(options.rows) and scene.form == "plane" and is_like_euler


def _is_restitution_law(scene: Scene, setting: Setting) -> bool:
    law = read_options(setting.options).law
    return law is not None and not is_force(law) and scene.form == "plane"


def certified(
    scene: Scene, setting: Setting, train: LongestTrain | None = None
) -> Passivity | None:
    """Run all tests of energy and rest for a setting in plain MuJoCo, under every integrator, cone
    and solver that it allows; minutes.

    train: the longest train of bounces that the target allows; None: none.
    None for a setting with neither rows nor a restitution law, and in a cup.
    Raises SettingError for an option that MuJoCo does not have.
    """
    options = read_options(setting.options)
    is_rows = bool(options.rows) and scene.form == "plane"
    if not is_rows and not _is_restitution_law(scene, setting):
        return None
    contact, runs = tried(scene, setting)
    with captured_warnings():
        return certify(contact, any(row.friction for row in options.rows), runs, train)


def _pasted(options: Options, pairs: Sequence[Pair]) -> str:
    """The MJCF that a user pastes for some pairs: <contact> of rows, or a law's plug-in instances.

    A law's plug-in is loaded, so that MuJoCo can compile it.
    Raises CannotRun without a C compiler.
    """
    if options.law is None:
        lines = ""
        for pair in pairs:
            lines += pairs_text(options.rows, pair)
        return f"<contact>{lines}</contact>"
    from hcbench.engines.mujoco import plugin

    plugin.load()
    return plugin.law_instances(options.law, pairs)


def tried(scene: Scene, setting: Setting) -> tuple[Contact, list[Stepping]]:
    """The contact of a setting to try in plain models, and the options to try it under: the
    setting's own, then some that differ from them in the integrator, the cone or the solver.

    A cone that the setting names is kept.
    Raises SettingError for an option that MuJoCo does not have.
    """
    options = read_options(setting.options)
    written = options.attributes(repr)
    integrator = written.pop("integrator", "Euler")
    contact = Contact(
        timestep=setting.timestep,
        gravity=scene.gravity or STANDARD_GRAVITY,
        option=written,
        text=partial(_pasted, options),
        radius=scene.touch_radius,
        falls=scene.gravity,
        friction=scene.friction,
    )
    cones: tuple[str, ...] = _CONES
    if options.cone:
        cones = (options.cone,)
    # The setting's own comes first; each of the others differs from it in one option.
    runs = [Stepping(integrator, cones[0])]
    if integrator in _LIKE_EULER:
        for other in _LIKE_EULER:
            if other != integrator:
                run = Stepping(other, cones[0])
                runs.append(run)
    runs += [Stepping(integrator, cone) for cone in cones[1:]]
    runs += [Stepping(integrator, cones[0], solver) for solver in _SOLVERS[1:]]
    return contact, runs
