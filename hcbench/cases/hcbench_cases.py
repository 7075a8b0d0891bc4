"""Bounces that a physics engine should get right: runs the cases, judges the states, writes JUnit.

One file of Python's standard library, to be copied beside hcbench-cases-1.json into an engine's own tests:

    python hcbench_cases.py my_adapter.py --expected known.json --junit cases.xml

An adapter is a file with ENGINES: a list of classes, or functions without arguments, that make an engine. It
has `name`, `version`, and `combine`: how the restitutions of two bodies become one ("product", "average",
"maximum", "minimum", "geometric", or None without a rule). It has `make(world)`, `step()`, and `state()`,
the list of [x, y, z, vx, vy, vz, wx, wy, wz] of each body that moves, in SI units and the world's frame.
It raises NotImplementedError for what the engine cannot do.
An engine that steps many worlds at once also has `start()`: `make` adds a world, `start` starts all that were
added since, of as many steps of one length and the same shapes, and `state` lists the states of each.

MIT License, copyright (c) 2026 the hcbench authors. Permission is hereby granted, free of charge, to any
person obtaining a copy, to use, copy, modify, merge, publish, distribute, sublicense and sell it, if this
notice stays in all copies or substantial portions. It is provided "as is", without warranty of any kind.
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
States = list[list[Any]]  # [step, state of a body, state of the next ...], of each recorded step
CASES = Path(__file__).resolve().with_name("hcbench-cases-1.json")
COMBINE: dict[str, Callable[[list[float]], float]] = {
    "product": math.prod, "average": fmean, "geometric": geometric_mean, "maximum": max, "minimum": min
}  # fmt: skip


def run(engine: Any, cases: Json) -> Json:
    """Run the cases and return the states that they ask for, as plain data for a JSON file."""
    runs, began = [each for case in cases["cases"] for each in case["runs"]], time.process_time()
    batches: dict[str, list[Json]] = {}
    for number, each in enumerate(runs):
        world, shapes = each["world"], [(b["shape"], b.get("fixed")) for b in each["world"]["bodies"]]
        alike = (each["steps"], world["timestep"], world["floor"], shapes)
        batches.setdefault(str(alike if hasattr(engine, "start") else number), []).append(each)
    states = {id(each): done for batch in batches.values() for each, done in _run(engine, batch)}
    done = {case["id"]: [states[id(each)] for each in case["runs"]] for case in cases["cases"]}
    about = {name: getattr(engine, name, None) for name in ("name", "version", "combine")}
    cpu_s = round(time.process_time() - began, 3)
    return {"format": 1, "set": cases["set"], "engine": about, "cpu_s": cpu_s, "runs": done}


def _run(engine: Any, runs: list[Json]) -> list[tuple[Json, Json]]:
    """Each run with {"states": ...}, {"unsupported": why} or {"error": why}; many runs make a batch."""
    batch, made, results = hasattr(engine, "start"), [], [(each, Json()) for each in runs]
    try:
        for each, result in results:
            try:
                engine.make(each["world"])
                made.append((each, result.setdefault("states", [])))
            except NotImplementedError as error:
                result["unsupported"] = str(error)
        if made and batch:
            engine.start()
        for step in range(1 + runs[0]["steps"] if made else 0):
            if step:
                engine.step()
            asked = [any(a <= step <= b for a, b in each["record"]) for each, _ in made]
            if any(asked):
                worlds = engine.state() if batch else [engine.state()]
                for (_, states), wanted, bodies in zip(made, asked, worlds, strict=True):
                    if wanted:
                        states.append([step, *([float(f"{x:.9g}") for x in body] for body in bodies)])
    except Exception as error:  # an engine's own; the other runs go on
        failed = {"error": f"{type(error).__name__}: {error}"}
        results = [(each, result if "unsupported" in result else failed) for each, result in results]
    return results


def restitution(each: Json, states: States) -> float:
    """Speed after over speed before, both at the plane of touch; 0 where nothing came back."""
    h, g = each["world"]["timestep"], -each["world"]["gravity"][2]
    touch = each["world"]["bodies"][0]["radius"]
    z = {step: bodies[0][2] for step, *bodies in states}
    squares = {  # of the speed at the plane: central differences mean the same in every integrator
        step: ((z[step + 1] - z[step - 1]) / (2 * h)) ** 2 + 2 * g * (z[step] - touch)
        for step in z
        if step - 1 in z and step + 1 in z
    }
    turned = next((later for step, later in pairwise(z) if z[later] > z[step]), math.inf)
    after = max((s for s in squares if s > turned and z[s] >= touch), key=lambda s: z[s], default=None)
    return 0.0 if after is None else math.sqrt(max(0.0, squares[after]) / squares[min(squares)])


def height_share(each: Json, states: States) -> float:
    """The highest point of the last recorded steps over the first height, both above the floor."""
    radius = each["world"]["bodies"][0]["radius"]
    return float((max(state[1][2] for state in _last(each, states)) - radius) / (states[0][1][2] - radius))


def drift(each: Json, states: States) -> float:
    """Distance over time in the last recorded steps, of the body that moved farthest, m/s."""
    (start, *before), *_, (end, *after) = _last(each, states)
    moved = max(math.dist(a[:3], b[:3]) for a, b in zip(before, after, strict=True))
    return moved / float((end - start) * each["world"]["timestep"])


def vibration(each: Json, states: States) -> float:
    """Standard deviation of the velocity in the last recorded steps, m/s, of the body that shakes most."""
    end = _last(each, states)
    return max(math.hypot(*(pstdev(s[b][i] for s in end) for i in (3, 4, 5))) for b in range(1, len(end[0])))


def force_noise(each: Json, states: States) -> float:
    """Standard deviation of the contact's force over the weight, from the velocity in the last steps."""
    v = [state[1][5] for state in _last(each, states)]
    gained = each["world"]["timestep"] * -each["world"]["gravity"][2]
    return float(pstdev(b - a for a, b in pairwise(v)) / gained)


