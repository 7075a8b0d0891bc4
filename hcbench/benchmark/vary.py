"""Rows of parameters to measure: the grid of some values, or rows drawn at random."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.system.errors import UserError
from hcbench.terms import units

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats

# The time step belongs to the model, not to a contact, but decides e with the parameters of one.
TIMESTEP = "timestep"
MOST_ROWS = 10_000_000
# Rows of a grid are numbered by NumPy.
_MOST_OF_GRID = np.iinfo(np.int64).max
_LOG = " log"
_EXAMPLE = "Write for example --vary friction=0.3:1:5"


@dataclass(frozen=True, slots=True)
class VariedParameter:
    """A parameter that a sweep varies.

    values: those that it takes, SI; of a band its lowest and its highest.
    is_band: whether every value between the two may be drawn.
    is_log: evenly by their logarithm.
    """

    name: str
    values: tuple[float, ...]
    is_band: bool = False
    is_log: bool = False

    def drawn(self, random: np.random.Generator, count: int) -> Floats:
        """Values drawn at random, shape (count,); from a generator of one seed a longer draw begins
        with the shorter one, so that a sweep can be continued.
        """
        if not self.is_band:
            return random.choice(self.values, count)
        low, high = self.values
        share = random.random(count)
        if self.is_log:
            return np.asarray(low * (high / low) ** share)
        return np.asarray(low + (high - low) * share)


def read_parameter(text: str) -> VariedParameter:
    """A parameter of "NAME=VALUES".

    VALUES: a list "0.3, 0.5"; a grid "LOW:HIGH:COUNT"; or a band "LOW:HIGH". " log" at the end of a
    grid or band spaces it evenly by logarithms. A unit goes after the numbers.

    Raises UserError for another form, QuantityError for values that cannot be read.
    """
    name, equals, values = (part.strip() for part in text.partition("="))
    if not (name and equals and values):
        raise UserError("vary", repr(text), "NAME=VALUES", _EXAMPLE)
    numbers_text = values.removesuffix(_LOG)
    is_log = numbers_text != values
    quantity = TIMESTEP if name == TIMESTEP else "number"
    numbers = units.parse_values(numbers_text, quantity, "vary")
    is_range = ":" in numbers_text and "," not in numbers_text
    is_band = is_range and numbers_text.count(":") == 1
    if is_log:
        low, high = numbers[[0, -1]].tolist()
        if not (is_range and low * high > 0):
            raise UserError("vary", repr(text), "a range on one side of 0 before `log`", _EXAMPLE)
        # By the ends: geomspace keeps them to the last bit.
        numbers = np.geomspace(low, high, len(numbers))
    if is_band:
        numbers = numbers[[0, -1]]
    if len(np.unique(numbers)) != len(numbers):
        raise UserError("vary", f"{text!r} has a value twice", "each value once")
    return VariedParameter(name, tuple(numbers.tolist()), is_band, is_log)


def read_parameters(texts: Sequence[str]) -> list[VariedParameter]:
    """The parameters of texts, each "NAME=VALUES"; UserError for none, and for one twice."""
    if not texts:
        raise UserError("vary", "none given", "a parameter with its values", _EXAMPLE)
    parameters = list(map(read_parameter, texts))
    names = [parameter.name for parameter in parameters]
    if len(set(names)) < len(names):
        raise UserError(
            "vary", f"{', '.join(names)}", "each parameter once", "Put them in one list"
        )
    return parameters


def rows_of(parameters: Sequence[VariedParameter], samples: int | None, seed: int) -> Floats:
    """Rows of values, shape (n, number of parameters), each row once.

    samples: rows drawn at random, at most; None: the whole grid, its last parameter fastest. A grid
    that has no more is taken whole.
    seed: of the draw; a longer draw of bands begins with the shorter one.

    Raises UserError for a grid with a band in it, for more than MOST_ROWS, and for a grid of 2^63
    rows or more, from which none are drawn.
    """
    bands = [parameter.name for parameter in parameters if parameter.is_band]
    if bands and samples is None:
        advice = f"Write {bands[0]}=LOW:HIGH:COUNT, or draw rows by --samples"
        raise UserError("vary", f"{bands[0]} from LOW to HIGH", "how many values", advice)
    shape = tuple(len(parameter.values) for parameter in parameters)
    of_grid = math.prod(shape)
    count = of_grid
    if samples is not None and (bands or samples < count):
        count = samples
    if not 1 <= count <= MOST_ROWS:
        raise UserError("samples", f"{count} rows", f"1 ... {MOST_ROWS}")
    if not bands and of_grid > _MOST_OF_GRID:
        got = f"a grid of {of_grid:.2g} rows"
        raise UserError("vary", got, "less than 2^63", "Draw from bands: NAME=LOW:HIGH")
    random = np.random.default_rng(seed)
    if bands:
        # A stream for each parameter, so that a longer draw begins with the shorter one.
        streams = random.spawn(len(parameters))
        columns = [p.drawn(stream, count) for p, stream in zip(parameters, streams, strict=True)]
        return np.stack(columns, axis=1)
    # Numbers of the rows in the whole grid.
    places = np.arange(count)
    if count < of_grid:
        places = np.sort(random.choice(of_grid, count, replace=False))
    indices = np.unravel_index(places, shape)
    chosen = zip(parameters, indices, strict=True)
    return np.stack([np.array(p.values)[index] for p, index in chosen], axis=1)


def read_shard(text: str) -> tuple[int, int]:
    """(number from 0, of how many) of text such as "3/20", whose number is from 1 on.

    Raises UserError for anything else.
    """
    number, _, of = text.partition("/")
    if number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of):
        return int(number) - 1, int(of)
    raise UserError("shard", repr(text), "NUMBER/OF, such as 3/20, from 1/20 to 20/20")
