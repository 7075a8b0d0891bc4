"""MJX behind the contract of an engine: it steps MJCF models in one vmap.

Options of a setting: those of MuJoCo, and
    precision: "float32", JAX's own, or "float64", by jax_enable_x64, which is one for a whole
    process.
    device: "cpu" or "gpu": all launches are one batch there, and no step leaves it.
    law: {"kind": "restitution", ...} for e(v) set in each step, or {"kind": "force", ...} in place
    of the
        contact, as `hcbench.laws.contact_law.law_of` reads them.

A user's model is simulated in JAX's own precision, or that of the
environment variable JAX_ENABLE_X64.
"""

from __future__ import annotations

import os
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact
from hcbench.sim.read_impact import Reading, reader
from hcbench.sim.scripted import batch_in, free_memory, law_text, no_gpu
from hcbench.sim.shared_model import (
    HEIGHT,
    RISING,
    Copies,
    SharedModelEngine,
)
from hcbench.system.errors import SceneError, SettingError
from hcbench.system.files import user_folder
from hcbench.terms.setting import PAIR
from hcbench.workers import in_worker

if TYPE_CHECKING:
    from hcbench.sim.read_impact import Rule
    from hcbench.sim.scripted import PythonLaw
    from hcbench.terms.impact import Floats
    from hcbench.terms.setting import Pair, Setting


# Copies of a model whose steps are recorded: one vmap is compiled for so many.
_PLACES = 32
# Threads of XLA: with two, batched Cholesky factorizations that run at once
# take both, and wait for a third.
_THREADS = "16"
# Memory that a step takes in all, in bytes of a state.
_WORKING = 4
# Steps that are recorded before they are looked at.
_BUFFER = 512
# Fields of a state that stay as the user has set them.
_HELD = ("ctrl", "act", "mocap_pos", "mocap_quat", "eq_active")
_BITS = {"float32": 32, "float64": 64}


_CAVEATS = ("MJX drops a pair's adhesion; in float32 set solimp to 0.9, where MuJoCo has 0.9999.",)


