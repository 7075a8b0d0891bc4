"""A study: scenes x engines x recipes x α x speeds x phases x steps, and how its file is read."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import Field, StrictBool, StrictInt

from hcbench.catalogue.find import find
from hcbench.recipes.target import default_band
from hcbench.system.errors import SceneError, StudyError, UserError
from hcbench.terms.arguments import checked, checked_fields
from hcbench.terms.fields import (
    Acceleration,
    Alpha,
    Alphas,
    Angles,
    Clearance,
    Clearances,
    FileTable,
    Friction,
    Length,
    Speed,
    Speeds,
    Spin,
    Step,
    Steps,
    Text,
    read_toml,
    validate,
)
from hcbench.terms.scene import Scene, load_scene

# The keys of a study file and of its runs.

_MOST_PHASES = 1000


class SentTable(FileTable):
    """Gravity, friction, angles and spin of the launches: for all runs of a study, or one."""

    gravity: Acceleration | None = None
    friction: Friction | None = None
    angles: Angles | None = None
    spin: Spin | None = None


class RunTable(SentTable):
    """A [[run]] of a study file."""

    engine: Text = Field(description="an engine's name")
    recipe: Text = Field(description="a recipe's name")
    timesteps: Steps
    alphas: Alphas | None = None
    material: Text | None = Field(None, description="a pair of materials with an α")
    speeds: Speeds | None = None
    heights: Clearances | None = None
    default_band: StrictInt | None = Field(
        None, ge=2, le=1000, description="how many speeds over the default band of each step"
    )
    scene: Any = None
    off_axis: Length = 0.0


class StudyFile(SentTable):
    """A study file: its keys, without those of its runs."""

    schema_: StrictInt = Field(
        1, alias="schema", ge=1, le=1, description="the number 1; a newer hcbench may read others"
    )
    title: Text | None = Field(None, description="text")
    scene: Any = Field(description="a scene's name or folder")
    alphas: Alphas | None = None
    material: Text | None = Field(None, description="a pair of materials with an α")
    speeds: Speeds
    loop_speeds: Speeds = ()
    phases: StrictInt = Field(
        8, ge=1, le=_MOST_PHASES, description=f"a whole number from 1 to {_MOST_PHASES}"
    )
    main_alpha: Alpha | None = None
    step_speed: Speed | None = None
    train_height: Clearance | None = None
    train_step: Step | None = None
    page: Literal["report", "field"] = "report"
    all_loops: StrictBool = Field(False, description="true or false")
    run: list[dict[str, Any]] = Field(min_length=1, description="[[run]] tables")


Table = TypeVar("Table", StudyFile, RunTable)


# The unit in text such as "4, 16 in/s" or "4 inch/s"; "m/min" has none.
_INCHES = re.compile(r"(?<![a-z])in(ch(es)?)?(?![a-z])")
# Steps of one drop, at most.
_MOST_STEPS = 1e9
_PACKAGE = Path(__file__).parents[1]
# Studies lie beside the package in a checkout, and inside it in a wheel.
_BUILT_IN = (_PACKAGE.parent / "reports", _PACKAGE / "data" / "studies")


@dataclass(frozen=True, slots=True)
class Run:
    """One line of a study: a recipe at some steps, over some speeds, for some α.

    timesteps: s.
    alphas: s/m.
    speeds: at the touch, m/s.
    scene: with the run's own gravity, friction and place off the axis.
    dropped: bodies fall to touch at these speeds; else they are launched at them.
    angles: from the normal, rad: each launch is made at each of them.
    spin: of all launches, see `Launch`, rad/s.
    """

    engine: str
    recipe: str
    timesteps: tuple[float, ...]
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]
    scene: Scene
    dropped: bool = False
    angles: tuple[float, ...] = (0.0,)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def is_oblique(self) -> bool:
        """True if any launch has an angle or spin."""
        return any(self.angles) or any(self.spin)

    def described(self) -> dict[str, Any]:
        """This part of the study as JSON, SI: a key for each field, and the scene by its name.

        Angles, spin and friction are left out where there are none.
        """
        left_out = {"scene"}
        if not self.is_oblique:
            left_out |= {"angles", "spin"}
        described: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            if field.name not in left_out:
                described[field.name] = getattr(self, field.name)
        described["scene"] = self.scene.name
        described["gravity"] = self.scene.gravity
        described["off_axis"] = self.scene.off_axis
        if self.scene.friction:
            described["friction"] = self.scene.friction
        return described


@checked_fields
@dataclass(frozen=True)
class Study:
    """Runs of a study, SI. `loop_speeds` are launched too; their loops (at the middle phase) are
    kept and scored.

    alphas: α of the laws, s/m.
    speeds, loop_speeds: of impacts, m/s.
    phases: launches a speed.
    all_loops: keep those at every other speed of the band too, and of the drops, to look at.
    scene: the main one; each run has its own.
    main_alpha, step_speed: the α and the speed that figures of one α or one speed show.
    train_height, m: settings that run under gravity are dropped from there and followed bounce
    after bounce until they rest; those at the step train_step, s, too, without having to.
    page: what is written of it; "field": all installed engines side by side.
    missing: engines of the study that are not installed.
    speed_unit: that its speeds are shown in, "in/s" or "m/s", as they were written.
    left_out: of a preview, which parts of its study it has and which it lacks, in words.
    device: that its engines compute on, in batches of any size; "" for each engine's own way.
    """

    title: str
    scene: Scene
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]
    loop_speeds: tuple[float, ...]
    phases: int
    main_alpha: float
    step_speed: float
    runs: tuple[Run, ...]
    train_height: float | None = None
    train_step: float | None = None
    page: str = "report"
    missing: tuple[str, ...] = ()
    all_loops: bool = False
    speed_unit: str = "in/s"
    left_out: str = ""
    device: str = ""

    @property
    def is_oblique(self) -> bool:
        """True if any run has oblique launches."""
        return any(run.is_oblique for run in self.runs)

    def described(self) -> dict[str, Any]:
        """The study as JSON, SI, defaults filled in, without what a plain study lacks."""
        left_out = {"scene", "runs"}
        for name in ("left_out", "device"):
            if not getattr(self, name):
                left_out.add(name)
        if self.page == "report":
            left_out.add("page")
            if not self.missing:
                left_out.add("missing")
        described: dict[str, Any] = {}
        for field in dataclasses.fields(self):
            if field.name not in left_out:
                value = getattr(self, field.name)
                # JSON has lists, and no tuples.
                if isinstance(value, tuple):
                    value = list(value)
                described[field.name] = value
        scene = self.scene
        return {
            **described,
            "scene": scene.name,
            "form": scene.form,
            "gravity": scene.gravity,
            "mass_kg": scene.mass,
            "stiffness": scene.stiffness,
            "exponent": scene.exponent,
            "relative_radius_m": scene.relative_radius,
            "scenes": {run.scene.name: _described(run.scene) for run in self.runs},
            "runs": [run.described() for run in self.runs],
        }

    def of_engines(self, there: Callable[[str], bool]) -> Study:
        """Return the study without the runs of missing engines, which its `missing` names.

        there: whether the engine of a name is installed.
        Raises StudyError if no engine is left.
        """
        missing = dict.fromkeys(run.engine for run in self.runs if not there(run.engine))
        runs = tuple(run for run in self.runs if run.engine not in missing)
        if not runs:
            raise StudyError(
                "study", "none of its engines is installed", "one", "`hcbench engines` lists them"
            )
        return dataclasses.replace(self, runs=runs, missing=(*self.missing, *missing))

    def quick(self) -> Study:
        """A preview of itself, which takes a fraction of its time. left_out says what it is
        without. Raises StudyError where no run is left.
        """
        return preview(self)


def find_study(name: str) -> Path:
    """The study.toml that a path, a folder or a built-in name means, looked for in this order.

    Raises StudyError where none is found.
    """
    path = Path(name)
    if path.is_dir() and (path / "study.toml").is_file():
        return path / "study.toml"
    if path.is_file():
        return path
    for folder in _BUILT_IN:
        for candidate in (folder / name / "study.toml", folder / f"{name}.toml"):
            if candidate.is_file():
                return candidate
    built_in = sorted({name_of(p) for folder in _BUILT_IN for p in folder.glob("**/*.toml")})
    raise StudyError(
        "study",
        f"{name!r} was not found",
        f"a study.toml, its folder, or one of: {', '.join(built_in)}",
    )


def is_built_in(path: Path) -> bool:
    """Say whether a study.toml is one of hcbench's own: a missing engine is then a gap in its page."""
    return any(path.resolve().is_relative_to(folder.resolve()) for folder in _BUILT_IN)


