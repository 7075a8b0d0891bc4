"""A study: a scene x engines x recipes x α x speeds x phases x steps, and how its file is read."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench import units
from hcbench.errors import StudyError
from hcbench.scene import Scene, load_scene

if TYPE_CHECKING:
    from collections.abc import Mapping


_MOST_PHASES = 1000
_PACKAGE = Path(__file__).parents[1]
_BUILT_IN = (_PACKAGE.parent / "reports", _PACKAGE / "data" / "studies")  # a checkout's, a wheel's


@dataclass(frozen=True, slots=True)
class Run:
    """One line of a study: a recipe at some steps, over some speeds, for some α."""

    engine: str
    recipe: str
    timesteps: tuple[float, ...]
    alphas: tuple[float, ...]
    speeds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Study:
    """What to run. SI. `loop_speeds` are launched too, and their loops kept (at the middle phase).

    main_alpha, step_speed: the α and the speed that figures of one α or one speed show. train_height, m, and
    train_step, s: settings at that step are dropped from there under gravity too, for ten bounces.
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

    def described(self) -> dict[str, Any]:
        """As JSON, defaults filled in."""
        own = {
            f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in ("scene", "runs")
        }
        scene = self.scene
        return {
            **{k: list(v) if isinstance(v, tuple) else v for k, v in own.items()},
            "scene": scene.name,
            "form": scene.form,
            "gravity": scene.gravity,
            "mass_kg": scene.mass,
            "stiffness": scene.stiffness,
            "exponent": scene.exponent,
            "relative_radius_m": scene.relative_radius,
            "runs": [dataclasses.asdict(run) for run in self.runs],
        }

    def quick(self) -> Study:
        """A preview of itself: every fourth speed, half the phases, every second step.

        Curves of fewer α than the study's are left out: they are there for settings that take a search.
        """
        thin = {self.speeds: self.speeds[3::4] or self.speeds}
        runs = tuple(
            dataclasses.replace(run, speeds=thin.get(run.speeds, run.speeds), timesteps=run.timesteps[::2])
            for run in self.runs
            if run.speeds != self.speeds or set(run.alphas) == set(self.alphas)
        )
        return dataclasses.replace(
            self,
            speeds=thin[self.speeds],
            phases=max(1, self.phases // 2),
            runs=runs,
            title=f"{self.title} (quick)",
        )


_STUDY_KEYS = {
    "schema": "the number 1",
    "title": "text",
    "scene": "a scene's name or folder",
    "alphas": 'like "0.002, 0.004 s/in"',
    "speeds": 'like "1:20 in/s"',
    "loop_speeds": 'like "4, 8 in/s"',
    "phases": "a whole number",
    "main_alpha": 'like "0.008 s/in"',
    "step_speed": 'like "8 in/s"',
    "train_height": 'like "10 mm"',
    "train_step": 'like "1e-3 s"',
    "gravity": 'like "9.81 m/s^2"',
    "run": "[[run]] tables",
}
_RUN_KEYS = {
    "engine": "an engine's name",
    "recipe": "a recipe's name",
    "timesteps": 'like "1e-3, 2e-3 s"',
    "alphas": 'like "0.008 s/in"',
    "speeds": 'like "8 in/s"',
}


def find_study(name: str) -> Path:
    """The study.toml that a path, a folder or a built-in name means."""
    path = Path(name)
    if path.is_dir() and (path / "study.toml").is_file():
        return path / "study.toml"
    if path.is_file():
        return path
    for folder in _BUILT_IN:
        for candidate in (folder / name / "study.toml", folder / f"{name}.toml"):
            if candidate.is_file():
                return candidate
    known = sorted(
        {p.parent.name if p.name == "study.toml" else p.stem for f in _BUILT_IN for p in f.glob("**/*.toml")}
    )
    raise StudyError(
        "study", f"{name!r} was not found", f"a study.toml, its folder, or one of: {', '.join(known)}"
    )


def name_of(path: Path) -> str:
    """What a study's file is called by: its folder for a study.toml, its own name for any other."""
    own = path.parent.resolve().name if path.name == "study.toml" else path.stem
    return own or path.stem


def load_study(path: str | Path) -> Study:
    """Read a study.toml; StudyError for anything that is not one, with the line's name."""
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError(
            "study", f"{path} does not exist", "a study.toml or the name of a built-in study"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError("study", f"{path}: {error}", "a readable TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise StudyError("study", f"{path} is not TOML: {error}", "TOML") from None
    return study_from(content, str(path), path.parent)


def study_from(content: Mapping[str, Any], where: str = "study", folder: Path | None = None) -> Study:
    """A Study from a study file's content; `folder` is where relative scene paths start."""
    _known(content, _STUDY_KEYS, where)
    schema = content.get("schema", 1)
    if schema != 1 or not isinstance(schema, int) or isinstance(schema, bool):
        raise StudyError(
            f"{where}: schema", f"{schema!r}", _STUDY_KEYS["schema"], "A newer hcbench may read it"
        )
    for key in ("scene", "alphas", "speeds", "run"):
        if key not in content or content[key] in ("", []):
            raise StudyError(f"{where}: {key}", "missing", _STUDY_KEYS[key])
    scene = load_scene(content["scene"], folder)
    if "gravity" in content:
        scene = dataclasses.replace(
            scene, gravity=units.parse(content["gravity"], "acceleration", f"{where}: gravity")
        )
    phases = content.get("phases", 8)
    if not isinstance(phases, int) or isinstance(phases, bool) or not 1 <= phases <= _MOST_PHASES:
        raise StudyError(f"{where}: phases", f"{phases!r}", f"a whole number from 1 to {_MOST_PHASES}")
    alphas = _values(content["alphas"], "alpha", f"{where}: alphas", positive=False)
    speeds = _values(content["speeds"], "speed", f"{where}: speeds")
    main_alpha = _one(content.get("main_alpha", alphas[len(alphas) // 2]), "alpha", f"{where}: main_alpha")
    if main_alpha not in alphas:
        raise StudyError(f"{where}: main_alpha", f"{main_alpha:.6g} s/m", "one of the study's alphas")
    runs = content["run"]
    if not isinstance(runs, list) or not all(isinstance(run, dict) for run in runs):
        raise StudyError(f"{where}: run", f"{runs!r:.60}", "[[run]] tables")
    return Study(
        title=_text(content, "title", where) if "title" in content else scene.title,
        scene=scene,
        alphas=alphas,
        speeds=speeds,
        loop_speeds=_values(content["loop_speeds"], "speed", f"{where}: loop_speeds")
        if "loop_speeds" in content
        else (),
        phases=phases,
        main_alpha=main_alpha,
        step_speed=_one(content.get("step_speed", speeds[len(speeds) // 2]), "speed", f"{where}: step_speed"),
        runs=tuple(_run(run, f"{where}: run {i}", alphas, speeds) for i, run in enumerate(runs, 1)),
        train_height=_maybe(content, "train_height", "length", where),
        train_step=_maybe(content, "train_step", "timestep", where),
    )


def _maybe(content: Mapping[str, Any], key: str, quantity: str, where: str) -> float | None:
    if key not in content:
        return None
    value = units.parse(content[key], quantity, f"{where}: {key}")
    units.require_positive(value, quantity, f"{where}: {key}")
    return value


def _run(content: Mapping[str, Any], where: str, alphas: tuple[float, ...], speeds: tuple[float, ...]) -> Run:
    _known(content, _RUN_KEYS, where)
    for key in ("engine", "recipe", "timesteps"):
        if key not in content:
            raise StudyError(f"{where}: {key}", "missing", _RUN_KEYS[key])
    return Run(
        engine=_text(content, "engine", where),
        recipe=_text(content, "recipe", where),
        timesteps=_values(content["timesteps"], "timestep", f"{where}: timesteps"),
        alphas=_values(content["alphas"], "alpha", f"{where}: alphas", positive=False)
        if "alphas" in content
        else alphas,
        speeds=_values(content["speeds"], "speed", f"{where}: speeds") if "speeds" in content else speeds,
    )


def _text(content: Mapping[str, Any], key: str, where: str) -> str:
    value = content[key]
    if not isinstance(value, str) or not value.strip():
        expected = {**_STUDY_KEYS, **_RUN_KEYS}[key]
        raise StudyError(f"{where}: {key}", f"{value!r:.60}", expected)
    return value


def _known(content: Mapping[str, Any], keys: Mapping[str, str], where: str) -> None:
    for key in content:
        if key not in keys:
            raise StudyError(f"{where}: {key}", "unknown key", f"one of: {', '.join(keys)}")


def _values(value: object, quantity: str, slot: str, positive: bool = True) -> tuple[float, ...]:
    found = units.parse_values(value, quantity, slot)
    if positive:
        units.require_positive(found, quantity, slot)
    elif (found < 0).any():
        raise StudyError(slot, f"{found.min():g}", "0 or more")
    return tuple(dict.fromkeys(found.tolist()))


def _one(value: object, quantity: str, slot: str) -> float:
    return units.parse(value, quantity, slot)
