"""Helps of commands: options in groups, examples that can be typed, and where the documentation is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import click

from hcbench.terms.options import OPTIONS, renamed


def _flags_of(group: str) -> list[str]:
    """The flags that `hcbench.terms.options` puts under a title."""
    return [option.flag for option in OPTIONS.values() if option.group == group]


# Flags of options by the title of their group, for all commands; those of no group come last.
_COMMON: dict[str, Sequence[str]] = {
    "Target": (
        *("points", "adams", "newton", "drake", "simbody", "solref", "match", "measure-only"),
        *_flags_of("Target"),
    ),
    "Model": ("python", *_flags_of("Model")),
    "Launches": ("pair", "all", *_flags_of("Launches")),
    "Output": (
        *("out", "json", "page", "markdown", "junit", "png", "force", "quick", "resume"),
        *("write-baseline", "write-scene", "write-model", "write-include", "write-points"),
        "write-material",
    ),
}
# Commands where a flag means something else, or needs a group of its own.
_OWN: dict[str, Mapping[str, Sequence[str]]] = {
    "fit": {
        "What to read": ("as", "touches", "from", "to", "against", "law"),
        "What you know": (
            *("height", "gravity", "mass", "diameter", "drag-coefficient", "contact-time"),
            *("timing", "speed", "exponent"),
        ),
        "A scene that bounces alike": ("engine", "timestep", "write-scene"),
    },
    "tune": {
        "Conditions": ("timestep", "speeds", "gravity"),
        "Of an ENGINE": (
            *(
                "plugin",
                "settings",
                "constant",
                "recipe",
                "integrator",
                "certify",
                "friction",
                "corners",
            ),
            *("scene", "mass", "stiffness", "exponent", "write-scene"),
        ),
        "Of a MODEL": (
            *("pair", "key", "qpos", "state", "from", "actuators", "strict", "for"),
            *("write-model", "write-include"),
        ),
    },
    "report": {
        "Study `reality`": ("sets", "data", "part", "identify"),
        "Your own toss": ("poses", "size", "mass", "model", "inertia"),
    },
    "land": {"Drops": ("heights", "tilt", "controller")},
    "randomize": {"Worlds": ("restitution", "friction", "worlds", "seed")},
    "sweep": {"Of a MODEL": ("vary", "samples", "seed", "shard", "part-rows", "rest")},
}
# Groups that a help shows only beside the word that they belong to: `hcbench report reality --help`.
_ONLY_WITH = {"Study `reality`": "reality", "Your own toss": "reality"}
_WORDS = "hcbench.cli.help.words"
# Old names of flags, by command, which this version still takes.
OLD_FLAGS = {
    "check": {"--pairs": "--points"},
    "law": {"--speed": "--speeds"},
}
# Values of an option of plain text, for options that only one command has.
_TAKES = {
    **dict.fromkeys(("gravity", "stiffness"), "QUANTITY"),
    **dict.fromkeys(("recipe", "integrator", "scene", "engine"), "NAME"),
    **{"pair": "PAIR", "points": "POINTS", "max-error": "NUMBER"},
    **{"as": "KIND", "touches": "RANGE", "for": "ENGINE@VERSION", "solref": "'A B'"},
    **{
        "sets": "NAMES",
        "size": "'X Y Z'",
        "inertia": "NUMBERS",
        "scheduler": "ADDRESS",
        "python": "VERSION",
    },
}
# Documentation page and examples of each command; a test parses the examples.
_EXAMPLES: dict[str, tuple[str, Sequence[str]]] = {
    "law": ("tutorial", ['--alpha "0.3 s/m" --speeds "0.1, 0.5, 1 m/s"']),
    "fit": ("howto/fit", ["drop.wav", 'heights.csv --height "30 +- 0.1 cm"']),
    "materials": ("reference/materials", ["", "'rubber on concrete'"]),
    "tune": (
        "howto/tune",
        [
            'mujoco --alpha "0.3 s/m" --timestep "2 ms"',
            'mujoco --alpha "0.3 s/m" --timestep "2 ms" --plugin',
            "my.xml --pair foot,floor --alpha 0.3 --write-model tuned.xml",
        ],
    ),
    "randomize": (
        "howto/randomize",
        ["my.xml --pair foot,floor --restitution 0.3:0.6 --friction 0.5:1 --out p.npz"],
    ),
    "pairs": ("howto/measure", ["my.xml"]),
    "measure": (
        "howto/measure",
        ["my.xml --pair ball,plate", 'my.xml --pair foot,floor --alpha "0.3 s/m" --page foot.html'],
    ),
    "land": ("howto/land", ['robot.xml --heights "5, 10, 20 cm"']),
    "check": (
        "howto/check",
        [
            'my.xml --pair ball,plate --alpha "0.3 s/m" --max-error 0.05',
            "pyproject.toml --junit out.xml",
        ],
    ),
    "convert": ("howto/tune", ['--alpha "0.3 s/m" --speed "0.5 m/s"', '--drake "0.45 s/m"']),
    "report": ("reference/report", ["--quick", "my/study.toml --out my/report --jobs 2", "field"]),
    "sweep": (
        "howto/sweeps",
        [
            "my/study.toml --out my/sweep --jobs 2",
            "my.xml --pair foot,floor --vary friction=0.3:1:5 --out my/runs",
        ],
    ),
    "paper": ("explanation/paper", ["--quick"]),
    "cases": ("howto/cases", ["run mujoco pybullet", "score results.json"]),
    "engines": ("howto/versions", ["-v", "add mujoco@3.3.0"]),
    "plugin": ("howto/plugin-mujoco", ["mujoco", "mujoco --install"]),
    "docs": ("index", ["", "howto/tune"]),
    "completion": ("reference/commands", ["bash >> ~/.bashrc"]),
}


START = """\b
Examples:
  hcbench measure my.xml --pair ball,floor
  hcbench tune mujoco --alpha "0.3 s/m" --timestep "2 ms"
  hcbench fit drop.wav

