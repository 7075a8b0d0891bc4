"""Tables of docs/reference/plugins.md, and that of the energy that contact
gains in random scenes, by class.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import binom

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from hcbench.terms.impact import Floats

    Flags = NDArray[np.bool_]

# Of the first energy: more is named by the plug-in.
LARGEST_GAIN = 0.01
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "plugins.md"


@dataclass
class Gains:
    """Each scene's gain of energy over the first, NaN where none is
    known, and what else became of it.

    deeper: than with native contact, m. named: by the plug-in. diverged:
    where native contact does not.
    """

    gain: Floats
    deeper: Floats
    named: Flags
    diverged: Flags

    @classmethod
    def empty(cls, count: int) -> Gains:
        """Return those of scenes not simulated yet."""
        flags = np.zeros((2, count), dtype=bool)
        return cls(np.full(count, np.nan), np.full(count, np.nan), flags[0], flags[1])

    def require_no_more_than(self, mark: str, classes: Mapping[str, list[int]]) -> None:
        """Assert that these scenes are of the page's population, in each class.

        Scenes in which bodies tumble end elsewhere on another processor, whose sums round
        otherwise: so the largest gain of some scenes does not bound the next. The scenes that gain
        more than the page's 99 % are few, as a binomial has them, and none gains more than 1 %.
        """
        said = on_the_page(mark)
        assert not (self.diverged & ~self.named).any()
        assert np.nanmax(self.gain[~self.named], initial=0.0) <= LARGEST_GAIN
        for name, chosen in classes.items():
            quiet = self.gain[[i for i in chosen if not self.named[i]]]
            above = int(np.sum(quiet > float(said[name][3]) / 100))
            # One class in ten thousand has more by chance.
            assert above <= binom.ppf(1 - 1e-4, len(quiet), 0.01), name
        assert self.diverged.sum() <= int(said["all"][8])

    def write(self, mark: str, classes: Mapping[str, list[int]]) -> None:
        """Write the page's table of this mark."""
        lines = [
            "| class | scenes | median, % | 90 %, % | 99 %, % | largest, % | deeper, mm |"
            " named | largest of these, % | NaN | fine of the named, % |",
            "|---|---|---|---|---|---|---|---|---|---|---|",
        ]
        for name, chosen in classes.items():
            seen = np.isfinite(self.gain) & np.isin(np.arange(len(self.gain)), chosen)
            quiet, loud = self.gain[seen & ~self.named], self.gain[seen & self.named]
            cells = [percent(x) for x in np.quantile(quiet, [0.5, 0.9, 0.99, 1.0])]
            depth = np.quantile(self.deeper[seen & ~self.named], 0.99) * 1e3
            worst = percent(np.max(loud, initial=0.0)) if len(loud) else ""
            counts = self.named[chosen].sum(), worst, self.diverged[chosen].sum()
            fine = f"{100 * np.mean(loud <= LARGEST_GAIN):.0f}" if len(loud) else ""
            row = [name, len(quiet), *cells, f"{depth:.1f}", *counts, fine]
            lines.append(f"| {' | '.join(map(str, row))} |")
        write_table(mark, lines)


def write_table(mark: str, lines: list[str]) -> None:
    """Put the lines of a table between the page's marks."""
    begin, end = _marks(mark)
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(begin)
    table = "".join(f"{line}\n" for line in lines)
    PAGE.write_text(f"{head}{begin}{table}{end}{rest.partition(end)[2]}", encoding="utf-8")


def _marks(mark: str) -> tuple[str, str]:
    return f"<!-- begin {mark} -->\n", f"<!-- end {mark} -->"


def on_the_page(mark: str) -> dict[str, list[str]]:
    """The page's cells by class."""
    begin, end = _marks(mark)
    table = PAGE.read_text(encoding="utf-8").split(begin)[1].split(end)[0]
    lines = [
        [cell.strip() for cell in line.split("|")[1:-1]] for line in table.strip().splitlines()[2:]
    ]
    return {cells[0]: cells[1:] for cells in lines}


def percent(share: float) -> str:
    """A share in per cent, rounded up to two digits, from 0.001 % on."""
    digit = 10.0 ** (np.floor(np.log10(max(share, 1e-5))) - 1)
    return f"{100 * np.ceil(max(share, 1e-5) / digit - 1e-9) * digit:.2g}"
