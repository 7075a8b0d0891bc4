"""MJX behind the contract of an engine: it flies the MJCF that `hcbench tune mujoco` writes, by vmap.

Options of a setting: those of MuJoCo, and
    precision: "float32", JAX's own, or "float64", by jax_enable_x64, which is one for a whole process.
    law: {"kind": "restitution", ...} for e(v) set in each step, or {"kind": "force", ...} in place of the
        contact, as `hcbench.laws.contact_law.law_of` reads them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hcbench.errors import SettingError
from hcbench.laws.force import HuntCrossley
from hcbench.sim.backend import Backend
from hcbench.sim.batched import BatchWorld, BorrowedScenes, law_text, reading_of, require_motion

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.scripted import PythonLaw

_PLACES = 32
_BUFFER = 512  # steps that are recorded before they are looked at
_HIGHEST_POWER = 100.0  # of a solimp in float32, which ends at 2^-149
IMPEDANCE, _HIGHEST = 0.9, 0.99  # of a bounce in one step: float32 tells 1 - d to 2e-6, to 1e-5
_BITS = {"float32": 32, "float64": 64}


class MjxEngine(BorrowedScenes):
    """MuJoCo in JAX, 3.17."""

    name: ClassVar[str] = "mjx"
    title: ClassVar[str] = "MuJoCo MJX"
    backend: ClassVar[Backend] = Backend("mjx", "mujoco-mjx", "3.17", "3.17")
    bits: ClassVar[int] = 32
    own_process: ClassVar[bool] = True
    limit: ClassVar[float] = 600.0  # JAX compiles for up to minutes
    together: ClassVar[int] = _PLACES
    lender: ClassVar[str] = "mujoco"
    own: ClassVar[tuple[str, ...]] = ("law", "precision")

    def lent(self, setting: Setting) -> Setting:
        """What of a setting MuJoCo reads; e(v) needs a pair whose solref a step can set."""
        law, lent = self.law(setting), super().lent(setting)
        if law is None or isinstance(law, HuntCrossley):
            return lent
        d = 0.9999 if _bits(setting) == 64 else IMPEDANCE
        row = {"solref": [0.0, -1.0 / setting.timestep], "solimp": [d, d, 0.001, 0.5, 2.0]}
        return replace(lent, options={**lent.options, "rows": [row]})

    def snippet(self, setting: Setting, form: str) -> str:
        """MJCF, or the law's step."""
        return _step_text(self.law(setting)) or super().snippet(setting, form)

    def load(self, scene: Scene, setting: Setting, fastest: float) -> MjxWorld:
        """A scene under a setting. Raises SettingError for what MJX would do otherwise than MuJoCo."""
        bits = _bits(setting)
        require_motion(scene, setting.timestep, fastest, bits)
        xml, law = self.script(scene, setting), self.law(setting)
        jax, mujoco, mjx = (self.backend.module(name) for name in ("jax", "mujoco", "mujoco.mjx"))
        jax.config.update("jax_enable_x64", bits == 64)
        model = mujoco.MjModel.from_xml_string(xml)
        if isinstance(law, HuntCrossley):
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        elif law is None:
            require_same(model, f"mjx {setting.name!r}", bits)
        try:
            on_device = mjx.put_model(model)
        except NotImplementedError as error:
            raise SettingError(f"mjx {setting.name!r}", f"{error}", "what MJX has of MuJoCo") from None
        compiled = _compiled(_step_text(law) or "step = mjx.step", scene.touch_radius, bits)
        world = MjxWorld(scene, setting.timestep, bits, on_device, mjx.make_data(on_device), *compiled)
        world.speed_reading = reading_of(law, model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4)
        return world


def _bits(setting: Setting) -> int:
    precision = setting.options.get("precision", "float32")
    if precision not in _BITS:
        raise SettingError("mjx option 'precision'", repr(precision), "'float32' or 'float64'")
    return _BITS[precision]


