"""Runs cases in engines that have an adapter, and judges results of any engine in any language:
verdicts, how far e is obeyed, regressions.
"""

from __future__ import annotations

import ast
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hcbench.cases.hcbench_cases import (
    CASES,
    LIMIT,
    VZ,
    Json,
    joined,
    judge,
    load,
    restitution,
    run_apart,
)
from hcbench.cases.schema import Obedience, Rebound, validated
from hcbench.environments import run_with_parent
from hcbench.sim import registry
from hcbench.sim.remote import RemoteEngine
from hcbench.system.errors import EngineFailed, UserError
from hcbench.system.files import parse_json, read_text
from hcbench.system.text import sanitized

KNOWN = Path(__file__).with_name("known.json")
MEASURED = Path(__file__).with_name("measured.json")
# Cases of slow impacts under gravity, and of the depth in an impact.
_SLOW = "C02"
_DEPTH = "C16"
# In restitutions asked for: less does not count as a bounce.
_HALF = 0.5
# Characters of a reason that an engine's file gives.
_LONGEST_WHY = 1000
# In e. Over all restitutions asked for, a smaller range of the mean takes no notice of them.
_ALIKE = 0.02


def the_cases(only: Sequence[str] = ()) -> Json:
    """The set of cases, or those of these ids, in the order of the set; all where `only` is empty.

    Raises UserError for an id that it has not.
    """
    whole = load(CASES)
    ids = [case["id"] for case in whole["cases"]]
    for name in only:
        if name not in ids:
            raise UserError("--case", repr(name), f"one of {ids[0]} ... {ids[-1]}")
    if not only:
        return whole
    chosen = [case for case in whole["cases"] if case["id"] in only]
    return {**whole, "cases": chosen}


def known_failures() -> dict[str, dict[str, str]]:
    """Cases that the engines with an adapter here are known to fail: {engine: {case: reason}}."""
    return dict(parse_json(read_text(KNOWN)))


@dataclass(frozen=True, slots=True)
class EngineScore:
    """Score of one engine's results.

    verdicts: of `hcbench_cases.judge`.
    restitution: "obeyed"; "soft", where it is obeyed deep in the floor; "threshold", where it is
    obeyed above a speed; "ignored", where the number makes no difference; "mixed"; or None where
    the first case was not run.
    threshold: the highest impact speed under gravity that did not bounce, m/s; 0 where all did.
    gravity: the rebound of an impact under gravity, "e v" or "e (v + g h)"; None where it is
    neither.
    """

    engine: str
    version: str
    verdicts: tuple[Json, ...]
    restitution: Obedience | None
    threshold: float
    gravity: Rebound | None
    cpu_s: float

    @property
    def name(self) -> str:
        """Name of the engine with its version."""
        return f"{self.engine} {self.version}".strip()

    @property
    def passed(self) -> int:
        """Number of cases the engine passes."""
        return sum(verdict["verdict"] == "pass" for verdict in self.verdicts)

    def as_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        names = ("engine", "version", "passed", "restitution", "threshold", "gravity", "cpu_s")
        return {name: getattr(self, name) for name in (*names, "verdicts")}


def score(results: Json, source: str = "results", only: Sequence[str] = ()) -> EngineScore:
    """Judge the results of one engine, in all cases or in `only` these.

    source: slot of errors.
    Raises UserError for anything else than results of these cases, and for an unknown case.
    """
    cases = the_cases(only)
    validated(results, "results", source)
    if results["set"] != cases["set"]:
        raise UserError(source, f"results of {results['set']!r}", f"of {cases['set']!r}")
    for case in cases["cases"]:
        _require_runs(case, results["runs"].get(case["id"], []), source)
    verdicts = judge(results, cases)
    try:
        obeyed, threshold = _obedience(results["runs"], cases, verdicts)
    except (ArithmeticError, ValueError) as error:
        raise UserError(
            source, f"a ball at rest before an impact: {error}", "states of the cases"
        ) from None
    printable = []
    for verdict in verdicts:
        why = sanitized(verdict["why"], _LONGEST_WHY)
        printable.append({**verdict, "why": why})
    engine = results["engine"]
    return EngineScore(
        engine=sanitized(engine["name"]),
        version=sanitized(engine["version"]),
        verdicts=tuple(printable),
        restitution=obeyed,
        threshold=threshold,
        gravity=_rebound_under_gravity(results["runs"], cases),
        cpu_s=float(results.get("cpu_s", 0.0)),
    )


