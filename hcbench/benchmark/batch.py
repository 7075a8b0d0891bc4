"""Simulates a batch of launches and returns its results as columns.

It imports little, as every worker process of an engine has it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.coulomb import coulomb_ratio
from hcbench.sim import registry
from hcbench.sim.columns import STATUSES, Impacts, Launches
from hcbench.sim.tangential import along_plate
from hcbench.system.errors import UserError
from hcbench.terms.impact import Impact, Loop, Status
from hcbench.terms.records import (
    ALONG,
    ANGLE,
    COULOMB,
    DURATION,
    FORCE_MAX,
    PENETRATION_MAX,
    REASON,
    RESTITUTION,
    SAMPLES,
    SPEED_IN,
    SPEED_OUT,
    STATUS,
    keys,
    record,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

_STATUSES = np.array([status.value for status in STATUSES], dtype=object)
# Columns that have an attribute of an impact as it is.
MEASURED = (SPEED_IN, SPEED_OUT, DURATION, PENETRATION_MAX, FORCE_MAX)
# More columns of impacts in a study with oblique launches: the angle from the normal, what
# `AlongPlate` has, and what Coulomb's law makes of the ratio of impulses.
OBLIQUE_COLUMNS = keys((ANGLE, *ALONG, COULOMB))
_ALONG_COLUMNS = slice(1, 1 + len(ALONG))
_ENERGY_LOST = len(ALONG)


@dataclass(frozen=True, slots=True)
class Batch:
    """Launches of one setting.

    kept: the indices of those whose loops are kept.
    oblique: whether its results have OBLIQUE_COLUMNS, which tell what each does along the plate.
    """

    scene: Scene
    setting: Setting
    launches: Launches
    kept: Sequence[int]
    oblique: bool = False


@dataclass(frozen=True, slots=True)
class BatchResult:
    """`columns_of` a batch's impacts, and (index in the batch, loop) of the kept ones."""

    columns: Mapping[str, Any]
    loops: Sequence[tuple[int, Loop]]


def result_of(impacts: Impacts, batch: Batch) -> BatchResult:
    """Return the columns and loops that are kept of a batch's impacts.

    impacts: one for each launch of the batch, in order. An impact without a loop, such as one that
    failed, is left out of the loops.
    Raises what the engine raises, on a device.
    """
    columns = columns_of(impacts)
    if batch.oblique:
        columns |= oblique_columns(impacts, batch.scene)
    loops = []
    for i in batch.kept:
        loop = _loop(i, impacts, batch)
        if loop is not None:
            loops.append((i, loop))
    return BatchResult(columns, loops)


def _loop(i: int, impacts: Impacts, batch: Batch) -> Loop | None:
    """The loop of one impact; None for one that has none. On a device no step is recorded, and the
    launch is simulated once more.

    i: index of the impact in the batch.
    Raises what the engine raises, on a device.
    """
    impact = impacts[i]
    setting = batch.setting
    if "device" not in setting.options or not impact.is_measured:
        return impact.loop
    # The first step in contact.
    start = int(impacts.start[i])
    stop = start + impact.samples
    engine = registry.engine(setting.engine)
    path = engine.trajectory(batch.scene, setting, impact.launch, stop * setting.timestep)
    return Loop(
        # Times of a loop begin at the touch.
        time=path.time[: impact.samples],
        penetration=path.penetration[start:stop],
        rate=path.rate[start:stop],
        force=path.force[start:stop],
    )


def columns_of(impacts: Impacts) -> dict[str, Any]:
    """Column -> values, one an impact: SI, NaN where an impact has no such number."""
    return {
        STATUS.key: _STATUSES[impacts.status],
        REASON.key: impacts.reason,
        RESTITUTION.key: impacts.restitution,
        SAMPLES.key: impacts.samples,
    } | record(MEASURED, impacts)


def oblique_columns(impacts: Impacts, scene: Scene) -> dict[str, Any]:
    """OBLIQUE_COLUMNS -> values, one an impact: angles in rad, speeds in m/s, spins in rad/s.

    What `along_plate` does not find is NaN. The ratio by Coulomb's law is 0 for an impact that was
    not measured along the plate.
    """
    rows = np.zeros((len(impacts), len(OBLIQUE_COLUMNS)))
    # Most launches of most studies are straight: they do nothing along the plate but lose energy.
    rows[:, _ENERGY_LOST] = [1.0 - e**2 for e in impacts.restitution.tolist()]
    rows[~impacts.is_measured, _ALONG_COLUMNS] = np.nan
    was_seen = np.array([motion is not None for motion in impacts.tangential], dtype=bool)
    oblique = np.flatnonzero(impacts.launches.is_oblique | was_seen)
    for i, impact in zip(oblique, impacts.take(oblique), strict=True):
        ratio = 0.0
        if impact.tangential is not None:
            ratio = coulomb_ratio(impact.tangential, scene)
        rows[i] = (impact.launch.angle, *along_plate(impact), ratio)
    return dict(zip(OBLIQUE_COLUMNS, rows.T.copy(), strict=True))


def run_batch(batch: Batch) -> BatchResult:
    """Run the whole batch at once, as the engine does best. Raises what the engine raises."""
    engine = registry.engine(batch.setting.engine)
    return result_of(engine.run_columns(batch.scene, batch.setting, batch.launches), batch)


def run_one_by_one(which: Sequence[int], batch: Batch) -> Iterator[Impact]:
    """Run some launches of a batch, each alone; yield their impacts in order.

    which: indices of the launches. One at which the engine raises is CRASHED, with the reason.
    Raises UserError for what the engine refuses.
    """
    engine = registry.engine(batch.setting.engine)
    for i in which:
        launch = batch.launches[i]
        try:
            (impact,) = engine.run(batch.scene, batch.setting, [launch])
        except UserError:
            raise
        except Exception as error:
            reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(":")
            impact = Impact(launch, Status.CRASHED, reason)
        # An impact without its loop is small to send between processes.
        yield impact if i in batch.kept else dataclasses.replace(impact, loop=None)
