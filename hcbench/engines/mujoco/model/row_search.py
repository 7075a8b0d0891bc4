"""Searches two contact rows in the user's own model, by MuJoCo's rollouts of many launches.

A stiff row, of an impedance near 1, sets the acceleration of its contact, regardless of servos and springs
of the robot, other corners of the body and estimates of its mass. But it leaves gravity out from the step on
that finds the touch. A soft one adds a force to all of them. The search finds what lies between, with a
damper whose impedance grows with depth.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.engines.mujoco.model.bodies import integrator_name
from hcbench.engines.mujoco.recipes.row_pair import MOST_PULL, oscillator, short
from hcbench.engines.mujoco.scene.rows import MIN_IMPEDANCE, ConstraintRow
from hcbench.recipes.search import evolve

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.impact import Floats
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.standing import Standing

    Rows = tuple[ConstraintRow, ...]

_STEPS = 30  # of a launch: two to the touch, then a contact and its parting
_GRID = (4, 9), (3, 6)  # speeds and phases, of small and of large models
_PARTS = 3  # of the launches: most rows fail in the first
_SLOW, _SLOW_PHASES = 0.4, 4  # of the lowest speed, where none may gain energy
_LARGEST_E, _COSTS = 0.995, 20.0  # as of `row_pair`
# Steps laid down; the last of them, whose vibration falls so many times more; m/s; of e a power of ten.
_LAID, _LAST, _LATER, _CALM, _RESTLESS = 200, 50, 20, 1e-5, 0.05
_SHALLOW = 8e-5  # m: a body at rest may lie so deep
_SEED, _MEMBERS = 1, 16
_LIGHT, _GENERATIONS = 12, (50, 16)  # up to so many degrees of freedom, and generations there and beyond
_POWER = 4.0
# Half period in steps; logs of its loss a step, odds of its impedance; log of D h, odds of dmax, logs of
# width over v h and midpoint of the damper.
_LOWEST = np.array([1.5, -6.0, -4.0, *np.log([0.05, 1e-4, 0.1, 3e-3])])
_HIGHEST = np.array([16.0, -0.1, 9.0, *np.log([5.0, 1e4, 20.0, 0.5])])
# What long searches found for e from 0.1 to 0.9 and for α, of a cube on face, edge and vertex; and for legs.
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
_LEGS_LOWEST = np.array([1.5, -6.0, 0.0, *_LOWEST[3:]])  # servos ask for stiffer rows


def starting_rows(adhesive: bool) -> Rows:
    """Rows of the kind that is searched for, before any are found. adhesive: whether they may pull."""
    return (
        ConstraintRow.direct(2e4, 100.0, (0.999, 0.999, 1.0, 0.5, 1.0)),
        _damper(100.0, (0.9, 2e-3, 0.01), adhesive),
    )


def _damper(damping: float, impedance: tuple[float, float, float], adhesive: bool) -> ConstraintRow:
    """A row of this damping (1/s) per unit mass. impedance: its highest, width (m) and midpoint."""
    solimp = (MIN_IMPEDANCE, *impedance, _POWER)
    return ConstraintRow.direct(0.0, damping, solimp, adhesion=MOST_PULL if adhesive else 0.0)


class RowSearch:
    """Launches in a model, and what rows do to their e.

    goal: e. band: m/s. was: the model before. set_rows: writes rows into the pairs of a compiled model.
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
        mujoco = backend()
        geom, kind = mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtSensor.mjSENS_GEOMDIST
        called = [geom.name for geom in spec.geoms]  # by id
        for model in opened:
            names = [called[geom] for geom in model.place.contact.rows[0][2]]
            each = {"objtype": geom, "objname": names[0], "reftype": geom, "refname": names[1]}
            spec.add_sensor(type=kind, cutoff=10.0 * float(model.model.stat.extent), **each)
        self._model = spec.compile()
        for name in ("timestep", "gravity", "disableflags"):
            setattr(self._model.opt, name, getattr(opened[0].model.opt, name))
        self._data, self._band, self._goal, self._set = mujoco.MjData(self._model), band, goal, set_rows
        # A stage of RK4 feels the contact in the step before and after the states that are in it.
        self._lag = int(integrator_name(self._model) == "RK4")
        self._calm = max(_CALM, float(np.nan_to_num(was.vibration)))
        self._shallow = max(_SHALLOW, float(np.nan_to_num(was.penetration)))
        self._opened, self._first = opened, self._model.nsensordata - len(opened)
        low, high = band
        count, phases = _GRID[self._model.nv > _LIGHT]
        speeds = np.geomspace(low, high, count) if low < high else np.array([low])
        sent = [(v, (i + k / len(speeds)) / phases) for k, v in enumerate(speeds) for i in range(phases)]
        sent += [(_SLOW * low, (i + 0.5) / _SLOW_PHASES) for i in range(_SLOW_PHASES)]
        every = [self._sent(model, sent) for model in opened]
        self._launches = [
            (number, states[part::_PARTS], control)
            for part in range(_PARTS)
            for number, (states, control) in enumerate(every)
        ]
        self._laid = [self._sent(model, [(0.0, 0.0)]) for model in opened]

    def _sent(self, opened: MujocoModel, sent: Sequence[tuple[float, float]]) -> tuple[Floats, Floats]:
        """(states, control) of launches: speed m/s, where in a step each touches."""
        mujoco, model, place = backend(), self._model, opened.place
        h, kind = float(model.opt.timestep), mujoco.mjtState.mjSTATE_FULLPHYSICS
        data, states = mujoco.MjData(model), np.empty((len(sent), mujoco.mj_stateSize(model, kind)))
        for field in ("ctrl", "act", "mocap_pos", "mocap_quat", "eq_active"):
            getattr(data, field)[:] = getattr(opened.start, field)
            getattr(self._data, field)[:] = getattr(opened.start, field)
        for state, (v, phase) in zip(states, sent, strict=True):
            data.qpos[:] = place.qpos
            mujoco.mj_integratePos(model, data.qpos, place.direction, -v * h * (1.5 + phase))
            data.qvel[:] = v * place.direction
            mujoco.mj_getState(model, data, state, kind)
        return states, data.ctrl.copy()

    def _error(self, rows: Rows, limit: float = math.inf) -> float:
        """The largest error of e, and much of what an e gains; above the limit any number that is."""
        self._set(self._model, rows)
        worst, largest, wanted = 0.0, 0.0, 0.0
        for number, states, control in self._launches:
            e, speed = self._bounces(number, states, control)
            band = speed > 0.9 * self._band[0]
            target = np.asarray(self._goal.at(speed[band]))
            worst = max(worst, float(np.abs(e[band] - target).max(initial=0.0)))
            if worst > limit:
                return worst
            largest, wanted = max(largest, float(e.max())), max(wanted, float(target.max(initial=0.0)))
        worst += _COSTS * max(0.0, largest - max(_LARGEST_E, wanted))
        if worst > limit:
            return worst
        vibration, depth = self._at_rest()
        restless = math.log10(max(1.0, vibration / self._calm)) + math.log10(max(1.0, depth / self._shallow))
        return worst + _RESTLESS * restless

    def _at_rest(self) -> tuple[float, float]:
        """(root mean square of the approach rates m/s, depth m) of the pairs a while after they were laid."""
        worst, deepest, h = 0.0, 0.0, float(self._model.opt.timestep)
        for number, (states, control) in enumerate(self._laid):
            depth = self._depths(number, states, control, _LAID)[0]
            rate, deepest = np.diff(depth) / h, max(deepest, float(np.nan_to_num(depth[-_LAST:].mean())))
            before, last = np.std(rate[-2 * _LAST : -_LAST]), np.std(rate[-_LAST:])
            calmed = min(1.0, last / before) if before > 0.0 else 0.0
            worst = max(worst, float(np.nan_to_num(last * calmed**_LATER, nan=math.inf)))
        return worst, deepest

    def _bounces(self, number: int, states: Floats, control: Floats) -> tuple[Floats, Floats]:
        """(e, impact speed m/s) at the touch plane, by the parabolas of free flight before and after."""
        x = self._depths(number, states, control, _STEPS)
        inside = np.nan_to_num(x, nan=1.0) > 0.0
        each, lag = np.arange(len(x)), self._lag
        first = np.clip(inside.argmax(axis=1) - lag, 2, _STEPS - 3)
        parted = inside[:, :-1] & ~inside[:, 1:]
        last = np.clip(parted.argmax(axis=1) + lag, 0, _STEPS - 3)
        into = _crossing_speed(*(x[each, first + i] for i in (-2, -1, 0)))
        out = _crossing_speed(*(x[each, last + i] for i in (0, 1, 2)))
        e = np.where(parted.any(axis=1), out / np.maximum(into, 1e-12), 0.0)
        return np.nan_to_num(e, nan=_COSTS), into / float(self._model.opt.timestep)

    def _depths(self, number: int, states: Floats, control: Floats, steps: int) -> Floats:
        """Penetration of a pair after each step, m; (n, steps)."""
        controls = np.tile(control, (len(states), steps, 1)) if control.size else None
        run = backend().rollout.rollout
        _, seen = run(self._model, [self._data], states, controls, nstep=steps)
        onset = self._opened[number].place.contact.onset
        return np.asarray(onset - seen[:, :, self._first + number])

    def rows(self, parameters: Floats, adhesive: bool) -> Rows:
        """Spring and damper of parameters (7,)."""
        h, high = float(self._model.opt.timestep), self._band[1]
        stiffness, loss = oscillator(parameters[0], math.exp(parameters[1]))
        d, dmax = (short(1.0 / (1.0 + math.exp(-parameters[i]))) for i in (2, 4))
        damping, width, midpoint = np.exp(parameters[[3, 5, 6]])
        spring = ConstraintRow.direct(short(stiffness / h**2), short(loss / h), (d, d, 1.0, 0.5, 1.0))
        impedance = dmax, short(width * high * h), short(midpoint)
        return spring, _damper(short(damping / h), impedance, adhesive)

    def best(self, adhesive: bool) -> Rows:
        """Rows of the least error that an evolution finds."""

        def errors(members: Floats, limits: Floats) -> Floats:
            each = zip(members, limits.tolist(), strict=True)
            return np.array([self._error(self.rows(member, adhesive), limit) for member, limit in each])

        is_large = self._model.nv > _LIGHT
        random, bounds = np.random.default_rng(_SEED), (_LEGS_LOWEST if is_large else _LOWEST, _HIGHEST)
        first, starts = random.uniform(*bounds, (_MEMBERS, len(_LOWEST))), _LEGS if is_large else _STARTS
        first[: len(starts)] = starts
        generations = _GENERATIONS[is_large]
        with captured_warnings():
            best = evolve(errors, first, generations, bounds, random, towards_best=True)[0]
            return self.rows(best, adhesive)


def _crossing_speed(*x: Floats) -> Floats:
    """Speed at which the parabola through three states, a step apart, crosses 0, in m a step; (n,)."""
    before, at, after = x
    rate, bend = (after - before) / 2, after - 2 * at + before
    return np.asarray(np.sqrt(np.maximum(0.0, rate**2 - 2 * bend * at)))
