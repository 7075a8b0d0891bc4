"""Bounces that a physics engine should get right: runs the cases, judges the states, writes JUnit.

One file of Python's standard library, to be copied beside
hcbench-cases-1.json into an engine's own tests:

    python hcbench_cases.py my_adapter.py --expected known.json --junit cases.xml

An adapter is a file with ENGINES: a list of classes, or functions without arguments, that make an
engine. It has `name`, `version`, and `combine`: how the restitutions of two bodies become one
("product", "average", "maximum", "minimum", "geometric", or None without a rule). It has
`make(world)`, `step()`, and `state()`, the list of [x, y, z, vx, vy, vz, wx, wy, wz] of each body
that moves, in SI units and the world's frame. It raises NotImplementedError for what the engine
cannot do. An engine that steps many worlds at once also has `start()`: `make` adds a world,
`start` starts all that were added since, of as many steps of one length and the same shapes, and
`state` lists the states of each.

MIT License, copyright (c) 2026 the hcbench authors. Permission is hereby granted, free of
charge, to any person obtaining a copy, to use, copy, modify, merge, publish, distribute,
sublicense and sell it, if this notice stays in all copies or substantial portions. It is
provided "as is", without warranty of any kind.
"""

from __future__ import annotations

import argparse
import json
import math
import runpy
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import fmean, geometric_mean, pstdev
from typing import Any
from xml.etree import ElementTree

Json = dict[str, Any]
States = list[list[Any]]  # of each recorded step [step, state of a body, state of the next ...]
CASES = Path(__file__).resolve().with_name("hcbench-cases-1.json")
# Places of z, of vz, and of vx, vy, vz in the state of a body.
_Z = 2
_VZ = 5
_VELOCITY = (3, 4, 5)
COMBINE: dict[str, Callable[[list[float]], float]] = {
    "product": math.prod, "average": fmean, "geometric": geometric_mean, "maximum": max, "minimum": min
}  # fmt: skip


def run(engine: Any, cases: Json) -> Json:
    """Run the cases and return the states that they ask for, as plain data for a JSON file."""
    began = time.process_time()
    runs: list[Json] = []
    for case in cases["cases"]:
        runs.extend(case["runs"])
    batches: dict[str, list[Json]] = {}
    for number, each in enumerate(runs):
        # An engine that steps one world at a time has each run in a batch of its own.
        key = _batch_key(each) if hasattr(engine, "start") else str(number)
        batches.setdefault(key, []).append(each)
    states: dict[int, Json] = {}  # by the run's identity: equal runs may be in two cases
    for batch in batches.values():
        for each, result in _run(engine, batch):
            states[id(each)] = result
    done: dict[str, list[Json]] = {}
    for case in cases["cases"]:
        done[case["id"]] = [states[id(each)] for each in case["runs"]]
    about = {name: getattr(engine, name, None) for name in ("name", "version", "combine")}
    cpu_s = round(time.process_time() - began, 3)
    return {"format": 1, "set": cases["set"], "engine": about, "cpu_s": cpu_s, "runs": done}


def _batch_key(each: Json) -> str:
    """Text that is the same for runs which an engine can step together."""
    world = each["world"]
    shapes = [(body["shape"], body.get("fixed")) for body in world["bodies"]]
    return str((each["steps"], world["timestep"], world["floor"], shapes))


def _run(engine: Any, runs: list[Json]) -> list[tuple[Json, Json]]:
    """Each run with {"states": ...}, {"unsupported": why} or
    {"error": why}; many runs make a batch.
    """
    results = [(each, Json()) for each in runs]
    try:
        made = _make_worlds(engine, results)
        if made:
            _step_worlds(engine, made)
    except Exception as error:  # an engine's own error ends its runs alone
        failed = {"error": f"{type(error).__name__}: {error}"}
        for place, (each, result) in enumerate(results):
            if "unsupported" not in result:
                results[place] = each, failed
    return results


def _make_worlds(engine: Any, results: list[tuple[Json, Json]]) -> list[tuple[Json, States]]:
    """Make the worlds that the engine can make: each run with its states, which are empty yet.

    The result of any other run gets {"unsupported": why}.
    """
    made = []
    for each, result in results:
        try:
            engine.make(each["world"])
        except NotImplementedError as error:
            result["unsupported"] = str(error)
        else:
            result["states"] = []
            made.append((each, result["states"]))
    return made


def _step_worlds(engine: Any, made: list[tuple[Json, States]]) -> None:
    """Step the worlds that were made last, and add the states of the steps that are asked for."""
    is_batch = hasattr(engine, "start")
    if is_batch:
        engine.start()
    any_run, _ = made[0]
    for step in range(1 + any_run["steps"]):  # one number for a whole batch
        if step:
            engine.step()
        asked = [_is_asked(each, step) for each, _ in made]
        if not any(asked):
            continue  # to read a state may cost an engine more than a step
        worlds = engine.state() if is_batch else [engine.state()]
        for (_, states), is_asked, bodies in zip(made, asked, worlds, strict=True):
            if is_asked:
                states.append([step, *map(_nine_digits, bodies)])


