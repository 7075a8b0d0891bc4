"""A MuJoCo model with a pair in it, opened, and the memory in which its launches are stepped."""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings, require_feature
from hcbench.engines.mujoco.model.bodies import integrator_name, is_whole_state, speed_reading
from hcbench.engines.mujoco.model.find_pair import find_pair
from hcbench.engines.mujoco.model.pair import WithoutContact, restitution_law
from hcbench.engines.mujoco.model.place import bring_to_touch, require_plausible_contact
from hcbench.engines.mujoco.model.start_pose import start_pose
from hcbench.sim.model_under_test import ModelUnderTest, Request, Suspect
from hcbench.sim.read_impact import SpeedReading

# A body struck beside its centre turns: its effective mass is below its
# own by more than this share.
_TURNS = 1e-6
# Launches in a simulation: looking at the steps of one costs as much as at those of all.
_PLACES = 32


class OpenedModel(ModelUnderTest):
    """A MuJoCo model with a pair in it, opened: its start, its place at touch, and what launches leave.

    model: an MjModel, which this object may change.
    label: its name in outputs.
    state: an MjData to start from, or None.

    Raises UserError or SceneError with the reason where the pair cannot be measured; EngineMissing
    for a MuJoCo that is too old.
    """

    diverged = "MuJoCo found the state unstable and reset it"
    # A simulation steps no launch after it has parted, so few steps are enough at first.
    least_steps = 32

    def __init__(self, model: Any, label: str, state: Any, request: Request) -> None:
        require_feature(backend(), "mj_copyData")
        self.model = model
        self.label = label
        self.state = state
        self.request = request
        with captured_warnings():
            self.start, self.start_name = start_pose(model, request, state)
            pair = find_pair(model, request, state)
            # A second state, which ends at touch.
            moved, _ = start_pose(model, request, state)
            self.place = bring_to_touch(pair, moved, request.coming_from, request.move)
        require_plausible_contact(model, self.place)
        self.timestep = float(model.opt.timestep)
        self.mass = self.place.effective_mass
        self.gravity = self.place.gravity
        self.energy_by_work = self.place.pair.more_than_contacts
        self.speed_reading = speed_reading(model)
        if not self._falls_freely():
            if self.speed_reading is SpeedReading.TOUCH_PLANE_EXACT_FLIGHT:
                self.speed_reading = SpeedReading.STAGED_CROSSING
            else:
                self.speed_reading = SpeedReading.CROSSING
        self.places = _PLACES if is_whole_state(model) else 1
        # Geoms that touched the two during an impact.
        self.others: set[int] = set()
        # Texts of MuJoCo and its plug-ins while it stepped launches.
        self.warned: list[str] = []
        # Speed that each cause took off the approach, over that at touch.
        self.shares: dict[str, float] = {}

    def _falls_freely(self) -> bool:
        """Say whether the two have one constant acceleration apart from the contact. Joints, a
        moving second body, and a corner that turns in the impact change it.
        """
        model = self.model
        place = self.place
        first = place.pair.first.body
        second = place.pair.second.body
        central = place.effective_mass >= (1.0 - _TURNS) * float(model.body_subtreemass[first])
        return central and not (self.energy_by_work or model.body_weldid[second])

    @abstractmethod
    def fixed(self, suspects: Sequence[Suspect]) -> OpenedModel:
        """The same pair with the fixes of `suspects` made, in a copy of the model."""

    @property
    def step_cost(self) -> float:
        """Grows with degrees of freedom and geoms."""
        return 1.0 + float(self.model.nv + self.model.ngeom) / 10


@dataclass(frozen=True, slots=True)
class LaunchWorkspace:
    """Memory for launches of a model, one at a time: allocating it takes as long as 500 steps.

    data: the state under way.
    seen: the state before the step, which RK4 does not leave in `data`.
    free: for steps of RK4 without contact.
    beside: for those without a plug-in's.

    Those without a use are None.
    """

    data: Any
    seen: Any
    free: Any
    beside: WithoutContact | None

    @classmethod
    def of(cls, opened: OpenedModel) -> Self:
        """The workspace for launches of a model."""
        mujoco = backend()
        model = opened.model
        data = copy.copy(opened.start)
        seen = data
        free = None
        # RK4 leaves another state than that before the step in `data`.
        if integrator_name(model) == "RK4":
            seen = mujoco.MjData(model)
            free = mujoco.MjData(model)
        without = None
        if restitution_law(model, opened.place.contact.geoms) is not None:
            without = WithoutContact(model)
        return cls(data, seen, free, without)


def copy_state(model: Any, source: Any, target: Any) -> None:
    """Put one MjData into the state of another."""
    mujoco = backend()
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, source, state, kind)
    mujoco.mj_setState(model, target, state, kind)