def _require_runs(case: Json, done: Sequence[Json], source: str) -> None:
    """Refuse results of a case where runs are missing, or a run has other states than the case asks
    for, by UserError.

    done: results, one for each run of the case, in order.
    source: name of the file in the error.
    """
    if len(done) != len(case["runs"]):
        got = f"{len(done)} of {len(case['runs'])} runs"
        advice = "Name the cases of the file by `--case`"
        raise UserError(f"{source}: {case['id']}", got, "all of them", advice)
    for number, (each, result) in enumerate(zip(case["runs"], done, strict=True)):
        slot = f"{source}: {case['id']}, run {number}"
        if len(result) != 1:
            raise UserError(slot, " and ".join(result) or "nothing", "states, unsupported or error")
        if "states" in result:
            _require_states(each, result["states"], slot)


def _require_states(each: Json, states: Sequence[Sequence[Any]], slot: str) -> None:
    """Raise UserError for states after other steps, or of more or fewer bodies, than a run asks
    for.

    slot: of the error.
    states: of each step [step, state of a body, ...].
    """
    wanted: list[int] = []
    for first, last in each["record"]:
        wanted.extend(range(first, last + 1))
    if [step for step, *_ in states] != wanted:
        spans = ", ".join(f"{first} ... {last}" for first, last in each["record"])
        raise UserError(slot, "states after other steps", f"those after steps {spans}")
    moving = sum(not body.get("fixed") for body in each["world"]["bodies"])
    for step, *bodies in states:
        if len(bodies) != moving:
            raise UserError(f"{slot}, step {step}", f"{len(bodies)} bodies", str(moving))


def read_scores(path: Path, only: Sequence[str] = ()) -> list[EngineScore]:
    """Scores of a file of results, which holds one object or a list, in all cases or in `only`
    these.

    Raises UserError for a file that cannot be read, for anything but results, and for an unknown
    case.
    """
    try:
        content = parse_json(read_text(path))
    except OSError as error:
        raise UserError(
            str(path), error.strerror or "cannot be read", "a JSON file of results"
        ) from None
    except ValueError:
        raise UserError(str(path), "not JSON", "a JSON file of results") from None
    if not content:
        raise UserError(str(path), "nothing in it", "the results of an engine, or a list of them")
    if not isinstance(content, list):
        content = [content]
    return [score(each, str(path), only) for each in content]


def measured() -> list[EngineScore]:
    """Scores of the engines and versions that were measured for the pages, in the order of the file
    `measured.json` that ships with hcbench. Raises UserError if the file is not of this form.
    """
    scores = []
    for each in validated(parse_json(read_text(MEASURED)), "scores", MEASURED.name):
        one = EngineScore(
            engine=each["engine"],
            version=each["version"],
            verdicts=tuple(each["verdicts"]),
            restitution=each["restitution"],
            threshold=each["threshold"],
            gravity=each["gravity"],
            cpu_s=each["cpu_s"],
        )
        scores.append(one)
    return scores


def newest(scores: Sequence[EngineScore]) -> list[EngineScore]:
    """The scores of the newest version of each engine, where the versions are in their order."""
    return list({each.engine: each for each in scores}.values())


def matrix(scores: Sequence[EngineScore] | None = None) -> list[dict[str, str]]:
    """A row of words for each engine: name, version, a verdict by the id of each case, how many
    passed.

    scores: those of `measured`, in the newest version of each engine, where None. "restitution" and
    "gravity" of a row are those of EngineScore, or "".
    """
    if scores is None:
        scores = newest(measured())
    rows = []
    for each in scores:
        row = {"engine": each.engine, "version": each.version}
        for verdict in each.verdicts:
            row[verdict["case"]] = verdict["verdict"]
        row["passed"] = f"{each.passed} of {len(each.verdicts)}"
        row["restitution"] = each.restitution or ""
        row["gravity"] = each.gravity or ""
        rows.append(row)
    return rows


