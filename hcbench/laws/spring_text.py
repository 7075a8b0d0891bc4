"""Contacts by stiffness and damping, as a user writes them: Adams' IMPACT, and a solver of Newton."""

from hcbench import units
from hcbench.errors import UserError
from hcbench.laws.conventions import SOLVERS_OF_NEWTON
from hcbench.laws.penalty import AdamsImpact, NewtonSpring


def read_adams(text: str, slot: str = "adams") -> AdamsImpact:
    """IMPACT of "k, e, cmax, d", SI or with units. Raises UserError and QuantityError."""
    k, e, c, d = _parts(text, slot, "IMPACT's k, e, cmax, d, such as '1e5 N/mm, 1, 10 N s/mm, 0.1 mm'", 4)
    exponent = units.parse(e, "exponent", slot)
    stiffness = units.parse(k, "stiffness", slot, exponent=exponent)
    damping, depth = units.parse(c, "damping", slot), units.parse(d, "length", slot)
    return AdamsImpact(stiffness, exponent, damping, depth)


def read_newton(text: str, slot: str = "newton") -> NewtonSpring:
    """The contact of "SOLVER, ke, kd". Raises UserError and QuantityError."""
    solver, ke, kd = _parts(text, slot, "a solver, ke, kd, such as 'semi-implicit, 1e4, 20'", 3)
    if solver.lower() not in SOLVERS_OF_NEWTON:
        known = " or ".join(SOLVERS_OF_NEWTON)
        raise UserError(slot, repr(solver), f"{known}: the solvers of Newton that read ke and kd")
    numbers = (units.parse(text, "number", slot) for text in (ke, kd))
    return NewtonSpring(SOLVERS_OF_NEWTON[solver.lower()], *numbers)


def _parts(value: str, slot: str, expected: str, count: int) -> list[str]:
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != count:
        raise UserError(slot, repr(value), expected)
    return parts
