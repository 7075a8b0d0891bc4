"""Options for a contact given by stiffness and damping, as Adams and Newton have it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from hcbench.errors import UserError


class _AdamsType(click.types.StringParamType):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """An AdamsImpact of the text."""
        from hcbench import units
        from hcbench.laws.penalty import AdamsImpact

        k, e, c, d = _parts(
            value, "--adams", "IMPACT's k, e, cmax, d, such as '1e5 N/mm, 1, 10 N s/mm, 0.1 mm'", 4
        )
        exponent = units.parse(e, "exponent", "--adams")
        stiffness = units.parse(k, "stiffness", "--adams", exponent=exponent)
        damping, depth = units.parse(c, "damping", "--adams"), units.parse(d, "length", "--adams")
        return AdamsImpact(stiffness, exponent, damping, depth)


class _NewtonType(click.types.StringParamType):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """A NewtonSpring of the text."""
        from hcbench import units
        from hcbench.laws.conventions import SOLVERS_OF_NEWTON
        from hcbench.laws.penalty import NewtonSpring

        solver, ke, kd = _parts(value, "--newton", "a solver, ke, kd, such as 'semi-implicit, 1e4, 20'", 3)
        if solver.lower() not in SOLVERS_OF_NEWTON:
            known = " or ".join(SOLVERS_OF_NEWTON)
            raise UserError("--newton", repr(solver), f"{known}: the solvers of Newton that read ke and kd")
        numbers = (units.parse(text, "number", "--newton") for text in (ke, kd))
        return NewtonSpring(SOLVERS_OF_NEWTON[solver.lower()], *numbers)


def _parts(value: str, slot: str, expected: str, count: int) -> list[str]:
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != count:
        raise UserError(slot, repr(value), expected)
    return parts


def spring_options(option: Callable[..., Any] = click.option) -> Callable[[Callable[..., Any]], Any]:
    """Gives a command --adams and --newton."""
    adams = option("--adams", type=_AdamsType(), help="IMPACT of Adams: k, e, cmax, d in SI or with units.")
    newton = option("--newton", type=_NewtonType(), help="Newton's solver, ke, kd: 'semi-implicit, 1e4, 20'.")
    return lambda command: adams(newton(command))
