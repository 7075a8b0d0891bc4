"""Causes that change the approach speed of a pair during a contact: contact, limits, actuators, ..."""

from bisect import bisect_left
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hcbench.engines.mujoco.backend import backend
from hcbench.sim.model_under_test import CONTACT, WEIGHT
from hcbench.terms.impact import Floats

OTHERS = "other contacts"
LIMITS = "limits of joints and tendons"
EQUALITIES = "equality constraints"
FRICTION = "friction in joints"
ACTUATORS = "actuators"
PASSIVE = "springs and damping of joints"
NAMES = (CONTACT, OTHERS, LIMITS, EQUALITIES, FRICTION, ACTUATORS, PASSIVE, WEIGHT)
# Steps that there is room for at first.
_ROOM = 64


def has_more_than_contacts(model: Any) -> bool:
    """Say whether anything but contacts and gravity can act on the bodies of a model."""
    fields = ("jnt_limited", "jnt_stiffness", "dof_damping", "dof_frictionloss", "dof_armature")
    return bool(
        model.nu or model.neq or model.ntendon or any(getattr(model, f).any() for f in fields)
    ) or (model.nv != 6 * model.njnt)


def strange_share(shares: Mapping[str, float]) -> float:
    """Share of the change of speed that neither the contact nor gravity made."""
    return sum(abs(share) for name, share in shares.items() if name not in (CONTACT, WEIGHT))


class SpeedShares:
    """Adds up what each cause takes off the approach speed of one
    launch, as long as the force acts.

    model: MjModel.
    sides: (ngeom + 1,), 1 for geoms of the moving part, 2 for the other's, else 0.

    Forces are multiplied by what they move once for many steps: after a step of MuJoCo's, each
    operation of NumPy's takes longer.
    """

    def __init__(self, model: Any, sides: NDArray[np.int8]) -> None:
        self._model = model
        self._sides = sides
        self._h = float(model.opt.timestep)
        # (steps, 5, nv): the motion by a unit push, then the generalised forces of four causes.
        self._steps = np.empty((_ROOM, 5, model.nv))
        self.forget()

    def forget(self) -> None:
        """Begin again from zero."""
        self._taken: Floats = np.zeros(len(NAMES))
        self._clear()

    def _clear(self) -> None:
        # Numbers of the steps that `_steps` has.
        self._at: list[int] = []
        # Steps with more constraints than contacts, whose forces are added up one by one.
        self._told_apart: list[tuple[int, list[float]]] = []

    def add(self, step: int, data: Any, row: Floats, others: bool) -> None:
        """Add one step to the sums.

        step: its number in the launch, rising.
        data: MjData whose constraints and forces are of the state before the step.
        row: (nv,), Jacobian of the approach rate.
        others: True if there are contacts besides the pair's.
        """
        entry = len(self._at)
        if entry == len(self._steps):
            self._steps = np.concatenate([self._steps, np.empty_like(self._steps)])
        here = self._steps[entry]
        # M^-1 J^T, the motion by a unit push along the normal.
        backend().mj_solveM(self._model, data, here[:1], row[None])
        here[1], here[2] = data.qfrc_constraint, data.qfrc_actuator
        here[3], here[4] = data.qfrc_passive, data.qfrc_bias
        if others or data.ne or data.nf or data.nl:
            self._told_apart.append((entry, self._by_constraint(data, here[0])))
        self._at.append(step)

    def taken(self, steps: int) -> dict[str, float]:
        """Speed that each cause took off the approach in the first `steps` steps, m/s, by its name.

        A cause that sped the pair up has a number below 0. Steps before the last `settle` count as
        a whole, so `steps` must not end among them.
        """
        return dict(zip(NAMES, self._sum(bisect_left(self._at, steps)).tolist(), strict=True))

    def settle(self) -> None:
        """Keep the sums of the steps until now, and not the steps."""
        self._taken = self._sum(len(self._at))
        self._clear()

    def _sum(self, entries: int) -> Floats:
        """Speed that each of NAMES took in the first `entries` steps
        and in those settled before, m/s.
        """
        # Accelerations, m/s².
        parts = np.zeros((entries, len(NAMES)))
        # (entries, 5, nv): M^-1 J^T, then the forces by constraints,
        # actuators, passive ones and bias.
        steps = self._steps[:entries]
        # All constraints go to the first, which `_told_apart` splits where there were several.
        parts[:, [0, *range(5, len(NAMES))]] = (steps[:, :1] * steps[:, 1:]).sum(axis=2)
        # The bias is on the other side of the equation of motion.
        parts[:, -1] *= -1.0
        for entry, accelerations in self._told_apart:
            if entry < entries:
                parts[entry, :5] = accelerations
        # One after the other: the same bits, however many steps are added at once.
        return np.asarray(np.cumsum(np.vstack([self._taken, -self._h * parts]), axis=0)[-1])

    def _by_constraint(self, data: Any, moved: Floats) -> list[float]:
        """Acceleration of the approach, m/s², by each of the first five of NAMES.

        data: MjData with the constraints of the state.
        moved: M^-1 J^T, (nv,), the motion by a unit push at the contact.
        """
        accelerations = np.zeros(data.nefc)
        backend().mj_mulJacVec(self._model, data, accelerations, moved)
        accelerations *= data.efc_force
        # MuJoCo's order of rows
        ends = np.cumsum((data.ne, data.nf, data.nl))
        equalities, friction, limits, contacts = np.split(accelerations, ends)
        contact_of_row = data.efc_id[ends[-1] :]
        of_pair = self._sides[data.contact.geom[contact_of_row]].sum(axis=1) == 3
        parts = contacts[of_pair], contacts[~of_pair], limits, equalities, friction
        return [float(part.sum()) for part in parts]
