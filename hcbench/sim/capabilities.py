"""Optional capabilities of an engine, a small base class each: `isinstance` asks for it.

An engine that has several of them inherits them all, beside `SteppedEngine`. `ContactFamily` is
what one returns that can give a model other contacts in each of many worlds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.sim.engine import Engine
from hcbench.sim.rest import UNKNOWN, Standing
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from hcbench.laws.conventions import OneContact, Vocabulary
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.landing import DropPlan, DropTest, Landings, ReboundSettings
    from hcbench.sim.model_under_test import (
        CandidatePair,
        ModelSetting,
        ModelUnderTest,
        Output,
        Request,
        Texts,
    )
    from hcbench.sim.rest import LandingPeak
    from hcbench.sim.touch import TrajectoryTouchdowns
    from hcbench.terms.impact import Floats


# Mobility along the plate over that along the normal, below which joints keep a pair from sliding.
LEAST_MOBILITY = 1e-6
# Largest nominal e: one above it adds energy.
MOST_NOMINAL = 1.0


class ContactFamily(ABC):
    """Contacts of a model's pairs that differ in a nominal e and in friction alone.

    name: for the user.
    notes: sentences for the user.
    slides: whether the pairs have friction.
    mobility: of each request's pair, how many times as easily the contact point moves along the
    plate as along its normal.
    """

    name: str
    notes: tuple[str, ...] = ()
    slides: bool = True
    mobility: tuple[float, ...]

    @abstractmethod
    def parameters(self, nominal: Floats, friction: Floats | None) -> dict[str, Floats]:
        """The engine's own parameters of n worlds, each an array of n rows, by the engine's names.

        nominal: e that the contact would have on a free body, (n, pairs).
        friction: μ, (n,); None for the model's own.
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
        every = np.full((1, len(self.mobility)), nominal)
        return self.parameters(every, None if friction is None else np.array([friction]))


@dataclass(frozen=True, slots=True)
class Feature:
    """One property of an engine, with its source: a page, a source file, or how it was measured."""

    text: str
    source: str


@dataclass(frozen=True, slots=True)
class Features:
    """Properties of an engine's own contact, with nothing added, for the
    table of `hcbench report field`.

    law: its force or impulse.
    exponent: of the penetration in it.
    threshold: the speed below which it does not bounce, and what sets that.
    licence: of the package.
    energy: what to know of an e above 1.
    """

    law: Feature
    exponent: Feature
    threshold: Feature
    licence: Feature
    energy: Feature | None = None


class DescribesContact(Engine):
    """An engine that describes its own contact.

    features: None for those of the engine whose models it steps.
    """

    features: Features | None = None

    @abstractmethod
    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """Return the numbers and options that describe a contact in this
        engine, for `hcbench convert`.
        """


class HasPlugin(Engine):
    """An engine that takes the contact laws as a plug-in."""

    @abstractmethod
    def plugin(self, *, install: bool = False) -> Path:
        """The library of the contact laws for this engine, compiled when first asked for.

        install: puts it where the engine loads plug-ins from; UserError
        where it has no such folder.
        """


def plugin_of(engine: Engine, install: bool) -> Path:
    """The plug-in of an engine; UserError where there is none."""
    if not isinstance(engine, HasPlugin):
        raise UserError(
            f"engine {engine.name!r}", "no plug-in", "an engine for which hcbench has one"
        )
    return engine.plugin(install=install)


