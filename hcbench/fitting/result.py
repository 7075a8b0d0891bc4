"""Result of a fit: α, its uncertainty and the sources of that, and the law that the data support."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.fitting.which_law import EITHER, PLAIN, WITH_E0
from hcbench.system.notebook import Drawn

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.fitting.budget import Budget
    from hcbench.fitting.comparison import Comparison
    from hcbench.fitting.datasets import Dataset
    from hcbench.fitting.estimate import Estimate, LawFit
    from hcbench.fitting.flags import Flag
    from hcbench.fitting.lack_of_fit import LackOfFit
    from hcbench.fitting.replay import Replay


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

    law: the one that the data support; None where several are left.
    asked: the one of --law, or "auto".
    fits: every law tried, the likeliest first; odds: of each against the best of the others.
    alpha, e0, restitution: None where the law that they belong to is ruled out or was not asked
    for.
    speeds: range of impact speeds in m/s that the data hold.
    doubts: why neither a law nor α is given although one was fitted.
    reservation: why no law is given.
    lack: the odds that no law fits.
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
        from hcbench.fitting.text import headline

        yield from (f"{name}: {value}" for name, value in headline(self).items())
        if self.against is not None:
            yield self.against.line

    def _rows(self) -> Iterator[dict[str, float]]:
        """e over speed with its 95 % band, as `--write-points` writes it."""
        from hcbench.fitting.text import band

        names = ("speed_m_per_s", "restitution", "restitution_low", "restitution_high")
        for row in zip(*(column.tolist() for column in band(self)), strict=True):
            yield dict(zip(names, row, strict=True))

    def scene(self, engine: str, timestep: float) -> Replay:
        """A scene that bounces as the recording did, tuned as `hcbench tune` does.

        timestep: s.
        """
        from hcbench.fitting.replay import replay

        return replay(self, engine, timestep)

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