def _is_asked(each: Json, step: int) -> bool:
    """True if a run asks for the states after a step."""
    return any(first <= step <= last for first, last in each["record"])


def _nine_digits(body: list[float]) -> list[float]:
    """The state of a body as the file of results has it: fewer bytes, and far below any tolerance."""
    return [float(f"{x:.9g}") for x in body]


def restitution(each: Json, states: States) -> float:
    """Speed after over speed before, both at the plane of touch; 0 where nothing came back."""
    timestep = each["world"]["timestep"]
    *_, gravity_z = each["world"]["gravity"]
    ball, *_ = each["world"]["bodies"]
    touch = ball["radius"]  # height of the ball's centre at touch, m
    z = {step: body[_Z] for step, body, *_ in states}
    squares = {}  # speed at the plane, squared, m²/s²
    for step, height in z.items():
        if step - 1 in z and step + 1 in z:
            # Central differences mean the same in every integrator; the
            # energy takes them to the plane.
            speed = (z[step + 1] - z[step - 1]) / (2 * timestep)
            squares[step] = speed**2 - 2 * gravity_z * (height - touch)
    turned = math.inf  # the first step after which the ball is higher
    for step, later in pairwise(z):
        if z[later] > z[step]:
            turned = later
            break
    rising = [step for step in squares if step > turned and z[step] >= touch]
    if not rising:
        return 0.0
    highest = max(rising, key=lambda step: z[step])
    return math.sqrt(max(0.0, squares[highest]) / squares[min(squares)])


def height_share(each: Json, states: States) -> float:
    """The highest point of the last recorded steps over the first height, both above the floor."""
    ball, *_ = each["world"]["bodies"]
    radius = ball["radius"]
    _, first_state, *_ = states[0]
    heights = [body[_Z] for _, body, *_ in _last(each, states)]
    return float((max(heights) - radius) / (first_state[_Z] - radius))


def drift(each: Json, states: States) -> float:
    """Distance over time in the last recorded steps, of the body that moved farthest, m/s."""
    last = _last(each, states)
    start, *before = last[0]
    end, *after = last[-1]
    moved = max(math.dist(a[:3], b[:3]) for a, b in zip(before, after, strict=True))
    return moved / float((end - start) * each["world"]["timestep"])


def vibration(each: Json, states: States) -> float:
    """Standard deviation of the velocity in the last recorded steps,
    m/s, of the body that shakes most.
    """
    last = _last(each, states)
    shaking = []
    for body in range(1, len(last[0])):  # a state's first entry is the step
        by_axis = [pstdev(state[body][axis] for state in last) for axis in _VELOCITY]
        shaking.append(math.hypot(*by_axis))
    return max(shaking)


def force_noise(each: Json, states: States) -> float:
    """Standard deviation of the contact's force over the weight, from
    the velocity in the last steps.
    """
    upward = [body[_VZ] for _, body, *_ in _last(each, states)]  # m/s
    *_, gravity_z = each["world"]["gravity"]
    gained = -each["world"]["timestep"] * gravity_z  # speed of a step of free fall, m/s
    return float(pstdev(later - now for now, later in pairwise(upward)) / gained)


def depth(each: Json, states: States) -> float:
    """Final depth of the first body, a box, in the floor, over its height."""
    box, *_ = each["world"]["bodies"]
    *_, half_height = box["half"]
    _, final, *_ = states[-1]
    return float(0.5 - final[_Z] / (2 * half_height))


def velocity(each: Json, states: States) -> list[float]:
    """Final velocity of each body over the first one's first speed."""
    speed = math.hypot(*each["world"]["bodies"][0]["velocity"])
    _, *bodies = states[-1]
    return [x / speed for body in bodies for x in body[3:6]]


def spin(each: Json, states: States) -> list[float]:
    """Final speed of the surface by each body's spin over the first one's first speed."""
    first = each["world"]["bodies"][0]
    if "radius" in first:
        arm = first["radius"]  # m
    else:
        arm = max(first.get("half", [0.0]))  # m
    scale = arm / math.hypot(*first["velocity"])
    _, *bodies = states[-1]
    return [scale * x for body in bodies for x in body[6:9]]


def _last(each: Json, states: States) -> States:
    """States of the last span of steps that a run asks for."""
    begin, _ = each["record"][-1]
    return [state for state in states if state[0] >= begin]


_READ = (restitution, height_share, drift, vibration, force_noise, depth, velocity, spin)
QUANTITIES: dict[str, Callable[[Json, States], Any]] = {
    function.__name__: function for function in _READ
}


def judge(results: Json, cases: Json) -> list[Json]:
    """A verdict on each case: {case, title, verdict, why, worst}.

    verdict: "pass", "fail", "unsupported" or "error". worst: by quantity what was measured, what is
    true, and the number of the run that is farthest off.
    """
    done, combine = results["runs"], results["engine"]["combine"]
    return [_judge(case, done.get(case["id"], []), combine) for case in cases["cases"]]


