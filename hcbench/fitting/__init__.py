"""From a measurement of bounces to α with its uncertainty, and to the law that the data support."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hcbench.errors import UserError

if TYPE_CHECKING:
    from hcbench.fitting.result import FitResult
    from hcbench.fitting.setup import MeasurementSetup


def fit_files(*files: str | Path, setup: MeasurementSetup | None = None, law: str = "auto") -> FitResult:
    """α of the material in files of measured bounces, as `hcbench fit` finds it.

    files: recordings, times, heights, tracks or pairs of one ball on one plate. setup: what is known besides;
    by default standard gravity and no drop height. law: "auto", or one that the data follow for certain.
    Raises UserError where the files do not hold enough. The result shows itself in a notebook.
    """
    from hcbench.fitting.fit import fit
    from hcbench.fitting.read import read_dataset
    from hcbench.fitting.setup import MeasurementSetup

    known = MeasurementSetup() if setup is None else setup
    if not isinstance(known, MeasurementSetup):
        raise UserError("setup", f"{setup!r:.80}", "a MeasurementSetup")
    for file in files:
        if not isinstance(file, str | Path):
            raise UserError("files", f"{file!r:.80}", "paths")
    return fit([read_dataset(Path(file), known) for file in files], law)
