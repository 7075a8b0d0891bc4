"""Differences between a model and the one in which `hcbench tune` measured the error it promised."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs
from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.scene.promises import option_in_force
from hcbench.sim.model_under_test import Suspect
from hcbench.sim.promise import Promise

# Relative difference of two numbers that the digits of XML make.
_SAME = 1e-6


def broken_promise(model: Any, promise: Promise, geoms: tuple[int, int]) -> Iterator[Suspect]:
    """Yield each difference by which the pair is no longer the one that was tuned."""
    yield from _pairs(model, promise, geoms)
    yield from _override(model)
    now = dict(option_in_force(model))
    for name, text in promise.option:
        if name in now and not _equal(now[name], text):
            yield Suspect(
                f"promised-{name}",
                f"The model has another {name} than hcbench wrote this pair for.",
                f'{name}="{now[name]}" now; tuned for "{text}". A later <option> replaces an earlier one',
                f'<option {name}="{text}"/>, after every other <option>',
                partial(_set_option, name=name, text=text),
                always_reported=True,
            )


def _pairs(model: Any, promise: Promise, geoms: tuple[int, int]) -> Iterator[Suspect]:
    """Pairs of two geoms that were added to those hcbench wrote, or that are missing."""
    joining = explicit_pairs(model, geoms)
    lost = promise.rows - len(joining)
    if lost > 0:
        yield Suspect(
            "missing-pair",
            f"{lost} of the {promise.rows} pairs that hcbench wrote for these two geoms is missing.",
            f"the model keeps the promise of {promise.rows} pairs: {promise.text}",
            "paste all <pair> elements that `hcbench tune` printed, all of the same two geoms",
            always_reported=True,
        )
    if lost < 0:
        yield Suspect(
            "second-pair",
            f"{len(joining)} <pair>s join these two geoms where hcbench wrote {promise.rows}: all act.",
            f"the model keeps the promise of {promise.rows}: {promise.text}",
            "take out the <pair>s of these two geoms that `hcbench tune` did not print",
            always_reported=True,
        )


def _override(model: Any) -> Iterator[Suspect]:
    """The flag that replaces solref and solimp of every contact."""
    flag = int(backend().mjtEnableBit.mjENBL_OVERRIDE)
    if not model.opt.enableflags & flag:
        return
    yield Suspect(
        "override",
        "The override flag replaces every contact's solref and solimp.",
        "the pair's own numbers, which hcbench wrote, are not used",
        '<option><flag override="disable"/></option>',
        partial(fixes.set_options, enableflags=int(model.opt.enableflags) & ~flag),
        always_reported=True,
    )


def _equal(now: str, promised: str) -> bool:
    try:
        return abs(float(now) - float(promised)) <= _SAME * abs(float(promised))
    except ValueError:
        return now == promised


def _set_option(model: Any, name: str, text: str) -> None:
    """Set one attribute of <option> from its text."""
    mujoco = backend()
    if name == "integrator":
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{text.upper()}")
    elif name == "cone":
        model.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{text.upper()}")
    else:
        setattr(model.opt, name, float(text))
