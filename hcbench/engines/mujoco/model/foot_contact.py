"""One contact for all feet of a robot: a damped spring that is smooth in frequency and damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs
from hcbench.engines.mujoco.model.find_pair import named_pair
from hcbench.engines.mujoco.model.write_pairs import (
    Written,
    colliding_geoms,
    contact_text,
    elliptic_option,
    friction_values,
    name_geoms,
    set_pair,
    spec_of,
    taken_pairs,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.sim.model_under_test import Request

    Geoms = tuple[int, int]

# MuJoCo's own impedance: with it solref alone makes the contact.
SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
# MuJoCo raises a shorter time constant to so many steps.
_LEAST_STEPS = 2.0


@dataclass(frozen=True, slots=True)
class FootContact:
    """A contact in the coordinates in which the rebound of a robot is smooth.

    frequency: w = 1/(timeconst dampratio), rad/s. damping: ζ, the dampratio. impratio: of the whole
    model, with elliptic cones; 0 for the model's own cone and impratio.
    """

    frequency: float
    damping: float
    impratio: float = 0.0

    @property
    def solref(self) -> tuple[float, float]:
        """MuJoCo's timeconst, s, and dampratio, in the digits that are written."""
        return (
            float(f"{1.0 / (self.frequency * self.damping):.5g}"),
            float(f"{self.damping:.5g}"),
        )

    def is_kept(self, timestep: float) -> bool:
        """Say whether MuJoCo keeps the time constant at a step, s."""
        return self.solref[0] >= _LEAST_STEPS * timestep


def foot_geoms(model: Any, requests: Sequence[Request]) -> list[Geoms]:
    """All pairs of geoms of the pairs of the requests that MuJoCo collides.

    Raises UserError for more than can be written.
    """
    pairs = []
    for request in requests:
        assert request.pair is not None
        pairs.append(named_pair(model, request.pair))
    return colliding_geoms(model, pairs)


def set_contact(model: Any, plain: Any, geoms: Sequence[Geoms], contact: FootContact) -> None:
    """Change the <pair>s of geoms in a compiled model. plain: the model as it is."""
    for both in geoms:
        for number in explicit_pairs(model, both):
            model.pair_solref[number] = contact.solref
            model.pair_solimp[number] = SOLIMP
    model.opt.cone = plain.opt.cone
    model.opt.impratio = plain.opt.impratio
    if contact.impratio:
        model.opt.cone = int(backend().mjtCone.mjCONE_ELLIPTIC)
        model.opt.impratio = contact.impratio


def write_contact(source: Any, requests: Sequence[Request], contact: FootContact) -> Written:
    """The model of a source with the contact in <pair>s, in a spec of its own; friction, condim
    and margin stay.
    """
    spec = spec_of(source)
    model = spec.compile()
    geoms = foot_geoms(model, requests)
    notes: list[str] = []
    names = name_geoms(spec, model, geoms, notes)
    own = not notes and not taken_pairs(model, geoms)
    lines = []
    for one, other in geoms:
        both = (names[one], names[other])
        known = [pair for pair in spec.pairs if {pair.geomname1, pair.geomname2} == set(both)]
        values: dict[str, Any] = {"solref": list(contact.solref), "solimp": list(SOLIMP)}
        if not known:
            values |= friction_values(model, (one, other))
            if model.geom_margin[[one, other]].any():
                values |= {"margin": _onset(model, one, other), "gap": 0.0}
        elements = known or [spec.add_pair(geomname1=both[0], geomname2=both[1])]
        lines += [set_pair(element, both, values) for element in elements]
    option = ""
    if contact.impratio:
        option = elliptic_option(spec, contact.impratio, "feet slip less", notes)
    return Written(spec, contact_text(option, lines), notes, names, own)


def _onset(model: Any, one: int, other: int) -> float:
    """Distance from which the contact of two geoms acts, m.

    Versions of MuJoCo join margins and gaps in different ways: two spheres with those show it.
    """
    spec = backend().MjSpec()
    for geom in (one, other):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        margin = float(model.geom_margin[geom])
        gap = float(model.geom_gap[geom])
        body.add_geom(type=backend().mjtGeom.mjGEOM_SPHERE, size=[1, 0, 0], margin=margin, gap=gap)
    compiled = spec.compile()
    data = backend().MjData(compiled)
    backend().mj_forward(compiled, data)
    return float(data.contact.includemargin[0])
