"""What is attached to which model, and the callbacks that serve it: the one place with state."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench import _compile
from hcbench.engines.mujoco.plugin import callback as _callback
from hcbench.engines.mujoco.plugin import native as _native
from hcbench.engines.mujoco.plugin.pairs import FORCE, PairSpec, body_kinds, named
from hcbench.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    Key = tuple[int, int, int, int]

_INERT = ("o_margin", "o_solref", "o_solimp", "o_friction")
_NO_MARGIN = -1e10  # m: a <pair> that MuJoCo never finds


class PythonContactWarning(UserWarning):
    """There is no compiled path here: contact runs in Python."""


def why_not_compiled() -> str | None:
    """None where compiled callbacks can be had, else the reason."""
    try:
        _native.callbacks()
    except _compile.NotCompiled as error:
        return str(error)
    return None


class Entry:
    """All that is attached to one model."""

    def __init__(self, model: Any, number: int, compiled: bool) -> None:
        self.model, self.number, self.compiled = model, number, compiled
        self.pairs: list[PairSpec] = []
        self.bodies = body_kinds(model)
        self.saved = {name: np.copy(getattr(model.opt, name)) for name in _INERT}
        self.margins: dict[int, float] = {}
        self.limits: dict[int, int] = {}
        self.table: Any = None

    def free_slot(self, count: int) -> int:
        """The first slot that no law of the model has, or -1."""
        taken = {pair.slot for pair in self.pairs}
        return next((slot for slot in range(count) if slot not in taken), -1)

    def slot_of(self, key: Key) -> int:
        """The slot of an attached pair's law."""
        return next(pair.slot for pair in self.pairs if _key(pair) == key)

    def refuse_twice(self, keys: Sequence[Key]) -> None:
        """Raise SettingError where one of the pairs has a law already."""
        attached = {_key(pair) for pair in self.pairs}
        for key in keys:
            if key in attached:
                raise SettingError(
                    "contact pair",
                    f"{named(self.model, key)} has a law already",
                    "a pair without one",
                    "Detach that first",
                )

    def counters(self) -> tuple[int, int]:
        """How often a state was not finite, and a step too coarse, since the first law was attached."""
        return int(self.table.not_finite), int(self.table.too_coarse)

    def report(self, model: Any, data: Any) -> list[tuple[Any, ...]]:
        """(key, x, v, F, effective mass, point, normal) of each contact of the force law."""
        if self.compiled:
            room = 64 + 2 * len(self.pairs)
            rows = np.zeros((room, _native.REPORT))
            count = _native.callbacks().hcb_report(model._address, data._address, rows.ctypes.data, room)
        else:
            rows = _callback.report(self.table, model, data)
            count = len(rows)
        pairs = self.table_order()
        return [
            (_key(pairs[int(row[0])]), *(float(one) for one in row[1:5]), row[5:8].copy(), row[8:11].copy())
            for row in rows[:count]
        ]

    def table_order(self) -> list[PairSpec]:
        """Pairs as the table has them."""
        return sorted(self.pairs, key=lambda pair: pair.key)


def _key(pair: PairSpec) -> Key:
    return pair.geom1, pair.geom2, pair.tendon, pair.side


class _Process:
    """What this process has installed in MuJoCo."""

    def __init__(self) -> None:
        self.entries: dict[int, Entry] = {}  # by the model's address
        self.before: tuple[Any, Any] | None = None
        self.own: tuple[Any, Any] | None = None


_process = _Process()


def entry_for(model: Any, compiled: bool) -> Entry:
    """The model's entry, or a new one that is not installed yet."""
    known = _process.entries.get(model._address)
    if known is not None and known.model is model:
        return known
    for entry in _process.entries.values():
        if model.opt.o_margin == _native.MARK * entry.number:
            raise SettingError(
                "model", "a copy of one that a law is attached to", "the model itself, or a copy made before"
            )
    used = {entry.number for entry in _process.entries.values()}
    return Entry(model, next(n for n in range(1, _native.TABLES) if n not in used), compiled)


def add(entry: Entry, pairs: list[PairSpec], slots: Sequence[tuple[str, int]]) -> None:
    """Attach pairs of one law: mark the model, make the table, install the callbacks."""
    model = entry.model
    entry.pairs += pairs
    _process.entries[model._address] = entry
    model.opt.o_margin = _native.MARK * entry.number
    first = pairs[0]
    if first.slot >= 0:
        field, start = slots[first.slot]
        getattr(model.opt, field)[start : start + 2] = 1.0, first.alpha
    for pair in pairs:
        if pair.kind == FORCE:
            _silence(entry, pair)
    _make_table(entry)
    _install()


