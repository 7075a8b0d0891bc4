"""hcbench engines: the engines, their versions and their settings."""

from __future__ import annotations

import click

from hcbench.cli.console import as_json, print_json


@click.command()
@as_json
def engines(as_json: bool) -> None:
    """List the engines and their settings.

    With their versions, and how to install a missing one.
    """
    from hcbench.errors import EngineMissing
    from hcbench.sim import registry

    listed = []
    for name in registry.names():
        engine = registry.engine(name)
        settings = {recipe.name: recipe.summary for recipe in registry.recipes(name).values()}
        try:
            version, install = engine.version(), ""
        except EngineMissing:
            version, install = "", engine.install
        listed.append({"name": name, "version": version, "install": install, "settings": settings})
        if not as_json:
            print(f"{name}  {version or f'not installed: {install}'}")
            width = max(map(len, settings), default=0)
            for setting, summary in settings.items():
                print(f"  {setting:<{width}}  {summary}")
    if as_json:
        print_json(listed)
