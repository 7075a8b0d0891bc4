"""Opening of users' models: the part of Drake's engine that loads URDF, SDF and MJCF."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import OpensModels

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.engines.drake.under_test import DrakeModel
    from hcbench.sim.model_under_test import CandidatePair, Request


class OpensFiles(OpensModels):
    """URDF, SDF and MJCF files that Drake loads."""

    backend: Backend
    # Seconds: Python reads a user's model after each step.
    limit = 300.0
    suffixes = (".urdf", ".sdf", ".xml", ".mjcf")

    def accepts(self, source: Any) -> bool:
        """Never chosen automatically: Drake supports only part of MJCF."""
        return False

    # What reads models is imported where one is opened: each command asks every engine what it opens.

    def open(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> DrakeModel:
        """A model from URDF, SDF or MJCF files, in a discrete plant with nothing else set."""
        from hcbench.engines.drake.under_test import DrakeModel

        return DrakeModel(self.backend.module("pydrake.all"), self.version(), source, request, {})

    def pairs(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> list[CandidatePair]:
        """Pairs of shapes that Drake collides."""
        from hcbench.engines.drake.under_test import list_pairs

        return list_pairs(self.backend.module("pydrake.all"), source, request)
