"""Helps of commands: options in groups, examples that can be typed, where the documentation is; and
`hcbench docs`, which prints it.
"""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click

from hcbench.cli.console import show
from hcbench.system.errors import UserError
from hcbench.system.files import read_text
from hcbench.system.project import DOCUMENTATION, address
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
    "check": {"Drops": ("heights", "tilt", "controller")},
    "land": {"Drops": ("heights", "tilt", "controller")},
    "randomize": {"Worlds": ("restitution", "friction", "worlds", "seed")},
    "sweep": {"Of a MODEL": ("vary", "samples", "seed", "shard", "part-rows", "rest")},
}
# Options of many commands, which the help of hcbench itself explains.
_EVERYWHERE = ("--json", "--force", "--beyond-bounds", "--jobs", "--help")
# The command whose help explains the options of a group; others that have the same name them.
_EXPLAINED_BY = {
    "Model": "measure",
    "Launches": "measure",
    "Of a MODEL": "measure",
    "Drops": "land",
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
        """Read the words after the command's name, with old names of options replaced by today's,
        and a hint for each on stderr; return the words that are left.
        """
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
        """Write the options in groups, and the names of those that another help explains."""
        _write_options(ctx, formatter)


def _write_options(ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write the options of a command, a section for each group. Those that the help of another
    command explains have their names alone, in a section that names that command.
    """
    each = ctx.command
    groups = {**_OWN.get(each.name or "", {}), **_COMMON}
    titles = ["Target", *groups, "Options"]
    sections: dict[str, list[tuple[str, str]]] = {title: [] for title in titles}
    # Names of options that the help of another command explains, by that command.
    elsewhere: dict[str, list[str]] = {}
    for parameter in each.get_params(ctx):
        if not isinstance(parameter, click.Option):
            continue
        record = parameter.get_help_record(ctx)
        if record is None:
            continue
        title, explained_by = _place(ctx, parameter, groups)
        if explained_by is None:
            sections[title].append(record)
        else:
            elsewhere.setdefault(explained_by, []).append(_longest_flag(parameter))
    asked = ctx.meta.get(_WORDS, ())
    for title, records in sections.items():
        word = _ONLY_WITH.get(title)
        if records and (word is None or word in asked):
            with formatter.section(title):
                formatter.write_dl(records)
    for command in sorted(elsewhere, key=len, reverse=True):
        with formatter.section(f"As in `{command} --help`"):
            formatter.write_text(" ".join(elsewhere[command]))


def _place(
    ctx: click.Context, option: click.Option, groups: Mapping[str, Sequence[str]]
) -> tuple[str, str | None]:
    """Title of the group that an option is in, in the help of a command, and the command whose help
    explains the option in place of this one; None where this one does.

    ctx: of the command.
    groups: its flags by their titles.
    """
    if _longest_flag(option) in _EVERYWHERE:
        return "Options", "hcbench"
    flag = option.opts[0].lstrip("-")
    title = next((title for title, flags in groups.items() if flag in flags), "Options")
    root = ctx.find_root().command
    home = _EXPLAINED_BY.get(title)
    # --pair is what a user types first: its words stand in every help.
    if home is None or home == ctx.command.name or flag == "pair" or not isinstance(root, Group):
        return title, None
    there = root.commands[home].params
    same = any(isinstance(each, click.Option) and _is_same(each, option) for each in there)
    return title, f"hcbench {home}" if same else None


def _is_same(one: click.Option, other: click.Option) -> bool:
    """Say whether two commands have an option with the same flag and the same words."""
    return one.opts == other.opts and one.help == other.help


def _longest_flag(option: click.Option) -> str:
    """The flag of an option that a help names it by."""
    return max(option.opts, key=len)


class Group(click.Group):
    """A group of commands, with a help in the form of theirs."""

    command_class = Command

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in the order in which they were added."""
        return list(self.commands)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands and the options; of hcbench itself also options of many commands."""
        if ctx.parent is not None:
            self.format_commands(ctx, formatter)
            _write_options(ctx, formatter)
            return
        super().format_options(ctx, formatter)
        with formatter.section("Options of commands"):
            formatter.write_dl(_common_records(ctx, self))


def _common_records(ctx: click.Context, group: Group) -> list[tuple[str, str]]:
    """Rows of a help, (flags, words) each, on the options that many commands have; those that no
    command of the group has are left out.
    """
    records: dict[str, tuple[str, str]] = {}
    for command in group.commands.values():
        for option in command.params:
            if not isinstance(option, click.Option) or _longest_flag(option) not in _EVERYWHERE:
                continue
            record = option.get_help_record(ctx)
            if record is not None:
                records.setdefault(_longest_flag(option), record)
    return [records[flag] for flag in _EVERYWHERE if flag in records]


command = partial(click.command, cls=Command)


def group(**settings: Any) -> Callable[[Callable[..., Any]], Group]:
    """A group of commands with this help, as `click.group` makes one."""
    return click.group(cls=Group, **settings)


def described(each: Any) -> Any:
    """The command or group `each`, with its examples and the place of its documentation at the end
    of its help.

    Options of numbers get the words for what they take.
    Raises KeyError for a command without examples.
    """
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


# hcbench docs: the documentation of the installed version, as text.

_TITLE = re.compile(r"^# (.+)$", re.MULTILINE)
_HEADING = re.compile(r"^(#+) (.+)$", re.MULTILINE)
# A block of code, with its fences.
_CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
# A page that is another file of the repository.
_INCLUDED = re.compile(r"```\{include\} (\S+)\n.*?```\n", re.DOTALL)


@command()
@click.argument("page", required=False)
def docs(page: str | None) -> None:
    """List the pages of the documentation, or print one.

    PAGE is a name of the list, such as howto/tune, or a section of one: causes#gravity. Pages are
    Markdown.
    """
    pages = _pages()
    if page is not None:
        name, _, anchor = page.partition("#")
        text = _text(pages[_known(name, list(pages))])
        print(_section(text, anchor) if anchor else text, end="")
        return
    site = address("Documentation")
    if site:
        show(f"{site}\n")
    width = max(map(len, pages))
    for name, path in pages.items():
        title = _TITLE.search(_text(path))
        show(f"{name:<{width}}  {title[1] if title else ''}")
    show("\n`hcbench docs tutorial` prints one.")


def _pages() -> dict[str, Path]:
    """Files of the pages, by the names that a reader types: those of the top, then by folder."""
    folder = next(folder for folder in DOCUMENTATION if folder.is_dir())
    found = {}
    for path in folder.rglob("*.md"):
        name = path.relative_to(folder).with_suffix("").as_posix()
        if not name.startswith("_"):
            found[name] = path
    return dict(sorted(found.items(), key=lambda item: (item[0].count("/"), item[0])))


def _known(page: str, names: list[str]) -> str:
    """The name of a page that a reader means, with or without .md and its folder.

    Raises UserError for none or several.
    """
    wanted = page.removeprefix("docs/").removesuffix(".md").strip("/")
    same = [name for name in names if name == wanted or name.endswith(f"/{wanted}")]
    if wanted in names:
        return wanted
    if len(same) == 1:
        return same[0]
    near = same or difflib.get_close_matches(wanted, names, 3, 0.5)
    expected = f"one of: {', '.join(near)}" if near else "the name of a page"
    raise UserError("PAGE", repr(page), expected, "`hcbench docs` lists them")


def _section(text: str, anchor: str) -> str:
    """The part of a page, Markdown, from a heading to the next one that is not below it.

    text: of the page.
    anchor: of the heading, as in the page's address.
    Raises UserError where the page has none such.
    """
    headings = _headings(text)
    anchors = [re.sub(r"[^\w-]", "", h[2].lower().replace(" ", "-")) for h in headings]
    if anchor not in anchors:
        near = difflib.get_close_matches(anchor, anchors, 3, 0.5) or anchors[:3]
        raise UserError("PAGE", f"no section {anchor!r}", f"one of: {', '.join(near)}")
    start = headings[anchors.index(anchor)]
    level = len(start[1])
    ends = [h.start() for h in headings if h.start() > start.start() and len(h[1]) <= level]
    return f"{text[start.start() : min(ends, default=len(text))].strip()}\n"


def _headings(text: str) -> list[re.Match[str]]:
    """The headings of a page: their "#"s and their words; comments in blocks of code are none."""
    blocks = [block.span() for block in _CODE.finditer(text)]
    headings = []
    for heading in _HEADING.finditer(text):
        is_code = any(start < heading.start() < end for start, end in blocks)
        if not is_code:
            headings.append(heading)
    return headings


def _text(path: Path) -> str:
    """The text of a page, with that of the file that it stands for."""
    text = read_text(path)
    return _INCLUDED.sub(lambda found: read_text(path.parent / found[1]), text)
