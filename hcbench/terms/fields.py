"""Types for the fields of files and options, quantities with units among them,
and one error for a wrong one.

class Entry(FileTable):
    timesteps: Steps
    alphas: Alphas | None = None

entry = validate(Entry, content, StudyError, "study.toml: {}")
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainValidator,
    StrictStr,
    ValidationError,
    create_model,
)
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError, core_schema

from hcbench.system.errors import QuantityError, UserError
from hcbench.system.files import read_text
from hcbench.system.text import sanitized
from hcbench.terms import units

T = TypeVar("T", bound="FileTable")


class FileTable(BaseModel):
    """A table of a file: a class with its keys as annotated fields.

    unknown: what an error says of a key that the table does not have.
    """

    # A process uses few of the tables, so each builds its checks at first use.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)
    unknown: ClassVar[tuple[str, str]] = ("unknown key", "one of")


class OptionTable(FileTable):
    """A table of a setting's options."""

    unknown: ClassVar[tuple[str, str]] = ("unknown", "one of")


class ResultTable(FileTable):
    """Keys that every JSON file of results has. Its other keys depend on the file."""

    model_config = ConfigDict(extra="allow")
    study: dict[str, Any]
    settings: list[dict[str, Any]]
    versions: dict[str, str]


def mistake(expected: str, got: str = "", advice: str = "") -> PydanticCustomError:
    """Make the error that a validator raises, which `validate` turns into one of hcbench.

    expected, got, advice: of that error; got: "" for the value as given.
    """
    return PydanticCustomError(
        "mistake", "{expected}", {"expected": expected, "got": got, "advice": advice}
    )


@dataclass(frozen=True, slots=True)
class InUnits:
    """Marks a field as a quantity: a number (SI) or text with a unit, read as SI.

    quantity: a name in `units.QUANTITIES`.
    several: whether the field is a list or range of them, read as a tuple without repeats.
    least, above: the lowest value that may be, and one that all must exceed, SI.
    """

    quantity: str
    several: bool = False
    least: float = -math.inf
    above: float = -math.inf

    @property
    def expected(self) -> str:
        """The words of an error for what was expected."""
        kind = units.QUANTITIES[self.quantity]
        what = "numbers" if self.several else "a number"
        if kind.unit:
            what += f" in {kind.unit}"
        return f"{what}, or text like {kind.example!r}"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def read(self, value: Any) -> float | tuple[float, ...]:
        """The quantity in SI, or with `several` a tuple of them.

        Raises Pydantic's error of `mistake`, which `validate` turns into a UserError, for anything
        that is not one.
        """
        try:
            if not self.several:
                return units.parse(value, self.quantity, least=self.least, above=self.above)
            values = units.parse_values(value, self.quantity, least=self.least, above=self.above)
            return tuple(dict.fromkeys(values.tolist()))
        except QuantityError as error:
            raise mistake(error.expected, error.got, error.advice) from None


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise mistake("a finite number")
    return float(value)


def _spin(value: Any) -> tuple[float, float, float]:
    try:
        return units.parse_spin(value)
    except QuantityError as error:
        raise mistake(error.expected, error.got, error.advice) from None


Spin = Annotated[tuple[float, float, float], PlainValidator(_spin)]
Text = Annotated[StrictStr, Field(min_length=1)]
Finite = Annotated[float, PlainValidator(_finite), Field(description="a finite number")]
Number = Annotated[float, InUnits("number")]
Length = Annotated[float, InUnits("length")]
Clearance = Annotated[float, InUnits("length", above=0.0)]
Clearances = Annotated[tuple[float, ...], InUnits("length", several=True, above=0.0)]
Mass = Annotated[float, InUnits("mass")]
Pressure = Annotated[float, InUnits("pressure")]
Acceleration = Annotated[float, InUnits("acceleration")]
Alpha = Annotated[float, InUnits("alpha", least=0.0)]
Alphas = Annotated[tuple[float, ...], InUnits("alpha", several=True, least=0.0)]
Speed = Annotated[float, InUnits("speed", above=0.0)]
Speeds = Annotated[tuple[float, ...], InUnits("speed", several=True, above=0.0)]
Friction = Annotated[float, InUnits("friction", least=0.0)]
Exponent = Annotated[float, InUnits("exponent")]
Angles = Annotated[tuple[float, ...], InUnits("angle", several=True, least=0.0)]
Step = Annotated[float, InUnits("timestep", above=0.0)]
Steps = Annotated[tuple[float, ...], InUnits("timestep", several=True, above=0.0)]