def _obedience(runs: Json, cases: Json, verdicts: Sequence[Json]) -> tuple[Obedience | None, float]:
    """Obedience to the restitution asked for, and the speed, m/s, up to which nothing bounces.

    "obeyed", or "soft" where bodies sink in; else "ignored" where e is the same for all asked for,
    "threshold" where it is as asked for above that speed, "mixed" for all else.

    runs: results by case.
    verdicts: on the cases, in their order. By the first two cases: normal impacts without gravity,
    then slow ones under it. None and 0 where they were not run, or have no numbers.
    Raises ValueError or ArithmeticError for states of a ball that does not move before an impact.
    """
    ids = [case["id"] for case in cases["cases"]]
    if ids[:2] != ["C01", "C02"]:
        return None, 0.0
    normal, slow, *_ = cases["cases"]
    measured = list(_restitutions(normal, runs.get(normal["id"], [])))
    under_gravity = list(_restitutions(slow, runs.get(slow["id"], [])))
    silent = _silent_speeds(under_gravity)
    threshold = max(silent, default=0.0)
    first, second, *_ = verdicts
    if first["verdict"] == second["verdict"] == "pass":
        for verdict in verdicts:
            if verdict["case"] == _DEPTH and verdict["verdict"] == "fail":
                return "soft", threshold
        return "obeyed", threshold
    if not measured:
        return None, 0.0
    if _range_of_means(measured) < _ALIKE:
        return "ignored", threshold
    # From here on impacts without gravity count, too.
    silent += _silent_speeds(measured)
    threshold = max(silent, default=0.0)
    if silent:
        tolerance = normal["tolerance"]["restitution"]["value"]
        above = [impact for impact in measured if impact.speed > threshold]
        if above and all(abs(impact.e - impact.asked) <= tolerance for impact in above):
            return "threshold", threshold
    return "mixed", threshold


def _rebound_under_gravity(runs: Json, cases: Json) -> Rebound | None:
    """Speed that the engine multiplies by e: that at the start of the step, or at its end; None for
    neither.

    By the velocities before and after the step that turns the ball, in all runs of the slow
    impacts.
    """
    by_start: list[float] = []
    by_end: list[float] = []
    slow = [case for case in cases["cases"] if case["id"] == _SLOW]
    for case in slow:
        for each, result in zip(case["runs"], runs.get(_SLOW, []), strict=False):
            if "states" not in result:
                continue
            *_, gravity_z = each["world"]["gravity"]
            gained = -gravity_z * each["world"]["timestep"]  # speed of a step of fall, m/s
            upward = [body[VZ] for _, body, *_ in result["states"]]  # m/s
            # The first state that rises; a ball that rises from the first on, or never, tells nothing.
            turned = next((i for i, v in enumerate(upward) if v > 0), 0)
            if turned == 0:
                return None
            start = -upward[turned - 1]
            if start <= 0:
                return None
            e = each["world"]["restitution"]
            # Errors of the two readings, as shares of the speed.
            by_start.append(abs(upward[turned] - e * start) / start)
            by_end.append(abs(upward[turned] - e * (start + gained)) / start)
    if by_start and max(by_start) < _ALIKE:
        return "e v"
    if by_end and max(by_end) < _ALIKE:
        return "e (v + g h)"
    return None


def _silent_speeds(impacts: Sequence[_CaseBounce]) -> list[float]:
    """Speeds, m/s, of the impacts after which nothing bounces."""
    return [impact.speed for impact in impacts if impact.is_silent]


def _range_of_means(measured: Sequence[_CaseBounce]) -> float:
    """Range of the mean e over all restitutions that are asked for."""
    by_asked: dict[float, list[float]] = {}
    for impact in measured:
        by_asked.setdefault(impact.asked, []).append(impact.e)
    means = [sum(values) / len(values) for values in by_asked.values()]
    return max(means) - min(means)


class _CaseBounce(NamedTuple):
    """Impact of a case: its speed, m/s, and the restitution that is asked for and that is measured."""

    speed: float
    asked: float
    e: float

    @property
    def is_silent(self) -> bool:
        """True if it does not count as a bounce."""
        return self.e < _HALF * self.asked


def _restitutions(case: Json, results: Sequence[Json]) -> Iterator[_CaseBounce]:
    """Yield the impact of each run of a case that has states; runs that were not supported have
    none.

    results: of the runs, in order.
    Raises ValueError or ArithmeticError for states of a ball that does not move before an impact.
    """
    for each, result in zip(case["runs"], results, strict=False):
        if "states" not in result:
            continue
        world = each["world"]
        ball, *_ = world["bodies"]
        *_, gravity_z = world["gravity"]
        *_, velocity_z = ball["velocity"]
        *_, height = ball["position"]
        # At the touch, by the energy of the fall from where the ball starts.
        speed = math.sqrt(velocity_z**2 - 2.0 * gravity_z * (height - ball["radius"]))
        yield _CaseBounce(speed, world["restitution"], restitution(each, result["states"]))


