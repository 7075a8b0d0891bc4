"""Every law fitted to the data sets, the law chosen among them, and what
keeps a result from being given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hcbench.fitting.air import AirRivals, rivals_in_air
from hcbench.fitting.budget import error_budget
from hcbench.fitting.estimate import ODDS_TO_DROP, alpha_of, estimate_of, fit_law, widened
from hcbench.fitting.heights import odd_drops, shared_value
from hcbench.fitting.linear import MOST_SCATTER
from hcbench.fitting.misfits import (
    LOW_WEIGHT,
    MOST_OUTLIERS,
    PRIOR_OF_ADHESION,
    LackOfFit,
    adhesion,
    doubted_impacts,
    flagged_touches,
    scatter_widths,
    smooth_change,
)
from hcbench.fitting.readings import ODD_GAIN, ODD_IMPACT, readings_of
from hcbench.fitting.result import DropResult, FitResult
from hcbench.fitting.table import computed
from hcbench.fitting.track import scale_warnings
from hcbench.fitting.which_law import (
    EITHER,
    FAMILY,
    LAWS,
    PLAIN,
    WITH_E0,
    chosen_law,
    laws_left,
    odds_of,
)
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import Estimate, LawFit
    from hcbench.fitting.misfits import Flag
    from hcbench.fitting.readings import TableReading
    from hcbench.terms.impact import Floats

# Impacts that a warning names.
_SHOWN = 4
# Largest scatter of e of one ball's bounces in a row; single impacts of other bodies scatter more.
_MOST_OF_A_TRAIN = 0.05
# The fastest impact of a bouncing ball, m/s: falls of 0.5 mm to 20 m; and of impacts one by one.
_USUAL = (0.1, 20.0)
_USUAL_ALONE = (1e-3, 200.0)
# Half the width of a 95 % interval over the standard uncertainty, of a normal distribution.
_WIDTH_OF_95 = 1.96
# Why a law is not chosen where the air of a light ball does as well.
_OR_AIR = "the law, or a constant e in the air of a light ball: give --mass and --diameter"
_OR_LAW_IN_AIR = "the law in the air of a light ball: give --mass and --diameter"
# The data cannot be right if the posterior has this share at e > 1.
_GAINS = 0.999


def fit(sets: Sequence[Dataset], law: str = "auto") -> FitResult:
    """Fit data sets of one pair of bodies: the law is common to all, and α scatters from set to
    set.

    law: a name in LAWS, or "auto" to try all.
    Raises UserError for another law, for no sets, where no law comes near the data or no finite
    number comes out, and where the bounces gain energy.
    """
    if not isinstance(law, str) or law not in ("auto", *LAWS):
        raise UserError("law", f"{law!r:.80}", f"one of: auto, {', '.join(LAWS)}")
    if not sets:
        raise UserError("files", "none given", "a file of measured bounces")
    with computed(sets[0].name):
        return _fit(sets, law)


@dataclass(frozen=True, slots=True)
class _Fitted:
    """All laws on some data sets.

    fits: by the law's name.
    widths: per data set (m,), how much wider than s_e each of its m values of e scatters.
    flags: touches that stand out.
    impacts: those that count little, where outliers were looked for.
    changes: of the table, in words, where it is not read as it stands.
    rival: the same in another reading that is as likely and gives another result.
    """

    sets: Sequence[Dataset]
    fits: dict[str, LawFit]
    widths: Sequence[Floats]
    flags: tuple[Flag, ...]
    impacts: tuple[str, ...]
    changes: tuple[str, ...] = ()
    rival: _Fitted | None = None

    @property
    def evidence(self) -> dict[str, float]:
        """ln of the evidence of each law, by name."""
        return {name: one.log_evidence for name, one in self.fits.items()}

    @property
    def likeliest(self) -> LawFit:
        """The fit of the law with the largest evidence."""
        return max(self.fits.values(), key=lambda one: one.log_evidence)


def _fitted(sets: Sequence[Dataset], reference: float) -> _Fitted:
    """Fits of all laws: with normal scatter; where an impact stands out, with that of a t
    distribution.

    reference: m/s, at which the laws' parameters are defined.
    Raises UserError where no law comes near the data.
    """
    fits = {name: fit_law(law, sets, reference) for name, law in LAWS.items()}
    evidence = [one.log_evidence for one in fits.values()]
    if not all(map(math.isfinite, evidence)):
        raise UserError(
            sets[0].name, "no law comes near the data", "bounces of one ball on one plate"
        )
    best = max(fits.values(), key=lambda one: one.log_evidence)
    flags = tuple(flagged_touches(best, sets))
    if not any(flag.what == "bounced off" for flag in flags):
        return _Fitted(sets, fits, best.width, flags, ())
    widths = scatter_widths(LAWS[WITH_E0], sets, reference)
    impacts = doubted_impacts(sets, widths)
    count = sum(map(len, widths))
    # So many outliers are none: another curve fits the data.
    if len(impacts) > MOST_OUTLIERS * count:
        return _Fitted(sets, fits, best.width, flags, ())
    fits = {name: fit_law(law, sets, reference, widths) for name, law in LAWS.items()}
    return _Fitted(sets, fits, widths, flags, tuple(impacts))


def _read(s: Dataset, reference: float) -> _Fitted:
    """Fits of all laws to one file, in its likeliest reading.

    A reading is a table as it stands, or with a change such as a height left out; it is rated by
    the evidence of its likeliest law, by the prior of its changes, and by its impacts that stand
    out.
    reference: m/s.
    Raises UserError where no law comes near the data in any reading.
    """
    readings = readings_of(s)
    if len(readings) == 1:
        (only,) = readings
        s.require_a_ball()
        return replace(_fitted([only.data], reference), changes=only.changes)
    tried: list[_RatedReading] = []
    for reading in readings:
        try:
            one = _fitted([reading.data], reference)
        except (UserError, ArithmeticError, ValueError):
            # No law fits the table read so.
            continue
        price = reading.log_prior + _price_of_impacts(one)
        tried.append(_RatedReading(one.likeliest.log_evidence + price, one, reading))
    if not tried:
        return _fitted([s], reference)
    tried.sort(key=lambda rated: -rated.score)
    best = tried[0]
    best.reading.data.require_a_ball()
    rival = None
    for other in tried[1:]:
        is_as_likely = other.score > best.score - math.log(_ODDS_TO_READ)
        if is_as_likely and _differ(best.fitted, other.fitted):
            rival = replace(other.fitted, changes=other.reading.changes)
            break
    return replace(best.fitted, changes=best.reading.changes, rival=rival)


class _RatedReading(NamedTuple):
    """A reading of a table, with the fits to it and ln of its posterior odds, not normalised."""

    score: float
    fitted: _Fitted
    reading: TableReading


def _price_of_impacts(one: _Fitted) -> float:
    """ln of the prior odds of the impacts of one file that stand out: of losses, and of gains."""
    price = 0.0
    for relative, wide in zip(one.likeliest.latent[0], one.widths[0], strict=True):
        if wide**-2 < LOW_WEIGHT:
            price += ODD_IMPACT if relative < 0.0 else ODD_GAIN
    return price


# A reading of a table is given alone if all others are this many times less likely.
_ODDS_TO_READ = 100.0
# A difference of e, and a share of α, that two readings of a table may have and still agree.
_SAME_E = 0.01
_SAME_ALPHA = 0.05


def _differ(one: _Fitted, other: _Fitted) -> bool:
    """Say whether two readings of a table give another e, or another α."""
    middle = one.likeliest.reference
    if abs(one.likeliest.curve.at(middle) - other.likeliest.curve.at(middle)) > _SAME_E:
        return True
    alpha = alpha_of(one.fits[PLAIN], one.fits[WITH_E0])
    other_alpha = alpha_of(other.fits[PLAIN], other.fits[WITH_E0]).value
    is_outside = not alpha.low <= other_alpha <= alpha.high
    return is_outside and abs(other_alpha - alpha.value) > _SAME_ALPHA * alpha.value


def _fit(sets: Sequence[Dataset], law: str) -> FitResult:
    """Fit of some data sets.

    law: a law's name, or "auto" for the one that the evidence chooses.
    Where there are doubts or no law fits, and none was asked for, the result has no numbers.
    Raises UserError where no law comes near the data, or where the bounces gain energy.
    """
    speeds = _impact_speeds(sets)
    # The geometric mean, m/s.
    reference = float(np.exp(np.log(speeds).mean()))
    each = [_read(s, reference) for s in sets]
    # As they are read: a reading may leave impacts out.
    sets = [one.sets[0] for one in each]
    speeds = _impact_speeds(sets)
    is_alone = len(each) == 1
    whole = each[0] if is_alone else _together(sets, each, reference)
    _require_loss(sets, whole)
    evidence = whole.evidence
    drops = tuple(_drop(one, evidence, is_alone) for one in each)
    doubts = drops[0].doubts if is_alone else _doubts_of_all(drops)
    in_air = _in_air(sets, whole, _lack(each))
    lack = in_air.lack
    reservation = _reservation(sets, whole, in_air.why_no_law, is_alone)
    chosen: str | None = law
    if law == "auto":
        chosen = chosen_law(evidence)
        if doubts or reservation or lack.is_likely or _may_stick(evidence, lack):
            chosen = None
    fits = sorted(whole.fits.values(), key=lambda one: -one.log_evidence)
    odds = odds_of(evidence)
    flags: list[Flag] = []
    for one in each:
        flags.extend(one.flags)
    result = FitResult(
        sets=tuple(sets),
        asked=law,
        law=chosen,
        fits=tuple(fits),
        odds=tuple(odds[one.law.name] for one in fits),
        alpha=None,
        e0=None,
        restitution=None,
        speeds=(float(speeds.min()), float(speeds.max())),
        budget=error_budget(_of_budget(whole, chosen), sets),
        flags=tuple(flags),
        lack=lack,
        warnings=(*_warnings(whole, each), *scale_warnings(whole.likeliest, sets)),
        doubts=doubts,
        reservation=reservation,
        # The only drop is the result itself.
        drops=() if is_alone else drops,
    )
    if not chosen and (doubts or lack.is_certain):
        return result
    return _with_numbers(result, whole, each, in_air.rivals)


def _impact_speeds(sets: Sequence[Dataset]) -> Floats:
    """Rough speeds of the impacts of all data sets, m/s, (n,)."""
    return np.concatenate([s.pairs()[0] for s in sets])


def _reservation(sets: Sequence[Dataset], whole: _Fitted, why_no_law: str, is_alone: bool) -> str:
    """Reason to give a number but choose no law; "" without one.

    whole: all files together.
    why_no_law: what the air says, "" for nothing.
    is_alone: one file.
    """
    if is_alone and whole.rival is not None:
        return _other_reading(whole)
    if why_no_law:
        return why_no_law
    # One file that can be used on its own takes the reservation from all.
    if all(s.reservation for s in sets):
        return sets[0].reservation
    return ""


class _InAir(NamedTuple):
    """Changes of a result that the air of a light ball may explain.

    rivals: fits in air that the data leave.
    why_no_law: a sentence on why no law is chosen for them; "" where one may be.
    lack: of fit, of the law or of the rival that lacks less.
    """

    rivals: AirRivals
    why_no_law: str
    lack: LackOfFit


def _in_air(sets: Sequence[Dataset], whole: _Fitted, lack: LackOfFit) -> _InAir:
    """The rivals in the air of a light ball, and what they change.

    whole: all files together.
    lack: of the laws in a vacuum.
    """
    left = laws_left(whole.evidence)
    if left.isdisjoint({*FAMILY, "constant"}):
        return _InAir(AirRivals(), "", lack)
    # Where other laws are left too, α is still printed.
    air = rivals_in_air(sets, whole.fits, whole.widths)
    if "constant" in left:
        return _InAir(air, "", lack)
    why_no_law = ""
    if air.constant is not None:
        why_no_law = _OR_AIR
    elif air.law is not None and lack.is_likely:
        why_no_law = _OR_LAW_IN_AIR
    if len(sets) == 1:
        for rival in filter(None, (air.constant, air.law)):
            log_odds, _ = smooth_change(rival, sets[0])
            lack = replace(lack, odds=min(lack.odds, math.exp(log_odds)))
    return _InAir(air, why_no_law, lack)


def _together(sets: Sequence[Dataset], each: Sequence[_Fitted], reference: float) -> _Fitted:
    """Fits of all files at once; evidence: the product over files, each with parameters of its own.

    each: the files by themselves.
    reference: m/s. Flags and outliers are those of the single files.
    """
    widths: list[Floats] = []
    for one in each:
        widths.extend(one.widths)
    fits = {}
    for name, law in LAWS.items():
        log_evidence = sum(one.fits[name].log_evidence for one in each)
        fits[name] = replace(fit_law(law, sets, reference, widths), log_evidence=log_evidence)
    return _Fitted(sets, fits, widths, (), ())


def _require_loss(sets: Sequence[Dataset], whole: _Fitted) -> None:
    """Raises UserError where bounces gain energy beyond doubt."""
    if whole.fits["constant"].beyond > _GAINS:
        got = "the bounces gain energy: e comes out above 1"
        expected = "bounces that lose some"
        raise UserError(
            sets[0].name, got, expected, "Look at --gravity, --height and the units of the file"
        )


def _lack(each: Sequence[_Fitted]) -> LackOfFit:
    """Lack of fit of all files: the product of their odds, and the shape of the one that fits
    worst.
    """
    lacks = [_lack_of_one(one) for one in each]
    odds = _product([lack.odds for lack in lacks])
    adhesion_odds = _product([lack.adhesion for lack in lacks])
    worst = max(lacks, key=lambda lack: lack.odds)
    return LackOfFit(odds, worst.shape, adhesion_odds)


def _product(odds: Sequence[float]) -> float:
    """The product of odds, by logarithms: finite where that of many files would overflow, or be 0."""
    return math.exp(min(sum(math.log(max(one, 1e-300)) for one in odds), 700.0))


def _lack_of_one(one: _Fitted) -> LackOfFit:
    """Lack of fit of one file: against the law that lacks least of those left; of adhesion against
    the likeliest.

    The law with e0 counts only where it is the likeliest: its linear form would bend upwards, the
    law cannot.
    """
    (s,) = one.sets
    best = one.likeliest
    names = {best.law.name, *(laws_left(one.evidence) - {WITH_E0})}
    log_odds, shape = min(smooth_change(one.fits[name], s) for name in names)
    # ln of the odds of both laws with adhesion against the likeliest without.
    leads = []
    for fit in (one.fits[PLAIN], one.fits["constant"]):
        with_adhesion = adhesion(fit, s) + fit.log_evidence
        leads.append(with_adhesion - best.log_evidence)
    sticks = math.log(PRIOR_OF_ADHESION) + max(leads)
    if sticks > log_odds:
        log_odds = sticks
        shape = "e falls at low speeds, as where bodies stick"
    return LackOfFit(math.exp(min(log_odds, 700.0)), shape, math.exp(min(sticks, 700.0)))


def _other_reading(one: _Fitted) -> str:
    """Words for a table that can be read in two ways."""
    assert one.rival is not None
    said = "; ".join(one.rival.changes) or "it is right as it stands"
    return f"another reading of {one.sets[0].name} is as likely: {said}"


def _spanning(estimate: Estimate, others: Sequence[Estimate]) -> Estimate:
    """The estimate, with an interval that reaches to the ends of the others', and the standard
    uncertainty of one that is as wide; the estimate as it is where theirs lie within its own.
    """
    low = min([estimate.low, *(other.low for other in others)])
    high = max([estimate.high, *(other.high for other in others)])
    if (low, high) == (estimate.low, estimate.high):
        return estimate
    uncertainty = max(estimate.uncertainty, 0.5 * (high - low) / _WIDTH_OF_95)
    return replace(estimate, uncertainty=uncertainty, low=low, high=high)


def _of_budget(whole: _Fitted, chosen: str | None) -> LawFit:
    """The fit whose α, or e of a constant, is given: of the law chosen, else of the
    likelier of those with and without e0.
    """
    laws = {chosen} if chosen else laws_left(whole.evidence)
    if "constant" in laws and not laws & set(FAMILY):
        return whole.fits["constant"]
    if chosen in (PLAIN, WITH_E0):
        return whole.fits[chosen]
    return max((whole.fits[PLAIN], whole.fits[WITH_E0]), key=lambda one: one.log_evidence)


def _drop(one: _Fitted, evidence: dict[str, float], is_alone: bool) -> DropResult:
    """The fit of one file by itself: α, and e if it is constant; None for both where it has doubts.

    evidence: ln of the evidence of each law, of all files together.
    """
    (s,) = one.sets
    doubts = _doubts(one, is_alone)
    if doubts:
        return DropResult(s.name, None, None, doubts)
    alpha = _own_alpha(one, None, evidence, ODDS_TO_DROP)
    return DropResult(s.name, alpha, estimate_of(one.fits["constant"], "restitution"), ())


def _doubts(one: _Fitted, is_alone: bool) -> tuple[str, ...]:
    """Reasons to give no number for a file: those of its data, a scatter from bounce to bounce that
    no ball has, and, for one of several files, another way to read it.
    """
    (s,) = one.sets
    doubts = tuple(s.doubts(one.likeliest))
    scatter = one.likeliest.scatter
    if s.needs_gravity and scatter > _MOST_OF_A_TRAIN and not doubts:
        doubts = (
            f"e varies by {100 * scatter:.2g} % from bounce to bounce, a ball's by 0.1 to 2 %",
        )
    if one.rival is not None and not is_alone:
        doubts = (*doubts, _other_reading(one))
    return doubts


def _may_stick(evidence: dict[str, float], lack: LackOfFit) -> bool:
    """Say whether a loss that seems constant may be adhesion: α is then that of the law with
    either.
    """
    return chosen_law(evidence) == WITH_E0 and lack.may_stick


def _own_alpha(
    one: _Fitted, chosen: str | None, evidence: dict[str, float], odds: float, inputs: float = 0.0
) -> Estimate:
    """α of one file, s/m, by the law chosen, or by those with and without e0 that all files leave.

    chosen: a law's name, or None.
    evidence: ln of each law's, of all files together.
    odds: at which one of the two is ruled out.
    inputs: standard uncertainty of α from what was given, s/m.
    """
    left = laws_left({name: evidence[name] for name in (PLAIN, WITH_E0)}, odds)
    if chosen in (PLAIN, WITH_E0):
        left = {chosen}
    if len(left) == 1:
        estimate = estimate_of(one.fits[left.pop()], "alpha", inputs)
    else:
        estimate = alpha_of(one.fits[PLAIN], one.fits[WITH_E0], inputs, odds)
    return widened(estimate, one.sets[0].widening)


def _doubts_of_all(drops: Sequence[DropResult]) -> tuple[str, ...]:
    """Doubts of several files, each with the name of its file; empty
    where at least one can be used.
    """
    doubts: list[str] = []
    for drop in drops:
        if not drop.doubts:
            return ()
        doubts += [f"{drop.name}: {doubt}" for doubt in drop.doubts]
    return tuple(doubts)


def _with_numbers(
    result: FitResult, whole: _Fitted, each: Sequence[_Fitted], air: AirRivals
) -> FitResult:
    """The result with α, e0 and e of the law that is chosen, or of those left where none is.

    whole: all files together.
    air: what the air may be of it; α reaches down to the one in air.
    each: the files by themselves; only those without doubts give a common α.
    """
    laws = laws_left(whole.evidence) if result.law is None else {result.law}
    used = list(each)
    if result.drops:
        used = [one for one, drop in zip(each, result.drops, strict=True) if drop.alpha]
    # Another reading of the only file, as likely, widens what is given.
    rivals = [one.rival for one in each if one.rival is not None and len(each) == 1]
    over_drops = _OverDrops(estimate=None, between=None, odd=[])
    alpha = None
    if laws & set(FAMILY):
        over_drops = _alpha_of_drops(result, whole, each, used)
        alpha = over_drops.estimate
    if alpha is not None:
        alpha = replace(alpha, low=air.share * alpha.low)
        alpha = _spanning(alpha, [alpha_of(one.fits[PLAIN], one.fits[WITH_E0]) for one in rivals])
    e0 = None
    if laws & {WITH_E0, EITHER}:
        e0 = estimate_of(whole.fits[WITH_E0], "e0")
    restitution = None
    if "constant" in laws:
        constant = _constant_of_drops(whole, used)
        restitution = constant.estimate
        # Drops are compared in α where it is given.
        if over_drops.between is None:
            over_drops = constant
    elif air.constant is not None:
        restitution = _constant_e(air.constant)
    if restitution is not None:
        restitution = _spanning(restitution, list(map(_constant_e, air.constants)))
        of_rivals = [_constant_e(one.fits["constant"]) for one in rivals]
        restitution = _spanning(restitution, of_rivals)
    warnings = [_odd_one(name, off) for name, off in over_drops.odd]
    return replace(
        result,
        alpha=alpha,
        e0=e0,
        restitution=restitution,
        between=over_drops.between,
        warnings=(*result.warnings, *warnings),
    )


def _constant_e(fit: LawFit) -> Estimate:
    """e of the fit of a constant."""
    return estimate_of(fit, "restitution")


@dataclass(frozen=True, slots=True)
class _OverDrops:
    """A number, α in s/m or a constant e, from all drops together.

    estimate: from all drops; None where it is not given.
    between: share of α, or of 1 - e, by which drops differ; None for one drop.
    odd: (file, how far off it is in standard deviations) of drops that do not belong to the others.
    """

    estimate: Estimate | None
    between: float | None
    odd: list[tuple[str, float]]


def _alpha_of_drops(
    result: FitResult, whole: _Fitted, each: Sequence[_Fitted], used: Sequence[_Fitted]
) -> _OverDrops:
    """α, s/m, with what g, height and the like add to its interval, and how drops differ in it.

    whole, each: all files together, and by themselves; a file alone has no `between`.
    used: the drops without doubts.
    """
    chosen = result.law
    evidence = whole.evidence
    inputs = result.budget.of_inputs
    odds = ODDS_TO_DROP
    if not chosen and _may_stick(evidence, result.lack):
        odds = math.inf
    if len(each) == 1:
        return _OverDrops(_own_alpha(whole, chosen, evidence, odds, inputs), None, [])
    own = [_own_alpha(one, chosen, evidence, odds) for one in used]
    shared = shared_value(own)
    alpha = shared.estimate(_relative(inputs, shared.estimate().value))
    return _OverDrops(alpha, shared.between, _odd_files(used, own))


def _relative(uncertainty: float, value: float) -> float:
    """A standard uncertainty as a share of the value; 0 where the value is 0."""
    if not value:
        return 0.0
    return uncertainty / value


def _odd_files(used: Sequence[_Fitted], values: Sequence[Estimate]) -> list[tuple[str, float]]:
    """Names of the files whose value does not go with the others', and by how many standard
    deviations it is off.
    """
    return [(used[k].sets[0].name, off) for k, off in odd_drops(values)]


def _constant_of_drops(whole: _Fitted, used: Sequence[_Fitted]) -> _OverDrops:
    """e of a constant, with what g, height and the like add to its interval, and how drops differ.

    whole: all files together.
    used: the drops without doubts.
    Drops are compared in 1 - e, the share of the speed that is lost.
    """
    inputs = error_budget(whole.fits["constant"], whole.sets).of_inputs
    if len(whole.sets) == 1:
        return _OverDrops(estimate_of(whole.fits["constant"], "restitution", inputs), None, [])
    lost = [_one_minus(_constant_e(one.fits["constant"])) for one in used]
    shared = shared_value(lost)
    lost_by_all = shared.estimate(_relative(inputs, shared.estimate().value))
    return _OverDrops(_one_minus(lost_by_all), shared.between, _odd_files(used, lost))


def _one_minus(estimate: Estimate) -> Estimate:
    """The estimate of 1 less a number: of the share of speed that is lost, 1 - e, or of e by it."""
    return replace(
        estimate,
        value=1.0 - estimate.value,
        low=1.0 - estimate.high,
        high=1.0 - estimate.low,
    )


def _odd_one(name: str, off: float) -> str:
    """Warning of a file whose value differs from the others' by `off` standard deviations, with its
    sign.
    """
    side = "below"
    if off > 0:
        side = "above"
    return (
        f"{name} does not go with the other files: {abs(off):.1f} standard deviations {side} them"
    )


def _implausible(s: Dataset) -> str:
    """A sentence on speeds that balls seldom have, as of ms that are written for s; "" for none."""
    fastest = float(s.pairs()[0].max())
    slow, fast = _USUAL if s.needs_gravity else _USUAL_ALONE
    if slow <= fastest <= fast:
        return ""
    return f"{s.name}: its fastest impact is at {fastest:.2g} m/s: look at the units of the file"


def _warnings(whole: _Fitted, each: Sequence[_Fitted]) -> list[str]:
    """Warnings of what is assumed, of speeds that balls seldom have, of impacts that count little, of
    files left out, and of a scatter beyond what is tried.

    whole: all files together.
    each: the files by themselves.
    """
    warnings = [f"{s.name}: {s.assumed}" for s in whole.sets if s.assumed]
    warnings += filter(None, map(_implausible, whole.sets))
    for one in each:
        name = one.sets[0].name
        if one.impacts:
            shown = ", ".join(one.impacts[:_SHOWN])
            if len(one.impacts) > _SHOWN:
                shown += f" and {len(one.impacts) - _SHOWN} more"
            warnings.append(
                f"these impacts scatter far more than the others and count little: {shown}"
            )
        if one.changes:
            warnings.append(f"{name} is read so: {'; '.join(one.changes)}")
        if len(each) > 1 and (doubts := _doubts(one, is_alone=False)):
            warnings.append(f"{name} is left out: {doubts[0]}")
    if whole.likeliest.scatter > 0.9 * MOST_SCATTER:
        warnings.append(
            f"e scatters by {100 * MOST_SCATTER:.0f} % or more, the end of what is tried"
        )
    return warnings
