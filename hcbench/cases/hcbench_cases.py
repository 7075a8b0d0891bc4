# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Bounces that a physics engine should get right: runs, judges, writes JUnit.

One file without dependencies, for an engine's own tests:

    python hcbench_cases.py my_adapter.py --expected known.json --junit cases.xml

An adapter is a file with ENGINES: a list of classes, or functions without arguments, that make an
engine. It has `name`, `version`, and `combine`: how the restitutions of two bodies become one
("product", "average", "maximum", "minimum", "geometric", or None without a rule). It has
`make(world)`, `step()`, and `state()`, the list of [x, y, z, vx, vy, vz, wx, wy, wz] of each body
that moves, in SI units and the world's frame. `make` raises NotImplementedError for what the engine
cannot do. An engine of many worlds also has `start()`: `make` adds a world, `start` starts those
added since, which are alike in steps and shapes, and `state` lists the bodies of each.
"""

import argparse
import faulthandler
import json
import math
import runpy
import subprocess
import sys
import tempfile
import time
import traceback
from itertools import pairwise
from pathlib import Path
from statistics import fmean, geometric_mean, pstdev
from typing import Any
from xml.etree import ElementTree as ET

Json = dict[str, Any]
States = list[list[Any]]  # of each recorded step [step, state of a body, ...]
CASES = Path(__file__).resolve().with_name("hcbench-cases-1.json")
LIMIT = 300.0  # s a case
Z, VZ = 2, 5  # places in the state of a body
COMBINE: Json = {
    "product": math.prod, "average": fmean, "geometric": geometric_mean, "maximum": max, "minimum": min
}  # fmt: skip


def load(path: Path) -> Json:
    """The cases of a file. Each run has "world", whole, with what its case shares, "record", the
    spans of steps (first, last) after which states are kept, and "expected", numbers by quantity.
    """
    cases: Json = json.loads(path.read_text("utf-8"))
    for case in cases["cases"]:
        for each in case["runs"]:
            bodies = [{**case["body"], **body} for body in each["world"]["bodies"]]
            each["world"] = {**case["world"], **each["world"], "bodies": bodies}
    return cases


def run(engine: Any, cases: Json) -> Json:
    """Run the cases; return the states that they ask for, as plain data."""
    began = time.process_time()
    done = {case["id"]: _run_case(engine, case["runs"]) for case in cases["cases"]}
    about = {name: getattr(engine, name, None) for name in ("name", "version", "combine")}
    cpu_s = round(time.process_time() - began, 3)
    return {"format": 1, "set": cases["set"], "engine": about, "cpu_s": cpu_s, "runs": done}


def _run_case(engine: Any, runs: list[Json]) -> list[Json]:
    """A result of each run: {"states": States}, {"unsupported": why} or {"error": why}.

    An engine with `start` has all worlds of one batch at once, those that are alike in steps and
    shapes; any other has one world at a time. An error is that of all runs of the batch.
    """
    # (run, its result) of the runs of each batch, by what is alike in them.
    batches: Json = {}
    results: list[Json] = []
    for number, each in enumerate(runs):
        key = str(number)
        if hasattr(engine, "start"):
            world = each["world"]
            shapes = [(body["shape"], body.get("fixed")) for body in world["bodies"]]
            key = str((_last_step(each), world["timestep"], world["floor"], shapes))
        result: Json = {}
        results.append(result)
        batches.setdefault(key, []).append((each, result))
    for batch in batches.values():
        try:
            _run_batch(engine, batch)
        except Exception as error:
            for _, result in batch:
                if "unsupported" not in result:
                    result.clear()  # states up to the error
                    result["error"] = _with_place(error)
    return results


def _with_place(error: Exception) -> str:
    """An error with the adapter's line."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "runpy" not in f.filename]
    # The first line outside of this file is the adapter's.
    at = next((f for f in frames if f.filename != __file__), frames[-1])
    said, *_ = str(error).split("\n")
    return f"{type(error).__name__}: {said} ({Path(at.filename).name}, line {at.lineno})"


