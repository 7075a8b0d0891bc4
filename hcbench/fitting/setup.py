"""Setup of a measurement: masses, heights and other given values besides its data."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from hcbench.fitting.flight import (
    DIAMETER_OF_LIGHTEST,
    DRAG_COEFFICIENT,
    DRAG_COEFFICIENT_UNCERTAINTY,
    LIGHTEST,
    Ballistics,
    in_air,
)
from hcbench.fitting.which_law import dissipation_of, hunt_crossley
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.arguments import checked_fields
from hcbench.terms.bounds import require
from hcbench.terms.options import Quantity
from hcbench.terms.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from hcbench.terms.impact import Floats

# Over the Earth g is 9.764 ... 9.834 m/s²: as a standard deviation, (9.834 - 9.764)/(2 sqrt 3).
GRAVITY_UNCERTAINTY = 0.02
# Standard uncertainty of a drop height where none is given, m.
HEIGHT_UNCERTAINTY = 1e-3
# Bounds of every measured value, in SI: no measurement of a bounce lies outside.
_SMALLEST = 1e-9
_LARGEST = 1e9


@checked_fields
@dataclass(frozen=True, slots=True)
class Known:
    """A number and its standard uncertainty, SI."""

    value: float
    uncertainty: float = 0.0

    def __post_init__(self) -> None:
        require("value", self.value, math.isfinite(self.value), "a finite number")
        require("uncertainty", self.uncertainty, 0 <= self.uncertainty < math.inf, "0 or more")


@checked_fields
@dataclass(frozen=True, slots=True)
class MeasurementSetup:
    """The ball and the conditions of a measurement, SI.

    height: of the bottom of the ball above the plate where it was let go; None: unknown.

    mass, diameter: both or none, of the ball; with both, flights have drag, buoyancy and added
    mass.
    contact_time: of the first impact; the others last longer as v^(-1/5), as spheres do.
    timing: standard uncertainty of each time in s; None: to be found.
    speed, exponent: of the approach (m/s) and n of the law, for forces.
    """

    gravity: Known = Known(STANDARD_GRAVITY, GRAVITY_UNCERTAINTY)
    height: Known | None = None
    mass: Known | None = None
    diameter: Known | None = None
    drag_coefficient: Known = Known(DRAG_COEFFICIENT, DRAG_COEFFICIENT_UNCERTAINTY)
    contact_time: Known = Known(0.0)
    timing: float | None = None
    speed: Known | None = None
    exponent: float | None = None

    def __post_init__(self) -> None:
        """Raise UserError for a quantity out of its bounds, or a diameter without a mass.

        Also for a ball that is lighter than the air it displaces.
        """
        for slot in ("gravity", "height", "mass", "diameter", "drag_coefficient", "speed"):
            known = getattr(self, slot)
            if known is not None and not _SMALLEST <= known.value <= _LARGEST:
                expected = f"above 0: {_SMALLEST:g} ... {_LARGEST:g} in SI units"
                raise UserError(slot.replace("_", "-"), f"{known.value:g}", expected)
        if self.timing is not None:
            require("timing", self.timing, _SMALLEST <= self.timing <= _LARGEST, "seconds above 0")
        if self.exponent is not None:
            require("exponent", self.exponent, 1 <= self.exponent <= 10, "n within 1 ... 10")
        if self.contact_time.value < 0:
            raise UserError("contact-time", f"{self.contact_time.value:g} s", "0 s or more")
        if self.diameter is not None and self.mass is None:
            raise UserError("diameter", "given without --mass", "both, for the drag of the air")
        if self.has_air and not 0 < self.ballistics.drag < float("inf"):
            raise UserError(
                "mass", "lighter than the air that the ball displaces", "a heavier ball"
            )

    @property
    def drop(self) -> float | None:
        """The height where the ball was let go, m, if given."""
        if self.height is None:
            return None
        return self.height.value

    @property
    def least_touches(self) -> int:
        """The fewest touches that leave a fit something to check: a known drop saves one."""
        if self.height is None:
            return 4
        return 3

    @property
    def has_air(self) -> bool:
        """True if drag is computed: mass and diameter are given."""
        return self.mass is not None and self.diameter is not None

    @property
    def ballistics(self) -> Ballistics:
        """The flight of the ball."""
        if self.mass is None or self.diameter is None:
            return Ballistics(self.gravity.value)
        return in_air(
            self.gravity.value, self.mass.value, self.diameter.value, self.drag_coefficient.value
        )

    def perturbed(self) -> Iterator[tuple[str, float, MeasurementSetup]]:
        """Each uncertain input: its name, standard uncertainty, and the
        setup with it off by that much.

        Without mass and diameter the flight has no air, and its inputs do not count.
        """
        names = ["gravity", "contact_time"]
        if self.has_air:
            names += ["mass", "diameter", "drag_coefficient"]
        for name in names:
            known: Known = getattr(self, name)
            if known.uncertainty > 0:
                shifted = Known(known.value + known.uncertainty, known.uncertainty)
                yield name, known.uncertainty, replace(self, **{name: shifted})  # type: ignore[arg-type]


class SetupOptions(TypedDict, total=False):
    """Options for the setup of a measurement: SI numbers, or text with units and standard
    uncertainties.
    """

    height: Quantity | None
    gravity: Quantity | None
    mass: Quantity | None
    diameter: Quantity | None
    drag_coefficient: Quantity | None
    contact_time: Quantity | None
    timing: Quantity | None
    speed: Quantity | None
    exponent: Quantity | None


_QUANTITY = {
    "height": "length",
    "gravity": "acceleration",
    "mass": "mass",
    "diameter": "length",
    "drag_coefficient": "number",
    "contact_time": "timestep",
    "speed": "speed",
}


def read_setup(**given: Unpack[SetupOptions]) -> MeasurementSetup:
    """The setup of what a user writes.

    given: text with units, SI numbers, or (value, standard uncertainty), SI; None is left out.
    A height without an uncertainty gets HEIGHT_UNCERTAINTY.
    Raises QuantityError for text that is not such a quantity, UserError for values out of bounds, a
    diameter without a mass, and a g that is given as unknown.
    """
    known: dict[str, Any] = {}
    for name, value in given.items():
        if value is None:
            continue
        # These two have no uncertainty of their own.
        if name == "timing":
            known[name] = units.parse(value, "timestep", name)
            continue
        if name == "exponent":
            known[name] = units.parse(value, "exponent", name)
            continue
        if name == "gravity":
            _require_known(value)
        if isinstance(value, tuple) and len(value) == 2:
            number, uncertainty = value
        else:
            number, uncertainty = units.parse_uncertain(value, _QUANTITY[name], name)
        if name == "height" and not uncertainty:
            uncertainty = HEIGHT_UNCERTAINTY
        known[name] = Known(number, uncertainty or 0.0)
    return MeasurementSetup(**known)


def _require_known(gravity: object) -> None:
    """UserError where a text says that g is not known."""
    if isinstance(gravity, str) and gravity.strip().lower() in ("unknown", "?", "none", "free"):
        advice = "Flights give α g only: measure where g is known, or give pairs of speeds"
        raise UserError("gravity", f"{gravity!r}", "a number such as '9.81 m/s^2'", advice)


# Refuse touches that cannot be bounces of one ball: those of a clock, or of another drop than the
# given one.

# Largest e of a ball over several bounces: steel on steel reaches 0.99.
_MOST_E = 0.999
# A clock's intervals do not grow by more.
_GROWS = 1.02
# e at the first touch, by the drop height, over that of the law which gives the second touch's e.
_HEIGHT_E = (0.7, 1.05)


def require_a_ball(name: str, setup: MeasurementSetup, flights: Floats) -> None:
    """Raise UserError for flights that cannot be a ball's: they hardly shrink, or no ball that is
    dropped from the given height makes them.

    flights: s, of the first touch and those after it, up to the first that is not known whole.
    name: of the file.
    """
    if len(flights) < 2:
        return
    ratio = float(np.median(flights[1:] / flights[:-1]))
    # Intervals that grow are a gain of energy, which the fit tells.
    if _MOST_E < ratio < _GROWS:
        got = f"intervals that shrink by a factor of {ratio:.4f} each, {flights[0]:.4g} s"
        raise UserError(
            name, got, f"below {_MOST_E:g}, as of a ball", "A clock keeps its intervals"
        )
    if setup.height is not None:
        _require_height(setup, setup.height.value, float(flights[0]), float(flights[1]))


def _require_height(setup: MeasurementSetup, height: float, first: float, second: float) -> None:
    """Raise UserError for a drop height, m, that goes with no e of the first two flights, s.

    Where the ball is not given it may be as light as one of table tennis.
    """
    given = setup.ballistics
    ways = [given]
    if not setup.has_air:
        ways.append(in_air(given.gravity, LIGHTEST, DIAMETER_OF_LIGHTEST, DRAG_COEFFICIENT))
    if any(_goes_with(way, height, first, second) for way in ways):
        return
    e_first, e_second, _ = _first_es(given, height, first, second)
    rise, _ = given.apex(given.launch(first))
    got = f"{height:.4g} m, and a first flight of {first:.4g} s, {rise:.3g} m high"
    advice = f"That is e = {e_first:.3g} at the first touch, {e_second:.3g} at the second"
    if not setup.has_air:
        advice += ". Give --mass and --diameter if the ball is light"
    raise UserError("height", got, "the height of the drop before it", advice)


def _goes_with(way: Ballistics, height: float, first: float, second: float) -> bool:
    """Say whether a drop height (m) and the first two flights (s) go together under a flight's law.

    e falls with speed: of a soft ball that of the first touch may be a fifth of the second's.
    """
    e_first, e_second, faster = _first_es(way, height, first, second)
    d = dissipation_of(math.log(min(e_second, 1.0))) * faster
    of_law = math.exp(hunt_crossley(d)[0])
    return _HEIGHT_E[0] * of_law <= e_first <= _HEIGHT_E[1] * e_second


def _first_es(
    way: Ballistics, height: float, first: float, second: float
) -> tuple[float, float, float]:
    """e at the first and at the second touch, and the speed of the first over that of the second.

    height: of the drop, m.
    first, second: flights after the two touches, s.
    """
    speed, _ = way.dropped(height)
    launch = way.launch(first)
    speed_again, _ = way.touch(launch)
    return launch / speed, way.launch(second) / speed_again, speed / speed_again


def require_different(files: tuple[Path, ...]) -> None:
    """Raise UserError for a file that is given twice, or whose content is.

    files: paths. Pipes and files that cannot be read are passed over here.
    """
    from hcbench.system.files import is_file, read_bytes

    # A file alone need not be read here.
    if len(files) < 2:
        return
    seen: dict[bytes, Path] = {}
    for path in files:
        # A pipe can be read once, which the fit does.
        if not is_file(path):
            continue
        try:
            content = read_bytes(path)
        except OSError:
            # The function that reads the file for the fit reports what is wrong with it.
            continue
        if (other := seen.setdefault(content, path)) is not path:
            got = f"{path} has the same content as {other}"
            raise UserError(
                "files",
                got,
                "each file once",
                "Counting one file twice would understate the uncertainty",
            )
