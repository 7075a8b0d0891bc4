"""Bodies at rest under MuJoCo's restitution plug-in stay: a second here, a minute under `make
test-plugins`.
"""

from __future__ import annotations

import os
from itertools import product
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from plugin_options import CONES, INTEGRATORS, at_rest

LONG = "HCBENCH_PLUGINS" in os.environ
PAGE = Path(__file__).parents[3] / "docs" / "reference" / "plugins.md"


@pytest.mark.parametrize("cone", CONES if LONG else CONES[:1])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("kind", ["box", "stack", "ramp", "pile", "heap", "table"])
def test_what_rests_neither_creeps_nor_vibrates(kind: str, integrator: str, cone: str) -> None:
    """At 2 ms a settled body moves below 1e-8 m/s and drifts below 1e-8 m a second."""
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
    drift = (
        np.abs(data.xpos[bodies] - start)[:, 2 if kind == "table" else slice(None)].max() / seconds
    )
    if LONG:
        print(f"{kind}, {integrator}, {cone}: {fastest:.1e} m/s, {drift:.1e} m of drift a second")
    assert fastest < 1e-8
    assert drift < 1e-8


OTHERS: dict[str, dict[str, Any]] = {
    "PGS": {"solver": "PGS"},
    "`noslip_iterations` 5": {"noslip": 5},
    "CG": {"solver": "CG"},
}


def documented() -> dict[str, list[float]]:
    """The page's table: the fastest of a box, a stack and a box on a slope, m/s."""
    table = (
        PAGE.read_text(encoding="utf-8")
        .split("<!-- begin rest -->")[1]
        .split("<!-- end rest -->")[0]
    )
    rows = [line.split("|") for line in table.strip().splitlines()[2:]]
    return {row[1].strip(): [float(cell) for cell in row[2:-1]] for row in rows}


@pytest.mark.parametrize("name", OTHERS)
def test_other_solvers_creep_no_faster_than_the_page_says(name: str) -> None:
    integrators, cones = (("Euler", "implicitfast"), CONES) if LONG else (("Euler",), CONES[1:])
    fastest = []
    for kind in ("box", "stack", "ramp"):
        seen = [0.0]
        for integrator, cone in product(integrators, cones):
            scene = at_rest(kind, 2e-3, {**OTHERS[name], "integrator": integrator, "cone": cone})
            model = scene.model()
            data = scene.data(model)
            mujoco.mj_step(model, data, nstep=500)
            for _ in range(2500 if LONG else 50):
                mujoco.mj_step(model, data)
                seen.append(float(np.abs(data.cvel[1:, 3:]).max()))
        fastest.append(max(seen))
    if LONG:
        print(name, " | ".join(f"{one:.1e}" for one in fastest))
    assert (np.array(fastest) <= documented()[name]).all()
