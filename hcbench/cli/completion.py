"""hcbench completion: what a shell reads to complete commands, options and files."""

from __future__ import annotations

import click

from hcbench.cli.help import command

# A shell sets this variable to ask for completions.
VARIABLE = "_HCBENCH_COMPLETE"


@command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the completion script of a shell.

    Append it to ~/.bashrc or ~/.zshrc, or write it to ~/.config/fish/completions/hcbench.fish.
    """
    from click.shell_completion import get_completion_class

    made = get_completion_class(shell)
    assert made is not None
    print(made(click.get_current_context().find_root().command, {}, "hcbench", VARIABLE).source())
