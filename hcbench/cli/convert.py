"""hcbench convert: the same contact in the parameters of other libraries."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import ALPHA, MASS, RESTITUTION, SPEED, TIME, as_json, options, print_json
from hcbench.cli.help import command
from hcbench.cli.terminal import show

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.laws.conventions import Conversion

# Options for a contact given by stiffness and damping, as Adams and Newton have it.


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


@command()
@click.option("--alpha", type=ALPHA, help="α of e = 1 - α v, such as '0.008 s/in'.")
@click.option("--drake", type=ALPHA, help="Drake's hunt_crossley_dissipation.")
@click.option("--simbody", type=ALPHA, help="Simbody's dissipation.")
@click.option("--restitution", type=RESTITUTION, help="e at --speed.")
@click.option("--solref", help="solref of a soft constraint, two numbers such as '-2.7e8 -815'.")
@spring_options()
@click.option("--mass", type=MASS, help="Effective mass, for --adams and --newton.")
@click.option(
    "--speed", type=SPEED, help="Impact speed to match, for engines with one e for all speeds."
)
@click.option(
    "--contact-time",
    type=TIME,
    help="Duration of the contact, for solref's spring, such as '0.2 ms'.",
)
@click.option("--timestep", type=TIME, help="Time step, for a solref that bounces in one step.")
@options("target")
@as_json
def convert(as_json: bool, **given: Any) -> None:
    """Convert a contact between libraries.

    Give α, an e at a speed, a parameter of Drake or Simbody, a solref, or a stiffness and
    damping of Adams or Newton. hcbench prints the same contact in the parameters of
    Chrono, LAMMPS and others, too.
    """
    from hcbench.sim.convert import convert

    contact = convert(**given)
    if as_json:
        print_json(contact.as_dict())
        return
    show("\n".join(_lines(contact)))


def _lines(contact: Conversion) -> Iterator[str]:
    """Lines of a conversion: α in s/m and s/in, the rows in columns, caveats."""
    from hcbench.terms import units

    yield f"α = {contact.alpha:.10g} s/m = {contact.alpha * units.INCH:.10g} s/in"
    if contact.speed is not None:
        truth = (
            f"e of the law {contact.restitution:.10g}, 1 - α v {contact.restitution_linear:.10g}"
        )
        yield f"at {contact.speed:.6g} m/s: {truth}"
    yield ""
    system = max(len(row.system) for row in contact.rows)
    parameter = max(len(row.parameter) for row in contact.rows)
    text = max(len(row.text) for row in contact.rows)
    for row in contact.rows:
        line = (
            f"{row.system:<{system}}  {row.parameter:<{parameter}}  {row.text:<{text}} {row.unit}"
        )
        yield line.rstrip()
        if row.note:
            yield f"    {row.note}"
    for missing in contact.missing:
        yield f"missing: {missing}"
    yield ""
    yield "caveats:"
    for caveat in contact.caveats:
        yield f"- {caveat}"
