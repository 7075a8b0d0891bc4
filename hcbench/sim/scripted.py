"""Engines that a Python script runs: the script that users are handed is,
line for line, what is measured.

An engine writes the lines that build its world and define

    place(height, velocity)   the ball's centre, m, with its velocity upwards, m/s, and nothing remembered
    step()                    one step more
    force()                   N, that acts from the present state on; None, or not defined at all, where what
                              the step does to the momentum is the force, or `law` that of the state

`place` and `step` return height and velocity as the engine then has them. The lines find
the names m, R, inertia, gravity and timestep (SI, the plane is z = 0), and of a setting
with a law `law(x, v)` or `e(v)`.
"""

from __future__ import annotations

import linecache
import math
import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar, final

import numpy as np
from pydantic import PlainValidator

from hcbench.laws.contact_law import law_of
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.sim.engine import SteppedEngine
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.world import Record, Simulation, World, momentum_force
from hcbench.system.errors import CannotRun, EngineMissing, SettingError
from hcbench.system.text import rounded_up, sanitized, shortest
from hcbench.terms.fields import OptionTable, validate
from hcbench.terms.setting import PAIR

if TYPE_CHECKING:
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting

PythonLaw = HuntCrossley | Restitution
# At this accuracy of error control e hardly depends on where in a step the contact starts.
TIGHT = 1e-8


def python_law_of(options: Mapping[str, Any]) -> PythonLaw:
    """Law of the option "law" of a setting, for an engine that takes laws as Python code: eq. (16)
    only.

    Raises SettingError for any other law, and UserError for options that do not state a law.
    """
    law = law_of(options)
    if not isinstance(law, PythonLaw):
        raise SettingError(
            "option 'law.law'",
            repr(options["law"]),
            "alpha: this engine takes the law of Hunt and Crossley only",
        )
    return law


class ScriptOptions(OptionTable):
    """A setting's options.

    law: from Python, in place of the contact or to set its e before each impact.
    """

    law: Annotated[PythonLaw, PlainValidator(python_law_of)] | None = None


Options = TypeVar("Options", bound=ScriptOptions)


