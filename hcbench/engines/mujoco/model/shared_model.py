"""A user's MuJoCo model that another engine steps: prepared and read as MuJoCo's own."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.model.open import LaunchWorkspace
from hcbench.engines.mujoco.model.pair_reader import with_kinematics
from hcbench.engines.mujoco.model.simulation import Flights, MujocoFlight
from hcbench.engines.mujoco.scene.shared_scene import differences, rounded_adhesion
from hcbench.measuring.measurement import TOLERANCE
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Facts, ModelUnderTest, Suspect
from hcbench.sim.read_impact import NOT_FINITE
from hcbench.sim.scripted import require_motion_at, unit_in_last_place
from hcbench.terms.impact import Impact, Launch
from hcbench.terms.resolution import ROUND_OFF_SOLVED

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.model.open import OpenedModel
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.shared_model import Copies, SharedModelEngine
    from hcbench.sim.world import Flags, Record
    from hcbench.terms.impact import Floats

# A step has to move the bodies by as many units in the last place of their
# coordinates; below it e scatters.
_SMOOTH = 100.0


class LentModel(ModelUnderTest):
    """A MuJoCo model in the copies of another engine that steps it.

    The copies step; their states are put back into MuJoCo's own data, which reads the pair.

    own: the model as MuJoCo opened it, with the pair at touch.
    engine: the engine that steps.
    as_given: the model is the user's own, without fixes of hcbench's in it.

    Raises SceneError for what the engine does not have, SettingError for a step too short for its
    numbers.
    """

    diverged = NOT_FINITE

    def __init__(self, own: OpenedModel, engine: SharedModelEngine, as_given: bool = True) -> None:
        """Make the engine's copies of the model.

        own: the model as MuJoCo opened it.
        engine: that steps.
        as_given: the model is the user's own, without fixes.
        Raises SceneError for what the engine does not have, SettingError for a step too short for
        its numbers.
        """
        self._own = own
        self._engine = engine
        self._as_given = as_given
        self._copies = engine.copies(own.model, own.start)
        self.places = self._copies.places
        self.timestep = own.timestep
        self.mass = own.mass
        self.gravity = own.gravity
        self.speed_reading = own.speed_reading
        self.energy_by_work = own.energy_by_work
        at_touch = copy.copy(own.start)
        at_touch.qpos[:] = own.place.qpos
        middles = with_kinematics(at_touch, own.model).geom_xpos[list(own.place.pair.geoms)]
        # Largest coordinate, m, by which the engine's numbers round the motion.
        self._reach = float(np.abs([*middles, own.place.contact.point]).max())
        require_motion_at(self._reach, self.timestep, max(own.request.speeds), self._copies.bits)

    def release(self, launches: Sequence[Launch]) -> LentSimulation:
        """Release a copy of the model for each launch."""
        flights = [
            LentFlight(self._own, launch, LaunchWorkspace.of(self._own, copy.copy(self._own.start)))
            for launch in launches
        ]
        return LentSimulation(self._copies, flights)

    @property
    def step_cost(self) -> float:
        """Cost of MuJoCo's step: all copies share one."""
        return self._own.step_cost

    def facts(self) -> Facts:
        """MuJoCo's facts of the pair, under the name of the engine that steps it."""
        own = self._own.facts()
        settings = {**own.settings, "numbers": f"float{self._copies.bits}"}
        version = self._engine.version()
        return dataclasses.replace(
            own, engine=self._engine.name, version=version, settings=settings
        )

    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Suspects of the engine: its differences from MuJoCo that matter to the pair, then what
        MuJoCo itself suspects in the model.

        impacts: as the engine stepped them.
        wanted: e over speed, None where the user named none. One launch of each speed is simulated
        in MuJoCo itself, to compare.
        """
        own = self._own.suspects(impacts, wanted)
        # The engine's differences concern the user's own contact: not one with fixes.
        if not self._as_given:
            return own
        model = self._own.model
        bits = self._copies.bits
        rows = []
        geoms: list[int] = []
        for point in self._own.place.contact.rows:
            rows.append((point.solref, point.solimp))
            geoms += point.geoms
        named = differences(model, self._engine, bits, geoms, rows)
        named += rounded_adhesion(model, self._engine, bits, geoms, impacts)
        return [*named, *self._too_fine(impacts), *self._unlike_mujoco(impacts), *own]

    def _too_fine(self, impacts: Sequence[Impact]) -> Iterator[Suspect]:
        """Suspect a step in which the slowest launch moves by few units in the last place; at most
        one suspect.

        impacts: as the engine stepped them. Coordinates are rounded to the engine's numbers,
        float32 or float64; far from the origin or in short steps the rounding is a notable share of
        the way.
        """
        # Distance of two neighbouring numbers at the largest coordinate, and the slowest step, m.
        spacing = unit_in_last_place(self._reach, self._copies.bits)
        moved = min(impact.launch.speed for impact in impacts) * self.timestep
        if not moved < _SMOOTH * spacing:
            return
        fix = "the contact nearer to the origin, or longer steps"
        if self._engine.exact:
            fix += f"; or {self._engine.exact}"
        yield Suspect(
            "rounded-positions",
            f"Positions in float{self._copies.bits} are coarse for such short steps: e scatters.",
            f"steps of {moved:.2g} m where coordinates of {self._reach:.3g} m are {spacing:.2g} m apart",
            fix,
            always_reported=True,
        )

    def _unlike_mujoco(self, impacts: Sequence[Impact]) -> Iterator[Suspect]:
        """Suspect the engine if the same launches bounce otherwise in MuJoCo itself; at most one
        suspect.

        impacts: as the engine stepped them; one launch of each speed is simulated again in MuJoCo.
        Names the launch whose e differs most, if by more than TOLERANCE; one without e in either of
        the two differs most of all.
        """
        # One phase of each speed: the last.
        of_speed = {impact.launch.at_any_phase: impact for impact in impacts}
        by_engine = list(of_speed.values())
        by_mujoco = simulate.impacts_in(self._own, [impact.launch for impact in by_engine])
        worst = None
        largest = TOLERANCE
        for here, there in zip(by_engine, by_mujoco, strict=True):
            if not here.is_measured and not there.is_measured:
                continue
            difference = abs(here.restitution - there.restitution)
            if math.isnan(difference):
                # One of the two has no e.
                difference = math.inf
            if difference > largest:
                worst = (here, there)
                largest = difference
        if worst is None:
            return
        here, there = worst
        yield Suspect(
            "unlike-mujoco",
            f"{self._engine.title} does not bounce as MuJoCo does.",
            f"e at {here.launch.speed:.4g} m/s: {_e_or_end(here)}, "
            f"where MuJoCo has {_e_or_end(there)}",
            f"`hcbench tune {self._engine.name}` finds a contact that bounces as it should",
            always_reported=True,
        )

    def fixed(self, suspects: Sequence[Suspect]) -> LentModel:
        """The same pair with some fixes made, in copies of their own."""
        return LentModel(self._own.fixed(suspects), self._engine, as_given=False)


def _e_or_end(impact: Impact) -> str:
    """e of an impact, or else the status that it ended with."""
    return f"{impact.restitution:.4g}" if impact.is_measured else impact.status.value


class LentFlight(MujocoFlight):
    """One launch, whose states another engine hands in; MuJoCo only reads them."""

    def start_from(self, state: Floats, bits: int) -> None:
        """Begin at the launch's state as the engine has it, after rounding to its numbers.

        state: qpos, then qvel, (nq + nv,).
        bits: of the engine's numbers, 32 or 64.
        """
        # Share of the speeds up to which a change is round-off, and reads as no force.
        self._round_off = ROUND_OFF_SOLVED * float(np.finfo(f"f{bits // 8}").eps)
        self._noise = max(self._noise, self._round_off)
        # States of the engine that are still to be read, and by how much the last one's velocities
        # differ from MuJoCo's.
        self._states: deque[Floats] = deque()
        self._changed = np.zeros(self._model.nv)
        self._set(self._data, state)

    @property
    def state(self) -> Floats:
        """Positions and velocities at release."""
        return np.append(self._data.qpos, self._data.qvel)

    def hand_in(self, states: Floats) -> int:
        """Keep more states that the engine computed, and return how many steps can now be read.

        states: qpos, then qvel, after each step, (n, nq + nv).
        """
        self._states.extend(states)
        is_first = self._staged and self._last is None
        # Under RK4 a step is read once the one after it is.
        return len(self._states) - 1 if is_first else len(self._states)

    def _take_step(self, data: Any) -> None:
        """Take MuJoCo's own step, for its forces, and then put the engine's state in its place.

        data: MjData of the engine's state before; afterwards, of its next state that was handed in.
        Notes for `_force` how the engine's velocities differ from MuJoCo's after the step, and the
        speeds whose round-off may look like such a difference, (nv,) each.
        """
        before = np.abs(data.qvel)
        super()._take_step(data)
        velocity_of_mujoco = data.qvel.copy()
        self._set(data, self._states.popleft())
        if not np.isfinite(data.qvel).all():
            # A time that runs back is also MuJoCo's sign of a state that it had to reset.
            data.time = -math.inf
        self._changed = data.qvel - velocity_of_mujoco
        self._speeds = before + np.abs(velocity_of_mujoco) + np.abs(data.qvel)

    def _set(self, data: Any, state: Floats) -> None:
        nq = self._model.nq
        data.qpos[:] = state[:nq]
        data.qvel[:] = state[nq:]

    def _force(self, solved: float, seen: Any) -> float:
        """Force of the pair in the step just taken, N; 0 where it is not more than round-off.

        It is MuJoCo's force from the same state, plus the difference of the engine's momentum from
        that after MuJoCo's step, over the time step.
        solved: force of MuJoCo's solver, N.
        seen: MjData of the state before the step.
        """
        row = self._reader.row(seen)
        # By how much the engine slowed the approach more than MuJoCo did, and its round-off, m/s.
        slowed = -float(row @ self._changed)
        noise = self._round_off * float(np.abs(row) @ self._speeds)
        mass = self._place.effective_mass
        force = solved
        if abs(slowed) > noise:
            force = solved + mass * slowed / self._h
        if abs(force) * self._h > mass * noise:
            return force
        # Round-off alone would make as much.
        return 0.0


class LentSimulation(Flights[LentFlight]):
    """Launches under way in copies of their model, one copy each; all copies step together."""

    def __init__(self, copies: Copies, flights: Sequence[LentFlight]) -> None:
        """Put each launch into a copy of the model, and begin it in the state that the copy then has,
        which is rounded to the engine's numbers.

        copies: of the model, at least as many as flights.
        flights: each at its release.
        """
        super().__init__(flights)
        self._copies = copies
        # Copies whose launches are still read.
        self._which = np.arange(len(flights))
        # The states as the engine has them, (launches, nq + nv).
        started = copies.place_first(np.array([flight.state for flight in flights]))
        for flight, state in zip(flights, started, strict=True):
            flight.start_from(state, copies.bits)

    def advance(self, steps: int) -> Record:
        """Let the engine take up to `steps` steps, as many at once as it takes, and read each launch
        in the states that it hands back.

        The record has one step at least. Under RK4 it is one step behind the engine.
        """
        count = 0
        # Under RK4 one step alone cannot be read yet.
        while count < 1:
            path = self._copies.step(steps)[:, self._which]  # (steps, launches, nq + nv)
            count = min(flight.hand_in(path[:, i]) for i, flight in enumerate(self._flights))
        return self.side_by_side([flight.advance(count) for flight in self._flights])

    def keep(self, which: Flags) -> None:
        """Read these only: the engine goes on with all."""
        super().keep(which)
        self._which = self._which[which]
