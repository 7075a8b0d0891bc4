"""Runs an engine in a separate environment, through a worker process.

The worker imports the hcbench that started it, and the engine's adapter, from where they lie here;
all other packages are the environment's.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from functools import cache, partial
from importlib import metadata
from typing import TYPE_CHECKING, Any, NoReturn

from hcbench.sim import entry_points
from hcbench.sim.capabilities import HasPlugin, OpensModels, TunesModels, plugin_of
from hcbench.sim.entry_points import here, versioned_title
from hcbench.sim.simulate import STEP_S
from hcbench.system.errors import EngineMissing, UserError
from hcbench.terms.setting import PAIR
from hcbench.workers import Interpreter, call

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from hcbench.environments import Environment
    from hcbench.recipes.recipe import Recipe
    from hcbench.recipes.target import Target
    from hcbench.sim.engine import Engine
    from hcbench.sim.passivity import LongestTrain, Passivity
    from hcbench.sim.promise import Promise
    from hcbench.terms.impact import Impact, Launch, Trajectory
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting

_WORKER = ("numpy", "scipy", "pint", "pydantic")
_SETUP = """
import sys
from importlib.util import module_from_spec, spec_from_file_location
for name, file, folders in {modules!r}:
    spec = spec_from_file_location(name, file, submodule_search_locations=folders)
    sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
from hcbench.sim import entry_points
entry_points.adopt({values!r})
"""


class Wrapped(HasPlugin, TunesModels):
    """An engine under a name that states a version: its adapter answers what needs no backend."""

    def __init__(self, adapter: Engine, name: str) -> None:
        """Copy the properties of an engine's adapter, under a name that may state a version."""
        self.adapter = adapter
        self.name = name
        self.title = versioned_title(adapter, name)
        self.backend = adapter.backend
        self.bits = adapter.bits
        self.oblique = adapter.oblique
        self.devices = adapter.devices
        self.default_friction = adapter.default_friction
        self.keeps_friction = adapter.keeps_friction
        self.several_corners = adapter.several_corners
        if isinstance(adapter, OpensModels):
            self.suffixes = adapter.suffixes
            self.opens = adapter.opens

    def recipes(self) -> Sequence[Recipe]:
        """Return the adapter's recipes."""
        return self.adapter.recipes()

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Return the text that the adapter writes for a setting."""
        return self.adapter.snippet(setting, form, pair)

    def model_options(self, setting: Setting) -> tuple[tuple[str, str], ...]:
        """Return what the adapter says."""
        return self.adapter.model_options(setting)

    def promised(self, text: str, pair: Pair, promise: Promise) -> str:
        """Return the text with the promise that the adapter writes into it."""
        return self.adapter.promised(text, pair, promise)

    def needs(self, setting: Setting) -> tuple[str, ...]:
        """Return the adapter's requirements on a user's model or machine."""
        return self.adapter.needs(setting)

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """Return the setting with μ, as the adapter adds it."""
        return self.adapter.with_friction(setting, friction)

    def oblique_setting(self, setting: Setting) -> Setting | None:
        """Return the setting under which the adapter has launches at an angle run."""
        return self.adapter.oblique_setting(setting)

    def with_corners(self, setting: Setting, corners: int) -> Setting:
        """Return the setting for a body that lands on `corners` points at once."""
        return self.adapter.with_corners(setting, corners)

    def accepts(self, source: Any) -> bool:
        """Say whether the adapter opens models, and this one."""
        return isinstance(self.adapter, OpensModels) and self.adapter.accepts(source)


class MissingEngine(Wrapped):
    """A version that is not installed: every use raises EngineMissing
    with the command that installs it.
    """

    def version(self) -> NoReturn:
        """Raises EngineMissing."""
        advice = f"Try: {self.backend.add_command(self.name)}" if self.backend else ""
        raise EngineMissing(f"engine {self.name!r}", "not installed", "", advice)

    def _missing(self, *_: Any, **__: Any) -> NoReturn:
        self.version()

    impacts = trajectory = script = plugin = open = pairs = model_settings = _missing


class RemoteEngine(Wrapped):
    """An engine that runs in an environment of its own, in a worker process there."""

    def __init__(self, adapter: Engine, name: str, environment: Environment) -> None:
        super().__init__(adapter, name)
        self.environment = environment
        self.interpreter = interpreter(environment)
        # Time for one launch, s, after which an engine that may hang counts as hung.
        self.limit: float = getattr(adapter, "limit", 0.0)
        self._hangs: bool = getattr(adapter, "own_process", False)

    def version(self) -> str:
        """Version of the engine in its environment, as installed.

        Raises EngineMissing where this hcbench needs what that environment lacks.
        """
        if lacking := set(worker_requirements()) - set(self.environment.requirements):
            got = f"its environment is of another hcbench, without {', '.join(sorted(lacking))}"
            # An engine without a package has no environment of its own.
            assert self.backend is not None
            advice = f"Try: {self.backend.add_command(self.environment.name)}"
            raise EngineMissing(f"engine {self.name!r}", got, "", advice)
        return self.environment.version

    def recipes(self) -> Sequence[Recipe]:
        """Recipes of the adapter, each with a function that runs in the engine's environment: the
        options may depend on the engine's version.
        """
        recipes = []
        for recipe in super().recipes():
            there = partial(self._options, recipe.name)
            recipes.append(dataclasses.replace(recipe, function=there))
        return recipes

    def _options(self, recipe: str, target: Target, *integrator: str) -> Mapping[str, Any]:
        """Options that a recipe gives for a target, computed in the engine's environment."""
        options: Mapping[str, Any] = call(
            _options_there, self.name, recipe, target, *integrator, limit=None, at=self.interpreter
        )
        return options

    def _call(self, method: str, *args: Any, launches: int = 0, steps: float = 0.0) -> Any:
        """Call a method of the adapter in its environment, within the time that launches may take.

        method: its name.
        args: its arguments.
        launches, steps: how many it simulates, and steps in all beyond those of impacts; without
        launches there is no limit.
        Raises what the method does, and the error of a worker that died or hung.
        """
        limit = None
        # An engine that never hangs has all the time that it takes, as beside hcbench.
        if self._hangs and launches:
            limit = launches * self.limit + steps * STEP_S
        return call(_call_there, self.name, method, *args, limit=limit, at=self.interpreter)

    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """Simulate the launches in the engine's environment."""
        impacts: list[Impact] = self._call(
            "impacts", scene, setting, launches, launches=len(launches)
        )
        return impacts

    def require_device(self, device: str) -> None:
        """Raise CannotRun where the engine sees no such device in its environment."""
        self._call("require_device", device)

    def trajectory(
        self, scene: Scene, setting: Setting, launch: Launch, duration: float
    ) -> Trajectory:
        """Simulate one launch for `duration`, s, in the engine's environment; arguments as of
        `Engine.trajectory`.

        Raises what the engine raises there, and the error of a worker that died or hung.
        """
        steps = duration / setting.timestep
        path: Trajectory = self._call(
            "trajectory", scene, setting, launch, duration, launches=1, steps=steps
        )
        return path

    def passivity(
        self,
        scene: Scene,
        setting: Setting,
        speeds: tuple[float, float],
        whole: bool = False,
        train: LongestTrain | None = None,
    ) -> Passivity:
        """Test, in the engine's environment, whether a setting ever adds energy to a ball.

        speeds: the band, lowest and highest impact speed, m/s.
        whole: run the long test, with drops of half a minute and with boxes.
        train: the longest train of bounces that the target allows after a drop; None: it must rest.
        Raises SettingError for a setting that the engine cannot have, SceneError for a scene that
        it cannot load, EngineFailed.
        """
        passivity: Passivity = self._call("passivity", scene, setting, speeds, whole, train)
        return passivity

    def with_boxes(
        self, scene: Scene, setting: Setting, passivity: Passivity, whole: bool = False
    ) -> Passivity:
        """Try boxes in the engine's environment; as `Engine.with_boxes`."""
        tried: Passivity = self._call("with_boxes", scene, setting, passivity, whole)
        return tried

    def script(self, scene: Scene, setting: Setting) -> str:
        """Write the script of a setting in the engine's environment."""
        text: str = self._call("script", scene, setting)
        return text

    def plugin(self, *, install: bool = False) -> Path:
        """Compile the plug-in in the engine's environment and return its path.

        install: copy it into that environment.
        """
        path: Path = call(_plugin_there, self.name, install, limit=None, at=self.interpreter)
        return path

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        """Refuse an object of this process: it cannot be sent there. Raises UserError."""
        got = f"{self.name!r} is in an environment of its own, and given an object of this one"
        raise UserError(
            "engine", got, "a model's file", "An object is measured by the engine beside hcbench"
        )

    open = pairs = model_settings = _refuse


