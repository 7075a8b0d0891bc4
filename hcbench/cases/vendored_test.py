# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Bounces that the engine of adapter.py should get right, as tests of unittest; pytest runs them too.

`known.json` beside this file names failures that are known: {engine: {case: reason}}.
"""

from __future__ import annotations

import json
import runpy
import unittest
from collections.abc import Callable
from pathlib import Path

import hcbench_cases  # type: ignore[import-not-found]

HERE = Path(__file__).resolve().parent
ADAPTER = HERE / "adapter.py"
KNOWN = HERE / "known.json"
CASES = hcbench_cases.load(HERE / "hcbench-cases-1.json")


class TestBounces(unittest.TestCase):
    """A test for each engine of the adapter and each case, in a process of its own."""


def _test(variant: int, case: hcbench_cases.Json) -> Callable[[TestBounces], None]:
    """The test of a case in an engine; its docstring is the case's title and equation."""

    def test(self: TestBounces) -> None:
        alone = {**CASES, "cases": [case]}
        results = hcbench_cases.run_apart(ADAPTER, variant, alone)
        (verdict,) = hcbench_cases.judge(results, alone)
        known = json.loads(KNOWN.read_text("utf-8")) if KNOWN.is_file() else {}
        kind, text = hcbench_cases.outcome(verdict, known.get(results["engine"]["name"], {}))
        if kind == "skipped":
            self.skipTest(text)
        self.assertEqual(kind, "passed", text)

    test.__doc__ = f"{case['title']}: {case['equation']}."
    return test


for number in range(len(runpy.run_path(str(ADAPTER))["ENGINES"])):
    for each in CASES["cases"]:
        setattr(TestBounces, f"test_{each['id'].lower()}_engine_{number}", _test(number, each))
