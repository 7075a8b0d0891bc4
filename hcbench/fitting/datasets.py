"""Kinds of data, each as a linear model about parameters: what they share, and touch times."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.fitting.linear import LinearModel, NoisyData
from hcbench.fitting.recording import doubts_of, reservation_of
from hcbench.fitting.setup import require_a_ball

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import Self

    from hcbench.fitting.flight import Ballistics
    from hcbench.fitting.linear import LawFit
    from hcbench.fitting.recording import Indices, Picks, Recording
    from hcbench.fitting.setup import Known, MeasurementSetup
    from hcbench.fitting.which_law import FittedCurve
    from hcbench.terms.impact import Floats

# Intervals of clicks are wider than the posterior's by this: without it, 0.93 of them held in
# disturbed rooms.
_OF_CLICKS = 1.15


class Dataset(NoisyData, ABC):
    """The data of one drop. Subclasses are frozen dataclasses with the fields `name` and `setup`.

    assumed: what the file does not say, such as a unit, and its numbers leave no choice about.
    """

    name: str
    setup: MeasurementSetup
    assumed: str

    @property
    @abstractmethod
    def kind(self) -> str:
        """Name of this kind of data."""

    @property
    def needs_gravity(self) -> bool:
        """True if speeds are computed from flights between bounces."""
        return True

    @property
    def depends_on_setup(self) -> bool:
        """True if gravity, and the air, make the speeds from what was read."""
        return self.needs_gravity

    @abstractmethod
    def pairs(self) -> tuple[Floats, Floats]:
        """Rough impact speeds (m/s) and e, for the starting point and for plots."""

    @abstractmethod
    def start(self) -> Floats:
        """Own parameters to start from, shape (p,)."""

    @abstractmethod
    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """The linear model about a law, own parameters and relative
        changes of each e, `latent` (m,).

        Its residual is that at no changes: what the ones given do is added back to first order.
        """

    @abstractmethod
    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter, for people."""

    def rows(self) -> list[str]:
        """Labels for the rows of the residual; empty if single rows cannot be wrong on their own."""
        return []

    def require_a_ball(self) -> None:
        """Raise UserError for data that no ball gives, under any law."""

    def doubts(self, fit: LawFit) -> Iterator[str]:
        """Yield reasons, under any law, to distrust the data so far that no number is given."""
        yield from ()

    @property
    def widening(self) -> float:
        """Factor by which the interval of α is widened, for errors with
        longer tails than normal ones.
        """
        return 1.0

    @property
    def reservation(self) -> str:
        """Reason to give a number but choose no law; "" without one."""
        return ""

    def with_setup(self, setup: MeasurementSetup) -> Self:
        """The same data under other conditions."""
        return replace(self, setup=setup)  # type: ignore[type-var]


def rounding_of(values: Floats) -> float:
    """Error of readings by their last digit, SI: a third of its unit, 0.02 of a thousandth at least."""
    for digits in range(1, 6):
        if np.allclose(values, np.round(values, digits), rtol=0.0, atol=1e-9):
            return 0.3 * 10.0**-digits
    return 2e-5


@dataclass(frozen=True, slots=True)
class BounceTrain:
    """Flights of a ball, one after the other, with the impacts between them.

    launch: (n,), m/s.
    touch: (m,), speed of each impact, m/s.

    by: (n, 1 + q + m), derivatives of each launch speed by ln of the first speed, the law's
    parameters, and the relative changes of e.
    """

    launch: Floats
    touch: Floats
    by: Floats