def depth(each: Json, states: States) -> float:
    """Final depth of the first body, a box, in the floor, over its height."""
    return float(0.5 - states[-1][1][2] / (2 * each["world"]["bodies"][0]["half"][2]))


def velocity(each: Json, states: States) -> list[float]:
    """Final velocity of each body over the first one's first speed."""
    speed = math.hypot(*each["world"]["bodies"][0]["velocity"])
    return [x / speed for body in states[-1][1:] for x in body[3:6]]


def spin(each: Json, states: States) -> list[float]:
    """Final speed of the surface by each body's spin over the first one's first speed."""
    first = each["world"]["bodies"][0]
    scale = first.get("radius", max(first.get("half", [0.0]))) / math.hypot(*first["velocity"])
    return [scale * x for body in states[-1][1:] for x in body[6:9]]


def _last(each: Json, states: States) -> States:
    return [state for state in states if state[0] >= each["record"][-1][0]]


_READ = (restitution, height_share, drift, vibration, force_noise, depth, velocity, spin)
QUANTITIES: dict[str, Callable[[Json, States], Any]] = {function.__name__: function for function in _READ}


def judge(results: Json, cases: Json) -> list[Json]:
    """A verdict on each case: {case, title, verdict, why, worst}.

    verdict: "pass", "fail", "unsupported" or "error". worst: by quantity what was measured, what is true, and
    the number of the run that is farthest off.
    """
    done, combine = results["runs"], results["engine"]["combine"]
    return [_judge(case, done.get(case["id"], []), combine) for case in cases["cases"]]


