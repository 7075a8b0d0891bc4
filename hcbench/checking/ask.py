"""`hcbench.check`: hold a model to a target, as CI does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench._arguments import checked
from hcbench.checking.command import check as run_spec
from hcbench.checking.spec import CheckSpec
from hcbench.errors import UserError
from hcbench.fields import validate
from hcbench.launch_options import PintQuantity
from hcbench.measuring.request import read_pair

if TYPE_CHECKING:
    from hcbench.checking.outcome import Report


@checked
def check(
    model: str | Path | Sequence[str | Path] = (),
    pair: Any = None,
    *,
    jobs: int = 1,
    measure_only: bool = False,
    **options: Any,
) -> Report:
    """Hold a pair of your model to a target, as `hcbench check` does.

    Parameters
    ----------
    model : path or two paths, optional
        A model, two URDFs, a study, or a TOML file with a [tool.hcbench] table; ./pyproject.toml by default.
    pair : text or two names, optional
        Two bodies or geoms, first the one that moves.
    jobs : int
        Worker processes, for a study.
    measure_only : bool
        Measure without a target; nothing can fail.
    **options
        One target: alpha (s/m or with a unit, read as `target` "law" or "linear"), restitution, pairs (a CSV
        file), baseline (a file), or require ("e < 0.3, peak < 6") with heights, tilt, controller or
        trajectory. max_error of e, 0.02 by default. engine, limit (s or with a unit), and the options of
        launches, as `LaunchOptions` describes them.

    Returns
    -------
    Report
        `exit_code`, as the command ends with; `raise_if_failed()`; `outcomes`, one a check.

    Raises
    ------
    UserError
        For what cannot be planned, in the argument's name.

    Examples
    --------
    >>> import hcbench as hb
    >>> hb.check("ball.xml", "ball,plate", restitution=0.9, speeds="0.2, 0.5 m/s", max_error=0.01)
    PASSED ball.xml: largest error -0.00136 at 0.2058 m/s, limit 0.01

    """
    models = [model] if isinstance(model, str | Path) else list(model)
    if "target" in options:
        options["reading"] = options.pop("target")
    given = {name: _plain(value) for name, value in options.items()}
    names = read_pair(pair)
    spec = validate(CheckSpec, {"model": tuple(map(str, models)), "pair": names, **given}, UserError)
    return run_spec(spec, jobs=jobs, measure_only=measure_only)


def _plain(value: Any) -> Any:
    """A quantity of Pint's as text, which files of checks have, too."""
    return f"{value.magnitude!s} {value.units}" if isinstance(value, PintQuantity) else value
