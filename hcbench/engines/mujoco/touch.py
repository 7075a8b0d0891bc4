"""MuJoCo: two geoms brought just to touch, by the engine's own collision functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model import approach_row
from hcbench.engines.mujoco.pair import Side, height_field, normal_between
from hcbench.sim.touch import travel_by_distance, travel_by_scan

if TYPE_CHECKING:
    from hcbench.impact import Floats

_DEPTHS = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)  # of the smaller one's size: where contacts are looked for
_AGAINST = 0.5  # of the approach, that must be along the normal of a contact


@dataclass(frozen=True, slots=True)
class Contact:
    """The engine's contact of the pair at touch, averaged over its points; SI.

    normal: from the first side to the second. onset: distance at which its force begins to act.
    rows: (solref, solimp, geoms) of each point.
    """

    normal: Floats
    point: Floats
    onset: float
    distance: float
    rows: tuple[tuple[tuple[float, ...], tuple[float, ...], tuple[int, int]], ...]


def side_table(model: Any, first: Side, second: Side) -> Any:
    """(ngeom + 1,): 1 for geoms of the first side, 2 for the second's, 0 else; -1 indexes the last, a 0."""
    table = np.zeros(model.ngeom + 1, dtype=np.int8)
    table[list(first.geoms)], table[list(second.geoms)] = 1, 2
    return table


def read_contact(model: Any, data: Any, table: Any) -> Contact | None:
    """The pair's contact in `data`, None where it has none that acts."""
    rows, points, normals, distances, onsets = [], [], [], [], []
    for i in range(data.ncon):
        contact = data.contact[i]
        a, b = (int(g) for g in contact.geom)
        if table[a] + table[b] != 3 or contact.exclude:
            continue
        rows.append((tuple(map(float, contact.solref)), tuple(map(float, contact.solimp)), (a, b)))
        points.append(contact.pos.copy())
        normals.append(contact.frame[:3] * (1.0 if table[a] == 1 else -1.0))
        distances.append(float(contact.dist))
        onsets.append(float(contact.includemargin))
    if not rows:
        return None
    normal = np.mean(normals, axis=0)
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0 else normals[0]
    return Contact(normal, np.mean(points, axis=0), max(onsets), min(distances), tuple(rows))


class Approach:
    """A motion of the model, along `move` from the configuration that `data` is in, towards a touch."""

    def __init__(self, model: Any, data: Any, first: Side, second: Side, move: Floats, size: float) -> None:
        self.model, self.data, self.first, self.second = model, data, first, second
        self.move, self.size, self.start = move, size, data.qpos.copy()
        self.table = side_table(model, first, second)

    def touch(self) -> tuple[Floats, Contact] | None:
        """(qpos at touch, contact); None where the engine makes no contact of the two."""
        far = travel_by_distance(self._distance, self.size)
        found = self._below(far)
        if found is None:  # MuJoCo gives the distance of some shapes only roughly
            before, behind = self._window()
            begun = travel_by_scan(lambda f: self._contact(f) is not None, far - before, far + behind)
            found = None if begun is None else self._below(begun)
            if begun is None or found is None:
                return None
            far = begun
        depth, contact = found
        for _ in range(2):  # the engine's own collision function has the last word on where they touch
            far += contact.distance - contact.onset + depth
            contact = self._contact(far + depth) or contact
        far += contact.distance - contact.onset + depth
        self._go(far)
        return self.data.qpos.copy(), contact

    def _go(self, far: float) -> None:
        """Put `data` `far` along the motion, contacts and mass matrix included."""
        mujoco = backend()
        self.data.qpos[:] = self.start
        mujoco.mj_integratePos(self.model, self.data.qpos, self.move, far)
        mujoco.mj_fwdPosition(self.model, self.data)

    def _contact(self, far: float) -> Contact | None:
        self._go(far)
        return read_contact(self.model, self.data, self.table)

    def _distance(self, far: float) -> float:
        self._go(far)
        return normal_between(self.model, self.data, self.first, self.second)[0]

    def _below(self, far: float) -> tuple[float, Contact] | None:
        """(depth, contact) at the least depth with a contact against the motion: one just begun may have any
        normal.
        """
        for share in _DEPTHS:
            contact = self._contact(far + share * self.size)
            if contact is not None and self._opposes(contact):
                return share * self.size, contact
        return None

    def _opposes(self, contact: Contact) -> bool:
        bodies = self.first.body, self.second.body
        row = approach_row(self.model, self.data, *bodies, contact.point, contact.normal)
        return abs(float(row @ self.move)) > _AGAINST

    def _window(self) -> tuple[float, float]:
        """How far before and behind the rough distance a contact may begin, m."""
        field = height_field(self.model, self.first, self.second)
        if field < 0:
            return self.size, self.size
        geoms = [g for g in (*self.first.geoms, *self.second.geoms) if g != field]
        bound = max(float(self.model.geom_rbound[g]) for g in geoms)
        return bound, 2 * bound + float(self.model.hfield_size[self.model.geom_dataid[field]][2])
