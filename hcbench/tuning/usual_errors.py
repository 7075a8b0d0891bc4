"""Errors of the answers at any α, found once (`make answers`): a page has them without a search.

A row has the answer of `find_answer` at one α. Between two rows a page interpolates the error of one e, if
the rows around lie near a straight line. Errors of settings jump from α to α, because searches converge
elsewhere; they are known only at the rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from hcbench.recipes.recipe import Role, first
from hcbench.sim import registry
from hcbench.system.errors import SettingError
from hcbench.system.files import parse_json, read_text, write_text
from hcbench.terms.units import INCH
from hcbench.tuning import usual
from hcbench.tuning.ask import make_target
from hcbench.tuning.find import exact_from, find_answer
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    from hcbench.recipes.target import Target
    from hcbench.terms.scene import Scene

FILE = Path(__file__).with_name("usual_errors.json")
SCENE = "steel-plane"
STEPS = (1e-3, 2e-3, 1 / 240, 5e-3)
GRAVITIES = (9.81, 0.0)
BANDS = ((), (0.1, 2.0))  # m/s; (): the default of a step
_DIGITS = (*range(10, 20), *range(20, 50, 2), 25, 35, 45, *range(50, 100, 5))  # what people type
_STUDIED = tuple(alpha / INCH for alpha in (0.001, 0.002, 0.004, 0.008, 0.016, 0.032))
_TYPED = (float(f"{digits}e{power}") for power in (-3, -2, -1) for digits in _DIGITS)
ALPHAS = tuple(sorted({*_STUDIED, *(alpha for alpha in _TYPED if _STUDIED[0] < alpha < _STUDIED[-1])}))
FINE_ALPHAS = tuple(float(f"{10 ** (k / 32 - 2):.4g}") for k in range(129))  # 0.01 ... 100 s/m
NEAR, AROUND = 0.05, 8  # relative: how far so many rows around may lie from their line, to trust it

# α s/m; setting and error of "settings", of "constant"; None for no such choice.
Row: TypeAlias = "list[Any]"


class Condition(NamedTuple):
    """Conditions for which the file has errors at any α; SI. band: of impact speeds, () for the
    default of the step.
    """

    engine: str
    timestep: float
    gravity: float
    band: tuple[float, ...]


def row(condition: Condition, alpha: float) -> Row:
    """Answer of `hcbench tune` in these conditions for one α."""
    scene, target = _asked(condition, alpha)
    try:
        answer = find_answer(condition.engine, target, scene)
    except SettingError:
        return [alpha, None, None]
    choices = [answer.of(kind) for kind in ("settings", "constant")]
    return [alpha, *(None if one is None else [one.setting.name, one.max_error] for one in choices)]


def lows(condition: Condition) -> list[list[float]]:
    """Slowest speeds at which the plug-in is exact: pairs of an α, s/m, and the speed up to this α,
    m/s.
    """
    recipe = first(registry.preferred(condition.engine), Role.LAW, "plane", native=False)
    assert recipe is not None
    steps: list[list[float]] = []
    for alpha in FINE_ALPHAS:
        target = _asked(condition, alpha)[1]
        low = float(f"{exact_from(recipe, target):.4g}")
        if not low < target.speed_max:
            break
        if steps and steps[-1][1] == low:
            steps[-1][0] = alpha
        else:
            steps.append([alpha, low])
    return steps


def _asked(condition: Condition, alpha: float) -> tuple[Scene, Target]:
    _, timestep, gravity, band = condition
    return make_target(
        timestep=timestep, alpha=alpha, gravity=gravity, scene=SCENE, speeds=list(band) or None
    )


def line(table: Sequence[Row], i: int) -> list[Any] | None:
    """The settings of one e in the rows around the interval from i to i + 1, and its error at both ends.

    None where one of AROUND rows has no such error, or one that is not near the line through all of them,
    straight over logarithms of both.
    """
    first = max(0, min(i + 1 - AROUND // 2, len(table) - AROUND))
    around = table[first : first + AROUND]
    if any(constant is None for _, _, constant in around):
        return None
    alphas = np.log([_alpha(each) for each in around])
    errors = np.log([error for _, _, (_, error) in around])
    fitted = np.polynomial.Polynomial.fit(alphas, errors, 1)
    if np.abs(np.expm1(errors - fitted(alphas))).max() > NEAR:
        return None
    names = " or ".join(sorted({name for _, _, (name, _) in around}))
    return [names, *(_shortened(math.exp(fitted(math.log(_alpha(each))))) for each in table[i : i + 2])]


def _alpha(one: Row) -> float:
    return float(one[0])


def write(jobs: int = 2) -> None:
    """Find them all again and write the file."""
    engines = usual.file_content()["versions"]
    conditions = [Condition(*each) for each in product(engines, STEPS, GRAVITIES, BANDS)]
    with WorkerPool(jobs) as pool:
        asked = iter(pool.map(_asked_row, list(product(conditions, ALPHAS))))
    lines = [
        json.dumps({**each._asdict(), "lows": lows(each), "rows": [next(asked) for _ in ALPHAS]})
        for each in conditions
    ]
    write_text(FILE, "[\n" + ",\n".join(lines) + "\n]\n")


def errors_of(engines: Collection[str]) -> list[dict[str, Any]]:
    """Each condition of some engines, as JSON for a page.

    names: of settings, by the numbers that the rows have in their place. rows: each with the line of one e
    from its α to the next, None where that is not known.
    """
    return [_for_page(condition) for condition in file_content() if condition["engine"] in engines]


def _for_page(condition: dict[str, Any]) -> dict[str, Any]:
    table, names = condition["rows"], dict[str, int]()
    lines = [*(line(table, i) for i in range(len(table) - 1)), None]
    numbered = [
        [alpha, *(one and [names.setdefault(one[0], len(names)), *one[1:]] for one in (*choices, onward))]
        for (alpha, *choices), onward in zip(table, lines, strict=True)
    ]
    return {**condition, "names": list(names), "rows": numbered}


@lru_cache(maxsize=1)
def file_content() -> list[dict[str, Any]]:
    """The file."""
    known: list[dict[str, Any]] = parse_json(read_text(FILE))
    return known


def _asked_row(question: tuple[Condition, float]) -> Row:
    """A row as the file has it: α in nine digits, errors in four."""
    alpha, *choices = row(*question)
    return [float(f"{alpha:.9g}"), *(each and [each[0], _shortened(each[1])] for each in choices)]


def _shortened(error: float) -> float:
    return float(f"{error:.4g}")
