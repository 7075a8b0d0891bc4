"""The contract of an engine, stated once.

An engine builds a world, releases bodies in it, advances it, and hands back penetration, rate and force of
each step; `hcbench.sim.simulate` does the rest. None of its own types leave it. It imports its backend late.

    class MyEngine(SteppedEngine):
        name, title = "myengine", "My Engine"
        backend = Backend("myengine", "its-package", "1.0", "1.2")

        def load(self, scene, setting, fastest): return MyWorld(scene, setting)

    class MyWorld(World):
        def release(self, launches): return MySimulation(self, launches)

    class MySimulation(Simulation):
        def advance(self, steps): return Record(penetration, rate, force)
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from hcbench.errors import EngineFailed, SettingError, UserError
from hcbench.sim.launch import require_launch, require_types
from hcbench.sim.read_impact import NOT_FINITE, SpeedReading

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from hcbench.impact import Floats, Impact, Launch, Trajectory
    from hcbench.laws.conventions import OneContact, Words
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.recipes.recipe import Recipe
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.backend import Backend
    from hcbench.sim.candidate_pairs import CandidatePair
    from hcbench.sim.model_under_test import ModelSetting, ModelUnderTest, Request
    from hcbench.workers import Interpreter

    Flags = NDArray[Any]


@dataclass(frozen=True, slots=True)
class Record:
    """What was seen at the start of each step; arrays of shape (b, n), SI, signs as in `hcbench.impact`.

    force: the normal contact force that acts in the step; exactly 0 where the contact did not act. All three
    are NaN from the step on at which the engine gave up.
    tangential: what was seen along the plate, shape (8, b, n), rows as `hcbench.impact` numbers them; None
    where no launch is oblique, or from an engine that knows the normal direction only.
    """

    penetration: Floats
    rate: Floats
    force: Floats
    tangential: Floats | None = None

    def rows(self) -> Floats:
        """All of it, one quantity below the other, shape (3 or 11, b, n)."""
        normal = np.stack([self.penetration, self.rate, self.force])
        return normal if self.tangential is None else np.concatenate([normal, self.tangential])


class CannotShareError(Exception):
    """Launches that were simulated together may have disturbed each other: each is to be simulated alone."""


class Simulation(ABC):
    """Some launches under way, from their release on."""

    @abstractmethod
    def advance(self, steps: int) -> Record:
        """Take at least one step and `steps` at the most; what was seen of the launches that are kept.

        Raises CannotShareError where several launches are no longer what each would be alone.
        """

    @abstractmethod
    def keep(self, which: Flags) -> None:
        """Go on with these only, shape (b,): the others have ended."""

    def remark(self, steps: int) -> str:
        """What else acted on the bodies in the first `steps` steps, in words; "" where nothing did."""
        return ""

    def close(self) -> None:  # noqa: B027 - most have nothing to put back
        """Put back what the simulation changed in its world."""


class World(ABC):
    """One or more equal bodies over what they fall on, in one engine.

    timestep: s. gravity: m/s², along the normal, into the plate. mass: effective mass along the normal, kg.
    places: launches that one simulation carries. concurrent: simulations that may be under way at once, each
    in a thread of its own. deepest: penetration beyond which the engine cannot see the contact any more, m.
    diverged: the reason to give where numbers are not finite. speed_reading: which speeds e is the ratio of.
    """

    timestep: float
    gravity: float
    mass: float
    places: int = 1
    concurrent: int = 1
    deepest: float = math.inf
    diverged: str = NOT_FINITE
    speed_reading: SpeedReading = SpeedReading.TOUCH_PLANE

    @abstractmethod
    def release(self, launches: Sequence[Launch]) -> Simulation:
        """Bodies at their starting points, `places` of them at the most, with nothing remembered."""

    def follow(self, launch: Launch) -> Simulation:
        """One launch to be followed as far as one likes, stepped exactly as the engine's users do it."""
        return self.release([launch])

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Give back what the world holds."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Engine(ABC):
    """A physics engine, or anything else that can drop a body on a plate.

    name: as registered, and as settings name it. title: as reports print it.
    suffixes: of the model files of users that it opens. opens: objects that it opens, in words.
    backend: the package that it needs; None for none. bits: of its numbers. oblique: sends bodies so too.
    interpreter: of the environment that it runs in; None for this process' own.
    """

    name: ClassVar[str]
    interpreter: ClassVar[Interpreter | None] = None
    title: ClassVar[str] = ""
    backend: ClassVar[Backend | None] = None
    bits: ClassVar[int] = 64
    oblique: ClassVar[bool] = True
    suffixes: ClassVar[tuple[str, ...]] = ()
    opens: ClassVar[tuple[str, ...]] = ()

    @property
    def install(self) -> str:
        """The command that installs the backend; "" for an engine that needs none."""
        return self.backend.command if self.backend else ""

    def version(self) -> str:
        """Version of the installed backend, not imported; raises EngineMissing where there is none."""
        assert self.backend is not None, f"engine {self.name!r} has neither a backend nor a version"
        return self.backend.version()

    def recipes(self) -> Sequence[Recipe]:
        """What makes its settings, of each role the preferred one first: `recipes.RECIPES` in its folder."""
        recipes = self.module("recipes")
        return recipes.RECIPES if recipes else ()

    def plugin(self, *, install: bool = False) -> Path:
        """The library of the contact laws for this engine, compiled when first asked for.

        install: puts it where the engine loads plug-ins from. UserError where there is none.
        """
        raise UserError(f"engine {self.name!r}", "no plug-in", "an engine for which hcbench has one")

    @abstractmethod
    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch, in order. An impact that went wrong is a record with a status.

        Raises SettingError for options the engine does not have, SceneError for a scene it cannot load.
        """

    def trajectory(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """Every step of `duration` s after release, however often the body bounces.

        Raises EngineFailed where an engine knows single impacts only.
        """
        raise EngineFailed(self.name, "knows single impacts only", "an engine that can go on after one")

    def accepts(self, source: Any) -> bool:
        """Whether `source`, a path, several or an object, is a model that `open` takes."""
        return isinstance(source, str | Path) and Path(source).suffix.lower() in self.suffixes

    def make_room(self) -> None:  # noqa: B027 - most engines keep nothing
        """Let go of what this process keeps for the engine, before code of the user's runs in it."""

    def open(self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None) -> ModelUnderTest:
        """A user's own model. rebuild: makes `source` anew, where a function of the user's made it.

        Raises UserError with the reason where the pair cannot be measured.
        """
        raise UserError("engine", repr(self.name), "an engine that opens models of users", f"{source!r}")

    def pairs(
        self,
        source: Any,
        request: Request,
        rebuild: Callable[[], Any] | None = None,
    ) -> list[CandidatePair]:
        """Which parts of a user's own model can meet, as `open` takes it; those that touch first."""
        raise UserError("engine", repr(self.name), "an engine that opens models of users", f"{source!r}")

    def model_settings(
        self,
        source: Any,
        requests: Sequence[Request],
        goal: RestitutionCurve,
        rebuild: Callable[[], Any] | None = None,
    ) -> Iterable[ModelSetting]:
        """Settings for pairs in a user's own model, each meant to have the e of `goal` there; simplest first.

        requests: one a pair, alike but for that; their speeds span the band.
        """
        raise UserError("engine", repr(self.name), "an engine that tunes models of users", f"{source!r}")

    def snippet(self, setting: Setting, form: str) -> str:
        """What to paste of a setting into a model or script of one's own; "" where nothing is set.

        form: the scene's, "plane" or "cup".
        """
        return setting.options_text

    def words(self, contact: OneContact) -> Words | None:
        """What to write for a contact, for `hcbench convert`: `words.words` in its folder, or None."""
        module = self.module("words")
        return module.words(contact) if module else None

    @final
    def module(self, name: str) -> Any:
        """A module of its folder, such as "scene.two_blocks"; None where there is none."""
        folder = type(self).__module__.rpartition(".")[0]
        parts = [f"{folder}.{'.'.join(name.split('.')[:n])}" for n in range(1, name.count(".") + 2)]
        return import_module(parts[-1]) if folder and all(map(find_spec, parts)) else None

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """The same setting that says Coulomb's μ of its contact itself, for whoever pastes it."""
        return setting

    def script(self, scene: Scene, setting: Setting) -> str:
        """A whole file that runs in the plain engine; SettingError where there is none."""
        given = f"{setting.engine} {setting.name!r} in the form {scene.form!r}"
        raise SettingError("write-scene", given, "a setting that its engine can write as a file")

    @final
    def run(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """Check the request, run it, and hand back one impact for each launch, in order."""
        require_types(scene, setting, launches)
        if setting.engine != self.name:
            raise SettingError("setting", f"made for {setting.engine!r}", f"one for {self.name!r}")
        if not setting.timestep > 0:
            raise SettingError("timestep", f"{setting.timestep!r} s", "a step above 0 s")
        for launch in launches:
            require_launch(launch, self.name, self.oblique)
        return self.impacts(scene, setting, launches)


class SteppedEngine(Engine):
    """An engine that advances in time steps: all but the closed form.

    own_process: settings of the whole process, prints and crashes: simulations run in a process of their own.
    limit: s, after which one launch in such a process counts as hung. together: launches in it at once.
    """

    own_process: ClassVar[bool] = False
    limit: ClassVar[float] = 30.0
    together: ClassVar[int] = 8

    @abstractmethod
    def load(self, scene: Scene, setting: Setting, fastest: float) -> World:
        """A scene under a setting, for launches whose speed at touch is at most `fastest` m/s.

        Raises SettingError for options the engine does not have or a step too coarse for them, SceneError for
        a scene it cannot load, EngineMissing.
        """

    @final
    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch, in order, by `hcbench.sim.simulate`."""
        from hcbench.sim import simulate

        return simulate.impacts(self, scene, setting, launches)

    @final
    def trajectory(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """Every step of `duration` s after release; NaN from where the engine gave up."""
        from hcbench.sim import simulate

        return simulate.trajectory(self, scene, setting, launch, duration)
