"""hcbench measures how physics engines really bounce.

>>> import hcbench as hb
>>> round(hb.law(alpha="0.3 s/m").e("1 m/s"), 3)
0.768

`dir(hcbench)` names the verbs of the command line and what they need; the classes of results,
studies and engines are here, too. Each name is imported when first used, so that `import
hcbench` costs almost nothing.
"""

from __future__ import annotations

# Type checkers read the name like `typing`'s. Importing `typing` takes time in which Ctrl-C would
# show a traceback.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from hcbench import paper as paper
    from hcbench.benchmark.results import Results as Results
    from hcbench.benchmark.run import run_study as run_study
    from hcbench.benchmark.study import Study as Study
    from hcbench.benchmark.study import load_study as load_study
    from hcbench.catalogue.find import Materials as Materials
    from hcbench.catalogue.find import materials
    from hcbench.catalogue.material import MaterialPair as MaterialPair
    from hcbench.checking.command import check
    from hcbench.fitting.ask import fit, fit_force
    from hcbench.laws.force import HuntCrossley as HuntCrossley
    from hcbench.laws.force import KelvinVoigt as KelvinVoigt
    from hcbench.laws.impact_law import ImpactLaw as ImpactLaw
    from hcbench.laws.impact_law import ImpactLaws as ImpactLaws
    from hcbench.laws.impact_law import law
    from hcbench.measuring import Measurement as Measurement
    from hcbench.measuring import Wanted as Wanted
    from hcbench.measuring.landing import land
    from hcbench.measuring.landing import measure_trajectory as measure_trajectory
    from hcbench.measuring.measure import measure, pairs
    from hcbench.recipes.target import Target as Target
    from hcbench.reporting.ask import report
    from hcbench.scoring import Score as Score
    from hcbench.scoring import score as score
    from hcbench.sim.convert import convert
    from hcbench.sim.landing import Landings as Landings
    from hcbench.sim.registry import engine
    from hcbench.system.errors import HcbenchError
    from hcbench.terms.impact import Impact as Impact
    from hcbench.terms.impact import Launch as Launch
    from hcbench.terms.impact import Loop as Loop
    from hcbench.terms.impact import Status as Status
    from hcbench.terms.scene import Scene as Scene
    from hcbench.terms.scene import load_scene
    from hcbench.terms.setting import Setting as Setting
    from hcbench.tuning.answer import Answer as Answer
    from hcbench.tuning.ask import tune, tune_model
    from hcbench.tuning.random_worlds import RandomWorlds as RandomWorlds
    from hcbench.tuning.randomize import randomize

_VERBS = {
    "HcbenchError": "system.errors",
    "check": "checking.command",
    "convert": "sim.convert",
    "engine": "sim.registry",
    "fit": "fitting.ask",
    "fit_force": "fitting.ask",
    "land": "measuring.landing",
    "law": "laws.impact_law",
    "load_scene": "terms.scene",
    "materials": "catalogue.find",
    "measure": "measuring.measure",
    "pairs": "measuring.measure",
    "randomize": "tuning.randomize",
    "report": "reporting.ask",
    "tune": "tuning.ask",
    "tune_model": "tuning.ask",
}
# Classes and functions of studies, engines and results.
_CLASSES = {
    "Answer": "tuning.answer",
    "HuntCrossley": "laws.force",
    "Impact": "terms.impact",
    "ImpactLaw": "laws.impact_law",
    "ImpactLaws": "laws.impact_law",
    "KelvinVoigt": "laws.force",
    "Landings": "sim.landing",
    "Launch": "terms.impact",
    "Loop": "terms.impact",
    "MaterialPair": "catalogue.material",
    "Materials": "catalogue.find",
    "Measurement": "measuring.measurement",
    "RandomWorlds": "tuning.random_worlds",
    "Results": "benchmark.results",
    "Scene": "terms.scene",
    "Score": "scoring",
    "Setting": "terms.setting",
    "Status": "terms.impact",
    "Study": "benchmark.study",
    "Target": "recipes.target",
    "Wanted": "measuring.measurement",
    "beyond_bounds": "terms.bounds",
    "load_study": "benchmark.study",
    "measure_trajectory": "measuring.landing",
    "run_study": "benchmark.run",
    "score": "scoring",
}

__all__ = [
    "HcbenchError",
    "check",
    "convert",
    "engine",
    "fit",
    "fit_force",
    "land",
    "law",
    "load_scene",
    "materials",
    "measure",
    "pairs",
    "randomize",
    "report",
    "tune",
    "tune_model",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__", "paper"]


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: `import hcbench` alone takes no time.

    Raises AttributeError for any other name.
    """
    from importlib import import_module

    if name == "__version__":
        globals()[name] = import_module("importlib.metadata").version("hcbench")
        return globals()[name]
    if name == "paper":
        return import_module("hcbench.paper")
    if home := _VERBS.get(name) or _CLASSES.get(name):
        return getattr(import_module(f"hcbench.{home}"), name)
    raise AttributeError(f"module 'hcbench' has no attribute {name!r}")


def _figures() -> Any:
    """The module that draws results, for rooms that may not import it."""
    from importlib import import_module

    return import_module("hcbench.reporting.notebook")
