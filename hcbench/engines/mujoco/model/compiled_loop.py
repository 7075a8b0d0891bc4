"""MuJoCo: launches of a user's model stepped and read in C; the same bits as in Python."""

from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco import plugin
from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.open import LaunchWorkspace
from hcbench.engines.mujoco.model.simulation import NEAR, MujocoFlight
from hcbench.engines.mujoco.model.speed_shares import NAMES
from hcbench.system.compiler import build
from hcbench.system.errors import EngineFailed, HcbenchError
from hcbench.terms.impact import Launch

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hcbench.engines.mujoco.model.open import OpenedModel
    from hcbench.terms.impact import Floats

_SOURCE = "engines/mujoco/model/launch.c"
# What `advance` of the library returns in place of a count of steps.
_FATAL_ERROR = -1
_CALLBACKS = ("control", "passive", "act_bias", "act_dyn", "act_gain", "contactfilter", "sensor")


class _Pair(ctypes.Structure):
    """`Pair` of launch.c, which says what its fields are."""

    _fields_ = (
        ("sides", ctypes.c_void_p),
        ("in_trees", ctypes.c_void_p),
        ("geoms", ctypes.c_void_p),
        ("firsts", ctypes.c_int32),
        ("seconds", ctypes.c_int32),
        ("bodies", ctypes.c_int32 * 2),
        ("has_causes", ctypes.c_int32),
        ("near", ctypes.c_double),
        ("onset", ctypes.c_double),
        ("gap", ctypes.c_double),
        ("reach", ctypes.c_double),
    )


class _Launch(ctypes.Structure):
    """`Launch` of launch.c, which says what its fields are."""

    _fields_ = (
        ("point", ctypes.c_double * 3),
        ("normal", ctypes.c_double * 3),
        ("x", ctypes.c_double),
        ("rate", ctypes.c_double),
        ("steps", ctypes.c_int32),
        ("first_force", ctypes.c_int32),
        ("is_apart", ctypes.c_int32),
        ("first_touch", ctypes.c_void_p),
    )


@functools.cache
def _library() -> ctypes.CDLL | None:
    """The compiled loop for the installed MuJoCo; None where it cannot be compiled."""
    try:
        arguments = plugin.compiler_arguments(Path(backend().__file__).parent)
        library = ctypes.CDLL(str(build(_SOURCE, *arguments)))
    # Without a compiler, without MuJoCo's headers, or on a full disk the loop in Python does it.
    except (HcbenchError, OSError):
        return None
    library.fatal_error.restype = ctypes.c_char_p
    pointer = ctypes.c_void_p
    count = ctypes.c_int
    library.advance.argtypes = [
        *(pointer, pointer, ctypes.POINTER(_Pair), ctypes.POINTER(_Launch)),
        *(count, count, pointer, pointer, pointer),
    ]
    return library


def flights_of(opened: OpenedModel, launches: Sequence[Launch]) -> list[MujocoFlight]:
    """Launches of a model in one workspace, each left at its start; stepped in C where that can be.

    Raises UserError for a launch that the joints cannot make.
    """
    space = LaunchWorkspace.of(opened)
    kind: Callable[[OpenedModel, Launch, LaunchWorkspace], MujocoFlight] = MujocoFlight
    if _is_plain(opened, launches, space) and _library() is not None:
        kind = functools.partial(CompiledFlight, pair=PairInC(opened))
    flights = []
    for launch in launches:
        flights.append(kind(opened, launch, space))
        flights[-1].leave()
    return flights


def _is_plain(opened: OpenedModel, launches: Sequence[Launch], space: LaunchWorkspace) -> bool:
    """Say whether launches need nothing that the loop in C lacks.

    It has no RK4, no plug-in of hcbench's that sets e, no motion along the plate and no distance to
    height fields. A callback in Python would need the interpreter in each step.
    """
    mujoco = backend()
    return (
        space.free is None
        and space.beside is None
        and opened.place.pair.height_field < 0
        and not any(launch.is_oblique for launch in launches)
        and all(getattr(mujoco, f"get_mjcb_{name}")() is None for name in _CALLBACKS)
    )


