"""A pair of materials: its restitution, the speeds that it holds for, and who measured it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, PlainValidator, StrictStr, model_validator

from hcbench.laws.restitution import (
    ConstantRestitution,
    MeasuredRestitution,
    Reading,
    Restitution,
    RestitutionCurve,
)
from hcbench.laws.solvers import rising
from hcbench.system.errors import UserError
from hcbench.terms.bounds import BOUNDS
from hcbench.terms.fields import FileTable, Text, mistake

KIND: Literal["hcbench material"] = "hcbench material"
# Who has read the number, by `Citation.level`.
LEVELS = {
    "P": "the document itself was read",
    "S": "another document quotes it",
    "R": "a rule allows this band",
    "own": "fitted to a recording of the user's own",
}
# Highest over lowest speed where the source states none but 0: the paper's 1 to 20 in/s.
_HIGHEST_OVER_LOWEST = 20.0
# Speeds at which a pair with one e over a band is measured.
_SPEEDS = 5


def _number(low: float, high: float, expected: str) -> PlainValidator:
    """A validator that reads a number of low ... high, and takes neither text nor true or false:
    for these it raises Pydantic's error of `mistake`.

    expected: the words of its error.
    """

    def read(value: Any) -> float:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if not is_number or not low <= value <= high:
            raise mistake(expected)
        return float(value)

    return PlainValidator(read, json_schema_input_type=float)


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise mistake("the lower number first")
    return ends


_Speed = Annotated[
    float, _number(0.0, BOUNDS["speed"][1], "a speed in m/s, 0 or more"), Field(description="m/s")
]
_E = Annotated[float, _number(0.0, 1.0, "an e of 0 ... 1"), Field(description="e, 0 ... 1")]
_Alpha = Annotated[
    float, _number(0.0, BOUNDS["alpha"][1], "α in s/m, 0 or more"), Field(description="s/m")
]
_SpeedRange = Annotated[tuple[_Speed, _Speed], AfterValidator(_rising)]
_AlphaRange = Annotated[tuple[_Alpha, _Alpha], AfterValidator(_rising)]
_ERange = Annotated[tuple[_E, _E], AfterValidator(_rising)]
_Line = Annotated[StrictStr, Field(max_length=1000)]


class Citation(FileTable):
    """Document that a number stands in."""

    document: Annotated[Text, Field(description="Authors, title, where it was published, year")]
    place: Annotated[Text, Field(description="Table, figure, section or file with the number")]
    read_at: Annotated[Text, Field(description="Where the number was read")]
    level: Annotated[
        Literal["P", "S", "R", "own"],
        Field(
            description="P: the document itself was read; S: another document quotes it; R: a rule's"
            " band; own: fitted to a recording of your own"
        ),
    ]


class TargetNumbers(NamedTuple):
    """A material as the options of a target: α, s/m; one e; or points (v m/s, e)."""

    alpha: float | None
    restitution: float | None
    points: tuple[tuple[float, float], ...]


class MaterialPair(FileTable):
    """One measurement of the restitution of a pair of materials.

    It has α, one e, or points of e over speed. Raises a validation error for none or several.
    """

    model_config = ConfigDict(populate_by_name=True)

    schema_: Annotated[Literal[1], Field(alias="schema", description="1")] = 1
    kind: Annotated[Literal["hcbench material"], Field(description="What the file is")] = KIND
    id: Annotated[
        StrictStr,
        Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$", description="Name of this measurement alone"),
    ]
    name: Annotated[Text, Field(description="The pair, such as 'rubber on concrete'")]
    bodies: Annotated[tuple[Text, Text], Field(description="What met what")]
    size: Annotated[_Line, Field(description="Size and mass of the first body")] = ""
    alpha_s_per_m: Annotated[_Alpha | None, Field(description="α of e = 1 - α v, s/m")] = None
    alpha_interval_s_per_m: Annotated[
        _AlphaRange | None, Field(description="Interval of α, s/m; see uncertainty")
    ] = None
    restitution: Annotated[_E | None, Field(description="One e for all speeds of the range")] = None
    restitution_interval: Annotated[
        _ERange | None, Field(description="Interval of e; see uncertainty")
    ] = None
    points: Annotated[
        tuple[tuple[_Speed, _E], ...], Field(description="Pairs of impact speed, m/s, and e")
    ] = ()
    speed_range_m_per_s: Annotated[
        _SpeedRange | None,
        Field(description="Lowest and highest impact speed, m/s; null: the source states none"),
    ]
    uncertainty: Annotated[_Line, Field(description="What the interval is, or the scatter")] = ""
    friction: Annotated[_Line, Field(description="Coefficient of friction, in words")] = ""
    measured: Annotated[Text, Field(description="How it was measured")]
    source: Annotated[Citation, Field(description="Where it stands")]
    note: Annotated[_Line, Field(description="What else to know")] = ""

    @model_validator(mode="after")
    def _require_one_form(self) -> Self:
        """Refuse a material with none or several of α, e and points, and speeds that contradict: by
        an error of Pydantic, which `validate` turns into a UserError.
        """
        forms = (self.alpha_s_per_m is not None, self.restitution is not None, bool(self.points))
        if sum(forms) != 1:
            raise mistake("exactly one of alpha_s_per_m, restitution and points")
        if self.speed_range_m_per_s is None:
            if self.restitution is None:
                raise mistake("speed_range_m_per_s, without which only one e can be given")
            return self
        speeds = [v for v, _ in self.points]
        if self.points and (len(set(speeds)) < len(speeds) or len(speeds) < 2):
            raise mistake("two points or more, each speed once")
        if self.points and (min(speeds), max(speeds)) != self.speed_range_m_per_s:
            raise mistake("speed_range_m_per_s from the slowest to the fastest point")
        return self

    @property
    def numbers(self) -> str:
        """The measured numbers in words: α in s/m, one e, or the first and last e of the points;
        with the interval where one is stated.
        """
        if self.alpha_s_per_m is not None:
            return f"α = {self.alpha_s_per_m:.4g} s/m{_interval(self.alpha_interval_s_per_m)}"
        if self.restitution is not None:
            return f"e = {self.restitution:.4g}{_interval(self.restitution_interval)}"
        values = [e for _, e in sorted(self.points)]
        return f"e = {values[0]:.4g} ... {values[-1]:.4g}, {len(values)} points"

    @property
    def at(self) -> str:
        """The speeds that the numbers hold for, as a phrase, such as "from 0.5 to 2 m/s"."""
        if self.speed_range_m_per_s is None:
            return "at an unstated speed"
        low, high = self.speed_range_m_per_s
        if low == high:
            return f"at {low:.4g} m/s"
        if low == 0.0:
            return f"up to {high:.4g} m/s"
        return f"from {low:.4g} to {high:.4g} m/s"

    @property
    def line(self) -> str:
        """Name, numbers, speeds and source, in one line."""
        source = f"{self.source.document}, {self.source.place}"
        return f"{self.name}: {self.numbers} {self.at} ({self.id}; {source})"

    @property
    def target(self) -> TargetNumbers:
        """The same as options; points do not rise, see `falling`."""
        return TargetNumbers(self.alpha_s_per_m, self.restitution, falling(self.points))

    def curve(self, reading: Reading = "law") -> RestitutionCurve:
        """e over the impact speed, to compare with.

        reading: how α gives e: "law", or "linear" for e = 1 - α v.
        Raises UserError for "linear" where the material has no α.
        """
        if self.alpha_s_per_m is not None:
            return Restitution(self.alpha_s_per_m, reading, of=self.line)
        if reading != "law":
            got = f"{reading!r} given for {self.name!r}, which has no α"
            raise UserError("target", got, "'law'")
        if self.restitution is not None:
            return ConstantRestitution(self.restitution, of=self.line)
        return MeasuredRestitution(self.target.points, of=self.line)

    @property
    def band(self) -> tuple[float, float] | None:
        """The range of speeds, m/s, above 0; None for one speed and where none is stated.

        A range from 0 begins at a 20th of its highest speed.
        """
        if self.speed_range_m_per_s is None:
            return None
        low, high = self.speed_range_m_per_s
        if low == high:
            return None
        return max(low, high / _HIGHEST_OVER_LOWEST), high

    @property
    def speeds(self) -> tuple[float, ...] | None:
        """Speeds, m/s, to measure a pair at that should bounce so: those of the points, or evenly
        over the band, or the only one; None where none is stated.
        """
        if self.speed_range_m_per_s is None:
            return None
        if self.points:
            return tuple(sorted(v for v, _ in self.points))
        if self.band is None:
            return (self.speed_range_m_per_s[0],)
        return tuple(np.linspace(*self.band, _SPEEDS).tolist())

    def alpha(self) -> float:
        """α, s/m. Raises UserError for a pair with one e or with points: neither gives an α."""
        if self.alpha_s_per_m is not None:
            return self.alpha_s_per_m
        got = f"{self.name!r} has {self.numbers} {self.at}, which gives no α"
        advice = "`tune`, `measure`, `check` and `convert` take e as it was measured"
        raise UserError("material", got, "a material with an α", advice)

    def warn_outside(self, low: float, high: float) -> None:
        """Warn where speeds of low ... high, m/s, are outside the range that was measured, or where
        none is stated.
        """
        if self.speed_range_m_per_s is not None:
            least, most = self.speed_range_m_per_s
            if least * (1 - 1e-9) <= low and high <= most * (1 + 1e-9):
                return
        here = f"{low:.3g} to {high:.3g} m/s"
        if math.isclose(low, high):
            here = f"{low:.3g} m/s"
        warnings.warn(
            f"{self.name} ({self.id}) was measured {self.at}; its e at {here} is a guess.",
            stacklevel=4,
        )


def _interval(ends: tuple[float, float] | None) -> str:
    """The ends of an interval in brackets; "" without one."""
    if ends is None:
        return ""
    return f" ({ends[0]:.4g} ... {ends[1]:.4g})"


def falling(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The e nearest to points (v m/s, e), by least squares, that does not rise with speed: the same
    speeds, rising, each with its new e.

    Measured e scatters; a target that rises by chance has no setting.
    """
    by_speed = sorted(points)
    # The nearest rising numbers to -e.
    negatives = rising(-e for _, e in by_speed)
    fallen = []
    for (speed, _), negative in zip(by_speed, negatives, strict=True):
        # Not -negative: an e of 0 would become -0.0.
        fallen.append((speed, 0.0 - negative))
    return tuple(fallen)
