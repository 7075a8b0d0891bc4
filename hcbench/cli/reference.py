"""hcbench reference: what the law says of an impact."""

from __future__ import annotations

import sys

import click

from hcbench._text import table
from hcbench.cli.console import as_json, print_json
from hcbench.errors import UserError

PAPER_STIFFNESS = "3.1e7 lbf/in^1.5"


@click.command()
@click.option(
    "--alpha", multiple=True, required=True, help="α of e = 1 - α v, such as '0.008 s/in'. Repeatable."
)
@click.option(
    "--speed",
    multiple=True,
    required=True,
    help="Impact speeds: '16 in/s', '4, 8 in/s', '1:20 in/s'. Repeatable.",
)
@click.option("--mass", default="1 lb", show_default=True, help="Effective mass.")
@click.option("--stiffness", help=f"k of F = k x^n; plain: N/m^n.  [default for n = 1.5: {PAPER_STIFFNESS}]")
@click.option("--exponent", default="1.5", show_default=True, help="n of F = k x^n, 1 or more.")
@as_json
def reference(
    alpha: tuple[str, ...],
    speed: tuple[str, ...],
    mass: str,
    stiffness: str | None,
    exponent: str,
    as_json: bool,
) -> None:
    """Say what the law says of an impact.

    Restitution, depth, force, duration, loss and stress.
    """
    import dataclasses

    import numpy as np

    from hcbench import units
    from hcbench.laws.force import HuntCrossley
    from hcbench.laws.summary import PAPER_RELATIVE_RADIUS, summarize

    alphas = np.concatenate([units.parse_values(a, "alpha", "--alpha") for a in alpha])
    speeds = np.concatenate([units.parse_values(v, "speed", "--speed") for v in speed])
    units.require_positive(speeds, "speed", "--speed")
    n = units.parse(exponent, "number", "--exponent")
    if stiffness is None and n >= 1 and n != 1.5:
        raise UserError("--stiffness", f"missing for exponent {n:g}", f"k in N/m^{n:g}")
    m = units.parse(mass, "mass", "--mass")
    k = units.parse(stiffness or PAPER_STIFFNESS, "stiffness", "--stiffness", 1.5 if stiffness is None else n)
    units.require_positive(m, "mass", "--mass")
    rows = [
        summarize(HuntCrossley(k, float(a), n), m, float(v), PAPER_RELATIVE_RADIUS)
        for a in alphas
        for v in speeds
    ]
    if as_json:
        print_json([dataclasses.asdict(row) for row in rows])
        return
    header = ("α s/m", "v_i m/s", "e of (16)", "1 - α v_i", "x_m m", "F_max N", "t s", "ΔE J", "τ_max Pa")
    values = [
        tuple("-" if v is None else f"{v:.6g}" for v in dataclasses.astuple(row)[: len(header)])
        for row in rows
    ]
    print("\n".join(table(header, values)))
    kinds: dict[str, list[str]] = {}
    for warning in dict.fromkeys(w for row in rows for w in row.warnings):
        kinds.setdefault(warning[:12], []).append(warning)
    for first, *others in kinds.values():
        more = f" (and {len(others)} more like it)" if others else ""
        print(f"warning: {first}{more}", file=sys.stderr)
