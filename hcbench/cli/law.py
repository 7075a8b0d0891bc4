"""hcbench law, convert and materials: what a law says, the parameters of a contact, and pairs of
materials whose restitution is published; without a model.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import (
    ALPHA,
    ALPHAS,
    EXPONENT,
    MASS,
    RESTITUTION,
    SPEED,
    SPEEDS,
    TIME,
    as_json,
    options,
    print_json,
    show,
)
from hcbench.cli.help import command
from hcbench.system.errors import UserError
from hcbench.system.text import table

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.catalogue.material import MaterialPair
    from hcbench.laws.conventions import Conversion
    from hcbench.laws.impact_law import ImpactSummary
    from hcbench.terms.impact import Floats


# hcbench law: what the law says of an impact.

# Fields of an impact in the table, and the title of their column.
_COLUMNS = {
    "alpha_s_per_m": "α s/m",
    "speed_m_per_s": "v_i m/s",
    "restitution": "e of the law",
    "restitution_linear": "1 - α v_i",
    "penetration_max_m": "x_m m",
    "force_max_n": "F_max N",
    "duration_s": "t s",
    "energy_loss_j": "ΔE J",
    "shear_stress_max_pa": "τ_max Pa",
}

_several = partial(click.option, multiple=True)


@command()
@options("material")
@_several("--alpha", type=ALPHAS, help="α of e = 1 - α v, such as '0.008 s/in'. Repeatable.")
@_several(
    "--speeds",
    "speed",
    required=True,
    type=SPEEDS,
    help="Impact speeds: '16 in/s', '4, 8 in/s', '1:20 in/s'. Repeatable.",
)
@click.option("--mass", type=MASS, default="1 lb", show_default=True, help="Effective mass.")
@click.option(
    "--stiffness",
    help="k of F = k x^n; a plain number is in N/m^n.  [default for n = 1.5: 3.1e7 lbf/in^1.5]",
)
@click.option(
    "--exponent", type=EXPONENT, default="1.5", show_default=True, help="n of F = k x^n, 1 or more."
)
@as_json
def law(
    material: str | None,
    alpha: tuple[Floats, ...],
    speed: tuple[Floats, ...],
    mass: float,
    stiffness: str | None,
    exponent: float,
    as_json: bool,
) -> None:
    """Compute an impact by the law.

    Print restitution, penetration, force, duration, energy loss and stress.
    """
    import dataclasses

    import numpy as np

    from hcbench.catalogue.target import target_material
    from hcbench.laws.impact_law import PAPER_STIFFNESS, law

    speeds = np.concatenate(speed)
    known = target_material(material, alpha=alpha or None)
    alphas = _alphas(known, alpha)
    if known is not None:
        known.warn_outside(float(speeds.min()), float(speeds.max()))
    rows = []
    for a in alphas:
        of_alpha = law(a, mass=mass, stiffness=stiffness, exponent=exponent)
        rows += of_alpha.impacts(speeds)
    if as_json:
        print_json(list(map(dataclasses.asdict, rows)))
        return
    cells = [tuple(_cell(getattr(row, name)) for name in _COLUMNS) for row in rows]
    if known is not None:
        show(f"{known.line}\n")
    show("\n".join(table(tuple(_COLUMNS.values()), cells)))
    if stiffness is None:
        print(
            f"x_m ... τ_max: of a steel ball, k = {PAPER_STIFFNESS} (--stiffness), {mass:.4g} kg (--mass)"
        )
    _warn(rows)


def _cell(number: float | None) -> str:
    return "-" if number is None else f"{number:.5g}"


def _alphas(known: MaterialPair | None, given: tuple[Floats, ...]) -> list[float]:
    """α, s/m: that of the material, or all that were given. Raises UserError for neither.

    known: the material that the user named, None without one.
    """
    import numpy as np

    if known is not None:
        return [known.alpha()]
    if not given:
        expected = "α of e = 1 - α v, such as '0.3 s/m', or --material"
        raise UserError("--alpha", "missing", expected)
    alphas: list[float] = np.concatenate(given).tolist()
    return alphas


def _warn(rows: Sequence[ImpactSummary]) -> None:
    """Print the warnings of impacts to stderr, of each kind one: those that differ only from their
    first digit on are of one kind.

    rows: the impacts. The number of others of a kind stands behind its first.
    """
    warnings: dict[str, None] = {}
    for row in rows:
        warnings |= dict.fromkeys(row.warnings)
    kinds: dict[str, list[str]] = {}
    for warning in warnings:
        before_number = re.split(r"\d", warning, maxsplit=1)[0]
        kinds.setdefault(before_number, []).append(warning)
    for first, *others in kinds.values():
        more = ""
        if others:
            more = f" (and {len(others)} more)"
        print(f"warning: {first}{more}", file=sys.stderr)


# hcbench convert: the same contact in the parameters of other libraries.

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
    """Give a command the options --adams and --newton: returns a decorator.

    option: makes an option, as `click.option` does.
    """
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
@options("material")
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

    Give a pair of materials, α, an e at a speed, a parameter of Drake or Simbody, a solref, or a
    stiffness and damping of Adams or Newton. hcbench prints the same contact in the parameters
    of Chrono, LAMMPS and others, too.
    """
    from hcbench.sim.convert import convert

    contact = convert(**given)
    if as_json:
        print_json(contact.as_dict())
        return
    if given["material"] is not None:
        from hcbench.catalogue.find import find

        show(find(given["material"]).line)
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


# hcbench materials: pairs of materials whose restitution is published, with their sources.


@command()
@click.argument("name", metavar="[NAME]", required=False)
@as_json
def materials(name: str | None, as_json: bool) -> None:
    """List pairs of materials with a published restitution.

    NAME is a pair, such as 'rubber on concrete', or a file material.json: print it in full,
    with its source. --json of one pair is such a file.
    """
    from hcbench.catalogue.find import as_record, as_text
    from hcbench.catalogue.find import materials as find_all

    found = find_all(name)
    if as_json and name is not None:
        # The first is the one that `--material` takes.
        print_json(as_record(found[0]))
    elif as_json:
        print_json([as_record(each) for each in found])
    elif name is not None:
        show(as_text(found))
    else:
        width = max(map(len, found.names))
        show("\n".join(f"{each.name:<{width}}  {each.numbers} {each.at}" for each in found))
        show(f"\n{len(found.names)} pairs; `hcbench materials 'steel on concrete'` shows one.")
        show("Robots' rubber feet have no published e: use `hcbench fit` or `hcbench land`.")
