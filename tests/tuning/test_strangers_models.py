"""A text of `tune`, pasted into models of others, keeps its promise, or
`measure` names what broke it.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pasted
import pytest
from long_searches import LONG
from pasted_into import FACTORS, model_of, strangers

import hcbench
from hcbench.contact.mujoco import load
from hcbench.system.errors import HcbenchError
from hcbench.tuning.answer import Choice

pytestmark = pytest.mark.usefixtures("tuned_once")

MODELS = 46 if LONG else 9
STEP, E = "2 ms", 0.7
LAUNCHES = [(share, phase) for share in (0.1, 0.5, 1.0) for phase in (0.15, 0.65)]


@cache
def choices() -> tuple[Choice, ...]:
    load()
    one_e = hcbench.tune("mujoco", restitution=E, timestep=STEP)
    falling = hcbench.tune("mujoco", alpha=0.3, timestep=STEP)
    return tuple(
        choice
        for answer in (one_e, falling)
        for choice in answer.choices
        if choice.promise is not None
    )


def acts_from(model: Any) -> float:
    """Distance at which MuJoCo's contact of ball and plate begins, in the model's unit of length.

    Read from a contact: versions of MuJoCo differ in what a gap does.
    """
    geoms = {model.geom(name).id for name in ("ball", "plate")}
    data = mujoco.MjData(model)
    data.qpos[2] = 0.999 * model.geom_size[model.geom("ball").id, 0]
    mujoco.mj_forward(model, data)
    for contact in data.contact:
        if set(map(int, contact.geom)) == geoms:
            return float(contact.includemargin)
    return 0.0


def error_in(model: Any, row: dict[str, Any], choice: Choice) -> float:
    """The largest error of e against the promise's target, by a loop over mj_step."""
    scale = 1000.0 if row["unit"] == "mm" else 1.0
    (low, high), curve = choice.speeds, choice.promise.curve  # type: ignore[union-attr]
    speeds = [low + share * (high - low) for share, _ in LAUNCHES]
    launches = [(scale * v, phase) for v, (_, phase) in zip(speeds, LAUNCHES, strict=True)]
    touch = 0.05
    if choice.kind == "exact":  # a law acts from where MuJoCo's own contact does
        touch += acts_from(model) / scale
    try:
        found = pasted.bounces(model, launches, radius=touch * scale)
    except ValueError:  # a position that is not a number any more
        return math.inf
    return float(np.abs(np.array(found) - [float(curve.at(v)) for v in speeds]).max())


def said_of(model: Any, choice: Choice) -> bool:
    """True where `measure` refuses the model or names a cause."""
    low, high = choice.speeds
    try:
        measured = hcbench.measure(model, "ball,plate", speeds=f"{low}:{high}:3 m/s", rest=False)
    except HcbenchError:
        return True
    return bool(measured.causes)


@pytest.mark.adhesion
@pytest.mark.parametrize("row", strangers(MODELS), ids=str)
def test_a_pasted_text_keeps_its_promise_or_measure_says_what_broke_it(row: dict[str, Any]) -> None:
    for choice in choices():
        model = mujoco.MjModel.from_xml_string(model_of(row, choice.text))
        try:
            kept = error_in(model, row, choice) <= 1.25 * choice.max_error + 0.005
        except mujoco.FatalError as refused:
            assert row["flag"] in str(refused)
            continue
        assert kept or said_of(model, choice), choice.line


def test_the_models_have_each_level_of_each_factor() -> None:
    rows = strangers(MODELS)
    for factor, levels in FACTORS.items():
        assert {row[factor] for row in rows} == set(levels)
