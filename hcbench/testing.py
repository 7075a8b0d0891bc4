"""Conformance tests of an engine, for pytest: third-party engines run the same tests as hcbench's
own.

    from hcbench.testing import EngineConformance

    class TestMyEngine(EngineConformance):
        engine = "myengine"
        scenes = ("steel-plane",)

Each test runs for the recipes and scenes that its claim is made for: roles say which, and a
class has no test for the others. A claim that only the run shows not to apply is a skip
with its reason, never a pass.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import cache
from typing import Any, ClassVar, TypeVar, cast

import numpy as np
import pytest

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.recipes.recipe import Recipe, Role
from hcbench.recipes.target import Target
from hcbench.scoring import loop_area
from hcbench.sim import registry
from hcbench.sim.engine import Engine, SteppedEngine
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.remote import adapter_of, interpreter_of
from hcbench.sim.world import World
from hcbench.system.errors import EngineMissing, SettingError
from hcbench.terms.impact import Floats, Impact, Launch
from hcbench.terms.scene import Scene, load_scene, scene_names
from hcbench.terms.setting import Setting
from hcbench.workers import call

SPEEDS = (0.05, 0.21, 0.47)
PHASES = tuple((i + 0.5) / 8 for i in range(8))
LAUNCHES = tuple(Launch(v, p) for v in SPEEDS for p in PHASES)
# α of the paper's Fig. 4, s/m.
ALPHA = 0.008 / 0.0254
# 1 to 20 in/s, in m/s.
BAND = (0.0254, 0.508)
GRAVITY = 9.80665  # m/s²
_LIMIT_S = 60.0
Answer = TypeVar("Answer")


@cache
def _scene(name: str) -> Scene:
    """A built-in scene, read once: the cases of all tests ask for it thousands of times."""
    return load_scene(name)


def target_for(recipe: Recipe, scene: Scene) -> Target:
    """The law at α = 0.008 s/in, at the step that a recipe's claims are checked at, from 1 to 20
    in/s.
    """
    if recipe.role is Role.STOCK or recipe.one_step:
        timestep = 1e-3
    elif registry.engine(recipe.engine).bits == 32:
        # In shorter steps a float32 position moves by only a few of its last digits.
        timestep = 1e-5
    elif recipe.role is Role.CONSTANT_E and not recipe.native:
        # Published laws are many, and the same lines for all: coarser is enough.
        timestep = 4e-6
    else:
        timestep = 1e-6
    return Target(HuntCrossley(scene.stiffness, ALPHA, scene.exponent), scene.mass, timestep, *BAND)


@cache
def setting_for(recipe: str, scene: str) -> Setting:
    """A recipe's setting for `target_for`."""
    return registry.recipe(recipe)(target_for(registry.recipe(recipe), _scene(scene)))


@cache
def impacts_for(recipe: str, scene: str) -> tuple[Impact, ...]:
    """Impacts of LAUNCHES."""
    engine = registry.engine(registry.recipe(recipe).engine)
    return tuple(engine.run(_scene(scene), setting_for(recipe, scene), LAUNCHES))


Applies = Callable[["type[EngineConformance]", Recipe, Scene], bool]


