"""hcbench law: what the law says of an impact."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING

import click

from hcbench.cli.console import ALPHAS, EXPONENT, MASS, SPEEDS, as_json, print_json
from hcbench.cli.help import command
from hcbench.cli.terminal import show
from hcbench.system.text import table

if TYPE_CHECKING:
    from hcbench.terms.impact import Floats

_several = partial(click.option, multiple=True, required=True)


@command()
@_several("--alpha", type=ALPHAS, help="α of e = 1 - α v, such as '0.008 s/in'. Repeatable.")
@_several(
    "--speed", type=SPEEDS, help="Impact speeds: '16 in/s', '4, 8 in/s', '1:20 in/s'. Repeatable."
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

    from hcbench.laws.impact_law import PAPER_STIFFNESS, law

    speeds = np.concatenate(speed)
    rows = []
    for a in np.concatenate(alpha).tolist():
        of_alpha = law(a, mass=mass, stiffness=stiffness, exponent=exponent)
        rows += of_alpha.impacts(speeds)
    if as_json:
        print_json(list(map(dataclasses.asdict, rows)))
        return
    header = (
        "α s/m",
        "v_i m/s",
        "e of the law",
        "1 - α v_i",
        "x_m m",
        "F_max N",
        "t s",
        "ΔE J",
        "τ_max Pa",
    )
    values = []
    for row in rows:
        texts = []
        for number in dataclasses.astuple(row)[: len(header)]:
            if number is None:
                texts.append("-")
            else:
                texts.append(f"{number:.5g}")
        values.append(tuple(texts))
    show("\n".join(table(header, values)))
    if stiffness is None:
        print(
            f"x_m ... τ_max: of a steel ball, k = {PAPER_STIFFNESS} (--stiffness), {mass:.4g} kg (--mass)"
        )
    warnings: dict[str, None] = {}
    for row in rows:
        warnings |= dict.fromkeys(row.warnings)
    # Warnings that begin alike are of one kind: one of each is printed.
    kinds: dict[str, list[str]] = {}
    for warning in warnings:
        kinds.setdefault(warning[:12], []).append(warning)
    for first, *others in kinds.values():
        more = ""
        if others:
            more = f" (and {len(others)} more)"
        print(f"warning: {first}{more}", file=sys.stderr)