def _run_batch(engine: Any, batch: list[Any]) -> None:
    """Step the worlds of (run, result) pairs together, and put "states" into each result, or
    "unsupported" for a world that the engine cannot have.

    Raises what the engine raises, and ValueError for a wrong number of bodies.
    """
    made = []  # (run, its states), of the worlds that the engine has
    for each, result in batch:
        try:
            engine.make(each["world"])
        except NotImplementedError as error:
            result["unsupported"] = str(error)
        else:
            result["states"] = []
            made.append((each, result["states"]))
    if not made:
        return
    is_batch = hasattr(engine, "start")
    if is_batch:
        engine.start()
    run, _ = made[0]
    for step in range(1 + _last_step(run)):  # the same of all in a batch
        if step:
            engine.step()
        # An engine's state may cost more than its step: it is asked for only where a run keeps it.
        if not any(_keeps(each, step) for each, _ in made):
            continue
        worlds = engine.state() if is_batch else [engine.state()]
        for (each, states), bodies in zip(made, worlds, strict=True):
            if _keeps(each, step):
                states.append([step, *_rounded_bodies(each, bodies, step)])


def _keeps(each: Json, step: int) -> bool:
    """True where a run has the state after this step recorded."""
    return any(first <= step <= last for first, last in each["record"])


def _rounded_bodies(each: Json, bodies: Any, step: int) -> list[list[float]]:
    """States of a run's bodies in nine digits, far below any tolerance.

    Raises ValueError, with the step, for more or fewer of them than the run has moving bodies.
    """
    moving = sum(not body.get("fixed") for body in each["world"]["bodies"])
    if len(bodies) != moving:
        raise ValueError(f"step {step}: {len(bodies)} bodies, not {moving}")
    return [[float(f"{x:.9g}") for x in body] for body in bodies]


def _last_step(run: Json) -> int:
    *_, (_, last) = run["record"]
    return int(last)


def restitution(each: Json, states: States) -> float:
    """e of a run's ball on the floor: speed after over speed before, both at the height where its
    two flights meet; 0 if it does not come back, -1 if it falls on under the floor.

    By heights alone: what an engine calls the velocity differs by half a step. The flight before is
    that of the launch, as an engine that acts before the touch leaves no other to read.
    """
    h = each["world"]["timestep"]  # s
    *_, g = each["world"]["gravity"]  # m/s², below 0
    ball, *_ = each["world"]["bodies"]
    z = {step: body[Z] for step, body, *_ in states}  # height by step, m
    rising = _free_rise(z, g * h**2, ball["radius"])
    if not rising:
        *_, (step, end) = z.items()
        # A quarter of free fall; sinking is slower.
        return -1.0 if end < g * (step * h) ** 2 / 8 else 0.0
    last = rising[-1]
    up = (z[last + 1] - z[last - 1]) / (2 * h)  # velocity at step `last`, m/s
    down = _launch_velocity(ball["velocity"][Z], (z[1] - z[0]) / h, g * h)
    # Both parabolas bend alike and meet once, `since` s after step `last` (below 0): where a short
    # impact was. A long one is read at the height of the touch.
    fall = g * h * last  # velocity that gravity gives until then, m/s
    since = (z[last] - z[0] - (down + fall / 2) * last * h) / (down + fall - up)
    plane = ball["radius"]
    if last + since / h > rising[0] - 3:  # they meet less than 3 steps before the rise
        plane = z[last] + (up + g * since / 2) * since
    # Squared speeds at that height, by the energy of free flight, m²/s².
    after = up**2 - 2 * g * (z[last] - plane)
    before = down**2 - 2 * g * (z[0] - plane)
    return math.sqrt(max(0.0, after) / before)


def _launch_velocity(stated: float, first: float, gain: float) -> float:
    """Velocity at step 0, m/s, of the parabola that an engine's steps follow.

    stated: velocity that the engine was given.
    first: mean velocity in its first step.
    gain: velocity of gravity in a step, below 0. That step has none of gravity's share (explicit
    Euler), half (exact flight), or all (semi-implicit Euler).
    """
    share = min((0.0, 0.5, 1.0), key=lambda x: abs(first - stated - x * gain))
    return stated + (share - 0.5) * gain


def _free_rise(z: dict[int, float], fall: float, touch: float) -> list[int]:
    """Steps of a ball's first rise without contact, in order; none if it rests or hovers.

    z: {step: height}, m.
    fall: second difference of the height in free flight, m; 0 without gravity.
    touch: height at which the ball touches, m; without gravity only steps above it are free.
    """
    free: list[int] = []
    is_up = False
    for step, height in z.items():
        if step - 1 not in z or step + 1 not in z:
            continue
        if z[step + 1] <= z[step - 1]:
            if is_up and fall:
                break  # at the top of the first rise
            free.clear()  # without gravity only a contact ends a rise
            continue
        is_up = True
        is_in_contact = height < touch
        if fall:
            bend = z[step + 1] - 2 * height + z[step - 1]
            is_in_contact = abs(bend - fall) > abs(fall) / 2
        if is_in_contact:
            free.clear()  # still, or again
        else:
            free.append(step)
    return free


