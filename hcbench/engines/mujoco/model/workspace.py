"""Memory in which launches of a MuJoCo model are stepped."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import integrator_name
from hcbench.engines.mujoco.model.pair import WithoutContact, restitution_law

if TYPE_CHECKING:
    from hcbench.engines.mujoco.model.under_test import MujocoModel


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
    def of(cls, opened: MujocoModel) -> Self:
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
