"""Contacts drawn for many worlds: the engine's own parameters, and how well they were measured to
have what was drawn.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.sim.columns import Whole
from hcbench.sim.model_under_test import Facts, Texts
from hcbench.sim.passivity import MOST_E, MOST_ENERGY
from hcbench.sim.rest import Standing
from hcbench.system.outputs import write_output
from hcbench.system.text import Shown, joined_names
from hcbench.terms.arguments import checked
from hcbench.terms.impact import Floats

Band = tuple[float, float]

# Chance with which measurements as far from the distribution as these would come by luck: below
# it they do not have the distribution (Kolmogorov and Smirnov's test at 5 %).
LEVEL = 0.05
# Where one number is drawn for all worlds, nothing has a distribution: it is met within this.
NEAR_ENOUGH = 0.02
# Version of the file's layout.
LAYOUT = 1


@dataclass(frozen=True, slots=True)
class Certificate:
    """Launches in some of the worlds, with each world's own parameters.

    worlds: their numbers, (c,).
    speeds: launch speeds, m/s, (s,).
    restitution: mean e over the phases of a step, (c, s).
    lowest, highest: e of a single launch in each world, (c,).
    friction: impulse of friction over that of the normal force in a launch that slides throughout,
    (c,), NaN where no launch of the pair does; None where the friction is the model's own.
    unmeasured: why the friction of each pair is not measured, as a clause; "" where it is.
    energy_gained: the largest share of the kinetic energy that a launch gained; at most 0 where
    none did.
    launches: their number.
    """

    worlds: Whole
    speeds: Floats
    restitution: Floats
    lowest: Floats
    highest: Floats
    friction: Floats | None
    unmeasured: tuple[str, ...]
    energy_gained: float
    launches: int


@dataclass(frozen=True, repr=False)
class RandomWorlds(Shown):
    """Contacts of pairs of a model in many worlds.

    parameters: the engine's own, by their names in it; the first axis of each is the world.
    restitution: e drawn for each world, (n,).
    friction: μ, None where it is the model's own.
    bands: of both, as asked.
    facts: of each pair, with what was drawn.
    name: of the family of contacts.
    before, after: how the model stands as it is, and in the worlds at the corners of both bands.
    texts: the lines, and the whole model, to which the parameters belong.
    files: that were written.
    """

    parameters: Mapping[str, Floats]
    restitution: Floats
    friction: Floats | None
    restitution_band: Band
    friction_band: Band | None
    seed: int
    facts: tuple[Facts, ...]
    name: str
    notes: tuple[str, ...]
    certificate: Certificate
    before: Standing
    after: tuple[Standing, ...]
    texts: Texts
    files: tuple[Path, ...] = ()

    def __len__(self) -> int:
        return len(self.restitution)

    @property
    def text(self) -> str:
        """The lines to paste into the model; the parameters belong to a model with them."""
        return self.texts.paste

    @property
    def measured(self) -> Floats:
        """Measured e of each certified world: the mean over phases and speeds, (c,)."""
        return np.asarray(self.certificate.restitution.mean(axis=1))

    @property
    def errors(self) -> Floats:
        """Measured e less the e drawn of each certified world, (c,)."""
        return np.asarray(self.measured - self.restitution[self.certificate.worlds])

    @property
    def friction_errors(self) -> Floats:
        """Measured friction less the μ drawn of each certified world where it was measured; ()
        where none was.
        """
        if self.friction is None or self.certificate.friction is None:
            return np.zeros(0)
        errors = self.certificate.friction - self.friction[self.certificate.worlds]
        return np.asarray(errors[np.isfinite(errors)])

    @property
    def by_speed(self) -> Floats:
        """Mean of e at each speed less the mean of its world, (s,)."""
        return np.asarray((self.certificate.restitution - self.measured[:, None]).mean(axis=0))

    @property
    def chance(self) -> float:
        """Most by which e of one launch differs from its world's, by where in a step it touches and
        by its speed.
        """
        above = self.certificate.highest - self.measured
        below = self.measured - self.certificate.lowest
        return float(np.maximum(above, below).max())

    @cached_property
    def p_restitution(self) -> float:
        """Chance of e as far from uniform as measured; NaN where one e is drawn for all worlds."""
        return p_uniform(self.measured, self.restitution_band)

    @cached_property
    def p_friction(self) -> float:
        """The same of friction; NaN where it is the model's own, one for all worlds, or was not
        measured.
        """
        if self.certificate.friction is None or self.friction_band is None:
            return math.nan
        measured = self.certificate.friction[np.isfinite(self.certificate.friction)]
        return p_uniform(measured, self.friction_band) if len(measured) else math.nan

    @property
    def failures(self) -> list[str]:
        """Reasons why the worlds do not have what was asked, in words; empty where they do.

        They have it if e (and friction) of the launches is uniform over its band, or equals its one
        number; if no launch gains energy; and if no world rests worse than the model as it is.
        """
        found = []
        for name, p, band, errors in (
            ("e", self.p_restitution, self.restitution_band, self.errors),
            ("friction", self.p_friction, self.friction_band, self.friction_errors),
        ):
            if band is not None and p < LEVEL:
                found.append(
                    f"measured {name} is not uniform from {band[0]:g} to {band[1]:g} (p = {p:.2g})"
                )
            elif math.isnan(p) and len(errors) and np.abs(errors).max() > NEAR_ENOUGH:
                found.append(f"measured {name} differs by up to {np.abs(errors).max():.2g}")
        if (
            self.certificate.highest.max() > MOST_E
            or self.certificate.energy_gained > MOST_ENERGY - 1.0
        ):
            found.append(f"a launch gains energy (e up to {self.certificate.highest.max():.3g})")
        found += [f"a world rests worse than the model as it is: {words}" for words in self.worse]
        return found

    @property
    def worse(self) -> list[str]:
        """Quantities at rest that some world makes worse than the model as it is, in words."""
        words: dict[str, None] = {}
        for after in self.after:
            words |= dict.fromkeys(after.rests_worse_than(self.before, self.facts[0].timestep))
        return list(words)

    @checked
    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the parameters and the certificate as an .npz file, whole or not at all.

        force: replace a file that hcbench did not write.
        Raises UserError and OutputError.
        """
        path = Path(path)
        write_output(path, self.archive(), "--out", force)
        return path

    def archive(self) -> bytes:
        """Bytes of the .npz file; the same for the same worlds."""
        certificate = self.certificate
        arrays: dict[str, Any] = dict(self.parameters)
        arrays["restitution"] = self.restitution
        arrays["certified"] = certificate.worlds
        arrays["speeds"] = certificate.speeds
        arrays["measured_restitution"] = certificate.restitution
        if self.friction is not None and certificate.friction is not None:
            arrays["friction"] = self.friction
            arrays["measured_friction"] = certificate.friction
        arrays["about"] = np.array(json.dumps(self.about, sort_keys=True))
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)
        return buffer.getvalue()

    @property
    def about(self) -> dict[str, Any]:
        """Description of the worlds as the file has it, SI."""
        first = self.facts[0]
        return {
            "layout": LAYOUT,
            "kind": "hcbench worlds",
            "engine": first.engine,
            "version": first.version,
            "model": first.model,
            "pairs": [list(facts.pair) for facts in self.facts],
            "timestep_s": first.timestep,
            "gravity_m_per_s2": list(first.gravity),
            "effective_mass_kg": [facts.effective_mass for facts in self.facts],
            "contact": self.name,
            "restitution": list(self.restitution_band),
            "friction": None if self.friction_band is None else list(self.friction_band),
            "seed": self.seed,
            "lines": self.text,
        }

    def written_to(self, files: tuple[Path, ...]) -> RandomWorlds:
        """The same worlds, with the files that they were written to."""
        return replace(self, files=files)

    def _lines(self) -> Iterator[str]:
        """Yield lines for a terminal: what was drawn, and how well it was measured."""
        low, high = self.restitution_band
        yield f"{self.facts[0].model}: {len(self)} worlds, {self.name}"
        yield f"e from {low:g} to {high:g}, measured within {np.abs(self.errors).max():.2g}"
        if self.friction_band is not None:
            low, high = self.friction_band
            measured = ", not measured"
            if len(self.friction_errors):
                measured = f", measured within {np.abs(self.friction_errors).max():.2g}"
            yield f"friction from {low:g} to {high:g}{measured}"
        yield f'parameters: {", ".join(self.parameters)}; .save("params.npz") writes them'
        for path in self.files:
            yield f"written: {path}"

    def _rows(self) -> Iterator[dict[str, Any]]:
        measured = dict(zip(self.certificate.worlds.tolist(), self.measured.tolist(), strict=True))
        for world, e in enumerate(self.restitution.tolist()):
            row = {"world": world, "restitution": e, "measured": measured.get(world, math.nan)}
            if self.friction is not None:
                row["friction"] = float(self.friction[world])
            yield row

    @property
    def pairs(self) -> list[str]:
        """Names of the pairs, as options take them."""
        return [joined_names(facts.pair) for facts in self.facts]


def p_uniform(values: Floats, band: Band) -> float:
    """Chance that values drawn uniformly over a band lie as far from uniform as these, by the test
    of Kolmogorov and Smirnov.

    values: (n,).
    band: lowest and highest, in the unit of the values. NaN for a band of one number. It takes the
    distribution for large n: SciPy's `kstest` gives the same to 1e-3 from 40 on.
    """
    low, high = band
    if not high > low:
        return math.nan
    from scipy.special import kolmogorov

    share = np.clip((np.sort(values) - low) / (high - low), 0.0, 1.0)
    count = len(share)
    above = np.arange(1, count + 1) / count - share
    below = share - np.arange(count) / count
    farthest = max(float(above.max()), float(below.max()))
    return float(kolmogorov(math.sqrt(count) * farthest))
