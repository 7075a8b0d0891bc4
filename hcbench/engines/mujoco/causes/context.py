"""What the search for causes looks at: a model, its impacts, and its contact as written and as used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.causes.fixes import numbers
from hcbench.engines.mujoco.model import explicit_pairs, geom_name, integrator_name
from hcbench.engines.mujoco.rows import SoftConstraint
from hcbench.measure.causes import BOUNCY, constant_e

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.place import PairAtTouch
    from hcbench.impact import Floats, Impact
    from hcbench.laws.restitution import RestitutionCurve

DEFAULT_SOLREF = (0.02, 1.0)
_DEFAULT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)


@dataclass(frozen=True, slots=True)
class Context:
    """A model with a pair in it, and the impacts to explain.

    asked, delivered: the contact as its author wrote it and as the engine uses it; None where different ones
    add up. gravity: m/s^2.
    """

    model: Any
    place: PairAtTouch
    asked: SoftConstraint | None
    delivered: SoftConstraint | None
    impacts: Sequence[Impact]
    wanted: RestitutionCurve | None
    gravity: tuple[float, ...]

    @property
    def geoms(self) -> tuple[int, int]:
        """The first two geoms that touch, the moving one first."""
        return _in_order(self.place, self.place.contact.rows[0][2])

    @property
    def all_geoms(self) -> tuple[int, ...]:
        """All geoms that touch, the moving ones first."""
        moving, others = zip(*(_in_order(self.place, row[2]) for row in self.place.contact.rows), strict=True)
        return tuple(dict.fromkeys(moving + others))

    @property
    def names(self) -> str:
        """Of all geoms that touch, as a fix names them."""
        *some, last = (geom_name(self.model, g) for g in self.all_geoms)
        return f"{', '.join(some)} and {last}"

    @property
    def integrator(self) -> str:
        """As XML spells it."""
        return integrator_name(self.model)

    @property
    def timestep(self) -> float:
        """s."""
        return float(self.model.opt.timestep)

    @property
    def overridden(self) -> bool:
        """Whether o_solref and o_solimp replace those of every contact."""
        return bool(self.model.opt.enableflags & backend().mjtEnableBit.mjENBL_OVERRIDE)

    @property
    def asked_e(self) -> float:
        """e of the contact as written, at the median launch speed; NaN without one."""
        speed = float(np.median([i.launch.speed for i in self.impacts]))
        return self.asked.restitution(speed) if self.asked is not None else np.nan

    def goal(self) -> float:
        """The one e that a pasted constant setting should have."""
        e = constant_e(self.impacts, self.wanted)
        if e is None:
            e = self.asked_e if self.asked_e > 0.5 else BOUNCY
        return e


def _in_order(place: PairAtTouch, geoms: tuple[int, int]) -> tuple[int, int]:
    """The moving one first."""
    return geoms if geoms[0] in place.pair.first.geoms else (geoms[1], geoms[0])


def _as_written(
    model: Any, place: PairAtTouch, geoms: tuple[int, int]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(solref, solimp) that the author wrote for two geoms: of their <pair>, else of the moving geom, or of
    the other one where that has the default.
    """
    source, ids = "pair", explicit_pairs(model, geoms)[:1]
    if not ids:
        source, ids = "geom", list(_in_order(place, geoms))
    solrefs, solimps = getattr(model, f"{source}_solref")[ids], getattr(model, f"{source}_solimp")[ids]
    return _first_set(solrefs, DEFAULT_SOLREF), _first_set(solimps, _DEFAULT_SOLIMP)


def _first_set(values: Floats, default: tuple[float, ...]) -> tuple[float, ...]:
    return next((tuple(value.tolist()) for value in values if not same(value, default)), default)


def same(a: Sequence[float] | Floats, b: Sequence[float]) -> bool:
    """Equal as far as XML goes."""
    return bool(np.allclose(a, b, rtol=1e-12, atol=0))


def asked_law(model: Any, place: PairAtTouch) -> tuple[SoftConstraint | None, str]:
    """What the author's solref and solimp ask for, in words too; None where different contacts add up."""
    rows = place.contact.rows
    written = {_as_written(model, place, geoms) for _, _, geoms in rows}
    if len(written) > 1:
        return None, f"{len(rows)} different contacts add up: the model asks for no one e"
    ((solref, solimp),) = written
    law = SoftConstraint(solref, solimp, float(model.opt.timestep), clamped=False)  # type: ignore[arg-type]
    default = "default " if same(solref, DEFAULT_SOLREF) else ""
    return law, f"{default}solref {numbers(solref)}, solimp {numbers(solimp)}"


def delivered_law(model: Any, place: PairAtTouch) -> SoftConstraint | None:
    """What the engine made of it: mixed, clamped and kept safe; None where different contacts add up."""
    used = {(solref, solimp) for solref, solimp, _ in place.contact.rows}
    if len(used) > 1:
        return None
    ((solref, solimp),) = used
    h = float(model.opt.timestep)
    safe = not model.opt.disableflags & backend().mjtDisableBit.mjDSBL_REFSAFE
    return SoftConstraint(solref, solimp, h, shortest=2 * h if safe else 0.0)  # type: ignore[arg-type]
