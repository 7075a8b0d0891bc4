"""Contacts of a user's MuJoCo model in many worlds: one spring for each pair, whose damping and
friction differ from world to world.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs, integrator_name
from hcbench.engines.mujoco.model.find_pair import contact_in_force
from hcbench.engines.mujoco.model.open import as_requested, load
from hcbench.engines.mujoco.model.standing import standing
from hcbench.engines.mujoco.model.tune_model import pairs_to_tune
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.model.write_pairs import (
    ONE_STEP,
    SOFT_IMPEDANCE,
    label_of,
    one_step,
    slip_under_load,
    spec_of,
    spring_row,
    texts_of,
    written,
)
from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.sim.capabilities import LEAST_MOBILITY, ContactFamily

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from hcbench.engines.mujoco.model.write_pairs import PairToTune
    from hcbench.sim.model_under_test import ModelUnderTest, Output, Request, Texts
    from hcbench.sim.rest import Standing
    from hcbench.terms.impact import Floats

# Impedances d of a spring. A soft one hardly feels what slides: friction that stops a slip v in a
# step h adds d μ v/h to it, in units of the mass. A stiff one takes half of what servos and weight
# do to the approach out of it: feet of robots reach a higher e.
_SOFT = SOFT_IMPEDANCE
_STIFF = 0.5
# Least weight d/(1 - d) of a friction row.
_FRICTION_WEIGHT = 1.0
# Least impratio of a stiff spring, with which feet creep less than with MuJoCo's default.
_STIFF_IMPRATIO = 10.0
# Steps of the half period of a spring. In a longer contact chance moves e less, but it is deeper.
_STEPS = (16, 12, 10, 8, 6, 5, 4)
# A friction row creeps less than the user's own by this factor.
_LESS_CREEP = 1.1


class PairWorlds(ContactFamily):
    """<pair> elements of a model, whose solref and friction differ from world to world.

    The parameters are the fields of `MjModel` by name, with a world as their first axis:
    `pair_solref` (n, npair, 2), `pair_solimp` (n, npair, 5) and `pair_friction` (n, npair, 5).
    """

    def __init__(
        self,
        source: Any,
        pairs: Sequence[PairToTune],
        name: str,
        row_of: Callable[[PairToTune, float], ConstraintRow],
        impratio: float,
    ) -> None:
        """Write a row of a middling e into a copy of the model, and compile it.

        source: a file, MJCF text or an MjSpec.
        pairs: that get a row each.
        name: of the family, for the user.
        row_of: the row of a pair that has a nominal e.
        impratio: of the whole model; 0: its own.
        Raises UserError for a source that cannot be written.
        """
        self.name = name
        self._source = source
        self._pairs = pairs
        self._row_of = row_of
        self._written = written(source, [(pair, (row_of(pair, 0.5),)) for pair in pairs], impratio)
        self._model = self._written.spec.compile()
        self.notes = tuple(self._written.notes)
        self.slides = any(pair.load.slides for pair in pairs)
        self.mobility = tuple(pair.sliding_mobility / pair.load.strength for pair in pairs)
        # Of each <pair>: the index in `pairs` of its pair, its number in the model, and its solref
        # over the row's, (2,): `written` scales it by MuJoCo's estimate of the mass there.
        self._numbers: list[tuple[int, int, Floats]] = []
        for of_pair, pair in enumerate(pairs):
            asked = np.array(row_of(pair, 0.5).solref)
            for geoms in pair.geoms:
                (number,) = explicit_pairs(self._model, geoms)
                # A number that is 0 is so at every e.
                share = self._model.pair_solref[number] / np.where(asked, asked, 1.0)
                self._numbers.append((of_pair, number, share))

    def parameters(self, nominal: Floats, friction: Floats | None) -> dict[str, Floats]:
        """solref, solimp and friction of every <pair> of the model in each of n worlds, by the
        fields of MjModel.

        nominal: e that each contact would have on a free body, (n, pairs).
        friction: μ of each world, (n,); None: the model's own. <pair>s of the model's own that are
        not randomised have their own values.

        Shapes: (n, npair, 2), (n, npair, 5) and (n, npair, 5). Only solref depends on e.
        """
        count = len(nominal)
        solref = np.repeat(self._model.pair_solref[None], count, axis=0)
        frictions = np.repeat(self._model.pair_friction[None], count, axis=0)
        for of_pair, number, share in self._numbers:
            pair = self._pairs[of_pair]
            for world, e in enumerate(nominal[:, of_pair].tolist()):
                solref[world, number] = share * self._row_of(pair, e).solref
            if friction is not None:
                # The first two numbers are the sliding μ, of both ways along the plate.
                frictions[:, number, :2] = friction[:, None]
        solimp = np.repeat(self._model.pair_solimp[None], count, axis=0)
        return {"pair_solref": solref, "pair_solimp": solimp, "pair_friction": frictions}

    def open(self, request: Request) -> MujocoModel:
        """A copy of the model with the <pair>s, with the request's step and gravity."""
        label = label_of(self._source)
        return MujocoModel(as_requested(self._model.__copy__(), request), label, None, request)

    def set(self, model: ModelUnderTest, parameters: Mapping[str, Floats], world: int) -> None:
        """Write one world's arrays into the fields of the compiled model that they are named after."""
        assert isinstance(model, MujocoModel)
        for name, values in parameters.items():
            getattr(model.model, name)[:] = values[world]

    def standing(self, models: Sequence[ModelUnderTest]) -> Standing:
        """Measure how the model stands, in its plain steps."""
        return standing([model for model in models if isinstance(model, MujocoModel)])

    def texts(self, output: Output) -> Texts:
        """The <pair> lines, with the <option> that they need, and the whole model with them."""
        return texts_of(self._source, self._written, (), output)


