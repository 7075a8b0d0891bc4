"""The error that `hcbench tune` promised for a pair, written into the model so
that `measure` recognizes it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from hcbench.laws.restitution import ConstantRestitution, Restitution, RestitutionCurve
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Impact

_NUMBER = r"([0-9.eE+-]+)"
_TEXT = re.compile(
    r"(?P<setting>\S+) by hcbench: (?P<rows>\d+) pairs?; "
    rf"(?P<goal>alpha|linear|restitution) (?P<value>{_NUMBER})(?: s/m)?; "
    rf"error (?P<error>{_NUMBER}); speeds (?P<low>{_NUMBER}) (?P<high>{_NUMBER}) m/s"
    rf"(?:; gravity (?P<gravity>{_NUMBER}) m/s2)?"
    rf"(?:; friction (?P<friction>{_NUMBER}))?"
    r"(?:; corners (?P<corners>\d+))?"
    r"(?:; option (?P<option>(?:\w+=[\w.+-]+ ?)+))?"
)
# Other launches find a little more than was promised: in shares of the promised error, and in e.
_KEPT = 1.25
_SLACK = 0.005
# Share by which gravity may differ, as 9.8 does from 9.81.
_SAME_GRAVITY = 0.02


@dataclass(frozen=True, slots=True)
class Promise:
    """Facts that a setting for a pair was found with, as its text states them.

    rows: <pair>s of the same two geoms; 0 for a plug-in.
    curve: the target.
    error: of e over `speeds`, m/s.
    gravity: into the plate, m/s²; NaN where an older text does not say it.
    friction: Coulomb's μ; NaN likewise.
    corners: points of contact at once for which it holds; 0 where any number will do.
    option: options of the whole model with which the error was found, as the engine's own files
    name and write them; for a plug-in the time step, up to which it holds.
    """

    setting: str
    rows: int
    curve: RestitutionCurve
    error: float
    speeds: tuple[float, float]
    option: tuple[tuple[str, str], ...] = ()
    gravity: float = math.nan
    friction: float = math.nan
    corners: int = 0

    @property
    def text(self) -> str:
        """The promise as a model keeps it; "" for a target that is neither one α nor one e."""
        if isinstance(self.curve, Restitution):
            name = "linear"
            if self.curve.reading == "law":
                name = "alpha"
            goal = f"{name} {self.curve.alpha:.6g} s/m"
        elif isinstance(self.curve, ConstantRestitution):
            goal = f"restitution {self.curve.restitution:.6g}"
        else:
            return ""
        low, high = self.speeds
        head = f"{self.setting.replace(' ', '-')} by hcbench: {self.rows} pair"
        if self.rows != 1:
            head += "s"
        text = f"{head}; {goal}; error {self.error:.3g}; speeds {low:.4g} {high:.4g} m/s"
        if not math.isnan(self.gravity):
            text += f"; gravity {self.gravity:.6g} m/s2"
        if not math.isnan(self.friction):
            text += f"; friction {self.friction:.6g}"
        if self.corners:
            text += f"; corners {self.corners}"
        if not self.option:
            return text
        option = " ".join(f"{name}={value}" for name, value in self.option)
        return f"{text}; option {option}"

    @classmethod
    def read(cls, text: str) -> Promise | None:
        """Read a promise from a text such as the property `text` gives; None for any other text, and
        for one of that form with numbers that no promise has, such as an e of 2.
        """
        match = _TEXT.fullmatch(text)
        if match is None:
            return None
        # A user may have edited the text in the model.
        with suppress(ValueError, SettingError):
            return cls._of(match)
        return None

    @classmethod
    def _of(cls, match: re.Match[str]) -> Promise:
        """The promise whose numbers a match of `_TEXT` has as text; NaN or 0 for those left out.

        Raises ValueError and SettingError for numbers without meaning.
        """
        value = float(match["value"])
        goal: RestitutionCurve
        if match["goal"] == "restitution":
            goal = ConstantRestitution(value)
        else:
            goal = Restitution(value, "law" if match["goal"] == "alpha" else "linear")
        option = []
        for assignment in (match["option"] or "").split():
            name, number = assignment.split("=")
            option.append((name, number))
        return cls(
            setting=match["setting"],
            rows=int(match["rows"]),
            curve=goal,
            error=float(match["error"]),
            speeds=(float(match["low"]), float(match["high"])),
            option=tuple(option),
            gravity=float(match["gravity"] or math.nan),
            friction=float(match["friction"] or math.nan),
            corners=int(match["corners"] or 0),
        )

    def is_other_gravity(self, gravity: float) -> bool:
        """Say whether a gravity, m/s², is another than the promised one; never where none was."""
        # NaN, which was not promised, is above nothing.
        return abs(gravity - self.gravity) > _SAME_GRAVITY * max(self.gravity, 1.0)

    def measured(self, impacts: Sequence[Impact]) -> float:
        """The largest |e - promised e| of impacts in the band of the promise, widened by 0.1 % at
        both ends for round-off; 0 where no impact with an e lies in it.
        """
        low, high = self.speeds
        largest = 0.0
        for impact in impacts:
            speed = impact.speed_in
            if impact.is_measured and 0.999 * low <= speed <= 1.001 * high:
                error = abs(impact.restitution - float(self.curve.at(speed)))
                largest = max(largest, error)
        return largest

    def is_kept(self, impacts: Sequence[Impact]) -> bool:
        """Say whether e is as close as promised, with a margin for rounding."""
        return self.measured(impacts) <= _KEPT * self.error + _SLACK

    def note(self, impacts: Sequence[Impact]) -> str:
        """One sentence: what was promised and what was measured, as text for people."""
        low, high = self.speeds
        count = {0: "The plug-in", 1: "One pair", 2: "Two pairs"}.get(
            self.rows, f"{self.rows} pairs"
        )
        numbers = f"promised {self.error:.2g}, measured {self.measured(impacts):.2g}"
        return f"{count} by hcbench for {self.curve.description}: {numbers} from {low:.3g} to {high:.3g} m/s."
