"""Flies one part, wherever it is sent: engines run in a process of their own, and what they die on is a row.

`fly_part` is all that an executor is given. Whatever kills an engine's process costs the impacts of one
stretch, which are then flown one by one; what fails again is CRASHED, with the reason.
"""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from hcbench.benchmark import batch
from hcbench.benchmark.batch import Flown, Stretch
from hcbench.benchmark.shards import Part, digests_of, versions_here
from hcbench.benchmark.tables import PartBytes, part_bytes
from hcbench.errors import CannotRun, SceneError, UserError
from hcbench.impact import Impact, Launch, Status
from hcbench.scene import load_scene
from hcbench.workers import call, map_surviving_crashes, use_own_worker

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.scene import Scene

_FIRST = 64  # impacts in the first stretch of a part: it tells how long the others take
_SAMPLES = 500_000  # steps in contact in a stretch, at most: 16 MB of loops
_GIVE_UP = 32  # deaths in a row: all phases of a few speeds, which fail together


@dataclass(frozen=True, slots=True)
class Patience:
    """How long an engine may take, s: for anything at all, and for each impact on top of that.

    each: None for 4 s at steps of 1 µs or more, for smaller ones in proportion: a ball at rest takes 1 s.
    """

    start: float = 60.0
    each: float | None = None

    def limit(self, timestep: float, impacts: int) -> float:
        """For so many impacts."""
        each = 4.0 * max(1.0, 1e-6 / timestep) if self.each is None else self.each
        return self.start + each * impacts


def fly_part(part: Part, patience: Patience) -> PartBytes:
    """All of a part, in the files' bytes.

    Raises UserError for what the engine refuses, CannotRun where this is not what the part was planned with.
    """
    use_own_worker()
    scene = _scene_here(part)
    found: list[Flown] = []
    done, size, total = 0, _FIRST, len(part.launches)
    while done < total:
        end = min(done + size, total)
        keep = [i - done for i in part.keep if done <= i < end]
        own = _fly(Stretch(scene, part.setting, part.launches[done:end], keep), patience)
        found.append(Flown(own.columns, [(i + done, loop) for i, loop in own.loops]))
        done, size = end, max(_FIRST, int(_SAMPLES // (1 + own.columns["samples"].mean())))
    return part_bytes(part, found)


def _fly(own: Stretch, patience: Patience) -> Flown:
    limit = patience.limit(own.setting.timestep, len(own.launches))
    try:
        return call(batch.together, own, limit=limit)
    except UserError:
        raise
    except Exception:
        # Death included. Which impact it was, and what happened, is told when each has flown alone.
        found_alone = map_surviving_crashes(
            batch.alone,
            range(len(own.launches)),
            own,
            lost=partial(_lost, own),
            limit=patience.limit(own.setting.timestep, 1),
            give_up=_GIVE_UP,
        )
        return Flown.of(found_alone, own.keep)


def _lost(own: Stretch, i: int, why: str) -> Impact:
    return Impact(Launch(*own.launches[i]), Status.CRASHED, why)


def _scene_here(part: Part) -> Scene:
    """The scene with its files as they lie here; CannotRun where anything is not as it was planned."""
    engine = part.setting.engine
    here = versions_here([engine])
    differ = [name for name in here if part.versions[name] != here[name]]
    if differ:
        raise CannotRun(
            "worker",
            f"has {', '.join(f'{name} {here[name]}' for name in differ)}",
            ", ".join(f"{name} {part.versions[name]}" for name in differ),
            "Install the same everywhere",
        )
    for scene in _candidates(part.scene):
        if digests_of(scene, engine) == part.digests[engine]:
            return dataclasses.replace(part.scene, models=scene.models)
    raise CannotRun(
        "worker",
        f"the files of scene {part.scene.name!r} are not there, or not the same",
        "those that the sweep was planned with",
        "Keep the scene's folder where every machine sees it under the same path",
    )


def _candidates(scene: Scene) -> Iterator[Scene]:
    """The scene where it lay when it was planned, else the built-in one of that name."""
    yield scene
    with suppress(SceneError):
        yield load_scene(scene.name)
