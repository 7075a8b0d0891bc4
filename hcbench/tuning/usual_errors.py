"""Errors of the answers at any α, found once (`make answers`): a page tells them without a search.

A row is what `find_answer` says at one α; rows are added until those on both sides of one tell its errors.
Where they do not, as where the answer is another setting, the errors between two rows are left unknown.
"""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Sequence
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from hcbench._files import parse_json, read_text, write_text
from hcbench.errors import SettingError
from hcbench.recipes.recipe import Role, first
from hcbench.sim import registry
from hcbench.tuning import usual
from hcbench.tuning.ask import make_target
from hcbench.tuning.find import exact_from, find_answer
from hcbench.units import INCH
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    from hcbench.recipes.target import Target
    from hcbench.scene import Scene

FILE = Path(__file__).with_name("usual_errors.json")
SCENE = "steel-plane"
STEPS = (1e-3, 2e-3, 1 / 240, 5e-3)
GRAVITIES = (9.81, 0.0)
BANDS = ((), (0.1, 2.0))  # m/s; (): the default of a step
ALPHAS = tuple(alpha / INCH for alpha in (0.001, 0.002, 0.004, 0.008, 0.016, 0.032))
FINE_ALPHAS = tuple(float(f"{10 ** (k / 32 - 2):.4g}") for k in range(129))  # 0.01 ... 100 s/m
NEAR = 0.05  # relative: how far an error in the middle may lie from the line between two
_HALVINGS = 3

# α s/m; setting and error of "settings", of "constant"; whether this and the next row tell what lies between.
Row: TypeAlias = "list[Any]"


class Condition(NamedTuple):
    """Where the file knows errors at any α; SI. band: of impact speeds, () for the default of the step."""

    engine: str
    timestep: float
    gravity: float
    band: tuple[float, ...]


def row(condition: Condition, alpha: float) -> Row:
    """What `hcbench tune` says there of one α."""
    scene, target = _asked(condition, alpha)
    try:
        answer = find_answer(condition.engine, target, scene)
    except SettingError:
        return [alpha, None, None]
    choices = [answer.of(kind) for kind in ("settings", "constant")]
    return [alpha, *(None if one is None else [one.setting.name, one.max_error] for one in choices)]


def lows(condition: Condition) -> list[list[float]]:
    """Where the plug-in's band begins: pairs of an α, s/m, up to which it is a speed, m/s."""
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


def rows(condition: Condition) -> list[Row]:
    """Rows in the order of α."""
    known = {alpha: row(condition, alpha) for alpha in ALPHAS}
    open_intervals = list(pairwise(ALPHAS))
    for _ in range(_HALVINGS):
        halves = []
        for low, high in open_intervals:
            between = math.sqrt(low * high)
            known[between] = row(condition, between)
            if not all(_is_told(known[low], known[between], known[high], kind) for kind in (1, 2)):
                halves += [(low, between), (between, high)]
        open_intervals = halves
    ordered = [known[alpha] for alpha in sorted(known)]
    return [[*each, _joined(ordered, i)] for i, each in enumerate(ordered)]


def _joined(ordered: Sequence[Row], i: int) -> list[bool]:
    """Of each kind, whether rows i and i + 1 lie on the line between their neighbours."""
    inner = [k for k in (i, i + 1) if 0 < k < len(ordered) - 1 and i + 1 < len(ordered)]
    return [
        bool(inner) and all(_is_told(ordered[k - 1], ordered[k], ordered[k + 1], kind) for k in inner)
        for kind in (1, 2)
    ]


def _is_told(left: Row, middle: Row, right: Row, kind: int) -> bool:
    """Whether an error lies on a line over log α between two others; none where they have none."""
    if left[kind] is None or middle[kind] is None or right[kind] is None:
        return left[kind] is middle[kind] is right[kind]
    share = math.log(middle[0] / left[0]) / math.log(right[0] / left[0])
    error = left[kind][1] + share * (right[kind][1] - left[kind][1])
    same = left[kind][0] == middle[kind][0] == right[kind][0]
    return bool(same and math.isclose(error, middle[kind][1], rel_tol=NEAR))


def write(jobs: int = 2) -> None:
    """Find them all again and write the file."""
    engines = usual.file_content()["versions"]
    conditions = [Condition(*each) for each in product(engines, STEPS, GRAVITIES, BANDS)]
    with WorkerPool(jobs) as pool:
        tables = pool.map(rows, conditions)
    lines = [
        json.dumps({**each._asdict(), "lows": lows(each), "rows": [_shortened(one) for one in table]})
        for each, table in zip(conditions, tables, strict=True)
    ]
    write_text(FILE, "[\n" + ",\n".join(lines) + "\n]\n")


def errors_of(engines: Collection[str]) -> list[dict[str, Any]]:
    """Each condition of some engines with its rows, as JSON."""
    return [condition for condition in file_content() if condition["engine"] in engines]


@lru_cache(maxsize=1)
def file_content() -> list[dict[str, Any]]:
    """The file."""
    known: list[dict[str, Any]] = parse_json(read_text(FILE))
    return known


def _shortened(one: Row) -> Row:
    """An α in nine digits, errors in four."""
    errors = [each and [each[0], float(f"{each[1]:.4g}")] for each in one[1:3]]
    return [float(f"{one[0]:.9g}"), *errors, one[3]]
