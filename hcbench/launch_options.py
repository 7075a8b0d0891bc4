"""Options that describe the launches of a pair, stated once.

`hcbench.measure` takes them as keywords. Derived from here are the options of the commands, the keys of
[tool.hcbench], and the options of the pytest marker and fixture; `measuring.request.make_request` reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import (
    Annotated,
    Any,
    NamedTuple,
    Protocol,
    TypedDict,
    get_args,
    get_type_hints,
    runtime_checkable,
)


class Option(NamedTuple):
    """Help of an option. flag: its name on the command line and in files; "" if that is the
    parameter's name.
    """

    help: str
    flag: str = ""
    default: Any = None


@runtime_checkable
class PintQuantity(Protocol):
    """Quantity of Pint, from any registry."""

    @property
    def magnitude(self) -> Any:
        """One number or an array."""

    @property
    def units(self) -> Any:
        """Unit of the magnitude."""


Quantity = float | str | PintQuantity  # SI, or with a unit
Quantities = float | str | PintQuantity | Iterable[float | str]  # also "1:20:8 in/s", and arrays
ModelSource = (
    str | Path | Sequence[str | Path] | object
)  # files, MJCF text, or an object that an engine opens
BodyPair = str | Sequence[str | int]  # "a,b" or two names, first the one that moves
Joints = str | Mapping[str, float | Iterable[float]]  # "hip=0.3, knee=-30 deg", or values by name
PoseState = str | Path | object  # a file of numbers by name, or an engine's own state
Folders = str | Mapping[str, str]  # "NAME=DIR", or folders by the name of a package
Controller = str | Callable[[Any, Any], Any]  # "pd", "ctrl", ..., or a function of model and state


class LaunchOptions(TypedDict, total=False):
    """Options of the launches of a pair: SI numbers, or text with units. None is the same as left
    out.
    """

    speeds: Annotated[Quantities | None, Option("Launch speeds, such as '1:20:8 in/s'.")]
    phases: Annotated[
        int | str | Iterable[float] | None,
        Option("Phases, the places in a time step where the contact starts: how many, or '0.1, 0.5'."),
    ]
    timestep: Annotated[Quantity | None, Option("Time step, in place of the model's own.")]
    gravity: Annotated[
        Quantities | None,
        Option("Gravity along -z, or a vector, in place of the model's own; 0 for none."),
    ]
    key: Annotated[str | None, Option("Keyframe to start from.")]
    move: Annotated[
        str | None,
        Option("What to launch: base: (the whole robot), body:NAME (from there on), or joint:NAME."),
    ]
    height: Annotated[Quantity | None, Option("Height over the touch to launch from.")]
    qpos: Annotated[
        Joints | None,
        Option("Joints to start from: 'hip=0.3, knee=-30 deg, base=0, 0, 0.3'."),
    ]
    state: Annotated[
        PoseState | None, Option("Pose to start from: a file (.npz, JSON); in Python an MjData, too.")
    ]
    package: Annotated[
        Folders | None,
        Option("Folder of a package that package:// names: 'NAME=DIR'; several with commas."),
    ]
    coming_from: Annotated[
        str | Iterable[float | str] | None,
        Option("Side that the first body approaches from: above, +x, or 0,1,1.", flag="from"),
    ]
    actuators: Annotated[bool | None, Option("Let actuators act, or turn them off.", default=True)]
    angle: Annotated[
        Quantities | None, Option("Launch obliquely, at this angle from the normal: '0, 45, 80 deg'.")
    ]
    along: Annotated[Quantities | None, Option("Direction of oblique launches: '0, 1, 0'.")]
    spin: Annotated[
        Quantities | None,
        Option("Spin, such as '40 rad/s' (above 0: rolls forward); or three: along, across, normal."),
    ]


_HINTS = get_type_hints(LaunchOptions, include_extras=True)
OPTIONS: dict[str, Option] = {
    name: option._replace(flag=option.flag or name)
    for name, hint in _HINTS.items()
    for option in [get_args(hint)[1]]
}