def height_share(each: Json, states: States) -> Any:
    """The highest of the last recorded heights over the first one."""
    radius = each["world"]["bodies"][0]["radius"]
    highest = max(body[Z] for _, body, *_ in _last(each, states))
    return (highest - radius) / (states[0][1][Z] - radius)


def drift(each: Json, states: States) -> Any:
    """Mean speed of the body that moved farthest in the last span of steps that is recorded, m/s."""
    span = _last(each, states)
    first_step, *before = span[0]
    last_step, *after = span[-1]
    # A body's state begins with its place, x y z.
    moved = max(math.dist(a[:3], b[:3]) for a, b in zip(before, after, strict=True))
    return moved / ((last_step - first_step) * each["world"]["timestep"])


def vibration(each: Json, states: States) -> float:
    """Standard deviation of the velocity of the body that shakes most, m/s."""
    of_bodies = zip(*(bodies for _, *bodies in _last(each, states)), strict=True)
    return max(math.hypot(*(pstdev(at[i] for at in body) for i in (3, 4, 5))) for body in of_bodies)


def force_noise(each: Json, states: States) -> Any:
    """Standard deviation of the contact's force over the weight, from the velocity."""
    upward = [body[VZ] for _, body, *_ in _last(each, states)]  # m/s
    *_, g = each["world"]["gravity"]
    gained = -each["world"]["timestep"] * g  # speed of a step of free fall, m/s
    return pstdev(later - now for now, later in pairwise(upward)) / gained


def depth(each: Json, states: States) -> Any:
    """Final depth of a box in the floor over its height."""
    *_, half = each["world"]["bodies"][0]["half"]
    return 0.5 - states[-1][1][Z] / (2 * half)


def sink(each: Json, states: States) -> Any:
    """Greatest depth of a ball beyond a step's travel, over its radius."""
    ball, *_ = each["world"]["bodies"]
    travel = math.hypot(*ball["velocity"]) * each["world"]["timestep"]
    lowest = min(body[Z] for _, body, *_ in states)
    return max(0.0, ball["radius"] - travel - lowest) / ball["radius"]


def rise(each: Json, states: States) -> Any:
    """Height of the first body's rebound over that of its fall; negative if it fell through.

    each: a run, with its "fall", m, from the body's first height to the touch.
    """
    z = [body[Z] for _, body, *_ in states]
    fall = each["fall"]
    touch = each["world"]["bodies"][0]["position"][Z] - fall
    if z[-1] < touch - fall / 2:  # deeper than a soft contact
        return (z[-1] - touch) / fall
    lowest = min(z)
    touch = max(lowest, touch)  # higher where an engine acts before it
    return max(0.0, max(z[z.index(lowest) :]) - touch) / fall


def velocity(each: Json, states: States) -> list[float]:
    """Final velocity of each body over the first one's first speed."""
    speed = math.hypot(*each["world"]["bodies"][0]["velocity"])
    return [x / speed for body in states[-1][1:] for x in body[3:6]]


def spin(each: Json, states: States) -> list[float]:
    """Final speed of the surface by each body's spin over the first one's first speed."""
    first = each["world"]["bodies"][0]
    arm = first.get("radius") or max(first["half"])  # m
    scale = arm / math.hypot(*first["velocity"])
    return [scale * x for body in states[-1][1:] for x in body[6:9]]


def _last(each: Json, states: States) -> States:
    """States of the last span of steps that a run asks for."""
    begin, _ = each["record"][-1]
    return [state for state in states if state[0] >= begin]


QUANTITIES: Json = {
    f.__name__: f for f in (
        restitution, height_share, drift, vibration, force_noise, depth, sink, rise, velocity, spin
    )
}  # fmt: skip


def judge(results: Json, cases: Json) -> list[Json]:
    """A verdict on each case: {case, title, verdict, why, worst}.

    verdict: "pass", "fail", "unsupported" or "error". worst: [measured, true, run] by quantity.
    """
    done, combine = results["runs"], results["engine"]["combine"]
    return [_judge(case, done.get(case["id"], []), combine) for case in cases["cases"]]


