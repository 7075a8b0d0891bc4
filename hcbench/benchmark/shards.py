"""Cuts a study into parts: by the study alone, so that the same study is cut the same everywhere."""

from __future__ import annotations

import hashlib
import math
import re
from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from hcbench.benchmark.run import plan, setting_record
from hcbench.laws import closed_form
from hcbench.sim import registry

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from hcbench.benchmark.run import Row, Task
    from hcbench.benchmark.study import Study
    from hcbench.scene import Scene
    from hcbench.setting import Setting

SCHEMA = 1
_NAMED = re.compile(r'file(?:name)?\s*=\s*"([^"]+)"')  # how MJCF and URDF name meshes and parts
# In a part, at most: about a second of work, a fine grain for 10^8 impacts.
_IMPACTS, _STEPS = 4096, 5_000_000


@dataclass(frozen=True, slots=True)
class Part:
    """Some launches of one setting, and everything that is needed to fly them anywhere.

    number: of all parts. alphas: those that the setting is compared to, s/m. launches: (speed m/s, phase).
    keep: which of them keep their loops. digests: of the scene's model files, engine -> role -> SHA-256.
    versions: of everything that makes the result, where it was planned.
    """

    number: int
    scene: Scene
    setting: Setting
    alphas: tuple[float, ...]
    launches: tuple[tuple[float, float], ...]
    keep: tuple[int, ...]
    digests: Mapping[str, Mapping[str, str]]
    versions: Mapping[str, str]


class Plan:
    """All parts of a study, made when asked for. impacts: in all of them."""

    def __init__(self, study: Study) -> None:
        rows = plan(study)
        self.study = study
        self.settings = [setting_record(study.scene.name, row) for row in rows]
        engines = {run.engine for run in study.runs}
        self.versions = versions_here(engines)
        self.digests = {engine: digests_of(study.scene, engine) for engine in sorted(engines)}
        self._tasks = _shared(rows)
        self._sizes = [_size(task, study.scene) for task, _ in self._tasks]
        counts = [
            math.ceil(len(task.launches) / size)
            for (task, _), size in zip(self._tasks, self._sizes, strict=True)
        ]
        self._starts = list(accumulate(counts, initial=0))
        self.impacts = sum(len(task.launches) for task, _ in self._tasks)

    def __len__(self) -> int:
        return self._starts[-1]

    def impacts_in(self, number: int) -> int:
        """How many impacts a part has."""
        _, begin, end = self._where(number)
        return end - begin

    def part(self, number: int) -> Part:
        """One part by its number."""
        task, begin, end = self._where(number)
        (own, alphas), launches = self._tasks[task], self._tasks[task][0].launches[begin:end]
        return Part(
            number=number,
            scene=own.scene,
            setting=own.setting,
            alphas=alphas,
            launches=tuple((launch.speed, launch.phase) for launch in launches),
            keep=tuple(i for i, launch in enumerate(launches) if launch in own.keep),
            digests=self.digests,
            versions=self.versions,
        )

    def _where(self, number: int) -> tuple[int, int, int]:
        """The task of a part, and which of its launches."""
        task = bisect_right(self._starts, number) - 1
        size, total = self._sizes[task], len(self._tasks[task][0].launches)
        begin = (number - self._starts[task]) * size
        return task, begin, min(begin + size, total)

    def described(self) -> dict[str, Any]:
        """Everything that makes a sweep this one, as JSON. Equal descriptions give equal bytes."""
        return {
            "schema": SCHEMA,
            "kind": "hcbench sweep",
            "study": self.study.described(),
            "settings": self.settings,
            "versions": self.versions,
            "files": self.digests,
            "impacts": self.impacts,
            "parts": len(self),
            "parts_of_settings": self._starts,
        }


def _shared(rows: list[Row]) -> list[tuple[Task, tuple[float, ...]]]:
    """Each task once, with every α that it serves, in the study's order."""
    found: dict[Any, tuple[Task, list[float]]] = {}
    for row in rows:
        found.setdefault(row.task.key, (row.task, []))[1].append(row.alpha)
    return [(task, tuple(dict.fromkeys(alphas))) for task, alphas in found.values()]


def _size(task: Task, scene: Scene) -> int:
    """Impacts in each part of a task: as few parts as may be, of one size."""
    slowest = min(task.launches.speeds)
    elastic = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, slowest)
    steps = math.ceil(elastic / task.setting.timestep) + 8  # a scale, no more
    most, total = max(1, min(_IMPACTS, _STEPS // steps)), len(task.launches)
    return math.ceil(total / math.ceil(total / most))


@lru_cache(maxsize=64)
def _version(package: str) -> str:
    return version(package)


@lru_cache(maxsize=64)
def _engine_version(name: str) -> str:
    return registry.engine(name).version()


def versions_here(engines: Iterable[str]) -> dict[str, str]:
    """Of everything that the bytes of a part depend on: package or engine, and version."""
    packages = {name: _version(name) for name in ("hcbench", "numpy", "pyarrow", "scipy")}
    return {**packages, **{name: _engine_version(name) for name in sorted(set(engines))}}


def digests_of(scene: Scene, engine: str) -> dict[str, str]:
    """SHA-256 of an engine's model files, each with the files that it names, by role; "" for what is gone."""
    found = {}
    for role, path in sorted(scene.models.get(engine, {}).items()):
        found[role] = _digest(path, path.stat().st_mtime_ns) if path.is_file() else ""
    return found


@lru_cache(maxsize=256)
def _digest(path: Path, _: int) -> str:
    content = path.read_bytes()
    digest = hashlib.sha256(content)
    if path.suffix in (".xml", ".urdf"):
        for name in sorted(set(_NAMED.findall(content.decode("utf-8", "replace")))):
            named = path.parent / name
            if named.is_file():
                digest.update(_digest(named, named.stat().st_mtime_ns).encode())
    return digest.hexdigest()