def bounce_train(
    curve: FittedCurve, ballistics: Ballistics, first: float, latent: Floats, dropped: bool
) -> BounceTrain:
    """Flights with the relative changes `latent` of each e, and their derivatives; all speeds are
    m/s.

    curve: the law, with q parameters.
    first: speed of the first launch; where `dropped`, of the touch before it.
    latent: shape (impacts,): e of each is exp(latent) times the law's.
    dropped: whether the train begins with a fall; a thrown ball has one launch more than impacts.
    """
    q = curve.count
    impacts = len(latent)
    # A thrown ball has one launch more than impacts: the throw itself.
    throws = int(not dropped)
    count = impacts + throws
    launch = np.empty(count)
    touch = np.empty(impacts)
    by = np.zeros((count, 1 + q + impacts))
    speed = first
    # Derivatives of the speed by ln of the first speed, the law's parameters and the change of each
    # e.
    gradient = np.zeros(1 + q + impacts)
    gradient[0] = first
    for i in range(count):
        # The impact before launch i; none before the first launch of a thrown ball.
        at = i - throws
        if at >= 0:
            if i:
                speed, slope = ballistics.touch(speed)
                gradient = slope * gradient
            touch[at] = speed
            log_e, over_speed, by_law = curve.local(speed)
            # The logarithm of the next launch's speed is ln v + ln e(v) + the change of e.
            gradient = (1.0 + over_speed) / speed * gradient
            gradient[1 : 1 + q] += by_law
            gradient[1 + q + at] += 1.0
            speed *= math.exp(log_e + latent[at])
            gradient *= speed
        launch[i] = speed
        by[i] = gradient
    return BounceTrain(launch, touch, by)


def drop_prior(setup: MeasurementSetup, own: float) -> tuple[float, float]:
    """(offset, standard deviation) of ln of the touch speed `own` as the drop height gives it.

    own: ln of a speed, m/s. The offset is that of the height's speed from it.
    Without a drop height the prior is flat: (0, inf).
    """
    height: Known | None = setup.height
    if height is None:
        return 0.0, math.inf
    speed, slope = setup.ballistics.dropped(height.value)
    # A height without uncertainty would have an infinite weight.
    return math.log(speed) - own, max(slope * height.uncertainty / speed, 1e-7)