def _judge(case: Json, done: list[Json], combine: Any) -> Json:
    """The verdict on a case, a record as `judge` returns: by the run with the largest error of each
    quantity.

    done: results of the case's runs, in order, as `_run_case` makes them.
    combine: name of the engine's rule for two restitutions, None without one.
    """
    worst: Json = {}  # [measured, true, run] of the largest error, by quantity
    off: Json = {}  # that error
    word, why = "pass", ""
    try:
        for number, (each, result) in enumerate(zip(case["runs"], done, strict=True)):
            if "states" not in result:
                ((word, why),) = result.items()  # "unsupported" or "error"
                break
            if not _is_finite(result["states"]):
                word, why = "fail", f"a state is not finite (run {number})"
                break
            for name, measured, true in _compared(each, result["states"], combine):
                error = abs(measured - true)
                if not error <= off.get(name, -1.0):  # NaN is the worst
                    off[name] = error
                    worst[name] = [measured, true, number]
    except NotImplementedError as error:
        word, why = "unsupported", str(error)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        word, why = "error", f"cannot be read: {type(error).__name__} {error}"
    missed = []
    for name, (measured, true, number) in worst.items():
        limit = case["tolerance"][name]["value"]
        if not off[name] <= limit:
            missed.append(f"{name} {measured:.4g}, not {true:.4g} within {limit:g} (run {number})")
    if word == "pass" and missed:
        word, why = "fail", "; ".join(missed)
    return {"case": case["id"], "title": case["title"], "verdict": word, "why": why, "worst": worst}


def _is_finite(states: States) -> bool:
    return all(math.isfinite(x) for _, *bodies in states for body in bodies for x in body)


def _compared(each: Json, states: States, combine: Any) -> Any:
    """(name, measured, true) of each number that a run expects, three of a vector.

    combine: as of `_judge`.
    Raises NotImplementedError for a run with two materials without a rule.
    """
    materials = each["world"].get("materials")
    if materials and combine is None:
        raise NotImplementedError("no rule for two restitutions is stated")
    for name, expected in each["expected"].items():
        true = COMBINE[combine](materials) if materials else expected
        measured = QUANTITIES[name](each, states)
        if not isinstance(measured, list):
            measured, true = [measured], [true]
        for pair in zip(measured, true, strict=True):
            yield name, *pair


def outcome(verdict: Json, expected: Json) -> tuple[str, str]:
    """A verdict held against what is known: ("passed", "failure" or "skipped", why).

    expected: known failures of the engine, {case: reason}; they are skipped, and fail if they pass.
    """
    known = expected.get(verdict["case"])
    word = verdict["verdict"]
    if word == "pass" and known:
        return "failure", f"passes, but is expected to fail: {known}"
    if word == "pass":
        return "passed", ""
    if known or word == "unsupported":
        return "skipped", known or verdict["why"]
    return "failure", f"{word}: {verdict['why']}"


def junit(verdicts: list[Json], engine: str, expected: Json) -> str:
    """The verdicts of `judge` on one engine as JUnit's XML, a test case each.

    engine: its name.
    expected: its known failures, {case: reason}.
    """
    root = ET.Element("testsuite", name=f"hcbench-cases {engine}", tests=str(len(verdicts)))
    kinds = []
    for verdict in verdicts:
        name = f"{verdict['case']} {verdict['title']}"
        part = ET.SubElement(root, "testcase", name=name, classname=f"hcbench-cases.{engine}")
        kind, text = outcome(verdict, expected)
        kinds.append(kind)
        if kind != "passed":
            ET.SubElement(part, kind, message=text)
    root.set("failures", str(kinds.count("failure")))
    root.set("skipped", str(kinds.count("skipped")))
    # XML holds no control characters.
    return "".join(filter(str.isprintable, ET.tostring(root, encoding="unicode")))


def _start(arguments: list[str]) -> Any:
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)


def run_apart(
    adapter: Path, variant: int, cases: Json, start: Any = _start, limit: float = LIMIT
) -> Json:
    """Results of an engine in a process of its own, up to the first case that ends it.

    That case, or one of more than `limit` s, has errors; those after it are left out.
    The version is "" where no engine could be made.
    variant: place of the engine in the adapter's ENGINES.
    start: runs Python with arguments, and returns its exit code and messages.
    """
    with tempfile.TemporaryDirectory() as folder:
        lines = Path(folder) / "lines"
        asked = Path(folder) / "cases.json"
        lines.touch()
        asked.write_text(json.dumps(cases), "utf-8")
        own = map(str, (adapter, variant, lines))
        done = start([__file__, *own, f"--cases={asked}", f"--limit={limit}"])
        # Results of no case, which name the engine; then those of each case that it came to.
        parts = [json.loads(line) for line in lines.read_text("utf-8").splitlines()]
    said = done.stderr.strip()
    why = f"ended with {done.returncode}: {' '.join(said.split())[-200:]}"
    if "Timeout (" in said:  # of faulthandler
        why = f"took longer than --limit, {limit:g} s"
    if done.returncode == 3:  # of `main`, whose last line is the error
        *_, why = said.split("\n")
    unmade = argparse.Namespace(name=f"ENGINES[{variant}]", version="")
    results = joined(parts or [run(unmade, {**cases, "cases": []})])
    for case in cases["cases"]:
        if case["id"] not in results["runs"]:
            results["runs"][case["id"]] = [{"error": why}] * len(case["runs"])
            break
    return results