class MjxEngine(DescribesContact, SharedModelEngine):
    """The engine MJX 3.17, MuJoCo in JAX."""

    name = "mjx"
    title = "MuJoCo MJX"
    backend = Backend("mjx", "mujoco-mjx", "3.17", "3.17")
    bits = 32
    own_process = True
    # Seconds: JAX compiles for up to minutes.
    limit = 600.0
    together = _PLACES
    suffixes = (".xml", ".mjcf", ".mjb")
    model_engine = "mujoco"
    # MuJoCo's, of two geoms.
    default_friction = 1.0
    own = ("law", "precision", "device")
    devices = ("cpu", "gpu")
    lacks = frozenset({"adhesion", "impedance in float32"})
    exact = "JAX_ENABLE_X64=1 (a setting: precision = 'float64')"

    def bits_of(self, setting: Setting) -> int:
        """Return the bits of the numbers of a setting: 32 or 64."""
        precision = setting.options.get("precision", "float32")
        if precision not in _BITS:
            raise SettingError("mjx option 'precision'", repr(precision), "'float32' or 'float64'")
        return _BITS[precision]

    def law_lines(self, law: PythonLaw | None, pair: Pair = PAIR) -> str:
        """Lines of Python of a step of one world with a law in it, for jit and vmap; "" without a
        law.

        pair: names of the two geoms.
        """
        return law_text(law, _EACH, _FORCE, pair)

    def copies(
        self,
        model: Any,
        start: Any,
        bits: int = 0,
        law: str = "",
        radius: float = 0.0,
        device: str = "",
    ) -> MjxCopies:
        """Make copies of a model that one vmap steps together.

        model: MjModel.
        start: MjData with what states leave out, such as controls.
        bits: 32 or 64; 0 for JAX's own.
        law: lines of the step function; "" for MJX's own step.
        radius: of the ball, m.
        device: "cpu" or "gpu"; "" for JAX's default.

        Raises SceneError for what MJX does not have, CannotRun without the device.
        """
        if model.nplugin:
            got = "a plug-in, which MJX leaves out without a warning"
            raise SceneError(
                "model", got, "a model without", "`hcbench tune mjx` puts a law into its step"
            )
        # Before anything else: JAX starts with what is set by then.
        bits = self._configure_jax(bits, device)
        jax = self.backend.module("jax")
        mjx = self.backend.module("mujoco.mjx")
        chosen = self._device(device)
        try:
            on_device = mjx.put_model(model, device=chosen)
        except NotImplementedError as error:
            raise SceneError("model", f"MJX: {error}", "what MJX has of MuJoCo") from None
        # put_data has other types in 64 bits: the fields are put one by one.
        empty = mjx.make_data(on_device, device=chosen)
        held = {name: jax.device_put(getattr(start, name), chosen) for name in _HELD}
        copies = MjxCopies(
            on_device,
            empty.replace(**held),
            bits,
            _compiled(law or "step = mjx.step", radius, bits, model if _OWN in law else None),
        )
        if device:
            # Bytes: of a CPU JAX gives no limit.
            memory = (chosen.memory_stats() or {}).get("bytes_limit") or free_memory()
            of_state = sum(array.nbytes for array in jax.tree.leaves(empty))
            copies.room = batch_in(memory, _WORKING * of_state)
        return copies

    def _configure_jax(self, bits: int, device: str) -> int:
        """Set the process's options of JAX, and return the bits of its numbers: the threads of a CPU,
        the precision, and in a worker process the folder in which compiled functions are kept.

        bits: 32 or 64; 0 for JAX's own.
        device: as of `copies`.
        """
        # The number of threads must be set before MJX starts XLA.
        if device == "cpu" and in_worker():
            os.environ.setdefault("NPROC", _THREADS)
        # Read before a setting says otherwise.
        starts_in_64_bits = self._starts_in_64_bits()
        if not bits:
            bits = 64 if starts_in_64_bits else 32
        jax = self.backend.module("jax")
        jax.config.update("jax_enable_x64", bits == 64)
        # In the user's own process the cache is the user's choice.
        if in_worker() and not jax.config.jax_compilation_cache_dir:
            jax.config.update("jax_compilation_cache_dir", str(user_folder("cache") / "jax"))
        return bits

    def require_device(self, device: str) -> None:
        """Raises CannotRun where JAX sees no such device."""
        self._device(device)

    def _device(self, device: str) -> Any:
        """JAX's device of a kind, "" for its default. Raises CannotRun without a GPU."""
        try:
            return self.backend.module("jax").devices(device or None)[0]
        except RuntimeError:
            raise no_gpu(self.name, "JAX", "Install jax[cuda12] into its environment") from None

    @cache  # noqa: B019 - one adapter a process
    def _starts_in_64_bits(self) -> bool:
        return bool(self.backend.module("jax").config.jax_enable_x64)

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """MJX's solref for a bounce in one step, if the contact has an e and a step; with caveats."""
        e = contact.restitution
        h = contact.timestep
        if e is None or h is None:
            return Vocabulary(caveats=_CAVEATS)
        note = "bounces in one step; solimp 0.9 0.9 0.001 in float32"
        value = SystemValue("MJX", "solref", (0.0, -(1.0 + e) / h), "", note)
        return Vocabulary((value,), caveats=_CAVEATS)


class _Functions(NamedTuple):
    """Compiled functions of copies of one model.

    place: puts them into states.
    place_balls: puts balls at heights, with velocities upwards.
    run: takes steps and records them.
    read: takes steps and reads impacts instead.
    """

    place: Any
    place_balls: Any
    run: Any
    read: Any


class MjxCopies(Copies):
    """Copies of a model in one vmap."""

    places = _PLACES

    def __init__(self, model: Any, empty: Any, bits: int, functions: _Functions) -> None:
        """Keep a model, its data, and the compiled functions that step its copies.

        model, empty: MJX's Model, and Data at the start, both on the device.
        bits: of their numbers, 32 or 64.
        functions: of this model's kind.
        """
        self.bits = bits
        self._model = model
        self._empty = empty
        self._functions = functions
        self.kind = np.dtype(f"f{bits // 8}").type

    def place(self, states: Floats) -> Floats:
        """Put the copies into new states."""
        rounded = states.astype(f"f{self.bits // 8}")
        self._data = self._functions.place(self._empty, rounded)
        return rounded.astype(np.float64)

    def place_balls(self, rest: Floats, heights: Floats, rising: Floats) -> Floats:
        """Put balls into states that are made on the device: two numbers of each are sent."""
        balls: Floats = np.stack([heights, rising]).astype(self.kind)
        self._data = self._functions.place_balls(self._empty, rest.astype(self.kind), *balls)
        return balls.astype(np.float64)

    def step(self, steps: int) -> Floats:
        """Up to as many steps as the buffer takes."""
        count = min(steps, _BUFFER)
        self._data, path = self._functions.run(self._model, self._data, count)
        return np.asarray(path, np.float64)[:count]

    def read_on(self, rule: Rule, reading: Reading, fewest: int, most: int) -> Reading:
        """Step and read balls on the device; nothing is sent back between steps."""
        self._data, reading = self._functions.read(
            self._model, self._data, rule, reading, fewest, most
        )
        return Reading(*map(np.asarray, reading))