class PairInC:
    """The pair of a model under test for launch.c, which all of its launches share.

    fields: a `_Pair`, valid as long as this object.
    """

    def __init__(self, opened: OpenedModel) -> None:
        """Describe the pair of an opened model at its place of touch."""
        pair = opened.place.pair
        # What `fields` points into.
        self._arrays = (
            np.ascontiguousarray(pair.sides, dtype=np.int8),
            pair.in_trees.astype(np.uint8),
            np.array(pair.geoms, dtype=np.int32),
        )
        sides, in_trees, geoms = (array.ctypes.data for array in self._arrays)
        self.fields = _Pair(
            sides=sides,
            in_trees=in_trees,
            geoms=geoms,
            firsts=len(pair.first.geoms),
            seconds=len(pair.second.geoms),
            bodies=(pair.first.body, pair.second.body),
            has_causes=pair.more_than_contacts,
            near=NEAR,
            onset=opened.place.contact.onset,
            gap=opened.place.gap,
            reach=pair.reach,
        )


class CompiledFlight(MujocoFlight):
    """One launch of a placed pair, stepped by MuJoCo and read in C."""

    def __init__(
        self, opened: OpenedModel, launch: Launch, space: LaunchWorkspace, pair: PairInC
    ) -> None:
        """Put the pair where the launch begins.

        pair: of the model under test. Other arguments and errors are `MujocoFlight`'s.
        """
        super().__init__(opened, launch, space)
        contact = opened.place.contact
        self._pair = pair
        self._touch_steps = np.full(self._model.ngeom, -1, dtype=np.int32)
        self._launch = _Launch(
            point=tuple(contact.point),
            normal=tuple(contact.normal),
            x=self._x,
            rate=self._rate,
            first_force=-1,
            first_touch=self._touch_steps.ctypes.data,
        )

    def _begin_reading(self) -> None:
        """Read nothing: the loop in C does."""

    def _rows(self, steps: int, after: int | None) -> tuple[Floats, None]:
        """Take the steps in C: (penetration m, rate m/s and force N, (3, n); None, as nothing is
        read along the plate).

        steps: most to take. after: how many more once the two have parted; None: all. Also keeps
        what each cause adds to the approach, from the first step with a force on. Raises MuJoCo's
        FatalError, and EngineFailed where there is no memory for a step.
        """
        library = _library()
        assert library is not None, "flights_of takes this class only with a library"
        begin = self._launch.steps
        read = np.empty((steps, 3))
        parts = np.empty((steps, len(NAMES)))
        is_counted = np.zeros(steps, dtype=np.uint8)
        wait = -1 if after is None else after
        arrays = [array.ctypes.data for array in (read, parts, is_counted)]
        taken = library.advance(
            *(self._model._address, self._data._address, self._pair.fields, self._launch),
            *(steps, wait, *arrays),
        )
        if taken == _FATAL_ERROR:
            raise self._mujoco.FatalError(library.fatal_error().decode(errors="replace"))
        if taken < 0:
            raise EngineFailed("mujoco", "no memory for a step", "a model that fits into memory")
        first_force = self._launch.first_force
        self._touched = first_force >= 0
        counted = np.flatnonzero(is_counted[:taken])
        if self._causes is not None:
            if first_force >= begin:
                self._causes.forget()
                self._touch_speed = float(read[first_force - begin, 1])
                counted = counted[counted >= first_force - begin]
            self._causes.keep((begin + counted).tolist(), parts[counted].tolist())
        return read[:taken].T, None

    def _touched_until(self, steps: int) -> set[int]:
        """Geoms that touched the two in the first `steps` steps."""
        touched = (self._touch_steps >= 0) & (self._touch_steps < steps)
        return set(np.flatnonzero(touched).tolist())