def _judge(case: Json, done: list[Json], combine: str | None) -> Json:
    """The verdict on one case. done: the results of its runs, in order."""
    verdict = {
        "case": case["id"],
        "title": case["title"],
        "verdict": "pass",
        "why": "",
        "worst": {},
    }
    limits = {name: limit["value"] for name, limit in case["tolerance"].items()}
    off = dict.fromkeys(limits, -1.0)  # largest error so far
    try:
        for number, (each, result) in enumerate(zip(case["runs"], done, strict=True)):
            if "states" not in result:
                ((word, why),) = result.items()  # "unsupported" or "error"
                return {**verdict, "verdict": word, "why": str(why)}
            if not _is_finite(result["states"]):
                return {
                    **verdict,
                    "verdict": "fail",
                    "why": f"a state is not finite (run {number})",
                }
            for name, measured, true in _compared(each, result["states"], combine):
                error = abs(measured - true)
                if not error <= off[name]:  # written so that NaN is the worst
                    off[name] = error
                    verdict["worst"][name] = [measured, true, number]
    except NotImplementedError as error:
        return {**verdict, "verdict": "unsupported", "why": str(error)}
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        return {
            **verdict,
            "verdict": "error",
            "why": f"cannot be read: {type(error).__name__} {error}",
        }
    missed = []
    for name, (measured, true, number) in verdict["worst"].items():
        if not off[name] <= limits[name]:
            limit = f"within {limits[name]:g}"
            missed.append(f"{name} {measured:.4g}, not {true:.4g} {limit} (run {number})")
    if missed:
        return {**verdict, "verdict": "fail", "why": "; ".join(missed)}
    return verdict


def _is_finite(states: States) -> bool:
    """Say whether all numbers of all states are finite."""
    for _, *bodies in states:
        for body in bodies:
            if not all(map(math.isfinite, body)):
                return False
    return True


def _compared(
    each: Json, states: States, combine: str | None
) -> Iterator[tuple[str, float, float]]:
    """(name, measured, true) of each number that a run expects;
    several for a quantity of each body.
    """
    materials = each["world"].get("materials")
    if materials and combine is None:
        raise NotImplementedError("no rule for two restitutions is stated")
    for name, expected in each["expected"].items():
        true: Any = expected
        if materials and combine:
            true = COMBINE[combine](materials)
        measured = QUANTITIES[name](each, states)
        if isinstance(measured, list):
            for one_measured, one_true in zip(measured, true, strict=True):
                yield name, one_measured, one_true
        else:
            yield name, measured, true


def outcome(verdict: Json, expected: Json) -> tuple[str, str]:
    """("passed", "failure" or "skipped", in words). expected: {case:
    reason} of failures that are known.
    """
    known = expected.get(verdict["case"])
    if verdict["verdict"] == "pass":
        if known:
            return "failure", f"passes, though it is expected to fail: {known}"
        return "passed", ""
    if known or verdict["verdict"] == "unsupported":
        return "skipped", known or verdict["why"]
    return "failure", f"{verdict['verdict']}: {verdict['why']}"


def junit(verdicts: list[Json], engine: str, expected: Json) -> str:
    """Write the verdicts as JUnit XML."""
    root = ElementTree.Element("testsuite", name=f"hcbench-cases {engine}")
    for verdict in verdicts:
        name = f"{verdict['case']} {verdict['title']}"
        part = ElementTree.SubElement(
            root, "testcase", classname=f"hcbench-cases.{engine}", name=name
        )
        kind, text = outcome(verdict, expected)
        if kind != "passed":
            ElementTree.SubElement(part, kind, message=text)
    return ElementTree.tostring(root, encoding="unicode")


def main() -> int:
    """Run the cases; exit 1 where one fails that is not expected to, or passes that is."""
    parser = argparse.ArgumentParser(description="Run the bounce cases of hcbench in an engine.")
    parser.add_argument("adapter", type=Path, help="file with a list ENGINES")
    parser.add_argument("--cases", type=Path, default=CASES)
    parser.add_argument(
        "--expected", type=Path, help="JSON file {engine: {case: reason}} of known failures"
    )
    parser.add_argument("--out", type=Path, help="file for the results, a JSON list")
    parser.add_argument("--junit", type=Path, help="file for JUnit's XML")
    asked = parser.parse_args()
    cases = json.loads(asked.cases.read_text("utf-8"))
    known: Json = {}
    if asked.expected:
        known = json.loads(asked.expected.read_text("utf-8"))
    makers = runpy.run_path(str(asked.adapter))["ENGINES"]
    all_results = []
    suites = ""
    failures = 0
    for make in makers:
        engine = make()
        results = run(engine, cases)
        all_results.append(results)
        verdicts = judge(results, cases)
        expected = known.get(engine.name, {})
        suites += junit(verdicts, engine.name, expected)
        for verdict in verdicts:
            kind, text = outcome(verdict, expected)
            failures += kind == "failure"
            print(
                f"{engine.name} {verdict['case']} {kind}  {verdict['title']}  {text}",
                file=sys.stderr,
            )
    if asked.out:
        asked.out.write_text(json.dumps(all_results, separators=(",", ":")) + "\n", "utf-8")
    if asked.junit:
        asked.junit.write_text(f"<testsuites>{suites}</testsuites>\n", "utf-8")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
