"""MuJoCo's options under which the restitution plug-in is measured, and
the energy it wins under each.
"""

from __future__ import annotations

import copy
from functools import partial
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from contact_scenes import (
    BOX,
    HALF,
    RADIUS,
    Scene,
    add_body,
    kept_in_flight,
    pile,
    stack,
    tumbling,
    world,
)

from hcbench.contact.mujoco import Restitution

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

CONES = ("pyramidal", "elliptic")
INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4")


def rows() -> Iterator[tuple[str, dict[str, Any]]]:
    """Name and options of each row of the table in docs/reference/plugins.md."""
    for integrator in INTEGRATORS:
        yield f"`{integrator}`, Newton", {"integrator": integrator}
    for integrator in INTEGRATORS:
        yield f"`{integrator}`, CG", {"integrator": integrator, "solver": "CG"}
    for integrator in ("Euler", "implicitfast"):
        yield f"`{integrator}`, PGS", {"integrator": integrator, "solver": "PGS"}
        yield f"`{integrator}`, `noslip_iterations` 5", {"integrator": integrator, "noslip": 5}
    for condim in (1, 4, 6):
        yield f"`condim` {condim}", {"condim": condim}
    for flag in ("Sleep", "DiagExact", "Speculative"):
        yield f"flag `{flag.lower()}` on", {"enable": flag}
    for flag in ("Island", "MultiCCD", "NativeCCD", "Warmstart", "Midphase", "Refsafe"):
        yield f"flag `{flag.lower()}` off", {"disable": flag}


def scenes(
    seeds: Sequence[int], cone: str, options: dict[str, Any]
) -> Iterator[Callable[[], Scene]]:
    """A stack, and of each seed a thrown box and a pile."""
    h = (1e-3, 2e-3, 4e-3)
    own = {
        name: value for name, value in options.items() if name in ("integrator", "solver", "noslip")
    }
    yield partial(stack, 4, 2e-3, HALF, friction=1.0, cone=cone, **own)
    for seed in seeds:
        yield partial(
            tumbling,
            seed,
            h[seed % 3],
            (HALF, Restitution(0.315))[seed % 2],
            friction=0.5,
            cone=cone,
            **own,
        )
        yield partial(
            pile, seed, h[seed % 3], HALF, n=4, cone=cone, **({"integrator": "Euler"} | own)
        )


def energy_won(
    make: Callable[[], Scene], options: dict[str, Any], seconds: float
) -> tuple[float, float]:
    """Energy that contact wins beyond the step without contact, over the
    start's: in the worst step, in all.

    options: condim of all geoms; enable, disable: a flag by MuJoCo's name.
    """
    scene = make()
    for geom in scene.spec.geoms:
        geom.condim = options.get("condim", geom.condim)
    model = scene.model()
    model.opt.enableflags |= _bit("Enable", options.get("enable"))
    model.opt.disableflags |= _bit("Disable", options.get("disable"))
    data, alone, free = scene.data(model), mujoco.MjData(model), copy.copy(model)
    free.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.mj_forward(model, data)
    start, most, total = max(abs(kept_in_flight(model, data)), 1e-9), 0.0, 0.0
    for _ in range(round(seconds / model.opt.timestep)):
        alone.qpos[:], alone.qvel[:] = data.qpos, data.qvel
        meets = data.ncon > 0
        mujoco.mj_step(model, data)
        if not meets:
            continue
        mujoco.mj_step(free, alone)
        mujoco.mj_forward(free, alone)
        now = copy.copy(data)
        mujoco.mj_forward(free, now)
        gain = (kept_in_flight(free, now) - kept_in_flight(free, alone)) / start
        most, total = max(most, gain), total + max(0.0, gain)
    assert np.isfinite(data.qpos).all()
    return most, total


def _bit(kind: str, name: str | None) -> int:
    if name is None:
        return 0
    bits = getattr(mujoco, f"mjt{kind}Bit")
    prefix = "mjENBL_" if kind == "Enable" else "mjDSBL_"
    return int(getattr(bits, prefix + name.upper()))


def at_rest(kind: str, h: float, options: dict[str, Any]) -> Scene:
    """Bodies at rest: a box, a stack, a box on a ramp, bricks, a heap that fell, a ball on a
    turning table.
    """
    spec = world(h, friction=0.5, **options)
    tip = np.radians(15 if kind == "ramp" else 0)
    quat = [np.cos(tip / 2), 0, np.sin(tip / 2), 0]
    spec.worldbody.first_geom().quat = quat
    if kind == "table":
        table = spec.worldbody.add_body(name="table", pos=[0, 0, 0.1])
        table.add_joint(name="table", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        table.add_geom(
            name="table", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.5, 0.02, 0], mass=20
        )
        add_body(spec, "b0", (0, 0, 0.12 + RADIUS))
        return Scene(spec, HALF, [("table", [1.0])])
    if kind == "pile":  # bricks, each on two
        for i, (x, row) in enumerate([(-2.2, 0), (0, 0), (2.2, 0), (-1.1, 1), (1.1, 1), (0, 2)]):
            add_body(
                spec,
                f"b{i}",
                (x * RADIUS, 0, (2 * row + 1) * RADIUS),
                BOX,
                (RADIUS,) * 3,
                10.0 ** (row - 1),
            )
        return Scene(spec, HALF)
    if kind == "heap":  # what falls on each other, and lies
        rng = np.random.default_rng(1)
        for i in range(6):
            at = (*rng.uniform(-0.03, 0.03, 2), 0.1 + 0.15 * i)
            add_body(
                spec,
                f"b{i}",
                at,
                BOX,
                rng.uniform(0.03, 0.06, 3),
                friction=0.5,
                quat=rng.normal(size=4),
            )
        return Scene(spec, HALF)
    for i in range(4 if kind == "stack" else 1):
        up = RADIUS * (2 * i + 1)
        add_body(
            spec, f"b{i}", (up * np.sin(tip), 0, up * np.cos(tip)), BOX, (RADIUS,) * 3, quat=quat
        )
    return Scene(spec, HALF)
