"""Requests from what a user writes: text with units, lists, single numbers."""

from __future__ import annotations

import io
import math
import re
import runpy
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from hcbench.sim.model_under_test import Request, Vector
from hcbench.sim.packages import read_packages
from hcbench.system.errors import HcbenchError, QuantityError, UserError
from hcbench.system.files import parse_json, read_bytes, read_text, require_small_archive
from hcbench.system.text import sanitized, shown, split_names
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import BodyPair, LaunchOptions, Quantity

if TYPE_CHECKING:
    from hcbench.catalogue.material import MaterialPair

# Functions in a user's Python file, named as "file.py:function".

_PYTHON = re.compile(r"(?P<file>.+\.py):(?P<function>[A-Za-z_]\w*)")


def is_python(source: Any) -> bool:
    """Say whether a text names a function of a Python file."""
    return isinstance(source, str) and _PYTHON.fullmatch(source) is not None


def python_function(text: str) -> Callable[..., Any]:
    """The function that "file.py:function" names; its file is run.

    text: of that form, as `is_python` tells.
    Raises UserError where the file or the function is missing, and where the file does not run.
    """
    match = _PYTHON.fullmatch(text)
    assert match is not None
    path = Path(match["file"])
    name = match["function"]
    if not path.is_file():
        raise UserError("model", f"{path} is not there", "a Python file")
    with _user_code(f"{path}", "a file that runs"):
        names = runpy.run_path(str(path))
    if name not in names:
        raise UserError("model", f"{path} has no {name!r}", "the name of a function in it")
    function: Callable[..., Any] = names[name]
    return function


def call_python(text: str) -> Any:
    """Call the function of a Python file and return its result."""
    function = python_function(text)
    with _user_code(text, "a function without arguments that returns a model"):
        return function()


