"""MuJoCo's models in engines that step them: scenes, and what they do
otherwise than MuJoCo, by name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, geom_name, speed_reading
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.sim.model_under_test import Suspect
from hcbench.sim.read_impact import SpeedReading

if TYPE_CHECKING:
    from hcbench.sim.shared_model import SharedModelEngine
    from hcbench.terms.impact import Floats, Impact

    Rows = Sequence[tuple[Sequence[float], Sequence[float]]]

# Names in an engine's `lacks`.
ADHESION = "adhesion"
PAIRS = "several pairs"
IMPEDANCE = "impedance in float32"
# A solimp of a higher power underflows in float32, which ends at 2^-149.
_HIGHEST_POWER = 100.0
# In forces of a contact: with so much adhesion MuJoCo Warp's e is wrong by 1e-4,
# with 50 times as much by 0.06.
_ADHESION = 1000.0
# Of the first impedance float32 tells 1 - d to 2e-6, of the second to 1e-5.
_KEPT = 0.9
_HIGHEST = 0.99


class LentScene(NamedTuple):
    """A compiled scene, MuJoCo's state of it at rest, also as positions and velocities, shape
    (13,); whether its steps are exact in free flight.
    """

    model: Any
    start: Any
    rest: Floats
    exact_flight: bool


def load_scene(xml: str, contact: bool) -> LentScene:
    """Compile a scene of a ball with a free joint for an engine that steps MuJoCo's models.

    xml: its MJCF.
    contact: false to let bodies pass through each other.
    """
    mujoco = backend()
    model = mujoco.MjModel.from_xml_string(xml)
    if not contact:
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    start = mujoco.MjData(model)
    exact = speed_reading(model) is SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
    return LentScene(model, start, np.append(start.qpos, start.qvel), exact)


def differences(
    model: Any,
    engine: SharedModelEngine,
    bits: int,
    geoms: Sequence[int] = (),
    rows: Rows = (),
) -> list[Suspect]:
    """List the suspects in a MuJoCo model that make another contact in an engine that steps such
    models, by what the engine lacks or by its shorter numbers; empty without any.

    bits: of the engine's numbers, 32 or 64.
    geoms: numbers of those whose <pair>s are looked at; (): all of the model.
    rows: (solref, solimp) of the contact; (): those of every <pair> and geom of the model.
    """
    pairs = list(range(model.npair))
    if geoms:
        pairs = explicit_pairs(model, geoms)
    if not rows:
        solrefs = np.concatenate([model.pair_solref, model.geom_solref])
        solimps = np.concatenate([model.pair_solimp, model.geom_solimp])
        rows = list(zip(solrefs, solimps, strict=True))
    differences = [*_adhesion(model, engine, pairs), *_several(model, engine, pairs)]
    if bits == 32:
        differences += [*_power(engine, rows), *_impedance(model, engine, rows, geoms)]
    return differences


def _adhesion(model: Any, engine: SharedModelEngine, pairs: Any) -> Iterator[Suspect]:
    """Suspect an engine that ignores the adhesion of <pair>s; at most one suspect.

    pairs: numbers of the <pair>s that are looked at.
    """
    adhesion = getattr(model, "pair_adhesion", np.zeros(model.npair))[pairs]
    if ADHESION in engine.lacks and adhesion.any():
        yield Suspect(
            "adhesion-dropped",
            f"{engine.title} drops a pair's adhesion without a warning: the damper cannot pull.",
            f"adhesion of up to {adhesion.max():.4g} N",
            f"Use `staggered-push`, whose pairs only push: `hcbench tune {engine.name}`",
            always_reported=True,
        )


def rounded_adhesion(
    model: Any,
    engine: SharedModelEngine,
    bits: int,
    geoms: Sequence[int],
    impacts: Sequence[Impact],
) -> Iterator[Suspect]:
    """Suspect a pair's adhesion beside which float32 has too few digits for the contact's force.

    bits: of the engine's numbers; nothing for 64, and for an engine without adhesion.
    geoms: whose <pair>s are looked at.
    impacts: with the contact's forces, N.
    """
    if ADHESION in engine.lacks or bits != 32:
        return
    # Old versions of MuJoCo have no adhesion.
    adhesions = getattr(model, "pair_adhesion", np.zeros(model.npair))
    pairs = explicit_pairs(model, geoms)
    highest = float(max(adhesions[pairs], default=0.0))
    forces = [impact.force_max for impact in impacts if impact.force_max > 0.0]
    if not forces or highest < _ADHESION * min(forces):
        return
    # N: twice the largest force pulls enough, and leaves float32 its digits.
    enough = float(f"{2.0 * max(forces):.2g}")
    yield Suspect(
        "adhesion-rounding",
        "A large adhesion makes float32 round the contact force: e is wrong by 0.001 and more.",
        f"adhesion {highest:.4g} N, contact forces from {min(forces):.3g} N in {engine.title}",
        _or_exact(f'adhesion="{enough:g}"', engine),
        partial(_hold_adhesion, pairs=pairs, enough=enough),
        always_reported=True,
    )


def _hold_adhesion(model: Any, pairs: Sequence[int], enough: float) -> None:
    model.pair_adhesion[pairs] = np.minimum(model.pair_adhesion[pairs], enough)


def _several(model: Any, engine: SharedModelEngine, pairs: Any) -> Iterator[Suspect]:
    """Suspect an engine that keeps only one of several <pair>s of the same two geoms; at most one
    suspect, for the two geoms with most.

    pairs: numbers of the <pair>s that are looked at.
    """
    if PAIRS not in engine.lacks:
        return
    # <pair>s of each two geoms, in ascending order.
    counts: Counter[tuple[int, int]] = Counter()
    firsts = model.pair_geom1[pairs].tolist()
    seconds = model.pair_geom2[pairs].tolist()
    for one, other in zip(firsts, seconds, strict=True):
        counts[min(one, other), max(one, other)] += 1
    # A loop of one round, or of none for a model without <pair>s.
    for geoms, count in counts.most_common(1):
        if count == 1:
            return
        names = " and ".join(geom_name(model, geom) for geom in geoms)
        yield Suspect(
            "pairs-dropped",
            f"{engine.title} keeps one of several pairs of the same two geoms, without a warning.",
            f"{count} pairs of {names}",
            f"A massless copy of the geom for each pair, as `hcbench tune {engine.name}` writes it",
            always_reported=True,
        )


def _power(engine: SharedModelEngine, rows: Rows) -> Iterator[Suspect]:
    """Suspect numbers of 32 bits, in which a high power of solimp underflows.

    rows: (solref, solimp) of the contact, one or more.
    """
    power = max(float(solimp[4]) for _, solimp in rows)
    if power > _HIGHEST_POWER:
        yield Suspect(
            "power-underflow",
            f"A solimp of power {power:.4g} underflows in float32: the contact is another one, or none.",
            f"{engine.title} computes in float32",
            _or_exact(f"A power up to {_HIGHEST_POWER:g}", engine),
            always_reported=True,
        )


def _impedance(
    model: Any, engine: SharedModelEngine, rows: Rows, geoms: Sequence[int]
) -> Iterator[Suspect]:
    """Suspect numbers of 32 bits, in which a bounce in one step rounds its impedance; nothing for
    an engine that keeps it.

    rows: (solref, solimp) of the contact; a row counts whose damper alone, in the direct format,
    reverses the body in a step.
    geoms: that the fix changes.
    """
    # solimps of the rows that reverse a body in one step.
    stiff = []
    for (stiffness, damping), solimp in rows:
        # In the direct format the numbers are negative: a damper of 1/h stops a body in a step h.
        if stiffness == 0 and -damping * model.opt.timestep > 1:
            stiff.append(solimp)
    highest = max((float(max(solimp[:2])) for solimp in stiff), default=0.0)
    if IMPEDANCE in engine.lacks and highest > _HIGHEST:
        # Width, midpoint and power stay.
        _, _, *curve = (float(x) for x in stiff[0])
        solimp = (_KEPT, _KEPT, *curve)
        yield Suspect(
            "impedance-rounding",
            "The impedance of a bounce in one step is rounded in float32: e is wrong by 0.0024.",
            f"impedance {highest:g} in {engine.title}",
            _or_exact(
                f'solimp="{fixes.numbers(solimp)}", as in `hcbench tune {engine.name}`', engine
            ),
            partial(fixes.set_contact, geoms=geoms, solref=None, solimp=solimp),
            always_reported=True,
        )


def _or_exact(fix: str, engine: SharedModelEngine) -> str:
    return f"{fix}; or {engine.exact}" if engine.exact else fix