@dataclass(frozen=True, slots=True)
class TouchTimes(Dataset):
    """Times at which a ball touches the plate, from a recording or a list.

    times: (n,), s, of successive touches. Own parameters: time of the first, ln of the first speed.
    numbers: (n,), which touch each is, from 0; None: none is missing.
    picks, recording: where they come from.
    heard: all trains of the recording, the one taken first; empty where the user chose the touches.
    """

    name: str
    setup: MeasurementSetup
    times: Floats
    numbers: Indices | None = None
    picks: Picks | None = None
    recording: Recording | None = None
    heard: tuple[Picks, ...] = ()
    assumed: str = ""
    noise_unit: ClassVar[str] = "s"

    @property
    def noise_scale(self) -> float:
        """Likely size of the noise of measuring, s: that of a table is its rounding at least."""
        if self.picks is not None:
            return max(2e-4, self.picks.resolution)
        return max(2e-4, rounding_of(self.times))

    @property
    def kind(self) -> str:
        """Name of the kind of data that the times came from."""
        if self.picks is None:
            return "times"
        if self.recording is not None and self.recording.what:
            return "signal"
        return "sound"

    @property
    def known_noise(self) -> float | None:
        """s_m where it is given."""
        return self.setup.timing

    @property
    def which(self) -> Indices:
        """Number of the touch at each time, from 0 for the first that was heard: shape (n,)."""
        if self.numbers is None:
            return np.arange(len(self.times))
        return np.asarray(self.numbers - self.numbers[0])

    def require_a_ball(self) -> None:
        """Raise UserError for touches of a clock, or of another drop than the given one."""
        whole = int(np.argmax(np.append(np.diff(self.which) > 1, True))) + 1
        require_a_ball(self.name, self.setup, np.diff(self.times[:whole]))

    @property
    def _first_with_e(self) -> int:
        """The first touch whose e is known: only a drop tells the speed into touch 0."""
        return int(self.setup.height is None)

    def _launches(self) -> Floats:
        """Launch of every flight; of two that an unheard touch joins, half of both."""
        which = self.which
        full = np.interp(np.arange(which[-1] + 1), which, self.times)
        flights = np.diff(full) - self.setup.contact_time.value
        return 0.5 * self.setup.ballistics.gravity * np.maximum(flights, 1e-4)

    def pairs(self) -> tuple[Floats, Floats]:
        """Rough impact speeds (m/s) and e, shape (k,) each, without the law.

        An e next to an unheard touch is left out.
        """
        speed, e = pairs_of_launches(self._launches(), self.setup, self.setup.drop)
        if self.numbers is None:
            return speed, e
        heard = set(self.which.tolist())
        first = self._first_with_e
        # An e takes the flights on both sides: with an unheard end, a flight's length is a guess.
        whole = []
        for touch in range(first, first + len(e)):
            has_flight_in = touch == 0 or touch - 1 in heard
            whole.append(has_flight_in and touch in heard and touch + 1 in heard)
        if any(whole):
            return speed[whole], e[whole]
        return speed, e

    def start(self) -> Floats:
        """Own parameters to start from: time of the first touch, s, and ln of the first speed, m/s."""
        height = self.setup.height
        if height is None:
            first = float(self._launches()[0])
        else:
            first, _ = self.setup.ballistics.dropped(height.value)
        return np.array([self.times[0], math.log(first)])

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """Linear model of the times of touches about a law, own parameters and changes of e.

        curve: the law with its parameters.
        own: time of the first touch, s, and ln of the first speed, m/s.
        latent: relative change of each e, shape (k,).
        The residuals are times, s, one for each touch that was heard.
        """
        ballistics = self.setup.ballistics
        dropped = self.setup.height is not None
        train = bounce_train(curve, ballistics, math.exp(own[1]), latent, dropped)
        # Time of each flight, s, and its slope by the launch speed: shape (launches, 2).
        aloft = np.array([ballistics.aloft(w) for w in train.launch])
        # Hertz: a contact lasts as v^(-1/5).
        contact = self.setup.contact_time.value * (train.launch / train.launch[0]) ** -0.2
        times = own[0] + np.concatenate([[0.0], np.cumsum(aloft[:, 0] + contact)])
        by = np.concatenate(
            [np.zeros((1, train.by.shape[1])), np.cumsum(aloft[:, 1:] * train.by, axis=0)]
        )
        times = times[self.which]
        by = by[self.which]
        q = curve.count
        of_time = (0.0, math.inf)
        of_speed = drop_prior(self.setup, own[1])
        return LinearModel(
            residual=self.times - times + by[:, 1 + q :] @ latent,
            by_own=np.stack([np.ones(len(times)), by[:, 0]], axis=1),
            by_law=by[:, 1 : 1 + q],
            by_scatter=by[:, 1 + q :],
            shape=np.ones(len(times)),
            prior=np.array([of_time, of_speed]),
            speed=train.touch,
        )

    def rows(self) -> list[str]:
        """Labels for the rows of the residual: each touch with its time."""
        return [f"touch {i + 1} at {t:.4f} s" for i, t in zip(self.which, self.times, strict=True)]

    def doubts(self, fit: LawFit) -> Iterator[str]:
        """Yield reasons to doubt that the touches are the ball's; none if the user chose them."""
        if self.heard:
            yield from doubts_of(self.heard, fit.scatter)

    @property
    def widening(self) -> float:
        """The widening for clicks, some of which are mistimed by 0.1 to 0.5 ms."""
        if self.picks is None:
            return 1.0
        return _OF_CLICKS

    @property
    def reservation(self) -> str:
        """Reason why the touches may not be the ball's; "" if they surely are or the user chose
        them.
        """
        if not self.heard:
            return ""
        return reservation_of(self.heard)

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        heard = dict(zip(self.which.tolist(), self.rows(), strict=True))
        # No flight follows the last touch, so that it has no e.
        with_e = range(self._first_with_e, int(self.which[-1]))
        return [heard.get(i, f"touch {i + 1}, unheard") for i in with_e]


def pairs_of_launches(
    launches: Floats, setup: MeasurementSetup, drop: float | None
) -> tuple[Floats, Floats]:
    """Impact speeds and e of flights with these launch speeds (n,), all m/s; arrays of shape (k,).

    drop: height where the ball was let go, m; None: not known. Then the first launch has no e, and
    k is n - 1; with it k is n.
    """
    ballistics = setup.ballistics
    touch = np.array([ballistics.touch(w)[0] for w in launches])[:-1]
    if drop is None:
        return touch, launches[1:] / touch
    touch = np.concatenate([[ballistics.dropped(drop)[0]], touch])
    return touch, launches / touch