def _silence(entry: Entry, pair: PairSpec) -> None:
    """Keep MuJoCo's own force away where its contact filter is not asked: <pair> elements and tendons."""
    model = entry.model
    if pair.tendon >= 0:
        entry.limits[pair.tendon] = int(model.tendon_limited[pair.tendon])
        model.tendon_limited[pair.tendon] = 0
        return
    for i in range(model.npair):
        if {int(model.pair_geom1[i]), int(model.pair_geom2[i])} == {pair.geom1, pair.geom2}:
            entry.margins[i] = float(model.pair_margin[i])
            model.pair_margin[i] = _NO_MARGIN


def remove(entry: Entry, keys: Sequence[Key]) -> None:
    """Detach pairs; with the last of them the model is as it was, bit for bit."""
    model, gone = entry.model, set(keys)
    leaving = [pair for pair in entry.pairs if _key(pair) in gone]
    entry.pairs = [pair for pair in entry.pairs if _key(pair) not in gone]
    for pair in leaving:
        if pair.tendon in entry.limits:
            model.tendon_limited[pair.tendon] = entry.limits.pop(pair.tendon)
        for i in list(entry.margins):
            if {int(model.pair_geom1[i]), int(model.pair_geom2[i])} == {pair.geom1, pair.geom2}:
                model.pair_margin[i] = entry.margins.pop(i)
    if entry.pairs:
        _make_table(entry)
    else:
        for name in _INERT:
            if name == "o_margin":
                model.opt.o_margin = float(entry.saved[name])
            else:
                getattr(model.opt, name)[:] = entry.saved[name]
        _set_table(entry, None)
        del _process.entries[model._address]
    _install()


def _make_table(entry: Entry) -> None:
    counts = (0, 0) if entry.table is None else entry.counters()
    make = _native.table_of if entry.compiled else _callback.table_of
    table = make(entry.table_order(), entry.bodies)
    table.not_finite, table.too_coarse = counts
    _set_table(entry, table)
    entry.table = table  # the old one is freed only after its successor is in place


def _set_table(entry: Entry, table: Any) -> None:
    if entry.compiled:
        pointer = None if table is None else ctypes.addressof(table)
        _native.callbacks().hcb_set_table(entry.number, pointer)
    else:
        _callback.set_table(entry.number, table)


def active() -> bool:
    """Whether MuJoCo still has the callbacks that were installed."""
    import mujoco

    return _process.own is None or mujoco.get_mjcb_passive() is _process.own[0]


def _install() -> None:
    """Bring MuJoCo's callbacks in line with what is attached."""
    import mujoco

    if _process.own is not None:
        # Somebody else's callback that has taken the place of ours is theirs to keep.
        if mujoco.get_mjcb_passive() is _process.own[0]:
            mujoco.set_mjcb_passive(_process.before[0])  # type: ignore[index]
        if mujoco.get_mjcb_contactfilter() is _process.own[1]:
            mujoco.set_mjcb_contactfilter(_process.before[1])  # type: ignore[index]
        _process.own = _process.before = None
    if not _process.entries:
        return
    before = mujoco.get_mjcb_passive(), mujoco.get_mjcb_contactfilter()
    kinds = {entry.compiled for entry in _process.entries.values()}
    chained = [_address_of(callback) for callback in before]
    if kinds == {True} and None not in chained:
        native = _native.callbacks()
        native.hcb_chain(*chained)
        own: tuple[Any, Any] = (native.hcb_passive, native.hcb_filter)
    else:
        if True in kinds:
            _native.callbacks().hcb_chain(0, 0)
        own = _callback.make(before, _native.callbacks() if True in kinds else None)
    mujoco.set_mjcb_passive(own[0])
    mujoco.set_mjcb_contactfilter(own[1])
    _process.before, _process.own = before, own


def _address_of(callback: Any) -> int | None:
    """Address of a C callback, 0 for none, None for one in Python."""
    if callback is None:
        return 0
    if isinstance(callback, ctypes._CFuncPtr):  # type: ignore[attr-defined]
        return ctypes.cast(callback, ctypes.c_void_p).value or 0
    return None
