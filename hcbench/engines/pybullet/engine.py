"""PyBullet behind the contract of an engine.

Options of a setting (all optional; none means as loaded):
    world: keywords of setPhysicsEngineParameter. ball, plate: keywords of changeDynamics.
    law: the plug-in, in place of Bullet's own contact or before it, as
        `hcbench.laws.contact_law.law_of` reads it: {"kind": "force", "alpha": s/m, "stiffness":
        N/m^n, "exponent": n}, {"kind": "restitution", "alpha": s/m}, or with {"law": a later law's
        slug, "restitution": e} in place of alpha.
    maximal_coordinates: true for rigid bodies proper instead of Bullet's default, multibodies.

Bullet keeps contactBreakingThreshold in a global of the process, shared by all of its
clients, and some settings outlive resetSimulation. So nothing here ever steps in the user's
process: see `hcbench.workers`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.backend import BACKEND, end_clients, is_connected
from hcbench.engines.pybullet.model.open import LiveWorld
from hcbench.engines.pybullet.scene import options
from hcbench.engines.pybullet.scene.options import read_options
from hcbench.engines.pybullet.scene.world import PybulletWorld
from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.sim.capabilities import (
    DescribesContact,
    Feature,
    Features,
    HasPlugin,
    LandsRobots,
    TunesModels,
    VariesContacts,
)
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.rest import UNKNOWN, Standing
from hcbench.system.errors import UserError
from hcbench.system.text import shortest
from hcbench.terms.setting import PAIR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from hcbench.engines.pybullet.model.open import LoadedWorld
    from hcbench.engines.pybullet.model.under_test import PybulletModel
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.capabilities import VariedContact
    from hcbench.sim.landing import DropPlan, DropTest, Landings, ReboundSettings
    from hcbench.sim.model_under_test import CandidatePair, ModelSetting, Request
    from hcbench.sim.promise import Promise
    from hcbench.sim.touch import TrajectoryTouchdowns
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting


_SOURCE = "Bullet 3, btMultiBodyConstraintSolver.cpp, setupMultiBodyContactConstraint"
_CAVEAT = (
    "PyBullet multiplies the restitutions of both bodies. restitutionVelocityThreshold, contactSlop and"
    " contactERP must be 0, and contactProcessingThreshold of the body too: else nothing bounces."
)


class PybulletEngine(
    DescribesContact, HasPlugin, VariesContacts, TunesModels, LandsRobots, SteppedEngine
):
    """Bullet 3 behind its Python module."""

    name = "pybullet"
    title = "PyBullet"
    backend = BACKEND
    suffixes = (".urdf", ".sdf")
    opens = ("a PyBullet World (`hcbench docs howto/measure` makes one)",)
    own_process = True
    writes_models = False
    # lateralFriction is 0.5 of each body, and Bullet multiplies the two.
    default_friction = 0.25
    keeps_friction = True
    features = Features(
        law=Feature(
            "Newton's e in one step; or F = k x + c v, implicit, by contactStiffness and contactDamping",
            _SOURCE,
        ),
        exponent=Feature("1", _SOURCE),
        threshold=Feature("0.2 m/s unless restitutionVelocityThreshold is set", _SOURCE),
        licence=Feature("zlib", "its wheel"),
    )

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Return the calls that apply a setting to a user's two bodies."""
        return options.snippet(setting, form, pair)

    def model_options(self, setting: Setting) -> tuple[tuple[str, str], ...]:
        """Options of the model, the time step alone: Bullet's other settings of the world are in the text."""
        return (("fixedTimeStep", shortest(setting.timestep)),)

    def promised(self, text: str, pair: Pair, promise: Promise) -> str:
        """The text of a setting with a call that keeps its promise as user data of the first body.

        text: Python lines; returned as they are if they drop a ball themselves, or are not Python.
        pair: names of the two bodies' variables. promise: error of e, and its conditions.
        """
        from hcbench.engines.pybullet.model.causes import promise_line

        # A whole script has dropped its ball when it ends; other text is no Python.
        if "pybullet." not in text or "pybullet.connect(" in text:
            return text
        return "\n".join(filter(None, [text, promise_line(pair, promise)]))

    def needs(self, setting: Setting) -> tuple[str, ...]:
        """Requirements of a setting, in words: the plug-in, how the bodies are loaded, their
        variables.
        """
        needs = []
        if "law" in setting.options:
            needs.append("hcbench, which has the plug-in")
        if setting.options.get("maximal_coordinates"):
            needs.append("both bodies loaded with useMaximalCoordinates=True")
        if setting.options.get("links"):
            needs.append(
                "radius, mass, inertia and friction of the ball, whose URDF the lines write"
            )
        return (*needs, "the variables of the two bodies")

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """The setting with lateralFriction of ball and plate, which Bullet multiplies."""
        ball = {**setting.options.get("ball", {}), "lateralFriction": friction}
        plate = {**setting.options.get("plate", {}), "lateralFriction": 1.0}
        return replace(setting, options={**setting.options, "ball": ball, "plate": plate})

    def script(self, scene: Scene, setting: Setting) -> str:
        """A Python script that drops the ball on the plane."""
        return options.script(scene, setting)

    def load(self, scene: Scene, setting: Setting, fastest: float) -> PybulletWorld:
        """A scene under a setting, with its plug-in attached, for impacts at up to `fastest` m/s."""
        return PybulletWorld(scene, setting.timestep, read_options(setting.options), fastest)

    def plugin(self, *, install: bool = False) -> Path:
        """The library of hunt_crossley and restitution, for pybullet.loadPlugin.

        Raises UserError for `install`: PyBullet has no folder for plug-ins.
        """
        from hcbench.engines.pybullet import plugin

        if install:
            raise UserError(
                "--install",
                "PyBullet has no folder of its own for plug-ins",
                "pybullet.loadPlugin(path)",
            )
        return plugin.library()

    def accepts(self, source: Any) -> bool:
        """Say whether PyBullet opens this source, without opening it: a path with one of `suffixes`,
        a list of paths, a client's id, a BulletClient, a `World`, or None where the process has a
        client.
        """
        if isinstance(source, list | tuple):
            return all(isinstance(part, str | Path) for part in source)
        # An ordinary script's function returns nothing: its client is then the first one.
        if source is None:
            return is_connected()
        return (
            super().accepts(source)
            or (isinstance(source, int | LiveWorld) and not isinstance(source, bool))
            or hasattr(source, "_client")
        )

    def make_room(self) -> None:
        """End all clients: a script that names none means the first, which must be its own."""
        end_clients()

    def open(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> PybulletModel:
        """A world from files, from a `World`, or from a client."""
        from hcbench.engines.pybullet.model.under_test import open_world

        return open_world(source, request, rebuild)

    def varied(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> VariedContact:
        """A world that is made again with other restitution and friction of the pair."""
        from hcbench.engines.pybullet.model.vary import VariedWorld

        return VariedWorld(source, request, rebuild)

    def pairs(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> list[CandidatePair]:
        """Pairs of links of different bodies."""
        from hcbench.engines.pybullet.model.under_test import list_pairs_of

        return list_pairs_of(source, request, rebuild)

    def model_settings(
        self,
        source: Any,
        requests: Sequence[Request],
        goal: RestitutionCurve,
        was: Standing = UNKNOWN,
        rebuild: Callable[[], Any] | None = None,
        version: tuple[int, ...] = (),
    ) -> Iterable[ModelSetting]:
        """Settings for pairs of a user's world, each meant to have the e of `goal` there: lines of
        changeDynamics and setPhysicsEngineParameter for all pairs.

        source: files, a `World`, or a client. rebuild: makes it again, where a function built it.
        requests: of the pairs. goal: e over speed. was, version: unused. Raises, as the settings
        are read, UserError for a live client, and what opening raises.
        """
        from hcbench.engines.pybullet.model.under_test import model_settings

        return model_settings(source, requests, goal, rebuild)

    def standing(
        self, source: Any, setting: ModelSetting | None, requests: Sequence[Request]
    ) -> Standing:
        """Measure how the first pair of a user's world rests on the level and on a slope.

        source: files, a `World`, or a client. setting: whose lines are run first; None: the world
        as it is. requests: of the pairs; the first counts. Raises UserError and SceneError where it
        cannot be opened.
        """
        from hcbench.engines.pybullet.model.under_test import PybulletModel

        opened = self.open(source, requests[0]) if setting is None else setting.open(requests[0])
        assert isinstance(opened, PybulletModel)
        with opened as model:
            return model.standing()

    def land(
        self,
        source: Any,
        request: Request,
        drops: DropPlan,
        rebuild: Callable[[], Any] | None = None,
    ) -> Landings:
        """Drop a robot with a free base over the fixed bodies of its world, from each height and
        tilt.

        source: files, a `World`, or a client. rebuild: makes it again, where a function built it.
        request: the pose. drops: heights, m, tilts, rad, and the controller. Raises UserError for a
        world without robot or floor, and for another process's client.
        """
        from hcbench.engines.pybullet.model.under_test import land_in

        return land_in(source, request, drops, rebuild)

    def landing(
        self,
        source: Any,
        requests: Sequence[Request],
        like: DropTest | None = None,
        until_worse: bool = False,
    ) -> DropTest:
        """Drop a robot of joints with a free base over the fixed bodies of its world, and judge how
        it lands.

        source: files, a `World`, a client, or one of these with a setting. requests: of the pairs
        of its feet with the floor. like: a test whose length this one takes; None: long enough to
        come to rest. until_worse: one drop is enough where something is worse in it than in all of
        `like`. Raises UserError where the pairs are not of a robot that can fall.
        """
        from hcbench.engines.pybullet.model.drop_test import ChangedWorld, WorldDropBench

        if isinstance(source, ChangedWorld):
            bench = source.bench or WorldDropBench(source.build(), requests, source.apply)
        else:
            bench = WorldDropBench(_opened(source, requests), requests)
        return bench.whole_test(like, until_worse)

    def rebound_settings(
        self, source: Any, requests: Sequence[Request], before: DropTest, rebound: float
    ) -> ReboundSettings:
        """One spring of contactStiffness and contactDamping for all feet."""
        from hcbench.engines.pybullet.model.foot_springs import rebound_settings

        return rebound_settings(lambda: _opened(source, requests), requests, before, rebound)

    def touchdowns(
        self, source: Any, request: Request, recorded: Mapping[str, Floats]
    ) -> TrajectoryTouchdowns:
        """Find where a recorded motion met the bodies that do not move."""
        from hcbench.engines.pybullet.model.under_test import touchdowns_in

        return touchdowns_in(source, request, recorded)

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """Bullet's restitution of a contact."""
        if contact.restitution is None:
            return Vocabulary(caveats=(_CAVEAT,))
        note = f"{contact.at}; on one body, 1 on the other"
        value = SystemValue("PyBullet", "restitution", (contact.restitution,), "", note)
        return Vocabulary((value,), caveats=(_CAVEAT,))


def _opened(source: Any, requests: Sequence[Request]) -> LoadedWorld:
    """The world of files, a `World` or a client. Raises SceneError for files that do not load."""
    from hcbench.engines.pybullet.model.under_test import loaded

    world, _ = loaded(source, None, requests[0].packages)
    return world
