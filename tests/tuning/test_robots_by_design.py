"""The rebound that a refusal names is the largest: robots of many kinds against brute force by the same
judge, and what is printed of the rebound against drops at random places in a step.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import mujoco
import numpy as np
import pytest
from long_searches import LONG, long_search
from robots_by_design import DESIGNS, Design, best_of_all

import hcbench as hb
from hcbench.engines.mujoco.model.drop_test import ModelDropBench, landing
from hcbench.engines.mujoco.model.foot_springs import FootContact, PairSearch
from hcbench.measuring.request import make_request
from hcbench.sim.landing import RobotDrop
from hcbench.tuning.tuned_model import LandingChange

# A rebound that no robot has: each is refused.
BEYOND = 0.095  # m
QUICK = "wheeled leg"
EACH = [
    pytest.param(design, id=design.name, marks=() if design.name == QUICK else long_search)
    for design in DESIGNS
]


@cache
def refused(design: Design) -> tuple[LandingChange, str]:
    """The landing of a refusal, and the model with the nearest setting."""
    found = hb.tune_model(design.text, design.pairs, rebound=BEYOND)
    assert not found.gains
    assert found.landing is not None
    return found.landing, found.written


@pytest.mark.parametrize("design", EACH)
def test_the_largest_rebound_that_is_named_is_that_of_brute_force(design: Design) -> None:
    landing, _ = refused(design)
    assert landing.reach is not None
    best, tried = best_of_all(design, BEYOND, fast=24 if LONG else 10, damped=16 if LONG else 8)
    assert tried > 100
    assert landing.reach.rebound >= 0.9 * best


@pytest.mark.parametrize("design", EACH)
def test_nine_of_ten_rebounds_at_random_places_in_a_step_are_within_what_is_printed(
    design: Design,
) -> None:
    landing, written = refused(design)
    requests = [make_request(pair) for pair in design.pairs]
    bench = ModelDropBench(mujoco.MjSpec.from_string(written), design.name, requests)
    phases = np.random.default_rng(7).uniform(size=40).tolist()
    seen = [bench.test(0.6, [RobotDrop(0.1, 0.0, phase)]).rebound for phase in phases]
    after = landing.after
    within = [abs(one - after.rebound) <= 1.02 * after.spread for one in seen]
    assert np.mean(within) >= 0.9


def test_a_search_is_as_good_as_any_of_a_coarse_grid_of_springs() -> None:
    design = next(one for one in DESIGNS if one.name == QUICK)
    requests = [make_request(pair) for pair in design.pairs]
    before = landing(design.text, requests, None)
    search = PairSearch(design.text, requests, before, BEYOND)
    coarse = []
    for share, damping in product(np.geomspace(0.15, 0.4, 8).tolist(), (0.12, 0.35, 0.7, 1.0, 1.4)):
        contact = FootContact(share / design.step, damping)
        if search.is_kept(contact):
            coarse.append(search.whole_test(contact))
    good = [test.rebound for test in coarse if not list(test.worse_than(before, BEYOND))]
    reach = refused(design)[0].reach
    assert good
    assert reach is not None
    assert reach.rebound >= max(good)
