"""Options for a contact given by stiffness and damping, as Adams and Newton have it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click


class _AdamsType(click.types.StringParamType):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """An AdamsImpact of the text."""
        from hcbench.laws.impact_law import read_adams

        return read_adams(value, param.opts[0] if param else "adams")


class _NewtonType(click.types.StringParamType):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """A NewtonSpring of the text."""
        from hcbench.laws.impact_law import read_newton

        return read_newton(value, param.opts[0] if param else "newton")


def spring_options(
    option: Callable[..., Any] = click.option,
) -> Callable[[Callable[..., Any]], Any]:
    """Gives a command --adams and --newton."""
    adams = option(
        "--adams",
        type=_AdamsType(),
        metavar="K,E,CMAX,D",
        help="IMPACT of Adams: k, e, cmax, d in SI or with units.",
    )
    newton = option(
        "--newton",
        type=_NewtonType(),
        metavar="SOLVER,KE,KD",
        help="Newton's solver, ke, kd: 'semi-implicit, 1e4, 20'.",
    )
    return lambda command: adams(newton(command))
