# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Bounces that the engine of adapter.py should get right, as tests of unittest and pytest.

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
_FILE = HERE / "known.json"
KNOWN = json.loads(_FILE.read_text("utf-8")) if _FILE.is_file() else {}
CASES = hcbench_cases.load(HERE / "hcbench-cases-1.json")


class TestBounces(unittest.TestCase):
    """A test for each engine and each case, in a process of its own."""


def _test(variant: int, case: hcbench_cases.Json) -> Callable[[TestBounces], None]:
    """The test of a case in an engine, with its title and equation as docstring."""

    def test(self: TestBounces) -> None:
        alone = {**CASES, "cases": [case]}
        results = hcbench_cases.run_apart(ADAPTER, variant, alone)
        (verdict,) = hcbench_cases.judge(results, alone)
        kind, text = hcbench_cases.outcome(verdict, KNOWN.get(results["engine"]["name"], {}))
        if kind == "skipped":
            self.skipTest(text)
        self.assertEqual(kind, "passed", text)

    test.__doc__ = f"{case['title']}: {case['equation']}."
    return test


for number in range(len(runpy.run_path(str(ADAPTER))["ENGINES"])):
    for each in CASES["cases"]:
        setattr(TestBounces, f"test_{each['id'].lower()}_engine_{number}", _test(number, each))
