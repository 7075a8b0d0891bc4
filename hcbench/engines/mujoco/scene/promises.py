"""Promises of `hcbench tune` in MJCF: a <text> of the <custom> section, named by the two geoms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.scene.elements import quoted
from hcbench.sim.promise import Promise
from hcbench.system.text import shortest

if TYPE_CHECKING:
    from collections.abc import Iterable

    from hcbench.terms.setting import Pair


def promise_lines(pairs: Iterable[Pair], promise: Promise) -> str:
    """The <custom> section of these pairs, to paste; "" for a target that a text cannot say."""
    if not promise.text:
        return ""
    lines = [f"  <text name={quoted(_name(*pair))} data={quoted(promise.text)}/>" for pair in pairs]
    return "\n".join(["<custom>", *lines, "</custom>"])


def promise_in(model: Any, geoms: tuple[int, int]) -> Promise | None:
    """Read hcbench's promise for two geoms of a compiled model; None without one."""
    names = [str(model.geom(geom).name) for geom in geoms]
    for pair in (names, names[::-1]):
        number = backend().mj_name2id(model, backend().mjtObj.mjOBJ_TEXT, _name(*pair))
        if number >= 0:
            start = int(model.text_adr[number])
            size = int(model.text_size[number])
            return Promise.read(bytes(model.text_data[start : start + size - 1]).decode())
    return None


def option_in_force(model: Any) -> tuple[tuple[str, str], ...]:
    """Options of a compiled model on which e and friction of a contact depend, as XML writes them."""
    mujoco = backend()
    option = model.opt
    integrator = (
        str(mujoco.mjtIntegrator(int(option.integrator)).name).removeprefix("mjINT_").lower()
    )
    cone = str(mujoco.mjtCone(int(option.cone)).name).removeprefix("mjCONE_").lower()
    return (
        ("timestep", shortest(float(option.timestep))),
        ("integrator", {"euler": "Euler", "rk4": "RK4"}.get(integrator, integrator)),
        ("cone", cone),
        ("impratio", shortest(float(option.impratio))),
    )


def _name(first: str, second: str) -> str:
    return f"hcbench:{first}:{second}"