def _judge(case: Json, done: list[Json], combine: str | None) -> Json:
    verdict = {"case": case["id"], "title": case["title"], "verdict": "pass", "why": "", "worst": {}}
    limits = {name: limit["value"] for name, limit in case["tolerance"].items()}
    off = dict.fromkeys(limits, -1.0)
    try:
        for number, (each, result) in enumerate(zip(case["runs"], done, strict=True)):
            if "states" not in result:
                ((word, why),) = result.items()
                return {**verdict, "verdict": word, "why": str(why)}
            numbers = (x for _, *bodies in result["states"] for body in bodies for x in body)
            if not all(map(math.isfinite, numbers)):
                return {**verdict, "verdict": "fail", "why": f"a state is not finite (run {number})"}
            for name, measured, true in _compared(each, result["states"], combine):
                if not abs(measured - true) <= off[name]:  # a nan is the worst
                    off[name], verdict["worst"][name] = abs(measured - true), [measured, true, number]
    except NotImplementedError as error:
        return {**verdict, "verdict": "unsupported", "why": str(error)}
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        return {**verdict, "verdict": "error", "why": f"cannot be read: {type(error).__name__} {error}"}
    why = [
        f"{name} {measured:.4g}, not {true:.4g} within {limits[name]:g} (run {number})"
        for name, (measured, true, number) in verdict["worst"].items()
        if not off[name] <= limits[name]
    ]
    return {**verdict, "verdict": "fail" if why else "pass", "why": "; ".join(why)}


def _compared(each: Json, states: States, combine: str | None) -> Iterator[tuple[str, float, float]]:
    materials = each["world"].get("materials")
    if materials and combine is None:
        raise NotImplementedError("no rule for two restitutions is stated")
    for name, expected in each["expected"].items():
        true: Any = COMBINE[combine](materials) if materials and combine else expected
        measured = QUANTITIES[name](each, states)
        several = zip(measured, true, strict=True) if isinstance(measured, list) else [(measured, true)]
        yield from ((name, *pair) for pair in several)


def outcome(verdict: Json, expected: Json) -> tuple[str, str]:
    """("passed", "failure" or "skipped", in words). expected: {case: reason} of failures that are known."""
    known = expected.get(verdict["case"])
    if verdict["verdict"] == "pass":
        return ("failure", f"passes, though it is expected to fail: {known}") if known else ("passed", "")
    if known or verdict["verdict"] == "unsupported":
        return "skipped", known or verdict["why"]
    return "failure", f"{verdict['verdict']}: {verdict['why']}"


def junit(verdicts: list[Json], engine: str, expected: Json) -> str:
    """Write the verdicts as JUnit XML."""
    root = ElementTree.Element("testsuite", name=f"hcbench-cases {engine}")
    for verdict in verdicts:
        name = f"{verdict['case']} {verdict['title']}"
        part = ElementTree.SubElement(root, "testcase", classname=f"hcbench-cases.{engine}", name=name)
        kind, text = outcome(verdict, expected)
        if kind != "passed":
            ElementTree.SubElement(part, kind, message=text)
    return ElementTree.tostring(root, encoding="unicode")


def main() -> int:
    """Run the cases; exit 1 where one fails that is not expected to, or passes that is."""
    parser = argparse.ArgumentParser(description="Run the bounce cases of hcbench in an engine.")
    parser.add_argument("adapter", type=Path, help="file with a list ENGINES")
    parser.add_argument("--cases", type=Path, default=CASES)
    parser.add_argument("--expected", type=Path, help="JSON file {engine: {case: reason}} of known failures")
    parser.add_argument("--out", type=Path, help="file for the results, a JSON list")
    parser.add_argument("--junit", type=Path, help="file for JUnit's XML")
    asked = parser.parse_args()
    cases, every, suites, failures = json.loads(asked.cases.read_text("utf-8")), [], "", 0
    known = json.loads(asked.expected.read_text("utf-8")) if asked.expected else {}
    for make in runpy.run_path(str(asked.adapter))["ENGINES"]:
        engine = make()
        every.append(run(engine, cases))
        verdicts, expected = judge(every[-1], cases), known.get(engine.name, {})
        suites += junit(verdicts, engine.name, expected)
        for verdict in verdicts:
            kind, text = outcome(verdict, expected)
            failures += kind == "failure"
            print(f"{engine.name} {verdict['case']} {kind}  {verdict['title']}  {text}", file=sys.stderr)
    if asked.out:
        asked.out.write_text(json.dumps(every, separators=(",", ":")) + "\n", "utf-8")
    if asked.junit:
        asked.junit.write_text(f"<testsuites>{suites}</testsuites>\n", "utf-8")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
