"""What a fit found: α, its uncertainty and where it comes from, and which law the data support."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hcbench.errors import UserError
from hcbench.fitting.budget import Budget, error_budget
from hcbench.fitting.candidates import LAWS
from hcbench.fitting.estimate import fit_law
from hcbench.fitting.flags import Flag, flagged_touches
from hcbench.fitting.table import computed
from hcbench.fitting.track import scale_warnings

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.figure import Figure

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.estimate import LawFit
    from hcbench.impact import Floats

ODDS_TO_TELL, ODDS_OVER_E0 = 25.0, 3.0
_GAINS = 0.999  # share of the posterior at e > 1 from which on the data cannot be right
WITH_E0 = "hunt-crossley with e0"
COVERAGE = 1.959964  # standard deviations on either side of 95 %


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard uncertainty and its 95 % interval, SI."""

    value: float
    uncertainty: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class FitResult:
    """law: the one that the data support; None where several are left. asked: the one of --law, or "auto".

    fits: every law tried, the likeliest first; odds: of each against the best of the others.
    alpha, e0, restitution: None where the law that they belong to is ruled out or was not asked for.
    speeds: range of impact speeds in m/s that the data hold.
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
    warnings: tuple[str, ...] = ()

    def _repr_html_(self) -> str:
        """What was found and the odds of each law, for a notebook."""
        from hcbench.fitting.notebook import as_html

        return as_html(self)

    def plot(self) -> Figure:
        """e over impact speed: the data, and the law with its 95 % band, as a matplotlib figure."""
        from matplotlib.figure import Figure

        from hcbench.fitting.notebook import draw_curve

        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        draw_curve(figure.subplots(), self, "C3", [f"C{i}" for i in (0, 1, 2, 4, 5, 6)])
        return figure

    @property
    def best(self) -> LawFit:
        """The fit of the law chosen, else of the likeliest."""
        name = self.law or self.fits[0].law.name
        return next(fit for fit in self.fits if fit.law.name == name)

    def fit_of(self, name: str) -> LawFit | None:
        """The fit of a law, if it was tried."""
        return next((fit for fit in self.fits if fit.law.name == name), None)

    @property
    def alpha_fit(self) -> LawFit:
        """The fit that α is of: with a constant loss besides where the data ask for one."""
        name = WITH_E0 if self.law == WITH_E0 else "hunt-crossley"
        return self.fit_of(name) or self.best


def fit(sets: Sequence[Dataset], law: str = "auto") -> FitResult:
    """Fit data sets of one pair of bodies, which share the law's parameters.

    law: a name in LAWS, or "auto" to try all. Raises UserError where the data cannot be right.
    """
    if not isinstance(law, str) or law not in ("auto", *LAWS):
        raise UserError("law", f"{law!r:.80}", f"one of: auto, {', '.join(LAWS)}")
    if not sets:
        raise UserError("files", "none given", "a file of measured bounces")
    with computed(sets[0].name):
        return _fit(sets, law)


def _fit(sets: Sequence[Dataset], law: str) -> FitResult:
    speeds = np.concatenate([s.pairs()[0] for s in sets])
    reference = float(np.exp(np.log(speeds).mean()))
    fits = [fit_law(each, sets, reference) for each in LAWS.values()]
    evidence = np.array([f.log_evidence for f in fits])
    if not np.isfinite(evidence).all():
        raise UserError(sets[0].name, "no law comes near the data", "bounces of one ball on one plate")
    _require_loss(sets, fits)
    order = np.argsort(-evidence, kind="stable")
    fits = [fits[i] for i in order]
    odds = tuple(_odds(evidence[order], i) for i in range(len(fits)))
    chosen = law if law != "auto" else _told([f.law.name for f in fits], evidence[order])
    by_name = {f.law.name: f for f in fits}
    best = by_name[chosen] if chosen else fits[0]
    alpha_fit = by_name[WITH_E0 if chosen == WITH_E0 else "hunt-crossley"]
    budget = error_budget(alpha_fit, sets)
    left = _left_over(evidence[order])
    in_question = {f.law.name for f, is_left in zip(fits, left, strict=True) if is_left}

    def has(name: str) -> bool:
        return chosen == name or (chosen is None and name in in_question)

    return FitResult(
        sets=tuple(sets),
        asked=law,
        law=chosen,
        fits=tuple(fits),
        odds=odds,
        alpha=_estimate(alpha_fit, "alpha", budget) if has(alpha_fit.law.name) else None,
        e0=_estimate(by_name[WITH_E0], "e0", None) if has(WITH_E0) else None,
        restitution=_constant(by_name["constant"], sets) if has("constant") else None,
        speeds=(float(speeds.min()), float(speeds.max())),
        budget=budget,
        flags=tuple(flagged_touches(best, sets)),
        warnings=tuple(scale_warnings(best, sets)),
    )


def _require_loss(sets: Sequence[Dataset], fits: Sequence[LawFit]) -> None:
    """Raises UserError where bounces gain energy beyond doubt."""
    constant = next(f for f in fits if f.law.name == "constant")
    if constant.beyond > _GAINS:
        got = "the bounces gain energy: e comes out above 1"
        expected = "bounces that lose some"
        raise UserError(sets[0].name, got, expected, "Look at --gravity, --height and the units of the file")


def _odds(evidence: Floats, i: int) -> float:
    """Of one law against the likeliest of the others."""
    return math.exp(max(-700.0, min(700.0, evidence[i] - float(np.delete(evidence, i).max()))))


def _left_over(evidence: Floats) -> list[bool]:
    return [bool(e > evidence[0] - math.log(ODDS_TO_TELL)) for e in evidence]


def _told(names: Sequence[str], evidence: Floats) -> str | None:
    """The likeliest law, None where another is not far enough behind it.

    eq. (16) and a constant e are both a case of "with e0", which no data can rule out beside them: it does
    not count against them where it is behind. Nor does eq. (16) against it: they are one law, and α with e0
    has the wider interval. The others need less of a lead over it, as it can bend towards any of them.
    """
    best = names[0]
    for name, behind in zip(names[1:], evidence[0] - evidence[1:], strict=True):
        if {best, name} == {WITH_E0, "hunt-crossley"} or (best, name) == ("constant", WITH_E0):
            continue
        if behind < math.log(ODDS_OVER_E0 if name == WITH_E0 else ODDS_TO_TELL):
            return None
    return best


def _estimate(fit: LawFit, name: str, budget: Budget | None) -> Estimate:
    """A parameter from its posterior, with what the inputs add in quadrature."""
    describe: Callable[[tuple[float, ...], float], dict[str, float]] = fit.law.describe
    values = np.array([describe(tuple(p), fit.reference)[name] for p in fit.posterior.parameters])
    low, middle, high = fit.posterior.quantiles(values, (0.025, 0.5, 0.975))
    mean = float(values @ fit.posterior.weight)
    sd = math.sqrt(float((values - mean) ** 2 @ fit.posterior.weight))
    more = 0.0 if budget is None else budget.of_inputs
    down, up = (math.hypot(side, COVERAGE * more) for side in (middle - low, high - middle))
    least, most = (0.0, math.inf) if name == "alpha" else (0.0, 1.0)
    return Estimate(middle, math.hypot(sd, more), max(least, middle - down), min(most, middle + up))


def _constant(fit: LawFit, sets: Sequence[Dataset]) -> Estimate:
    return _estimate(fit, "restitution", error_budget(fit, sets))
