"""Result of a fit: α, its uncertainty and the law that the data support, as text and JSON."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.estimate import ENDS, estimate_of
from hcbench.fitting.heights import ratio
from hcbench.fitting.linear import Estimate, quantiles
from hcbench.fitting.which_law import EITHER, FAMILY, LAWS, PLAIN, WITH_E0, hunt_crossley
from hcbench.system.errors import UserError
from hcbench.system.text import Drawn, sanitized, table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.catalogue.material import MaterialPair
    from hcbench.fitting.budget import Budget
    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import LawFit
    from hcbench.fitting.misfits import Flag, LackOfFit
    from hcbench.fitting.replay import Replay
    from hcbench.terms.impact import Floats

# Two materials against each other: the ratio of their α, or of what they lose.

# Drops of each material: fewer hardly show how much drops differ.
_DROPS_TO_KNOW = 3


@dataclass(frozen=True, slots=True)
class Comparison:
    """Difference of two materials in α, or in 1 - e where e of both is constant.

    files: names of the other's.
    compared: "alpha", or "one_minus_e" where e of both is constant.
    ratio: of the first material's to the other's.
    few_drops: a material has too few drops to tell well how they differ.
    """

    files: tuple[str, ...]
    compared: str
    ratio: Estimate
    few_drops: bool

    @property
    def differ(self) -> bool:
        """True if 1 lies outside the 95 % interval of the ratio."""
        return not self.ratio.low <= 1.0 <= self.ratio.high

    @property
    def line(self) -> str:
        """The verdict and the ratio, in words."""
        verdict = "no difference is seen"
        if self.differ:
            verdict = "the materials differ"
        compared = {"alpha": "α", "one_minus_e": "1 - e"}[self.compared]
        interval = f"{self.ratio.value:.3g}, 95 %: {self.ratio.low:.3g} ... {self.ratio.high:.3g}"
        return f"{verdict}: {compared} is {interval} times theirs"


def compare(one: FitResult, other: FitResult) -> Comparison:
    """The ratio of their α, or of 1 - e where one of them has no α.

    Raises UserError where a side has neither, or the two have no number in common.
    """
    files = tuple(s.name for s in other.sets)
    few = min(len(one.sets), len(other.sets)) < _DROPS_TO_KNOW
    if one.alpha is not None and other.alpha is not None:
        return Comparison(files, "alpha", ratio(_each(one, "alpha"), _each(other, "alpha")), few)
    if one.restitution is not None and other.restitution is not None:
        lost = ratio(_each(one, "restitution"), _each(other, "restitution"))
        return Comparison(files, "one_minus_e", lost, few)
    slot = "--against"
    if one.alpha is None and one.restitution is None:
        slot = "the files"
    raise UserError(slot, "no number to compare", "both with an α, or both with a constant e")


def _each(result: FitResult, name: str) -> list[Estimate]:
    """α of each drop, s/m, or 1 - e; that of all together where there is one file.

    name: "alpha", or "restitution" for 1 - e. Drops that have no such number are left out.
    """
    estimates = []
    for fitted in result.drops or [result]:
        estimate: Estimate | None = getattr(fitted, name)
        if estimate is None:
            continue
        if name == "restitution":
            # The ends of the interval change places.
            low = 1.0 - estimate.high
            high = 1.0 - estimate.low
            estimate = replace(estimate, value=1.0 - estimate.value, low=low, high=high)
        estimates.append(estimate)
    return estimates


def comparison_text(comparison: Comparison) -> str:
    """Verdict and ratio of a comparison, for a terminal."""
    lines = [f"against {', '.join(comparison.files)}", f"  {comparison.line}"]
    if comparison.few_drops:
        lines.append(
            "  With three drops or more of each, the difference from drop to drop is known better."
        )
    return "\n" + "\n".join(lines) + "\n"


def comparison_record(comparison: Comparison) -> dict[str, Any]:
    """The comparison as `--json` prints it."""
    return {
        "files": list(comparison.files),
        "compared": comparison.compared,
        "ratio": dataclasses.asdict(comparison.ratio),
        "differ": comparison.differ,
    }


# Result of a fit: α, its uncertainty and the sources of that, and the law that the data support.


@dataclass(frozen=True, slots=True)
class DropResult:
    """One file of several: its own α, and e if it is constant; None
    where the file's train is in doubt.
    """

    name: str
    alpha: Estimate | None
    restitution: Estimate | None
    doubts: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class FitResult(Drawn):
    """The fit of all laws to one or more drops.

    sets: the data, one of each file.
    asked: the law of --law, or "auto".
    law: the one of --law; of "auto" the one that the data support, None where several are left,
    where `doubts` or `reservation` say why none is given, where no law is likely to fit, and where
    the loss may be adhesion.
    fits: every law tried, the likeliest first; odds: of each against the best of the others.
    alpha, e0, restitution: None where the law that they belong to is ruled out or was not asked
    for.
    speeds: the least and the largest impact speed of the data, m/s.
    budget: the sources of the uncertainty of α, or of a constant e.
    doubts: why neither a law nor α is given although one was fitted.
    reservation: why no law is given.
    lack: the odds that no law fits.
    flags: touches that stand out.
    warnings: sentences for the user.
    drops: of several files, each by itself; between: by which share of α they differ beyond their
    own errors.
    against: the comparison with another material, where files of one were given.
    """

    sets: tuple[Dataset, ...]
    asked: str
    law: str | None
    fits: tuple[LawFit, ...]
    odds: tuple[float, ...]
    alpha: Estimate | None
    e0: Estimate | None
    restitution: Estimate | None
    speeds: tuple[float, float]
    budget: Budget
    flags: tuple[Flag, ...]
    lack: LackOfFit
    warnings: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    reservation: str = ""
    drops: tuple[DropResult, ...] = ()
    between: float | None = None
    against: Comparison | None = None

    def _lines(self) -> Iterator[str]:
        """The main numbers, a line each, and the comparison with another material, if there is
        one.
        """

        yield from (f"{name}: {value}" for name, value in headline(self).items())
        if self.against is not None:
            yield self.against.line

    def _rows(self) -> Iterator[dict[str, float]]:
        """e over speed with its 95 % band, as `--write-points` writes it."""

        names = ("speed_m_per_s", "restitution", "restitution_low", "restitution_high")
        for row in zip(*(column.tolist() for column in band(self)), strict=True):
            yield dict(zip(names, row, strict=True))

    def scene(self, engine: str, timestep: float) -> Replay:
        """A scene that bounces as the recording did, tuned as `hcbench tune` does.

        timestep: s.
        Raises UserError without touch times or a law and for fewer than 4 touches in a row, and
        what `replay` raises.
        """
        from hcbench.fitting.replay import recorded_touches, replay, target_of

        touches = _touch_times(self)
        # A recording of too few touches is refused before a fit without a law.
        recorded_touches(touches)
        if self.law is None:
            raise UserError(
                "--engine", "no law is certain", "a law to tune to, such as --law hunt-crossley"
            )
        alpha = None
        if self.is_plain and self.alpha is not None:
            alpha = self.alpha.value
        gravity = self.sets[0].setup.gravity.value
        target = target_of(self.best.curve, alpha, self.speeds, gravity, timestep)
        return replay(touches, target, engine)

    def material(self, name: str) -> MaterialPair:
        """The recording as a pair of materials, which `material=` takes.

        name: the pair, such as "rubber on concrete".
        """
        return material_of(self, name)

    @property
    def best(self) -> LawFit:
        """The fit of the law chosen, else of the likeliest."""
        fit = None
        if self.law:
            fit = self.fit_of(self.law)
        return fit or self.fits[0]

    @property
    def is_plain(self) -> bool:
        """True if eq. (16) without e0 describes the data: chosen, or likelier than the law with e0
        if both are left.
        """
        return self.law == PLAIN or (self.law == EITHER and self.best.law.name == PLAIN)

    def fit_of(self, name: str) -> LawFit | None:
        """The fit of a law, if it was tried."""
        return next((fit for fit in self.fits if fit.law.name == name), None)

    @property
    def curves(self) -> list[LawFit]:
        """The fits that the band of e spans: with and without e0 where that is open."""
        if self.law == EITHER:
            return [fit for fit in self.fits if fit.law.name in (PLAIN, WITH_E0)]
        return [self.best]


def _touch_times(result: FitResult) -> TouchTimes:
    """The first data set of touch times. Raises UserError where there is none."""
    for s in result.sets:
        if isinstance(s, TouchTimes):
            return s
    raise UserError("--engine", "no touch times in the files", "a recording, or times of touches")


# Text and JSON of a fit, and its points of e over speed.

SCHEMA = 1
_POINTS = 20
_BAND_POINTS = 25
# Times of touches in a line of text.
_TIMES_A_LINE = 10


def with_uncertainty(value: float, uncertainty: float) -> str:
    """Value and standard uncertainty as text, such as "0.3127 +- 0.0043": two digits of the latter.

    An uncertainty that is not above 0, or not finite, is written as 0.
    """
    if not uncertainty > 0 or not math.isfinite(uncertainty):
        return f"{value:.6g} +- 0"
    if uncertainty > 1e4:
        digits = max(
            2, math.floor(math.log10(abs(value))) - math.floor(math.log10(uncertainty)) + 2
        )
        return f"{value:.{digits - 1}e} +- {uncertainty:.1e}"
    digits = max(0, 1 - math.floor(math.log10(uncertainty)))
    return f"{value:.{digits}f} +- {uncertainty:.{digits}f}"


def speeds_over(result: FitResult, count: int) -> Floats:
    """Even speeds over the range that the data hold, m/s."""
    return np.linspace(*result.speeds, count)


def band(result: FitResult, count: int = _BAND_POINTS) -> tuple[Floats, Floats, Floats, Floats]:
    """Speeds (m/s), e of the law that is chosen or likeliest, and the ends of its 95 % band.

    count: of speeds, even over the range of the data; each of the four arrays has the shape
    (count,).
    The band spans the law with and without e0 if the data leave that open. Its upper end is 1 at
    most.
    """
    speeds = speeds_over(result, count)
    lows = []
    highs = []
    for fit in result.curves:
        low_of_law, middle_of_law, high_of_law = _band_of(fit, speeds)
        lows.append(low_of_law)
        highs.append(high_of_law)
        if fit is result.best:
            middle = middle_of_law
    low = np.min(lows, axis=0)
    high = np.max(highs, axis=0)
    # The band widens by the uncertainty of g, height and other inputs, and by the differences of
    # drops.
    wider = _wider(result)
    best = result.best
    names = best.law.describe(tuple(best.parameters), best.reference)
    medians = {name: estimate_of(best, name).value for name in names}
    given = middle * _of_given(result, speeds, medians)
    return (
        speeds,
        given,
        given - wider * (middle - low),
        np.minimum(given + wider * (high - middle), 1.0),
    )


def likeliest_e(result: FitResult, speeds: Floats) -> Floats:
    """e of the likeliest law at each speed (n,), m/s; of several drops, with the α or e given."""
    best = result.best
    each = np.array([best.curve.at(float(v)) for v in speeds])
    likeliest = best.law.describe(tuple(best.parameters), best.reference)
    return np.minimum(1.0, each * _of_given(result, speeds, likeliest))


def _of_given(result: FitResult, speeds: Floats, computed: dict[str, float]) -> Floats:
    """e by the α or e that is given, over e by the computed one, at each speed (n,), m/s.

    computed: parameters of the law for all impacts together, by their names.
    1 for one drop. The mean over several drops counts each drop, and the computed one each impact.
    """
    same = np.ones(len(speeds))
    if result.between is None:
        return same
    if "alpha" in computed and result.alpha is not None:
        logs = [
            hunt_crossley(1.5 * result.alpha.value * v)[0]
            - hunt_crossley(1.5 * computed["alpha"] * v)[0]
            for v in speeds
        ]
        return np.exp(logs)
    if "restitution" in computed and result.restitution is not None:
        return same * result.restitution.value / computed["restitution"]
    return same


def _band_of(fit: LawFit, speeds: Floats) -> Floats:
    """2.5 %, 50 % and 97.5 % of e at each speed (n,), m/s, by the posterior of a law: (3, n)."""
    posterior = fit.posterior
    # Draws of little weight do not move the band, and each costs a curve.
    keep = posterior.weight > 1e-4 * posterior.weight.max()
    weight = posterior.weight[keep] / posterior.weight[keep].sum()
    curves = []
    for parameters in posterior.parameters[keep]:
        curve = fit.law.curve(tuple(parameters), fit.reference)
        curves.append([curve.at(v) for v in speeds])
    by_speed = np.array(curves).T
    return np.array([quantiles(e, weight, ENDS) for e in by_speed]).T


def _wider(result: FitResult) -> float:
    """Width of the interval that the result gives, over the width of all posteriors of its `curves`
    together.

    1 for a law whose parameter is not given, and where no number is.
    """
    if result.best.law.name == "constant":
        name = "restitution"
        estimate = result.restitution
    elif result.best.law.name in FAMILY:
        name, estimate = "alpha", result.alpha
    else:
        return 1.0
    if estimate is None:
        return 1.0
    low = math.inf
    high = -math.inf
    for fit in result.curves:
        of_law = estimate_of(fit, name)
        low = min(low, of_law.low)
        high = max(high, of_law.high)
    return (estimate.high - estimate.low) / max(high - low, 1e-300)


def limit_of(result: FitResult, more: float = 0.0) -> float:
    """The |e - wanted| up to which a model is within the measurement and `more`, rounded up; 1 at
    most.
    """
    _, e, low, high = band(result)
    off = max(float((high - e).max()), float((e - low).max()), 1e-4) + more
    step = 10.0 ** (math.floor(math.log10(off)) - 1)
    return float(min(1.0, math.ceil(off / step - 1e-9) * step))


def as_text(result: FitResult) -> str:
    """The whole fit, for a terminal."""
    rows = headline(result)
    width = max(map(len, rows))
    lines = [f"{name:<{width}}  {value}" for name, value in rows.items()]
    lines += [*_heard(result), "", *_laws(result), "", *_budget(result)]
    for flag in result.flags:
        off = f"{flag.what} by {flag.sigmas:.1f} standard deviations"
        lines.append(f"check: {flag.file}, {flag.touch}: {off}; kept")
    lines += [f"warning: {warning}" for warning in result.warnings]
    return "\n".join(lines) + "\n"


def headline(result: FitResult) -> dict[str, str]:
    """The main numbers of the fit as text, by name. Where no law is chosen, each says under which
    it holds.
    """
    files = []
    count = 0
    for s in result.sets:
        speeds, _ = s.pairs()
        count += len(speeds)
        files.append(f"{s.name}: {s.kind}")
    low, high = result.speeds
    rows = {"data": f"{', '.join(files)}; {count} impacts", "law": _law_row(result)}
    if result.alpha is not None:
        rows["α"] = _shown(result.alpha, " s/m")
        if not result.law:
            rows["α"] += ", if it is hunt-crossley"
    if result.between is not None:
        rows["between drops"] = f"they differ by {100 * result.between:.2g} %, included above"
    if result.e0 is not None:
        rows["constant loss e0"] = _shown(result.e0)
        if result.law != WITH_E0:
            rows["constant loss e0"] += ", if there is one"
    if result.restitution is not None:
        rows["e"] = _shown(result.restitution)
        if not result.law:
            rows["e"] += ", if it is constant"
    rows["holds for"] = f"impact speeds of {low:.3g} ... {high:.3g} m/s"
    rows["found"] = f"e scatters by {100 * result.best.scatter:.2g} %"
    found = []
    for s, noise in zip(result.sets, result.best.noise, strict=True):
        if s.known_noise is None:
            found.append(f"{noise:.2g} {s.noise_unit}".strip())
    if found:
        rows["found"] += f"; measured to {', '.join(found)}"
    return rows


def _law_row(result: FitResult) -> str:
    """Name of the law that is chosen, or why none is: doubts first, then a lack of fit, then odds."""
    if result.law and result.asked != "auto":
        return f"{result.law}, as asked for"
    if result.law:
        return result.law
    if result.doubts:
        return "undecided: " + "; ".join(result.doubts)
    if result.lack.is_certain:
        return f"none of these laws ({odds_text(result.lack.odds)}): {result.lack.shape}"
    if result.reservation:
        return f"undecided: {result.reservation}"
    if result.lack.may_stick and result.fits[0].law.name == WITH_E0:
        return (
            "undecided: a constant loss e0 or bodies that stick; the interval of α holds for both"
        )
    if result.lack.is_likely:
        return f"undecided: perhaps none of these laws ({odds_text(result.lack.odds)}): {result.lack.shape}"
    return "undecided: several laws fit (see below)"


def _shown(estimate: Estimate, unit: str = "") -> str:
    interval = f"95 %: {estimate.low:.4g} ... {estimate.high:.4g}"
    return f"{with_uncertainty(estimate.value, estimate.uncertainty)}{unit}, {interval}{unit}"


def _heard(result: FitResult) -> list[str]:
    """Lines of the touches found in recordings, and of the other trains; empty for other data."""
    lines = []
    for s in result.sets:
        if isinstance(s, TouchTimes) and s.picks is not None:
            how = f"heard above {s.picks.band:g} Hz" if s.picks.band else "found as pulses"
            lines += ["", f"{s.name}: touches {how}, s"]
            places = [f"{time:.5f}" for time in s.picks.times]
            missed = int(s.picks.numbers[-1]) + 1 - len(places)
            for begin in range(0, len(places), _TIMES_A_LINE):
                lines.append("  " + "  ".join(places[begin : begin + _TIMES_A_LINE]))
            if missed:
                lines.append(f"  and {missed} between them that were not heard")
            lines += _trains(s)
    return lines


def trains_of(s: TouchTimes) -> list[tuple[str, ...]]:
    """Candidate trains of clicks, a row each: letter, touches, from, to, α, s_e, ln of the odds.

    Trains too short for a fit have neither α nor s_e: "". The letters are those of --touches.
    """
    rows: list[tuple[str, ...]] = []
    for letter, picks in zip("ABCDEF", s.heard, strict=False):
        alpha = ""
        if picks.alpha is not None:
            alpha = f"{with_uncertainty(picks.alpha.value, picks.alpha.uncertainty)} s/m"
        scatter = ""
        if picks.scatter:
            scatter = f"{100 * picks.scatter:.2g} %"
        begin = f"{picks.times[0]:.3f} s"
        end = f"{picks.times[-1]:.3f} s"
        score = f"{picks.score:.0f}"
        rows.append((letter, f"{len(picks.times)}", begin, end, alpha, scatter, score))
    return rows


TRAIN_COLUMNS = ("train", "touches", "from", "to", "α", "e scatters by", "ln odds of a ball")


def _trains(s: TouchTimes) -> list[str]:
    """Lines of all trains heard and how to choose one; empty where there is one, or none."""
    if len(s.heard) < 2:
        return []
    return [
        "",
        *table(TRAIN_COLUMNS, trains_of(s)),
        "choose one with --touches A, --touches B, --touches A2:14 ...",
    ]


def _laws(result: FitResult) -> list[str]:
    """The table of all laws with their odds."""
    rows = [
        (fit.law.name, LAWS[fit.law.name].formula, f"{fit.log_evidence:.2f}", odds_text(odds))
        for fit, odds in zip(result.fits, result.odds, strict=True)
    ]
    return table(("law", "e", "ln likelihood", "odds"), rows)


def odds_text(odds: float) -> str:
    """ "27 : 1"."""
    if odds >= 1:
        return f"{odds:.3g} : 1"
    return f"1 : {1 / odds:.3g}"


def _budget(result: FitResult) -> list[str]:
    """Lines of the error budget, and of what is not in it."""
    budget = result.budget
    name, unit = budget.parameter, ""
    if name == "alpha":
        name, unit = "α", " s/m"
    elif name == "restitution":
        name = "e"
    rows = [(row.source, row.kind, f"{row.share:.2g}{unit}") for row in budget.rows]
    lines = table(("where it comes from", "type", f"adds to {name}"), rows)
    if budget.left_out:
        change = f"{budget.left_out:+.2g}{unit}"
        lines.append(f"left out: contacts; 0.1 ms each would change {name} by {change}")
    if any(s.depends_on_setup for s in result.sets) and not result.sets[0].setup.has_air:
        lines.append(
            "left out: the air, which --mass and --diameter take in; table tennis balls need it"
        )
    return lines


def as_record(result: FitResult) -> dict[str, Any]:
    """Record of the fit for `--json`; None for numbers that do not apply.

    Speeds are m/s, α s/m; intervals are pairs of their ends.
    """
    best = result.best
    alpha = result.alpha
    e = result.restitution
    files = []
    noises = []
    for s, noise in zip(result.sets, best.noise, strict=True):
        speeds, _ = s.pairs()
        files.append({"name": s.name, "kind": s.kind, "impacts": len(speeds)})
        is_given = s.known_noise is not None
        noises.append({"file": s.name, "value": noise, "unit": s.noise_unit, "given": is_given})
    laws = []
    for fit, odds in zip(result.fits, result.odds, strict=True):
        parameters = fit.law.describe(tuple(fit.parameters), fit.reference)
        laws.append(
            {
                "law": fit.law.name,
                "log_likelihood": fit.log_evidence,
                "odds": odds,
                "parameters": parameters,
            }
        )
    drops = []
    for drop in result.drops:
        alpha_of_drop = drop.alpha and dataclasses.asdict(drop.alpha)
        drops.append({"file": drop.name, "doubts": list(drop.doubts), "alpha": alpha_of_drop})
    against = []
    if result.against is not None:
        against.append(comparison_record(result.against))
    return {
        "schema": SCHEMA,
        "kind": "hcbench fit",
        "files": files,
        "law": result.law,
        "law_asked": result.asked,
        "doubts": list(result.doubts),
        "reservation": result.reservation,
        "odds_none_of_these_laws": result.lack.odds,
        "alpha_s_per_m": alpha and alpha.value,
        "alpha_standard_uncertainty_s_per_m": alpha and alpha.uncertainty,
        "alpha_interval_95_s_per_m": alpha and [alpha.low, alpha.high],
        "restitution": e and e.value,
        "restitution_standard_uncertainty": e and e.uncertainty,
        "restitution_interval_95": e and [e.low, e.high],
        "constant_loss_e0": result.e0 and dataclasses.asdict(result.e0),
        "speed_range_m_per_s": list(result.speeds),
        "scatter": best.scatter,
        "noise": noises,
        "laws": laws,
        "drops": drops,
        "between_drops": result.between,
        "flagged": list(map(dataclasses.asdict, result.flags)),
        "warnings": list(result.warnings),
        "budget": dataclasses.asdict(result.budget),
        "max_error": limit_of(result),
        "against": against,
    }


def points_text(result: FitResult) -> str:
    """e over speed as a CSV that --points of `tune` and `check` reads."""
    speeds = speeds_over(result, _POINTS)
    law = result.law or f"{result.best.law.name}, the likeliest; others are not ruled out"
    points = zip(speeds, likeliest_e(result, speeds), strict=True)
    rows = [f"{v:.6g},{e:.6g}" for v, e in points]
    return "\n".join([f"# {law}", "speed [m/s],restitution", *rows]) + "\n"


# A fit as a pair of materials, which `material=` and `--material` take.

# Digits of what was measured.
_DIGITS = 6


def material_of(result: FitResult, name: str) -> MaterialPair:
    """The material that a recording shows: α or one e with its 95 % interval, or points of e(v).

    name: the pair, such as "rubber on concrete"; without " on " the second is "floor".
    """
    # Imported here: Pydantic takes long to import, and most fits need none.
    from hcbench.catalogue.material import Citation, MaterialPair

    low, high = (_rounded(v) for v in result.speeds)
    first, _, second = name.partition(" on ")
    files = ", ".join(sanitized(each.name) for each in result.sets)
    law = result.law or f"{result.best.law.name}, the likeliest; others are not ruled out"
    kinds = ", ".join(dict.fromkeys(each.kind for each in result.sets))
    return MaterialPair(
        id=re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "recording",
        name=name,
        bodies=(first.strip() or "body", second.strip() or "floor"),
        speed_range_m_per_s=(low, high),
        measured=f"hcbench fit of {kinds}",
        source=Citation(
            document=f"own recording: {files}", place=f"law: {law}", read_at=files, level="own"
        ),
        **_numbers(result, low, high),
    )


def _numbers(result: FitResult, low: float, high: float) -> dict[str, Any]:
    """α, e or points of a fit, by the keys of a material: of the law that describes it, points for
    any other.

    low, high: speeds, m/s, the first and the last of the points.
    """
    alpha = result.alpha
    if result.is_plain and alpha is not None:
        return {
            "alpha_s_per_m": _rounded(alpha.value),
            "alpha_interval_s_per_m": (_rounded(max(alpha.low, 0.0)), _rounded(alpha.high)),
            "uncertainty": "the interval is that of 95 %",
        }
    e = result.restitution
    if result.law == "constant" and e is not None:
        return {
            "restitution": _rounded(min(e.value, 1.0)),
            "restitution_interval": (_rounded(max(e.low, 0.0)), _rounded(min(e.high, 1.0))),
            "uncertainty": "the interval is that of 95 %",
        }
    speeds = [_rounded(v) for v in speeds_over(result, _POINTS).tolist()]
    # The ends are those of the range, to the last digit.
    speeds[0], speeds[-1] = low, high
    each = likeliest_e(result, np.array(speeds)).tolist()
    return {"points": tuple((v, _rounded(e)) for v, e in zip(speeds, each, strict=True))}


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
