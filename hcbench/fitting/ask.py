"""`hcbench.fit` and `hcbench.fit_force`: measured files, and what is known
besides, to α of the material.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hcbench.fitting.fit import fit as fit_sets
from hcbench.fitting.read import KINDS, Excerpt, has_force, read_datasets, read_force
from hcbench.fitting.result import compare
from hcbench.fitting.setup import MeasurementSetup, read_setup, require_different
from hcbench.system.errors import UserError
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import Quantity

if TYPE_CHECKING:
    from hcbench.fitting.force import ForceFit
    from hcbench.fitting.result import FitResult

LawToFit = Literal["auto", "hunt-crossley", "constant", "viscoelastic", "plastic"]


@checked
def fit(
    *files: str | Path,
    law: LawToFit = "auto",
    kind: str | None = None,
    touches: str | None = None,
    against: str | Path | Sequence[str | Path] = (),
    begin: Quantity | None = None,
    end: Quantity | None = None,
    height: Quantity | None = None,
    gravity: Quantity | None = None,
    mass: Quantity | None = None,
    diameter: Quantity | None = None,
    drag_coefficient: Quantity | None = None,
    contact_time: Quantity | None = None,
    timing: Quantity | None = None,
) -> FitResult:
    """Find α of your material from a measurement of bounces, as `hcbench fit` does.

    Parameters
    ----------
    *files : paths
        Recordings, times, heights, tracks or pairs of one ball on one plate, with units in their headers.
        `fit_force` fits a file of forces.
    law : {"auto", "hunt-crossley", "constant", "viscoelastic", "plastic"}
        The law, where you know it.
    kind : text, optional
        Kind of data, in place of what the header says: "times", "heights", "pairs", ...
    touches : text, optional
        Touches of a recording to use: "2:14", train "B", or "B2:14".
    against : path or several, optional
        Files of another material; `against` of the result says whether the two differ.
    begin, end : float, text or quantity of Pint's, optional
        Part of a recording to read, s or with a unit.
    height, gravity, mass, diameter, drag_coefficient, contact_time : optional
        Quantities that you know besides, SI or with a unit, also with a standard uncertainty such as
        "30 +- 0.1 cm": the height of release, g, mass and diameter of the ball, its drag coefficient, the
        duration of the first impact.
    timing : float, text or quantity of Pint's, optional
        Standard uncertainty of a time reading, s or with a unit.

    Returns
    -------
    FitResult
        `alpha` has the value in s/m with its interval; None where the data do not support the law.

    Raises
    ------
    UserError
        Where the files do not hold enough, with the reason.

    Examples
    --------
    >>> import hcbench as hb
    >>> found = hb.fit("pairs.csv")
    >>> found.law, round(found.alpha.value, 2)
    ('hunt-crossley', 0.3)

    """
    paths = list(map(Path, files))
    if not paths:
        advice = "`hcbench fit --help` shows what"
        raise UserError("files", "none given", "a file of measured bounces", advice)
    if kind is not None and kind not in KINDS:
        raise UserError("kind", repr(kind), f"one of {', '.join(KINDS)}")
    setup = read_setup(
        height=height,
        gravity=gravity,
        mass=mass,
        diameter=diameter,
        drag_coefficient=drag_coefficient,
        contact_time=contact_time,
        timing=timing,
    )
    if len(paths) == 1 and has_force(paths[0], kind):
        raise UserError("files", f"{paths[0]}, forces", "measured bounces", "Use `fit_force`")
    if isinstance(against, str | Path):
        others = [Path(against)]
    else:
        others = list(map(Path, against))
    return fit_files(paths, others, law, kind, setup, read_excerpt(begin, end, touches))


@checked
def fit_force(
    file: str | Path,
    *,
    kind: Literal["force", "loop"] | None = None,
    mass: Quantity | None = None,
    speed: Quantity | None = None,
    height: Quantity | None = None,
    gravity: Quantity | None = None,
    exponent: Quantity | None = None,
) -> ForceFit:
    """Find k, n and α of your material from a measurement of forces, as `hcbench fit` does.

    Parameters
    ----------
    file : path
        Force over time of one pulse, or penetration, rate and force of any number of impacts, with units in
        its header.
    kind : {"force", "loop"}, optional
        Force over time, or over penetration and rate, in place of what the header says.
    mass : float, text or quantity of Pint's, optional
        Effective mass, kg or with a unit; a pulse needs it.
    speed, height, gravity : optional
        Of a pulse: the speed of approach, or the height of release and g; SI or with a unit, also with a
        standard uncertainty such as "0.5 +- 0.01 m/s".
    exponent : float, text or quantity of Pint's, optional
        n, where you know it.

    Returns
    -------
    ForceFit
        `stiffness`, N/mⁿ, `exponent` and `alpha`, s/m.

    Raises
    ------
    UserError
        Where the file does not hold enough, with the reason.

    """
    setup = read_setup(mass=mass, speed=speed, height=height, gravity=gravity, exponent=exponent)
    fitted = read_force(Path(file), setup, kind)
    if fitted is None:
        raise UserError(
            "file", f"{file}, no forces", "force over time, or over penetration and rate"
        )
    return fitted


def fit_files(
    paths: Sequence[Path],
    against: Sequence[Path],
    law: str,
    kind: str | None,
    setup: MeasurementSetup,
    part: Excerpt,
) -> FitResult:
    """One fit of all files, compared with that of another material's where `against` names any.

    paths: one file or more.
    law: a name in LAWS, or "auto".
    kind: kind of the data, in place of what the headers say.
    part: of recordings.
    Raises UserError for a file given twice, for one that cannot be read or fitted, and for two
    materials without a number to compare.
    """
    require_different((*paths, *against))

    def fit_group(group: Sequence[Path]) -> FitResult:
        return fit_sets(
            [one for path in group for one in read_datasets(path, setup, kind, part)], law
        )

    fitted = fit_group(paths)
    if not against:
        return fitted
    return replace(fitted, against=compare(fitted, fit_group(against)))


def read_excerpt(begin: Any, end: Any, touches: str | None) -> Excerpt:
    """The part of a recording that a user names: times, SI or with
    units, and touches such as "B2:14".

    Raises QuantityError for text that is not a time, and UserError for touches of another form.
    """
    first = 0.0
    if begin is not None:
        first = units.parse(begin, "time", "from", least=0)
    last = None
    if end is not None:
        last = units.parse(end, "time", "to", above=0)
    train, numbers = _touches(touches)
    return Excerpt(first, last, train, numbers)


def _touches(text: str | None) -> tuple[int | None, range | None]:
    """The train, from 0, and its touches, from 1, of "2:14", "B" or "B2:14". Without a letter the
    train is the first; without numbers the touches are None; without a text both are.

    Raises UserError for text of another form, and for touches that do not rise from 1.
    """
    if text is None:
        return None, None
    expected = "the first and the last to take, such as 2:14, or a train, such as B"
    match = re.fullmatch(r"\s*([A-Fa-f])?\s*(?:([0-9]{1,6}):([0-9]{1,6}))?\s*", text)
    if match is None or not text.strip():
        raise UserError("--touches", repr(text), expected)
    letter, first, last = match.groups()
    train = ord((letter or "A").upper()) - ord("A")
    if first is None:
        return train, None
    if not 0 < int(first) < int(last):
        raise UserError("--touches", repr(text), expected)
    return train, range(int(first), int(last) + 1)
