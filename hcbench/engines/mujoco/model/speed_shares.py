"""What changes the approach speed of a pair during a contact, told apart: contact, limits, actuators, ..."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import response
from hcbench.impact import Floats
from hcbench.sim.model_under_test import CONTACT, WEIGHT

OTHERS = "other contacts"
LIMITS, EQUALITIES, FRICTION = "limits of joints and tendons", "equality constraints", "friction in joints"
ACTUATORS, PASSIVE = "actuators", "springs and damping of joints"
NAMES = (CONTACT, OTHERS, LIMITS, EQUALITIES, FRICTION, ACTUATORS, PASSIVE, WEIGHT)


def has_more_than_contacts(model: Any) -> bool:
    """Whether anything but contacts and gravity can act on the bodies of a model."""
    fields = ("jnt_limited", "jnt_stiffness", "dof_damping", "dof_frictionloss", "dof_armature")
    return bool(model.nu or model.neq or model.ntendon or any(getattr(model, f).any() for f in fields)) or (
        model.nv != 6 * model.njnt
    )


def strange_share(shares: Mapping[str, float]) -> float:
    """Share of the change of speed that neither the contact nor gravity made."""
    return sum(abs(share) for name, share in shares.items() if name not in (CONTACT, WEIGHT))


class SpeedShares:
    """Adds up what each cause takes off the approach speed of one launch, m/s, as long as the force acts."""

    def __init__(self, model: Any, sides: NDArray[np.int8]) -> None:
        self._model, self._sides, self._kinds = model, sides, backend().mjtConstraint
        self.taken = np.zeros(len(NAMES))

    def add(self, data: Any, row: Floats) -> None:
        """One step. data: its constraints and forces are of the state before the step. row: (nv,) J."""
        model = self._model
        moved = response(model, data, row)
        parts = dict.fromkeys(NAMES, 0.0)
        if data.nefc:
            coupling = np.zeros(data.nefc)
            backend().mj_mulJacVec(model, data, coupling, moved)
            accelerations = coupling * data.efc_force
            for name, mask in self._rows(data):
                parts[name] = float(accelerations[mask].sum())
        parts[ACTUATORS] = float(moved @ data.qfrc_actuator)
        parts[PASSIVE] = float(moved @ data.qfrc_passive)
        parts[WEIGHT] = -float(moved @ data.qfrc_bias)
        self.taken -= float(model.opt.timestep) * np.array([parts[name] for name in NAMES])

    def _rows(self, data: Any) -> list[tuple[str, NDArray[np.bool_]]]:
        kinds, kind = self._kinds, np.asarray(data.efc_type)
        of_contact = kind >= int(kinds.mjCNSTR_CONTACT_FRICTIONLESS)
        geoms = data.contact.geom[data.efc_id[of_contact]]
        mine = np.zeros(len(kind), bool)
        mine[of_contact] = self._sides[geoms].sum(axis=1) == 3
        limits = (kind == int(kinds.mjCNSTR_LIMIT_JOINT)) | (kind == int(kinds.mjCNSTR_LIMIT_TENDON))
        friction = (kind == int(kinds.mjCNSTR_FRICTION_DOF)) | (kind == int(kinds.mjCNSTR_FRICTION_TENDON))
        return [
            (CONTACT, mine),
            (OTHERS, of_contact & ~mine),
            (LIMITS, limits),
            (EQUALITIES, kind == int(kinds.mjCNSTR_EQUALITY)),
            (FRICTION, friction),
        ]
