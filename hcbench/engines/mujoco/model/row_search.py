"""Searches two contact rows in the user's own model, by MuJoCo's rollouts of many launches.

A stiff row, of an impedance near 1, sets the acceleration of its contact, regardless of servos and
springs of the robot, other corners of the body and estimates of its mass. But it leaves gravity out
from the step on that finds the touch. A soft one adds a force to all of them. The search finds what
lies between, with a damper whose impedance grows with depth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import integrator_name
from hcbench.engines.mujoco.recipes.row_pair import (
    COSTS,
    LARGEST_E,
    MOST_PULL,
    POWER,
    oscillator,
    short,
)
from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.recipes.recipe import evolve

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.columns import Whole
    from hcbench.sim.rest import Standing
    from hcbench.terms.impact import Floats

    Rows = tuple[ConstraintRow, ...]


# Steps of a launch: two to the touch, then a contact and its parting.
_STEPS = 30
# Speeds and phases of a small model, and of a large one.
_GRID_SMALL = (4, 9)
_GRID_LARGE = (3, 6)
# The launches go in parts, and most rows fail in the first. A large model's step takes so long that
# many calls cost less than launches of rows that have failed.
_PARTS = 3
_PARTS_LARGE = 11
# Impacts at this share of the lowest speed, at so many phases, may not gain energy.
_SLOW = 0.4
_SLOW_PHASES = 4
# Steps that a body is laid down for. The vibration of the last of them is compared with that of as
# many before, and taken to fall on by the same share so many times more.
_LAID = 200
_LAST = 50
_LATER = 20
# Vibration at rest that costs nothing, m/s; a power of ten above it costs so much of e.
_CALM = 1e-5
_RESTLESS = 0.05
# Depth at rest that costs nothing, m.
_SHALLOW = 8e-5
# Of the evolution: one seed, so that the same model always gets the same rows; and its members.
_SEED = 1
_MEMBERS = 16
# Degrees of freedom of the largest model that counts as light. A heavy one's launches take so long
# that it has a third of the generations; one that actuators drive has half, as its whole landing is
# judged besides.
_LIGHT = 12
_GENERATIONS = 50
_GENERATIONS_DRIVEN = 25
_GENERATIONS_LARGE = 16
# Half period in steps; logs of its loss a step, odds of its impedance; log of D h, odds of dmax,
# logs of width over v h and midpoint of the damper.
_LOWEST = np.array([1.5, -6.0, -4.0, *np.log([0.05, 1e-4, 0.1, 3e-3])])
_HIGHEST = np.array([16.0, -0.1, 9.0, *np.log([5.0, 1e4, 20.0, 0.5])])
# What long searches found for e from 0.1 to 0.9 and for α, of a cube on face,
# edge and vertex; and for legs.
_STARTS = np.array([
    [11.7, -0.55, 2.17, -2.18, 2.36, -0.49, -1.36],
    [11.95, -1.08, -0.95, -1.60, 0.51, -1.81, -1.43],
    [13.6, -1.10, -1.06, -1.74, -7.68, 1.40, -5.81],
    [12.9, -3.01, -0.48, -0.76, 2.41, 1.00, -5.23],
    [6.27, -2.42, 3.92, -2.45, 8.37, -2.06, -2.92],
    [8.65, -2.92, 9.00, -2.99, 6.44, 2.13, -2.17],
    [6.84, -3.39, 2.82, -3.00, 8.52, 1.69, -4.93],
    [8.81, -3.28, 5.10, -1.39, -3.93, 1.87, -3.20],
    [9.64, -3.50, 8.98, -2.98, -1.52, 2.84, -2.34],
    [8.28, -1.60, 2.87, -1.80, 2.79, -2.19, -4.65],
    [7.10, -1.50, 1.90, -1.40, -3.90, -1.50, -4.30],
])  # fmt: skip
_LEGS = np.array([
    [3.20, -1.36, 2.57, 0.07, -2.41, 1.20, -5.48],
    [6.30, -2.02, 2.70, -1.20, -4.00, -0.69, -3.00],
])  # fmt: skip
# The servos of legs ask for stiffer rows.
_LEGS_LOWEST = np.array([1.5, -6.0, 0.0, *_LOWEST[3:]])


def starting_rows(adhesive: bool) -> Rows:
    """A spring row and a damper row, of the kind that is searched for, before any are found.

    adhesive: whether the damper may pull.
    Their numbers are middling ones: they only hold other feet up while the rows of one kind of foot
    are searched.
    """
    return (
        ConstraintRow.direct(2e4, 100.0, (0.999, 0.999, 1.0, 0.5, 1.0)),
        _damper(100.0, (0.9, 2e-3, 0.01), adhesive),
    )


def _damper(damping: float, impedance: tuple[float, float, float], adhesive: bool) -> ConstraintRow:
    """A contact row that only damps, and the more the deeper the two bodies are.

    damping: per unit mass, 1/s.
    impedance: its highest value, the depth at which it is reached (m), and the midpoint, three
    numbers of solimp; at touch it is MuJoCo's least.
    adhesive: whether the row may pull.
    """
    solimp = (MIN_IMPEDANCE, *impedance, POWER)
    adhesion = 0.0
    if adhesive:
        adhesion = MOST_PULL
    return ConstraintRow.direct(0.0, damping, solimp, adhesion=adhesion)


class RowSearch:
    """Searches for the two rows of one kind of pair, by launches in the user's model.

    spec: MjSpec of the model with rows in it; sensors are added to it.
    opened: the model under each launch's attitude, which say where a launch begins.
    goal: e over speed.
    band: lowest and highest impact speed, m/s.
    was: vibration and depth of the model at rest before; rows need not be better.
    set_rows: writes rows into the pairs of a compiled model.
    """

    def __init__(
        self,
        spec: Any,
        opened: Sequence[MujocoModel],
        goal: RestitutionCurve,
        band: tuple[float, float],
        was: Standing,
        set_rows: Callable[[Any, Rows], None],
    ) -> None:
        """Compile the model with sensors, and lay out the launches that each try takes.

        spec: MjSpec with rows in it, to which sensors are added.
        opened: the model under each attitude.
        goal: e over speed.
        band: lowest and highest impact speed, m/s.
        was: the model at rest before.
        set_rows: writes rows into the pairs of a compiled model.
        """
        sensor_of = _add_distance_sensors(spec, opened)
        self._opened = opened
        self._goal = goal
        self._band = band
        self._set_rows = set_rows
        self._model = spec.compile()
        for name in ("timestep", "gravity", "disableflags"):
            setattr(self._model.opt, name, getattr(opened[0].model.opt, name))
        # One for each member of a generation.
        self._models = [self._model.__copy__() for _ in range(_MEMBERS)]
        self._data = backend().MjData(self._model)
        first_sensor = self._model.nsensordata - len(set(sensor_of))
        self._sensors = [first_sensor + number for number in sensor_of]
        # A stage of RK4 feels the contact in the step before and after the states that are in it.
        self._lag = int(integrator_name(self._model) == "RK4")
        # A model that already vibrates or sinks more than our limits need
        # not do better than before.
        self._calm = max(_CALM, float(np.nan_to_num(was.vibration)))
        self._shallow = max(_SHALLOW, float(np.nan_to_num(was.penetration)))

        is_large = self._model.nv > _LIGHT
        plan = _speeds_and_phases(band, is_large)
        starts = [self._start_states(model, plan) for model in opened]
        # Of each part of the launches: the index in `opened`, the states at release, (n, nstate),
        # and the controls, (nu,). A part of every model's launches, then the next part: bad rows
        # are given up after the first.
        self._launches = []
        # A part has one launch at least: a band of one speed has few.
        parts = min(_PARTS_LARGE if is_large else _PARTS, len(plan))
        for part in range(parts):
            for number, (states, control) in enumerate(starts):
                self._launches.append((number, states[part::parts], control))
        # The pair at touch and at rest, under each attitude.
        self._laid = [self._start_states(model, [(0.0, 0.0)]) for model in opened]

    def _start_states(
        self, opened: MujocoModel, plan: Sequence[tuple[float, float]]
    ) -> tuple[Floats, Floats]:
        """States of the model at the release of each launch, MuJoCo's full ones, (n, nstate), and
        the controls, (nu,).

        opened: the model at touch in one attitude.
        plan: speed, m/s, and phase (where in a step it touches, 0 to 1) of each of the n launches.

        Also puts the controls and the like of `opened` into `_data`, where rollouts look for them.
        """
        mujoco = backend()
        model = self._model
        place = opened.place
        h = float(model.opt.timestep)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        data = mujoco.MjData(model)
        states = np.empty((len(plan), mujoco.mj_stateSize(model, kind)))
        for field in ("ctrl", "act", "mocap_pos", "mocap_quat", "eq_active"):
            getattr(data, field)[:] = getattr(opened.start, field)
            # Rollouts take from here what the states leave out; of several
            # models the last one's stays.
            getattr(self._data, field)[:] = getattr(opened.start, field)
        for state, (speed, phase) in zip(states, plan, strict=True):
            data.qpos[:] = place.qpos
            # One and a half steps, and the phase, before the touch.
            mujoco.mj_integratePos(model, data.qpos, place.direction, -speed * h * (1.5 + phase))
            data.qvel[:] = speed * place.direction
            mujoco.mj_getState(model, data, state, kind)
        return states, data.ctrl.copy()

    def _errors(self, generation: Sequence[Rows], limits: Floats) -> Floats:
        """Cost of each pair of rows, (n,), in units of e: the largest error of e in any launch, plus
        costs of an e that is too large and of vibration and depth at rest.

        generation: n pairs of rows, up to _MEMBERS. All launches of one part go into one rollout: a
        call for each would take as long as the steps of a small model.
        limits: costs above which rows are given up, (n,); the number returned is then above its
        limit, but not the whole cost.
        Raises MuJoCo's FatalError.
        """
        # A generation may have fewer members than there are models.
        for model, rows in zip(self._models, generation, strict=False):
            self._set_rows(model, rows)
        cost = np.zeros(len(generation))
        largest_e = np.zeros(len(generation))
        largest_target = np.zeros(len(generation))
        for number, states, control in self._launches:
            tried = np.flatnonzero(cost <= limits)
            e, speed = self._bounces(tried, number, states, control)  # (tried, launches)
            # Launches at the band's lowest speed arrive a little slower or faster; the ones that
            # only may not gain energy are at less than half of it.
            in_band = speed > 0.9 * self._band[0]
            target = np.zeros(speed.shape)
            target[in_band] = self._goal.at(speed[in_band])
            errors = np.where(in_band, np.abs(e - target), 0.0)
            cost[tried] = np.maximum(cost[tried], errors.max(axis=1))
            largest_e[tried] = np.maximum(largest_e[tried], e.max(axis=1))
            largest_target[tried] = np.maximum(largest_target[tried], target.max(axis=1))
        tried = np.flatnonzero(cost <= limits)
        # An e above this counts as a gain of energy, in slow launches too.
        most = np.maximum(LARGEST_E, largest_target[tried])
        cost[tried] += COSTS * np.maximum(0.0, largest_e[tried] - most)
        tried = np.flatnonzero(cost <= limits)
        cost[tried] += self._unrest(tried)
        return cost

    def _unrest(self, tried: Whole) -> Floats:
        """Cost of how the pairs rest with the rows of some members, (m,), in units of e: it grows by
        _RESTLESS for each power of ten of vibration above `_calm` and of depth above `_shallow`.

        tried: indices of the members, (m,).
        Vibration (m/s; infinite where the state diverged) and depth (m) are those a while after the
        bodies were laid down, the largest of all pairs.
        """
        largest_vibration = np.zeros(len(tried))
        largest_depth = np.zeros(len(tried))
        h = float(self._model.opt.timestep)
        for number, (states, control) in enumerate(self._laid):
            # A pair is laid down once: the launch 0 is the only one.
            depths = self._depths(tried, number, states, control, _LAID)[:, 0]
            for k, depth in enumerate(depths):
                last_depth = float(np.nan_to_num(depth[-_LAST:].mean()))
                largest_depth[k] = max(largest_depth[k], last_depth)
                vibration = _later_vibration(np.diff(depth) / h)
                largest_vibration[k] = max(largest_vibration[k], vibration)
        costs = np.empty(len(tried))
        for k in range(len(tried)):
            shaking = math.log10(max(1.0, float(largest_vibration[k]) / self._calm))
            sinking = math.log10(max(1.0, float(largest_depth[k]) / self._shallow))
            costs[k] = _RESTLESS * (shaking + sinking)
        return costs

    def _bounces(
        self, tried: Whole, number: int, states: Floats, control: Floats
    ) -> tuple[Floats, Floats]:
        """Simulate launches with the rows of each member: e, (m, n), and impact speed, m/s, (m, n).

        tried: indices of the members, (m,).
        number: index of the opened model whose pair is read.
        states: at release, one row for each of n launches.
        control: (nu,).

        Speeds are those at the touch plane, of the parabola of free flight through three states, 0
        where it does not reach the plane. e is 0 for a launch that does not part, also where its
        states are NaN from within the contact on, and COSTS where a state next to the touch or to
        the parting is NaN.
        """
        # Penetration after each step, m, of all launches of all members, one below the other.
        x = self._depths(tried, number, states, control, _STEPS).reshape(-1, _STEPS)
        inside = np.nan_to_num(x, nan=1.0) > 0.0
        launches = np.arange(len(x))
        # The first state inside, and the last one inside before the first parting; three states
        # around each have to be on record.
        first = np.clip(inside.argmax(axis=1) - self._lag, 2, _STEPS - 3)
        parted = inside[:, :-1] & ~inside[:, 1:]
        last = np.clip(parted.argmax(axis=1) + self._lag, 0, _STEPS - 3)
        # Speeds in and out, m a step.
        into = _crossing_speed(x[launches, first - 2], x[launches, first - 1], x[launches, first])
        out = _crossing_speed(x[launches, last], x[launches, last + 1], x[launches, last + 2])
        # A parabola that does not reach the touch plane has a speed of 0.
        e = np.where(parted.any(axis=1), out / np.maximum(into, 1e-12), 0.0)
        e = np.nan_to_num(e, nan=COSTS)
        speed = into / float(self._model.opt.timestep)
        # Not (-1, n): there may be no member left.
        shape = (len(tried), len(states))
        return e.reshape(shape), speed.reshape(shape)

    def _depths(
        self, tried: Whole, number: int, states: Floats, control: Floats, steps: int
    ) -> Floats:
        """Simulate launches with the rows of each member: penetration of the pair of one opened model
        after each step, m, (m, n, steps).

        tried: indices of the members, (m,).
        number: index of the opened model.
        states: at release, one row for each of n launches.
        control: for all steps, (nu,).
        """
        if len(tried) == 0:
            return np.empty((0, len(states), steps))
        # Each member's model once for each of its launches: all are stepped in one call.
        models = [self._models[member] for member in tried for _ in states]
        controls = None
        if control.size:
            controls = np.tile(control, (len(models), steps, 1))
        rollout = backend().rollout.rollout
        # Sensors after each step, (m n, steps, sensors); the states are not looked at.
        _, sensors = rollout(
            models, [self._data], np.tile(states, (len(tried), 1)), controls, nstep=steps
        )
        onset = self._opened[number].place.contact.onset
        depths = onset - sensors[:, :, self._sensors[number]]
        return np.asarray(depths).reshape(len(tried), len(states), steps)

    def rows(self, parameters: Floats, adhesive: bool) -> Rows:
        """The two rows, a spring and a damper, that a point of the search stands for.

        parameters: (7,). Of the spring its half period in steps, and logarithms of its loss a step
        and of the odds d/(1 - d) of its impedance; of the damper logarithms of its damping times h,
        the odds of its impedance, the width of solimp over v h, v the band's highest speed, and its
        midpoint.
        adhesive: whether the damper may pull. Numbers have the digits that are written into the
        model: what is tried is what users paste.
        """
        half_period, log_loss, spring_odds, log_damping, damper_odds, log_width, log_midpoint = (
            parameters
        )
        h = float(self._model.opt.timestep)
        fastest = self._band[1]
        stiffness, loss = oscillator(half_period, math.exp(log_loss))
        d = short(1.0 / (1.0 + math.exp(-spring_odds)))
        dmax = short(1.0 / (1.0 + math.exp(-damper_odds)))
        # math.exp may differ in the last digit, and a search ends elsewhere by it.
        damping, width, midpoint = np.exp(np.array([log_damping, log_width, log_midpoint]))
        spring = ConstraintRow.direct(
            short(stiffness / h**2), short(loss / h), (d, d, 1.0, 0.5, 1.0)
        )
        impedance = (dmax, short(width * fastest * h), short(midpoint))
        return spring, _damper(short(damping / h), impedance, adhesive)

    def best(self, adhesive: bool) -> Rows:
        """Rows of the least cost that an evolution finds; the same for the same model.

        adhesive: whether the damper may pull.
        Raises EngineFailed for a fatal error of MuJoCo's.

        Members of the evolution are parameters of `rows`, (7,); it starts with those that long
        searches found in other models, and random ones.
        """

        def errors(members: Floats, limits: Floats) -> Floats:
            """Cost of each member, (n,); members: (n, 7); limits: above which one is given up, (n,)."""
            return self._errors([self.rows(member, adhesive) for member in members], limits)

        generations = _GENERATIONS_DRIVEN if self._model.nu else _GENERATIONS
        starts = _STARTS
        lowest = _LOWEST
        if self._model.nv > _LIGHT:
            generations = _GENERATIONS_LARGE
            starts = _LEGS
            lowest = _LEGS_LOWEST
        bounds = (lowest, _HIGHEST)
        random = np.random.default_rng(_SEED)
        first = random.uniform(*bounds, (_MEMBERS, len(_LOWEST)))
        first[: len(starts)] = starts
        with captured_warnings():
            # The members of the last generation, the best one first.
            members = evolve(errors, first, generations, bounds, random, towards_best=True)
            return self.rows(members[0], adhesive)


def _add_distance_sensors(spec: Any, opened: Sequence[MujocoModel]) -> list[int]:
    """Add a sensor to a spec for each two geoms that meet: their distance, m; return for each model
    the index of its sensor among these.

    spec: changed.
    opened: the models, each with its pair at touch. The sensors come last in the compiled model's
    sensor data, in the order of their indices. The attitudes of a pair share its sensor, which
    takes time in each step.
    """
    mujoco = backend()
    # In the order of their numbers.
    geom_names = [geom.name for geom in spec.geoms]
    geoms_of = [tuple(model.place.contact.geoms) for model in opened]
    # A dict keeps each pair of geoms once, in order.
    different = list(dict.fromkeys(geoms_of))
    for first, second in different:
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_GEOMDIST,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=geom_names[first],
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=geom_names[second],
            # MuJoCo reports this distance, m, for all that is farther apart.
            cutoff=10.0 * float(opened[0].model.stat.extent),
        )
    return [different.index(geoms) for geoms in geoms_of]


def _speeds_and_phases(band: tuple[float, float], is_large: bool) -> list[tuple[float, float]]:
    """Plan of the launches of a search: (speed, m/s; phase, where in a step it touches, 0 to 1) of
    each, over the band, then of some slower ones.

    band: lowest and highest impact speed, m/s.
    is_large: the model is slow, so fewer launches.
    """
    low, high = band
    count, phases = _GRID_SMALL
    if is_large:
        count, phases = _GRID_LARGE
    speeds = np.array([low])
    if low < high:
        speeds = np.geomspace(low, high, count)
    plan = []
    for k, speed in enumerate(speeds):
        # Each speed's phases lie between those of the others: few launches, no gap in phase.
        later = k / len(speeds)
        plan += [(speed, (i + later) / phases) for i in range(phases)]
    slow = _SLOW * low
    plan += [(slow, (i + 0.5) / _SLOW_PHASES) for i in range(_SLOW_PHASES)]
    return plan


def _later_vibration(rate: Floats) -> float:
    """Standard deviation of an approach rate long after a body was laid down, m/s; infinite where the
    rate is not finite.

    rate: in each step from the laying down on, m/s, (n,), n at least 2 _LAST.

    Vibration that decays is taken to go on so: the share that it lost from the last but one _LAST
    steps to the last _LAST, it loses _LATER times more.
    """
    before = np.std(rate[-2 * _LAST : -_LAST])
    last = np.std(rate[-_LAST:])
    left = 0.0  # share of the vibration that _LAST steps leave
    if before > 0.0:
        left = min(1.0, float(last / before))
    later = last * left**_LATER
    return float(np.nan_to_num(later, nan=math.inf))


def _crossing_speed(before: Floats, at: Floats, after: Floats) -> Floats:
    """Speed at which the parabola through three states, a step apart, crosses 0, in m a step; (n,).

    before, at, after: penetration in the three states, m, (n,). 0 where the parabola does not reach
    0, NaN where a state is NaN.
    """
    rate = (after - before) / 2
    bend = after - 2 * at + before
    return np.asarray(np.sqrt(np.maximum(0.0, rate**2 - 2 * bend * at)))
