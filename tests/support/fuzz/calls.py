"""Random calls of the Python API: each ends in an HcbenchError of one
line, or in a plausible result.
"""

from __future__ import annotations

import random
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from math import inf, isfinite, nan
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[3]
LONGEST_S = 60
_HOSTILE: list[Any] = [
    None, True, False, nan, inf, -inf, 0, -1, 1e308, -1e308, 1e-320, 10**400, "", "x", "nan", "1 kg", "1e9 m", "-3",
    b"1", [], {}, [1, 2], {"a": 1}, (1,), 1j, "٣", "0.3\n", "1:2:1e12", "ball", "a\0b", [None], "0.3 +- 5", object(),
]  # fmt: skip
_EARLY: list[Any] = [nan, -1, "x", "1 kg", {}, 1e9]  # refused before anything is simulated
_LARGEST_E = 1.0005


def _calls(folder: Path) -> dict[str, tuple[int, list[Any], dict[str, Any]]]:
    """Share, good arguments by place, and good ones by name, for each function."""
    (folder / "h.csv").write_text("height [cm]\n30\n22\n17\n13.5\n11\n9.2\n7.8\n")
    (folder / "f.csv").write_text(
        "time [ms],force [N]\n" + "".join(f"{t},{max(0, 9 - (t - 9) ** 2)}\n" for t in range(20))
    )
    model = str(ROOT / "examples" / "good.xml")
    start = {
        "key": "qpos0",
        "qpos": "ball=0 0 1 1 0 0 0",
        "state": None,
        "timestep": "1e-3",
        "gravity": "9.81",
    }
    return {
        "law": (30, ["0.3 s/m"], {"mass": "1 lb", "stiffness": "3e9", "exponent": 1.5}),
        "convert": (30, [], {
            "alpha": "0.3", "drake": 0.3, "simbody": 0.2, "restitution": 0.9, "solref": "-2e5 -80", "newton": (1e5, 10),
            "adams": (1e9, 1.5, 1e4, 1e-4), "mass": 1, "speed": "0.2 m/s", "contact_time": "0.2 ms", "timestep": 1e-3,
        }),
        "fit": (16, [str(folder / "h.csv")], {
            "law": "auto", "kind": "times", "touches": "x", "begin": 0, "height": "30 cm", "gravity": 9.81,
            "mass": "3 g", "diameter": "4 cm", "contact_time": "0.1 ms", "timing": "1 ms",
        }),
        "fit_force": (4, [str(folder / "f.csv")], {
            "kind": "force", "mass": "3 g", "speed": "0.5 m/s", "height": "1 cm", "gravity": 9.81, "exponent": 1.5,
        }),
        "measure": (7, [model, "ball,plate"], {
            **start, "alpha": 0.3, "points": [(0.1, 0.9)], "angle": "30 deg", "spin": 40, "along": "0,1,0",
        }),
        "check": (6, [model, "ball,plate"], {**start, "restitution": 0.9, "jobs": 1, "max_error": 0.05}),
        "tune": (4, ["mujoco"], {"alpha": 0.3, "timestep": 1e-3, "recipe": "impulse", "mass": 1, "friction": 0.1}),
        "tune_model": (4, [model, "ball,plate"], {
            **start, "restitution": 0.5, "max_error": 0.1, "version": "mujoco@3.5", "coming_from": "above",
        }),
        "land": (2, [model], {**start, "tilt": 5, "controller": "pd"}),
        "pairs": (6, [model], {"key": "qpos0", "qpos": "ball=0", "engine": "mujoco", "package": {"a": "b"}}),
    }  # fmt: skip


def _make(calls: dict[str, Any], number: int) -> tuple[str, list[Any], dict[str, Any]]:
    chance = random.Random(number)
    name = chance.choices(list(calls), [share for share, *_ in calls.values()])[0]
    _, places, names = calls[name]
    share = 0.15 if number % 2 else 0.5

    def value(good: Any) -> Any:
        return chance.choice(_HOSTILE) if chance.random() < share else good

    arguments = [value(good) for good in places]
    options = {key: value(good) for key, good in names.items() if chance.random() < 0.3}
    if name in ("measure", "check"):
        options |= {"phases": value(1), "speeds": value("0.3")}
    if name in ("tune", "tune_model", "land"):
        options["heights" if name == "land" else "speeds"] = chance.choice(_EARLY)
    return name, arguments, options


def _faults(name: str, result: Any) -> Iterator[str]:
    if name == "law":
        e = [1.0, *(result.e(speed) for speed in (0.01, 0.1, 1, 5)), 0.0]
        # Of several α e is an array.
        if any(np.any(slow < fast) for slow, fast in pairwise(e)):
            yield f"e at rising speeds: {e}"
    elif hasattr(result, "as_dict"):
        yield from _odd_numbers(result.as_dict())
    if not str(result):
        yield "prints nothing"


def _odd_numbers(content: Any, name: str = "") -> Iterator[str]:
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _odd_numbers(value, key)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from _odd_numbers(value, name)
    elif isinstance(content, float):
        is_e = name in ("e", "restitution")
        if not isfinite(content) or (is_e and not -1e-9 <= content <= _LARGEST_E):
            yield f"{name} = {content}"


def _late(_: int, __: FrameType | None) -> None:
    raise TimeoutError("hang")


def call(numbers: range, folder: Path) -> list[str]:
    """Make random calls. Prints the counts, and returns what went wrong."""
    import hcbench as hb

    calls, counts, wrong = _calls(folder), Counter[str](), []
    before = signal.signal(signal.SIGALRM, _late)
    for number in numbers:
        name, arguments, options = _make(calls, number)
        function: Callable[..., Any] = getattr(hb, name)
        signal.alarm(LONGEST_S)
        try:
            found = list(_faults(name, function(*arguments, **options)))
            kind = "result"
        except hb.HcbenchError as error:
            found, kind = ["a message of several lines"] if "\n" in str(error) else [], "refused"
        except BaseException as error:
            found, kind = [f"{type(error).__name__} {error}"], "unnamed"
        signal.alarm(0)
        counts[kind] += 1
        wrong += [f"call {number}: {fault}: {name} {arguments} {options}" for fault in found]
    signal.signal(signal.SIGALRM, before)
    print(
        *wrong, f"{len(numbers)} calls: {len(wrong)} faults, {dict(counts)}", sep="\n", flush=True
    )
    return wrong