def families(source: Any, requests: Sequence[Request]) -> Iterator[PairWorlds]:
    """Yield families of contacts for pairs of a user's model; first those whose e depends least on
    where in a step a contact starts.

    source: a file, MJCF text or an MjSpec.
    requests: one a pair.
    A row of one step comes first where nothing slides and the integrator is not RK4; then springs,
    the softest and longest first.
    Raises SceneError for a model that does not compile, UserError where a pair cannot be measured
    or no <pair> keeps its e.
    """
    load(source, requests[0])
    model = spec_of(source).compile()
    pairs = pairs_to_tune(model, label_of(source), [[request] for request in requests])
    slides = any(pair.load.slides for pair in pairs)
    if not slides and integrator_name(model) != "RK4":
        yield PairWorlds(source, pairs, ONE_STEP, _one_step_row, impratio=0.0)
    for kind, impedance in (("spring", _SOFT), ("stiff spring", _STIFF)):
        impratio = _impratio(model, pairs, impedance) if slides else 0.0
        for steps in _STEPS:
            row_of = partial(_spring_row, impedance, impratio, steps)
            yield PairWorlds(source, pairs, f"{kind} of {steps} steps", row_of, impratio)


def _one_step_row(pair: PairToTune, e: float) -> ConstraintRow:
    (row,) = one_step(e, pair.load.timestep)
    return row


def _spring_row(
    impedance: float, impratio: float, steps: int, pair: PairToTune, e: float
) -> ConstraintRow:
    """Contact row of a spring with a nominal e, whose friction stops a slip in one step where the
    cone allows it.

    impedance: d of the spring and its damper.
    impratio: of the whole model; 0: no pair slides.
    steps: in half a period of the spring.
    pair: whose contact it is, with its load.
    e: on a free body.
    A stiff spring, of a high impedance, sets an acceleration whatever the mass, so it is not scaled
    by the load.
    """
    load = pair.load
    if impedance > _SOFT:
        load = replace(load, strength=1.0)
    row = spring_row(e, steps, load, (impedance, impedance, 1.0, 0.5, 1.0))
    if not _can_slide(pair):
        return row
    weight = _weight(pair, impedance, impratio)
    # MuJoCo's row takes w/(1 + w) of a slip v in a step if its damping is d/h, in 1/s: this one is
    # so much stronger that it takes all.
    damping = impedance * (1.0 + weight) / weight / load.timestep
    return ConstraintRow(row.solref, row.solimp, solreffriction=(0.0, -damping))


def _can_slide(pair: PairToTune) -> bool:
    """Say whether a pair has friction, and joints that let it slide."""
    return pair.load.slides and pair.sliding_mobility > LEAST_MOBILITY


def _weight(pair: PairToTune, impedance: float, impratio: float) -> float:
    """Weight d/(1 - d) of a pair's friction row along the way that slides most easily."""
    return impedance / (1.0 - impedance) * impratio * pair.sliding_mobility


def _impratio(model: Any, pairs: Sequence[PairToTune], impedance: float) -> float:
    """Choose the impratio of the whole model with which the friction of every pair is strong enough
    to hold, and creeps no faster than that of the user's own contact; two digits.

    model: compiled, as the user has it.
    pairs: those that cannot slide ask for nothing.
    impedance: of the normal row.
    """
    own = float(model.opt.impratio)
    is_elliptic = model.opt.cone == backend().mjtCone.mjCONE_ELLIPTIC
    # MuJoCo uses an impratio with elliptic cones alone.
    needed = own if is_elliptic else 1.0
    if impedance > _SOFT:
        needed = max(needed, _STIFF_IMPRATIO)
    solimp = (impedance, impedance, 1.0, 0.5, 1.0)
    for pair in pairs:
        if not _can_slide(pair):
            continue
        needed = max(needed, _FRICTION_WEIGHT / _weight(pair, impedance, 1.0))
        # The damping of a row of any weight is at least this, 1/s.
        damping = impedance / pair.load.timestep
        slip_after = slip_under_load((0.0, -damping), solimp, impedance)
        # The user's contact, where it lies deep: at its full impedance.
        now = contact_in_force(model, *pair.geoms[0])
        slip_before = slip_under_load(now["solref"], now["solimp"], now["solimp"][1])
        needed = max(needed, _LESS_CREEP * own * slip_after / slip_before)
    return float(f"{needed:.2g}")
