"""Error budget as the GUM asks: scatter and timing (type A), uncertainty of given values (type B)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hcbench.fitting.linear import reduce
from hcbench.fitting.setup import Known

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.linear import LawFit
    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.terms.impact import Floats

# Contact time, s, for the note on what contact times that were left out would change.
_CONTACT = 1e-4


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """One source of the uncertainty of a parameter.

    kind: "A" or "B".
    uncertainty: its own, standard, SI.

    share: what it adds to the standard uncertainty of the parameter, in the parameter's unit.
    """

    source: str
    kind: str
    uncertainty: float
    share: float


@dataclass(frozen=True, slots=True)
class Budget:
    """Contributions to the uncertainty of one parameter.

    parameter: which one.
    rows: sources.
    left_out: what a contact of 0.1 ms would add to the parameter.
    """

    parameter: str
    rows: tuple[BudgetRow, ...]
    left_out: float

    @property
    def of_inputs(self) -> float:
        """Standard uncertainty from what was given, in quadrature."""
        return float(np.sqrt(sum(row.share**2 for row in self.rows if row.kind == "B")))


def error_budget(fit: LawFit, sets: Sequence[Dataset]) -> Budget:
    """Compute the budget of a law's first named parameter: α, s/m, or e of a constant.

    sets: those that the law was fitted to, in the order of the fit; all have one setup.
    Inputs count where speeds come from flights or drops; each is moved by its standard uncertainty, one at a
    time. Touch times without a contact time also tell what one of 0.1 ms would change.
    """
    name = next(iter(fit.law.describe(tuple(fit.parameters), fit.reference)))
    setup = sets[0].setup
    inputs = []
    if any(s.depends_on_setup for s in sets):
        inputs = list(setup.perturbed())
    setups = [shifted for _, _, shifted in inputs]
    has_touches = any(s.kind in ("times", "sound", "signal") for s in sets)
    is_left_out = setup.contact_time.value == 0.0 and has_touches
    if is_left_out:
        setups.append(replace(setup, contact_time=Known(_CONTACT)))
    moves = _moves(fit, sets, setups)
    at = _value(fit, name, np.zeros(len(fit.parameters)))
    rows = []
    # The last of the moves may be the contact's, which has no row.
    for (source, uncertainty, _), move in zip(inputs, moves, strict=False):
        share = abs(_value(fit, name, move) - at)
        rows.append(BudgetRow(source.replace("_", " "), "B", uncertainty, share))
    left_out = 0.0
    if is_left_out:
        left_out = _value(fit, name, moves[-1]) - at
    return Budget(name, (*_noise_rows(fit, name), *rows), left_out)


def _value(fit: LawFit, name: str, move: Floats) -> float:
    return fit.law.describe(tuple(fit.parameters + move), fit.reference)[name]


def _moves(fit: LawFit, sets: Sequence[Dataset], setups: Sequence[MeasurementSetup]) -> Floats:
    """δ of the law's parameters when the setup changes to each of `setups`: shape (c, q).

    sets: in the order of the fit; their setups are what changes.
    One Newton step from the fit, without a new fit: the changes of the residuals are solved for as
    further right-hand sides.
    """
    q = len(fit.parameters)
    total = np.zeros((q, q + 1 + len(setups)))
    for s, own, latent, model, noise in zip(
        sets, fit.own, fit.latent, fit.models, fit.noise, strict=True
    ):
        # Changes of the residual and of the prior's offsets by each setup.
        residuals = np.empty((len(setups), len(model.residual)))
        offsets = np.empty((len(setups), len(own)))
        for i, setup in enumerate(setups):
            shifted = s.with_setup(setup).linearise(fit.curve, own, latent)
            residuals[i] = shifted.residual - model.residual
            offsets[i] = shifted.prior[:, 0] - model.prior[:, 0]
        reduced = reduce(model, residuals.T, offsets)
        matrix, _ = reduced.profile(np.array(fit.scatter), np.array(noise))
        total += matrix[:q]
    # Column q belongs to the residual itself, which no input moves.
    hessian = total[:, :q]
    slopes = total[:, q + 1 :]
    return np.asarray(np.linalg.lstsq(hessian, slopes, rcond=1e-12)[0].T)


def _noise_rows(fit: LawFit, name: str) -> list[BudgetRow]:
    """Rows of the scatter of e and of the noise of measuring, in this order.

    name: of the parameter, whose unit the share of each row has.
    The posterior's spread is divided as the variances of both divide it. The second row's
    uncertainty is the noise s_m of the first data set.
    """
    posterior = fit.posterior
    values = fit.values(name)
    mean = float(values @ posterior.weight)
    spread = float(np.sqrt((values - mean) ** 2 @ posterior.weight))
    scatter = noise = 0.0
    q = len(fit.parameters)
    # By central differences: only its direction matters below.
    direction = np.empty(q)
    for i, unit in enumerate(np.eye(q)):
        direction[i] = _value(fit, name, 1e-6 * unit) - _value(fit, name, -1e-6 * unit)
    hessian = np.zeros((q, q))
    for reduced, s_m in zip(fit.reduced, fit.noise, strict=True):
        matrix, _ = reduced.profile(np.array(fit.scatter), np.array(s_m))
        hessian += matrix[:q, :q]
    gain: Floats = np.asarray(np.linalg.lstsq(hessian, direction, rcond=1e-12)[0], dtype=float)
    for reduced, s_m in zip(fit.reduced, fit.noise, strict=True):
        by_scatter, by_noise = reduced.variance_parts(fit.scatter, s_m, gain)
        scatter = scatter + by_scatter
        noise = noise + by_noise
    total = scatter + noise or 1.0
    return [
        BudgetRow("scatter of e", "A", fit.scatter, spread * float(np.sqrt(scatter / total))),
        BudgetRow("noise of measuring", "A", fit.noise[0], spread * float(np.sqrt(noise / total))),
    ]
