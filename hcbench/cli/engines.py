"""hcbench engines and hcbench plugin: engines, where they are, their
settings, and the laws as plug-ins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from hcbench.cli.console import as_json, print_json, progress, show, status
from hcbench.cli.help import command, group
from hcbench.system.errors import OutputError, UserError

if TYPE_CHECKING:
    from hcbench.environments import Environment


_recipes = click.option(
    "--recipes", "-v", is_flag=True, help="Also list each engine's recipes and folder."
)


@group(invoke_without_command=True)
@_recipes
@as_json
@click.pass_context
def engines(context: click.Context, recipes: bool, as_json: bool) -> None:
    """List the engines, a line each; add or remove versions.

    The table has version, Python and size of each, and how to install a missing one.
    """
    if context.invoked_subcommand is None:
        _list(recipes, as_json)


@engines.command("list")
@_recipes
@as_json
def list_engines(recipes: bool, as_json: bool) -> None:
    """Same as plain `hcbench engines`."""
    _list(recipes, as_json)


@engines.command()
@click.argument("names", metavar="ENGINE[@VERSION]...", nargs=-1, required=True)
@click.option("--python", help="Python to use, a version or a path.  [default: that of hcbench]")
def add(names: tuple[str, ...], python: str | None) -> None:
    """Install engines, each in an environment of its own.

    Name an installed engine ENGINE@VERSION in studies, tune, measure and check.
    """
    from hcbench.sim import install

    for name in names:
        with progress(f"adding {name}") as tick:
            made = install.add(name, python, tick)
        print(f"{made.name}  {_about(made)}")


@engines.command()
@click.argument("names", metavar="ENGINE[@VERSION]...", nargs=-1, required=True)
def remove(names: tuple[str, ...]) -> None:
    """Remove engines that `add` installed."""
    from hcbench import environments

    for name in names:
        matching = [e for e in environments.installed() if name in (e.name, e.engine)]
        if len(matching) != 1:
            there = ", ".join(e.name for e in matching or environments.installed()) or "none"
            raise UserError(
                "engine", f"{name!r}", f"an engine in an environment of its own: {there}"
            )
        environments.remove(matching[0])
        print(f"removed: {matching[0].name}")


def _list(recipes: bool, as_json: bool) -> None:
    """Print the engines, those beside hcbench and those in environments of their own: a line each,
    or JSON.

    recipes: whether to print the recipes of each, too.
    """
    from hcbench import environments
    from hcbench.sim import registry

    listed = []
    with status("asking the engines for their versions"):
        for name in registry.names():
            settings = _settings(name) if recipes or as_json else {}
            beside = _record(name, {**_beside(name), "settings": settings})
            elsewhere = [_record(e.name, _elsewhere(e)) for e in environments.installed(name)]
            if elsewhere and not beside["version"]:
                # Another environment has a version: nothing needs to be installed.
                beside["install"] = ""
            listed += [beside, *elsewhere]
    if as_json:
        print_json(listed)
        return
    width = max(len(record["name"]) for record in listed)
    for record in listed:
        show(f"{record['name']:<{width}}  {_described(record, with_folder=recipes)}")
        wide = max(map(len, record["settings"]), default=0)
        for setting, summary in record["settings"].items():
            show(f"  {setting:<{wide}}  {summary}")
    if not recipes:
        print("\n`hcbench engines -v` lists the recipes of each")


def _record(name: str, about: dict[str, Any]) -> dict[str, Any]:
    """A row of the list of engines, by the keys of `--json`; keys that do not apply have empty
    values.

    name: of the engine.
    about: values of the keys that apply.
    """
    known: dict[str, Any]
    known = {
        "version": "",
        "install": "",
        "settings": {},
        "python": "",
        "size_bytes": None,
        "where": "",
    }
    return {"name": name, **known, **about}


def _settings(name: str) -> dict[str, str]:
    from hcbench.sim import registry

    return {recipe.name: recipe.summary for recipe in registry.recipes(name).values()}


def _beside(name: str) -> dict[str, Any]:
    """Facts of the engine of this Python, by the keys of `--json`: version, Python, size and place,
    or how to install it where it is not there.

    name: of the engine.
    """
    import platform

    from hcbench.sim import install, registry

    if version := registry.version_beside(name):
        files = install.files_of(name)
        return {
            "version": version,
            "python": platform.python_version(),
            "size_bytes": files.size,
            "where": files.folder,
        }
    backend = registry.adapter(name).backend
    return {
        "install": f"{install.add_commands([name])[0]}, or: {backend.command if backend else ''}"
    }


def _elsewhere(made: Environment) -> dict[str, Any]:
    """Facts of an engine in an environment of its own, by the keys of `--json`; its size in bytes."""
    return {
        "version": made.version,
        "python": made.python,
        "size_bytes": made.size,
        "where": str(made.folder),
    }


def _described(record: dict[str, Any], with_folder: bool) -> str:
    """An engine in words: its version, or how to install it.

    record: a row of the list, as `_record` makes it.
    with_folder: whether to name its folder, too.
    """
    if not record["version"]:
        install = record["install"]
        if not install:
            return "in environments of its own"
        if not with_folder:
            install = install.partition(", or")[0]
        return f"not installed: {install}"
    text = f"{record['version']}, Python {record['python']}"
    if record["size_bytes"]:
        text += f", {record['size_bytes'] / 1e6:.0f} MB"
    if record["where"] and with_folder:
        text += f" in {record['where']}"
    return text


def _about(made: Environment) -> str:
    return _described(_elsewhere(made), with_folder=True)


@command()
@click.argument("engine")
@click.option(
    "--install", is_flag=True, help="Install it in the folder from which the engine loads plug-ins."
)
def plugin(engine: str, install: bool) -> None:
    """Print the path of the plug-in with the contact laws.

    It is compiled for the installed ENGINE at the first call.
    """
    from hcbench.sim import registry
    from hcbench.sim.capabilities import plugin_of
    from hcbench.system.files import user_folder

    with status("compiling the plug-in"):
        path = plugin_of(registry.engine(engine), install)
    # A temporary folder stands in for a cache that cannot be used.
    if not install and path.parent.name.startswith("hcbench-"):
        got = f"{user_folder('cache')} cannot be written to, by you alone"
        advice = "Set $HCBENCH_CACHE"
        raise OutputError("cache", got, "a folder of your own", advice)
    print(path)
