"""Answers to the usual questions, found once (`make answers`): pages tell them without a search.

Each is what `find_answer` says of a question, for the versions of engines that the file names.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hcbench.sim import registry
from hcbench.system.files import json_text, parse_json, read_text, write_text
from hcbench.terms.units import INCH
from hcbench.tuning.ask import make_target
from hcbench.tuning.find import find_answer
from hcbench.workers import WorkerPool

if TYPE_CHECKING:
    from hcbench.tuning.answer import Answer

FILE = Path(__file__).with_name("usual_answers.json")
_STEPS = (1e-3, 2e-3, 1 / 240, 5e-3)
_ALPHAS = tuple(alpha / INCH for alpha in (0.002, 0.004, 0.008, 0.016))
_GRAVITIES = (9.81, 0.0)
_SCENE = "steel-plane"
_PLACE = ("mass_kg", "stiffness", "exponent")


class Question(NamedTuple):
    """Engine, time step, s, gravity, m/s², and α, s/m, of a question: a ball on a plane, with the
    friction that two bodies of the engine have where nothing sets it.
    """

    engine: str
    timestep: float
    gravity: float
    alpha: float

    def answered(self) -> Answer:
        """The answer of `hcbench tune` to the question, by a search; raises as `find_answer`."""
        scene, target = make_target(
            timestep=self.timestep,
            alpha=self.alpha,
            gravity=self.gravity,
            scene=_SCENE,
            default_friction=registry.engine(self.engine).default_friction,
        )
        return find_answer(self.engine, target, scene)


def usual_answers(study: Mapping[str, Any], versions: Mapping[str, str]) -> list[dict[str, Any]]:
    """Answers to the usual questions, read from the file, for a study's α and engines.

    study: as JSON, with the numbers of its ball and its `alphas`, s/m.
    versions: of the engines that are installed, by engine; answers that were found with another
    version are left out.
    Each has the keys of `Question` and of `Answer.record`. Empty where the study's ball is another.
    """
    known = file_content()
    for name in _PLACE:
        if not math.isclose(study[name], known["scene"][name], rel_tol=1e-9):
            return []
    answers = []
    for answer in known["answers"]:
        engine = answer["engine"]
        is_asked = any(
            math.isclose(answer["alpha"], alpha, rel_tol=1e-9) for alpha in study["alphas"]
        )
        if is_asked and versions.get(engine) == known["versions"][engine]:
            answers.append(answer)
    return answers


def record_of(question: Question) -> dict[str, Any]:
    """The answer to a question, as JSON."""
    answer = question.answered()
    record: dict[str, Any] = json.loads(json_text(answer.record))
    return {**question._asdict(), "best": answer.best.kind, **record}


def write(jobs: int = 2) -> None:
    """Find all answers again, by the installed versions of the file's engines, and write the file.

    jobs: worker processes.
    Raises EngineMissing where one of the engines is not installed.
    """
    _, target = make_target(timestep=_STEPS[0], alpha=0.0, scene=_SCENE)
    law = target.law
    with WorkerPool(jobs) as pool:
        answers = pool.map(record_of, list(questions()))
    content = {
        "scene": dict(zip(_PLACE, (target.mass, law.stiffness, law.exponent), strict=True)),
        "versions": {engine: registry.require(engine) for engine in file_content()["versions"]},
        "answers": answers,
    }
    write_text(FILE, json_text(content))


def questions() -> Iterator[Question]:
    """Every question that the file answers."""
    engines = file_content()["versions"]
    for conditions in product(engines, _STEPS, _GRAVITIES, _ALPHAS):
        yield Question(*conditions)


@lru_cache(maxsize=1)
def file_content() -> dict[str, Any]:
    """The file: its ball, the versions of the engines, and the answers."""
    known: dict[str, Any] = parse_json(read_text(FILE))
    return known
