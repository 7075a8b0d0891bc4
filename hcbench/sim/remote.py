"""An engine in an environment of its own: it does what the engine beside hcbench would, in a worker there.

The worker imports the hcbench that started it, and the engine's adapter, from where they lie here; all other
packages are the environment's.
"""

from __future__ import annotations

import dataclasses
import re
import sys
from functools import cache, partial
from importlib import metadata
from typing import TYPE_CHECKING, Any, ClassVar

from hcbench.errors import EngineMissing, UserError
from hcbench.workers import Interpreter, call

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from hcbench.environments.store import Environment
    from hcbench.impact import Impact, Launch, Trajectory
    from hcbench.recipes.recipe import Recipe
    from hcbench.recipes.target import Target
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.backend import Backend
    from hcbench.sim.engine import Engine

_WORKER = ("numpy", "scipy", "pint", "pydantic")
STEP_S = 1e-3  # for one step of a trajectory, beyond the engine's limit for a launch
_SETUP = """
import sys
from importlib.util import module_from_spec, spec_from_file_location
for name, file, folders in {modules!r}:
    spec = spec_from_file_location(name, file, submodule_search_locations=folders)
    sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])
from hcbench.sim import registry
registry.adopt({values!r})
"""


class _Renamed:
    """An engine under a name that says its version."""

    name: ClassVar[str]
    backend: ClassVar[Backend]

    def recipes(self) -> Sequence[Recipe]:
        """The engine's own, under this name."""
        own: Sequence[Recipe] = super().recipes()  # type: ignore[misc]
        return [dataclasses.replace(recipe, engine=self.name) for recipe in own]


class _Absent(_Renamed):
    """A version that is not there: all that needs it says so."""

    def version(self) -> str:
        """Raises EngineMissing."""
        advice = f"Try: {self.backend.add_command(self.name)}"
        raise EngineMissing(f"engine {self.name!r}", "not installed", "", advice)

    def _missing(self, *_: Any, **__: Any) -> Any:
        return self.version()

    impacts = trajectory = plugin = script = open = pairs = model_settings = _missing


class _Elsewhere(_Renamed):
    """A version in an environment of its own."""

    environment: ClassVar[Environment]
    interpreter: ClassVar[Interpreter]
    limit: ClassVar[float]

    def version(self) -> str:
        """As it was installed. Raises EngineMissing where this hcbench needs what its environment lacks."""
        if lacking := set(worker_requirements()) - set(self.environment.requirements):
            got = f"its environment is of another hcbench, without {', '.join(sorted(lacking))}"
            advice = f"Try: {self.backend.add_command(self.environment.name)}"
            raise EngineMissing(f"engine {self.name!r}", got, "", advice)
        return self.environment.version

    def recipes(self) -> Sequence[Recipe]:
        """The engine's own, made there: what they write may depend on the version."""
        return [
            dataclasses.replace(recipe, function=partial(self._options, recipe.name))
            for recipe in super().recipes()
        ]

    def _options(self, recipe: str, target: Target, *integrator: str) -> Mapping[str, Any]:
        options: Mapping[str, Any] = call(
            _options_here, self.name, recipe, target, *integrator, limit=None, at=self.interpreter
        )
        return options

    def _ask(self, method: str, *args: Any, launches: int = 0, steps: float = 0.0) -> Any:
        # As for such an engine beside hcbench: one that never hangs has all the time that it takes.
        hangs = getattr(self, "own_process", False) and launches
        limit = launches * self.limit + steps * STEP_S if hangs else None
        return call(_ask_here, self.name, method, *args, limit=limit, at=self.interpreter)

    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """As the engine's own."""
        found: list[Impact] = self._ask("impacts", scene, setting, launches, launches=len(launches))
        return found

    def trajectory(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """As the engine's own."""
        steps = duration / setting.timestep
        path: Trajectory = self._ask("trajectory", scene, setting, launch, duration, launches=1, steps=steps)
        return path

    def script(self, scene: Scene, setting: Setting) -> str:
        """As the engine's own."""
        text: str = self._ask("script", scene, setting)
        return text

    def plugin(self, *, install: bool = False) -> Path:
        """As the engine's own; installed into the environment."""
        path: Path = call(_plugin_here, self.name, install, limit=None, at=self.interpreter)
        return path

    def _refuse(self, *_: Any, **__: Any) -> Any:
        got = f"{self.name!r} is in an environment of its own, and given an object of this one"
        raise UserError("engine", got, "a model's file", "An object is measured by the engine beside hcbench")

    open = pairs = model_settings = _refuse


def _options_here(name: str, recipe: str, target: Target, *integrator: str) -> Mapping[str, Any]:
    from hcbench.sim import registry

    return registry.recipes(name)[recipe].function(target, *integrator)


def _ask_here(name: str, method: str, *args: Any) -> Any:
    from hcbench.sim import registry

    return getattr(registry.engine(name), method)(*args)


def _plugin_here(name: str, install: bool) -> Path:
    from hcbench.sim import registry

    return registry.engine(name).plugin(install=install)


@cache
def worker_requirements() -> tuple[str, ...]:
    """What hcbench itself imports in a worker process, as pip writes it."""
    names = re.compile(f"({'|'.join(_WORKER)})\\b")
    return tuple(line for line in metadata.requires("hcbench") or () if names.match(line) and ";" not in line)


@cache
def renamed(engine: Engine, name: str) -> Engine:
    """The engine of this process under another name, such as "myengine@1.2"."""
    return engine if name == engine.name else _made(engine, name, _Renamed)


@cache
def absent(engine: Engine, name: str) -> Engine:
    """A version of an engine of which nothing but its words is there."""
    return _made(engine, name, _Absent)


@cache
def elsewhere(engine: Engine, name: str, environment: Environment) -> Engine:
    """The engine in an environment."""
    return _made(engine, name, _Elsewhere, environment=environment, interpreter=interpreter(environment))


def interpreter(environment: Environment) -> Interpreter:
    """What runs worker processes in an environment: with its engine, and those of hcbench that it may use."""
    from hcbench.sim import registry

    values = {name: registry.entry_point(name).value for name in registry.names()}
    tops = {name: value.partition(":")[0].partition(".")[0] for name, value in values.items()}
    modules = []
    for top in dict.fromkeys(("hcbench", tops[environment.engine])):
        module = sys.modules[top]
        modules.append((top, module.__file__, list(module.__path__) if hasattr(module, "__path__") else None))
    known = {n: v for n, v in values.items() if tops[n] in ("hcbench", tops[environment.engine])}
    setup = _SETUP.format(modules=modules, values=known)
    return Interpreter(environment.name, str(environment.executable), setup)


def _made(engine: Engine, name: str, kind: type, **about: Any) -> Engine:
    version = name.partition("@")[2]
    title = f"{engine.title or engine.name} {version}".strip()
    cls = type(engine)
    about |= {"name": name, "title": title, "__module__": cls.__module__}  # where its own modules are
    made: Engine = type(cls.__name__, (kind, cls), about)()
    return made