class ScriptedEngine(SteppedEngine, Generic[Options]):
    """An engine whose ball on a plane is a script; `lines` writes it,
    `paste` the part that a setting sets.

    table: of its settings' options.
    laws: those that it lets in from Python.
    """

    oblique = False
    laws: tuple[type[PythonLaw], ...] = (HuntCrossley, Restitution)
    table: type[Options]

    @abstractmethod
    def lines(self, options: Options, scene: Scene) -> str:
        """Return the engine's part of the script. Raises SettingError for
        options that exclude each other.
        """

    @abstractmethod
    def paste(self, options: Options, timestep: str) -> str:
        """Return the lines to paste into a user's script.

        timestep: s.
        """

    @final
    def read(self, setting: Setting) -> Options:
        """The options of a setting; SettingError names the first that the engine does not have."""
        options = validate(self.table, setting.options, SettingError, f"{self.name} option '{{}}'")
        if options.law is not None and not isinstance(options.law, self.laws):
            # An engine that does not take the one kind of law takes the other.
            got = "'restitution'"
            expected = "'force'"
            if isinstance(options.law, HuntCrossley):
                got = "'force'"
                expected = "'restitution'"
            raise SettingError(
                f"{self.name} option 'law.kind'", got, f"{expected}, which this engine supports"
            )
        return options

    def error_controlled(self, setting: Setting) -> bool:
        """Say whether error control, as tight as hcbench's recipes ask for it, chooses the steps of
        a contact. The setting's time step then only says how often the state is read.
        """
        return float(getattr(self.read(setting), "accuracy", None) or 1.0) <= TIGHT

    @final
    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Return the lines of the script that a setting adds; "" if it has no options."""
        if not setting.options:
            return ""
        return self.paste(self.read(setting), shortest(setting.timestep))

    def script(self, scene: Scene, setting: Setting) -> str:
        """The script, which prints restitution against speed when run.

        Raises SettingError for a scene that the script cannot have, and for options that the engine
        does not have.
        """
        if scene.form not in self.forms(setting) or scene.off_axis:
            got = "off its axis" if scene.off_axis else f"the form {scene.form!r}"
            raise SettingError(f"{setting.engine} {setting.name!r}", got, "the form 'plane'")
        numbers = (
            scene.mass,
            scene.touch_radius,
            scene.inertia,
            scene.normal_gravity,
            setting.timestep,
        )
        options = self.read(setting)
        return _SCRIPT.format(
            title=self.title,
            form=scene.form,
            numbers=", ".join(map(shortest, numbers)),
            law=law_lines(options.law),
            lines=self.lines(options, scene),
        )

    def forms(self, setting: Setting) -> Sequence[str]:
        """Forms of scenes that the script can be written for."""
        return ("plane",)

    def load(self, scene: Scene, setting: Setting, fastest: float) -> ScriptWorld:
        """The world of the script."""
        script = self.script(scene, setting)
        return ScriptWorld(self, scene, setting, script)


def law_lines(law: PythonLaw | None) -> str:
    """Source in Python of the function of a law: `law(x, v)`, a force in N, of one of forces, and
    `e(v)` of one of restitution; "" without a law.
    """
    if law is None:
        return ""
    if isinstance(law, HuntCrossley):
        return _FORCE.format(*map(shortest, (law.stiffness, law.exponent, law.alpha)))
    return _RESTITUTION.format(law.reading, shortest(law.alpha))


class ScriptWorld(World):
    """One ball over a plane, as a script has it."""

    def __init__(
        self, engine: ScriptedEngine[Any], scene: Scene, setting: Setting, script: str
    ) -> None:
        """Run the script, which defines the world's functions in names of its own: `place` and
        `step`, and those of `law` and `force` that it has.

        engine: of the script.
        scene: of ball and plane.
        setting: gives the time step, s.
        script: source in Python.
        Raises EngineMissing where the engine's package does not import, and what the script raises.
        """
        assert engine.backend is not None
        self.timestep = setting.timestep
        self.gravity = scene.normal_gravity
        self.mass = scene.mass
        self.radius = scene.touch_radius
        self.deepest = scene.touch_radius
        self.bits = engine.bits
        self.speed_reading = engine.speed_reading(setting)
        self.names: dict[str, Any] = {"__name__": f"hcbench_{engine.name}"}
        try:
            exec(compile(script, f"<{engine.name} script>", "exec"), self.names)
        # The package is installed, and does not import.
        except ImportError as error:
            got = f"cannot be imported: {error}"
            advice = f"Try: {engine.backend.command}"
            raise EngineMissing(f"engine {engine.name!r}", got, "", advice) from None

    def release(self, launches: Sequence[Launch]) -> BallSimulation:
        """The ball of one launch."""
        (launch,) = launches
        return BallSimulation(self, self.radius + launch.clearance(self.timestep), -launch.speed)


class BallSimulation(Simulation):
    """A ball under way; state: height, m, and velocity upwards, m/s."""

    def __init__(self, world: ScriptWorld, height: float, velocity: float) -> None:
        self.world = world
        self.state: tuple[float, float] = world.names["place"](height, velocity)

    def advance(self, steps: int) -> Record:
        """Take exactly `steps` steps, and record the state at the start of each, (1, steps).

        The force is what the script reports, else that of the law, else what the step does to the
        momentum. From where the script raises RuntimeError all is NaN, and `world.diverged` is its
        text.
        """
        world = self.world
        step: Any = world.names["step"]
        force = world.names.get("force")
        law = world.names.get("law")
        # Height of the centre, m, and velocity upwards, m/s.
        states = [self.state]
        # Force in each step, N; None where the script gives none.
        reported: list[float | None] = []
        for _ in range(steps):
            z, v = states[-1]
            # An engine that gave up takes no further step.
            if math.isnan(z):
                reported.append(None)
                states.append((math.nan, math.nan))
                continue
            at_start = None
            if law and z < world.radius:
                at_start = law(world.radius - z, -v)
            if force:
                reported.append(force())
            else:
                reported.append(at_start)
            try:
                states.append(step())
            # The engine gave up.
            except RuntimeError as error:
                world.diverged = sanitized(error)
                states.append((math.nan, math.nan))
        self.state = states[-1]
        z, v = np.array(states, dtype=np.float64).T
        fall = world.gravity * world.timestep
        speeds = np.abs(v[:-1]) + np.abs(v[1:]) + fall
        by_momentum = momentum_force(
            world.mass, world.timestep, np.diff(v) + fall, speeds, world.bits
        )
        # None becomes NaN.
        read = np.array(reported, dtype=np.float64)
        forces = np.where(np.isnan(read), by_momentum, read)
        return Record((world.radius - z[:-1])[None], -v[None, :-1], forces[None])

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""


_SCRIPT = '''"""A ball dropped on a {form} in {title}: prints restitution against impact speed (m/s)."""

m, R, inertia, gravity, timestep = {numbers}  # SI; the {form} is at z = 0
{law}
{lines}

if __name__ == "__main__":
    for speed in (0.05, 0.1, 0.2, 0.3, 0.4, 0.5):
        z, v = place(R + 2.5 * timestep * speed, -speed)
        for _ in range(100000):
            z, v = step()
            if (v > 0 and z > R) or v == 0:
                break
        print(speed, v / speed)
'''

_FORCE = '''

def law(x, v, k={}, n={}, alpha={}):
    """Eq. (16) of Hunt and Crossley 1975: force, N, over penetration, m, and its rate, m/s."""
    return max(0.0, k * x**n * (1.0 + 1.5 * alpha * v)) if x > 0.0 else 0.0

'''
_RESTITUTION = '''
from hcbench.laws.restitution import Restitution

curve = Restitution(reading="{}", alpha={})


def e(v):
    """Restitution at an impact speed, m/s."""
    return min(1.0, max(0.0, float(curve.at(v)))) if v > 0.0 else 0.0

'''


# Engines that step many copies of a world at once, as for training: a ball over a plane in each.

# Steps between two looks.
_MOST_STEPS = 64
# Bytes of free memory where the system does not tell.
_GUESSED = 4 << 30
# A step at the highest speed must move the body by so many units in the last place of its position.
_FEWEST = 4.0


def require_motion(scene: Scene, timestep: float, fastest: float, bits: int) -> None:
    """Raise SettingError for a step so short that the ball does not move in numbers of `bits` bits.

    timestep: s.
    fastest: highest speed, m/s.
    """
    require_motion_at(scene.touch_radius, timestep, fastest, bits)


def unit_in_last_place(coordinate: float, bits: int) -> float:
    """The distance, m, between a coordinate and the next number of `bits` bits."""
    return float(np.spacing(abs(coordinate), dtype=f"f{bits // 8}"))


def require_motion_at(coordinate: float, timestep: float, fastest: float, bits: int) -> None:
    """Raise SettingError for a step so short that numbers of `bits` bits do not resolve the motion.

    coordinate: of the body, m.
    timestep: s.
    fastest: highest speed, m/s.
    """
    place = unit_in_last_place(coordinate, bits)
    if fastest * timestep < _FEWEST * place:
        got = f"{timestep:g} s in float{bits}: at {fastest:.3g} m/s the ball moves {fastest * timestep:.1g} m"
        expected = f"{_FEWEST * place:.1g} m or more, as positions have steps of {place:.1g} m"
        advice = "Launch at a speed above 0 m/s"
        if fastest > 0.0:
            advice = f"Use {rounded_up(_FEWEST * place / fastest)} s or more"
        raise SettingError("timestep", got, expected, advice)


def law_text(law: PythonLaw | None, each: str, force: str, pair: Pair) -> str:
    """A law's numbers in an engine's own lines; "" without a law.

    each: lines that give each impact its e, with {alpha}, s/m, {reading} of the law, and {first}
    and {second}, names of the pair's geoms.
    force: lines of eq. (16) with {k}, {n} and {a}: N/m^n, 1 and s/m, a = (3/2) α; and with {geom},
    the first of the names.
    pair: the names.
    """
    first, second = pair
    if law is None:
        return ""
    if isinstance(law, Restitution):
        return each.format(
            first=first, second=second, alpha=shortest(law.alpha), reading=law.reading
        )
    k, n, a = map(shortest, (law.stiffness, law.exponent, 1.5 * law.alpha))
    return force.format(k=k, n=n, a=a, geom=first)


class BatchWorld(World):
    """`places` copies of a world, always all of them: those without a launch follow the last one's.

    bits: of the engine's numbers.
    """

    bits: int = 32

    def __init__(self, scene: Scene, timestep: float) -> None:
        self.scene = scene
        self.timestep = timestep
        self.gravity = scene.normal_gravity
        self.mass = scene.mass
        self.deepest = scene.touch_radius

    @abstractmethod
    def place(self, heights: Floats, velocities: Floats) -> Floats:
        """Put the balls' centres at heights, m, with velocities upwards, m/s, and nothing
        remembered; both as the engine then has them, shape (2, places).
        """

    @abstractmethod
    def step(self, steps: int) -> Floats:
        """Heights and velocities upwards after each of at most `steps`
        more steps, shape (n, 2, places).
        """

    def release(self, launches: Sequence[Launch]) -> BatchSimulation:
        """Release a ball for each launch; there may be one to `places` of them."""
        # The batch has a size that was compiled: places left over have the last launch again.
        spare = self.places - len(launches)
        padded = [*launches, *[launches[-1]] * spare]
        clear = np.array([launch.clearance(self.timestep) for launch in padded])
        speeds = np.array([launch.speed for launch in padded])
        start = self.place(self.scene.touch_radius + clear, -speeds)
        return BatchSimulation(self, start, len(launches))


class ScriptedWorlds(BatchWorld):
    """Copies of the world of an engine's script, stepped together; heights
    and velocities are arrays.
    """

    def __init__(
        self, scene: Scene, timestep: float, places: int, script: str, reading: SpeedReading
    ) -> None:
        super().__init__(scene, timestep)
        self.places = places
        self.speed_reading = reading
        self._names = run_lines(script, {"__name__": "hcbench_worlds"})

    def place(self, heights: Floats, velocities: Floats) -> Floats:
        """New states."""
        return np.array(self._names["place"](heights, velocities))

    def step(self, steps: int) -> Floats:
        """Up to as many steps as are worth a look."""
        return np.array([self._names["step"]() for _ in range(min(steps, _MOST_STEPS))])


class ScriptedWorldsEngine(ScriptedEngine[Options]):
    """An engine whose script, of one world, is run with `together` of
    them: float32, in its own process.
    """

    bits = 32
    own_process = True
    # Seconds: kernels are compiled when first used.
    limit = 600.0
    # A step of one world costs as much as of all.
    together = 64

    def load(self, scene: Scene, setting: Setting, fastest: float) -> World:  # type: ignore[override]
        """Run the engine's script with `together` copies of its world in place of one, for launches
        that touch at up to `fastest` m/s.

        Raises SettingError for a time step too short for float32, for a scene that the script
        cannot have, and for options that the engine does not have.
        """
        require_motion(scene, setting.timestep, fastest, self.bits)
        script = self.script(scene, setting).replace("worlds = 1", f"worlds = {self.together}")
        return ScriptedWorlds(
            scene, setting.timestep, self.together, script, self.speed_reading(setting)
        )


class BatchSimulation(Simulation):
    """Balls under way; state: heights and velocities upwards, shape (2, places)."""

    def __init__(self, world: BatchWorld, state: Floats, launches: int) -> None:
        self._world = world
        self._state = state
        # Places of the launches that have not ended.
        self._which = np.arange(launches)

    def advance(self, steps: int) -> Record:
        """Take up to `steps` steps, as many as the world takes at once, and record the state at the
        start of each, (b, n), of the b launches that are kept.

        The force, N, is what each step did to the momentum.
        """
        world = self._world
        # Heights, m, and velocities upwards, m/s, now and after each step: (n + 1, 2, places).
        path = np.concatenate([self._state[None], world.step(steps)], dtype=np.float64)
        self._state = path[-1]
        z, v = path[:, :, self._which].transpose(1, 2, 0)
        fall = world.gravity * world.timestep
        speeds = np.abs(v[:, :-1]) + np.abs(v[:, 1:]) + fall
        force = momentum_force(world.mass, world.timestep, np.diff(v) + fall, speeds, world.bits)
        return Record(world.scene.touch_radius - z[:, :-1], -v[:, :-1], force)

    def keep(self, which: Flags) -> None:
        """Look at these only: the others go on."""
        self._which = self._which[which]


def run_lines(lines: str, names: dict[str, Any]) -> dict[str, Any]:
    """Run Python lines in these names, and return the names.

    The functions keep their source in `linecache`, because compilers of kernels read it. Raises
    what the lines raise.
    """
    file = f"<hcbench lines {hash(lines)}>"
    linecache.cache[file] = len(lines), None, lines.splitlines(keepends=True), file
    exec(compile(lines, file, "exec"), names)
    return names


def no_gpu(engine: str, library: str, needed: str) -> CannotRun:
    """The error of an engine that is to compute on a GPU, where its library sees none."""
    advice = f"{needed}, or use --device cpu"
    return CannotRun(f"{engine} device", f"no GPU is visible to {library}", "", advice)


def batch_in(memory: int, bytes_of_copy: int) -> int:
    """Copies of a world that half of `memory`, bytes, has room for; one at least.

    bytes_of_copy: that a step of one needs.
    """
    return max(1, memory // (2 * bytes_of_copy))


def free_memory() -> int:
    """Bytes of this machine's memory that nothing uses; a guess where it does not say."""
    with suppress(OSError, AttributeError):
        line = re.search(r"MemAvailable:\s+(\d+) kB", Path("/proc/meminfo").read_text())
        return int(line[1]) << 10 if line else _GUESSED
    return _GUESSED