@contextmanager
def _user_code(where: str, expected: str) -> Iterator[None]:
    """Turn errors of a user's own code into UserError; hcbench's own and MemoryError pass.

    where: name of what runs, expected: what should have run, both for the message.
    """
    try:
        yield
    except (HcbenchError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        raise UserError("model", f"{where}: {type(error).__name__}: {error}", expected) from None


# Poses and directions as users write them: joints by name, state files, "above".

Pose = tuple[tuple[str, tuple[float, ...]], ...]

STATE_FIELDS = ("qpos", "ctrl", "act", "mocap_pos", "mocap_quat", "eq_active")
_ANGLES = {"deg": math.pi / 180.0, "°": math.pi / 180.0, "rad": 1.0}
_DIRECTIONS: dict[str, Vector] = {
    "above": (0.0, 0.0, 1.0),
    "below": (0.0, 0.0, -1.0),
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}


def read_joints(text: Any) -> Pose:
    """Joints, each with its values, of text such as "hip=0.3, knee=-30 deg, base=0, 0, 0.3", or of
    a mapping of names to numbers or text; () for None.

    Values are in rad or m, quaternions w x y z.
    Raises QuantityError for a part without a name or value, and for values that are not finite
    numbers.
    """
    if text is None:
        return ()
    if isinstance(text, Mapping):
        return tuple((str(name), _joint(name, values)) for name, values in text.items())
    pose: list[tuple[str, tuple[float, ...]]] = []
    for part in str(text).split(","):
        name, equals, values = map(str.strip, part.rpartition("="))
        # A further value of the joint before.
        if not equals and pose and values:
            last, before = pose[-1]
            pose[-1] = last, (*before, *_values(last, values))
            continue
        if not (name and equals and values):
            expected = "joints with their values: 'hip=0.3, knee=-30 deg, base=0, 0, 0.3'"
            raise QuantityError("qpos", repr(part.strip()), expected)
        pose.append((name, tuple(_values(name, values))))
    return tuple(pose)


def _joint(name: Any, values: Any) -> tuple[float, ...]:
    """Numbers of a joint, or of a field of a state such as qpos, from a mapping's value: text with
    units, or numbers in SI.

    name: of the joint or field.
    Raises QuantityError for anything else than finite numbers.
    """
    if isinstance(values, str):
        return tuple(_values(name, values))
    if name == "eq_active" and np.asarray(values).dtype == bool:
        # Engines keep this field as True and False, which `_numbers` refuses.
        values = np.asarray(values, dtype=float)
    return _numbers(name, values)


def _values(name: str, text: str) -> list[float]:
    """Numbers of a joint in text, rad or m: "-30 deg", "1 0 0 0", "2 cm".

    name: of the joint, for the error.
    Raises QuantityError for text that is not finite numbers, one unit behind them.
    """
    number, _, unit = text.rpartition(" ")
    if unit in _ANGLES:
        text = number
    try:
        numbers = _numbers(name, list(map(float, text.split())))
        return [_ANGLES.get(unit, 1.0) * x for x in numbers]
    except ValueError:
        # A single length with its unit, such as "2 cm".
        return [units.parse(text, "position", f"qpos: {name}")]


def _numbers(name: Any, values: Any) -> tuple[float, ...]:
    """One or more finite numbers as a flat tuple, from a number or an array of any shape.

    name: of the joint, for the error.
    Raises QuantityError for other values, and for an empty array.
    """
    try:
        numbers = tuple(units.real_array(values).reshape(-1).tolist())
    except (TypeError, ValueError):
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise QuantityError(
            "qpos", f"{name}: {str(values)[:60]!r}", "numbers, such as '0.3' or '-30 deg'"
        )
    return numbers


def read_state(state: Any) -> Pose:
    """A pose: (name, numbers) of each array of a state, such as a joint's or "qpos".

    state: path of an .npz file, or of JSON with names and numbers; or an engine's state in Python,
    such as an MjData, of which those fields count that are a pose; None for the empty pose.
    Raises UserError for anything else, QuantityError for numbers that are not finite.
    """
    if state is None:
        return ()
    if isinstance(state, str | Path):
        return read_joints(read_named(Path(state), "state", "a pose"))
    fields = {name: getattr(state, name) for name in STATE_FIELDS if hasattr(state, name)}
    if "qpos" not in fields:
        expected = "a .npz or JSON file with a pose, or a state that has qpos, such as an MjData"
        raise UserError("state", f"a {type(state).__name__}", expected)
    return read_joints({name: values for name, values in fields.items() if np.size(values)})


def read_named(file: Path, slot: str, what: str) -> Mapping[str, Any]:
    """The named arrays of an .npz file, or the object of a JSON file.

    slot, what: name of the option, and what the file should have, in errors.
    Raises UserError for a file that cannot be read, is damaged or has no names.
    """
    try:
        if file.suffix == ".npz":
            content: Any = _arrays(read_bytes(file))
        else:
            content = parse_json(read_text(file))
    except UnicodeDecodeError:
        got = f"{file} is neither .npz nor text"
        raise UserError(slot, got, f"a .npz or JSON file with {what}") from None
    except (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(slot, f"{file}: {error}", f"a .npz or JSON file with {what}") from None
    if not isinstance(content, Mapping) or not content:
        raise UserError(
            slot, f"{file} has no names in it", 'JSON like {"hip": 0.3}, or {"qpos": [...]}'
        )
    return content


def _arrays(content: bytes) -> dict[str, Any]:
    """The arrays of an .npz file; ValueError for one that is damaged, or unpacks to more than may be
    read.
    """
    try:
        require_small_archive(content)
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:
        # A damaged header raises anything that Python's tokenizer and zipfile raise.
        raise ValueError(f"is damaged: {error}") from None


def read_direction(text: Any) -> Vector:
    """Unit vector to the side from which the first body comes.

    text: a word such as "above" or "-x", or three numbers such as "0,1,1" of any length.
    Raises QuantityError for anything else and for three zeros.
    """
    if isinstance(text, str) and text.strip() in _DIRECTIONS:
        return _DIRECTIONS[text.strip()]
    parts = text.split(",") if isinstance(text, str) else list(text)
    try:
        x, y, z = map(float, parts)
        length = math.sqrt(x * x + y * y + z * z)
    except (TypeError, ValueError):
        length = 0.0
    if not (math.isfinite(length) and length > 0):
        raise QuantityError(
            "from", repr(text), f"one of {', '.join(_DIRECTIONS)}, or three numbers: 0,1,1"
        )
    return x / length, y / length, z / length


MAX_PHASES = 1000
LONGEST_LIMIT_S = 1e6
# Three numbers with blanks alone between them.
_THREE_NUMBERS = re.compile(r"\s*[-+\d.e]+\s+[-+\d.e]+\s+[-+\d.e]+.*")


@checked
def make_request(pair: BodyPair | None = None, **launch: Unpack[LaunchOptions]) -> Request:
    """Make the request of a measurement from what a user writes: numbers, or text with units.

    pair: "a,b" or ("a", "b"), first the one that moves; None where the model leaves no choice.
    launch: the pose, the launches and the world by name, such as speeds, height, angle, phases,
    qpos, state, timestep and gravity; `LaunchOptions` has them all. None stands for not given.

    Raises UserError for options that exclude each other, and QuantityError for numbers and units
    that cannot be read.
    """
    given: dict[str, Any] = {name: value for name, value in launch.items() if value is not None}
    if "along" in given and "angle" not in given and "spin" not in given:
        raise QuantityError(
            "along", f"{launch['along']!r}, and nothing oblique", "an angle or a spin too"
        )
    if "height" in given and "angle" in given:
        advice = "An angle holds at the first contact, a height at release; spin can be given with a height"
        raise UserError("angle", "given with height", "one of the two", advice)
    packages = read_packages(given.pop("package", {}))
    state = read_state(given.pop("state", None))
    joints = read_joints(given.pop("qpos", None))
    fields: dict[str, Any] = {}
    for name, value in given.items():
        read = _READ.get(name)
        fields[name] = value if read is None else read(value)
    return Request(
        pair=read_pair(pair),
        # Joints that are named replace those of the state.
        pose=(*state, *joints),
        packages=packages,
        adapt_phases="phases" not in given,
        **fields,
    )


def request_for(request: Request, speeds: object, known: MaterialPair | None) -> Request:
    """The request, at the speeds at which a material was measured if the user gave none.

    speeds: as the user gave them, or None.
    known: the material that the target is taken from; None for another target, which leaves the
    request as it is. Warns of launches outside the range of speeds for which the material is known.
    """
    if known is None:
        return request
    if speeds is None and known.speeds is not None:
        request = replace(request, speeds=known.speeds)
    known.warn_outside(min(request.speeds), max(request.speeds))
    return request


def _each_once(
    quantity: str, name: str, kind: str, **bounds: float
) -> Callable[[Any], tuple[float, ...]]:
    """Make a function that reads one or several quantities, text with units or numbers, as a tuple
    in SI; it raises QuantityError for equal ones and for those outside the bounds.

    quantity: such as "speed".
    bounds: `above` or `least`, SI.
    name: of the option.
    kind: "a speed" and the like, for the error.
    """

    def read(given: Any) -> tuple[float, ...]:
        values = tuple(units.parse_values(given, quantity, name, **bounds).tolist())
        if len(set(values)) != len(values):
            raise QuantityError(name, f"{given!r} has {kind} twice", f"each {kind.split()[1]} once")
        return values

    return read


def _direction(along: Any) -> Vector:
    values = units.parse_values(along, "number", "along").tolist()
    if len(values) != 3:
        raise QuantityError("along", f"{along!r}", "three numbers", "Write for example '0, 1, 0'")
    return values[0], values[1], values[2]


def read_pair(pair: BodyPair | None) -> tuple[str, str] | None:
    """Two names of "a,b" or a sequence of two; None for None. Raises UserError for anything else."""
    if pair is None:
        return None
    names = [_body_name(part) for part in _pair_parts(pair)]
    if len(names) != 2 or not all(names):
        raise UserError(
            "pair",
            repr(pair),
            "two names, first the one that moves",
            "Write for example --pair ball,plate",
        )
    return names[0], names[1]


def _pair_parts(pair: Any) -> list[Any]:
    """The parts of "a,b" or of a list; none of anything else."""
    if isinstance(pair, str):
        return list(split_names(pair))
    if isinstance(pair, list | tuple):
        return list(pair)
    return []


def _body_name(part: Any) -> str:
    """A name without blanks around it, as models' names are shown; a number is that of a body."""
    return f"body:{part}" if isinstance(part, int) else sanitized(str(part).strip())


def read_limit(limit: Quantity | None) -> float | None:
    """The time after which a model counts as hung, s; None for the default. Raises QuantityError."""
    if limit is None:
        return None
    seconds = units.parse(limit, "time", "limit")
    if not 0 < seconds <= LONGEST_LIMIT_S:
        raise QuantityError("limit", f"{seconds:g} s", f"above 0 s, up to {LONGEST_LIMIT_S:g} s")
    return seconds


def _move(move: str) -> str:
    """The joints that move the body: "base:", "body:NAME" or "joint:NAME"; "base" means the first.

    Raises UserError for anything else.
    """
    kind, _, name = move.partition(":")
    kind, name = kind.strip(), name.strip()
    is_whole_base = kind == "base" and not name
    is_named = kind in ("body", "joint") and bool(name)
    if not is_whole_base and not is_named:
        raise UserError("move", repr(move), "base:, body:NAME or joint:NAME")
    return f"{kind}:{name}"


def _height(height: Any) -> float:
    return units.parse(height, "length", "height", above=0)


def _phases(phases: int | str | Iterable[float]) -> tuple[float, ...]:
    """Phases, the shares of a step at which bodies touch: as given, or for a number n the middles
    of n equal parts of the step.

    phases: n, shares, or text of either.
    Raises QuantityError for n below 1 or above MAX_PHASES, and for shares that are alike or not
    within 0 <= share < 1.
    """
    if isinstance(phases, str):
        text = phases.strip()
        if text.isdecimal():
            phases = int(text)
        else:
            phases = units.parse_values(text, "number", "phases").tolist()
    if not isinstance(phases, Iterable):
        if not 1 <= phases <= MAX_PHASES:
            raise QuantityError("phases", str(phases), f"1 ... {MAX_PHASES}")
        return tuple((i + 0.5) / phases for i in range(phases))
    values = tuple(map(float, phases))
    are_inside = all(0 <= value < 1 for value in values)
    are_different = len(set(values)) == len(values)
    if not values or not are_inside or not are_different:
        raise QuantityError("phases", repr(phases), "different numbers from 0 up to below 1")
    return values


def _gravity(gravity: Any) -> Vector:
    """Vector of gravity, m/s², of three numbers, or of one along -z; text may have units.

    Raises QuantityError for a single one below 0, and for two, or more than three.
    """
    given = gravity
    gravity = units.without_pint(gravity, "acceleration", "gravity")
    if isinstance(gravity, str) and "," in gravity:
        gravity = gravity.split(",")
    if isinstance(gravity, str) and _THREE_NUMBERS.fullmatch(gravity):
        raise QuantityError("gravity", repr(gravity), "commas between the three: '0, 0, -9.81'")
    if isinstance(gravity, str) or not isinstance(gravity, Iterable):
        down = units.parse(gravity, "acceleration", "gravity")
        if not down >= 0:
            advice = "Give three for any other way: 0,0,1"
            raise QuantityError("gravity", f"{down:g} m/s^2", "0 or more, along -z", advice)
        # Adding 0.0 turns -0.0 into 0.0, which prints without a sign.
        return 0.0, 0.0, -down + 0.0
    values = [units.parse(part, "acceleration", "gravity") for part in gravity]
    if len(values) != 3:
        advice = "Write for example 0,0,-9.81"
        raise QuantityError("gravity", shown(given), "one number along -z, or three", advice)
    return values[0], values[1], values[2]


_READ: dict[str, Callable[[Any], Any]] = {
    "speeds": _each_once("speed", "speeds", "a speed", above=0),
    "phases": _phases,
    "timestep": lambda step: units.parse(step, "timestep", above=0),
    "gravity": _gravity,
    "height": _height,
    "coming_from": read_direction,
    "move": _move,
    "angle": _each_once("angle", "angle", "an angle", least=0),
    "along": _direction,
    "spin": units.parse_spin,
}
