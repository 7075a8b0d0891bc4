"""Types of the files of results and of scores, from which their schema and its page are written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, reduce
from operator import getitem
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

# pydantic takes TypedDict of typing from Python 3.12 on only.
from typing_extensions import TypedDict

from hcbench.system.errors import UserError

HELP = "docs/reference/cases.md has every field"
FILE = Path(__file__).with_name("hcbench-results-1.schema.json")
Obedience = Literal["obeyed", "soft", "threshold", "mixed", "ignored"]
Rebound = Literal["e v", "e (v + g h)"]
Word = Literal["pass", "fail", "unsupported", "error"]
CaseId = Annotated[str, Field(pattern=r"^C\d\d$")]


def _field(unit: str, meaning: str) -> Any:
    return Field(description=meaning, json_schema_extra={"unit": unit})


Nine = Annotated[list[float], Field(min_length=9, max_length=9)]


class RunResult(TypedDict, total=False):
    """Result of one run: exactly one of the three."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc]

    states: Annotated[
        list[Annotated[list[int | Nine], Field(min_length=2)]],
        _field(
            "step, then m, m/s, rad/s",
            "After each step that `record` asks for: its number, and of each body that moves its position, "
            "velocity and spin in the world's frame, 9 numbers",
        ),
    ]
    unsupported: Annotated[str, _field("", "Why the engine cannot do this run")]
    error: Annotated[str, _field("", "What went wrong in the engine")]


class About(TypedDict):
    """An engine in one version."""

    name: Annotated[str, _field("", "Name of the engine, with its solver where it has several")]
    version: Annotated[str, _field("", "Version of the engine")]
    combine: Annotated[
        Literal["product", "average", "maximum", "minimum", "geometric"] | None,
        _field("", "How the engine joins the restitutions of two bodies; null without a rule"),
    ]


class EngineResults(TypedDict):
    """Results of an engine in the cases: the file of `--out`, as a list, one item an engine."""

    format: Annotated[Literal[1], _field("", "Version of this format")]
    set: Annotated[str, _field("", "Name of the set of cases")]
    engine: Annotated[About, _field("", "The engine")]
    cpu_s: NotRequired[Annotated[float, _field("s", "CPU time of all runs")]]
    runs: Annotated[
        dict[CaseId, list[RunResult]],
        _field("", "By the id of a case, what became of its runs, in the order of the set"),
    ]


class CaseVerdict(TypedDict):
    """Verdict on a case."""

    case: Annotated[CaseId, _field("", "Id of the case, which never changes")]
    title: Annotated[str, _field("", "What the case asks of an engine")]
    verdict: Annotated[Word, _field("", "What the case came to")]
    why: Annotated[
        str, _field("", "The worst run of each quantity that fails, or why there is none")
    ]
    worst: Annotated[
        dict[str, tuple[float, float, int]],
        _field(
            "of the quantity: 1, drift and vibration m/s",
            "By quantity what was measured, the true value, and the number of the run that is farthest off",
        ),
    ]


class CasesScore(TypedDict):
    """Score of an engine: an item of `--json`."""

    engine: Annotated[str, _field("", "Name of the engine")]
    version: Annotated[str, _field("", "Version of the engine")]
    passed: Annotated[int, _field("cases", "How many cases passed")]
    restitution: Annotated[
        Obedience | None,
        _field(
            "",
            "Whether the engine does what restitution asks for; null where it has none",
        ),
    ]
    threshold: Annotated[
        float,
        _field("m/s", "Highest impact speed under gravity that did not bounce; 0 where all did"),
    ]
    gravity: Annotated[
        Rebound | None,
        _field(
            "",
            "Rebound of an impact under gravity, v at the start of the step; null where it is neither",
        ),
    ]
    cpu_s: Annotated[float, _field("s", "CPU time of all runs")]
    verdicts: Annotated[list[CaseVerdict], _field("", "A verdict on each case")]


_KINDS: dict[str, Any] = {"results": EngineResults, "scores": list[CasesScore]}


@cache
def _adapter(kind: str) -> TypeAdapter[Any]:
    return TypeAdapter(_KINDS[kind])


def validated(content: Any, kind: Literal["results", "scores"], source: str) -> Any:
    """The content of a file as it is, if it is of this kind.

    kind: "results" of one engine, or "scores" of several.
    source: the slot in an error.
    Raises UserError with the first wrong place.
    """
    try:
        return _adapter(kind).validate_python(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        # Keys and indices that lead to what is wrong; the first four tell the run.
        place = ".".join(map(str, first["loc"][:4])) or "all of it"
        # Within a state Pydantic's own words would be of unions: the state is shown instead.
        if "states" in first["loc"][:-1]:
            row = first["loc"].index("states") + 1
            state = reduce(getitem, first["loc"][: row + 1], content)
            got = f"{place}[{first['loc'][row]}] is {state!r:.80}"
            expected = "[step, 9 numbers of a body, ...], each 9 in a list of their own"
            raise UserError(source, got, expected, HELP) from None
        raise UserError(
            source, f"{place}: {first['msg']}", f"the {kind} of an engine", HELP
        ) from None


def schema() -> dict[str, Any]:
    """JSON Schema of a file of results, of one engine or a list of them, and of a list of scores."""
    return TypeAdapter(EngineResults | list[EngineResults] | list[CasesScore]).json_schema()


def fields() -> Iterator[tuple[str, str, str, str, str]]:
    """(object, field, type, unit, meaning) of each field, from the schema."""
    for name, about in schema()["$defs"].items():
        for field, each in about["properties"].items():
            yield name, field, type_name(each), each.get("unit", ""), each["description"]


def type_name(each: dict[str, Any], named: Callable[[str], str] = str) -> str:
    """The type of a field of a JSON Schema, in words such as "list of number"; "any" for a field that
    states none.

    each: the field's part of the schema.
    named: writes the name of a record that the field refers to.
    """
    if "anyOf" in each:
        return " or ".join(type_name(one, named) for one in each["anyOf"])
    if "enum" in each or "const" in each:
        return ", ".join(f"`{word}`" for word in each.get("enum", [each.get("const")]))
    if "$ref" in each:
        return named(str(each["$ref"]).rpartition("/")[2])
    if each.get("type") == "array" and "items" in each:
        return f"list of {type_name(each['items'], named)}".replace("of list", "of lists")
    return str(each.get("type", "any")).replace("array", "list")