def _options_there(name: str, recipe: str, target: Target, *integrator: str) -> Mapping[str, Any]:
    (known,) = (own for own in here(name).recipes() if own.name == recipe)
    return known.function(target, *integrator)


def _call_there(name: str, method: str, *args: Any) -> Any:
    return getattr(here(name), method)(*args)


def _plugin_there(name: str, install: bool) -> Path:
    return plugin_of(here(name), install)


@cache
def worker_requirements() -> tuple[str, ...]:
    """Return the packages that hcbench itself imports in a worker process, as requirements of pip."""
    names = re.compile(f"({'|'.join(_WORKER)})\\b")
    return tuple(
        line for line in metadata.requires("hcbench") or () if names.match(line) and ";" not in line
    )


@cache
def missing(adapter: Engine, name: str) -> Engine:
    """A version of an engine that is not installed."""
    return MissingEngine(adapter, name)


@cache
def remote(adapter: Engine, name: str, environment: Environment) -> Engine:
    """The engine in an environment."""
    return RemoteEngine(adapter, name, environment)


def adapter_of(engine: Engine) -> Engine:
    """The adapter of an engine, in whichever environment it runs."""
    return engine.adapter if isinstance(engine, Wrapped) else engine


def interpreter_of(engine: Engine) -> Interpreter | None:
    """The Python of the environment that an engine runs in; None for that of this process."""
    return engine.interpreter if isinstance(engine, RemoteEngine) else None


def interpreter(environment: Environment) -> Interpreter:
    """The interpreter for worker processes of an environment, with a setup that makes hcbench and
    the module of the environment's engine importable there, from their files here.

    Both have to be imported in this process before. Only engines of these two are registered there.
    """
    # Of each registered engine the entry point, and the top-level module in which that is.
    values: dict[str, str] = {}
    tops: dict[str, str] = {}
    for name in entry_points.names():
        values[name] = entry_points.entry_point(name).value
        module_path, _, _ = values[name].partition(":")
        tops[name], _, _ = module_path.partition(".")
    # Packages to make importable, each once.
    wanted = dict.fromkeys(("hcbench", tops[environment.engine]))
    modules = []
    for top in wanted:
        module = sys.modules[top]
        # A module of one file has no folders.
        folders = None
        if hasattr(module, "__path__"):
            folders = list(module.__path__)
        modules.append((top, module.__file__, folders))
    known = {name: value for name, value in values.items() if tops[name] in wanted}
    setup = _SETUP.format(modules=modules, values=known)
    return Interpreter(environment.name, str(environment.executable), setup)
