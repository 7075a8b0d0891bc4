"""The contract of an engine, stated once.

An engine builds a world, releases bodies in it, advances it, and hands back penetration, rate and
force of each step (`hcbench.sim.world`); `hcbench.sim.simulate` does the rest. None of its own
types leave it. It imports its backend late.

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

from abc import ABC, abstractmethod
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, final

from hcbench.sim import simulate
from hcbench.sim.columns import Impacts, Launches
from hcbench.sim.passivity import LongestTrain, Passivity, passivity_of
from hcbench.sim.promise import Promise
from hcbench.sim.read_impact import SpeedReading
from hcbench.system.errors import EngineFailed, SettingError
from hcbench.terms.impact import Launch
from hcbench.terms.scene import Scene
from hcbench.terms.setting import PAIR, Pair, Setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.recipes.recipe import Recipe
    from hcbench.sim.backend import Backend
    from hcbench.sim.world import World
    from hcbench.terms.impact import Impact, Trajectory


class Engine(ABC):
    """A physics engine, or anything else that can drop a body on a plate.

    name: as registered, and as settings name it.
    title: as reports print it.
    backend: the package that it needs; None for none.
    bits: of its numbers.
    oblique: launches bodies at an angle too.
    devices: that it can compute on, such as "cpu" and "gpu", where a setting's option `device` says
    so. What only some engines can do is in `hcbench.sim.capabilities`.
    default_friction: Coulomb's μ of two bodies that state none; 0 where settings to paste know no
    friction.
    keeps_friction: whether bodies keep a friction of their own under a setting that says none.
    several_corners: whether settings can be judged for bodies that land on several points at once.
    """

    name: str
    title: str = ""
    backend: Backend | None = None
    bits: int = 64
    oblique: bool = True
    devices: tuple[str, ...] = ()
    default_friction: float = 0.0
    keeps_friction: bool = False
    several_corners: bool = False

    def version(self) -> str:
        """Version of the installed backend, not imported; raises EngineMissing where there is none."""
        if self.backend is None:
            expected = "`backend`, or a method `version`"
            raise EngineFailed(f"engine {self.name!r}", "states no version", expected)
        return self.backend.version()

    def recipes(self) -> Sequence[Recipe]:
        """Recipes of the engine, the preferred one of each role first; () for an engine without
        any.

        They are RECIPES of its module, or of `recipes` in its folder. Raises what their import
        raises.
        """
        module: Any = import_module(type(self).__module__)
        if not hasattr(module, "RECIPES"):
            module = module_of(self, "recipes")
        if module is None:
            return ()
        recipes: Sequence[Recipe] = module.RECIPES
        return recipes

    @abstractmethod
    def impacts(
        self, scene: Scene, setting: Setting, launches: Sequence[Launch]
    ) -> Sequence[Impact]:
        """One impact for each launch, in order. An impact that went wrong is a record with a
        status.

        Raises SettingError for options the engine does not have, SceneError for a scene it cannot
        load.
        """

    def require_device(self, device: str) -> None:  # noqa: B027 - most have no choice
        """Raises CannotRun where this machine lacks one of the engine's `devices`."""

    @final
    def device_of(self, setting: Setting) -> str:
        """Device on which a setting asks the engine to compute, such as "gpu"; "" for none.

        An engine with `devices` then reads impacts while it steps there, and they have no loops of
        force; for an engine without `devices` it is "", whatever the setting says.
        Raises SettingError for a device that the engine does not have.
        """
        device = str(setting.options.get("device", "")) if self.devices else ""
        if device and device not in self.devices:
            expected = " or ".join(map(repr, self.devices))
            raise SettingError(f"{self.name} option 'device'", repr(device), expected)
        return device

    def trajectory(
        self, scene: Scene, setting: Setting, launch: Launch, duration: float
    ) -> Trajectory:
        """Every step of `duration` s after release, however often the body bounces.

        Raises EngineFailed where an engine knows single impacts only, SettingError for options that
        it does not have or a step too coarse for them, SceneError for a scene that it cannot load.
        """
        raise EngineFailed(
            self.name, "knows single impacts only", "an engine that can go on after one"
        )

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Text of a setting to paste into a user's model or script; "" if nothing is set.

        form: the scene's, "plane" or "cup".
        pair: names of the two in the user's model, the first moves.
        """
        return setting.options_text

    def model_options(self, setting: Setting) -> tuple[tuple[str, str], ...]:
        """Options of the whole model that a setting has, (name, text) as
        the engine's files write them.
        """
        return ()

    def promised(self, text: str, pair: Pair, promise: Promise) -> str:
        """A text to paste with what is promised of it, as `measure` can read it again."""
        return text

    def needs(self, setting: Setting) -> tuple[str, ...]:
        """Return the requirements of the pasted text on a user's model or machine, a phrase each."""
        return ()

    def passivity(
        self,
        scene: Scene,
        setting: Setting,
        speeds: tuple[float, float],
        whole: bool = False,
        train: LongestTrain | None = None,
    ) -> Passivity:
        """Test, for about a second, whether a setting ever adds energy to a ball, and how the ball
        rests on it.

        speeds: the band, lowest and highest impact speed, m/s.
        whole: run the long test instead, with drops of half a minute and with boxes.
        train: the longest train of bounces that the target allows after a drop; None: it must rest.
        The short test has no boxes: `with_boxes` adds them where they matter. Raises what `run`
        raises.
        """
        return passivity_of(self, scene, setting, speeds, whole, train)

    def with_boxes(
        self, scene: Scene, setting: Setting, passivity: Passivity, whole: bool = False
    ) -> Passivity:
        """Return what `passivity` found with findings for boxes and a capsule, up to the first that
        fails; unchanged where the engine tries none.

        whole: go on after the first that fails, to learn which is furthest above its limit.
        """
        return passivity

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """Return the setting with Coulomb's μ added to its contact, for pasting."""
        return setting

    def oblique_setting(self, setting: Setting) -> Setting | None:
        """The setting under which launches at an angle run in place of this one: its own, or that of
        another engine whose contact this engine has; None where there is none.
        """
        return setting if self.oblique else None

    def with_corners(self, setting: Setting, corners: int) -> Setting:
        """Return the setting for a body that lands on `corners` points at once."""
        return setting

    def script(self, scene: Scene, setting: Setting) -> str:
        """A whole file that runs in the plain engine; SettingError where there is none."""
        given = f"{setting.engine} {setting.name!r} in the form {scene.form!r}"
        raise SettingError("write-scene", given, "a setting that its engine can write as a file")

    @final
    def run(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """Run launches of a body onto the scene's plate with a setting's contact: one impact for
        each launch, in order.

        Raises SettingError for launches without meaning, for oblique ones where the engine has
        none, and for a scene, setting or step without meaning or a setting of another engine; and
        what the engine raises.
        """
        if not isinstance(launches, list | tuple):
            raise SettingError("launches", f"{launches!r:.80}", "a list of Launch")
        for launch in launches:
            _require_launch(launch, self.name, self.oblique)
        return list(self.run_columns(scene, setting, Launches.of(launches)).objects(launches))

    @final
    def run_columns(self, scene: Scene, setting: Setting, launches: Launches) -> Impacts:
        """Run launches by the thousand, without an object for each impact.

        Raises SettingError for a scene, a setting or a step without meaning, for a setting of
        another engine and for options that the engine does not have, SceneError for a scene that it
        cannot load, EngineMissing, EngineFailed.
        """
        _require_types(scene, setting)
        if setting.engine != self.name:
            raise SettingError("setting", f"made for {setting.engine!r}", f"one for {self.name!r}")
        if not setting.timestep > 0:
            raise SettingError("timestep", f"{setting.timestep!r} s", "a step above 0 s")
        if not len(launches):
            return Impacts.of([])
        return Impacts.of(self.impacts(scene, setting, launches))


class SteppedEngine(Engine):
    """An engine that advances in time steps: all but the closed form.

    own_process: settings of the whole process, prints and crashes: simulations run in a process of
    their own.
    limit: s, after which one launch in such a process counts as hung.
    together: launches in it at once.
    """

    own_process: bool = False
    limit: float = 30.0
    together: int = 8

    @abstractmethod
    def load(self, scene: Scene, setting: Setting, fastest: float) -> World:
        """A scene under a setting, for launches whose speed at touch is at most `fastest` m/s.

        Raises SettingError for options the engine does not have or a step too coarse for them,
        SceneError for a scene it cannot load, EngineMissing.
        """

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Quantity that the steps of a setting conserve in free flight; the
        same as in the worlds it loads.
        """
        return SpeedReading.TOUCH_PLANE

    @final
    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> Impacts:
        """One impact for each launch, in order, by `hcbench.sim.simulate`."""
        return simulate.impacts(self, scene, setting, Launches.of(launches))

    @final
    def trajectory(
        self, scene: Scene, setting: Setting, launch: Launch, duration: float
    ) -> Trajectory:
        """Every step of `duration` s after release; NaN from where the engine gave up."""
        return simulate.trajectory(self, scene, setting, launch, duration)


def _require_types(scene: object, setting: object) -> None:
    """Raises SettingError for what is of another type than a run takes, by the argument's name."""
    for slot, value, kind in (("scene", scene, Scene), ("setting", setting, Setting)):
        if not isinstance(value, kind):
            raise SettingError(slot, f"{value!r:.80}", f"a {kind.__name__}")


def _require_launch(launch: Launch, engine: str, oblique: bool) -> None:
    """Raise SettingError for what is not a Launch, for one without speed and height, which would
    never touch, and for an oblique one in an engine that has none.

    engine: its name, for the error.
    oblique: whether it has oblique launches.
    """
    if not isinstance(launch, Launch):
        raise SettingError("launch", f"{launch!r:.200}", "a Launch")
    if launch.speed == 0 and not launch.height:
        raise SettingError(
            "speed", f"{launch.speed!r} m/s", "a speed above 0, or a height to fall from"
        )
    if not oblique and launch.is_oblique:
        raise SettingError(
            "launch", f"oblique, in {engine!r}", "one along the normal, without spin"
        )


def module_of(engine: Engine, name: str) -> Any:
    """A module of the engine's folder, imported when first asked for; None where there is none.

    name: may have dots, as "model.under_test".
    Raises what the import raises.
    """
    path = type(engine).__module__.rpartition(".")[0]
    # One folder at a time: `find_spec` imports those above, and raises where there is none.
    for part in name.split("."):
        if not path or find_spec(path := f"{path}.{part}") is None:
            return None
    return import_module(path)
