"""Contacts of one model in many worlds: what an engine must offer so that they can be drawn."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hcbench.sim.model_under_test import ModelUnderTest, Output, Request, Texts
    from hcbench.sim.rest import Standing
    from hcbench.terms.impact import Floats

# Largest nominal e: one above it adds energy.
MOST_NOMINAL = 1.0


class ContactFamily(ABC):
    """Contacts of a model's pairs that differ in a nominal e and in friction alone.

    name: for the user. notes: sentences for the user.
    kinds: of each request's pair, the number of the first request whose pair is alike.
    slides: whether the pairs have friction.
    mobility: of each request's pair, how many times as easily the contact point moves along the
    plate as along its normal.
    """

    name: str
    notes: tuple[str, ...] = ()
    kinds: tuple[int, ...]
    slides: bool = True
    mobility: tuple[float, ...]

    @abstractmethod
    def parameters(self, nominal: Floats, friction: Floats | None) -> dict[str, Floats]:
        """The engine's own parameters of n worlds, each an array of n rows, by the engine's names.

        nominal: e that the contact would have on a free body, (n, pairs). friction: μ, (n,); None
        for the model's own.
        """

    @abstractmethod
    def open(self, request: Request) -> ModelUnderTest:
        """The model with such contacts, for the launches of a request."""

    @abstractmethod
    def set(self, model: ModelUnderTest, parameters: Mapping[str, Floats], world: int) -> None:
        """Give a model that `open` returned the parameters of one world."""

    @abstractmethod
    def standing(self, models: Sequence[ModelUnderTest]) -> Standing:
        """Measure how models that `open` returned, one a request, stand with what was set."""

    @abstractmethod
    def texts(self, output: Output) -> Texts:
        """The lines and the whole model to which the parameters belong."""

    def one(self, nominal: float, friction: float | None) -> dict[str, Floats]:
        """Parameters of one world whose pairs all have one nominal e and μ."""
        every = np.full((1, len(self.kinds)), nominal)
        return self.parameters(every, None if friction is None else np.array([friction]))
