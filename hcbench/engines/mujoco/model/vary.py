"""A user's MuJoCo model whose pair has other contact parameters, without a change of any other
contact.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.model.bodies import explicit_pairs
from hcbench.engines.mujoco.model.find_pair import contact_in_force, find_pair
from hcbench.engines.mujoco.model.open import as_requested, load
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.model.write_pairs import (
    colliding_geoms,
    friction_values,
    label_of,
    name_geoms,
    set_pair,
    spec_of,
)
from hcbench.sim.capabilities import VariedContact

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.sim.model_under_test import Request

# Parameter -> the field of MjModel with a row for each <pair>, and its columns. friction is the μ
# of both ways along the plate; friction.1 is torsional and friction.2 rolling, as a geom has them.
PARAMETERS: dict[str, tuple[str, tuple[int, ...]]] = {
    "friction": ("pair_friction", (0, 1)),
    "friction.1": ("pair_friction", (2,)),
    "friction.2": ("pair_friction", (3, 4)),
    **{f"solref.{i}": ("pair_solref", (i,)) for i in range(2)},
    **{f"solimp.{i}": ("pair_solimp", (i,)) for i in range(5)},
}


class VariedPair(VariedContact):
    """A model in which every two geoms of a pair have a <pair> of their own.

    Where the model has none, one is added with the parameters that are in force: MuJoCo mixes those
    of geoms, and a geom such as the floor belongs to other contacts, too.
    """

    parameters = tuple(PARAMETERS)

    def __init__(self, source: Any, request: Request) -> None:
        """Write a <pair> for every two geoms of the request's pair into a copy of the model, and
        compile it.

        source: a path, MJCF text or an MjSpec.
        Raises SceneError for a model that does not compile, UserError where it cannot be written or
        the pair cannot be measured.
        """
        own = load(source, request).model
        self._label = label_of(source)
        # The distance from which the contact acts is that of the model as it is.
        onset = MujocoModel(own, self._label, None, request).place.contact.onset
        spec = spec_of(source)
        model = spec.compile()
        geoms = colliding_geoms(model, [find_pair(model, request)])
        names = name_geoms(spec, model, geoms, [])
        for one, other in geoms:
            if not explicit_pairs(model, (one, other)):
                contact = contact_in_force(model, one, other)
                values = {"solref": contact["solref"], "solimp": contact["solimp"]}
                values |= friction_values(model, (one, other)) | {"margin": onset, "gap": 0.0}
                both = names[one], names[other]
                set_pair(spec.add_pair(geomname1=both[0], geomname2=both[1]), both, values)
        self._model = spec.compile()
        self._numbers = [n for each in geoms for n in explicit_pairs(self._model, each)]

    def open(self, request: Request, values: Mapping[str, float]) -> MujocoModel:
        """Open a copy of the model whose <pair>s have these values, with the pair at touch.

        values: by names of PARAMETERS, in MuJoCo's units.
        Raises UserError and its kinds where the pair cannot be measured.
        """
        model = as_requested(self._model.__copy__(), request)
        for name, value in values.items():
            field, columns = PARAMETERS[name]
            for number in self._numbers:
                getattr(model, field)[number, list(columns)] = value
        return MujocoModel(model, self._label, None, request)
