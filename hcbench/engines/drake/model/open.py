"""Opening of users' models: the part of Drake's engine that loads URDF, SDF and MJCF."""

from __future__ import annotations

import math
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
    limit = 300.0  # Python reads a user's model after each step
    suffixes = (".urdf", ".sdf", ".xml", ".mjcf")

    def accepts(self, source: Any) -> bool:
        """Never chosen automatically: Drake supports only part of MJCF."""
        return False

    def open(self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None) -> ModelUnderTest:
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
    return in_order([_described(loaded, context, *_in_order(loaded, both)) for both in loaded.collide])


def _in_order(loaded: LoadedPlant, both: frozenset[Any]) -> list[Part]:
    """The two of a pair, the one that moves first."""
    shapes = sorted(both, key=lambda g: (loaded.plant.IsAnchored(loaded.body_of(g)), loaded.short(g)))
    return [Part(loaded.short(shape), loaded.body_of(shape), (shape,)) for shape in shapes]


def _described(loaded: LoadedPlant, context: Any, first: Part, second: Part) -> CandidatePair:
    distance = mass = math.nan
    try:
        gap = loaded.nearest(context, first, second)
    except UserError:  # of shapes whose distance Drake does not know
        pass
    else:
        row = approach_row(loaded, context, (first, second), gap)
        mobility = float(row @ np.linalg.solve(loaded.plant.CalcMassMatrix(context), row))
        distance, mass = gap.distance, 1.0 / mobility if mobility > 0 else math.nan
    moved = [words for part in (first, second) for _, words in movers(loaded, part.body)]
    shapes = [part.geometries[0] for part in (first, second)]
    kinds = [type(loaded.inspector.GetShape(shape)).__name__ for shape in shapes]
    return CandidatePair(
        bodies=(first.body.name(), second.body.name()),
        geoms=(first.name, second.name),
        types=(kinds[0], kinds[1]),
        pair=joined_names([f"geom:{first.name}", f"geom:{second.name}"]),
        joint=moved[0] if moved else "nothing",
        effective_mass=mass,
        distance=distance,
        touching=distance <= 0.0,
        settings={name: [loaded.property(g, name) for g in shapes] for name in (STIFFNESS, DISSIPATION)},
    )
