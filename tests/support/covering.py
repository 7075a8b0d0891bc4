"""Covering designs: rows of levels in which each pair of levels of two factors comes often."""

from __future__ import annotations

from collections import Counter
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np
from long_searches import LONG

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    Row = dict[str, Any]
    Factors = Mapping[str, Sequence[Any]]


def covering_rows(
    factors: Factors, count: int, allowed: Callable[[Row], bool], seed: int = 0
) -> list[Row]:
    """Rows with one level of each factor, each level by the pairs that
    came least so far; ties are drawn.

    allowed: of a row that has some of its factors. The first rows of a longer
    design are those of a shorter.
    """
    rng = np.random.default_rng(seed)
    came: Counter[tuple[Any, ...]] = Counter()
    names, rows = list(factors), []
    for _ in range(count):
        row: Row = {}
        for k in rng.permutation(len(names)):
            name = names[k]
            levels = [level for level in factors[name] if allowed({**row, name: level})]
            weight = {other: len(factors[name]) * len(factors[other]) for other in row}
            pairs = [sum(came[name, a, o, b] * weight[o] for o, b in row.items()) for a in levels]
            ties = rng.random(len(levels)) * 1e-3
            row[name] = levels[int(np.argmin(pairs + ties))]
        for (one, a), (two, b) in product(row.items(), repeat=2):
            came[one, a, two, b] += 1
        rows.append({name: row[name] for name in names})
    return rows


def fewest(rows: Sequence[Row], factors: Factors, allowed: Callable[[Row], bool]) -> int:
    """Number of times that the rarest allowed pair of levels comes."""
    came = Counter(pair for row in rows for pair in combinations(row.items(), 2))
    return min(
        came[(one, a), (two, b)]
        for one, two in combinations(factors, 2)
        for a, b in product(factors[one], factors[two])
        if allowed({one: a, two: b})
    )


def every_pair(*factors: Sequence[Any]) -> list[tuple[Any, ...]]:
    """Return rows with a level of each factor, in which each two levels of two factors meet.

    Cases of a test that holds for every row of their product; `make test-all` has that product. The
    row taken is the first of those with the most pairs that have not met yet.
    """
    every = list(product(*(range(len(levels)) for levels in factors)))
    rows = list(every) if LONG else list[tuple[int, ...]]()
    places = list(combinations(range(len(factors)), 2))
    unmet = {(i, row[i], j, row[j]) for row in every for i, j in places}
    while unmet and not LONG:
        most = max(every, key=lambda row: sum((i, row[i], j, row[j]) in unmet for i, j in places))
        unmet -= {(i, most[i], j, most[j]) for i, j in places}
        rows.append(most)
    return [tuple(levels[k] for levels, k in zip(factors, row, strict=True)) for row in rows]
