"""What rests under MuJoCo's restitution plug-in stays: a second here, a minute under `make test-plugins`."""

from __future__ import annotations

import os

import mujoco
import numpy as np
import pytest
from plugin_options import CONES, INTEGRATORS, at_rest

LONG = "HCBENCH_PLUGINS" in os.environ


@pytest.mark.parametrize("cone", CONES if LONG else CONES[:1])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("kind", ["box", "stack", "ramp", "pile", "heap", "table"])
def test_what_rests_neither_creeps_nor_vibrates(kind: str, integrator: str, cone: str) -> None:
    """At 2 ms, once it has settled: below 1e-8 m/s and 1e-8 m of drift a second."""
    scene = at_rest(kind, 2e-3, {"integrator": integrator, "cone": cone})
    model = scene.model()
    data = scene.data(model)
    mujoco.mj_step(model, data, nstep=2000 if kind == "heap" else 500)
    bodies = [i for i in range(model.nbody) if (model.body(i).name or "").startswith("b")]
    start, fastest, seconds = data.xpos[bodies].copy(), 0.0, 59 if LONG else 1
    for _ in range(500 * seconds):
        mujoco.mj_step(model, data)
        velocities = data.cvel[bodies, 3:] if kind != "table" else data.cvel[bodies, 5:]
        fastest = max(fastest, float(np.abs(velocities).max()))
    drift = np.abs(data.xpos[bodies] - start)[:, 2 if kind == "table" else slice(None)].max() / seconds
    if LONG:
        print(f"{kind}, {integrator}, {cone}: {fastest:.1e} m/s, {drift:.1e} m of drift a second")
    assert fastest < 1e-8
    assert drift < 1e-8
