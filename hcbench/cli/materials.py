"""hcbench materials: pairs of materials whose restitution is published, with their sources."""

from __future__ import annotations

import click

from hcbench.cli.console import as_json, print_json
from hcbench.cli.help import command
from hcbench.cli.terminal import show


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