def joined(parts: list[Json]) -> Json:
    """Results of one engine in one."""
    runs: Json = {}
    for part in parts:
        runs |= part["runs"]
    return {**parts[0], "cpu_s": round(sum(part["cpu_s"] for part in parts), 3), "runs": runs}


def _work(asked: Any, cases: Json) -> int:
    """Run the cases in one engine, in its process; return 0.

    asked: arguments; `own` has the variant and the file to which a line of results is added before
    the cases and after each, so that a crash leaves those until then.
    """
    faulthandler.dump_traceback_later(asked.limit, exit=True)
    variant, lines = asked.own
    engine = runpy.run_path(str(asked.adapter))["ENGINES"][int(variant)]()
    with Path(lines).open("a", 1, "utf-8") as file:
        for part in ([], *([case] for case in cases["cases"])):
            faulthandler.dump_traceback_later(asked.limit, exit=True)
            print(json.dumps(run(engine, {**cases, "cases": part})), file=file)
    return 0


def _run_every(asked: Any, cases: Json, known: Json) -> int:
    """Run each case of each engine in a process; write the files that were asked for after each.

    known: expected failures, {engine: {case: reason}}.
    Returns the exit code, see `main`.
    """
    failures = 0
    made = 0  # cases for which there was an engine
    done: list[list[Json]] = []  # of each engine the results of its cases
    suites = []  # of each engine its part of the JUnit file
    for variant in range(len(runpy.run_path(str(asked.adapter))["ENGINES"])):
        done.append([])
        suites.append("")
        verdicts: list[Json] = []
        said: Json = {}  # the case that first said an error
        for case in cases["cases"]:
            alone = {**cases, "cases": [case]}
            results = run_apart(asked.adapter, variant, alone, limit=asked.limit)
            done[-1].append(results)
            verdicts += judge(results, alone)
            name = results["engine"]["name"]
            number = case["id"]
            made += results["engine"]["version"] != ""
            expected = known.get(name, {})
            kind, text = outcome(verdicts[-1], expected)
            failures += kind == "failure"
            # The same error in many cases is printed once.
            if text[:5] == "error" and said.setdefault(text, number) != number:
                text = f"error: as in {said[text]}"
            print(f"{name} {number} {kind}  {case['title']}  {text}", file=sys.stderr)
            suites[-1] = junit(verdicts, name, expected)
            if asked.out:
                asked.out.write_text(json.dumps([*map(joined, done)]), "utf-8")
            if asked.junit:
                xml = f"<testsuites>{''.join(suites)}</testsuites>"
                asked.junit.write_text(xml, "utf-8")
    if not made:
        print(f"{asked.adapter}: ENGINES makes no engine", file=sys.stderr)
        return 3
    return 1 if failures else 0


def main() -> int:
    """Run the cases of a file in the engines of an adapter, by the arguments of the command line.

    Returns the exit code: 1 for an unexpected failure or pass, 2 for a file that cannot be read, 3
    for no engine and for any other error.
    """
    parser = argparse.ArgumentParser(description="Run cases in an engine.")
    add = parser.add_argument
    add("adapter", type=Path, help="file with ENGINES")
    add("--cases", type=Path, default=CASES)
    add("--expected", type=Path, help="JSON {engine: {case: reason}}")
    add("--out", type=Path, help="file of results")
    add("--junit", type=Path, help="JUnit file")
    add("--limit", type=float, default=LIMIT, help="seconds a case")
    add("own", nargs="*", help=argparse.SUPPRESS)  # of its processes
    asked = parser.parse_args()
    try:
        cases = load(asked.cases)
        known = json.loads(asked.expected.read_text("utf-8")) if asked.expected else {}
        asked.adapter.read_bytes()
    except (OSError, ValueError) as error:
        parser.error(str(error))
    try:
        return _work(asked, cases) if asked.own else _run_every(asked, cases, known)
    except Exception as error:
        print(_with_place(error), file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
