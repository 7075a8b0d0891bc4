"""The paper as a page: every figure redrawn, every printed number beside ours."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import LAWS
from hcbench.laws.require import positive, require
from hcbench.paper import impact_figures, vibroimpact_figures
from hcbench.paper.approximations import APPROXIMATIONS
from hcbench.paper.printed_numbers import FACTOR_MASSES, factors, printed_numbers
from hcbench.paper.vibroimpact_figures import FULL, QUICK, Effort
from hcbench.reporting.page import PAGE, Drawing, draw, render
from hcbench.reporting.wording import engine_title, listed
from hcbench.sim import registry
from hcbench.sim.remote import interpreter_of
from hcbench.sim.two_blocks import TwoBlocks
from hcbench.system.files import atomic_folder, read_text, write_text
from hcbench.workers import call

if TYPE_CHECKING:
    from hcbench.paper.vibroimpact.system import Sinusoid, VibroImpact
    from hcbench.terms.impact import Floats

# The mass between two blocks inside the engines, to be laid over the reference: the scene
# `two-blocks`.
#
# Contact is either the engine's plug-in, which is eq. (16) itself, or the best that the engine has
# of its own, tuned at one speed. The engines run in a process of their own.

# Wall time of one simulation, s: an engine that runs longer counts as hung.
LIMIT = 120.0


@dataclass(frozen=True, slots=True)
class EngineTrajectory:
    """Motion of an engine's mass at the ends of steps, arrays of shape (n,): s, m, m/s, N.

    resultant: what the blocks did against the position, by the change of speed; P taken off.
    """

    time: Floats
    position: Floats
    velocity: Floats
    resultant: Floats

    def since(self, start: float) -> EngineTrajectory:
        """The part with time >= start, s."""
        keep = self.time >= start
        return EngineTrajectory(
            self.time[keep], self.position[keep], self.velocity[keep], self.resultant[keep]
        )


def engines_with_two_blocks() -> list[str]:
    """Names of the engines that can simulate the scene, whether they are installed or not."""
    return [name for name in registry.names() if registry.submodule(name, "two_blocks") is not None]


def simulate_in_engine(
    name: str,
    system: VibroImpact,
    position: float,
    velocity: float,
    until: float,
    drive: Sinusoid | None = None,
    *,
    timestep: float = 1e-5,
    tuned_at: float | None = None,
) -> EngineTrajectory:
    """Simulate a system in an engine, by the plug-in, or by its own contact tuned at a speed (m/s).

    Both blocks must have the same law (16). timestep, until in s. Raises UserError for a system
    that an engine cannot have, EngineMissing and EngineFailed.

    The drive is leapfrog, so of second order: engines do v += h P/m, then q += h v. With P of the
    step's start, and the first velocity half a step behind, velocities are those half a step before
    the positions; the velocity at a step's end is the mean of its neighbours.
    """
    law = system.right
    alike = isinstance(law, HuntCrossley) and law == system.left
    require("laws", (system.right, system.left), alike, "the same law (16) on both sides")
    assert isinstance(law, HuntCrossley)
    positive("timestep", timestep, "s")
    positive("until", until, "s")
    if tuned_at is not None:
        positive("tuned_at", tuned_at, "m/s")
    engine = registry.engine(name)
    # Raises EngineMissing before the simulation starts.
    engine.version()
    count = math.ceil(until / timestep) + 1
    forces = np.zeros(count)
    if drive is not None:
        forces[:] = [drive(i * timestep) for i in range(count)]
    start = velocity - 0.5 * timestep * float(forces[0]) / system.mass
    blocks = TwoBlocks(system.mass, system.gap, law, timestep, tuned_at)
    where = interpreter_of(engine)
    positions, velocities = call(
        _simulate, name, blocks, position, start, forces, limit=LIMIT, at=where
    )
    return EngineTrajectory(
        time=np.asarray(np.arange(count) * timestep, dtype=np.float64),
        position=positions[:-1],
        velocity=np.asarray(0.5 * (velocities[:-1] + velocities[1:])),
        resultant=forces - system.mass * np.diff(velocities) / timestep,
    )


def _simulate(
    name: str, blocks: TwoBlocks, position: float, velocity: float, forces: Floats
) -> tuple[Floats, Floats]:
    """Simulate the two blocks, in the worker process."""
    states: tuple[Floats, Floats]
    states = registry.submodule(name, "two_blocks").simulate(blocks, position, velocity, forces)
    return states


# Restitutions in the table of laws.
ASKED = (0.3, 0.5, 0.7, 0.9)


def drawings(effort: Effort) -> list[Drawing]:
    """All figures, in the page's order.

    effort: what the forced ones may cost.
    """
    functions: dict[str, Any] = {
        "figure-1": impact_figures.figure_1,
        "figure-2": impact_figures.figure_2,
        "figure-3": impact_figures.figure_3,
        "figure-4": impact_figures.figure_4,
        "figure-5": vibroimpact_figures.figure_5,
        "figure-6": vibroimpact_figures.figure_6,
        "figure-7": vibroimpact_figures.figure_7,
        "figure-8": vibroimpact_figures.figure_8,
        "figure-9": vibroimpact_figures.figure_9,
        "approximations": impact_figures.approximations_figure,
        "quadratic": impact_figures.quadratic_figure,
        "later-laws": impact_figures.later_laws_figure,
        "response": partial(vibroimpact_figures.response_figure, effort),
        "bifurcation": partial(vibroimpact_figures.bifurcation_figure, effort),
        "engines": partial(vibroimpact_figures.engines_figure, effort),
    }
    return [Drawing(name, function) for name, function in functions.items()]


def build(
    folder: Path,
    *,
    quick: bool = False,
    jobs: int = 1,
    tick: Callable[[int, int], None] | None = None,
) -> Path:
    """Write the page and its figures (SVG, PNG) into `folder` and return
    the page. All of it, or nothing.

    quick: few parameters in the two forced figures.
    jobs: processes for the largest of them.
    tick: called with (figures done, figures in all). The same version gives the same bytes for any
    jobs.

    Raises OutputError where the folder cannot be written.
    """
    effort = QUICK if quick else FULL
    plan = drawings(replace(effort, jobs=jobs))
    with atomic_folder(folder, PAGE) as scratch:
        (scratch / "figures").mkdir()
        figures = {}
        for done, drawing in enumerate(plan):
            if tick is not None:
                tick(done, len(plan))
            figures[drawing.name] = draw(drawing, scratch / "figures")
        if tick is not None:
            tick(len(plan), len(plan))
        write_text(scratch / PAGE, _page(figures))
    return folder / PAGE


def engines_drawn_in(folder: Path) -> set[str]:
    """Engines whose motion the page in a folder shows; empty without a page."""
    with suppress(OSError, ValueError):
        text = read_text(folder / PAGE)
        return {
            name for name in engines_with_two_blocks() if f"{engine_title(name)} plug-in" in text
        }
    return set()


def _page(figures: dict[str, dict[str, Any]]) -> str:
    """The page. figures: each figure's values for the template, by its name."""
    numbers = printed_numbers()
    titles = []
    notes = []
    for name in engines_with_two_blocks():
        titles.append(engine_title(name))
        notes.append(registry.submodule(name, "two_blocks").NOTE)
    return render(
        "paper.html",
        figures=figures,
        numbers=numbers,
        counts=Counter(n.verdict for n in numbers),
        steps=APPROXIMATIONS,
        masses=FACTOR_MASSES,
        factors=factors(),
        asked=ASKED,
        laws=LAWS,
        engine_titles=listed(titles),
        engine_notes=" ".join(notes),
    )
