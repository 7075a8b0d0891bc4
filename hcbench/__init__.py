"""hcbench measures how physics engines really bounce.

The public names, each imported when first used so that `import hcbench` costs almost nothing.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers read it; `typing` takes its time, in which Ctrl-C shows a traceback
if TYPE_CHECKING:
    from typing import Any

    from hcbench.benchmark.results import Results
    from hcbench.benchmark.run import run_study
    from hcbench.benchmark.study import Study, load_study
    from hcbench.errors import HcbenchError
    from hcbench.impact import Impact, Launch, Loop, Status
    from hcbench.laws.force import HuntCrossley, KelvinVoigt
    from hcbench.measuring import Measurement, Wanted
    from hcbench.measuring.landing import land
    from hcbench.measuring.trajectory import measure_trajectory
    from hcbench.recipes.target import Target
    from hcbench.scene import Scene, load_scene
    from hcbench.scoring import Score, score
    from hcbench.setting import Setting
    from hcbench.sim.landing import Landings
    from hcbench.sim.registry import engine
    from hcbench.tuning.answer import Answer
    from hcbench.tuning.ask import tune

_HOMES = {
    "Answer": "tuning.answer",
    "HcbenchError": "errors",
    "HuntCrossley": "laws.force",
    "Impact": "impact",
    "KelvinVoigt": "laws.force",
    "Landings": "sim.landing",
    "Launch": "impact",
    "Loop": "impact",
    "Measurement": "measuring.measurement",
    "Results": "benchmark.results",
    "Scene": "scene",
    "Score": "scoring",
    "Setting": "setting",
    "Status": "impact",
    "Study": "benchmark.study",
    "Target": "recipes.target",
    "Wanted": "measuring.measurement",
    "engine": "sim.registry",
    "land": "measuring.landing",
    "load_scene": "scene",
    "load_study": "benchmark.study",
    "measure": "measuring.measure",
    "measure_trajectory": "measuring.trajectory",
    "run_study": "benchmark.run",
    "score": "scoring",
    "tune": "tuning.ask",
}

__all__ = [
    "Answer",
    "HcbenchError",
    "HuntCrossley",
    "Impact",
    "KelvinVoigt",
    "Landings",
    "Launch",
    "Loop",
    "Measurement",
    "Results",
    "Scene",
    "Score",
    "Setting",
    "Status",
    "Study",
    "Target",
    "Wanted",
    "engine",
    "land",
    "load_scene",
    "load_study",
    "measure",
    "measure_trajectory",
    "run_study",
    "score",
    "tune",
]


def __getattr__(name: str) -> Any:
    from importlib import import_module

    if name == "__version__":
        globals()[name] = import_module("importlib.metadata").version("hcbench")
        return globals()[name]
    if name in _HOMES:
        return getattr(import_module(f"hcbench.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'hcbench' has no attribute {name!r}")


def _figures() -> Any:
    """What draws every result, for those below that show themselves."""
    from importlib import import_module

    return import_module("hcbench.reporting.notebook")
