"""Reads the depth, force and approach rate of a pair off MuJoCo's data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend

if TYPE_CHECKING:
    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.engines.mujoco.model.sliding import MujocoAlongPlate
    from hcbench.impact import Floats


class PairReader:
    """Reads depth, force and rate of the pair off an MjData that belongs to one state."""

    def __init__(self, model: Any, place: PairAtTouch, data: Any, along: MujocoAlongPlate | None) -> None:
        mujoco = backend()
        self.model, self.place, self.along, self.count = model, place, along, 0
        self.table = place.pair.sides.tolist()
        self.pyramid = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self.wrench = np.zeros(6)
        self.force_of = mujoco.mj_contactForce
        self.point, self.normal = place.contact.point, place.contact.normal
        self._row: Floats | None = None
        self.row(data)

    def contact_point(self, data: Any) -> Floats:
        """The last contact's, m; of a body that slides and spins it goes along with the body's centre."""
        return self.point if self.along is None else self.along.moved_with(data, self.point)

    def row(self, data: Any) -> Floats:
        """(nv,) approach row at the last contact, from the kinematics in `data`."""
        if self._row is None or self.along is not None:
            self._row = self.place.pair.approach_row(data, self.contact_point(data), self.normal)
        return self._row

    def read(self, data: Any, velocity: Floats) -> tuple[float | None, float, float]:
        """(penetration beyond the onset, None without a contact; force; approach rate)."""
        mine = []
        for i in range(data.ncon):
            contact = data.contact[i]
            a, b = contact.geom.tolist()
            if self.table[a] + self.table[b] == 3:
                mine.append((i, contact, self.table[a] == 2))
        self.count = len(mine)
        if not mine:
            self._row = None  # the links have turned since
            return None, 0.0, float(self.row(data) @ velocity)
        force, distance, acting = 0.0, math.inf, []
        for i, contact, turned in mine:
            distance = min(distance, contact.dist)
            address = contact.efc_address
            if address >= 0:
                self.force_of(self.model, data, i, self.wrench)
                force += float(self.wrench[0])
                if self.along is not None:
                    self.along.push(contact, self.wrench, turned)
                acting.append(self._parting_rate(data, address, contact.dim))
        self.point = mine[0][1].pos.copy() if len(mine) == 1 else np.mean([c.pos for _, c, _ in mine], axis=0)
        _, contact, turned = mine[0]
        self.normal = -contact.frame[:3] if turned else contact.frame[:3].copy()
        self._row = None
        if self.along is not None:  # on the moving body's surface; MuJoCo has it halfway to the other's
            self.point = self.point - 0.5 * distance * self.normal
            self.along.seen(data)
        rate = -sum(acting) / len(acting) if acting else float(self.row(data) @ velocity)
        return self.place.contact.onset - distance, force, rate

    def depth(self, data: Any, guess: float) -> float:
        """Penetration beyond the onset without a contact; the guess for shapes without a distance."""
        if not math.isfinite(self.place.gap):
            return guess
        return self.place.gap - float(self.place.pair.nearest(data).distance)

    def _parting_rate(self, data: Any, address: int, dim: int) -> float:
        """Rate along the normal, as the engine has it: the two edges of a pyramid lie evenly about it."""
        velocity = data.efc_vel
        if dim == 1 or not self.pyramid:
            return float(velocity[address])
        return 0.5 * float(velocity[address] + velocity[address + 1])


def with_kinematics(data: Any, model: Any) -> Any:
    """`data` with its kinematics computed at its state."""
    mujoco = backend()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data