def read_toml(
    path: Path, error: type[UserError], slot: str, expected: str = "a TOML file"
) -> dict[str, Any]:
    """The content of a TOML file of at most 16 MiB.

    error: its type, raised for a missing file, one that cannot be read, and one that is not TOML.
    slot: what to call the file in it.
    expected: what the file should be, where it is missing.
    """
    # Imported here: it takes as long as most of what reads fields.
    import tomllib

    try:
        return tomllib.loads(read_text(path, most=16 << 20))
    except FileNotFoundError:
        raise error(slot, f"{path} does not exist", expected) from None
    except (OSError, UnicodeDecodeError) as caught:
        raise error(slot, f"{path}: {sanitized(caught)}", "a readable TOML file") from None
    except RecursionError:
        got = f"{path} is not TOML that can be read: brackets within brackets, too many"
        raise error(slot, got, "TOML", "Mend its brackets") from None
    except ValueError as caught:
        # A plain ValueError: a whole number of more digits than Python converts.
        raise error(
            slot, f"{path} is not TOML: {sanitized(caught)}", "TOML", "Mend that line"
        ) from None


def validate(
    table: type[T], content: Mapping[str, Any], error: type[UserError], slot: str = "{}"
) -> T:
    """The content of a file, or a part of it, as a table.

    error: its type, raised for the first key that is wrong, unknown or missing.
    slot: what it calls a key, with {} for the path to it, such as "run[0].speeds".
    """
    try:
        return table.model_validate(dict(content))
    except ValidationError as caught:
        first = _first(caught)
    # Where it is, the table there, and what that takes; the rest depends on Pydantic's kind of error.
    path, inner, expected = _place(table, first["loc"])
    got = f"{first['input']!r:.60}"
    advice = ""
    if first["type"] == "mistake":
        got = first["ctx"]["got"] or got
        expected = first["ctx"]["expected"]
        advice = first["ctx"]["advice"]
    elif first["type"] == "missing":
        got = "missing"
        expected = expected or "a value"
    elif first["type"] == "extra_forbidden":
        got, one_of = inner.unknown
        names = list(_fields(inner))
        # The message may be cut: the names that may be meant come first.
        meant = get_close_matches(str(first["loc"][-1]), names)
        expected = f"{one_of}: {', '.join(dict.fromkeys([*meant, *names]))}"
    expected = expected or first["msg"].removeprefix("Input should be ")
    raise error(slot.replace("{}", sanitized(path)), got, expected, advice)


def _first(caught: ValidationError) -> ErrorDetails:
    """The first error, or an unknown key where something is missing: it may be the one meant."""
    errors = caught.errors(include_url=False)
    if errors[0]["type"] == "missing":
        return next((each for each in errors if each["type"] == "extra_forbidden"), errors[0])
    return errors[0]


def _place(
    table: type[FileTable], location: Sequence[int | str]
) -> tuple[str, type[FileTable], str]:
    """(path, innermost table, what was expected there, "" if nothing says it) of what an error of
    Pydantic is about.

    table: the whole.
    location: keys and places in lists from it on, and Pydantic's own words for types, which are
    passed over.
    """
    path = ""
    expected = ""
    # The type that the path leads to.
    reached: Any = table
    for part in location:
        inner = _table_in(reached)
        if inner is None:
            if get_origin(reached) is dict:
                path = f"{path}.{part}"
                _, reached = get_args(reached)
            continue
        table = inner
        if isinstance(part, int):
            path = f"{path}[{part}]"
            expected = f"a table of {', '.join(_fields(inner))}"
            continue
        path = f"{path}.{part}"
        reached = None
        expected = ""
        field = _fields(inner).get(part)
        if field is not None:
            reached = field.annotation
            expected = _expected(field)
    return path.lstrip("."), table, expected


def _table_in(annotation: Any) -> type[FileTable] | None:
    if isinstance(annotation, type) and issubclass(annotation, FileTable):
        return annotation
    return next(filter(None, map(_table_in, get_args(annotation))), None)


def _fields(table: type[FileTable]) -> dict[str, FieldInfo]:
    """The fields by the names that a file has for them."""
    return {field.alias or name: field for name, field in table.model_fields.items()}


def _expected(field: FieldInfo) -> str:
    """The words for what a field of a file takes; "" where it declares none."""
    if field.description:
        return field.description
    for constraint in field.metadata:
        if isinstance(constraint, InUnits):
            return constraint.expected
    if Path in (field.annotation, *get_args(field.annotation)):
        return "the name of a file"
    return ""


def read_numbers(
    options: Mapping[str, Any],
    required: Sequence[str],
    optional: Sequence[str],
    error: type[UserError],
    slot: str,
) -> dict[str, float]:
    """Options that are all numbers, as floats; those that are not given are left out.

    options: by name.
    required, optional: names.
    error, slot: as of `validate`; raised for what is unknown, missing, or no finite number.
    """
    table = _numbers(tuple(required), tuple(optional))
    return validate(table, options, error, slot).model_dump(exclude_unset=True)


@cache
def _numbers(required: tuple[str, ...], optional: tuple[str, ...]) -> type[OptionTable]:
    fields: dict[str, Any] = dict.fromkeys(required, (Finite, ...)) | dict.fromkeys(
        optional, (Finite, 0.0)
    )
    return create_model("Numbers", __base__=OptionTable, **fields)
