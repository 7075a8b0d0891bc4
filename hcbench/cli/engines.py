"""hcbench engines and hcbench plugin: the engines, their settings, and the laws as plug-ins of theirs."""

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


@click.command()
@click.argument("engine")
@click.option("--install", is_flag=True, help="Put it where the engine loads its own plug-ins from.")
def plugin(engine: str, install: bool) -> None:
    """Print where the contact laws' plug-in is.

    The one for ENGINE: it is compiled against the installed engine when first asked for.
    """
    from hcbench.sim import registry

    print(registry.engine(engine).plugin(install=install))
