"""MuJoCo: its own contact, from stock to matched, through the contract.

Options of a setting (all optional; none means as authored):
    integrator: "Euler", "implicit", "implicitfast", "RK4" or "discrete".
    rows: contact constraints that take the place of the model's own, each {"solref": [2 numbers],
        "solimp": [5 numbers], "onset": depth at which it starts, m, "adhesion": force with which
        it may pull, N, "friction": coefficient, "solreffriction": [2 numbers]}. On a plane each is
        a <pair>, all of the same two geoms; in a cup each is a tendon's limit.
    cone, impratio: of the <option>, for all contacts.
    friction: μ of a force law, in the text to paste.
    law: a plug-in in the model, in place of MuJoCo's own contact, as
        `hcbench.laws.contact_law.law_of` reads it: {"kind": "force", "alpha": s/m, "stiffness":
        N/m^n, "exponent": n}, {"kind": "restitution", "alpha": s/m}, or with {"law": a later law's
        slug, "restitution": e} in place of alpha.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import BACKEND
from hcbench.engines.mujoco.scene import mjcf
from hcbench.engines.mujoco.scene.mjcf import Options, read_options
from hcbench.engines.mujoco.scene.scene_model import load
from hcbench.engines.mujoco.scene.world import BatchPool, MujocoWorld
from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.contact_law import is_force
from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.sim.capabilities import (
    DescribesContact,
    Feature,
    Features,
    HasPlugin,
    LandsRobots,
    RandomizesContacts,
    TunesModels,
    VariesContacts,
)
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.rest import UNKNOWN, Standing
from hcbench.system.errors import EngineMissing, UserError
from hcbench.terms.setting import PAIR

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.capabilities import ContactFamily, VariedContact
    from hcbench.sim.landing import DropPlan, DropTest, Landings, ReboundSettings
    from hcbench.sim.model_under_test import CandidatePair, ModelSetting, Request
    from hcbench.sim.passivity import LongestTrain, Passivity
    from hcbench.sim.promise import Promise
    from hcbench.sim.rest import LandingPeak
    from hcbench.sim.touch import TrajectoryTouchdowns
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting

# One contact as MuJoCo writes it: solref, for `hcbench convert`.

_CAVEATS = (
    "These numbers need a constant solimp, 0.9999 0.9999 0.001. MuJoCo's default varies with penetration.",
    "MuJoCo mixes solref and solimp of the two geoms: set both, or a <pair>.",
)


def vocabulary(contact: OneContact) -> Vocabulary:
    """Write one contact in MuJoCo's parameters: the solref of a bounce in one step, and that of a
    spring and damper; with sentences on what is missing for either, and caveats.

    contact: a contact without an e gives neither.
    """
    rows: list[SystemValue] = []
    missing: list[str] = []
    if contact.restitution is not None:
        rows += _one_step(contact.restitution, contact.timestep, missing)
        rows += _spring_damper(contact.restitution, contact.contact_time, contact.timestep, missing)
    return Vocabulary(tuple(rows), tuple(missing), _CAVEATS)


def _one_step(e: float, timestep: float | None, missing: list[str]) -> list[SystemValue]:
    """solref of a bounce in one step of `timestep`, s, with this e.

    missing: gets a sentence for what cannot be written.
    """
    if timestep is None:
        missing.append("MuJoCo's one-step bounce: it needs the timestep.")
        return []
    note = (
        "without friction, bounces in one step, Euler or implicitfast; solimp 0.9999 0.9999 0.001"
    )
    return [SystemValue("MuJoCo", "solref", (0.0, -(1.0 + e) / timestep), "", note)]


def _spring_damper(
    e: float, contact_time: float | None, timestep: float | None, missing: list[str]
) -> list[SystemValue]:
    """solref of a spring and damper with this e, in both of its forms; [] where the contact time is
    missing.

    contact_time: s, that it lasts.
    timestep: s, where it is known: a time constant below two of them gets a note.
    missing: gets a sentence for what cannot be written.
    """
    if contact_time is None:
        missing.append("MuJoCo's spring and damper: it needs the contact time.")
        return []
    # Of unit mass, as MuJoCo's numbers are per mass.
    law = kv.matched(e, contact_time, 1.0, kv.Ending.FORCE)
    zeta = kv.damping_ratio(law, 1.0)
    note = "spring and damper per unit effective mass; constant solimp, at least 20 steps a contact"
    direct = SystemValue("MuJoCo", "solref", (-law.stiffness, -law.damping), "1/s², 1/s", note)
    if zeta == 0.0:
        missing.append("MuJoCo's timeconst: without damping it is infinite.")
        return [direct]
    timeconst = 2.0 / law.damping
    note = "the same as timeconst, dampratio"
    if timestep is not None and timeconst < 2.0 * timestep:
        note += "; refsafe would raise timeconst to twice the step and change e"
    return [direct, SystemValue("MuJoCo", "solref", (timeconst, zeta), "s, 1", note)]


_DOCS = "MuJoCo documentation, Computation: Soft contact model"


class MujocoEngine(
    DescribesContact,
    HasPlugin,
    RandomizesContacts,
    VariesContacts,
    TunesModels,
    LandsRobots,
    SteppedEngine,
):
    """MuJoCo behind its Python bindings, 3.3 and later."""

    name = "mujoco"
    title = "MuJoCo"
    backend = BACKEND
    suffixes = (".xml", ".mjcf", ".mjb", ".mjz")
    opens = ("an MjModel", "an MjData", "an MjSpec")
    # Of two geoms, and of a <pair>: friction "1 0.005 0.0001".
    default_friction = 1.0
    several_corners = True
    features = Features(
        law=Feature("F = m d (k x + b v), clipped at 0; k, b by solref, d(x) by solimp", _DOCS),
        exponent=Feature("1; d(x) or several pairs give others", _DOCS),
        threshold=Feature("none", "measured down to 1 mm/s"),
        licence=Feature("Apache-2.0", "its wheel"),
    )

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """One contact in MuJoCo's parameters, for `hcbench convert`: see `vocabulary`."""

        return vocabulary(contact)

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Return the MJCF of a setting, to paste: its rows or its law, else its options as text.

        form: "cup" for limits of a tendon, else <pair>s.
        pair: names of the two geoms.
        Raises SettingError for an option that MuJoCo does not have.
        """
        if "law" not in setting.options:
            rows = mjcf.rows_snippet(setting, form, pair) if setting.options.get("rows") else ""
            return rows or setting.options_text
        from hcbench.engines.mujoco.plugin import law_snippet

        options = read_options(setting.options)
        assert options.law is not None
        return law_snippet(options.law, form, pair, options.friction)

    def model_options(self, setting: Setting) -> tuple[tuple[str, str], ...]:
        """Attributes of <option> and their text."""
        return tuple(mjcf.option_attributes(setting).items())

    def promised(self, text: str, pair: Pair, promise: Promise) -> str:
        """The text of a setting with a <custom> section that states its promise.

        text: a snippet or a whole model.
        Returned unchanged where it has neither a <pair> nor a plug-in, or where no text can state
        the promise's target.
        """
        from hcbench.engines.mujoco.model.promises import promise_lines

        if "<pair" not in text and "<plugin" not in text:
            return text
        lines = promise_lines([pair], promise)
        if not lines:
            return text
        head, end, tail = text.rpartition("</mujoco>")
        if end:
            return f"{head}{lines}\n{end}{tail}"
        return f"{text}\n{lines}"

    def needs(self, setting: Setting) -> tuple[str, ...]:
        """Return the requirements of a setting, in words: a version of MuJoCo, the
        plug-in, the elliptic cone. Raises SettingError for an option that MuJoCo does not have.
        """
        options = read_options(setting.options)
        needs = []
        if options.law is not None:
            needs.append("hcbench's plug-in: run `hcbench plugin mujoco --install` once")
            needs.append("MuJoCo itself: MJX and MuJoCo Warp run no plug-in")
        if any(row.adhesion for row in options.rows):
            needs.append("MuJoCo 3.11 or later")
        if options.cone:
            needs.append(
                f"the {options.cone} cone and impratio {options.impratio:g}, for all contacts"
            )
        if options.rows:
            needs.append("the names of geoms")
        return tuple(needs)

    def passivity(
        self,
        scene: Scene,
        setting: Setting,
        speeds: tuple[float, float],
        whole: bool = False,
        train: LongestTrain | None = None,
    ) -> Passivity:
        """Test whether a setting adds energy: bounces and drops in hcbench's own model of its rows,
        and what slides in plain MuJoCo.

        speeds: lowest and highest of the band, m/s.
        whole: all in plain MuJoCo, under every option that the setting allows, which takes minutes.
        train: the longest train of bounces that the target allows; None: none.
        A setting without rows is tested by impacts, as for every engine, and one with a restitution
        law also where it slides.
        """
        from hcbench.engines.mujoco.passivity.judge import certified, screened, with_law

        if whole:
            passivity = certified(scene, setting, train)
        else:
            passivity = screened(scene, setting, speeds, train)
        # None: a setting without rows.
        if passivity is not None:
            return passivity
        passivity = super().passivity(scene, setting, speeds, whole, train)
        return with_law(scene, setting, passivity)

    def with_boxes(
        self, scene: Scene, setting: Setting, passivity: Passivity, whole: bool = False
    ) -> Passivity:
        """Try boxes and a capsule in plain MuJoCo; none in a cup, and none of a force law."""
        from hcbench.engines.mujoco.passivity import judge

        return judge.with_boxes(scene, setting, passivity, whole)

    def with_friction(self, setting: Setting, friction: float) -> Setting:
        """The setting with friction in its force law, or in each of its rows.

        friction: Coulomb's μ. Unchanged where a row already has some, and without rows or such a
        law.
        Raises SettingError for an option that MuJoCo does not have.
        """
        law = read_options(setting.options).law
        if law is not None and is_force(law):
            return replace(setting, options={**setting.options, "friction": friction})
        rows = setting.options.get("rows", ())
        if not rows or any(row.get("friction") for row in rows):
            return setting
        with_it = [{**row, "friction": friction} for row in rows]
        return replace(setting, options={**setting.options, "rows": with_it})

    def with_corners(self, setting: Setting, corners: int) -> Setting:
        """The setting for bodies that land on several points at once, as an option of its rows;
        unchanged for one point, and without rows.

        corners: number of points n.
        A flat body that lands on n points by symmetry moves as one that meets n times at its
        centre: so each row is there n times.
        """
        if corners == 1 or not setting.options.get("rows"):
            return setting
        return replace(setting, options={**setting.options, "corners": corners})

    def script(self, scene: Scene, setting: Setting) -> str:
        """Return the MJCF of the scene under a setting."""
        return mjcf.model_xml(scene, setting)

    def load(self, scene: Scene, setting: Setting, fastest: float) -> MujocoWorld:
        """Load a scene under a setting, with its plug-in, for impacts at up to `fastest` m/s.

        Raises SceneError for a model that is not what the scene says; SettingError for options that
        MuJoCo does not have and for a law that the step does not resolve; EngineMissing for a
        MuJoCo that is too old.
        """
        options = read_options(setting.options)
        if options.law is None:
            return MujocoWorld(_pool(scene, setting.timestep, options))
        from hcbench.engines.mujoco import plugin
        from hcbench.laws.contact_law import require_resolved

        require_resolved(options.law, scene.mass, fastest, setting.timestep)
        plugin.load()
        return MujocoWorld(BatchPool.of(load(scene, setting.timestep, options)))

    def speed_reading(self, setting: Setting) -> SpeedReading:
        """Only RK4 is exact in free flight."""
        exact = read_options(setting.options).integrator == "RK4"
        return SpeedReading.TOUCH_PLANE_EXACT_FLIGHT if exact else SpeedReading.TOUCH_PLANE

    def plugin(self, *, install: bool = False) -> Path:
        """The library of hcbench.hunt_crossley and hcbench.restitution."""
        from hcbench.engines.mujoco import plugin

        return plugin.install() if install else plugin.library()

    def accepts(self, source: Any) -> bool:
        """Say whether MuJoCo opens this source, without opening it: a path with one of `suffixes`,
        MJCF text, an MjModel, MjSpec or MjData, a pair (MjModel, MjData), or an environment that
        has both.
        """
        if isinstance(source, str | Path):
            return str(source).lstrip().startswith("<") or super().accepts(source)
        if isinstance(source, list | tuple) and source:
            return len(source) == 2 and type(source[1]).__name__ == "MjData"
        if type(source).__module__.startswith("mujoco."):
            return True
        from hcbench.engines.mujoco.model.open import live_state

        return any(hasattr(source, name) for name in ("unwrapped", "physics", "sim")) and (
            live_state(source) is not None
        )

    def open(
        self,
        source: Any,
        request: Request,
        rebuild: Callable[[], Any] | None = None,
    ) -> MujocoModel:
        """Open a user's model with its pair at touch.

        source: a path, an MjModel, an MjSpec, MJCF text, or a state as it stands.
        rebuild: unused, as MuJoCo copies a state.
        Raises UserError, with SceneError and QuantityError among its kinds, where the model does
        not open or its pair cannot be measured.
        """
        from hcbench.engines.mujoco.model.open import load as load_user_model
        from hcbench.engines.mujoco.model.under_test import MujocoModel

        return MujocoModel(*load_user_model(_one_file(source), request), request)

    def pairs(
        self,
        source: Any,
        request: Request,
        rebuild: Callable[[], Any] | None = None,
    ) -> list[CandidatePair]:
        """Pairs of geoms of a user's model that may collide, those that touch at the start first.

        source: a path, an MjModel, an MjSpec, MJCF text, or a state as it stands.
        request: the pose.
        rebuild: unused.
        Raises UserError for a URDF without any, and what opening raises.
        """
        from hcbench.engines.mujoco.model.find_pair import list_pairs
        from hcbench.engines.mujoco.model.open import load as load_user_model

        file = _one_file(source)
        model, _, state = load_user_model(file, request)
        found = list_pairs(model, request, state)
        if not found and str(file).lower().endswith(".urdf"):
            got = "no two parts of this URDF can meet: MuJoCo fixes its root link, and has no floor"
            advice = "Measure it with --engine pybullet, or save it as MJCF and add a freejoint"
            raise UserError("model", got, "two parts that collide, one of which moves", advice)
        return found

    def model_settings(
        self,
        source: Any,
        requests: Sequence[Request],
        goal: RestitutionCurve,
        was: Standing = UNKNOWN,
        rebuild: Callable[[], Any] | None = None,
        version: tuple[int, ...] = (),
    ) -> Iterable[ModelSetting]:
        """Settings to try, each <pair> elements for all pairs, the simplest first.

        source: a path, MJCF text or an MjSpec.
        requests: of the pairs.
        goal: e over speed.
        was: how the model stands as it is.
        rebuild: unused.
        version: numbers of MuJoCo's version that has to load what is written, such as (3, 5); ()
        for the installed one.
        Raises, at the call, UserError for several files; as the settings are tried, what
        `tune_model.model_settings` raises: SceneError for a model that does not compile, UserError
        where a pair cannot be measured, the model cannot be written or no <pair> keeps its e, and
        SearchInterrupted with the best so far.
        """
        from hcbench.engines.mujoco.model.tune_model import model_settings

        return model_settings(_one_file(source), requests, goal, was, version)

    def contact_families(
        self,
        source: Any,
        requests: Sequence[Request],
        rebuild: Callable[[], Any] | None = None,
    ) -> Iterable[ContactFamily]:
        """Families of <pair> elements whose numbers differ from world to world.

        source: a path, MJCF text or an MjSpec.
        requests: one a pair.
        rebuild: unused.
        Raises, at the call, UserError for several files; as they are made, SceneError for a model
        that does not compile and UserError where a pair cannot be measured or no <pair> keeps its
        e.
        """
        from hcbench.engines.mujoco.model.worlds import families

        return families(_one_file(source), requests)

    def varied(
        self,
        source: Any,
        request: Request,
        rebuild: Callable[[], Any] | None = None,
    ) -> VariedContact:
        """Open a user's model so that the contact of its pair can be changed: with a <pair> for
        every two geoms of the pair.

        source: a path, MJCF text or an MjSpec.
        request: the pair.
        rebuild: unused.
        Raises UserError for several files, SceneError for a model that does not compile, and what
        `vary.VariedPair` raises else.
        """
        from hcbench.engines.mujoco.model.vary import VariedPair

        return VariedPair(_one_file(source), request)

    def land(
        self,
        source: Any,
        request: Request,
        drops: DropPlan,
        rebuild: Callable[[], Any] | None = None,
    ) -> Landings:
        """Drop a robot over parts of the world, from each height and tilt of `drops`.

        source: a path, an MjModel, an MjSpec, MJCF text, or a state as it stands.
        request: the pose and conditions.
        rebuild: unused.
        Raises UserError where the model has no such robot, EngineFailed where it diverges.
        """
        from hcbench.engines.mujoco.model.landing import land
        from hcbench.engines.mujoco.model.open import load as load_user_model

        return land(*load_user_model(_one_file(source), request), request, drops)

    def touchdowns(
        self, source: Any, request: Request, recorded: Mapping[str, Floats]
    ) -> TrajectoryTouchdowns:
        """Find where a recorded motion met the floor.

        source: a path, an MjModel, an MjSpec or MJCF text.
        request: its pair is the one to read; without one each part that moves, on what does not.
        recorded: qpos (n, nq) and qvel (n, nv), SI, and time (n,), s, where it is known.
        Raises UserError for other shapes.
        """
        from hcbench.engines.mujoco.model.landing import touchdowns
        from hcbench.engines.mujoco.model.open import load as load_user_model

        model, label, _ = load_user_model(_one_file(source), request)
        return touchdowns(model, label, request, recorded)

    def attitudes(self, source: Any, request: Request) -> list[tuple[str, Request]]:
        """Face, edge and vertex of a loose box, and what a loose cylinder has."""
        from hcbench.engines.mujoco.model.tune_model import attitudes_of

        return attitudes_of(_one_file(source), request)

    def standing(
        self, source: Any, setting: ModelSetting | None, requests: Sequence[Request]
    ) -> Standing:
        """Measure how a user's model stands, in plain steps of the model.

        source: a path, an MjModel, an MjSpec, MJCF text, or a state as it stands.
        setting: that is written into it; None: as it is.
        requests: of its pairs.
        Raises UserError where a pair cannot be brought to touch.
        """
        from hcbench.engines.mujoco.model.standing import standing

        opened: list[Any] = []
        for request in requests:
            if setting is None:
                opened.append(self.open(source, request))
            else:
                opened.append(setting.open(request))
        return standing(opened)

    def landing(
        self,
        source: Any,
        requests: Sequence[Request],
        like: DropTest | None = None,
        until_worse: bool = False,
    ) -> DropTest:
        """Drop a robot that falls over parts of the world, and judge how it lands.

        source: a path, MJCF text, an MjModel or an MjSpec.
        requests: of the pairs of its feet.
        like: a test whose length this one takes; None: long enough to come to rest.
        until_worse: one drop is enough where something is worse in it than in all of `like`.
        Raises UserError where the pairs are not of a robot that can fall.
        """
        from hcbench.engines.mujoco.model.drop_test import landing

        return landing(_one_file(source), requests, like, until_worse)

    def landing_peaks(self, source: Any, request: Request) -> tuple[LandingPeak, ...]:
        """Peak forces of drops of the pair's moving body, with all that hangs on it, over its
        weight.

        source: a path, MJCF text or an MjSpec.
        request: of the pair.
        Returns () where the body cannot fall on what stands still, and for a MuJoCo without contact
        sensors.
        """
        from hcbench.engines.mujoco.model.drop_test import landing_peaks

        try:
            return landing_peaks(_one_file(source), request)
        except (UserError, EngineMissing):
            return ()

    def rebound_settings(
        self, source: Any, requests: Sequence[Request], before: DropTest, rebound: float
    ) -> ReboundSettings:
        """<pair> elements of one spring for all feet."""
        from hcbench.engines.mujoco.model.foot_springs import rebound_settings

        return rebound_settings(_one_file(source), requests, before, rebound)


def _one_file(source: Any) -> Any:
    """The one source that MuJoCo opens: the only one of a list, or the MjData of (MjModel, MjData);
    anything but a list or tuple, unchanged. Raises UserError for several files, and for none.
    """
    if not isinstance(source, list | tuple):
        return source
    kinds = [type(one).__name__ for one in source]
    if kinds == ["MjModel", "MjData"]:
        return source[1]
    if not source:
        raise UserError("model", "no file", "one file for MuJoCo")
    if len(source) != 1:
        raise UserError(
            "model", f"{len(source)} files", "one file for MuJoCo", "Put both into one MJCF"
        )
    return source[0]


def _pool(scene: Scene, timestep: float, options: Options) -> BatchPool:
    """The pool of a scene under a setting, compiled, or the one that was made for it before.

    timestep: s.
    options: the setting's.
    Compiled again if the scene's file has changed or names others.
    Raises SettingError for friction or adhesion in a cup, SceneError for a model that is not what
    the scene says, EngineMissing for a MuJoCo that is too old.
    """
    try:
        written = mjcf.model_path(scene).read_bytes()
    # Loading the model says why it cannot be read.
    except OSError:
        written = b""
    # A file that names others is compiled again each time: they may have changed, while it has not.
    names_others = b"file=" in written
    make = cached_pool if written and not names_others else cached_pool.__wrapped__
    return make(scene, timestep, options, written)


@lru_cache(maxsize=2)
def cached_pool(scene: Scene, timestep: float, options: Options, _: bytes) -> BatchPool:
    """The model of a scene under a step and options, loaded once."""
    return BatchPool.of(load(scene, timestep, options))
