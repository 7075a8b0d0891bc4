"""An engine for sweeps to trip over: the reference, that dies, hangs or
breaks where its notes say so.

`installed` registers it by entry points, as any engine is, also for processes that are started.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.engines.reference import ReferenceEngine
from hcbench.recipes.law_recipes import law_options
from hcbench.recipes.recipe import Recipe, Role
from hcbench.sim import entry_points
from hcbench.sim.engine import Engine
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pytest

    from hcbench.recipes.target import Target
    from hcbench.terms.impact import Impact, Launch
    from hcbench.terms.scene import Scene

NOTES = "HCBENCH_TEST_NOTES"  # the file, in the environment: processes that are started see it too


class Tripping(Engine):
    """Notes: {"segfault": [[speed, phase], ...], "hang": ..., "memory": ..., "error":
    ..., "log": file, "sleep": s}.
    """

    name = "tripping"

    def version(self) -> str:
        return str(_notes().get("version", "1"))

    def recipes(self) -> Sequence[Recipe]:
        def law(target: Target) -> dict[str, float]:
            return law_options(target.law)

        return [Recipe("tripping", "law", Role.LAW, law, "The law, with trouble.", native=False)]

    def impacts(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        notes = _notes()
        for launch in launches:
            for trouble in (_segfault, _hang, _memory, _error):
                if [launch.speed, launch.phase] in notes.get(trouble.__name__[1:], []):
                    trouble()
        time.sleep(notes.get("sleep", 0.0))
        if "log" in notes:
            with Path(notes["log"]).open("a") as log:
                log.write("".join(f"{launch.speed!r} {launch.phase!r}\n" for launch in launches))
        own = Setting("reference", "hunt-crossley", setting.timestep, setting.options)
        return ReferenceEngine().impacts(scene, own, launches)


def _segfault() -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def _hang() -> None:
    time.sleep(600)


def _memory() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
    bytearray(8 << 30)


def _error() -> None:
    raise RuntimeError("the solver\nlost its way")


def _notes() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(Path(os.environ[NOTES]).read_text())
    return found


def installed(folder: Path, monkeypatch: pytest.MonkeyPatch, **notes: Any) -> Iterator[None]:
    """While a folder that Python looks in says that it is installed."""
    monkeypatch.setenv(NOTES, str(folder / "notes.json"))
    note(folder, **notes)
    about = folder / "tripping-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: tripping\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[hcbench.engines]\ntripping = sweep_engine:Tripping\n")
    monkeypatch.syspath_prepend(folder)
    _look_again()
    yield
    _look_again()


def note(folder: Path, **notes: Any) -> None:
    """Fault that occurs from now on."""
    (folder / "notes.json").write_text(json.dumps(notes))


def _look_again() -> None:
    entry_points.registered.cache_clear()
    entry_points.adapter.cache_clear()
