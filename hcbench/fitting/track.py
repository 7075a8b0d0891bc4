"""A track, height over time: the whole path is fitted at once, flights, touches and all."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hcbench.fitting.datasets import Dataset, bounce_train, drop_prior, pairs_of_launches
from hcbench.fitting.linear import LinearModel
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.flight import Ballistics
    from hcbench.fitting.linear import LawFit
    from hcbench.fitting.recording import Indices
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.fitting.which_law import FittedCurve
    from hcbench.terms.impact import Floats

# A flight must be this many times higher than the noise to be looked for.
_SIGMAS = 7.0
# The same for flights that follow one another: their places are known.
_FOLLOWS = 5.0
# The same, as a share of the highest point.
_SHARE = 0.005
# Frames that a flight has at least.
_LEAST_FRAMES = 4
# Share of the last flight that is left out: nothing after it shows whether it is still flight.
_UNSURE = 0.1
# Share of the drop after which the ball surely falls freely.
_FALLEN = 0.05
# Standard deviations of g from which on the scale or the clock is called wrong.
_OFF = 3.0
# A difference of g below this share does not matter, whatever its standard deviation.
_NEAR = 0.01
# No measurement of g is wrong by this share: the scale or the times are.
_GROSS = 0.2
# Longest flight, as a multiple of the flight before: bounces get lower, and frames round times.
_SHORTER = 1.1
# Frames of the windows in which free flight is looked for, and windows of each length, at most.
_WINDOWS = (6, 9, 14, 20, 30, 45, 70, 105, 160, 240)
_MOST_WINDOWS = 250
# So few of noise alone look like flights.
_LEAST_WINDOWS = 6
# A flight's bend over its noise, at least.
_CLEAR = 12.0
# Frames from which the bend of a flight shows g.
_FRAMES_OF_G = 6


@dataclass(frozen=True, slots=True)
class Track(Dataset):
    """Heights of a ball in the frames of a film.

    times, heights: (n,), s and m, of any point of the ball over any level.
    touch_times: (k,), s, floor and drop, m: to start from; drop: None where the track does not
    begin with the ball let go. Own parameters: height of the floor, time of the first touch, ln of
    the speed of the first touch where it begins with a fall, else of the first launch.
    """

    name: str
    setup: MeasurementSetup
    times: Floats
    heights: Floats
    touch_times: Floats
    floor: float
    drop: float | None
    assumed: str = ""
    noise_scale: ClassVar[float] = 1e-3
    noise_unit: ClassVar[str] = "m"

    @property
    def kind(self) -> str:
        """Name of this kind of data."""
        return "track"

    @property
    def _drop(self) -> float | None:
        """The height of the drop, m: as given, else as the track shows it, if it does."""
        if self.setup.drop is not None:
            return self.setup.drop
        return self.drop

    @property
    def _dropped(self) -> bool:
        return self._drop is not None

    def _launches(self) -> Floats:
        return 0.5 * self.setup.ballistics.gravity * np.diff(self.touch_times)

    def pairs(self) -> tuple[Floats, Floats]:
        """Rough impact speeds (m/s) and e, without the law."""
        return pairs_of_launches(self._launches(), self.setup, self._drop)

    def start(self) -> Floats:
        """Own parameters to start from."""
        first = float(self._launches()[0])
        if self._drop is not None:
            first = self.setup.ballistics.dropped(self._drop)[0]
        return np.array([self.floor, self.touch_times[0], math.log(first)])

    def linearise(self, curve: FittedCurve, own: Floats, latent: Floats) -> LinearModel:
        """Linear model of the heights about a law, own parameters and changes of e.

        curve: the law with its parameters.
        own: height of the floor, m; time of the first touch, s; ln of the first speed, m/s.
        latent: relative change of each e, shape (k,).
        The residuals are heights, m, one for each frame. The drop height is known only where the
        setup has it: other own parameters have a flat prior.
        """
        ball = self.setup.ballistics
        q = curve.count
        first = math.exp(own[2])
        train = bounce_train(curve, ball, first, latent, self._dropped)
        aloft = np.array([ball.aloft(w) for w in train.launch])
        touch = own[1] + np.concatenate([[0.0], np.cumsum(aloft[:, 0])])
        touch_by = np.concatenate(
            [np.zeros((1, train.by.shape[1])), np.cumsum(aloft[:, 1:] * train.by, axis=0)]
        )
        which = np.clip(
            np.searchsorted(touch, self.times, side="right") - 1, -1, len(train.launch) - 1
        )
        path = np.empty(len(self.times))
        by = np.zeros((len(self.times), train.by.shape[1]))
        velocity = np.empty(len(self.times))
        for j in range(-1, len(train.launch)):
            at = which == j
            if j < 0:
                path[at], by[at, 0], velocity[at] = ball.fall(first, own[1] - self.times[at])
                by[at, 0] *= first
            else:
                path[at], slope, velocity[at] = ball.path(
                    train.launch[j], self.times[at] - touch[j]
                )
                by[at] = slope[:, None] * train.by[j] - velocity[at, None] * touch_by[j]
        flat = (0.0, math.inf)
        # Of the floor's height, of the time of the first touch and of ln of the first speed.
        prior = [flat, flat, drop_prior(self.setup, own[2])]
        return LinearModel(
            residual=self.heights - own[0] - path + by[:, 1 + q :] @ latent,
            by_own=np.stack([np.ones(len(path)), -velocity, by[:, 0]], axis=1),
            by_law=by[:, 1 : 1 + q],
            by_scatter=by[:, 1 + q :],
            shape=np.ones(len(path)),
            prior=np.array(prior),
            speed=train.touch,
        )

    def touches(self) -> list[str]:
        """Labels for the columns of by_scatter."""
        labels = [f"touch {i + 1} at {t:.3f} s" for i, t in enumerate(self.touch_times)]
        # Only a drop tells the speed into the first touch.
        first = int(not self._dropped)
        return labels[first:-1]


def seen_fall(times: Floats, heights: Floats) -> float:
    """The acceleration of free flight between touches, as the heights' unit over time's squared: below
    0 where heights rise upwards; 0 where no flight is seen.

    times, heights: (n,), rising times. Parabolas through windows of many lengths: those of flights
    are smooth and bent, those with a touch are not smooth, those at rest are not bent. Frames in
    which the ball rests or that are noisy do not count, as they would in a median over all.
    """
    count = len(times)
    if count and not float(np.ptp(heights)) > 0.0:
        # A marker on the wall: rounding would bend its line.
        return 0.0
    found = []
    for frames in _WINDOWS:
        if frames > count:
            break
        step = max(1, frames // 4, count // _MOST_WINDOWS)
        for begin in range(0, count - frames + 1, step):
            window = slice(begin, begin + frames)
            flight = _clear_flight(times[window], heights[window])
            if flight is not None:
                found.append(flight)
    if len(found) < _LEAST_WINDOWS:
        return 0.0
    accelerations, weights = np.array(found).T
    # Their weighted median.
    order = np.argsort(accelerations)
    share = np.cumsum(weights[order])
    middle = float(accelerations[order][int(np.searchsorted(share, 0.5 * share[-1]))])
    is_alike = np.abs(accelerations / middle - 1.0) < _GROSS
    if float(weights[is_alike].sum()) < 0.5 * share[-1]:
        return 0.0
    return middle


def _clear_flight(times: Floats, heights: Floats) -> tuple[float, float] | None:
    """The acceleration of a parabola through heights, in their unit over time's squared, and its
    weight; None where it does not bend clearly more than the heights scatter about it.

    times, heights: (n,), of one window. weight: the bend over the scatter, up to 1000.
    """
    since_middle = times - times.mean()
    half = float(since_middle[-1])
    matrix = np.vander(since_middle / half, 3)
    fitted, *_ = np.linalg.lstsq(matrix, heights, rcond=None)
    scatter = float(np.sqrt(((heights - matrix @ fitted) ** 2).sum() / max(len(times) - 3, 1)))
    bend = float(fitted[0])
    if not abs(bend) > _CLEAR * scatter:
        return None
    return 2.0 * bend / half**2, min(abs(bend) / max(scatter, 1e-12), 1e3)


def upright(times: Floats, heights: Floats, setup: MeasurementSetup) -> Floats:
    """Heights that rise upwards: pictures count downwards, and flights then curve the other way."""
    if seen_fall(times, heights) > 0.5 * setup.ballistics.gravity:
        return -heights
    return heights


def track_of(name: str, setup: MeasurementSetup, times: Floats, heights: Floats) -> Track:
    """A track with its touches found.

    times, heights: (n,), s and m, rising times; of any point of the ball over any level.
    The track begins with the free fall, where there is one, else after the first touch.
    Raises UserError where there are too few touches, and where flights fall with quite another g.
    """
    # It takes half a second to import, and few data are tracks.
    from scipy.signal import find_peaks

    # The third difference has 20 times the variance of white noise, and is 0 for free flight.
    noise = float(np.median(np.abs(np.diff(heights, 3)))) / (0.6745 * math.sqrt(20.0))
    share = _SHARE * float(np.ptp(heights))
    least = max(_SIGMAS * noise, share)
    follows = max(_FOLLOWS * noise, share)
    lows = find_peaks(-heights, prominence=least)[0]
    is_short = np.append(np.diff(lows) < _LEAST_FRAMES, True)
    lows = lows[: 1 + int(np.argmax(is_short))]
    if not len(lows):
        raise _too_few(name, 0)
    floor = float(np.median(heights[lows]))
    gravity = setup.ballistics.gravity
    # Time between two frames, s.
    frame = float(np.median(np.diff(times)))
    _require_scale(name, setup.ballistics, times, heights, lows)
    lows = _of_flights(lows, times, heights - floor, frame, gravity)
    # The fall begins after the last frame in which the ball may still be held.
    before_touch = heights[: lows[0]]
    top = float(before_touch.max(initial=floor))
    fallen = max(_FALLEN * (top - floor), 3.0 * noise)
    held = np.flatnonzero(before_touch > top - fallen)
    begin = 0
    if held.size:
        begin = int(held[-1]) + 1
    has_fall = int(lows[0]) - begin >= _LEAST_FRAMES
    touches = times[lows].tolist()
    # Two rounds: the floor's height gives the touches, and the touches give the floor.
    for _ in range(2):
        touches = _extended(touches, times, heights - floor, follows, frame, gravity)
        touches, floor = _refined(touches, times[begin:], heights[begin:], floor, frame, gravity)
    needed = 2 if has_fall or setup.height is not None else 4
    if len(touches) < needed:
        raise _too_few(name, len(touches))
    end = touches[-1] - _UNSURE * (touches[-1] - touches[-2])
    if has_fall:
        is_begun = times >= times[begin]
        drop = top - floor
    else:
        # The part before the first touch shows no free fall: it is left out.
        is_begun = times > touches[0]
        drop = None
    kept = is_begun & (times < end)
    return Track(
        name=name,
        setup=setup,
        times=times[kept],
        heights=heights[kept],
        touch_times=np.array(touches),
        floor=floor,
        drop=drop,
    )


def _require_scale(
    name: str, ball: Ballistics, times: Floats, heights: Floats, lows: Indices
) -> None:
    """Raise UserError where the flights between touches fall with
    quite another g than the one given.

    times, heights: (n,), s and m.
    lows: (k,), the frames of touches. A film shown slower than it was taken stretches time, a wrong
    scale the heights; both enter α in full.
    """
    measured = 0.0
    expected = 0.0
    longest = math.inf
    for a, b in itertools.pairwise(lows):
        duration = float(times[b] - times[a])
        if duration > longest:
            # A flight longer than the one before hides a touch that was missed.
            break
        longest = _SHORTER * duration
        inside = slice(a + 1, b)
        aloft = times[inside] - times[a]
        if len(aloft) < _FRAMES_OF_G:
            continue
        ideal, _, _ = ball.path(0.5 * ball.gravity * duration, aloft)
        # Inverse variance of a parabola's bend, up to the noise of the heights.
        weight = float(aloft[-1] - aloft[0]) ** 4
        measured += weight * float(np.polyfit(aloft, heights[inside], 2)[0])
        expected += weight * float(np.polyfit(aloft, ideal, 2)[0])
    if not expected:
        return
    share = measured / expected
    if abs(share - 1.0) > _GROSS:
        got = f"its flights fall with {share:.2g} times the g given"
        advice = (
            "Look at the unit of heights and at the frame rate: of a slow-motion film, the camera's"
        )
        raise UserError(name, got, f"{1 - _GROSS:g} ... {1 + _GROSS:g} times", advice)


def _of_flights(
    lows: Indices, times: Floats, raised: Floats, frame: float, gravity: float
) -> Indices:
    """The lowest frames up to the first that no free flight of its height leads to: the rest is
    noise.

    lows: (k,), frames, rising.
    times, raised: (n,), s and m over the floor.
    frame: time between two frames, s.
    gravity: m/s².
    """
    for i, (a, b) in enumerate(itertools.pairwise(lows)):
        flight = math.sqrt(8.0 * float(raised[a:b].max()) / gravity)
        if abs(times[b] - times[a] - flight) > max(0.2 * flight, 2.5 * frame):
            return lows[: i + 1]
    return lows


def _refined(
    touches: list[float], times: Floats, heights: Floats, floor: float, frame: float, gravity: float
) -> tuple[list[float], float]:
    """Refine times of touches, s, and the height of the floor, m.

    A touch is where the arcs before and after it meet; the last one is where its arc meets the
    floor. A touch that would move by two frames or more stays.

    times, heights: of the frames, s and m, shape (n,).
    frame: time between two frames, s.
    gravity: m/s².
    """
    ends = [float(times[0]) - frame, *touches]
    # Adding g t²/2 makes straight lines of free flights.
    raised = heights + 0.5 * gravity * times**2
    # Slope and height of the line of each flight; None for a flight with too few frames.
    arcs = []
    for begin, end in itertools.pairwise(ends):
        inside = (times > begin + 0.5 * frame) & (times < end - 0.5 * frame)
        arc = None
        if inside.sum() > 1:
            arc = np.polyfit(times[inside], raised[inside], 1)
        arcs.append(arc)
    refined = list(touches)
    levels = []
    for i, (before, after) in enumerate(itertools.pairwise(arcs)):
        if before is None or after is None:
            continue
        t = (after[1] - before[1]) / (before[0] - after[0])
        if abs(t - touches[i]) < 2.0 * frame:
            refined[i] = float(t)
            levels.append(float(np.polyval(before, t) - 0.5 * gravity * t**2))
    if levels:
        floor = float(np.median(levels))
    if arcs[-1] is not None:
        slope, start = arcs[-1]
        root = math.sqrt(max(slope**2 + 2.0 * gravity * (start - floor), 0.0))
        refined[-1] = float((slope + root) / gravity)
    return refined, floor


def _extended(
    touches: list[float], times: Floats, heights: Floats, least: float, frame: float, gravity: float
) -> list[float]:
    """Touches, and those after them that the heights of flights tell, of more than _LEAST_FRAMES
    frames each.

    touches: one or more, s.
    times: s.
    heights: over the floor, m, at these times.
    least: height of a flight that is one, m.
    frame: time between two frames, s.
    gravity: m/s².
    """
    while True:
        # Flights shrink: the next one is shorter than the last, if there is a last one.
        if len(touches) > 1:
            window = touches[-1] - touches[-2]
        else:
            window = times[-1] - touches[-1]
        after = heights[(times > touches[-1] + 0.5 * frame) & (times < touches[-1] + window)]
        height = max(float(after.max(initial=0.0)), 0.0)
        # A flight to a height takes two falls from it.
        flight = 2.0 * math.sqrt(2.0 * height / gravity)
        is_seen = height > least and flight > _LEAST_FRAMES * frame
        if not is_seen or flight > window or touches[-1] + flight > times[-1]:
            return touches
        touches = [*touches, touches[-1] + flight]


def _too_few(name: str, count: int) -> UserError:
    advice = "Film the fall and more bounces, or faster: a flight needs four frames"
    return UserError(name, f"{count} touches in the track", "more", advice)


def scale_warnings(fit: LawFit, sets: Sequence[Dataset]) -> list[str]:
    """Warn of tracks whose flights fall with another g than the one given: a wrong scale or frame
    rate.

    fit: to these data sets, in their order; others than tracks are passed over. A warning needs a
    difference of g of 3 standard deviations and 1 %.
    """
    warnings = []
    for s, left, noise in zip(sets, fit.measured_off(), fit.noise, strict=True):
        if not isinstance(s, Track):
            continue
        off, sd = _off_g(s, left, noise)
        if abs(off) > max(_OFF * sd, _NEAR):
            warnings.append(
                f"{s.name}: its flights fall with {100 * (1 + off):.1f} +- {100 * sd:.1f} % of the g given: "
                "look at the scale and the frame rate, which count fully in α"
            )
    return warnings


def _off_g(track: Track, left: Floats, noise: float) -> tuple[float, float]:
    """Difference of the track's g from the one given, and its standard deviation, as shares of g.

    left: residual of each height after the fit, m, (n,): over a flight a parabola where g is
    another, whatever the law.
    noise: of a height, m.
    """
    # A flight each; the first entries stand for a track without any.
    weights = [1e-300]
    differences = [0.0]
    for begin, end in itertools.pairwise([-math.inf, *track.touch_times]):
        inside = (track.times > begin) & (track.times < end)
        if inside.sum() < _LEAST_FRAMES:
            continue
        matrix = np.vander(track.times[inside] - track.times[inside].mean(), 3)
        bend = float(np.linalg.lstsq(matrix, left[inside], rcond=None)[0][0])
        variance_of_bend = noise**2 * float(np.linalg.inv(matrix.T @ matrix)[0, 0])
        # A height is short of its parabola by g t²/2.
        differences.append(-2.0 * bend)
        weights.append(1.0 / (4.0 * variance_of_bend))
    g = track.setup.ballistics.gravity
    off = float(np.average(differences, weights=weights)) / g
    return off, 1.0 / (g * math.sqrt(sum(weights)))
