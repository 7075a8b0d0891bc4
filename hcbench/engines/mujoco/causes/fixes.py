"""MuJoCo: the fixes of the diagnosis, as changes to a copy of the model and as numbers to paste."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.rows import STIFF_SOLIMP
from hcbench.laws.kelvin_voigt import Ending, matched

if TYPE_CHECKING:
    from collections.abc import Sequence

_STEPS = 40  # in contact, of a spring and damper
_LEAST_E = 0.01  # that a spring and damper are made for: e = 0 takes a damping without bounds
_SPELLED = {"euler": "Euler", "rk4": "RK4"}


def numbers(values: Sequence[float]) -> str:
    """As an XML attribute has them."""
    return " ".join(f"{v:.10g}" for v in values)


def integrator_name(model: Any) -> str:
    """The integrator as XML spells it."""
    name = str(backend().mjtIntegrator(int(model.opt.integrator)).name).removeprefix("mjINT_").lower()
    return _SPELLED.get(name, name)


def bouncy(e: float, timestep: float, integrator: str) -> tuple[tuple[float, ...], tuple[float, ...], str]:
    """(solref, solimp, what else to write) of a contact with this e at this step."""
    if integrator in ("RK4", "discrete"):
        law = matched(min(max(e, _LEAST_E), 1.0), _STEPS * timestep, 1.0, Ending.FORCE)
        other = ', integrator="implicitfast"' if integrator == "discrete" else ""
        return (-law.stiffness, -law.damping), STIFF_SOLIMP, other
    return (0.0, -(1.0 + e) / timestep), STIFF_SOLIMP, ""


def set_contact(
    model: Any, geoms: Sequence[int], solref: Sequence[float] | None, solimp: Sequence[float] | None
) -> None:
    """Give the contacts among some geoms their parameters, wherever they take them from."""
    pairs = [
        i
        for i, (a, b) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True))
        if {int(a), int(b)} <= set(geoms)
    ]
    for field, values in (("solref", solref), ("solimp", solimp)):
        if values is None:
            continue
        for i in pairs:
            getattr(model, f"pair_{field}")[i] = values
        if not pairs:
            for g in geoms:
                getattr(model, f"geom_{field}")[g] = values
    if not pairs:
        model.geom_priority[list(geoms)] = max(int(model.geom_priority[g]) for g in geoms)


def set_bouncy(model: Any, geoms: Sequence[int], e: float) -> None:
    """Give the contact this e, at the step and under the integrator that the model has by then."""
    solref, solimp, _ = bouncy(e, float(model.opt.timestep), integrator_name(model))
    set_contact(model, geoms, solref, solimp)


def set_timestep(model: Any, timestep: float) -> None:
    """Another step."""
    model.opt.timestep = timestep


def set_integrator(model: Any, name: str) -> None:
    """Another integrator, by the end of its name in mjtIntegrator."""
    model.opt.integrator = int(getattr(backend().mjtIntegrator, f"mjINT_{name}"))


def no_override(model: Any) -> None:
    """Contacts keep their own parameters."""
    model.opt.enableflags &= ~int(backend().mjtEnableBit.mjENBL_OVERRIDE)


def no_gravity(model: Any) -> None:
    """Free flight."""
    model.opt.gravity[:] = 0.0


def no_fluid(model: Any) -> None:
    """Vacuum."""
    model.opt.density = model.opt.viscosity = 0.0


def zero_dofs(model: Any, field: str, dofs: Sequence[int]) -> None:
    """Take a loss off some degrees of freedom."""
    getattr(model, field)[list(dofs)] = 0.0


def no_margin(model: Any, geoms: Sequence[int]) -> None:
    """The contact acts where the surfaces meet."""
    for field in ("margin", "gap"):
        getattr(model, f"geom_{field}")[list(geoms)] = 0.0
        values = getattr(model, f"pair_{field}", None)
        for i, (a, b) in enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True)):
            if values is not None and {int(a), int(b)} <= set(geoms):
                values[i] = 0.0