def name_of(path: Path) -> str:
    """Name of a study: its folder for a study.toml, else the name of its file."""
    name = path.parent.resolve().name if path.name == "study.toml" else path.stem
    return name or path.stem


@checked
def load_study(path: str | Path) -> Study:
    """Read a study.toml. Relative paths of scenes in it start at its folder.

    Raises StudyError for anything that is not one, with the name of the key, and SceneError for a
    scene that cannot be read.
    """
    path = Path(path)
    content = read_toml(path, StudyError, "study", "a study.toml or the name of a built-in study")
    return study_from(content, str(path), path.parent)


def study_from(
    content: Mapping[str, Any], where: str = "study", folder: Path | None = None
) -> Study:
    """A Study from a study file's content; `folder` is where relative scene paths start.

    where: name of the file in errors.
    Raises StudyError for content of another form,
    and for a main α or a step's speed that is not among the study's; SceneError for a scene that
    cannot be read.
    """
    file = validate(StudyFile, content, StudyError, f"{where}: {{}}")
    file = _with_alphas(file, where, folder)
    if file.alphas is None:
        expected = "numbers in s/m, text like '0.008 s/in', or a material"
        raise StudyError(f"{where}: alphas", "missing", expected)
    scene = load_scene(file.scene, folder)
    scene = dataclasses.replace(scene, **_stated(file))
    # Unless the file states them, the middle α and the middle speed.
    main_alpha = file.main_alpha
    if main_alpha is None:
        main_alpha = file.alphas[len(file.alphas) // 2]
    if main_alpha not in file.alphas:
        raise StudyError(
            f"{where}: main_alpha", f"{main_alpha:.6g} s/m", "one of the study's alphas"
        )
    step_speed = file.step_speed or file.speeds[len(file.speeds) // 2]
    if not any(math.isclose(step_speed, speed) for speed in (*file.speeds, *file.loop_speeds)):
        raise StudyError(
            f"{where}: step_speed", f"{step_speed:.6g} m/s", "one of the study's speeds"
        )
    # All tables are read before any of their scenes; by their name in errors.
    tables: dict[str, RunTable] = {}
    for number, table in enumerate(file.run, 1):
        line = f"{where}: run {number}"
        run_table = validate(RunTable, table, StudyError, f"{line}: {{}}")
        tables[line] = _with_alphas(run_table, line, folder)
    runs: list[Run] = []
    for line, run_table in tables.items():
        runs += _runs(run_table, line, file, scene, folder)
    _require_short_drop(file, runs, where)
    # The page's unit is that in which the file states its speeds.
    speed_unit = "m/s"
    if _INCHES.search(str(content.get("speeds"))):
        speed_unit = "in/s"
    return Study(
        title=file.title or scene.title,
        scene=scene,
        alphas=file.alphas,
        speeds=file.speeds,
        loop_speeds=file.loop_speeds,
        phases=file.phases,
        main_alpha=main_alpha,
        step_speed=step_speed,
        runs=tuple(runs),
        train_height=file.train_height,
        train_step=file.train_step,
        page=file.page,
        speed_unit=speed_unit,
        all_loops=file.all_loops,
    )


def _with_alphas(table: Table, where: str, folder: Path | None) -> Table:
    """The table with the α of its material, s/m, if it names one; else the table itself.

    where: name of the table in errors.
    folder: where the path of a material file starts.
    Raises StudyError for a material with alphas, and for one that is not known or has no α.
    """
    if table.material is None:
        return table
    slot = f"{where}: material"
    if table.alphas is not None:
        raise StudyError(slot, "given with alphas", "one of the two")
    try:
        alpha = find(table.material, folder).alpha()
    except UserError as error:
        raise StudyError(slot, error.got, error.expected, error.advice) from None
    return table.model_copy(update={"alphas": (alpha,), "material": None})


def _require_short_drop(file: StudyFile, runs: Sequence[Run], where: str) -> None:
    """Raise StudyError where bodies are dropped from so high that too many steps are to be
    simulated.

    file: the study as it was read.
    runs: its runs, whose steps, s, count where they are dropped.
    where: name of the study's file in errors. A study without a height for its drops passes.
    """
    if file.train_height is None:
        return
    steps = [file.train_step or math.inf]
    for run in runs:
        if run.dropped:
            steps += run.timesteps
    # s: within half of it ten bounces are over, also where none loses energy. A fall from 5 m
    # takes 1 s, and each bounce after the first fall two falls: 1 + 2 * 10.
    seconds = 42.0 * math.sqrt(file.train_height / 5.0)
    count = seconds / min(steps)
    if count > _MOST_STEPS:
        got = f"{file.train_height:g} m, a drop of {count:.2g} steps"
        raise StudyError(f"{where}: train_height", got, f"up to {_MOST_STEPS:g} steps")


def _runs(
    table: RunTable, where: str, file: StudyFile, scene: Scene, folder: Path | None
) -> Iterator[Run]:
    """The runs of a [[run]] table: one, or with `default_band` one for each step, dropped over that
    step's own band of speeds.

    where: name of the table in errors.
    folder: where the path of a scene starts.
    Raises StudyError for keys that contradict one another, and SceneError for a scene that cannot
    be read.
    """
    run = _run(table, where, file, scene, folder)
    if table.default_band is None:
        yield run
        return
    if not run.scene.gravity or table.speeds is not None or table.heights is not None:
        expected = 'default_band alone, with gravity = "9.81 m/s^2"'
        raise StudyError(f"{where}: default_band", "given without gravity or with speeds", expected)
    last = table.default_band - 1
    for timestep in run.timesteps:
        low, high = default_band(timestep, run.scene.gravity)
        # Denser at the slow end.
        speeds = [low + (high - low) * (i / last) ** 2 for i in range(last)]
        speeds.append(high)
        yield dataclasses.replace(run, timesteps=(timestep,), speeds=tuple(speeds), dropped=True)


def _run(table: RunTable, where: str, file: StudyFile, scene: Scene, folder: Path | None) -> Run:
    """A run of a study's file; what it leaves out is the study's.

    where: name of the table in errors.
    folder: where the path of a scene starts.
    Raises StudyError for heights with speeds or without gravity, and for gravity, friction or a
    place off the axis that its scene cannot have; SceneError for a scene that cannot be read.
    """
    own = scene
    if table.scene is not None:
        own = load_scene(table.scene, folder)
        own = dataclasses.replace(own, gravity=scene.gravity, friction=scene.friction)
    try:
        own = dataclasses.replace(own, off_axis=table.off_axis, **_stated(table))
    except SceneError as error:
        raise StudyError(
            f"{where}: {error.slot}", error.got, error.expected, error.advice
        ) from None
    speeds = table.speeds or file.speeds
    if table.heights is not None:
        expected = 'heights alone, with gravity = "9.81 m/s^2"'
        if table.speeds is not None:
            raise StudyError(f"{where}: heights", "given with speeds", expected)
        if not own.gravity:
            raise StudyError(f"{where}: heights", "given without gravity", expected)
        # A fall from rest: v² = 2 g h.
        speeds = tuple(math.sqrt(2.0 * own.gravity * height) for height in table.heights)
    return Run(
        engine=table.engine,
        recipe=table.recipe,
        timesteps=table.timesteps,
        alphas=table.alphas or file.alphas or (),
        speeds=speeds,
        scene=own,
        dropped=table.heights is not None,
        angles=table.angles or file.angles or (0.0,),
        spin=table.spin or file.spin or (0.0, 0.0, 0.0),
    )


def _stated(table: SentTable) -> dict[str, Any]:
    """Gravity (m/s²) and friction of the scene, by these names, as far as the study's file states
    them; empty where it states neither.
    """
    stated = {"gravity": table.gravity, "friction": table.friction}
    return {name: value for name, value in stated.items() if value is not None}


def _described(scene: Scene) -> dict[str, Any]:
    """Form and size of a scene, as JSON."""
    return {"form": scene.form, "relative_radius_m": scene.relative_radius}


def preview(study: Study) -> Study:
    """A smaller study: the main α alone, every fourth speed, half the phases, and every second step,
    or in a run of drops every second height; its `left_out` says so. A run with speeds of its own
    keeps them.

    Without oblique launches, those off the axis, and launches over the band for fewer α than the
    study's: these are the settings that each take a search. A table of engines by step has every
    second step of the study, so that each has all engines.
    Raises StudyError where no run is left.
    """
    speeds = study.speeds[3::4]
    if len(speeds) < 2:
        # Few speeds: the ends of the band stand for it.
        speeds = study.speeds[:: max(1, len(study.speeds) - 1)]
    phases = max(1, study.phases // 2)
    runs = []
    for run in study.runs:
        if not _is_shown(run, study):
            continue
        thinned = _thinned(run, study, speeds)
        if thinned.timesteps:
            runs.append(thinned)
    if not runs:
        got = "every run is oblique, off the axis or without the main α"
        raise StudyError("quick", got, "a run that a preview can show", "Run it without --quick")
    left_out = (
        f"{len(speeds)} of {len(study.speeds)} speeds, {phases} of {study.phases} phases, 1 of "
        f"{len(study.alphas)} α, every second height or step, and {len(runs)} of "
        f"{len(study.runs)} runs: none launched obliquely, off the axis or for fewer α; no PNG files"
    )
    return replace(
        study,
        title=f"{study.title} (quick)",
        alphas=(study.main_alpha,),
        speeds=speeds,
        phases=phases,
        runs=tuple(runs),
        left_out=left_out,
    )


def _is_shown(run: Run, study: Study) -> bool:
    """True for a run that a preview has: see `preview`."""
    if study.main_alpha not in run.alphas or run.is_oblique or run.scene.off_axis:
        return False
    over_band = not run.dropped and run.speeds == study.speeds
    return not over_band or set(run.alphas) == set(study.alphas)


def _thinned(run: Run, study: Study, speeds: tuple[float, ...]) -> Run:
    """A run as a preview has it: for the main α, and fewer speeds or steps. It may have no steps
    left.

    study: gives the main α and the steps of all runs.
    speeds: m/s, in place of the study's band; a run with speeds of its own keeps them.
    """
    run = replace(run, alphas=(study.main_alpha,))
    if run.dropped:
        # Every second speed, and the last one: the band stays, also that of two.
        slower = run.speeds[:-2:2] or run.speeds[:-1]
        return replace(run, speeds=(*slower, run.speeds[-1]))
    steps = run.timesteps[::2]
    if study.page == "field":
        # Every second step of all engines: those of one engine alone may be others.
        steps_of_study: set[float] = set()
        for other in study.runs:
            steps_of_study.update(other.timesteps)
        in_order = sorted(steps_of_study)
        shown = in_order[1::2] or in_order
        steps = tuple(step for step in run.timesteps if step in shown)
    if run.speeds != study.speeds:
        speeds = run.speeds
    return replace(run, speeds=speeds, timesteps=steps)
