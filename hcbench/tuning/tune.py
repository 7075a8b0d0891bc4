"""Tunes an engine to a target: the one setting that its answer chooses,
evaluated in the engine itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.recipes.recipe import report_progress
from hcbench.tuning.answer import MAX_ERROR
from hcbench.tuning.find import find_answer

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.recipes.target import Target
    from hcbench.terms.scene import Scene
    from hcbench.tuning.find import Match
    from hcbench.tuning.tuned import Tuned

__all__ = ["MAX_ERROR", "tune"]


def tune(
    engine: str,
    target: Target,
    scene: Scene,
    recipe: str = "auto",
    match: Match = "restitution",
    integrator: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    max_error: float = MAX_ERROR,
) -> Tuned:
    """A setting that matches a target, evaluated under the target's gravity and friction.

    Arguments and errors as of `find_answer`, whose choice it is.
    progress: called with the evaluations of a search (done, at most).
    """
    with report_progress(progress):
        return find_answer(
            engine, target, scene, recipe, match, integrator, max_error, asked="settings"
        ).tuned
