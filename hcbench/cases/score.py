"""Judges results of cases, of any engine in any language: verdicts, how far e is obeyed, regressions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hcbench._files import parse_json, read_text
from hcbench.cases.hcbench_cases import CASES, Json, judge, restitution
from hcbench.cases.schema import Obedience, validated
from hcbench.errors import UserError

KNOWN = Path(__file__).with_name("known.json")
MEASURED = Path(__file__).with_name("measured.json")
_HALF = 0.5  # of the restitution asked for: less does not count as a bounce


def the_cases(only: Sequence[str] = ()) -> Json:
    """The set, or the cases of these ids. Raises UserError for an id that it has not."""
    whole = dict(parse_json(read_text(CASES)))
    ids = [case["id"] for case in whole["cases"]]
    for name in only:
        if name not in ids:
            raise UserError("--case", repr(name), f"one of {ids[0]} ... {ids[-1]}")
    return {**whole, "cases": [case for case in whole["cases"] if not only or case["id"] in only]}


def known_failures() -> dict[str, dict[str, str]]:
    """Cases that the engines with an adapter here are known to fail: {engine: {case: reason}}."""
    return dict(parse_json(read_text(KNOWN)))


@dataclass(frozen=True, slots=True)
class EngineScore:
    """Score of one engine's results.

    verdicts: of `hcbench_cases.judge`. restitution: "obeyed"; "threshold", where it is obeyed above a speed;
    "ignored", where the number makes no difference; "mixed"; or None where the first case was not run.
    threshold: the highest impact speed under gravity that did not bounce, m/s; 0 where all did.
    """

    engine: str
    version: str
    verdicts: tuple[Json, ...]
    restitution: Obedience | None
    threshold: float
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
        names = ("engine", "version", "passed", "restitution", "threshold", "cpu_s", "verdicts")
        return {name: getattr(self, name) for name in names}


def score(results: Json, source: str = "results", only: Sequence[str] = ()) -> EngineScore:
    """Judge the results of one engine, in all cases or in `only` these.

    Raises UserError, with source as the slot, for anything else than results.
    """
    cases = the_cases(only)
    validated(results, "results", source)
    if results["set"] != cases["set"]:
        raise UserError(source, f"results of {results['set']!r}", f"of {cases['set']!r}")
    for case in cases["cases"]:
        _require_runs(case, results["runs"].get(case["id"], []), source)
    verdicts, engine = judge(results, cases), results["engine"]
    try:
        obeyed, threshold = _obedience(results["runs"], cases, verdicts)
    except (ArithmeticError, ValueError) as error:
        raise UserError(source, f"a ball at rest before an impact: {error}", "states of the cases") from None
    cpu_s = float(results.get("cpu_s", 0.0))
    return EngineScore(engine["name"], engine["version"], tuple(verdicts), obeyed, threshold, cpu_s)


def _require_runs(case: Json, done: Sequence[Json], source: str) -> None:
    """Raise UserError where runs are missing, or a run has other states than the case asks for."""
    if len(done) != len(case["runs"]):
        got, hint = f"{len(done)} of {len(case['runs'])} runs", "Name the cases of the file by `--case`"
        raise UserError(f"{source}: {case['id']}", got, "all of them", hint)
    for number, (each, result) in enumerate(zip(case["runs"], done, strict=True)):
        slot = f"{source}: {case['id']}, run {number}"
        if len(result) != 1:
            raise UserError(slot, " and ".join(result) or "nothing", "states, unsupported or error")
        if "states" not in result:
            continue
        steps = [step for first, last in each["record"] for step in range(first, last + 1)]
        if [step for step, *_ in result["states"]] != steps:
            wanted = ", ".join(f"{first} ... {last}" for first, last in each["record"])
            raise UserError(slot, "states after other steps", f"those after steps {wanted}")
        moving = sum(not body.get("fixed") for body in each["world"]["bodies"])
        for step, *bodies in result["states"]:
            if len(bodies) != moving:
                raise UserError(f"{slot}, step {step}", f"{len(bodies)} bodies", str(moving))


def read_scores(path: Path, only: Sequence[str] = ()) -> list[EngineScore]:
    """Score a file of results, which holds one object or a list, in all cases or in `only` these.

    Raises UserError.
    """
    try:
        content = parse_json(read_text(path))
    except OSError as error:
        raise UserError(str(path), error.strerror or "cannot be read", "a JSON file of results") from None
    except ValueError:
        raise UserError(str(path), "not JSON", "a JSON file of results") from None
    if not content:
        raise UserError(str(path), "nothing in it", "the results of an engine, or a list of them")
    return [score(each, str(path), only) for each in (content if isinstance(content, list) else [content])]


def measured() -> list[EngineScore]:
    """Scores of the engines and versions that were measured for the pages, from `measured.json`."""
    scores = validated(parse_json(read_text(MEASURED)), "scores", MEASURED.name)
    names = ("engine", "version", "restitution", "threshold", "cpu_s")
    return [EngineScore(verdicts=tuple(each["verdicts"]), **{n: each[n] for n in names}) for each in scores]


def matrix(scores: Sequence[EngineScore] | None = None) -> list[dict[str, str]]:
    """A row of words for each engine: what it is, a verdict by the id of each case, what it came to.

    scores: those of `measured` where None. restitution: "obeyed", "threshold", "mixed", "ignored" or "".
    """
    return [
        {
            "engine": each.engine,
            "version": each.version,
            **{verdict["case"]: verdict["verdict"] for verdict in each.verdicts},
            "passed": f"{each.passed} of {len(each.verdicts)}",
            "restitution": each.restitution or "",
        }
        for each in (measured() if scores is None else scores)
    ]


def _obedience(runs: Json, cases: Json, verdicts: Sequence[Json]) -> tuple[Obedience | None, float]:
    if [case["id"] for case in cases["cases"][:2]] != ["C01", "C02"]:
        return None, 0.0
    normal, slow, *_ = cases["cases"]
    measured = list(_restitutions(normal, runs.get(normal["id"], [])))
    under_gravity = _restitutions(slow, runs.get(slow["id"], []))
    silent = [speed for speed, asked, e in under_gravity if e < _HALF * asked]
    threshold = max(silent, default=0.0)
    if [verdict["verdict"] for verdict in verdicts[:2]] == ["pass", "pass"]:
        return "obeyed", threshold
    spread = {asked: [e for _, a, e in measured if a == asked] for asked in {a for _, a, _ in measured}}
    means = [sum(each) / len(each) for each in spread.values()]
    if not means:
        return None, 0.0
    if max(means) - min(means) < 0.02:
        return "ignored", threshold
    tolerance = normal["tolerance"]["restitution"]["value"]
    off = [speed for speed, asked, e in measured if not abs(e - asked) <= tolerance]
    quiet = [speed for speed, asked, e in measured if e < _HALF * asked]
    above = [speed for speed, *_ in measured if speed > max([*quiet, *silent], default=0.0)]
    only_slow = above and not set(off) & set(above)
    return ("threshold" if only_slow and (quiet or silent) else "mixed"), max([threshold, *quiet])


def _restitutions(case: Json, results: Sequence[Json]) -> Iterator[tuple[float, float, float]]:
    """(impact speed, e asked for, e measured) of the runs that have states."""
    for each, states in zip(case["runs"], results, strict=False):
        if "states" in states:
            ball, fall = each["world"]["bodies"][0], -2.0 * each["world"]["gravity"][2]
            speed = math.sqrt(ball["velocity"][2] ** 2 + fall * (ball["position"][2] - ball["radius"]))
            yield speed, each["world"]["restitution"], restitution(each, states["states"])


def regressions(scores: Sequence[EngineScore]) -> list[str]:
    """A line for each case that passed in a version of an engine and fails in the next one given, or back."""
    lines, last = [], dict[str, EngineScore]()
    for now in scores:
        before = last.get(now.engine)
        last[now.engine] = now
        for old, new in zip(before.verdicts, now.verdicts, strict=True) if before else ():
            if (old["verdict"] == "pass") != (new["verdict"] == "pass"):
                words = f"{old['verdict']} in {before.version}, {new['verdict']} in {now.version}"  # type: ignore[union-attr]
                lines.append(f"{now.engine} {new['case']} {new['title']}: {words}")
    return lines
