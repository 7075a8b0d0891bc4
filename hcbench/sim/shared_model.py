"""Engines that step what another one loads: its scenes and its users'
models, in many copies at once.

The other engine compiles a file, prepares the launches and reads the
bounces; this one takes the steps.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import map_result
from hcbench.sim import registry
from hcbench.sim.capabilities import OpensModels, VariedContact, VariesContacts, opener
from hcbench.sim.columns import Impacts
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.read_impact import (
    NEVER,
    Reading,
    SpeedReading,
    begun,
    contacts_of,
    reader,
    rule_for,
)
from hcbench.sim.scripted import BatchWorld, PythonLaw, python_law_of, require_motion
from hcbench.system.errors import EngineFailed, SettingError, UserError
from hcbench.terms.setting import PAIR

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from hcbench.recipes.recipe import Recipe
    from hcbench.recipes.target import Target
    from hcbench.sim.columns import Launches
    from hcbench.sim.model_under_test import CandidatePair, ModelUnderTest, Request
    from hcbench.sim.passivity import LongestTrain, Passivity
    from hcbench.sim.read_impact import Rule
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting


# Places in a ball's state: velocities come after the 7 positions of a free joint.
HEIGHT = 2
RISING = 7 + 2
# Steps between two looks at which launches have ended.
_LOOK = 16
# Once so many times fewer launches than began go on, the steps of the
# other copies are not worth it.
_FEW = 8
# The few that are left go on for as many times the steps of the longest launch, and so many more.
_LONGER = 4
_REST = 256
# Copies in a batch, at least.
_WIDTH = 32


class Copies(ABC):
    """Copies of a model: `places` where steps are recorded, any number to read from.

    bits: of the numbers.
    room: copies that the memory has room for.
    kind: of the floats that `read_on` computes with.
    """

    places: int
    bits: int
    room: int = 0
    kind: type = np.float64

    @abstractmethod
    def place(self, states: Floats) -> Floats:
        """Put the copies into states, positions and then velocities, with nothing else remembered;
        as the engine then has them. Both of shape (b, n), SI; b is `places` where `step` follows.
        """

    @abstractmethod
    def step(self, steps: int) -> Floats:
        """States after each of at most `steps` more steps, SI: shape (k, places, n) of k steps taken
        and n numbers a state, positions and then velocities.
        """

    def read_on(self, rule: Rule, reading: Reading, fewest: int, most: int) -> Reading:
        """Step balls on and read each step, until at most `fewest` go on or `most` steps are taken.

        rule: when each ball's impact ends, from `rule_for`.
        reading: what was read of each until now, from `begun` or from here; returned as it is then,
        arrays of shape (b,).
        """
        add = reader(np)
        while np.count_nonzero(reading.end == 0) > fewest and reading.steps.max() < most:
            for state in self.step(_LOOK):
                reading = Reading(*add(state[:, HEIGHT], state[:, RISING], *rule, *reading))
        return reading

    def place_balls(self, rest: Floats, heights: Floats, rising: Floats) -> Floats:
        """Place balls that differ in height and in velocity upwards alone; both as the engine then
        has them, (2, b).

        rest: state of a ball at rest, (n,).
        heights: (b,), m.
        rising: (b,), m/s.
        """
        states = np.tile(rest, (len(heights), 1))
        at = [HEIGHT, RISING]
        states[:, at] = np.stack([heights, rising], axis=1)
        return self.place(states)[:, at].T

    def place_first(self, states: Floats) -> Floats:
        """Place the first copies by their states, shape (b, n); the others follow the last of them."""
        others = np.repeat(states[-1:], self.places - len(states), axis=0)
        return self.place(np.concatenate([states, others]))[: len(states)]


class CopiesWorld(BatchWorld):
    """Copies of a scene whose ball has one free joint.

    rest: its state at rest, shape (n,).
    """

    def __init__(
        self, scene: Scene, timestep: float, copies: Copies, rest: Floats, reading: SpeedReading
    ) -> None:
        """Take up copies of a scene's ball, all at rest.

        timestep: s.
        copies: of the engine, which steps them.
        rest: state of the ball at rest, (n,).
        reading: how speeds are read.
        """
        super().__init__(scene, timestep)
        self._copies = copies
        self._rest = rest
        self.speed_reading = reading
        self.places = copies.places
        self.bits = copies.bits
        self.room = copies.room
        self._at = [HEIGHT, RISING]

    def place(self, heights: Floats, velocities: Floats) -> Floats:
        """Put the balls at heights, m, with velocities upwards, m/s; both as the engine then has
        them, (2, b).
        """
        return self._copies.place_balls(self._rest, heights, velocities)

    def read(self, launches: Launches) -> Impacts:
        """The impacts of launches, in order, read while all are stepped together.

        Once most have ended the batch stops, and the few that are left begin again in a batch of
        their own: so a few long contacts do not keep all copies stepping.
        """
        left = np.arange(len(launches))
        parts: list[Impacts] = []
        # Places of the parts' launches among all.
        order: list[Any] = []
        while left.size:
            reading = self._read(launches.take(left))
            has_ended = reading.end > 0
            contacts = contacts_of(Reading(*(column[has_ended] for column in reading)))
            ended = left[has_ended]
            order.append(ended)
            # Speed gained in a step of free fall, m/s.
            gained = self.gravity * self.timestep
            speeds = self.speed_reading.speeds(contacts.came, contacts.left, gained, self.gravity)
            parts.append(
                contacts.impacts(launches.take(ended), speeds, self.timestep, self.diverged)
            )
            left = left[~has_ended]
        return Impacts.joined(parts).take(np.argsort(np.concatenate(order)))

    def _read(self, launches: Launches) -> Reading:
        """Step a copy of the scene for each launch, and return what was read of each, (b,); `end` is
        0 for a launch that has not ended.

        Copies of the last launch fill the batch to a size that may have been compiled before. Of
        many launches it stops once 7 in 8 have ended, or a few steps later.
        """
        count = len(launches)
        # Batches are a multiple of this: an eighth to a sixteenth of the launches, a power of 2.
        unit = max(_WIDTH, 2 ** (count.bit_length() - 4))
        padded = -(-count // unit) * unit
        in_batch = launches.take(np.minimum(np.arange(padded), count - 1))
        heights = self.scene.touch_radius + in_batch.clearance(self.timestep)
        placed_heights, rising = self.place(heights, -in_batch.speed)
        kind = self._copies.kind
        rule = rule_for(in_batch, self.scene, self.timestep, self.bits, kind)
        reading = begun(placed_heights, rising, kind)
        few = 0
        if padded > _FEW * _WIDTH:
            few = padded // _FEW
        reading = self._copies.read_on(rule, reading, few, NEVER)
        if few:
            most = _LONGER * int(reading.steps.max()) + _REST
            reading = self._copies.read_on(rule, reading, 0, most)
        return Reading(*(column[:count] for column in reading))

    def step(self, steps: int) -> Floats:
        """Up to as many steps as the copies take at once."""
        return self._copies.step(steps)[:, :, self._at].transpose(0, 2, 1)


class LendsSteps(ABC):
    """A user's model whose steps another engine can take."""

    @abstractmethod
    def stepped_by(self, engine: SharedModelEngine) -> ModelUnderTest:
        """The same pair, read as here and stepped by another engine."""


