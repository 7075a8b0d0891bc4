"""Scores and folds the impacts of a setting, shard by shard, in a worker
process: no table of all is made.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hcbench import scoring
from hcbench.benchmark.batch import MEASURED
from hcbench.benchmark.encodings import columns_in
from hcbench.benchmark.fold import FOLDED, FOLDED_OBLIQUE, Folded, Folder
from hcbench.benchmark.results import LOOP_COLUMNS, RUN_KEY, Key
from hcbench.benchmark.tables import metadata_of
from hcbench.laws.force import HuntCrossley
from hcbench.terms.impact import LOOP_TOLERANCE, Impact, Launch, Loop, Status
from hcbench.terms.records import LOOP, REASON, keys

if TYPE_CHECKING:
    from hcbench.benchmark.store import Store

# Impacts of a setting, α and step that are folded at once; fewer if speeds are cut.
_PIECE = 16_384
_READ = {*FOLDED, *FOLDED_OBLIQUE, *keys(MEASURED), REASON.key}
_Columns = dict[str, NDArray[Any]]
# Speed, m/s, and phase of a launch.
_Launched = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Gathered:
    """Impacts of a setting, α and step.

    score: SCORE_FIELDS.
    loops: those kept, by speed and phase.
    """

    key: Key
    folded: Folded
    score: tuple[Any, ...]
    loops: Sequence[tuple[_Launched, Loop]]


def gather(job: tuple[Store, Mapping[str, Any], Sequence[tuple[int, str]]]) -> list[Gathered]:
    """Collect the shards of one setting, for each α.

    job: their store, the study as JSON, and their numbers and names.
    """
    store, study, shards = job
    seen: dict[Key, _Gathering] = {}
    for number, name in shards:
        impacts, loops = store.tables(number, name)
        columns = columns_in(impacts, _READ)
        loops_by_alpha = _loops_in(loops)
        for key, rows in places_of(impacts).items():
            one = seen.setdefault(key, _Gathering(key, study))
            one.add(_rows(columns, rows), loops_by_alpha.get(one.alpha, {}))
    return [one.gathered() for one in seen.values()]


def places_of(impacts: bytes) -> dict[Key, slice]:
    """Rows of a shard's table that belong to each key."""
    places = {}
    begin = 0
    _loops_digest, summaries = metadata_of(impacts)
    for summary in summaries:
        end = begin + summary["impacts"]
        key = tuple(summary[name] for name in RUN_KEY)
        places[key] = slice(begin, end)
        begin = end
    return places


def _loops_in(content: bytes) -> dict[float, dict[_Launched, Loop]]:
    """The loops of a shard: α (s/m) -> launch speed (m/s) and phase -> loop.

    content: bytes of the shard's file of loops; empty if it kept none.
    """
    if not content:
        return {}
    columns = columns_in(content, LOOP_COLUMNS)
    launch = np.array([columns[name] for name in ("alpha_s_per_m", "speed_m_per_s", "phase")])
    begins = np.flatnonzero(np.r_[True, (launch[:, 1:] != launch[:, :-1]).any(axis=0)])
    loops: dict[float, dict[_Launched, Loop]] = {}
    for begin, end in zip(begins, [*begins[1:], None], strict=True):
        alpha, speed, phase = launch[:, begin].tolist()
        loop = Loop(*(columns[field.key][begin:end] for field in LOOP))
        loops.setdefault(alpha, {})[speed, phase] = loop
    return loops


class _Gathering:
    """Adds up impacts of one key."""

    def __init__(self, key: Key, study: Mapping[str, Any]) -> None:
        """Sums without impacts yet, for one setting, step and α.

        key: the setting, step and α, values of RUN_KEY.
        study: the sweep's description, numbers in SI.
        """
        self._key = key
        self.alpha = float(key[RUN_KEY.index("alpha_s_per_m")])
        self._law = HuntCrossley(study["stiffness"], self.alpha, study["exponent"])
        self._mass = float(study["mass_kg"])
        self._scored = set(study["loop_speeds"])
        self._tally = scoring.Tally(self._law, self._mass)
        self._folder = Folder(study)
        self._waiting: list[_Columns] = []
        self._loops: dict[_Launched, Loop] = {}

    def add(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> None:
        """Add impacts in the order of their launches, and the loops of some of these."""
        self._waiting.append(columns)
        for launch, loop in loops.items():
            self._loops[launch] = loop.simplified(LOOP_TOLERANCE)
        for impact in self._looped(columns, loops):
            score = scoring.score_loop(impact, self._law, self._mass)
            if score is not None:
                self._tally.add_loops([score])
        waiting = sum(len(each["status"]) for each in self._waiting)
        if waiting >= _PIECE:
            whole = _joined(self._waiting)
            place = self._folder.place(whole["speed_m_per_s"])
            # The next shard may have more impacts of this place.
            last = place == place[-1]
            self._use(_rows(whole, ~last))
            self._waiting = [_rows(whole, last)]

    def _looped(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> Iterator[Impact]:
        """Impacts of the study's loop speeds, with their loops, from columns in SI."""
        speeds = columns["speed_m_per_s"]
        phases = columns["phase"]
        head_on = columns.get("angle_rad", np.zeros(len(speeds))) == 0.0
        for (speed, phase), loop in loops.items():
            if speed not in self._scored:
                continue
            here = head_on & (speeds == speed) & (phases == phase)
            for i in np.flatnonzero(here).tolist():
                measured: dict[str, Any] = {
                    field.name: float(columns[field.key][i]) for field in MEASURED
                }
                yield Impact(
                    launch=Launch(speed, phase),
                    status=Status(columns["status"][i]),
                    reason=columns["reason"][i],
                    samples=int(columns["samples"][i]),
                    loop=loop,
                    **measured,
                )

    def _use(self, columns: _Columns) -> None:
        """Score and fold impacts: all phases of their speeds. Columns without impacts change
        nothing.

        columns: arrays of shape (n,), SI.
        """
        if not len(columns["status"]):
            return
        status = columns["status"]
        e = columns["restitution"]
        speed = columns["speed_m_per_s"]
        angle = columns.get("angle_rad", np.zeros(len(e)))
        # One number for each pair of speed and angle: as complex numbers,
        # NumPy tells the pairs apart.
        _, launch = np.unique(speed + 1j * angle, return_inverse=True)
        measured = scoring.Measured(
            speed=speed,
            launch=launch,
            parted=status == Status.PARTED.value,
            rested=status == Status.RESTED.value,
            speed_in=columns["speed_in_m_per_s"],
            e=e,
            # Along the plate an oblique impact loses energy too, which e does not tell.
            energy_lost=np.where(angle == 0.0, 1.0 - e**2, np.nan),
            samples=columns["samples"],
            gained=any("energy" in reason for reason in set(columns["reason"].tolist())),
        )
        self._tally.add(measured)
        self._folder.add(columns)

    def gathered(self) -> Gathered:
        """Finish and return the collection."""
        self._use(_joined(self._waiting))
        self._waiting = []
        return Gathered(
            key=self._key,
            folded=self._folder.folded(),
            score=dataclasses.astuple(self._tally.score()),
            loops=sorted(self._loops.items(), key=lambda launch_and_loop: launch_and_loop[0]),
        )


def _joined(parts: Sequence[_Columns]) -> _Columns:
    """Impacts of parts, one or more, as one."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _rows(columns: _Columns, which: slice | NDArray[np.bool_]) -> _Columns:
    """Some of the impacts."""
    return {name: values[which] for name, values in columns.items()}