Documentation: hcbench docs
"""


def examples(name: str) -> list[str]:
    """The examples of a command, as they are typed."""
    return [f"hcbench {name} {words}".rstrip() for words in _EXAMPLES[name][1]]


class Command(click.Command):
    """A command whose help has its options in groups."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments; an old name of an option is taken with a hint."""
        old_names = OLD_FLAGS.get(self.name or "", {})
        named = []
        for word in args:
            flag, equals, value = word.partition("=")
            new = old_names.get(flag)
            if new is not None:
                print(f"hcbench: {renamed(flag, new)}", file=sys.stderr)
            named.append(f"{new or flag}{equals}{value}")
        ctx.meta[_WORDS] = tuple(named)
        return super().parse_args(ctx, named)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, a section a group."""
        groups = {**_OWN.get(self.name or "", {}), **_COMMON}
        titles = ["Target", *groups, "Options"]
        sections: dict[str, list[tuple[str, str]]] = {title: [] for title in titles}
        for parameter in self.get_params(ctx):
            if not isinstance(parameter, click.Option):
                continue
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            flag = parameter.opts[0].lstrip("-")
            title = next((title for title, flags in groups.items() if flag in flags), "Options")
            sections[title].append(record)
        asked = ctx.meta.get(_WORDS, ())
        for title, records in sections.items():
            word = _ONLY_WITH.get(title)
            if records and (word is None or word in asked):
                with formatter.section(title):
                    formatter.write_dl(records)


class Group(click.Group):
    """A group of such commands."""

    command_class = Command

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in the order in which they were added."""
        return list(self.commands)


command = partial(click.command, cls=Command)


def group(**settings: Any) -> Callable[[Callable[..., Any]], Group]:
    """A group of commands with this help, as `click.group` makes one."""
    return click.group(cls=Group, **settings)


def described(each: Any) -> Any:
    """The command, with its examples and the place of its documentation at the end of its help."""
    parameters = list(each.params)
    for command in getattr(each, "commands", {}).values():
        parameters += command.params
    for parameter in parameters:
        if parameter.type is click.STRING or isinstance(parameter.type, click.types.FloatParamType):
            parameter.metavar = parameter.metavar or _TAKES.get(parameter.opts[0].lstrip("-"))
    page = _EXAMPLES[each.name][0]
    lines = "\n".join(f"  {line}" for line in examples(each.name))
    each.epilog = f"\b\nExamples:\n{lines}\n\nDocumentation: hcbench docs {page}"
    return each


# hcbench completion: what a shell reads to complete commands, options and files.

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
