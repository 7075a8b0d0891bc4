"""Opening of users' models: the part of Drake's engine that loads URDF, SDF and MJCF."""

from __future__ import annotations

import math
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.drake.model.place import approach_row, movers, set_pose
from hcbench.engines.drake.model.user_model import DISSIPATION, STIFFNESS, LoadedPlant, Part
from hcbench.sim.backend import Backend
from hcbench.sim.candidate_pairs import CandidatePair, in_order
from hcbench.sim.capabilities import OpensModels
from hcbench.system.errors import UserError
from hcbench.system.text import joined_names

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.sim.model_under_test import ModelUnderTest, Request


class OpensFiles(OpensModels):
    """URDF, SDF and MJCF files that Drake loads."""

    backend: Backend
    # Seconds: Python reads a user's model after each step.
    limit = 300.0
    suffixes = (".urdf", ".sdf", ".xml", ".mjcf")

    def accepts(self, source: Any) -> bool:
        """Never chosen automatically: Drake supports only part of MJCF."""
        return False

    def open(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> ModelUnderTest:
        """A model from URDF, SDF or MJCF files, in a discrete plant with nothing else set."""
        from hcbench.engines.drake.model.under_test import DrakeModel

        return DrakeModel(self.backend.module("pydrake.all"), self.version(), source, request, {})

    def pairs(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> list[CandidatePair]:
        """Pairs of shapes that Drake collides."""

        return list_pairs(self.backend.module("pydrake.all"), source, request)


def list_pairs(drake: Any, source: Any, request: Request) -> list[CandidatePair]:
    """Every pair that can meet, the one that moves first; those that touch at the start first."""
    loaded = LoadedPlant(drake, source, request, {})
    root = loaded.diagram.CreateDefaultContext()
    context = loaded.plant.GetMyMutableContextFromRoot(root)
    set_pose(loaded, context, request)
    pairs = []
    for both in loaded.collide:
        first, second = _in_order(loaded, both)
        pairs.append(_described(loaded, context, first, second))
    return in_order(pairs)


def _in_order(loaded: LoadedPlant, both: frozenset[Any]) -> list[Part]:
    """The two of a pair, the one that moves first."""
    shapes = sorted(
        both, key=lambda g: (loaded.plant.IsAnchored(loaded.body_of(g)), loaded.short(g))
    )
    return [Part(loaded.short(shape), loaded.body_of(shape), (shape,)) for shape in shapes]


def _described(loaded: LoadedPlant, context: Any, first: Part, second: Part) -> CandidatePair:
    """A pair as a row of the list; mass, kg, and distance, m, are NaN
    where Drake returns no distance.
    """
    distance = math.nan
    mass = math.nan
    try:
        gap = loaded.nearest(context, first, second)
    # Drake does not know the distance of these shapes.
    except UserError:
        pass
    else:
        distance = gap.distance
        row = approach_row(loaded, context, (first, second), gap)
        mobility = float(row @ np.linalg.solve(loaded.plant.CalcMassMatrix(context), row))
        if mobility > 0:
            mass = 1.0 / mobility
    first_mover = next(chain(movers(loaded, first.body), movers(loaded, second.body)), None)
    joint = "nothing"
    if first_mover is not None:
        _, joint = first_mover
    (first_shape,) = first.geometries
    (second_shape,) = second.geometries
    settings = {}
    for name in (STIFFNESS, DISSIPATION):
        settings[name] = [loaded.property(first_shape, name), loaded.property(second_shape, name)]
    return CandidatePair(
        bodies=(first.body.name(), second.body.name()),
        geoms=(first.name, second.name),
        types=(_type(loaded, first_shape), _type(loaded, second_shape)),
        pair=joined_names([f"geom:{first.name}", f"geom:{second.name}"]),
        joint=joint,
        effective_mass=mass,
        distance=distance,
        touching=distance <= 0.0,
        settings=settings,
    )


def _type(loaded: LoadedPlant, shape: Any) -> str:
    """The kind of a shape, as Drake calls it."""
    return type(loaded.inspector.GetShape(shape)).__name__
