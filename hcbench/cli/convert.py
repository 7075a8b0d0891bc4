"""hcbench convert: one contact in every library's words."""

from __future__ import annotations

from typing import Any

import click

from hcbench.cli.console import as_json, print_json
from hcbench.errors import UserError


@click.command()
@click.option("--alpha", help="α of e = 1 - α v, such as '0.008 s/in'.")
@click.option("--drake", help="Drake's hunt_crossley_dissipation.")
@click.option("--simbody", help="Simbody's dissipation.")
@click.option("--restitution", help="e at --speed.")
@click.option("--solref", help="MuJoCo's two numbers, such as '-2.7e8 -815'.")
@click.option("--speed", help="Where engines with one e for all speeds should match.")
@click.option("--contact-time", help="Duration of MuJoCo's spring contact, such as '0.2 ms'.")
@click.option("--timestep", help="Step of MuJoCo's one-step bounce.")
@click.option("--target", "reading", type=click.Choice(["law", "linear"]), default="law", show_default=True)
@as_json
def convert(as_json: bool, reading: Any, solref: str | None, **given: str | None) -> None:
    """Translate one contact between libraries.

    Between α, Drake, Simbody, MuJoCo, PyBullet, Chrono, LAMMPS and an e at a speed.
    """
    from hcbench import units
    from hcbench.laws.conventions import convert

    kinds = {"drake": "alpha", "simbody": "alpha", "restitution": "number", "contact_time": "timestep"}
    values: dict[str, Any] = {
        name: units.parse(text, kinds.get(name, name), "--" + name.replace("_", "-"))
        for name, text in given.items()
        if text is not None
    }
    if solref is not None:
        numbers = solref.replace(",", " ").split()
        if len(numbers) != 2:
            raise UserError("--solref", repr(solref), "two numbers such as '-2.7e8 -815'")
        values["solref"] = tuple(units.parse(number, "number", "--solref") for number in numbers)
    found = convert(**values, reading=reading)
    if as_json:
        print_json(found.as_dict())
        return
    print(f"α = {found.alpha:.10g} s/m = {found.alpha * units.INCH:.10g} s/in")
    if found.speed is not None:
        truth = f"e of (16) {found.restitution:.10g}, 1 - α v {found.restitution_linear:.10g}"
        print(f"at {found.speed:.6g} m/s: {truth}")
    print()
    wide = [max(len(getattr(row, name)) for row in found.rows) for name in ("system", "parameter", "text")]
    for row in found.rows:
        cells = zip((row.system, row.parameter, row.text), wide, strict=True)
        print("  ".join(cell.ljust(width) for cell, width in cells), f"{row.unit:<4} {row.note}".rstrip())
    for line in found.missing:
        print(f"missing: {line}")
    print("\ntraps:")
    for line in found.traps:
        print(f"- {line}")
