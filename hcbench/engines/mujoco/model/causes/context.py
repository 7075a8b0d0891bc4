"""Context of the search for causes: a model, its impacts, and its contact as written and as used."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, geom_name, integrator_name
from hcbench.engines.mujoco.model.causes.fixes import numbers
from hcbench.engines.mujoco.scene.rows import SoftConstraint
from hcbench.measuring.diagnose import BOUNCY, constant_e, speeds_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.terms.impact import Floats, Impact

# MuJoCo's defaults: a geom that has them says nothing of its contact.
DEFAULT_SOLREF = (0.02, 1.0)
_DEFAULT_SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)


@dataclass(frozen=True)
class Context:
    """A pair in a model, and the impacts to explain.

    place: the pair at touch, the moving body first, with MuJoCo's contact of it.
    impacts: of the launches; empty where a body at rest is to be explained.
    wanted: e over speed, where the user named one.
    gravity: (3,), m/s², in the world.
    shares: what each cause took, as a share of the speed at touch.
    """

    place: PairAtTouch
    impacts: Sequence[Impact]
    wanted: RestitutionCurve | None
    gravity: tuple[float, ...]
    shares: Mapping[str, float] = field(default_factory=dict)

    @property
    def model(self) -> Any:
        """The MjModel that is measured."""
        return self.place.pair.model

    @cached_property
    def written(self) -> SoftConstraint | None:
        """The contact as its author wrote it; None where different ones add up."""
        contact, _ = written_contact(self.place)
        return contact

    @cached_property
    def used(self) -> SoftConstraint | None:
        """The contact as the engine uses it; None where different ones add up.

        With refsafe, MuJoCo's default, no time constant is below two steps.
        """
        parameters = {(row.solref, row.solimp) for row in self.place.contact.rows}
        if len(parameters) > 1:
            return None
        ((solref, solimp),) = parameters
        safe = not self.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_REFSAFE
        shortest = 2 * self.timestep if safe else 0.0
        return SoftConstraint(solref, solimp, self.timestep, shortest)  # type: ignore[arg-type]

    @property
    def geoms(self) -> tuple[int, int]:
        """The first two geoms that touch, the moving body first."""
        return _in_order(self.place, self.place.contact.geoms)

    @property
    def all_geoms(self) -> tuple[int, ...]:
        """Numbers of all geoms that touch, those of the moving body first, each once."""
        moving = []
        others = []
        for row in self.place.contact.rows:
            first, second = _in_order(self.place, row.geoms)
            moving.append(first)
            others.append(second)
        # A dict keeps each geom once, in order.
        return tuple(dict.fromkeys(moving + others))

    @property
    def names(self) -> str:
        """Names of all geoms that touch, as a fix names them."""
        *some, last = (geom_name(self.model, g) for g in self.all_geoms)
        return f"{', '.join(some)} and {last}"

    @property
    def integrator(self) -> str:
        """Integrator of the model as XML spells it."""
        return integrator_name(self.model)

    @property
    def timestep(self) -> float:
        """Time step of the model, s."""
        return float(self.model.opt.timestep)

    @property
    def overridden(self) -> bool:
        """True if o_solref and o_solimp replace those of every contact."""
        return bool(self.model.opt.enableflags & backend().mjtEnableBit.mjENBL_OVERRIDE)

    @cached_property
    def written_e(self) -> float:
        """e of the contact as its author wrote it, at the median launch speed; NaN without one."""
        if self.written is None:
            return np.nan
        # The median by hand: np.median would import numpy.ma.
        speeds = sorted(speeds_of(self.impacts))
        median = (speeds[(len(speeds) - 1) // 2] + speeds[len(speeds) // 2]) / 2
        return self.written.restitution(median)

    def goal(self) -> float:
        """The one e that a setting to paste should have: the target's middle e over the speeds of
        the impacts; without a target, the e of the author's own contact if that is above 0.5; else
        BOUNCY.
        """
        e = constant_e(self.impacts, self.wanted)
        # Where the model itself asks for a bounce, that is taken for what its author means.
        if e is None:
            e = self.written_e if self.written_e > 0.5 else BOUNCY
        return e


def tuned_rows(context: Context, e: float) -> str:
    """The fix of a pair with friction, for one e: no attribute of a geom alone bounces and slides."""
    return (
        f"{context.names}: what hcbench tune writes for e = {e:.3g} in this model; with friction "
        "a solref alone throws up what slides"
    )


def written_contact(place: PairAtTouch) -> tuple[SoftConstraint | None, str]:
    """The contact as the author wrote its solref and solimp, before MuJoCo changes them, and the two
    as text.

    place: the pair at touch. None in place of the contact if the geoms of several points have
    different ones, which add up.
    """
    rows = place.contact.rows
    model = place.pair.model
    written = {_as_written(model, _in_order(place, row.geoms)) for row in rows}
    if len(written) > 1:
        return None, f"{len(rows)} different contacts add up: the model asks for no one e"
    ((solref, solimp),) = written
    timestep = float(model.opt.timestep)
    contact = SoftConstraint(solref, solimp, timestep, clamped=False)  # type: ignore[arg-type]
    default = "default " if same(solref, DEFAULT_SOLREF) else ""
    return contact, f"{default}solref {numbers(solref)}, solimp {numbers(solimp)}"


def _in_order(place: PairAtTouch, geoms: tuple[int, int]) -> tuple[int, int]:
    """The moving body first."""
    return geoms if place.pair.sides[geoms[0]] == 1 else (geoms[1], geoms[0])


def _as_written(model: Any, geoms: tuple[int, int]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """solref and solimp that the author wrote for two geoms: those of their <pair>, else those of
    the first geom, or of the second where the first has MuJoCo's default.

    geoms: numbers, the moving body's first.
    """
    source = "pair"
    ids = explicit_pairs(model, geoms)[:1]
    if not ids:
        source = "geom"
        ids = list(geoms)
    solrefs = getattr(model, f"{source}_solref")[ids]
    solimps = getattr(model, f"{source}_solimp")[ids]
    return _first_set(solrefs, DEFAULT_SOLREF), _first_set(solimps, _DEFAULT_SOLIMP)


def _first_set(values: Floats, default: tuple[float, ...]) -> tuple[float, ...]:
    """The value of the first row that is not MuJoCo's default; the default where all rows have it.

    values: (rows, k).
    default: k numbers.
    """
    for value in values:
        if not same(value, default):
            return tuple(value.tolist())
    return default


def same(a: Sequence[float] | Floats, b: Sequence[float]) -> bool:
    """Say whether two parameters are equal in the digits of XML."""
    return bool(np.allclose(a, b, rtol=1e-12, atol=0))