class _SharedVaried(VariedContact):
    """A model of another engine whose pair can be changed, stepped by this one."""

    def __init__(self, engine: SharedModelEngine, varied: VariedContact) -> None:
        self.parameters = varied.parameters
        self._engine = engine
        self._varied = varied

    def open(self, request: Request, values: Mapping[str, float]) -> ModelUnderTest:
        """The model of the other engine with the values, stepped by this one."""
        return self._engine.stepping(self._varied.open(request, values))


class SharedModelEngine(VariesContacts, SteppedEngine):
    """An engine that steps what another one loads.

    model_engine: the one that compiles the model.
    own: words of the options that it does not have.
    lacks: its features that this engine ignores without a warning, as it names them.
    exact: how to have it compute in 64 bits.
    """

    model_engine: str
    own: tuple[str, ...] = ("law", "device")
    lacks: frozenset[str] = frozenset()
    exact = ""
    oblique = False
    several_corners = True

    @abstractmethod
    def copies(
        self,
        model: Any,
        start: Any,
        bits: int = 0,
        law: str = "",
        radius: float = 0.0,
        device: str = "",
    ) -> Copies:
        """Make copies of a model for this engine to step.

        model: as `model_engine` compiled it.
        start: a state of that engine; the copies keep its controls, activations, moved bodies and
        active equalities, and `place` sets positions and velocities.
        bits: of the numbers; 0 for those that users get who set nothing.
        law: lines of code, as `law_lines` makes them, of a law for a ball of this radius, m, above
        z = 0; "" for the engine's own contact.
        device: one of `devices`, on which impacts are read; "" for the engine's own choice, and for
        recorded steps.
        Raises SceneError for what this engine does not have, CannotRun for a device that this
        machine lacks.
        """

    @abstractmethod
    def law_lines(self, law: PythonLaw | None, pair: Pair = PAIR) -> str:
        """Lines in the engine's own words that put a law into its steps; "" for none.

        pair: names of the two geoms.
        """

    def bits_of(self, setting: Setting) -> int:
        """Return the bits of the engine's numbers under a setting. Raises SettingError."""
        return self.bits

    def load(self, scene: Scene, setting: Setting, fastest: float) -> CopiesWorld:
        """Load a scene under a setting: a world with copies of it, for launches that touch at up to
        `fastest` m/s.

        Raises SettingError for what this engine does otherwise than `model_engine`, for a step too
        short for its numbers and for options that it does not have; SceneError and CannotRun as
        `copies` does.
        """
        bits = self.bits_of(setting)
        law = self.law(setting)
        require_motion(scene, setting.timestep, fastest, bits)
        lent = registry.submodule(self.model_engine, "scene.shared_scene")
        loaded = lent.load_scene(
            self.script(scene, setting), contact=not isinstance(law, HuntCrossley)
        )
        for difference in lent.differences(loaded.model, self, bits):
            got = f"{difference.title.removesuffix('.')} ({difference.evidence})"
            raise SettingError(f"{setting.engine} {setting.name!r}", got, "", difference.fix)
        lines = self.law_lines(law)
        device = self.device_of(setting)
        copies = self.copies(loaded.model, loaded.start, bits, lines, scene.touch_radius, device)
        reading = SpeedReading.TOUCH_PLANE
        if loaded.exact_flight:
            reading = SpeedReading.TOUCH_PLANE_EXACT_FLIGHT
        return CopiesWorld(scene, setting.timestep, copies, loaded.rest, reading)

    def accepts(self, source: Any) -> bool:
        """Never chosen automatically: without --engine, `model_engine` opens the file."""
        return False

    def open(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> ModelUnderTest:
        """Open a user's model by `model_engine`, to be stepped by this engine.

        source: the model.
        request: the pair, its pose, and the launches.
        rebuild: makes the model again, or None.
        Raises EngineFailed where the model cannot be stepped by another engine, UserError where the
        pair cannot be measured, EngineMissing where an engine is not installed.
        """
        return self.stepping(self._opener().open(source, request, rebuild))

    def stepping(self, opened: ModelUnderTest) -> ModelUnderTest:
        """A model that `model_engine` opened, stepped by this engine.

        Raises EngineFailed where it cannot be stepped by another, SceneError for what this one does
        not have.
        """
        if not isinstance(opened, LendsSteps):
            got = f"cannot step a {type(opened).__name__}"
            raise EngineFailed(self.name, got, "a model of its `model_engine`")
        return opened.stepped_by(self)

    def varied(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> VariedContact:
        """Open a user's model by `model_engine` so that the contact of its pair can be changed, and
        let this engine step it.

        source: the model.
        rebuild: makes it again, or None.
        Raises UserError where that engine varies no contacts or the pair cannot be measured,
        EngineMissing where it is not installed.
        """
        lender = self._opener()
        if not isinstance(lender, VariesContacts):
            raise UserError("engine", repr(self.name), "an engine that varies contacts")
        return _SharedVaried(self, lender.varied(source, request, rebuild))

    def pairs(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> list[CandidatePair]:
        """The pairs of a model, as `model_engine` lists them."""
        return self._opener().pairs(source, request, rebuild)

    def _opener(self) -> OpensModels:
        return opener(registry.engine(self.model_engine))

    def _shared(self, setting: Setting) -> Setting:
        """Part of a setting that `model_engine` reads, as a setting of that engine."""
        options = {word: value for word, value in setting.options.items() if word not in self.own}
        return replace(setting, engine=self.model_engine, options=options)

    def law(self, setting: Setting) -> PythonLaw | None:
        """Return the law of a setting that Python code applies; None without one."""
        return python_law_of(setting.options["law"]) if "law" in setting.options else None

    def script(self, scene: Scene, setting: Setting) -> str:
        """The scene of `model_engine`."""
        if scene.form != "plane":
            got = f"the form {scene.form!r}"
            raise SettingError(f"{setting.engine} {setting.name!r}", got, "the form 'plane'")
        return registry.engine(self.model_engine).script(scene, self._shared(setting))

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Return the law's lines; without a law, the snippet of `model_engine`."""
        lines = self.law_lines(self.law(setting), pair)
        return lines or registry.engine(self.model_engine).snippet(
            self._shared(setting), form, pair
        )

    def needs(self, setting: Setting) -> tuple[str, ...]:
        """Return the requirements: the law's lines around each step, or those of `model_engine`."""
        if self.law_lines(self.law(setting)):
            return ("the lines in your own loop, from Python",)
        return registry.engine(self.model_engine).needs(self._shared(setting))

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """The setting with friction in its rows, as `model_engine` writes it; a law has none."""
        if self.law(setting) is not None:
            return setting
        return registry.engine(self.model_engine).with_friction(setting, friction)

    def with_corners(self, setting: Setting, corners: int) -> Setting:
        """The setting with its rows at each of several points; a law has none."""
        if self.law(setting) is not None:
            return setting
        return registry.engine(self.model_engine).with_corners(setting, corners)

    def oblique_setting(self, setting: Setting) -> Setting | None:
        """The setting of `model_engine`, whose contact this engine has; None with a law."""
        return None if self.law(setting) is not None else self._shared(setting)

    def passivity(
        self,
        scene: Scene,
        setting: Setting,
        speeds: tuple[float, float],
        whole: bool = False,
        train: LongestTrain | None = None,
    ) -> Passivity:
        """Test whether a setting adds energy: by impacts along the normal in this engine, and, but
        for a setting with a law, also in `model_engine`, which has bodies that slide.

        speeds: the band, lowest and highest impact speed, m/s.
        whole: run the long test, with drops of half a minute and with boxes.
        train: the longest train of bounces that the target allows after a drop; None: it must rest.
        Raises SettingError for a setting that the engine cannot have, SceneError for a scene that
        it cannot load, EngineMissing, EngineFailed.
        """
        here = super().passivity(scene, setting, speeds, whole, train)
        if self.law(setting) is not None:
            return here
        other = registry.engine(self.model_engine)
        there = other.passivity(scene, self._shared(setting), speeds, whole, train)
        return replace(there, bounces=here.bounces.joined(there.bounces))

    def with_boxes(
        self, scene: Scene, setting: Setting, passivity: Passivity, whole: bool = False
    ) -> Passivity:
        """Try boxes and a capsule in `model_engine`; none with a law.

        passivity: what `passivity` found.
        whole: go on after the first body that fails.
        """
        if self.law(setting) is not None:
            return passivity
        other = registry.engine(self.model_engine)
        return other.with_boxes(scene, self._shared(setting), passivity, whole)


def shared_recipes(
    engine: str, model_engine: str, changes: Mapping[str, Mapping[str, Any]]
) -> tuple[Recipe, ...]:
    """Recipes of one engine made of those of another, on planes alone unless a change says
    otherwise.

    engine: the name of theirs.
    model_engine: the other engine.
    changes: for each recipe of the other, by name, the fields of `Recipe` that differ.
    Raises UserError for a name that the other engine does not have.
    """
    recipes = []
    for name, change in changes.items():
        original = registry.recipe(f"{model_engine}.{name}")
        fields = {"engine": engine, "forms": ("plane",), **change}
        recipes.append(replace(original, **fields))
    return tuple(recipes)


def changed(
    recipe: str, change: Callable[[Mapping[str, Any]], Mapping[str, Any]], **more: Any
) -> Callable[..., Mapping[str, Any]]:
    """Make the function of a recipe, from target to options, out of another recipe's, by changing
    the options that it returns; those that an interrupted search hands out are changed, too.

    recipe: "engine.name" of the other.
    change: from its options to those to return.
    more: further arguments of its function.
    """

    def function(target: Target, integrator: str = "Euler") -> Mapping[str, Any]:
        with map_result(change):
            return change(registry.recipe(recipe).function(target, integrator, **more))

    return function
