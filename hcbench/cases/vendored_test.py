# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""Bounces that the engine of adapter.py should get right, as tests of unittest and pytest.

`known.json` beside this file names known failures: {engine: {case: reason}}.
"""

import json
import runpy
import unittest
from pathlib import Path

import hcbench_cases

HERE = Path(__file__).resolve().parent
ADAPTER = HERE / "adapter.py"
FILE = HERE / "known.json"
KNOWN = json.loads(FILE.read_text("utf-8")) if FILE.is_file() else {}
CASES = hcbench_cases.load(HERE / "hcbench-cases-1.json")


class TestBounces(unittest.TestCase):
    """A test of each case in each engine, in its own process."""


def _test(variant: int, case: hcbench_cases.Json) -> object:
    """The test of a case in an engine, as a method of a test class.

    variant: place of the engine in the adapter's ENGINES. The test fails for a failure or a pass
    that is not in known.json, and is skipped for one that is.
    """

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
