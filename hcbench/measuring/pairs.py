"""`hcbench.pairs`: which parts of a user's model can meet."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from hcbench.measuring.measure import Job, run_job, source_of
from hcbench.measuring.measurement import TOLERANCE
from hcbench.measuring.request import make_request, read_limit
from hcbench.sim.candidate_pairs import CandidatePair, as_records, as_table
from hcbench.system.notebook import Shown
from hcbench.terms.arguments import checked
from hcbench.terms.options import Folders, Joints, ModelSource, PoseState, Quantity


@dataclass(frozen=True, repr=False)
class CandidatePairs(Shown):
    """The parts of a model that can meet: those that touch first, then the nearest."""

    pairs: tuple[CandidatePair, ...]

    def __iter__(self) -> Iterator[CandidatePair]:
        return iter(self.pairs)

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, number: int) -> CandidatePair:
        return self.pairs[number]

    def _lines(self) -> list[str]:
        return as_table(self.pairs).splitlines()

    def _rows(self) -> list[dict[str, Any]]:
        return as_records(self.pairs)


@checked
def pairs(
    model: ModelSource,
    *,
    engine: str | None = None,
    limit: Quantity | None = None,
    key: str | None = None,
    qpos: Joints | None = None,
    state: PoseState | None = None,
    package: Folders | None = None,
) -> CandidatePairs:
    """List which parts of your model can meet, and which do, as `hcbench pairs` does.

    Parameters
    ----------
    model, engine, limit, key, qpos, state, package
        As `measure` takes them.

    Returns
    -------
    CandidatePairs
        A sequence; `pair` of each is what `measure`, `tune` and `check` take. Effective masses are in kg,
        distances in m.

    Raises
    ------
    UserError
        With the reason for a model that cannot be opened.

    Examples
    --------
    >>> import hcbench as hb
    >>> [(each.pair, each.touching) for each in hb.pairs("ball.xml")]
    [('geom:ball,plate', False)]

    """
    request = make_request(None, key=key, qpos=qpos, state=state, package=package)
    job = Job(model, engine, request, None, TOLERANCE, diagnose=False)
    return CandidatePairs(tuple(list_pairs(job, read_limit(limit))))


def list_pairs(job: Job, limit: float | None = None) -> list[CandidatePair]:
    """List the parts of the model that can meet; those that touch at the start first."""
    return run_job(_listed, job, limit)


def _listed(job: Job) -> list[CandidatePair]:
    engine, source, rebuild = source_of(job)
    return engine.pairs(source, job.request, rebuild)