@lru_cache(maxsize=16)
def _compiled(step_text: str, radius: float, bits: int, own: Any) -> _Functions:
    """Compile the functions of copies of a model. They are kept for each law, radius, precision and
    model.

    step_text: lines that define `step(model, data)`.
    radius: of the ball, m.
    bits: 32 or 64; not used here, but the compiled functions of each are kept apart.
    own: the MjModel that the lines of a law e(v) read; None for other lines.
    """
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    # The lines find these names, and define `step` for one world.
    names: dict[str, Any] = {"jnp": jnp, "mjx": mjx, "R": radius, "model": own}
    exec(step_text, names)
    step = jax.vmap(names["step"], in_axes=(None, 0))

    def run(model: Any, data: Any, steps: int) -> Any:
        """(data, path) after `steps` steps, up to _BUFFER; path: positions and velocities after
        each, (_BUFFER, _PLACES, nq + nv).
        """

        def one(i: Any, carry: Any) -> Any:
            """Take step i, and record the state after it; carry: (data, path)."""
            before, path = carry
            data = step(model, before)
            return data, path.at[i].set(jnp.concatenate([data.qpos, data.qvel], axis=1))

        path = jnp.zeros((_BUFFER, _PLACES, model.nq + model.nv), data.qpos.dtype)
        return jax.lax.fori_loop(0, steps, one, (data, path))

    def place(empty: Any, state: Any) -> Any:
        """Data of one copy in a state, positions and velocities, (nq + nv,)."""
        return empty.replace(qpos=state[: empty.qpos.size], qvel=state[empty.qpos.size :])

    def place_ball(empty: Any, rest: Any, height: Any, rising: Any) -> Any:
        """Data of one ball that rests but for its height, m, and its velocity upwards, m/s."""
        return place(empty, rest.at[HEIGHT].set(height).at[RISING].set(rising))

    def read(model: Any, data: Any, rule: Any, reading: Any, fewest: int, most: int) -> Any:
        """Take up to `most` steps, or until at most `fewest` balls go on, and return MJX's Data and the
        reading of each ball then.

        rule: when a launch ends, as the fields of a `Rule`.
        reading: of each ball so far.
        """

        def goes_on(carry: Any) -> Any:
            _, now = carry
            return ((now.end == 0).sum() > fewest) & (now.steps.max() < most)

        def one(carry: Any) -> Any:
            """Take a step, and add it to the readings; carry: (data, reading)."""
            before, now = carry
            data = step(model, before)
            # The ball's free joint: its height and its velocity upwards.
            height = data.qpos[:, 2]
            rising = data.qvel[:, 2]
            return data, Reading(*add(height, rising, *rule, *now))

        return jax.lax.while_loop(goes_on, one, (data, reading))

    add = reader(jnp)
    return _Functions(
        place=jax.jit(jax.vmap(place, in_axes=(None, 0))),
        place_balls=jax.jit(jax.vmap(place_ball, in_axes=(None, None, 0, 0))),
        run=jax.jit(run),
        read=jax.jit(read),
    )


_FORCE = """\
def step(model, data):  # contacts off; R: the ball's radius, above the plane z = 0
    x = jnp.maximum(R - data.qpos[2], 0.0)
    f = jnp.maximum({k} * x**{n} * (1 - {a} * data.qvel[2]), 0.0)
    return mjx.step(model, data.replace(qfrc_applied=data.qfrc_applied.at[2].set(f)))"""
# Lines of e(v) are made for the geoms of one model; others serve any, and are compiled once.
_OWN = "restitution(model, "
_EACH = """\
# model: your mujoco.MjModel. Then, in place of mjx.step: data = step(mjx.put_model(model), data)
from hcbench.contact.mjx import Restitution, restitution

step = restitution(model, {{("{first}", "{second}"): Restitution({alpha}, "{reading}")}})"""
