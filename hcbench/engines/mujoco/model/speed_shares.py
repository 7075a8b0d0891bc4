"""Causes that change the approach speed of a pair during a contact: contact, limits, actuators, ..."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
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
# A contact's own pull, against which its rows push.
ADHESION = "adhesion of contacts"
NAMES = (CONTACT, OTHERS, LIMITS, EQUALITIES, FRICTION, ACTUATORS, PASSIVE, ADHESION, WEIGHT)
# So many steps are kept one by one: to sum them takes as long as to take ten.
_MANY = 1000


def has_more_than_contacts(model: Any) -> bool:
    """Say whether anything but contacts and gravity can act on the bodies of a model."""
    fields = ("jnt_limited", "jnt_stiffness", "dof_damping", "dof_frictionloss", "dof_armature")
    return bool(
        model.nu or model.neq or model.ntendon or any(getattr(model, f).any() for f in fields)
    ) or (model.nv != 6 * model.njnt)


def strange_share(shares: Mapping[str, float]) -> float:
    """Share of the change of speed that neither the pair's contact, with its adhesion, nor gravity
    made: other contacts count.
    """
    own = (CONTACT, ADHESION, WEIGHT)
    return sum(abs(share) for name, share in shares.items() if name not in own)


class SpeedShares:
    """Adds up what each cause takes off the approach speed of one
    launch, as long as the force acts.

    model: MjModel.
    sides: (ngeom + 1,), 1 for geoms of the moving part, 2 for the other's, else 0.

    Each sum and product is MuJoCo's own: launch.c has the same bits.
    """

    def __init__(self, model: Any, sides: NDArray[np.int8]) -> None:
        """Begin with sums of zero, for one launch.

        model: MjModel.
        sides: of each geom, 1 for those of the moving part, 2 for the other's, else 0, (ngeom +
        1,).
        """
        self._model = model
        self._sides = sides
        self._h = float(model.opt.timestep)
        # M^-1 J^T: motion of each degree of freedom by a unit push along the normal.
        self._moved = np.empty((1, model.nv))
        # Generalised forces of five causes, and what each adds to the approach.
        self._forces = np.zeros((5, model.nv))
        self._products = np.empty(5)
        # Older versions of MuJoCo have none.
        self._has_adhesion = bool(getattr(model, "flg_adhesion", False))
        self.forget()

    def forget(self) -> None:
        """Begin again from zero."""
        self._taken: Floats = np.zeros(len(NAMES))
        self._clear()

    def _clear(self) -> None:
        # Numbers of the steps that are kept, and the accelerations of each, m/s², in parts, (n, causes).
        self._at: list[int] = []
        self._parts: list[Floats] = []

    def add(self, step: int, data: Any, row: Floats, others: bool) -> None:
        """Add to the sums what each cause changes of the approach rate in one step.

        step: its number in the launch, rising.
        data: MjData whose constraints and forces are of the state before the step.
        row: Jacobian of the approach rate, (nv,).
        others: True if there are contacts besides the pair's.
        """
        mujoco = backend()
        mujoco.mj_solveM(self._model, data, self._moved, row[None])
        moved = self._moved[0]
        # A row for each cause, (5, nv).
        forces = self._forces
        forces[0] = data.qfrc_constraint
        forces[1] = data.qfrc_actuator
        forces[2] = data.qfrc_passive
        forces[3] = data.qfrc_bias
        if self._has_adhesion:
            forces[4] = data.qfrc_adhesion
        mujoco.mju_mulMatVec(self._products, forces, moved)
        constraint, actuators, passive, bias, adhesion = self._products.tolist()
        # All constraint forces are the pair's contact, unless there are other constraints.
        constraints = [constraint, 0.0, 0.0, 0.0, 0.0]
        if others or data.ne or data.nf or data.nl:
            constraints = self._by_constraint(data, moved)
        # In the order of NAMES. MuJoCo counts adhesion among the passive forces, and has the bias,
        # which is weight and motion of the links, on the other side of the equation of motion.
        parts = [*constraints, actuators, passive - adhesion, adhesion, -bias]
        self.keep([step], np.array([parts]))

    def keep(self, steps: Sequence[int], accelerations: Floats) -> None:
        """Add steps whose accelerations of the approach by each of NAMES are known.

        steps: their numbers in the launch, rising.
        accelerations: of each, m/s², (n, causes).
        """
        self._at += steps
        self._parts.append(accelerations)

    def taken(self, steps: int) -> dict[str, float]:
        """Speed that each cause took off the approach in the first `steps` steps, m/s, by its name.

        A cause that sped the pair up has a number below 0. Steps before the last `settle` count as
        a whole, so `steps` must not end among them.
        """
        return dict(zip(NAMES, self._sum(bisect_left(self._at, steps)).tolist(), strict=True))

    def settle(self) -> None:
        """Keep the sums of the steps until now, and not the steps, once these are many."""
        if len(self._at) < _MANY:
            return
        self._taken = self._sum(len(self._at))
        self._clear()

    def _sum(self, entries: int) -> Floats:
        """Speed that each of NAMES took in the first `entries` steps
        and in those settled before, m/s.
        """
        parts = np.concatenate([np.empty((0, len(NAMES))), *self._parts])[:entries]
        # One after the other: the same bits, however many steps are added at once.
        return np.asarray(np.cumsum(np.vstack([self._taken, -self._h * parts]), axis=0)[-1])

    def _by_constraint(self, data: Any, moved: Floats) -> list[float]:
        """Acceleration of the approach, m/s², by each of the first five of NAMES: the pair's
        contact, other contacts, limits, equalities and friction in joints.

        data: MjData with the constraints of the state.
        moved: M^-1 J^T, (nv,), the motion by a unit push at the contact.
        """
        mujoco = backend()
        accelerations = np.zeros(data.nefc)
        mujoco.mj_mulJacVec(self._model, data, accelerations, moved)
        accelerations *= data.efc_force
        # MuJoCo has its constraint rows in this order; the contacts' are the rest.
        ends = np.cumsum((data.ne, data.nf, data.nl))
        equalities, friction, limits, contacts = np.split(accelerations, ends)
        contact_of_row = data.efc_id[ends[-1] :]
        # Sides 1 and 2 add up to 3 only for a contact of the pair.
        of_pair = self._sides[data.contact.geom[contact_of_row]].sum(axis=1) == 3
        parts = contacts[of_pair], contacts[~of_pair], limits, equalities, friction
        return [mujoco.mju_sum(part) for part in parts]
