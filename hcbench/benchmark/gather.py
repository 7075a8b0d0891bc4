"""Scores and folds the impacts of a setting, shard by shard, in a worker process: no table of all is made."""

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

_PIECE = 16_384  # impacts of a setting, α and step that are folded at once; fewer where speeds are cut
_READ = {*FOLDED, *FOLDED_OBLIQUE, *keys(MEASURED), REASON.key}
_Columns = dict[str, NDArray[Any]]
_Launched = tuple[float, float]  # speed, m/s, and phase


@dataclass(frozen=True, slots=True)
class Gathered:
    """Impacts of a setting, α and step. score: SCORE_FIELDS. loops: those kept, by speed and phase."""

    key: Key
    folded: Folded
    score: tuple[Any, ...]
    loops: Sequence[tuple[_Launched, Loop]]


def gather(job: tuple[Store, Mapping[str, Any], Sequence[tuple[int, str]]]) -> list[Gathered]:
    """Collect the shards of one setting, for each α. job: their store, the study as JSON, and their
    numbers.
    """
    store, study, shards = job
    seen: dict[Key, _Gathering] = {}
    for shard in shards:
        impacts, loops = store.tables(*shard)
        columns = columns_in(impacts, _READ)
        kept = _loops_in(loops)
        for key, rows in places_of(impacts).items():
            one = seen.setdefault(key, _Gathering(key, study))
            one.add({name: values[rows] for name, values in columns.items()}, kept.get(one.alpha, {}))
    return [one.gathered() for one in seen.values()]


def places_of(impacts: bytes) -> dict[Key, slice]:
    """Rows of a shard's table that belong to each key."""
    places, begin = {}, 0
    for summary in metadata_of(impacts)[1]:
        end = begin + summary["impacts"]
        places[tuple(summary[name] for name in RUN_KEY)] = slice(begin, end)
        begin = end
    return places


def _loops_in(content: bytes) -> dict[float, dict[_Launched, Loop]]:
    """The loops of a shard by α and by launch."""
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
        self._key, self.alpha = key, float(key[RUN_KEY.index("alpha_s_per_m")])
        self._law = HuntCrossley(study["stiffness"], self.alpha, study["exponent"])
        self._mass, self._scored = float(study["mass_kg"]), set(study["loop_speeds"])
        self._tally, self._folder = scoring.Tally(self._law, self._mass), Folder(study)
        self._waiting: list[_Columns] = []
        self._loops: dict[_Launched, Loop] = {}

    def add(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> None:
        """Add impacts in the order of their launches, and the loops of some of these."""
        self._waiting.append(columns)
        self._loops |= {launch: loop.simplified(LOOP_TOLERANCE) for launch, loop in loops.items()}
        scores = [
            scoring.score_loop(impact, self._law, self._mass) for impact in self._looped(columns, loops)
        ]
        self._tally.add_loops([score for score in scores if score is not None])
        if sum(len(each["status"]) for each in self._waiting) >= _PIECE:
            whole = _joined(self._waiting)
            place = self._folder.place(whole["speed_m_per_s"])
            last = place == place[-1]  # more of these may be in the next shard
            self._use({name: values[~last] for name, values in whole.items()})
            self._waiting = [{name: values[last] for name, values in whole.items()}]

    def _looped(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> Iterator[Impact]:
        """Impacts whose loops are scored."""
        speeds, phases = columns["speed_m_per_s"], columns["phase"]
        head_on = columns.get("angle_rad", np.zeros(len(speeds))) == 0.0
        for launch, loop in loops.items():
            if launch[0] in self._scored:
                here = head_on & (speeds == launch[0]) & (phases == launch[1])
                for i in np.flatnonzero(here).tolist():
                    about = (Launch(*launch), Status(columns["status"][i]), columns["reason"][i])
                    seen: dict[str, Any] = {f.name: float(columns[f.key][i]) for f in MEASURED}
                    yield Impact(*about, **seen, samples=int(columns["samples"][i]), loop=loop)

    def _use(self, columns: _Columns) -> None:
        if not len(columns["status"]):
            return
        status, e = columns["status"], columns["restitution"]
        angle = columns.get("angle_rad", np.zeros(len(e)))
        measured = scoring.Measured(
            speed=columns["speed_m_per_s"],
            launch=np.unique(columns["speed_m_per_s"] + 1j * angle, return_inverse=True)[1],
            parted=status == Status.PARTED.value,
            rested=status == Status.RESTED.value,
            speed_in=columns["speed_in_m_per_s"],
            e=e,
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
        score = dataclasses.astuple(self._tally.score())
        return Gathered(
            self._key, self._folder.folded(), score, sorted(self._loops.items(), key=lambda k: k[0])
        )


def _joined(parts: Sequence[_Columns]) -> _Columns:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
