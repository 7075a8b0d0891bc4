"""`hcbench.check`: hold a model to a target, as CI does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from hcbench.checking.command import check as run_spec
from hcbench.checking.spec import CheckSpec
from hcbench.measuring.request import read_pair
from hcbench.system.errors import UserError
from hcbench.terms.arguments import checked
from hcbench.terms.fields import validate
from hcbench.terms.options import BodyPair, CheckOptions, Jobs, PintQuantity

if TYPE_CHECKING:
    from hcbench.checking.outcome import Report


@checked
def check(
    model: str | Path | Sequence[str | Path] = (),
    pair: BodyPair | None = None,
    *,
    name: str | None = None,
    jobs: Jobs = 1,
    measure_only: bool = False,
    **options: Unpack[CheckOptions],
) -> Report:
    """Hold a pair of your model to a target, as `hcbench check` does.

    Parameters
    ----------
    model : path or two paths, optional
        A model, two URDFs, a study, or a TOML file with a [tool.hcbench] table; ./pyproject.toml by default.
    pair : text or two names, optional
        Two bodies or geoms, first the one that moves.
    name : text, optional
        What the result calls the check; the file's name by default.
    material, alpha, restitution, points, baseline, require : optional
        One target: a pair of materials that `materials` lists; α, s/m or with a unit, read as `target` "law"
        or "linear"; one e for all speeds; a CSV file of measured pairs; a baseline that
        `hcbench check --write-baseline` wrote; or limits on landings or on a recorded motion,
        "e < 0.3, peak < 6".
    heights, tilt, controller : optional
        With `require`: how to drop a robot, as `land` takes them.
    trajectory : path, optional
        With `require`: a file of a recorded motion, as `measure_trajectory` takes it.
    max_error : float, optional
        Of e, 0.02 by default.
    max_depth, max_vibration : float, text or quantity of Pint's, optional
        Most of the penetration, m, and of the vibration, m/s (rms), at rest.
    engine, limit : optional
        As `measure` takes them.
    jobs : int
        Worker processes, for a study.
    measure_only : bool
        Measure without a target; nothing can fail.
    **launch
        Speeds, pose and all else of the launches, as `measure` takes them.

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
    given = {
        "model": tuple(map(str, models)),
        "pair": read_pair(pair),
        "name": name,
        **options,
    }
    plain = {slot: _plain(value) for slot, value in given.items()}
    return run_spec(validate(CheckSpec, plain, UserError), jobs=jobs, measure_only=measure_only)


def _plain(value: Any) -> Any:
    """A quantity of Pint's as text, which files of checks have, too."""
    return f"{value.magnitude!s} {value.units}" if isinstance(value, PintQuantity) else value
