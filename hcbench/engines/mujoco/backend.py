"""The mujoco package: importing it, what an older version lacks, its warnings and its fatal errors."""

import contextlib
import ctypes
import functools
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


def backend() -> Any:
    """The mujoco module, imported on the first call; in hcbench's own processes it takes no times
    of its steps.

    Raises EngineMissing, and EngineFailed where it is there but does not load.
    """
    try:
        import mujoco
        import mujoco.rollout

        if IS_COMMAND.get() or in_worker():
            _stop_clock(mujoco)
    except ImportError as error:
        raise EngineMissing(
            "engine 'mujoco'", f"cannot be imported: {error}", "", f"Try: {BACKEND.command}"
        ) from None
    # Its graphics library, which MUJOCO_GL names, may be missing.
    except Exception as error:
        raise EngineFailed("engine 'mujoco'", f"cannot be imported: {error}", "") from error
    return mujoco


@functools.cache
def _stop_clock(mujoco: Any) -> None:
    """Let MuJoCo time no part of its steps for MjData.timer, where the system lets Python reach it:
    to read the clock takes a quarter of a ball's step, a tenth of a robot's.

    MuJoCo's Python starts this clock; programs in C have none. A user's own clock stays.
    mujoco: the module.
    """
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

    The list grows while the block runs; the user's own handler is back afterwards.
    Raises EngineFailed for a fatal error of MuJoCo's in the block.
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
