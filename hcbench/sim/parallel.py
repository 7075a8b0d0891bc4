"""Engines that step many copies of a world at once, as for training: a ball over a plane in each."""

from __future__ import annotations

import linecache
import re
from abc import abstractmethod
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.force import HuntCrossley
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import Options, PythonLaw, ScriptedEngine
from hcbench.sim.world import Record, Simulation, World, momentum_force
from hcbench.system.errors import CannotRun, SettingError
from hcbench.system.text import shortest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Floats, Launch
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Steps between two looks.
_MOST_STEPS = 64
# Bytes of free memory where the system does not tell.
_GUESSED = 4 << 30
# A step at the highest speed must move the body by so many units in the last place of its position.
_FEWEST = 4.0


def require_motion(scene: Scene, timestep: float, fastest: float, bits: int) -> None:
    """Raises SettingError for a step so short that the ball, in numbers
    of so many bits, does not move.
    """
    require_motion_at(scene.touch_radius, timestep, fastest, bits)


def unit_in_last_place(coordinate: float, bits: int) -> float:
    """The distance, m, between a coordinate and the next that numbers of so many bits have."""
    return float(np.spacing(abs(coordinate), dtype=f"f{bits // 8}"))


def require_motion_at(coordinate: float, timestep: float, fastest: float, bits: int) -> None:
    """Require that numbers of so many bits resolve the motion of a body at this coordinate, m."""
    place = unit_in_last_place(coordinate, bits)
    if fastest * timestep < _FEWEST * place:
        got = f"{timestep:g} s in float{bits}: at {fastest:.3g} m/s the ball moves {fastest * timestep:.1g} m"
        expected = f"{_FEWEST * place:.1g} m or more, as positions have steps of {place:.1g} m"
        raise SettingError(
            "timestep", got, expected, f"Use {_FEWEST * place / fastest:.1g} s or more"
        )


def law_text(law: PythonLaw | None, force: str, each: str) -> str:
    """A law's numbers in an engine's own lines; "" for none.

    force: lines with {k}, {n} and {a}, of eq. (16).
    each: with two gaps, for α and the reading of e(v).
    """
    if law is None:
        return ""
    if isinstance(law, HuntCrossley):
        k, n, a = map(shortest, (law.stiffness, law.exponent, 1.5 * law.alpha))
        return force.format(k=k, n=n, a=a)
    return each.format(shortest(law.alpha), law.reading)


class BatchWorld(World):
    """`places` copies of a world, always so many: those without a launch follow the last one's.

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
        """A ball for each launch."""
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
        """The worlds of the script. Raises SettingError for a step too short for float32."""
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
        """Up to `steps` steps; the force is what each did to the momentum."""
        world = self._world
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
    """Run Python lines whose functions keep their source, which
    compilers of kernels read; the names.
    """
    file = f"<hcbench lines {hash(lines)}>"
    linecache.cache[file] = len(lines), None, lines.splitlines(keepends=True), file
    exec(compile(lines, file, "exec"), names)
    return names


def no_gpu(engine: str, library: str, needed: str) -> CannotRun:
    """The error of an engine that is to compute on a GPU, where its library sees none."""
    advice = f"{needed}, or use --device cpu"
    return CannotRun(f"{engine} device", f"no GPU is visible to {library}", "", advice)


def batch_in(memory: int, each: int) -> int:
    """Copies that half of so much memory has room for.

    each: bytes that a step needs for one.
    """
    return max(1, memory // (2 * each))


def free_memory() -> int:
    """Bytes of this machine's memory that nothing uses; a guess where it does not say."""
    with suppress(OSError, AttributeError):
        line = re.search(r"MemAvailable:\s+(\d+) kB", Path("/proc/meminfo").read_text())
        return int(line[1]) << 10 if line else _GUESSED
    return _GUESSED