def _claim(*conditions: Applies) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorator of a test that runs for the recipes and scenes that meet all conditions.

    conditions: functions of the class that tests, a recipe and a scene, to True or False. The test
    is skipped where the engine, or what it needs, is not installed.
    """

    def marked(test: Callable[..., None]) -> Callable[..., None]:
        claimed = _skip_where_missing()(test)
        claimed.conditions = conditions  # type: ignore[attr-defined]
        return claimed

    return marked


@contextmanager
def _skip_where_missing() -> Iterator[None]:
    """Skip a test for what is not installed, or what an installed version lacks."""
    try:
        yield
    except EngineMissing as error:
        pytest.skip(str(error))


def _fits(_: object, recipe: Recipe, scene: Scene) -> bool:
    return scene.form in recipe.forms


def _bounces(_: object, recipe: Recipe, scene: Scene) -> bool:
    return scene.form in recipe.forms and recipe.ends is None


def _is_set(_: object, recipe: Recipe, __: Scene) -> bool:
    return recipe.role is not Role.STOCK


def _promises_e(_: object, recipe: Recipe, __: Scene) -> bool:
    """Only a law's e, or a constant of the engine's own, is known at `target_for`."""
    if recipe.role is Role.FALLING_E:
        return recipe.within > 0
    return recipe.role is not Role.STOCK and (recipe.role is not Role.CONSTANT_E or recipe.native)


class EngineConformance:
    """Subclass it as `Test...` and name the engine.

    scenes: names of those that it has files for.
    stock_damping: share of its speed that a body may lose in flight in the engine with nothing set.
    """

    engine: ClassVar[str]
    stock_damping: ClassVar[float] = 1e-9
    scenes: ClassVar[Sequence[str]] = tuple(scene_names())

    def __init_subclass__(cls, **more: object) -> None:
        """Remove the tests of claims that none of the engine's recipes makes.

        Raises UserError for an engine of no such name.
        """
        super().__init_subclass__(**more)
        for name, test in vars(EngineConformance).items():
            if hasattr(test, "conditions") and not cls._cases(test):
                setattr(cls, name, None)

    @classmethod
    def pytest_generate_tests(cls, metafunc: pytest.Metafunc) -> None:
        """Let pytest run each test of a claim once for each recipe and scene that meets the claim's
        conditions.

        Skips the whole class if the engine is not installed.
        """
        if hasattr(metafunc.function, "conditions"):
            with _skip_where_missing():
                registry.engine(cls.engine).version()
            metafunc.parametrize(("recipe", "scene"), cls._cases(metafunc.function))

    @classmethod
    def _cases(cls, test: Any) -> list[tuple[str, str]]:
        """Recipes and scenes under which a test's conditions hold."""
        cases = []
        for name, recipe in registry.recipes(cls.engine).items():
            for scene in cls.scenes:
                conditions = (applies(cls, recipe, _scene(scene)) for applies in test.conditions)
                if all(conditions):
                    cases.append((f"{cls.engine}.{name}", scene))
        return cases

    @_claim(lambda cls, recipe, scene: not _fits(cls, recipe, scene))
    def test_a_form_of_scene_that_the_recipe_is_not_for_is_refused(
        self, recipe: str, scene: str
    ) -> None:
        """SettingError names the form of a scene that the recipe is not for."""
        forms = registry.recipe(recipe).forms
        suited = next(name for name in scene_names() if _scene(name).form in forms)
        engine = registry.engine(self.engine)
        form = _scene(scene).form
        with pytest.raises(SettingError, match=form):
            engine.run(_scene(scene), setting_for(recipe, suited), LAUNCHES)

    @_claim(_fits, lambda _, recipe, __: recipe.ends is not None)
    def test_where_nothing_bounces_launches_end_as_the_recipe_says(
        self, recipe: str, scene: str
    ) -> None:
        """Each launch ends with the status and the reason that the recipe names."""
        impacts = impacts_for(recipe, scene)
        assert {i.status for i in impacts} == {registry.recipe(recipe).ends}
        assert all(i.reason for i in impacts)

    @_claim(_bounces)
    def test_an_impact_for_each_launch_in_order(self, recipe: str, scene: str) -> None:
        """Every launch parts or comes to rest."""
        impacts = impacts_for(recipe, scene)
        assert [i.launch for i in impacts] == list(LAUNCHES)
        assert all(i.is_measured for i in impacts), {i.reason for i in impacts}

    @_claim(_bounces)
    def test_no_bounce_gains_energy(self, recipe: str, scene: str) -> None:
        """0 <= e <= 1."""
        assert all(0 <= i.restitution <= 1 + 1e-9 for i in impacts_for(recipe, scene))

    @_claim(_bounces)
    def test_the_speed_in_is_the_speed_launched(self, recipe: str, scene: str) -> None:
        """The speed at touch is the launch speed: nothing slows the body down or speeds it up on the
        way, but for the engine's own damping in a recipe that sets nothing.
        """
        exact = max(1e-9, rounding(recipe))
        loss = exact
        if registry.recipe(recipe).role is Role.STOCK:
            loss = max(exact, self.stock_damping)
        assert all(
            1 - loss < i.speed_in / i.launch.speed < 1 + exact for i in impacts_for(recipe, scene)
        )

    @_claim(_bounces, _is_set, lambda _, recipe, __: not recipe.one_step)
    def test_what_the_loop_loses_is_what_the_body_loses(self, recipe: str, scene: str) -> None:
        """The area of force over penetration is the kinetic energy lost."""
        mass = _scene(scene).mass
        resolved = 0
        for impact in impacts_for(recipe, scene):
            if impact.loop is None or impact.samples < 50:
                continue
            resolved += 1
            lost = 0.5 * mass * impact.speed_in**2 * (1 - impact.restitution**2)
            assert loop_area(impact.loop) == pytest.approx(lost, rel=0.01)
        if not resolved:
            pytest.skip("its loops are not resolved")

    @_claim(_bounces, _is_set)
    def test_restitution_hardly_depends_on_the_phase(self, recipe: str, scene: str) -> None:
        """e changes by less than 0.005, or twice the recipe's tolerance, with the phase of the
        touch.
        """
        if max(i.samples for i in impacts_for(recipe, scene)) in range(6, 16):
            pytest.skip("a contact of a few steps scatters a little: `tune` says by how much")
        for speed in SPEEDS:
            e = [i.restitution for i in impacts_for(recipe, scene) if i.launch.speed == speed]
            assert max(e) - min(e) < max(0.005, 2 * registry.recipe(recipe).within)

    @_claim(_bounces)
    def test_some_launches_or_one_alone_give_the_same_bits(self, recipe: str, scene: str) -> None:
        """Results do not depend on what else is simulated, nor on how often."""
        before = impacts_for(recipe, scene)
        setting = setting_for(recipe, scene)
        engine = registry.engine(setting.engine)
        case = _scene(scene)
        some = LAUNCHES[3::7]
        again = [*engine.run(case, setting, some), *engine.run(case, setting, some[-1:])]
        for one in again:
            other = before[LAUNCHES.index(one.launch)]
            for number in ("speed_in", "speed_out", "samples"):
                assert getattr(one, number) == getattr(other, number)
            assert one.loop is not None
            assert other.loop is not None
            assert np.array_equal(one.loop.force, other.loop.force)

    @_claim(
        _bounces, lambda cls, recipe, _: recipe.role is not Role.STOCK or cls.stock_damping <= 1e-9
    )
    def test_a_drop_under_gravity_touches_at_the_speed_of_its_fall(
        self, recipe: str, scene: str
    ) -> None:
        """A body dropped from a height h touches at the speed v with v² = 2 g h: exactly where the
        engine's speeds are read at the touch plane, else up to what two steps of fall add.
        """
        setting = setting_for(recipe, scene)
        engine = registry.engine(setting.engine)
        with_gravity = dataclasses.replace(_scene(scene), gravity=GRAVITY)
        height = 1e-4 if setting.timestep < 1e-4 else 1e-2
        (impact,) = engine.run(with_gravity, setting, [Launch(0.0, height=height)])
        # Speed that one step of free fall adds, m/s.
        fall = GRAVITY * setting.timestep
        speed = (2 * GRAVITY * height) ** 0.5
        allowed = 2 * fall
        if isinstance(adapter_of(engine), SteppedEngine):
            reading = _run_where(engine, _reading_of, with_gravity, setting, BAND[1])
            # A body released at rest falls in its first step by more than g h²/2, which the reading
            # counts as a speed at the release: its share of g h, 0 for an exact flight.
            speed = math.hypot(speed, reading.share * fall)
            # The place of the touch enters by v² - 2 g x: its round-off is that of the radius.
            if "touch plane" in reading:
                place = rounding(recipe) * with_gravity.touch_radius
                allowed = 1e-8 * speed + GRAVITY * place / speed
        assert impact.speed_in == pytest.approx(speed, abs=allowed)

    @_claim(_bounces, _promises_e)
    def test_restitution_is_what_the_role_promises(self, recipe: str, scene: str) -> None:
        """e is what the recipe's role promises, as near as the recipe says: one e at all speeds, or
        that of eq. (16) at each speed.
        """
        made_by = registry.recipe(recipe)
        impacts = impacts_for(recipe, scene)
        e = np.array([i.restitution for i in impacts])
        if made_by.role is Role.CONSTANT_E:
            asked = float(closed_form.restitution(ALPHA, np.array(BAND)).mean())
            of_mean = made_by.within
            of_each = made_by.within
            if not made_by.within:
                of_mean = 2e-4
                of_each = 5e-4
                if made_by.one_step:
                    of_mean = of_each = 1e-12
            assert abs(float(e.mean()) - asked) < of_mean
            assert np.abs(e - asked).max() < of_each
        else:
            law = closed_form.restitution(ALPHA, np.array([i.speed_in for i in impacts]))
            allowed = made_by.within
            if not allowed:
                allowed = 1e-4 if made_by.native else 1e-7
            assert np.abs(e - law).max() < allowed

    @_claim(
        _bounces, lambda cls, *_: isinstance(adapter_of(registry.engine(cls.engine)), SteppedEngine)
    )
    def test_chunks_of_steps_join_without_a_seam(self, recipe: str, scene: str) -> None:
        """A simulation advanced in pieces records what it does in one."""
        setting = setting_for(recipe, scene)
        engine = registry.engine(setting.engine)
        about = (_scene(scene), setting, LAUNCHES[:2], BAND[1])
        whole = _run_where(engine, _record_in, *about, (24,))
        pieces = _run_where(engine, _record_in, *about, (5, 1, 18))
        assert np.array_equal(whole, pieces, equal_nan=True)


