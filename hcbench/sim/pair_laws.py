"""Laws of pairs of a user's MJCF model, for engines that step many worlds of it.

The engines' own step functions differ; pairs, numbers and thresholds are the same in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hcbench.laws.restitution import ConstantRestitution, Restitution
from hcbench.sim.packages import suggest_names
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.units import is_real

# Steps of what presses a contact whose speed counts as rest.
STILL = 1.1
# Sweeps over the contacts that collide, at most.
SWEEPS = 100
# Share of the speed of rest with which a resting contact gives depth back, and the share of its
# load, over what its impedance lets by, that it bears at least.
RISE = 0.5
BEARS = 2.0
# e of the law depends on α v alone: its table, which is straight between the points to 3e-7.
LEAST_NUMBER, MOST_NUMBER = 1e-6, 1e3
NUMBERS = np.concatenate([[0.0], np.geomspace(LEAST_NUMBER, MOST_NUMBER, 8000)])
E = np.clip(Restitution(1.0).at(NUMBERS), 0.0, 1.0)

# What a pair's value is: α of eq. (16), α of eq. (2), or e.
LAW, LINEAR, CONSTANT = range(3)

Value = float | Restitution | ConstantRestitution
Pairs = Mapping[tuple[str, str], Value]
Names = Mapping[str, np.ndarray]
# Integrators of compiled MJCF models, by number.
_INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")
# Those with one contact force a step, which the functions have been tried with.
_ONE_FORCE = ("Euler", "implicitfast")


@dataclass(frozen=True)
class Laws:
    """Laws of all pairs, by number.

    pair_of: number of the pair of two geoms, (ngeom, ngeom); -1 of none.
    values: α, s/m, or a constant e, of each pair.
    readings: what each value is: that of LAW, LINEAR or CONSTANT.
    """

    pair_of: np.ndarray
    values: np.ndarray
    readings: np.ndarray


def laws_of(model: Any, pairs: Pairs, names: Names | None = None) -> Laws:
    """The laws of all pairs of geoms of a compiled MJCF model.

    pairs: {two names of geoms or bodies: α, s/m, or their law}.
    names: {name: ids of its geoms}; those of the model unless given.
    Raises UserError for what is not an MjModel, for names that it lacks, for none at all, for two
    parts of which none moves or that share a geom, and for two geoms that two pairs mean;
    SettingError for an integrator of several forces a step.
    """
    if type(model).__name__ != "MjModel":
        raise UserError("model", f"a {type(model).__name__}", "an MjModel")
    require_one_force(model.opt.integrator)
    if not pairs:
        raise UserError("pairs", "none", 'two names and a law, as {("ball", "floor"): 0.3}')
    # Number of the pair of each two geoms; -1 for those that are in none.
    pair_of = np.full((model.ngeom, model.ngeom), -1)
    values = []
    readings = []
    known = names or _names(model)
    for number, (both, value) in enumerate(pairs.items()):
        first, second = (_geoms(known, name) for name in both)
        # Bodies that are welded to the world, 0, do not move.
        moves = model.body_weldid[model.geom_bodyid[[*first, *second]]] != 0
        if not moves.any() or set(first) & set(second):
            raise UserError("pairs", f"{both} cannot meet", "two parts, one of which moves")
        if np.any(pair_of[np.ix_(first, second)] >= 0):
            raise UserError("pairs", f"{both} is in two pairs", "each pair once")
        pair_of[np.ix_(first, second)] = number
        pair_of[np.ix_(second, first)] = number
        number_of, reading = _read(both, value)
        values.append(number_of)
        readings.append(reading)
    return Laws(pair_of, np.array(values), np.array(readings))


def require_one_force(number: int) -> None:
    """Raise SettingError for an integrator, by its number in MJCF models, that was not tried."""
    integrator = _INTEGRATORS[int(number)]
    if integrator not in _ONE_FORCE:
        raise SettingError("integrator", integrator, "Euler or implicitfast")


def _read(names: tuple[str, str], value: Value) -> tuple[float, int]:
    """(α or e of a pair, what it is). Raises UserError for what is neither number nor law."""
    law: Restitution | ConstantRestitution
    if isinstance(value, Restitution | ConstantRestitution):
        law = value
    elif is_real(value):
        law = Restitution(float(value))
    else:
        raise UserError("pairs", f"{value!r} of {names}", "α in s/m, or a law")
    if isinstance(law, ConstantRestitution):
        return law.restitution, CONSTANT
    return law.alpha, LAW if law.reading == "law" else LINEAR


def _names(model: Any) -> Names:
    """Ids of the geoms of each body and geom with a name; a geom's name goes first."""
    bodies = {
        model.body(i).name: np.flatnonzero(model.geom_bodyid == i) for i in range(model.nbody)
    }
    return bodies | {model.geom(i).name: np.array([i]) for i in range(model.ngeom)}


def _geoms(names: Names, name: str) -> np.ndarray:
    """Ids of the geoms that a name means, (n,).

    Raises UserError for a name that there is not, and for a body without geoms.
    """
    if not name or name not in names:
        known = [each for each in names if each]
        raise UserError("pairs", f"no geom or body {name!r}", *suggest_names(name, known))
    if not names[name].size:
        raise UserError("pairs", f"body {name!r} has no geom", "one that can touch")
    return names[name]
