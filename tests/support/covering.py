"""Covering designs: rows of levels in which each pair of levels of two factors comes often."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    Row = dict[str, Any]


def covering_rows(
    factors: Mapping[str, Sequence[Any]], count: int, allowed: Callable[[Row], bool], seed: int = 0
) -> list[Row]:
    """Rows with one level of each factor, by the pairs that came least so far; ties are drawn.

    allowed: of a row that has some of its factors. The first rows of a longer design are those of a shorter.
    """
    rng = np.random.default_rng(seed)
    seen = {
        (one, two): np.zeros((len(factors[one]), len(factors[two])), dtype=int)
        for one, two in combinations(factors, 2)
    }
    rows = []
    for _ in range(count):
        chosen: dict[str, int] = {}
        for name in rng.permutation(list(factors)):
            fits = [
                i
                for i in range(len(factors[name]))
                if allowed({other: factors[other][j] for other, j in chosen.items()} | {name: factors[name][i]})
            ]
            came = [_came(seen, name, i, chosen) + rng.uniform(0, 1e-3) for i in fits]
            chosen[str(name)] = fits[int(np.argmin(came))]
        for one, two in seen:
            seen[one, two][chosen[one], chosen[two]] += 1
        rows.append({name: factors[name][i] for name, i in chosen.items()})
    return rows


def _came(seen: dict[tuple[str, str], Any], name: str, level: int, chosen: dict[str, int]) -> float:
    """How often a level came with those chosen, each in shares of what its pair of factors would have."""
    total = 0.0
    for other, i in chosen.items():
        table = seen[name, other][level] if (name, other) in seen else seen[other, name][:, level]
        total += table[i] * (seen[name, other] if (name, other) in seen else seen[other, name]).size
    return total


def fewest(rows: Sequence[Row], factors: Mapping[str, Sequence[Any]], allowed: Callable[[Row], bool]) -> int:
    """How often the rarest pair of levels comes that may come at all."""
    counts = []
    for one, two in combinations(factors, 2):
        for a in factors[one]:
            for b in factors[two]:
                if allowed({one: a, two: b}):
                    counts.append(sum(row[one] == a and row[two] == b for row in rows))
    return min(counts)
