"""The callbacks of MuJoCo in Python: the same as in _mujoco*.c, for where nothing can be compiled.

Calls MuJoCo's collision functions through ctypes; everything else goes by the bindings.
"""

from __future__ import annotations

import ctypes
import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.plugin import native as _native
from hcbench.engines.mujoco.plugin.callback_force import Table, add_forces, evaluate
from hcbench.engines.mujoco.plugin.callback_rows import rewrite_rows
from hcbench.engines.mujoco.plugin.pairs import FORCE, PairSpec

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.impact import Floats


class _Memory(threading.local):
    """What the stages of a Runge-Kutta step share: the first one plans, the others carry out."""

    data: int = 0
    time = step = 0.0
    stage = 0
    plans: dict[tuple[int, int], Any]


_tables: dict[int, Table] = {}
_memory = _Memory()


def table_of(pairs: Sequence[PairSpec], bodies: Sequence[int]) -> Table:
    """A table of pairs in their order."""
    index = {(pair.geom1, pair.geom2): i for i, pair in enumerate(pairs) if pair.tendon < 0}
    return Table(list(pairs), bodies, index)


def set_table(number: int, table: Table | None) -> None:
    """Put a table in its place, or nothing."""
    if table is None:
        _tables.pop(number, None)
    else:
        _tables[number] = table


def _find(model: Any) -> Table | None:
    number = model.opt.o_margin / _native.MARK
    if not 0.5 < number < _native.TABLES or model.opt.o_margin != round(number) * _native.MARK:
        return None
    return _tables.get(round(number))


def make(
    before: tuple[Any, Any], native: ctypes.CDLL | None
) -> tuple[Callable[..., None], Callable[..., int]]:
    """Callbacks for mjcb_passive and mjcb_contactfilter that call those that were there before."""

    def passive(model: Any, data: Any) -> None:
        if before[0] is not None:
            _call(before[0], model, data)
        if native is not None:
            native.hcb_passive(model._address, data._address)
        table = _find(model)
        if table is not None and not _off(model):
            # MuJoCo resets what is not finite before we see it, and keeps count.
            table.not_finite += _was_reset(data)
            stage = _stage(model, data)
            plans = _memory.plans if stage else {}
            add_forces(model, data, table, stage, plans)
            rewrite_rows(model, data, table, stage, plans)

    def contact_filter(model: Any, data: Any, geom1: int, geom2: int) -> int:
        table = _find(model)
        pair = None if table is None else table.index.get((min(geom1, geom2), max(geom1, geom2)))
        if table is not None and pair is not None and table.pairs[pair].kind == FORCE:
            return 1
        if native is not None and native.hcb_filter(model._address, data._address, geom1, geom2):
            return 1
        if before[1] is not None:
            return int(_call(before[1], model, data, geom1, geom2))
        masks = (model.geom_contype[geom1] & model.geom_conaffinity[geom2]) | (
            model.geom_contype[geom2] & model.geom_conaffinity[geom1]
        )
        return int(not masks)

    return passive, contact_filter


def _call(callback: Any, model: Any, data: Any, *rest: int) -> Any:
    if isinstance(callback, ctypes._CFuncPtr):  # type: ignore[attr-defined]
        return callback(ctypes.c_void_p(model._address), ctypes.c_void_p(data._address), *rest)
    return callback(model, data, *rest)


def _off(model: Any) -> bool:
    import mujoco

    bits = int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return bool(int(model.opt.disableflags) & bits)


def _was_reset(data: Any) -> bool:
    import mujoco

    kinds = mujoco.mjtWarning
    bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
    return any(data.warning[int(kind)].number for kind in bad)


def _stage(model: Any, data: Any) -> int:
    """0 unless RK4; else which of its stages this is, told by the time that MuJoCo sets for each."""
    import mujoco

    if int(model.opt.integrator) != int(mujoco.mjtIntegrator.mjINT_RK4):
        return 0
    memory, h, time = _memory, float(model.opt.timestep), float(data.time)
    stage = memory.stage if memory.data == data._address and memory.step == h else 0
    if stage and stage != 3 and time == memory.time + 0.5 * h:
        memory.stage = 3 if stage == 2 else 2
    elif stage == 3 and time == memory.time + h:
        memory.stage = 4
    else:
        memory.data, memory.step, memory.time, memory.stage, memory.plans = data._address, h, time, 1, {}
    return memory.stage


def report(table: Table, model: Any, data: Any) -> Floats:
    """Rows like those of hcb_report: pair, x, v, F, effective mass, point, normal, a."""
    import mujoco

    rk4 = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
    rows = [
        [t.pair, t.x, t.v, t.force, 1.0 / t.inverse_mass, *t.point, *t.normal, t.motion.a]
        for t in evaluate(model, data, table, int(rk4), {})
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, _native.REPORT)