def regressions(scores: Sequence[EngineScore]) -> list[str]:
    """Lines of cases that passed in a version of an engine and have another verdict in the next, or
    back.

    scores: of each engine in the order of its versions; all of the same cases, or ValueError is
    raised.
    """
    lines = []
    last = dict[str, EngineScore]()
    for now in scores:
        before = last.get(now.engine)
        last[now.engine] = now
        if before is None:
            continue
        for old, new in zip(before.verdicts, now.verdicts, strict=True):
            if (old["verdict"] == "pass") != (new["verdict"] == "pass"):
                change = f"{old['verdict']} in {before.version}, {new['verdict']} in {now.version}"
                lines.append(f"{now.engine} {new['case']} {new['title']}: {change}")
    return lines


# Runs the cases in engines that have an adapter, each in a process, beside hcbench or in its
# environment.

_HERE = Path(__file__).parent
RUNNER = _HERE / "hcbench_cases.py"


def adapters() -> dict[str, Path]:
    """File of the adapter for each engine that has one."""
    files = sorted((_HERE.parent / "engines").glob("*/cases.py"))
    return {path.parent.name.replace("_", "-"): path for path in files}


def _variants(adapter: Path) -> int:
    """Number of engines that an adapter makes, read without running it: it may need another
    environment.

    Raises ValueError or AssertionError for a file without one list ENGINES.
    """
    assigned = [node for node in ast.parse(read_text(adapter)).body if isinstance(node, ast.Assign)]
    (listed,) = [node.value for node in assigned if ast.unparse(node.targets[0]) == "ENGINES"]
    assert isinstance(listed, ast.List)
    return len(listed.elts)


def run_engines(
    names: Sequence[str],
    jobs: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
    only: Sequence[str] = (),
    limit: float = LIMIT,
) -> list[Json]:
    """Run the cases in each engine's variants, and return the results in that order.

    names: of engines, with "@" and a version or without.
    jobs: engines that run at once. progress: called with (done, in all).
    only: the ids of the cases to run; all where it is empty. limit: s that a case may take, of the
        clock; one that takes longer is an error, and the next one begins.
    Raises UserError for an engine without an adapter and for an unknown case, EngineMissing, and
    EngineFailed where an adapter makes no engine within `limit`.
    """
    for name in names:
        if name.partition("@")[0] not in adapters():
            raise UserError(
                "engine", f"{name!r} has no adapter of cases", f"one of: {', '.join(adapters())}"
            )
        registry.require(name)
    # Name, adapter and number of the variant of each engine to run.
    every: list[tuple[str, Path, int]] = []
    for name in names:
        adapter = adapters()[name.partition("@")[0]]
        every += [(name, adapter, variant) for variant in range(_variants(adapter))]
    results: list[Json] = []
    cases = the_cases(only)
    with ThreadPoolExecutor(jobs) as pool:
        run = pool.map(lambda each: _run(cases, limit, *each), every)
        for done, each in enumerate(run, 1):
            results.append(each)
            progress(done, len(every))
    return results


def _run(cases: Json, limit: float, name: str, adapter: Path, variant: int) -> Json:
    """Results of the cases in one engine of an adapter, from a process of its own.

    limit: s for each case. name: of the engine, with its version or without. variant: place in the
        adapter's ENGINES.
    Raises EngineFailed where the adapter makes no engine.
    """
    engine = registry.engine(name)
    # An engine in an environment of its own is run by the Python there.
    python = Path(sys.executable)
    if isinstance(engine, RemoteEngine):
        python = engine.environment.executable
    with tempfile.TemporaryDirectory() as folder:

        def start(arguments: list[str]) -> subprocess.CompletedProcess[str]:
            """Run that Python in the folder, and wait; it ends when this process does."""
            return run_with_parent([str(python), *arguments], Path(folder), os.environ)

        parts: list[Json] = []
        left = cases["cases"]
        # Another process goes on behind a case that ended one.
        while left:
            part = run_apart(adapter, variant, {**cases, "cases": left}, start, limit)
            # Without a version no engine was made; the first run has the error.
            if not part["engine"]["version"]:
                [first, *_], *_ = part["runs"].values()
                raise EngineFailed(f"engine {name!r}", first["error"], "results of its cases")
            parts.append(part)
            left = [case for case in left if case["id"] not in part["runs"]]
    return joined(parts)
