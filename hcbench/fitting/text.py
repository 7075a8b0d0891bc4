"""Text and JSON of a fit, and its points of e over speed."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.fitting import comparison
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.estimate import ENDS, estimate_of, quantiles
from hcbench.fitting.which_law import FAMILY, LAWS, WITH_E0
from hcbench.system.text import table

if TYPE_CHECKING:
    from hcbench.fitting.estimate import Estimate, LawFit
    from hcbench.fitting.result import FitResult
    from hcbench.terms.impact import Floats

SCHEMA = 1
_POINTS = 20
_BAND_POINTS = 25


def with_uncertainty(value: float, uncertainty: float) -> str:
    """ "0.3127 +- 0.0043": two digits of uncertainty."""
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

    Each of the four arrays has the shape (count,). The band spans the law with and without e0 if
    the data leave that open.
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
    return (
        speeds,
        middle,
        middle - wider * (middle - low),
        np.minimum(middle + wider * (high - middle), 1.0),
    )


def _band_of(fit: LawFit, speeds: Floats) -> Floats:
    """2.5 %, 50 % and 97.5 % of e at each speed: (3, n)."""
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
    """Factor by which the interval of the number that is given is wider than the posterior's.

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
    """The |e - wanted| up to which a model is within the measurement and `more`, rounded up."""
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
    """The main numbers of the fit, by name. Where no law is chosen, each says under which it holds."""
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
    """The law that is chosen, or why none is."""
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
    return "undecided: several laws fit (see below)"


def _shown(estimate: Estimate, unit: str = "") -> str:
    interval = f"95 %: {estimate.low:.4g} ... {estimate.high:.4g}"
    return f"{with_uncertainty(estimate.value, estimate.uncertainty)}{unit}, {interval}{unit}"


def _heard(result: FitResult) -> list[str]:
    """The touches found in recordings."""
    lines = []
    for s in result.sets:
        if isinstance(s, TouchTimes) and s.picks is not None:
            shown = zip(s.picks.numbers, s.picks.times, s.picks.level, strict=True)
            rows = [(f"{n + 1}", f"{t:.5f}", f"{level:.0f}") for n, t, level in shown]
            lines += ["", f"{s.name}: touches heard above {s.picks.band:g} Hz"]
            lines += table(("touch", "s", "dB over the noise"), rows)
            lines += _trains(s)
    return lines


def trains_of(s: TouchTimes) -> list[tuple[str, ...]]:
    """Candidate trains of clicks, a row each: letter, touches, from, to, α, s_e, ln of the odds.

    Trains too short for a fit have neither α nor s_e: "".
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
    """The other trains, where there are any, and how to choose one."""
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
    rows = [(row.source, row.kind, f"{row.share:.2g}{unit}") for row in budget.rows]
    lines = table(("where it comes from", "type", f"adds to {name}"), rows)
    if budget.left_out:
        change = f"{budget.left_out:+.2g}{unit}"
        lines.append(f"left out: contacts; 0.1 ms each would change {name} by {change}")
    if any(s.needs_gravity for s in result.sets) and not result.sets[0].setup.has_air:
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
        against.append(comparison.as_record(result.against))
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
    """e over speed as a CSV that `tune --points` and `check --pairs` read."""
    speeds = speeds_over(result, _POINTS)
    curve = result.best.curve
    law = result.law or f"{result.best.law.name}, the likeliest; others are not ruled out"
    rows = [f"{v:.6g},{min(1.0, curve.at(float(v))):.6g}" for v in speeds]
    return "\n".join([f"# {law}", "speed [m/s],restitution", *rows]) + "\n"