def rounding(recipe: str) -> float:
    """Relative error of a speed that an engine's numbers allow for."""
    bits = registry.engine(recipe.rpartition(".")[0]).bits
    return 16 * float(np.finfo(f"f{bits // 8}").eps)


def _run_where(engine: Engine, function: Callable[..., Answer], *args: Any) -> Answer:
    """Return `function(*args)`, called where the engine's simulations run: in this process, in a
    worker process, or in one of the engine's own environment.

    Raises what the function raises, and the error of a worker that died or took _LIMIT_S.
    """
    where = interpreter_of(engine)
    if getattr(adapter_of(engine), "own_process", False) or where is not None:
        return call(function, *args, limit=_LIMIT_S, at=where)
    return function(*args)


def _reading_of(scene: Scene, setting: Setting, fastest: float) -> SpeedReading:
    """Return the speed reading of a setting's world.

    fastest: m/s at touch.
    """
    with _load_world(scene, setting, fastest) as world:
        return world.speed_reading


def _record_in(
    scene: Scene, setting: Setting, launches: Sequence[Launch], fastest: float, parts: Sequence[int]
) -> Floats:
    """Penetration, rate and force of b launches at each step, SI, (3, b, n), advanced in parts.

    fastest: speed at touch, m/s.
    parts: numbers of steps, n in all. Launches are simulated together where a world has places for
    several, else one after another.
    """
    of_groups = []
    with _load_world(scene, setting, fastest) as world:
        size = len(launches)
        if not world.places > 1:
            size = 1
        for i in range(0, len(launches), size):
            group = launches[i : i + size]
            with closing(world.release(group)) as simulation:
                records = []
                for steps in parts:
                    record = simulation.advance(steps)
                    records.append((record.penetration, record.rate, record.force))
            of_groups.append(np.concatenate(records, axis=2))
    return np.concatenate(of_groups, axis=1)


def _load_world(scene: Scene, setting: Setting, fastest: float) -> World:
    engine = cast("SteppedEngine", registry.engine(setting.engine))
    return engine.load(scene, setting, fastest)