class OpensModels(Engine):
    """An engine that opens models that users wrote.

    suffixes: of their files.
    opens: objects that it opens, in words.
    """

    suffixes: tuple[str, ...] = ()
    opens: tuple[str, ...] = ()

    def accepts(self, source: Any) -> bool:
        """Say whether `open` takes `source` (a path, several paths or an
        object) if the user names no engine.
        """
        return isinstance(source, str | Path) and Path(source).suffix.lower() in self.suffixes

    def make_room(self) -> None:
        """Release what this process keeps for the engine, before a user's script runs in it."""

    @abstractmethod
    def open(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> ModelUnderTest:
        """Open a user's own model with the request's pair at touch; the caller closes it.

        source: a path, several paths, text or an object that the engine's `accepts` takes.
        request: the pair, its pose, and the conditions of the launches.
        rebuild: makes `source` again, where a function of the user's made it; else None.

        Raises UserError with the reason where the pair cannot be measured, EngineMissing where the
        engine is not installed.
        """

    @abstractmethod
    def pairs(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> list[CandidatePair]:
        """Return the pairs that can collide in a user's model, those that touch
        first; `source` as in `open`.
        """

    def landing_peaks(self, source: Any, request: Request) -> tuple[LandingPeak, ...]:
        """Drop the whole body of a pair from each of a few heights, and return the peaks of the
        force; () where it cannot fall, or where the engine does not drop bodies.
        """
        return ()


def opener(engine: Engine) -> OpensModels:
    """The engine, which opens models; UserError where it does not."""
    if not isinstance(engine, OpensModels):
        raise UserError("engine", repr(engine.name), "an engine that opens models of users")
    return engine


class RandomizesContacts(OpensModels):
    """Gives a user's model contacts that differ from world to world."""

    @abstractmethod
    def contact_families(
        self,
        source: Any,
        requests: Sequence[Request],
        rebuild: Callable[[], Any] | None = None,
    ) -> Iterable[ContactFamily]:
        """Families of contacts that pairs of a user's own model can have in many worlds; first those
        whose e depends least on where in a step a contact starts.

        source: a path, several paths, text or an object.
        rebuild: makes `source` again, or None.
        requests: one a pair.
        """


class VariedContact(ABC):
    """A user's model whose pair can have other contact parameters.

    parameters: their names, the engine's own.
    """

    parameters: tuple[str, ...]

    @abstractmethod
    def open(self, request: Request, values: Mapping[str, float]) -> ModelUnderTest:
        """The model with some parameters of the pair's contact changed, for the launches of a
        request.

        values: by names of `parameters`. Each call opens a copy, so that what it measures depends
        on its arguments alone.
        Raises UserError, with QuantityError among its kinds, for values that no contact has.
        """


class VariesContacts(OpensModels):
    """Gives a pair of a user's model other contact parameters, and leaves other contacts alone."""

    @abstractmethod
    def varied(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> VariedContact:
        """A user's model whose pair can be changed.

        source, rebuild: as in `open`.
        Raises as `open`.
        """


class TunesModels(OpensModels):
    """Writes settings for models that users wrote.

    writes_models: whether it writes the whole model with them; else lines of a script alone.
    """

    writes_models = True

    @abstractmethod
    def model_settings(
        self,
        source: Any,
        requests: Sequence[Request],
        goal: RestitutionCurve,
        was: Standing = UNKNOWN,
        rebuild: Callable[[], Any] | None = None,
        version: tuple[int, ...] = (),
    ) -> Iterable[ModelSetting]:
        """Settings for pairs in a user's own model, each meant to have the e of `goal` there;
        simplest first, each found when it is asked for.

        source: a path, several paths, text or an object.
        rebuild: makes `source` again, or None.
        requests: alike but for pairs and attitudes; their speeds, m/s, span the band.
        was: the model at rest as it is.
        version: numbers of the engine's version that has to load what is written, such as (3, 5);
        () for the installed one.
        Raises, also as settings are asked for, SceneError or UserError for a source or pair that
        cannot be opened, measured, written or made again; SearchInterrupted, a KeyboardInterrupt,
        with the best so far.
        """

    def attitudes(self, source: Any, request: Request) -> list[tuple[str, Request]]:
        """(attitude, request) of each way in which the pair can meet;
        ("", request) where there is one.
        """
        return [("", request)]

    def standing(
        self, source: Any, setting: ModelSetting | None, requests: Sequence[Request]
    ) -> Standing:
        """Return how the model rests, holds and runs with a setting; None
        stands for the model as it was.
        """
        return UNKNOWN

    def landing(
        self,
        source: Any,
        requests: Sequence[Request],
        like: DropTest | None = None,
        until_worse: bool = False,
    ) -> DropTest:
        """Drop the robot of which the pairs are feet, and judge how it lands.

        source: the user's model: a path, several paths, text or an object.
        requests: of the pairs, each of a foot and the floor; the first has the pose.
        like: a test whose length this one takes, to be compared with it; None for a length that
        lets the robot come to rest.
        until_worse: one drop is enough where something is worse in it than in all of `like`.
        Raises UserError where the pairs are not of a robot that can fall, and for an engine that
        judges no landings.
        """
        raise UserError("engine", self.title, "an engine in which hcbench judges landings")

    def rebound_settings(
        self, source: Any, requests: Sequence[Request], before: DropTest, rebound: float
    ) -> ReboundSettings:
        """Settings of a robot's feet with which its centre of mass rebounds by so much, m, from the
        highest drop; each is found when it is asked for.

        source: the user's model: a path, several paths, text or an object.
        requests: of the pairs, each of a foot and the floor; the first has the pose.
        before: the landing of the model as it is.
        Raises UserError where the pairs are not of a robot that can fall, and for an engine that
        judges no landings.
        """
        raise UserError("engine", self.title, "an engine in which hcbench judges landings")


class LandsRobots(OpensModels):
    """Drops robots on their floor, and reads where their recorded motion met it."""

    @abstractmethod
    def land(
        self,
        source: Any,
        request: Request,
        drops: DropPlan,
        rebuild: Callable[[], Any] | None = None,
    ) -> Landings:
        """Drop the robot of a model, in the pose of the request: a landing for each height at each
        tilt of the plan.

        drops: heights, tilts and controller.
        source: a path, several paths, text or an object.
        rebuild: makes `source` again, or None.
        Raises UserError where nothing can fall, or nothing is there to land on.
        """

    @abstractmethod
    def touchdowns(
        self, source: Any, request: Request, recorded: Mapping[str, Floats]
    ) -> TrajectoryTouchdowns:
        """Find where a recorded motion met the floor.

        recorded: arrays of states, by the engine's own names.
        """
