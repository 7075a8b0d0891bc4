"""Errors of the answers at any α, found once (`make answers`): a page has them without a search.

A row has the answer of `find_answer` at one α. Between two rows a page interpolates the error of
one e, if the rows around lie near a straight line. Errors of settings jump from α to α, because
searches converge elsewhere; they are known only at the rows.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from functools import lru_cache
from itertools import islice, product
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
# Bands of speeds, m/s; () stands for the default of a step.
BANDS = ((), (0.1, 2.0))
# Digits that people type.
_DIGITS = (*range(10, 20), *range(20, 50, 2), 25, 35, 45, *range(50, 100, 5))
# α of the paper's studies, s/m.
_STUDIED = tuple(alpha / INCH for alpha in (0.001, 0.002, 0.004, 0.008, 0.016, 0.032))


def _tabulated_alphas() -> tuple[float, ...]:
    """α of the rows, s/m, rising: those of the studies, and between them those that people type."""
    alphas = set(_STUDIED)
    for power in (-3, -2, -1):
        for digits in _DIGITS:
            typed = float(f"{digits}e{power}")
            if _STUDIED[0] < typed < _STUDIED[-1]:
                alphas.add(typed)
    return tuple(sorted(alphas))


ALPHAS = _tabulated_alphas()
# α of the fine table, s/m: from 0.01 to 100.
FINE_ALPHAS = tuple(float(f"{10 ** (k / 32 - 2):.4g}") for k in range(129))
# A row is trusted if the AROUND rows around it lie within this share of a line.
NEAR = 0.05
AROUND = 8

# α s/m; setting and error of "settings", of "constant"; None for no such choice.
Row: TypeAlias = "list[Any]"


class Condition(NamedTuple):
    """Conditions for which the file has errors at any α; SI.

    band: of impact speeds, () for the default of the step.
    """

    engine: str
    timestep: float
    gravity: float
    band: tuple[float, ...]


def row(condition: Condition, alpha: float) -> Row:
    """Answer of `hcbench tune` in these conditions for one α, s/m, found by a search: a row
    [α, settings, constant].

    The two choices are [name, largest error of e], or None for no such choice and where no recipe
    serves.
    Raises EngineMissing, and EngineFailed where the engine fails.
    """
    scene, target = _asked(condition, alpha)
    try:
        answer = find_answer(condition.engine, target, scene)
    except SettingError:
        return [alpha, None, None]
    cells: Row = [alpha]
    for kind in ("settings", "constant"):
        choice = answer.of(kind)
        cells.append(None if choice is None else [choice.setting.name, choice.max_error])
    return cells


def lows(condition: Condition) -> list[list[float]]:
    """Slowest impact speeds at which the plug-in delivers e exactly, as pairs [α, speed], s/m and
    m/s, in rising order.

    Each speed holds for all α from that of the pair before up to its own. The list ends at the α
    above which the plug-in is exact nowhere in the band.

    condition: engine, step, gravity and band of speeds.
    """
    recipe = first(registry.preferred(condition.engine), Role.LAW, "plane", native=False)
    assert recipe is not None
    steps: list[list[float]] = []
    for alpha in FINE_ALPHAS:
        _, target = _asked(condition, alpha)
        low = float(f"{exact_from(recipe, target):.4g}")
        if not low < target.speed_max:
            break
        # Where the speed is that of the pair before, it holds up to this α, too.
        if steps and steps[-1][1] == low:
            steps[-1][0] = alpha
        else:
            steps.append([alpha, low])
    return steps


def _asked(condition: Condition, alpha: float) -> tuple[Scene, Target]:
    """The scene and the target of a row: one α, s/m, in these conditions."""
    _, timestep, gravity, band = condition
    return make_target(
        timestep=timestep,
        alpha=alpha,
        gravity=gravity,
        scene=SCENE,
        speeds=list(band) or None,
        friction=0.0,
    )


def line(table: Sequence[Row], i: int) -> list[Any] | None:
    """The best constant setting between rows i and i + 1 of the table, and its error of e at both
    ends.

    The errors are read off a straight line, over logarithms of both, through the AROUND rows about
    the interval. The names of all constant settings of those rows are joined by "or". None if one
    of the rows has no constant setting, or an error that is not near the line.
    """
    # Half of the rows on either side of the interval, as far as the table has them.
    first = max(0, min(i + 1 - AROUND // 2, len(table) - AROUND))
    around = table[first : first + AROUND]
    names = set()
    errors = []
    for _alpha_of_row, _settings, constant in around:
        if constant is None:
            return None
        name, error = constant
        names.add(name)
        errors.append(error)
    log_alphas = np.log([_alpha(known_row) for known_row in around])
    log_errors = np.log(errors)
    # By least squares. A page has hundreds of such lines: a general fit takes ten times as long.
    alpha_middle = log_alphas.mean()
    error_middle = log_errors.mean()
    away = log_alphas - alpha_middle
    slope = away @ (log_errors - error_middle) / (away @ away)
    # A difference of logarithms, d, is a relative error of exp(d) - 1.
    off_line = np.expm1(log_errors - error_middle - slope * away)
    if np.abs(off_line).max() > NEAR:
        return None
    ends = []
    for known_row in table[i : i + 2]:
        log_error = error_middle + slope * (math.log(_alpha(known_row)) - alpha_middle)
        ends.append(_shortened(math.exp(log_error)))
    return [" or ".join(sorted(names)), *ends]


def _alpha(known_row: Row) -> float:
    return float(known_row[0])


def write(jobs: int = 2) -> None:
    """Find all rows again and write the file.

    jobs: worker processes. It takes half an hour with `usual.write`, which goes first.
    Raises EngineMissing where an engine of `usual`'s file is not installed, EngineFailed as
    `find_answer`.
    """
    engines = usual.file_content()["versions"]
    conditions = [Condition(*each) for each in product(engines, STEPS, GRAVITIES, BANDS)]
    with WorkerPool(jobs) as pool:
        asked = iter(pool.map(_asked_row, list(product(conditions, ALPHAS))))
    lines = []
    for condition in conditions:
        rows = list(islice(asked, len(ALPHAS)))
        record = {**condition._asdict(), "lows": lows(condition), "rows": rows}
        lines.append(json.dumps(record))
    write_text(FILE, "[\n" + ",\n".join(lines) + "\n]\n")


def errors_of(engines: Collection[str]) -> list[dict[str, Any]]:
    """Each condition of some engines, as JSON for a page.

    names: of settings, by the numbers that the rows have in their place. rows: each with the line
    of one e from its α to the next, None where that is not known.
    """
    return [_for_page(condition) for condition in file_content() if condition["engine"] in engines]


def _for_page(condition: dict[str, Any]) -> dict[str, Any]:
    """A condition of the file in the shorter form that the page loads.

    Its "names" has each setting's name once. Each of its "rows" is [α, settings, constant, constant
    up to the next row]. Of these settings and constants each is [index in "names", error of e], the
    last with the errors at both ends of the way to the next row; or None for none.
    """
    table = condition["rows"]
    numbers: dict[str, int] = {}

    def numbered(cell: Sequence[Any] | None) -> Any:
        if cell is None:
            return None
        name, *errors = cell
        return [numbers.setdefault(name, len(numbers)), *errors]

    rows = []
    for i, (alpha, *choices) in enumerate(table):
        onward = None
        if i + 1 < len(table):
            onward = line(table, i)
        rows.append([alpha, *map(numbered, choices), numbered(onward)])
    return {**condition, "names": list(numbers), "rows": rows}


@lru_cache(maxsize=1)
def file_content() -> list[dict[str, Any]]:
    """The file."""
    known: list[dict[str, Any]] = parse_json(read_text(FILE))
    return known


def _asked_row(question: tuple[Condition, float]) -> Row:
    """A row as the file has it: α in nine digits, errors in four.

    question: the conditions and α, s/m.
    """
    alpha, *choices = row(*question)
    cells: Row = [float(f"{alpha:.9g}")]
    for choice in choices:
        if choice is None:
            cells.append(None)
        else:
            name, error = choice
            cells.append([name, _shortened(error)])
    return cells


def _shortened(error: float) -> float:
    return float(f"{error:.4g}")