def require_same(model: Any, slot: str, bits: int) -> None:
    """Raises SettingError for a model whose contact MJX, or float32, turns into another one."""
    if getattr(model, "pair_adhesion", np.zeros(1)).any():
        got = "pairs with adhesion, which MJX drops without a word: their dampers cannot pull"
        raise SettingError(slot, got, "pairs that only push", "Use `staggered-push`")
    if bits == 64:
        return
    solimp = np.concatenate([model.pair_solimp, model.geom_solimp])
    if (power := float(solimp[:, 4].max())) > _HIGHEST_POWER:
        got = f"solimp of power {power:.4g}, which underflows in float32: no bounce"
        raise SettingError(slot, got, f"a power up to {_HIGHEST_POWER:g}", "Or precision = 'float64'")
    one_step = (model.pair_solref[:, 0] == 0) & (-model.pair_solref[:, 1] * model.opt.timestep > 1)
    if (one_step & (model.pair_solimp[:, :2].max(axis=1) > _HIGHEST)).any():
        got = "a bounce in one step with an impedance of which float32 keeps too little: e off by .0024"
        raise SettingError(slot, got, f"solimp up to {_HIGHEST:g}", "Use MJX's `impulse`, or 'float64'")


class MjxWorld(BatchWorld):
    """`places` worlds in one vmap."""

    places = _PLACES

    def __init__(
        self, scene: Scene, timestep: float, bits: int, model: Any, empty: Any, place: Any, run: Any
    ) -> None:
        super().__init__(scene, timestep)
        self.bits, self._model, self._empty, self._place, self._run = bits, model, empty, place, run

    def place(self, heights: Floats, velocities: Floats) -> Floats:
        """New data."""
        z, v = (np.asarray(a, f"f{self.bits // 8}") for a in (heights, velocities))
        self._data = self._place(self._empty, z, v)
        return np.stack([z, v]).astype(np.float64)

    def step(self, steps: int) -> Floats:
        """Up to as many steps as the buffer takes."""
        count = min(steps, _BUFFER)
        self._data, path = self._run(self._model, self._data, count)
        return np.asarray(path, np.float64)[:count]


@lru_cache(maxsize=16)
def _compiled(step_text: str, radius: float, bits: int) -> tuple[Any, Any]:
    """For each law and precision: what places the balls, and what takes so many steps and records them."""
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    names: dict[str, Any] = {"jnp": jnp, "mjx": mjx, "R": radius}
    exec(step_text, names)
    step = jax.vmap(names["step"], in_axes=(None, 0))

    def run(model: Any, data: Any, steps: int) -> Any:
        def one(i: Any, carry: Any) -> Any:
            data = step(model, carry[0])
            return data, carry[1].at[i].set(jnp.stack([data.qpos[:, 2], data.qvel[:, 2]]))

        return jax.lax.fori_loop(0, steps, one, (data, jnp.zeros((_BUFFER, 2, _PLACES), data.qpos.dtype)))

    def place(empty: Any, z: Any, v: Any) -> Any:
        return empty.replace(qpos=empty.qpos.at[2].set(z), qvel=empty.qvel.at[2].set(v))

    return jax.jit(jax.vmap(place, in_axes=(None, 0, 0))), jax.jit(run)


def _step_text(law: PythonLaw | None) -> str:
    """The step of one world with a law in it, for jit and vmap; "" for none."""
    return law_text(law, _FORCE, _EACH)


_FORCE = """\
def step(model, data):  # contacts off; R: the ball's radius, above the plane z = 0
    x = jnp.maximum(R - data.qpos[2], 0.0)
    f = jnp.maximum({k} * x**{n} * (1 - {a} * data.qvel[2]), 0.0)
    return mjx.step(model, data.replace(qfrc_applied=data.qfrc_applied.at[2].set(f)))"""
_EACH = """\
import numpy as np
from hcbench.laws.restitution import Restitution

speeds = np.concatenate([[0], np.geomspace(1e-4, 10, 4000)])
table = np.clip(Restitution({}, {!r}).at(speeds), 0, 1)

def step(model, data):  # the pair's solref is that of `impulse`
    v, rest = jnp.maximum(-data.qvel[2], 1e-6), 1 - model.pair_solimp[0, 0]  # of gravity, by impedance
    damping = (1 + jnp.interp(v, speeds, table)) / model.opt.timestep - rest * model.opt.gravity[2] / v
    return mjx.step(model.replace(pair_solref=model.pair_solref.at[0, 1].set(-damping)), data)"""
