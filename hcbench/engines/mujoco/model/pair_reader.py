"""Reads the depth, force and approach rate of a pair off MuJoCo's data."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend

if TYPE_CHECKING:
    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.engines.mujoco.model.sliding import MujocoAlongPlate
    from hcbench.terms.impact import Floats


class PairReader:
    """Reads depth, force and rate of the pair off an MjData that belongs to one state.

    others: whether there were contacts besides the pair's in the state that was read last.
    """

    def __init__(
        self, model: Any, place: PairAtTouch, data: Any, along: MujocoAlongPlate | None
    ) -> None:
        mujoco = backend()
        self.model = model
        self.place = place
        self.along = along
        self.others = False
        self._pyramid = int(model.opt.cone) == int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
        self._wrench = np.zeros(6)
        self._force_of = mujoco.mj_contactForce
        self._point = place.contact.point
        self._normal = place.contact.normal
        self._row: Floats | None = None
        # Of the last contacts: the geoms of all; of each of the pair's its place, whether the
        # moving geom is its second, and whether its normal has two rows; then these, points, axes
        # and the distance until they are asked for.
        self._geoms: list[list[int]] = []
        self._mine: list[tuple[int, bool, bool]] = []
        self._unread: tuple[list[tuple[int, bool, bool]], Floats, Floats, float] | None = None
        self.row(data)

    @property
    def normal(self) -> Floats:
        """Normal of the last contact, from the moving body."""
        self._use_contact()
        return self._normal

    def contact_point(self, data: Any) -> Floats:
        """Point of the last contact, m; moved along with the centre of a
        body that slides and spins.
        """
        self._use_contact()
        if self.along is None:
            return self._point
        return self.along.moved_with(data, self._point)

    def row(self, data: Any) -> Floats:
        """(nv,) approach row at the last contact, from the kinematics in `data`."""
        if self._row is None or self.along is not None:
            point = self.contact_point(data)
            self._row = self.place.pair.approach_row(data, point, self._normal)
        return self._row

    def read(self, data: Any, velocity: Floats) -> tuple[float | None, float, float]:
        """(penetration beyond the onset, m, None without a contact; force, N; approach rate, m/s).

        velocity: (nv,) of the state whose contacts and forces are in `data`. The contact's
        point and normal are kept for `normal` and `contact_point`; friction goes to `along`,
        the reader of oblique launches.
        """
        # The links have turned since the last step.
        self._row = None
        # Columns of all contacts: a look at one number of one contact takes as long.
        contacts = data.contact
        geoms = contacts.geom.tolist()
        if geoms != self._geoms:
            self._find_pair(geoms, contacts.dim.tolist())
        if not self._mine:
            return None, 0.0, float(self.row(data) @ velocity)
        distances = contacts.dist.tolist()
        addresses = contacts.efc_address.tolist()
        rates = data.efc_vel
        distance = math.inf
        force = 0.0
        parting = 0.0
        acting = 0
        for i, turned, is_pyramid in self._mine:
            distance = min(distance, distances[i])
            address = addresses[i]
            # A contact without a constraint row has no force.
            if address < 0:
                continue
            self._force_of(self.model, data, i, self._wrench)
            force += self._wrench.item(0)
            rate = rates.item(address)
            if is_pyramid:
                # As the engine has it: the two edges of a pyramid lie evenly about the normal.
                rate = 0.5 * (rate + rates.item(address + 1))
            parting += rate
            acting += 1
            if self.along is not None:
                self.along.push(contacts.frame[i], self._wrench, turned)
        self._unread = self._mine, contacts.pos.copy(), contacts.frame.copy(), distance
        if self.along is not None:
            self.along.seen(data)
        penetration = self.place.contact.onset - distance
        if acting:
            return penetration, force, -parting / acting
        return penetration, force, float(self.row(data) @ velocity)

    def _find_pair(self, geoms: list[list[int]], dims: list[int]) -> None:
        """Find the pair's contacts among all."""
        sides = self.place.pair.sides
        self._geoms = geoms
        self._mine = []
        for i, (a, b) in enumerate(geoms):
            # A geom of the first counts 1, one of the second 2: only one of each add up to 3.
            if sides[a] + sides[b] == 3:
                is_turned = bool(sides[a] == 2)
                is_pyramid = self._pyramid and dims[i] > 1
                self._mine.append((i, is_turned, is_pyramid))
        self.others = len(self._mine) < len(geoms)

    def _use_contact(self) -> None:
        """Take the point and the normal from the last contacts."""
        if self._unread is None:
            return
        mine, points, frames, distance = self._unread
        first, is_turned, _ = mine[0]
        if len(mine) == 1:
            self._point = points[first]
        else:
            self._point = points[[i for i, _, _ in mine]].mean(axis=0)
        self._normal = frames[first, :3]
        if is_turned:
            self._normal = -self._normal
        # On the moving body's surface: MuJoCo has the point halfway to the other's.
        if self.along is not None:
            self._point = self._point - 0.5 * distance * self._normal
        self._unread = None

    def depth(self, data: Any, guess: float) -> float:
        """Penetration beyond the onset without a contact, m; the guess for
        shapes without a distance.
        """
        if not math.isfinite(self.place.gap):
            return guess
        return self.place.gap - float(self.place.pair.nearest(data).distance)

    def other_geoms(self, data: Any) -> set[int]:
        """Numbers of the geoms that touch either one's tree of bodies,
        besides the pair's own contact.
        """
        sides = self.place.pair.sides
        in_tree = self.place.pair.in_trees
        geoms = data.contact.geom
        # A geom of -1 is none: the contact is that of a flex.
        acting = (data.contact.efc_address >= 0) & (geoms.min(axis=1) >= 0)
        geoms = geoms[acting & (sides[geoms].sum(axis=1) != 3)]
        inside = in_tree[geoms]
        one_is_inside = inside.any(axis=1)[:, None]
        both_are_inside = inside.all(axis=1)[:, None]
        # The geom outside the trees; both, where the trees touch themselves.
        is_named = one_is_inside & (~inside | both_are_inside)
        return set(geoms[is_named].tolist())


def with_kinematics(data: Any, model: Any) -> Any:
    """`data` with its kinematics computed at its state."""
    mujoco = backend()
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data
