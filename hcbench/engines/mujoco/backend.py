"""The mujoco package: importing it, what an older version lacks, its warnings and its fatal errors."""

import contextlib
import ctypes
import functools
import importlib
import os
import sys
from collections.abc import Iterable, Iterator
from typing import Any

from hcbench.sim.backend import Backend
from hcbench.system.errors import EngineFailed, EngineMissing, foreign_errors
from hcbench.system.process import IS_COMMAND
from hcbench.workers import in_worker

BACKEND = Backend("mujoco", "mujoco", "3.3", "4.0", "pip install mujoco", instead="mujoco-core")
# What older versions lack: the class ("": the module) and the attribute that show it, and
# the first version that has it.
_FEATURES = {
    "mj_copyData": ("", "mj_copyData", "3.5"),
    "adhesion": ("MjModel", "pair_adhesion", "3.11"),
    "contact sensors": ("mjtSensor", "mjSENS_CONTACT", "3.3.5"),
    "integrator 'discrete'": ("mjtIntegrator", "mjINT_DISCRETE", "3.13"),
}
# MuJoCo's module that loads a graphics library, in new versions and in older ones.
_GRAPHICS = ("mujoco.rendering.classic.gl_context", "mujoco.gl_context")


def backend() -> Any:
    """The mujoco module, imported on the first call; in hcbench's own processes it takes no times
    of its steps, and loads graphics where they are used.

    Raises EngineMissing, and EngineFailed where it is there but does not load.
    """
    try:
        if IS_COMMAND.get() or in_worker():
            _import_for_own_process()
        import mujoco
        import mujoco.rollout
    except ImportError as error:
        raise EngineMissing(
            "engine 'mujoco'", f"cannot be imported: {error}", "", f"Try: {BACKEND.command}"
        ) from None
    # Its graphics library, which MUJOCO_GL names, may be missing.
    except Exception as error:
        raise EngineFailed("engine 'mujoco'", f"cannot be imported: {error}", "") from error
    return mujoco


@functools.cache
def _import_for_own_process() -> None:
    """Import MuJoCo into a process of hcbench's own, without what only a user's program needs."""
    if "mujoco" not in sys.modules:
        _import_without_graphics()
    _stop_clock()


def _import_without_graphics() -> None:
    """Import MuJoCo, and let it load its graphics library when its GLContext is first asked for.

    GLFW starts a Python of its own to read its version, which takes an eighth of the import. A model
    that a user's Python makes may draw: it finds all that it would find.
    """
    given = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        import mujoco
    finally:
        del os.environ["MUJOCO_GL"]
        if given is not None:
            os.environ["MUJOCO_GL"] = given
    graphics = next((sys.modules[name] for name in _GRAPHICS if name in sys.modules), None)
    # mujoco-core alone draws nothing.
    if graphics is None:
        return

    def load(name: str) -> Any:
        """The class GLContext; AttributeError for any other name that a module lacks."""
        if name != "GLContext":
            raise AttributeError(f"module 'mujoco' has no attribute {name!r}")
        # Its code runs again, under the user's own MUJOCO_GL.
        importlib.reload(graphics)
        return graphics.__dict__[name]

    for module in (mujoco, graphics):
        module.__dict__["__getattr__"] = load


def _stop_clock() -> None:
    """Let MuJoCo time no part of its steps for MjData.timer, where the system lets Python reach it:
    to read the clock takes a quarter of a ball's step, a tenth of a robot's.

    MuJoCo's Python starts this clock; programs in C have none. A user's own clock stays.
    """
    import mujoco

    if mujoco.get_mjcb_time() is not None:
        return
    with contextlib.suppress(OSError, ValueError):
        # MuJoCo's library, found as one that its Python needs.
        library = ctypes.CDLL(mujoco._functions.__file__)
        ctypes.c_void_p.in_dll(library, "mjcb_time").value = None


def has_feature(mujoco: Any, feature: str) -> bool:
    """Return whether a MuJoCo has a feature.

    mujoco: the module.
    feature: a key of `_FEATURES`, such as "adhesion".
    """
    owner, attribute, _ = _FEATURES[feature]
    # The class that has it, or the module itself.
    where = mujoco
    if owner:
        where = getattr(mujoco, owner)
    return hasattr(where, attribute)


def can_pull(version: tuple[int, ...]) -> bool:
    """Say whether contacts can adhere, both in this version of MuJoCo, such as (3,
    5), and in the installed one.
    """
    _, _, first_version = _FEATURES["adhesion"]
    since = tuple(map(int, first_version.split(".")))
    return has_feature(backend(), "adhesion") and (not version or version >= since)


def require_feature(mujoco: Any, feature: str) -> None:
    """Raise EngineMissing for a MuJoCo that is too old for a feature.

    mujoco: the module.
    feature: a key of `_FEATURES`, such as "adhesion".
    """
    _, _, since = _FEATURES[feature]
    if not has_feature(mujoco, feature):
        raise EngineMissing(
            f"mujoco {mujoco.__version__}",
            f"has no {feature}",
            f"{since} or later",
            f"Try: {BACKEND.command} --upgrade",
        )


@contextlib.contextmanager
def captured_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would print and write to MUJOCO_LOG.TXT, in a list.

    The list grows while the block runs; the user's own handler is back afterwards. Raises
    EngineFailed for a fatal error of MuJoCo's in the block.
    """
    mujoco = backend()
    collected: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(collected.append)
    try:
        with foreign_errors("mujoco", mujoco.FatalError):
            yield collected
    finally:
        mujoco.set_mju_user_warning(before)


def keep_no_log() -> None:
    """Let MuJoCo write no MUJOCO_LOG.TXT into the user's folder from this worker process."""
    mujoco = backend()
    if in_worker() and mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(lambda _: None)


def plugin_warnings(warned: Iterable[str]) -> tuple[str, ...]:
    """Warnings of hcbench's plug-ins, the first of each kind, one line each, in order.

    warned: all texts that MuJoCo gave; those of others are left out. The plug-in repeats a warning
    with other numbers for every MjData.
    """
    # By a text's beginning, up to the numbers.
    kinds: dict[str, str] = {}
    for words in warned:
        if "plugin hcbench." in words:
            kinds.setdefault(words.partition(" turns by ")[0], " ".join(words.split()))
    return tuple(kinds.values())


def forget_resets(data: Any) -> None:
    """Start counting what `resets` reports from 0."""
    data.warning.number[:] = 0


def resets(data: Any) -> bool:
    """Say whether MuJoCo reset the state as bad; in a first step the time does not show it."""
    return bool(data.warning.number[_bad_states()].any())


@functools.cache
def _bad_states() -> slice:
    """Places of the warnings of a state that MuJoCo resets, among the numbers of all warnings."""
    kinds = backend().mjtWarning
    return slice(int(kinds.mjWARN_BADQPOS), int(kinds.mjWARN_BADQACC) + 1)
