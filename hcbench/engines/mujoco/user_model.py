"""MuJoCo: from whatever holds a model to an MjModel, or one line that says why not."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.errors import EngineFailed, SceneError, UserError

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import Request

SUFFIXES = (".xml", ".mjcf", ".urdf", ".mjb", ".mjz")


def load(source: Any, request: Request) -> tuple[Any, str]:
    """(MjModel, what to call it) with the request's step and gravity; the user's own object stays as it was.

    source: a path, an MjModel, an MjSpec, or MJCF text. Raises SceneError for what does not compile.
    """
    mujoco = backend()
    with captured_warnings() as warnings:
        if isinstance(source, mujoco.MjModel):
            model, label = copy.copy(source), "MjModel"
        elif isinstance(source, mujoco.MjSpec):
            model, label = _compiled(source.copy().compile, "MjSpec"), "MjSpec"
        elif isinstance(source, str) and source.lstrip().startswith("<"):
            model, label = _compiled(lambda: mujoco.MjModel.from_xml_string(source), "MJCF text"), "MJCF text"
        else:
            model, label = _from_file(mujoco, Path(source)), Path(source).name
    if any("NaN" in line for line in warnings):
        raise SceneError("model", f"{label} has a NaN in it", "numbers", "Look for 'nan' in the file")
    _require_sound(model, label)
    if request.timestep is not None:
        model.opt.timestep = request.timestep
    if request.gravity is not None:
        model.opt.gravity[:] = request.gravity
    return model, label


def _from_file(mujoco: Any, path: Path) -> Any:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "is not there"
        raise SceneError("model", f"{path} {what}", f"a model file: {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mjb":
        return _compiled(lambda: mujoco.MjModel.from_binary_path(str(path)), str(path))
    return _compiled(lambda: mujoco.MjModel.from_xml_path(str(path)), str(path))


def _compiled(make: Any, label: str) -> Any:
    try:
        return make()
    except (ValueError, RuntimeError, TypeError, OSError) as error:
        words = " ".join(str(error).split()).removeprefix("Error: ").removeprefix("XML Error: ")
        if "allocate" in words:
            raise EngineFailed("model", f"{label}: {words}", "a model that fits into memory") from None
        raise SceneError("model", f"{label}: {words}", "a model that MuJoCo compiles") from None


def _require_sound(model: Any, label: str) -> None:
    """What the compiler lets through and no simulation survives."""
    for slot, values in (
        ("mass", model.body_mass),
        ("inertia", model.body_inertia),
        ("size", model.geom_size),
    ):
        bad = np.flatnonzero(~np.isfinite(np.asarray(values).reshape(len(values), -1)).all(axis=1))
        if bad.size:
            kind = "geom" if slot == "size" else "body"
            raise SceneError("model", f"{label}: {slot} of {kind} {int(bad[0])} is not finite", "numbers")
    if (np.asarray(model.body_mass) < 0).any():
        raise SceneError("model", f"{label}: a body of negative mass", "masses of 0 kg or more")
    if not 0 < model.opt.timestep < np.inf:
        raise SceneError("timestep", f"{label}: {model.opt.timestep!r} s", "a step above 0 s")


def start(model: Any, key: str | None) -> tuple[Any, str]:
    """(MjData at rest in the start configuration, its name): the keyframe asked for, the first, or qpos0."""
    mujoco = backend()
    data = mujoco.MjData(model)
    names = [model.key(i).name or str(i) for i in range(model.nkey)]
    if key is not None and key != "qpos0" and key not in names:
        if not key.isdigit() or int(key) >= model.nkey:
            raise UserError("key", repr(key), f"one of: {', '.join(['qpos0', *names])}")
        key = names[int(key)]
    if key is None and names:
        key = names[0]
    if key is not None and key != "qpos0":
        mujoco.mj_resetDataKeyframe(model, data, names.index(key))
        data.qvel[:] = 0.0
        name = f"keyframe {key!r}"
    else:
        name = "qpos0"
    data.time = 0.0
    return data, name
