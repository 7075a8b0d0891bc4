"""Options of the verbs on a user's model, stated once.

`hcbench.measure` and `hcbench.check` take them as keywords. Derived from here are the options of
the commands, their groups in a command's help, the keys of [tool.hcbench], and the options of the
pytest marker and fixture. `measuring.request.make_request` reads those of launches,
`checking.spec.plan` the others.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Literal,
    NamedTuple,
    Protocol,
    TypedDict,
    get_args,
    get_type_hints,
    runtime_checkable,
)


class Option(NamedTuple):
    """Form of an option in commands and files.

    takes: the word for its value in a command's help.
    group: the title above it there.
    flag: its name on the command line and in files; "" for the parameter's name with dashes.
    choices: the only values, if any.
    """

    help: str
    takes: str = ""
    group: str = "Launches"
    flag: str = ""
    default: Any = None
    choices: tuple[str, ...] = ()


@runtime_checkable
class PintQuantity(Protocol):
    """Quantity of Pint, from any registry."""

    @property
    def magnitude(self) -> Any:
        """One number or an array."""

    @property
    def units(self) -> Any:
        """Unit of the magnitude."""


class AtLeast(NamedTuple):
    """Least value of a whole number, for `Annotated`."""

    least: int


# Number of worker processes.
Jobs = Annotated[int, AtLeast(1)]
# A number in SI, or text with a unit.
Quantity = float | str | PintQuantity
# Also a range such as "1:20:8 in/s", and arrays.
Quantities = float | str | PintQuantity | Iterable[float | str]
# One or more files, MJCF text, or an object that an engine opens.
ModelSource = str | Path | Sequence[str | Path] | object
# "a,b" or two names; the first body moves.
BodyPair = str | Sequence[str | int]
# "hip=0.3, knee=-30 deg", or values by the name of a joint.
Joints = str | Mapping[str, float | Iterable[float]]
# A file of numbers by name, or an engine's own state.
PoseState = str | Path | object
# "NAME=DIR", or folders by the name of a package.
Folders = str | Mapping[str, str]
# A pair of materials, "rubber on concrete"; a file material.json; or a `MaterialPair`.
MaterialName = str | Path | object
# "pd", "ctrl" and others, or a function of model and state.
Controller = str | Callable[[Any, Any], Any]


class LaunchOptions(TypedDict, total=False):
    """Options of the launches of a pair: SI numbers, or text with units. None is the same as left
    out.
    """

    speeds: Annotated[Quantities | None, Option("Launch speeds, such as '1:20:8 in/s'.", "SPEEDS")]
    phases: Annotated[
        int | str | Iterable[float] | None,
        Option(
            "Phases, the places in a time step where the contact starts: how many, or '0.1, 0.5'.",
            "PHASES",
        ),
    ]
    timestep: Annotated[Quantity | None, Option("Time step, in place of the model's own.", "TIME")]
    gravity: Annotated[
        Quantities | None,
        Option(
            "Gravity along -z, or a vector, in place of the model's own; 0 for none.", "QUANTITY"
        ),
    ]
    key: Annotated[str | None, Option("Keyframe to start from.", "NAME")]
    move: Annotated[
        str | None,
        Option(
            "What to launch: base: (the whole robot), body:NAME (from there on), or joint:NAME.",
            "PART",
        ),
    ]
    height: Annotated[Quantity | None, Option("Height over the touch to launch from.", "QUANTITY")]
    qpos: Annotated[
        Joints | None,
        Option("Joints to start from: 'hip=0.3, knee=-30 deg, base=0, 0, 0.3'.", "JOINTS"),
    ]
    state: Annotated[
        PoseState | None,
        Option("Pose to start from: a file (.npz, JSON); in Python an MjData, too.", "FILE"),
    ]
    package: Annotated[
        Folders | None,
        Option(
            "Folder of a package that package:// names: 'NAME=DIR'; several with commas.",
            "NAME=FOLDER",
            group="Model",
        ),
    ]
    coming_from: Annotated[
        str | Iterable[float | str] | None,
        Option(
            "Side that the first body approaches from: above, +x, or 0,1,1.", "SIDE", flag="from"
        ),
    ]
    actuators: Annotated[bool | None, Option("Let actuators act, or turn them off.", default=True)]
    angle: Annotated[
        Quantities | None,
        Option("Launch obliquely, at this angle from the normal: '0, 45, 80 deg'.", "ANGLES"),
    ]
    along: Annotated[
        Quantities | None, Option("Direction of oblique launches: '0, 1, 0'.", "VECTOR")
    ]
    spin: Annotated[
        Quantities | None,
        Option(
            "Spin, such as '40 rad/s' (above 0: rolls forward); or three: along, across, normal.",
            "SPIN",
        ),
    ]


class TargetOptions(TypedDict, total=False):
    """Options for what a model is compared with: at most one of material, alpha, restitution, points,
    baseline and require.
    """

    material: Annotated[
        MaterialName | None,
        Option(
            "Take e from a published measurement: 'rubber on concrete', or a file material.json."
            " `hcbench materials` lists them.",
            "NAME",
            group="Target",
        ),
    ]

    alpha: Annotated[
        Quantity | None, Option("Compare with the law of this α.", "QUANTITY", group="Target")
    ]
    target: Annotated[
        Literal["law", "linear"],
        Option(
            "Take α as the law's e(v), or as e = 1 - α v.",
            group="Target",
            default="law",
            choices=("law", "linear"),
        ),
    ]
    restitution: Annotated[Quantity | None, Option("Compare with one e.", "NUMBER", group="Target")]
    points: Annotated[
        str | Path | None,
        Option(
            "Compare with measured pairs (v, e): a CSV file with units in its header.",
            "FILE",
            group="Target",
        ),
    ]
    baseline: Annotated[
        str | Path | None,
        Option("Compare with a baseline that --write-baseline wrote.", "FILE", group="Target"),
    ]
    require: Annotated[
        str | None,
        Option(
            "Hold landings or a motion to limits: 'e < 0.3, peak < 6, slip < 5 mm'.",
            "LIMITS",
            group="Target",
        ),
    ]


class MotionOptions(TypedDict, total=False):
    """Options of landings, or of a recorded motion, that a check holds to `require`."""

    heights: Annotated[
        Quantities | None, Option("Heights to drop a robot from.  [default: 1:20:5 cm]", "HEIGHTS")
    ]
    tilt: Annotated[
        Quantities | None,
        Option("Tilts of its base about y, or '0, 5 deg about 0.6 0.8 0'.", "ANGLES"),
    ]
    controller: Annotated[
        str | None,
        Option(
            "Hold its pose by PD (default), by the pose's own controls, or by a function.",
            "pd|pd:KP,KD|ctrl|FILE.py:FUNCTION",
        ),
    ]
    trajectory: Annotated[
        str | Path | None,
        Option("Read where this recorded motion (qpos, qvel) met the floor.", "FILE"),
    ]


class LimitOptions(TypedDict, total=False):
    """Limits that a check holds a pair to."""

    max_error: Annotated[
        Quantity | None,
        Option(
            "Fail when e differs from the target by more than this.  [default: 0.02]",
            "NUMBER",
            group="Target",
        ),
    ]
    max_depth: Annotated[
        Quantity | None,
        Option(
            "Fail when the pair lies deeper at rest, such as '1 mm'.", "QUANTITY", group="Target"
        ),
    ]
    max_vibration: Annotated[
        Quantity | None,
        Option(
            "Fail when the pair shakes more at rest, such as '1e-4 m/s' (rms).",
            "QUANTITY",
            group="Target",
        ),
    ]


class SharedOptions(LaunchOptions, LimitOptions, total=False):
    """Options that the checks of a file may share."""

    engine: Annotated[
        str | None,
        Option(
            "Engine that simulates it.  [default: the first that opens it]", "NAME", group="Model"
        ),
    ]
    limit: Annotated[
        Quantity | None,
        Option("Give up on a model after this time, such as '60 s'.", "TIME", group="Model"),
    ]


class CheckOptions(TargetOptions, SharedOptions, MotionOptions, total=False):
    """Options of one check."""


def _options_of(declared: type) -> dict[str, Option]:
    """The options that a TypedDict declares by annotations `Annotated[type, Option]`, by name; the
    flag of each is its name, with dashes, unless the option states another.
    """
    options: dict[str, Option] = {}
    for name, hint in get_type_hints(declared, include_extras=True).items():
        _, option = get_args(hint)
        flag = option.flag or name.replace("_", "-")
        options[name] = option._replace(flag=flag)
    return options


OPTIONS = _options_of(CheckOptions)
# Old names of options of a check, which this version still takes with a hint.
RENAMED = {"pairs": "points"}


def renamed(old: str, new: str) -> str:
    """The hint at an old name. old, new: as the user writes them."""
    return f"{old} is now {new}; the next version no longer takes {old}"


def hint_at(old: str, new: str) -> None:
    """Warn of an old name, see `renamed`."""
    warnings.warn(renamed(old, new), FutureWarning, stacklevel=3)


LAUNCHES = tuple(_options_of(LaunchOptions))
LIMITS = tuple(_options_of(LimitOptions))
