"""MuJoCo: what the search for causes looks at, and what the model asks of its contact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.causes import fixes
from hcbench.engines.mujoco.model import geom_name
from hcbench.engines.mujoco.rows import SoftConstraint
from hcbench.measure.causes import BOUNCY, constant_e

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.place import Placement
    from hcbench.impact import Impact
    from hcbench.laws.restitution import RestitutionCurve

DEFAULT_SOLREF = (0.02, 1.0)
DEFAULT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
FLOOR_SHIFT = 0.01  # of e, that clamping impedances must make to be named


@dataclass(frozen=True, slots=True)
class Context:
    """All that the search for causes looks at."""

    model: Any
    place: Placement
    asked: SoftConstraint | None
    delivered: SoftConstraint | None
    impacts: Sequence[Impact]
    wanted: RestitutionCurve | None
    gravity: tuple[float, ...]

    @property
    def geoms(self) -> tuple[int, int]:
        """The first two geoms that touch, the moving one first."""
        return in_order(self.place, self.place.contact.rows[0][2])

    @property
    def all_geoms(self) -> tuple[int, ...]:
        """All geoms that touch, the moving ones first."""
        pairs = [in_order(self.place, geoms) for _, _, geoms in self.place.contact.rows]
        return tuple(dict.fromkeys([moving for moving, _ in pairs] + [other for _, other in pairs]))

    @property
    def names(self) -> str:
        """Of all geoms that touch, as a fix names them."""
        *some, last = (geom_name(self.model, g) for g in self.all_geoms)
        return f"{', '.join(some)} and {last}"

    @property
    def integrator(self) -> str:
        """As XML spells it."""
        return fixes.integrator_name(self.model)

    @property
    def timestep(self) -> float:
        """s."""
        return float(self.model.opt.timestep)

    def goal(self) -> float:
        """The one e that a pasted constant setting should have."""
        e = constant_e(self.impacts, self.wanted)
        if e is None and self.asked is not None:
            e = self.asked.restitution(float(np.median([i.launch.speed for i in self.impacts])))
            e = e if e > 0.5 else None
        return BOUNCY if e is None else e


def in_order(place: Placement, geoms: tuple[int, int]) -> tuple[int, int]:
    """The moving one first."""
    return geoms if geoms[0] in place.first.geoms else (geoms[1], geoms[0])


def explicit_pair(model: Any, geoms: tuple[int, int]) -> int:
    """Number of the <pair> of the two geoms, -1 without one."""
    both = {
        (int(a), int(b)): i for i, (a, b) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True))
    }
    return both.get(geoms, both.get(geoms[::-1], -1))


def _intended(
    model: Any, place: Placement, geoms: tuple[int, int]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(solref, solimp) that the author wrote for the two: the moving geom's unless it has the defaults."""
    moving, other = in_order(place, geoms)
    pair = explicit_pair(model, geoms)
    if pair >= 0:
        return tuple(map(float, model.pair_solref[pair])), tuple(map(float, model.pair_solimp[pair]))
    refs = [tuple(map(float, model.geom_solref[g])) for g in (moving, other)]
    imps = [tuple(map(float, model.geom_solimp[g])) for g in (moving, other)]
    ref = next((r for r in refs if not same(r, DEFAULT_SOLREF)), DEFAULT_SOLREF)
    imp = next((i for i in imps if not same(i, DEFAULT_SOLIMP)), DEFAULT_SOLIMP)
    return ref, imp


def same(a: Sequence[float], b: Sequence[float]) -> bool:
    """Equal as far as XML goes."""
    return bool(np.allclose(a, b, rtol=1e-12, atol=0))


def overridden(model: Any) -> bool:
    """Whether o_solref and o_solimp replace those of every contact."""
    return bool(model.opt.enableflags & backend().mjtEnableBit.mjENBL_OVERRIDE)


def asked_law(model: Any, place: Placement) -> tuple[SoftConstraint | None, str]:
    """What the author's own solref and solimp ask for, in words too; None where different contacts add up."""
    intended = {_intended(model, place, geoms) for _, _, geoms in place.contact.rows}
    if len(intended) > 1:
        return None, f"{len(place.contact.rows)} different contacts add up: the model asks for no one e"
    ((solref, solimp),) = intended
    law = SoftConstraint(solref, solimp, float(model.opt.timestep), clamped=False)  # type: ignore[arg-type]
    where = "default " if same(solref, DEFAULT_SOLREF) else ""
    return law, f"{where}solref {fixes.numbers(solref)}, solimp {fixes.numbers(solimp)}"


def delivered_law(model: Any, place: Placement) -> SoftConstraint | None:
    """What the engine made of it: mixed, clamped and kept safe."""
    made = {(solref, solimp) for solref, solimp, _ in place.contact.rows}
    if len(made) > 1:
        return None
    ((solref, solimp),) = made
    mujoco = backend()
    h = float(model.opt.timestep)
    safe = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE
    return SoftConstraint(solref, solimp, h, shortest=2 * h if safe else 0.0)  # type: ignore[arg-type]
