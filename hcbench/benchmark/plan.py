"""Plans a study: makes its settings by their recipes, and cuts their launches into shards.

Both depend on the study alone: the same study is cut the same everywhere.
"""

from __future__ import annotations

import hashlib
import math
import re
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from hcbench.benchmark.results import run_key
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.sim import registry
from hcbench.tune.target import Target

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from hcbench.benchmark.study import Run, Study
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.recipe import Recipe

SCHEMA = 1
_NAMED = re.compile(r'file(?:name)?\s*=\s*"([^"]+)"')  # how MJCF and URDF name meshes and parts
# In a shard, at most: about a second of work, a fine grain for 10^8 impacts.
_IMPACTS, _STEPS = 4096, 5_000_000


@dataclass(frozen=True, slots=True)
class Inputs:
    """What a result depends on besides its setting; compared wherever it is simulated.

    digests: of the scene's model files, engine -> role -> SHA-256. versions: package or engine -> version.
    """

    scene: Scene
    digests: Mapping[str, Mapping[str, str]]
    versions: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Shard:
    """Some launches of one setting, and everything that is needed to simulate them anywhere.

    number: of all shards of the study. alphas: those that the setting is compared to, s/m.
    launches: (speed m/s, phase). kept: the indices of those whose loops are kept.
    """

    number: int
    setting: Setting
    alphas: tuple[float, ...]
    launches: tuple[tuple[float, float], ...]
    kept: tuple[int, ...]
    inputs: Inputs

    def __str__(self) -> str:
        return f"part {self.number}"


@dataclass(frozen=True, slots=True)
class Job:
    """A setting, launched at every speed (m/s) and phase, and compared to every α (s/m).

    loop_speeds: those at which loops are kept, at the middle phase.
    """

    setting: Setting
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]
    loop_speeds: tuple[float, ...]
    phases: int

    def __len__(self) -> int:
        return len(self.speeds) * self.phases

    def launches(self, begin: int, end: int) -> tuple[list[tuple[float, float]], list[int]]:
        """Launches from `begin` to `end`, the phases of one speed together; and which keep their loops."""
        places = [divmod(i, self.phases) for i in range(begin, end)]
        launches = [(self.speeds[i], (phase + 0.5) / self.phases) for i, phase in places]
        middle = self.phases // 2
        kept = [
            n for n, (i, phase) in enumerate(places) if phase == middle and self.speeds[i] in self.loop_speeds
        ]
        return launches, kept


@dataclass(frozen=True)
class Plan:
    """The settings of a study, and its shards, made when asked for.

    records: what is known of each setting, α and step, as JSON. starts: number of the first shard of each
    job, and at the end how many there are.
    """

    study: Study
    inputs: Inputs
    records: Sequence[Mapping[str, Any]]
    jobs: Sequence[Job]
    starts: Sequence[int]

    def __len__(self) -> int:
        return self.starts[-1]

    @property
    def impacts(self) -> int:
        """Impacts in all shards."""
        return sum(map(len, self.jobs))

    def impacts_in(self, number: int) -> int:
        """Impacts in a shard."""
        _, begin, end = self._find(number)
        return end - begin

    def shard(self, number: int) -> Shard:
        """One shard by its number."""
        job, begin, end = self._find(number)
        launches, kept = job.launches(begin, end)
        return Shard(number, job.setting, job.alphas, tuple(launches), tuple(kept), self.inputs)

    def _find(self, number: int) -> tuple[Job, int, int]:
        """The job of a shard, and which of its launches."""
        i = bisect_right(self.starts, number) - 1
        job, count = self.jobs[i], self.starts[i + 1] - self.starts[i]
        size = math.ceil(len(job) / count)
        begin = (number - self.starts[i]) * size
        return job, begin, min(begin + size, len(job))

    def described(self) -> dict[str, Any]:
        """Everything that makes a sweep this one, as JSON. Equal descriptions give equal bytes."""
        return {
            "schema": SCHEMA,
            "kind": "hcbench sweep",
            "study": self.study.described(),
            "settings": self.records,
            "versions": self.inputs.versions,
            "files": self.inputs.digests,
            "impacts": self.impacts,
            "parts": len(self),
            "parts_of_settings": self.starts,
        }


