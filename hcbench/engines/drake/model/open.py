"""Opening of users' models: the part of Drake's engine that loads URDF, SDF and MJCF."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import OpensModels

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.sim.candidate_pairs import CandidatePair
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
        from hcbench.engines.drake.model.list_pairs import list_pairs

        return list_pairs(self.backend.module("pydrake.all"), source, request)
