"""Plans a study: makes its settings by their recipes, and cuts their launches into shards.

Both depend on the study alone: the same study is cut the same everywhere.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from hcbench.benchmark.results import run_key
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes import kept
from hcbench.recipes.target import Target, default_band
from hcbench.sim import registry
from hcbench.sim.columns import Launches, even_size
from hcbench.sim.engine import SteppedEngine
from hcbench.system.errors import UserError
from hcbench.system.files import is_file
from hcbench.terms.impact import Launch
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from hcbench.benchmark.study import Run, Study
    from hcbench.recipes.recipe import Recipe
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# The launches of one setting: at which speeds, angles and phases, and how bodies are sent to touch
# so.


@dataclass(frozen=True, slots=True)
class LaunchGrid:
    """A setting, launched or dropped at every speed (m/s), angle (rad) and
    phase, compared to every α (s/m).

    Its launches are numbered from 0 over speeds, then angles, then phases; a part of them is a
    range of these numbers that is not empty.

    dropped: bodies fall from rest to touch at the speeds; else they are launched shortly before.
    alphas: α of the laws that the impacts are compared to, s/m.
    speeds: at the touch, rising.
    loop_speeds: those at which loops are kept, at the middle phase.
    phases: how many; they are (k + 1/2) / phases of a step.
    angles: from the normal.
    spin: of all launches, see `Launch`, rad/s.
    share: of g h in (v + share g h)² + 2 g z, which the engine keeps in free flight, see
    `SpeedReading`: with it every engine touches at the same speeds.
    """

    scene: Scene
    dropped: bool
    setting: Setting
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]
    loop_speeds: tuple[float, ...]
    phases: int
    angles: tuple[float, ...]
    spin: tuple[float, float, float]
    share: float

    def __len__(self) -> int:
        return math.prod(self.shape)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of speeds, angles and phases."""
        return len(self.speeds), len(self.angles), self.phases

    def cut(self, part: range) -> tuple[LaunchGrid, range]:
        """Return a grid of only the speeds of some launches, which is small to send, and the
        numbers that these launches have in it.

        part: numbers of the launches in this grid.
        """
        launches_a_speed = len(self.angles) * self.phases
        first = part.start // launches_a_speed
        last = (part.stop - 1) // launches_a_speed
        speeds = self.speeds[first : last + 1]
        loop_speeds = tuple(sorted({*self.loop_speeds} & {*speeds}))
        small = replace(self, speeds=speeds, loop_speeds=loop_speeds)
        left_out = first * launches_a_speed
        return small, range(part.start - left_out, part.stop - left_out)

    def asked(self, part: range) -> tuple[Floats, Floats]:
        """The speed at touch, m/s, and the phase, 0 to 1, of some launches, in their order.

        part: numbers of the launches in the grid. Each array has the shape (len(part),).
        """
        speed, _, phase = np.unravel_index(np.arange(part.start, part.stop), self.shape)
        return np.array(self.speeds)[speed], (phase + 0.5) / self.phases

    def launches(self, part: range) -> Launches:
        """Launches that reach the speeds (m/s) and phases of the grid at the touch.

        part: numbers of the launches in the grid. A body that is dropped starts at rest, or with
        less than one step's gain in speed; others start at most two steps and the phase before
        the touch. Without gravity none falls: all start at their speed.
        """
        speed, phase = self.asked(part)
        # Number of each launch's angle.
        _, angle, _ = np.unravel_index(np.arange(part.start, part.stop), self.shape)
        # Slip of a launch of 1 m/s at each angle.
        slips = np.array([Launch.at_angle(each, 1.0).slip[0] for each in self.angles])
        # Steps of flight before the touch, at most; those that fall take as many as they need.
        steps_most = 2.0
        if self.dropped:
            steps_most = math.inf
        return Launches.touching(
            speed,
            phase,
            self.setting.timestep,
            self.scene.normal_gravity,
            slip=speed * slips[angle],
            spin=self.spin,
            steps_most=steps_most,
            share=self.share,
        )

    def looped(self, part: range) -> list[int]:
        """Indices, within a part, of the launches whose loops are kept: at the middle phase, along
        the normal.

        part: numbers of the launches in the grid.
        """
        speed, phase = self.asked(part)
        # The same expression as in `asked`, so that equal phases are equal bit for bit.
        middle = (self.phases // 2 + 0.5) / self.phases
        kept = np.isin(speed, self.loop_speeds) & (phase == middle)
        return [int(i) for i in np.flatnonzero(kept & ~self.launches(part).is_oblique)]


def share_of(setting: Setting) -> float:
    """Share of g h that an engine's speed lacks under a setting, see `SpeedReading`."""
    engine = registry.adapter(registry.base_name(setting.engine))
    return engine.speed_reading(setting).share if isinstance(engine, SteppedEngine) else 0.0


def speeds_at(study: Study, run: Run, timestep: float) -> tuple[float, ...]:
    """Impact speeds of a run, m/s; on a field page moved into the band over which a body bounces at
    the step, with gravity or without.

    timestep: s. The speeds keep their order, and are stretched evenly. No speed becomes lower: a
    run whose first speed is in the band keeps its own.
    """
    first = run.speeds[0]
    last = run.speeds[-1]
    band_low, band_high = default_band(timestep, STANDARD_GRAVITY)
    low = max(first, band_low)
    high = max(last, band_high)
    if study.page != "field" or low == first:
        return run.speeds
    stretch = 1.0
    if last > first:
        stretch = (high - low) / (last - first)
    return tuple(low + stretch * (speed - first) for speed in run.speeds)


SCHEMA = 3
# A run, the target that its setting is made for, and the file that keeps the setting.
_Job: TypeAlias = "tuple[Run, Target, Path | None]"
# MJCF and URDF name meshes and parts like this.
_NAMED = re.compile(r'file(?:name)?\s*=\s*"([^"]+)"')
# Impacts and steps in contact of a shard, at most: about a second of work, a fine grain for 10^8
# impacts.
SHARD_IMPACTS = 4096
_STEPS = 5_000_000
# Impacts of a shard, at most: on a device they are one batch.
_ON_A_DEVICE = 2**20


@dataclass(frozen=True, slots=True)
class Inputs:
    """Inputs of a result besides its setting; compared wherever it is simulated.

    digests: of the scene's model files, engine -> role -> SHA-256.
    versions: package or engine -> version.
    """

    scene: Scene
    digests: Mapping[str, Mapping[str, str]]
    versions: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Shard:
    """Some launches of one setting, and everything that is needed to simulate them anywhere.

    number: of all shards of the study.
    part: which of the grid's launches.
    oblique: whether the study has oblique launches.
    """

    number: int
    grid: LaunchGrid
    part: range
    oblique: bool
    inputs: Inputs

    def __len__(self) -> int:
        return len(self.part)

    def __str__(self) -> str:
        return f"part {self.number}"


@dataclass(frozen=True)
class Plan:
    """The settings of a study, and the shards that their launches are cut into.

    inputs: by a scene's name.
    records: of each setting, α and step, as JSON: the keys of RUN_KEY, its options, and its
    recipe's summary and notes.
    grids: in the order of their shards.
    cuts: of each shard the grid, and which of its launches.
    starts: number of the first shard of each grid, and at the end how many there are.
    """

    study: Study
    inputs: Mapping[str, Inputs]
    records: Sequence[Mapping[str, Any]]
    grids: Sequence[LaunchGrid]
    cuts: Sequence[tuple[LaunchGrid, range]]
    starts: Sequence[int]

    def __len__(self) -> int:
        return len(self.cuts)

    @property
    def impacts(self) -> int:
        """Impacts in all shards."""
        return sum(map(len, self.grids))

    def shard(self, number: int) -> Shard:
        """One shard by its number."""
        whole, part = self.cuts[number]
        return Shard(number, *whole.cut(part), self.study.is_oblique, self.inputs_of(whole))

    def inputs_of(self, grid: LaunchGrid) -> Inputs:
        """Return the inputs of a grid's results besides its setting."""
        return replace(self.inputs[grid.scene.name], scene=grid.scene)

    def described(self) -> dict[str, Any]:
        """Everything that makes a sweep this one, as JSON. Equal descriptions give equal bytes."""
        versions: dict[str, str] = {}
        digests = {}
        for name, inputs in self.inputs.items():
            versions.update(inputs.versions)
            digests[name] = inputs.digests
        return {
            "schema": SCHEMA,
            "kind": "hcbench sweep",
            "study": self.study.described(),
            "settings": self.records,
            "versions": versions,
            "files": digests,
            "impacts": self.impacts,
            "parts": len(self),
            "parts_of_settings": self.starts,
        }


def make_plan(study: Study, mapper: Callable[..., Iterable[Any]] = map) -> Plan:
    """Plan a study: make a setting for each run, α and step, and cut the launches into shards.

    mapper: calls recipes, as `map` does; that of a pool calls them side by side.

    Raises UserError for what the study asks wrongly, such as a target that a recipe cannot serve;
    StudyError for a field page none of whose engines is installed; EngineMissing for another
    study's missing engine; CannotRun where this machine lacks the study's device.
    """
    if study.page == "field":
        study = study.of_engines(registry.is_there)
    recipes = list(map(_recipe, study.runs))
    engines = sorted({run.engine for run in study.runs})
    # A missing engine is an error before any recipe runs.
    versions = versions_here(*engines)
    if study.device:
        for engine in engines:
            _require_device(study.device, engine)
    inputs = _inputs(study, engines, versions)
    # (number of the run, target of a setting).
    targets: list[tuple[int, Target]] = []
    for number, run in enumerate(study.runs):
        targets += [(number, target) for target in _targets(study, run)]

    records = []
    grids: dict[tuple[Any, ...], LaunchGrid] = {}
    settings = _settings(study, targets, mapper)
    for (number, target), setting in zip(targets, settings, strict=True):
        run = study.runs[number]
        alpha = target.law.alpha
        recipe = recipes[number]
        records.append(
            {
                **run_key(run.scene, setting, alpha),
                "options": setting.options,
                "summary": recipe.summary,
                "notes": list(recipe.notes),
            }
        )
        # One simulation serves every α whose setting is the same.
        new = _grid(study, run, setting, target.timestep)
        key = (new.scene, new.dropped, setting.key, new.speeds, new.angles, new.spin)
        grid = grids.get(key, new)
        grids[key] = replace(grid, alphas=tuple(dict.fromkeys((*grid.alphas, alpha))))
    cuts, starts = _cuts(grids.values())
    return Plan(
        study=study,
        inputs=inputs,
        records=records,
        grids=list(grids.values()),
        cuts=cuts,
        starts=starts,
    )


def _inputs(study: Study, engines: Sequence[str], versions: Mapping[str, str]) -> dict[str, Inputs]:
    """Inputs of the study's results, by the names of its scenes.

    engines: of its runs.
    versions: of them and of packages, see `versions_here`.
    """
    scenes = {study.scene.name: study.scene}
    for run in study.runs:
        scenes[run.scene.name] = run.scene
    inputs = {}
    for name, scene in scenes.items():
        digests = {engine: digests_of(scene, engine) for engine in engines}
        inputs[name] = Inputs(scene, digests, versions)
    return inputs


def _grid(study: Study, run: Run, setting: Setting, timestep: float) -> LaunchGrid:
    """The launches of one setting of a run, not yet compared to any α.

    timestep: of the setting's target, s.
    """
    band = speeds_at(study, run, timestep)
    # Only runs over the study's own band are launched at its loop speeds too.
    loop_speeds = study.loop_speeds if band == study.speeds else ()
    speeds = tuple(sorted({*band, *loop_speeds}))
    if study.all_loops and (loop_speeds or run.dropped):
        loop_speeds = speeds
    return LaunchGrid(
        scene=run.scene,
        dropped=run.dropped,
        setting=setting,
        alphas=(),
        speeds=speeds,
        loop_speeds=loop_speeds,
        phases=study.phases,
        angles=run.angles,
        spin=run.spin,
        share=share_of(setting),
    )


def _cuts(grids: Iterable[LaunchGrid]) -> tuple[list[tuple[LaunchGrid, range]], list[int]]:
    """Cut grids into shards: (grid and numbers of its launches of each shard; number of the first
    shard of each grid, and of all shards at the end).

    A shard has launches of one grid alone. The shards of a grid follow one another, and are of one
    size but for the last.
    """
    cuts: list[tuple[LaunchGrid, range]] = []
    starts = [0]
    for grid in grids:
        size = _shard_size(grid)
        total = len(grid)
        cuts += [(grid, range(begin, min(begin + size, total))) for begin in range(0, total, size)]
        starts.append(len(cuts))
    return cuts, starts


def _require_device(device: str, name: str) -> None:
    """Raises UserError for an engine that cannot compute on a device, CannotRun where this machine
    lacks the device.

    device: such as "gpu".
    name: of the engine.
    """
    engine = registry.engine(name)
    if device not in engine.devices:
        able = [other for other in registry.names() if device in registry.adapter(other).devices]
        raise UserError(
            "--device", f"{device!r} for {name}", f"a study of {' and '.join(able)} alone"
        )
    engine.require_device(device)


def _recipe(run: Run) -> Recipe:
    return registry.recipe(f"{run.engine}.{run.recipe}")


def _targets(study: Study, run: Run) -> list[Target]:
    """Targets of a run's settings: each α at each step, over the speeds that it meets.

    Speeds are m/s, time steps s. A run that is dropped or on a field page has a band of its own.
    Raises SettingError for numbers that no `Target` has.
    """
    scene = run.scene
    laws = [HuntCrossley(scene.stiffness, alpha, scene.exponent) for alpha in run.alphas]
    has_own_band = run.dropped or study.page == "field"
    targets = []
    for timestep in run.timesteps:
        band = study.speeds
        if has_own_band:
            band = speeds_at(study, run, timestep)
        for law in laws:
            target = Target(
                law,
                scene.mass,
                timestep,
                min(band),
                max(band),
                gravity=scene.normal_gravity,
                friction=scene.friction,
            )
            targets.append(target)
    return targets


def _settings(
    study: Study, targets: Sequence[tuple[int, Target]], mapper: Callable[..., Iterable[Any]]
) -> list[Setting]:
    """A setting for each (index of a run, target), in order; with the study's device, if it has
    one.

    mapper: calls the recipes of those that are not kept from an earlier run.
    Raises what a recipe raises: SettingError for a target that it cannot serve.
    """
    jobs: list[_Job] = []
    for number, target in targets:
        run = study.runs[number]
        place = kept.place_of(_recipe(run), target, versions_here(run.engine))
        jobs.append((run, target, place))
    # By the number of their job; missing: numbers of those whose recipe has to run.
    settings: dict[int, Setting] = {}
    missing = []
    for job_number, job in enumerate(jobs):
        setting = _kept_setting(job)
        if setting is None:
            missing.append(job_number)
        else:
            settings[job_number] = setting
    # Runs of few settings are made first: that they are few is mostly because each takes a search.
    count = Counter(number for number, _ in targets)
    missing.sort(key=lambda job_number: count[targets[job_number][0]])
    made = mapper(_make_setting, [jobs[job_number] for job_number in missing])
    settings.update(zip(missing, made, strict=True))
    in_order = [settings[job_number] for job_number in sorted(settings)]
    if not study.device:
        return in_order
    return [replace(s, options={**s.options, "device": study.device}) for s in in_order]


def _kept_setting(job: _Job) -> Setting | None:
    run, target, place = job
    return kept.kept(_recipe(run), target, place)


def _make_setting(job: _Job) -> Setting:
    run, target, place = job
    return kept.make(_recipe(run), target, place)


def _shard_size(grid: LaunchGrid) -> int:
    """Number of launches in each shard of a grid: as few shards as may be, of one size.

    At most _ON_A_DEVICE on a device; else SHARD_IMPACTS, and about _STEPS steps in contact.
    """
    if "device" in grid.setting.options:
        return even_size(len(grid), _ON_A_DEVICE)
    scene = grid.scene
    slowest = min(grid.speeds)
    elastic = closed_form.elastic_duration(scene.stiffness, scene.exponent, scene.mass, slowest)
    # A scale, no more: elastic contact, and a few steps of flight.
    steps = math.ceil(elastic / grid.setting.timestep) + 8
    return even_size(len(grid), max(1, min(SHARD_IMPACTS, _STEPS // steps)))


@lru_cache(maxsize=64)
def versions_here(*engines: str) -> Mapping[str, str]:
    """Versions of everything that the bytes of a shard depend on: package or engine -> version.

    engines: their names.
    Raises EngineMissing for one that is not installed.
    """
    packages = {name: version(name) for name in ("hcbench", "numpy", "scipy")}
    # Only sweeps need pyarrow.
    with suppress(PackageNotFoundError):
        packages["pyarrow"] = version("pyarrow")
    for name in engines:
        packages[name] = registry.require(name)
    return packages


def digests_of(scene: Scene, engine: str) -> dict[str, str]:
    """SHA-256 of an engine's model files of a scene, by role: each file together with the files
    that it names; "" for one that is gone.

    engine: its name, with a version or without. OSError for a file that cannot be read.
    """
    digests = {}
    for role, path in sorted(scene.models.get(registry.base_name(engine), {}).items()):
        digests[role] = file_digest(path) if path.is_file() else ""
    return digests


def file_digest(path: Path) -> str:
    """SHA-256 of a file and of all files that it names, or that these name, in hexadecimal digits.

    A named file counts if it exists beside the one that names it; names are found in .xml and .urdf
    alone. Each file counts once, at its first mention: files may name each other in a circle.
    OSError for a file that cannot be read.
    """
    digests: list[str] = []
    to_read = [path]
    seen: set[Path] = set()
    while to_read:
        file = to_read.pop().resolve()
        if file in seen:
            continue
        seen.add(file)
        own, names = _content_and_names(file, file.stat().st_mtime_ns)
        digests.append(own)
        to_read += [file.parent / name for name in reversed(names) if is_file(file.parent / name)]
    if len(digests) == 1:
        return digests[0]
    return hashlib.sha256("".join(digests).encode()).hexdigest()


@lru_cache(maxsize=256)
def _content_and_names(path: Path, _: int) -> tuple[str, list[str]]:
    """SHA-256 of a file's own bytes, and the names in it, sorted.

    _: time of the last change, ns, by which the cache tells a changed file.
    """
    content = path.read_bytes()
    names: set[str] = set()
    if path.suffix in (".xml", ".urdf"):
        names = set(_NAMED.findall(content.decode("utf-8", "replace")))
    return hashlib.sha256(content).hexdigest(), sorted(names)
