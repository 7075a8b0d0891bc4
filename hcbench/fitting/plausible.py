"""Refuse touches that cannot be bounces of one ball: those of a clock, or of another drop than the
given one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.fitting.setup import MeasurementSetup
    from hcbench.terms.impact import Floats

# Largest e of a ball over several bounces: steel on steel reaches 0.99.
_MOST_E = 0.999
# Bounds of the first touch's e by the drop height, over the second touch's e by the times.
_HEIGHT_E = (0.33, 1.05)


def require_a_ball(name: str, setup: MeasurementSetup, times: Floats) -> None:
    """Look at times of touches, s. Raises UserError where they shrink by less than any ball's, and
    where the height of the drop contradicts the first flight.
    """
    flights = np.diff(times)
    ratio = float(np.median(flights[1:] / flights[:-1]))
    if ratio > _MOST_E:
        got = f"intervals that shrink by a factor of {ratio:.4f} each, {flights[0]:.4g} s"
        raise UserError(
            name, got, f"below {_MOST_E:g}, as of a ball", "A clock keeps its intervals"
        )
    if setup.height is None:
        return
    speed = setup.ballistics.dropped(setup.height.value)[0]
    first = 0.5 * setup.gravity.value * float(flights[0]) / speed
    second = float(flights[1] / flights[0])
    if not _HEIGHT_E[0] * second <= first <= _HEIGHT_E[1]:
        rise = setup.gravity.value * float(flights[0]) ** 2 / 8.0
        got = f"{setup.height.value:.4g} m, and a first flight of {flights[0]:.4g} s, {rise:.3g} m high"
        advice = f"That is e = {first:.3g} at the first touch, {second:.3g} at the second"
        raise UserError("height", got, "the height of the drop before it", advice)


def require_different(files: tuple[Path, ...]) -> None:
    """Raises UserError for a file that is given twice, or whose content is.

    files: paths. Those that cannot be read are passed over here.
    """
    from hcbench.system.files import read_bytes

    # A file alone need not be read here.
    if len(files) < 2:
        return
    seen: dict[bytes, Path] = {}
    for path in files:
        try:
            content = read_bytes(path)
        except OSError:
            # The function that reads the file for the fit reports what is wrong with it.
            continue
        if (other := seen.setdefault(content, path)) is not path:
            got = f"{path} has the same content as {other}"
            raise UserError(
                "files",
                got,
                "each file once",
                "Counting one file twice would understate the uncertainty",
            )
