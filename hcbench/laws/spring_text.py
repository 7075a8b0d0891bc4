"""Contacts by stiffness and damping, as a user writes them: Adams' IMPACT, and a solver of Newton."""

from typing import Any

from hcbench.laws.conventions import SOLVERS_OF_NEWTON
from hcbench.laws.penalty import AdamsImpact, NewtonSpring
from hcbench.system.errors import UserError
from hcbench.terms import units

Adams = str | AdamsImpact  # "k, e, cmax, d", SI or with units
Newton = str | NewtonSpring  # "SOLVER, ke, kd"


def read_adams(given: Adams, slot: str = "adams") -> AdamsImpact:
    """IMPACT of "k, e, cmax, d", SI or with units, or one that was read. Raises UserError."""
    if isinstance(given, AdamsImpact):
        return given
    k, e, c, d = _parts(given, slot, "IMPACT's k, e, cmax, d, such as '1e5 N/mm, 1, 10 N s/mm, 0.1 mm'", 4)
    exponent = units.parse(e, "exponent", slot)
    stiffness = units.parse(k, "stiffness", slot, exponent=exponent)
    damping, depth = units.parse(c, "damping", slot), units.parse(d, "length", slot)
    return AdamsImpact(stiffness, exponent, damping, depth)


def read_newton(given: Newton, slot: str = "newton") -> NewtonSpring:
    """The contact of "SOLVER, ke, kd", or one that was read. Raises UserError."""
    if isinstance(given, NewtonSpring):
        return given
    solver, ke, kd = _parts(given, slot, "a solver, ke, kd, such as 'semi-implicit, 1e4, 20'", 3)
    if solver.lower() not in SOLVERS_OF_NEWTON:
        known = " or ".join(SOLVERS_OF_NEWTON)
        raise UserError(slot, repr(solver), f"{known}: the solvers of Newton that read ke and kd")
    numbers = (units.parse(text, "number", slot) for text in (ke, kd))
    return NewtonSpring(SOLVERS_OF_NEWTON[solver.lower()], *numbers)


def _parts(value: Any, slot: str, expected: str, count: int) -> list[str]:
    parts = [part.strip() for part in value.split(",")] if isinstance(value, str) else []
    if len(parts) != count:
        raise UserError(slot, f"{value!r:.80}", expected)
    return parts
