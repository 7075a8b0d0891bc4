"""Recipes of Newton: those of its own solvers, MuJoCo's, and the laws from Python."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.recipes.law_recipes import python_law_recipes
from hcbench.recipes.recipe import Role, on_a_plane, stock
from hcbench.recipes.target import contact_time, minimax_constant, one_way_spring_damper
from hcbench.sim.shared_model import changed, shared_recipes
from hcbench.terms.resolution import STEPS_OF_AN_EXPLICIT_SPRING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.recipes.target import Target


# Range of e by float32, in contacts of many steps.
_SCATTER = 6e-3


def best_constant(target: Target) -> dict[str, Any]:
    """XPBD's own restitution."""
    e, _ = minimax_constant(target)
    return {"restitution": e}


def spring_damper(target: Target) -> dict[str, Any]:
    """F = ke x + kd x' going in, ke x coming out, with the law's contact time mid-band."""
    ke, kd = one_way_spring_damper(
        target, contact_time(target, STEPS_OF_AN_EXPLICIT_SPRING), "restitution"
    )
    return {"solver": "SemiImplicit", "ke": ke, "kd": kd}


def _without_friction(options: Mapping[str, Any]) -> dict[str, Any]:
    rows = []
    for row in options["rows"]:
        without = {key: value for key, value in row.items() if "friction" not in key}
        rows.append(without)
    return {"solver": "MuJoCo", "rows": rows}


_PAIRS_NOTE = (
    "SolverMuJoCo needs newton[sim]. Each row needs its own sphere and pair; pairs cannot pull."
)
_LENT = (
    (
        "impulse",
        1e-6,
        "D = (1 + e)/h holds at this step only. Under gravity e varies by (1 + e) g h / v.",
    ),
    (
        "compliant",
        1e-2,
        "The numbers hold at this step and gravity only. e varies less than with `impulse`.",
    ),
    (
        "staggered-push",
        4e-3,
        "e is within 0.003 at 10 µs (float32) and 5e-4 at 100 µs and 1 ms (soft spring).",
    ),
)
_NATIVE = (
    stock("newton", "Newton with nothing set: SolverXPBD ignores restitutions, e = 0.03.", forms=("plane",)),
    on_a_plane("newton", "stock-mujoco", Role.STOCK, lambda target: {"solver": "MuJoCo"})(
        "SolverMuJoCo with nothing set: critically damped, e about 0.13, and restitutions are ignored.",
        "ke and kd become a solref: time constant 2/kd, damping ratio kd/(2 sqrt(ke)), per unit mass.",
        "Never give both shapes a mu of 0: Newton's states turn to NaN, MuJoCo's do not.",
    ),
    on_a_plane("newton", "restitution", Role.CONSTANT_E, best_constant, one_step=True, within=1e-6)(
        "SolverXPBD with enable_restitution=True: the best constant e, at any step and phase.",
        "Newton averages the restitutions of both shapes: set e on both. MJCF and URDF files have none.",
        "Under gravity a body rebounds with e (v + g h), v its speed before the step; not below 2 g h.",
        "The reported contact force leaves the restitution out: do not use it in an impact.",
    ),
    on_a_plane("newton", "spring-damper", Role.CONSTANT_E, spring_damper, within=_SCATTER)(
        "SolverSemiImplicit, ke and kd in closed form: the best constant e and the law's contact time.",
        "ke and kd are for this mass. Newton averages those of both shapes: set them on both.",
        "The damper acts on the way in only. e is wrong by up to 0.006 with 40 steps a contact in float32.",
    ),
    *shared_recipes("newton", "mujoco", {
        name: {
            "function": changed(f"mujoco.{name}", _without_friction), "notes": (_PAIRS_NOTE, note),
            "integrators": None, "within": within,
        } for name, within, note in _LENT
    }),
)  # fmt: skip
_HOOK = (
    "Set body_f before each step, or take the steps of SolverMuJoCo by `hcbench.contact.newton`."
)
RECIPES = (
    *_NATIVE,
    *python_law_recipes("newton", _NATIVE, _HOOK, force=_SCATTER, each_impact=2e-6),
)