def make_plan(study: Study, mapper: Callable[..., Iterable[Any]] = map) -> Plan:
    """Plan a study.

    mapper: calls recipes, as `map` does; that of a pool calls them side by side. Raises UserError for what
    the study asks wrongly, and EngineMissing.
    """
    recipes = [_recipe(run) for run in study.runs]
    engines = sorted({run.engine for run in study.runs})
    versions = versions_here(engines)  # a missing engine is said before any recipe runs
    inputs = Inputs(study.scene, {name: digests_of(study.scene, name) for name in engines}, versions)
    targets = [(i, target) for i, run in enumerate(study.runs) for target in _targets(study, run)]
    records = []
    jobs: dict[tuple[str, tuple[float, ...]], Job] = {}
    for (i, target), setting in zip(targets, _settings(study, targets, mapper), strict=True):
        run, alpha = study.runs[i], target.law.alpha
        about = {"options": setting.options, "summary": recipes[i].summary, "notes": list(recipes[i].notes)}
        records.append({**run_key(study.scene, setting, alpha), **about})
        loop_speeds = study.loop_speeds if run.speeds == study.speeds else ()
        speeds = tuple(sorted({*run.speeds, *loop_speeds}))
        job = jobs.get((setting.key, speeds), Job(setting, (), speeds, loop_speeds, study.phases))
        jobs[setting.key, speeds] = replace(job, alphas=tuple(dict.fromkeys((*job.alphas, alpha))))
    counts = [_count_shards(job, study.scene) for job in jobs.values()]
    return Plan(study, inputs, records, list(jobs.values()), list(accumulate(counts, initial=0)))


def _recipe(run: Run) -> Recipe:
    return registry.recipe(f"{run.engine}.{run.recipe}")


def _targets(study: Study, run: Run) -> list[Target]:
    scene, low, high = study.scene, min(study.speeds), max(study.speeds)
    laws = [HuntCrossley(scene.stiffness, alpha, scene.exponent) for alpha in run.alphas]
    return [Target(law, scene.mass, timestep, low, high) for timestep in run.timesteps for law in laws]


def _settings(
    study: Study, targets: Sequence[tuple[int, Target]], mapper: Callable[..., Iterable[Any]]
) -> list[Setting]:
    """A setting for each (index of a run, target), in order."""
    # Runs of few settings are made first: that they are few is mostly because each takes a search.
    count = Counter(i for i, _ in targets)
    turns = sorted(range(len(targets)), key=lambda k: count[targets[k][0]])
    made = mapper(_make_setting, [(study.runs[i], target) for i, target in map(targets.__getitem__, turns)])
    settings = dict(zip(turns, made, strict=True))
    return [settings[k] for k in range(len(targets))]


def _make_setting(order: tuple[Run, Target]) -> Setting:
    run, target = order
    return _recipe(run)(target)


def _count_shards(job: Job, scene: Scene) -> int:
    slowest = min(job.speeds)
    elastic = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, slowest)
    steps = math.ceil(elastic / job.setting.timestep) + 8  # a scale, no more
    return math.ceil(len(job) / max(1, min(_IMPACTS, _STEPS // steps)))


@lru_cache(maxsize=64)
def _version(package: str) -> str:
    return version(package)


@lru_cache(maxsize=64)
def _engine_version(name: str) -> str:
    return registry.engine(name).version()


def versions_here(engines: Iterable[str]) -> dict[str, str]:
    """Of everything that the bytes of a shard depend on: package or engine -> version."""
    packages = {name: _version(name) for name in ("hcbench", "numpy", "pyarrow", "scipy")}
    return {**packages, **{name: _engine_version(name) for name in sorted(set(engines))}}


def digests_of(scene: Scene, engine: str) -> dict[str, str]:
    """SHA-256 of an engine's model files, each with the files that it names, by role; "" for what is gone."""
    return {
        role: _digest(path, path.stat().st_mtime_ns) if path.is_file() else ""
        for role, path in sorted(scene.models.get(engine, {}).items())
    }


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
