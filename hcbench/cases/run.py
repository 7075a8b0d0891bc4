"""Runs the cases in engines that have an adapter, each in a process, beside
hcbench or in its environment.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hcbench.cases.hcbench_cases import LIMIT, Json, run_apart
from hcbench.cases.score import the_cases
from hcbench.environments import run_with_parent
from hcbench.sim import registry
from hcbench.sim.remote import RemoteEngine
from hcbench.system.errors import EngineFailed, UserError
from hcbench.system.files import read_text

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
    python = Path(sys.executable)
    if isinstance(engine, RemoteEngine):
        python = engine.environment.executable
    with tempfile.TemporaryDirectory() as folder:

        def start(arguments: list[str]) -> subprocess.CompletedProcess[str]:
            return run_with_parent([str(python), *arguments], Path(folder), os.environ)

        try:
            return run_apart(adapter, variant, cases, start, limit)
        except RuntimeError as error:
            reason = str(error).splitlines()[-1]
            raise EngineFailed(f"engine {name!r}", reason, "results of its cases") from None
