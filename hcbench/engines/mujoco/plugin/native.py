"""The compiled callbacks of MuJoCo: loaded, connected to the installed library, and checked before use."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench import _compile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.plugin.pairs import PairSpec
    from hcbench.impact import Floats

MARK = 1e-305
TABLES = 4096
REPORT = 12
_CONNECTED = ("mjCOLLISIONFUNC", "mj_applyFT", "mj_jac", "mj_solveM", "mj_markStack", "mj_freeStack")

_PROBE = """<mujoco><option timestep="0.0023"><flag energy="enable"/></option><worldbody>
<geom name="p" type="plane" size="1 1 1" friction="0.37 .1 .1"/>
<body pos="0 0 .0999"><freejoint/><geom size=".1" mass="1.25" friction="0.37 .1 .1"/></body>
</worldbody></mujoco>"""


class Pair(ctypes.Structure):
    """hcb_pair of _mujoco.c."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("kind", "geom1", "geom2", "tendon")),
        *((name, ctypes.c_int) for name in ("side", "slot", "reading", "own")),
        *((name, ctypes.c_double) for name in ("stiffness", "alpha", "exponent")),
        *((name, ctypes.c_double) for name in ("static_friction", "dynamic_friction", "slip_speed")),
    ]


class Table(ctypes.Structure):
    """hcb_table of _mujoco.c."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("pairs", "geom_pairs", "restitution_pairs", "unused")),
        ("pair", ctypes.POINTER(Pair)),
        ("body", ctypes.POINTER(ctypes.c_int)),
        ("not_finite", ctypes.c_longlong),
        ("too_coarse", ctypes.c_longlong),
    ]


def table_of(pairs: Sequence[PairSpec], bodies: Sequence[int]) -> Table:
    """A table in C's layout; the arrays that it points to live as long as it does."""
    rows = (Pair * max(1, len(pairs)))()
    for row, pair in zip(rows, pairs, strict=False):
        for name, kind in ((field[0], field[1]) for field in Pair._fields_):
            if name != "unused":
                setattr(row, name, int(getattr(pair, name)) if kind is ctypes.c_int else getattr(pair, name))
    kinds = (ctypes.c_int * len(bodies))(*bodies)
    table = Table()
    table.pairs = len(pairs)
    table.geom_pairs = sum(pair.tendon < 0 for pair in pairs)
    table.restitution_pairs = sum(pair.kind == 2 for pair in pairs)
    table.pair = rows
    table.body = kinds
    return table


def _headers() -> tuple[Path, tuple[str, ...], tuple[Path, ...]]:
    """Where the installed headers are, and what of it differs between versions of mujoco."""
    import mujoco

    include = Path(mujoco.__file__).parent / "include"
    data, model = include / "mujoco" / "mjdata.h", include / "mujoco" / "mjmodel.h"
    if not data.is_file() or not model.is_file():
        raise _compile.NotCompiled(f"mujoco {mujoco.__version__} has no headers in {include}")
    in_data, in_model = data.read_text(encoding="utf-8"), model.read_text(encoding="utf-8")
    has = {
        "HCB_PRECONTACT": "mjPreContact;" in in_data,
        "HCB_ISLAND_ROWS": "iefc_D;" in in_data,
        "HCB_SURFACE_VELOCITY": "surfacevel[3];" in in_data,
        "HCB_TENDON_ROWS_IN_MODEL": "ten_J_rownnz;" in in_model,
    }
    return include, tuple(f"-D{name}" for name, yes in has.items() if yes), (data, model)


def _engine() -> ctypes.CDLL:
    import mujoco

    folder = Path(mujoco.__file__).parent
    found = [*folder.glob("libmujoco*.so*"), *folder.glob("libmujoco*.dylib"), *folder.glob("mujoco.dll")]
    if not found:
        raise _compile.NotCompiled(f"no mujoco library in {folder}")
    return ctypes.CDLL(str(found[0]))  # the one that the bindings have loaded already


@functools.cache
def callbacks() -> ctypes.CDLL:
    """The callbacks' library, ready for use. Raises NotCompiled with the reason where there is none."""
    include, defines, headers = _headers()
    made = _compile.library("engines/mujoco/plugin/plugin.c", (f"-I{include}", *defines), headers)
    engine = _engine()
    addresses = [_address(engine, name) for name in (*_CONNECTED, "mj_stackAllocByte")]
    made.hcb_connect((ctypes.c_void_p * len(addresses))(*addresses))
    made.hcb_chain.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    made.hcb_report.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
    made.hcb_set_table.argtypes = [ctypes.c_int, ctypes.c_void_p]
    made.hcb_probe.argtypes = [ctypes.c_void_p] * 3
    made.hcb_passive.argtypes = [ctypes.c_void_p] * 2
    made.hcb_passive.restype = None
    made.hcb_filter.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int, ctypes.c_int]
    made.hcb_filter.restype = ctypes.c_int
    _check_layout(made)
    return made


def _address(engine: ctypes.CDLL, name: str) -> int:
    try:
        return ctypes.addressof(ctypes.c_char.in_dll(engine, name))
    except ValueError as error:
        raise _compile.NotCompiled(f"mujoco's library has no {name}") from error


def _check_layout(made: ctypes.CDLL) -> None:
    """Compare what C reads in a model and its data with what the Python bindings say."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(_PROBE)
    model.opt.o_margin, model.opt.o_friction[4] = 0.0625, 0.375
    data = mujoco.MjData(model)
    data.time = 0.75
    mujoco.mj_forward(model, data)
    expected = _expected(model, data)
    seen = np.zeros(len(expected))
    made.hcb_probe(model._address, data._address, seen.ctypes.data)
    wrong = [i for i, (a, b) in enumerate(zip(seen, expected, strict=True)) if b is not None and a != b]
    if wrong:
        raise _compile.NotCompiled(
            f"the headers of mujoco {mujoco.__version__} do not describe the library that is loaded"
            f" (probe {wrong[0]}: {seen[wrong[0]]!r}, expected {expected[wrong[0]]!r})"
        )


def _expected(model: Any, data: Any) -> list[float | None]:
    def at(array: Floats) -> float:
        return float(array.ctypes.data)

    contact = data.contact[0]
    return [
        *(None, None),  # version and sizeof(mjContact): for messages
        *(model.nq, model.nv, model.nbody, model.ngeom, model.ntendon),
        *(model.opt.timestep, model.opt.o_margin, model.opt.o_friction[4], int(model.opt.integrator)),
        *(int(model.opt.enableflags), model.geom_rbound[-1], model.body_mass[-1]),
        *(at(model.body_inertia), at(model.geom_bodyid), at(data.qpos), at(data.qvel), at(data.qfrc_passive)),
        *(at(data.geom_xpos), at(data.ximat), at(data.cvel), at(data.subtree_com), None),
        *(data.ncon, data.nefc, data.time),
        *(at(data.efc_KBIP), at(data.efc_pos), at(data.efc_margin), at(data.efc_R), at(data.efc_D)),
        *(contact.dist, contact.efc_address, contact.friction[0]),
    ]
