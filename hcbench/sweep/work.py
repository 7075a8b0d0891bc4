"""Flies one part, wherever it is sent: engines run in a process of their own, and what they die on is a row.

`fly_part` is all that an executor is given. Whatever kills an engine's process costs the impacts of one
stretch, which are then flown one by one; what fails again is CRASHED, with the reason.
"""

from __future__ import annotations

import dataclasses
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.engines import isolation, registry
from hcbench.errors import CannotRun, SceneError, UserError
from hcbench.impact import Impact, Launch, Status
from hcbench.run import flown
from hcbench.scene import load_scene
from hcbench.sweep.parts import Part, digests_of, versions_here
from hcbench.sweep.tables import Flown, PartBytes, part_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.scene import Scene

_FIRST = 64  # impacts in the first stretch of a part: it tells how long the others take
_SAMPLES = 2_000_000  # steps in contact in a stretch, at most: 64 MB of loops
stopping = threading.Event()  # set: the engines' processes are being ended on purpose


@dataclass(frozen=True, slots=True)
class Patience:
    """How long an engine may take, s: for anything at all, and for each impact on top of that.

    each: None for 4 s at steps of 1 µs or more, for smaller ones in proportion: a ball at rest takes 1 s.
    """

    start: float = 60.0
    each: float | None = None

    def limit(self, part: Part, impacts: int) -> float:
        """For so many impacts of a part."""
        each = 4.0 * max(1.0, 1e-6 / part.setting.timestep) if self.each is None else self.each
        return self.start + each * impacts


def fly_part(part: Part, patience: Patience) -> PartBytes:
    """All of a part, in the files' bytes.

    Raises UserError for what the engine refuses, CannotRun where this is not what the part was planned with.
    """
    isolation.take_own_worker()
    part = _here(part)
    stretches: list[Flown] = []
    done, size, total = 0, _FIRST, len(part.launches)
    while done < total:
        stretches.append(_stretch(part, done, min(done + size, total), patience))
        done = min(done + size, total)
        size = max(_FIRST, int(_SAMPLES // (1 + stretches[-1].columns["samples"].mean())))
    return part_bytes(part, Flown.joined(stretches))


def _stretch(part: Part, begin: int, end: int, patience: Patience) -> Flown:
    try:
        (found,) = isolation.collect(_fly_together, part, begin, end, limit=patience.limit(part, end - begin))
    except UserError:
        raise
    except Exception:
        # Death included. Which impact it was, and what happened, is told when each has flown alone.
        if stopping.is_set():
            raise
        limit = patience.limit(part, 1)
        alone = isolation.survive(
            _fly_alone, range(begin, end), part, lost=lambda i, why: _lost(part, i, why), limit=limit
        )
        return _told(part, begin, alone)
    return found


def _fly_together(part: Part, begin: int, end: int) -> Iterator[Flown]:
    launches = [Launch(*launch) for launch in part.launches[begin:end]]
    yield _told(part, begin, registry.engine(part.setting.engine).drop(part.scene, part.setting, launches))


def _fly_alone(which: Sequence[int], part: Part) -> Iterator[Impact]:
    engine = registry.engine(part.setting.engine)
    for i in which:
        try:
            (impact,) = engine.drop(part.scene, part.setting, [Launch(*part.launches[i])])
        except UserError:
            raise
        except Exception as error:
            impact = _lost(part, i, " ".join(f"{type(error).__name__}: {error}".split()))
        yield impact if i in part.keep else dataclasses.replace(impact, loop=None)  # light to send


def _lost(part: Part, i: int, why: str) -> Impact:
    return Impact(Launch(*part.launches[i]), Status.CRASHED, why)


def _told(part: Part, begin: int, impacts: Sequence[Impact]) -> Flown:
    kept = [(i, impact.loop) for i, impact in enumerate(impacts, begin) if i in part.keep]
    return Flown(flown(impacts), [(i, loop) for i, loop in kept if loop is not None])


def _here(part: Part) -> Part:
    """The part with the scene's files as they lie here; CannotRun where anything is not as it was planned."""
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
            return dataclasses.replace(part, scene=dataclasses.replace(part.scene, models=scene.models))
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
