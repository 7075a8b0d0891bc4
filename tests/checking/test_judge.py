"""The e that a check prints: the mean over a time step, whatever phases a speed was launched at."""

from __future__ import annotations

from dataclasses import replace

import pytest
from checks import GOOD

import hcbench as hb
from hcbench.checking.judge import judge
from hcbench.checking.outcome import Report
from hcbench.checking.spec import Check
from hcbench.checking.text import as_text
from hcbench.measuring.measurement import Measurement
from hcbench.sim.model_under_test import Request
from hcbench.terms.impact import Impact, Launch, Status


@pytest.fixture(scope="module")
def measured() -> Measurement:
    return hb.measure(GOOD, "ball,plate", speeds="2 m/s", phases=1, diagnose=False, rest=False)


def check_of(target: float, max_error: float) -> Check:
    wanted = hb.Wanted(restitution=target)
    return Check("ball", GOOD, Request(), wanted, None, max_error, None, None)


def test_the_printed_e_weighs_each_phase_by_its_share_of_the_step(measured: Measurement) -> None:
    """0.4 stands for the phases from 0 to 0.25, halfway to its
    neighbours, and 0.8 for the rest: 0.7.
    """
    phases = {0.0625: 0.4, 0.1875: 0.4, 0.3125: 0.8, 0.5: 0.8, 0.9375: 0.8}
    impacts = tuple(
        Impact(Launch(2.0, phase), Status.PARTED, speed_in=2.0, speed_out=2.0 * e, samples=9)
        for phase, e in phases.items()
    )
    outcome = judge(check_of(0.75, 0.5), replace(measured, impacts=impacts))
    (row,) = outcome.rows
    assert row.restitution == pytest.approx(0.7)
    assert row.error == pytest.approx(-0.05)
    (printed,) = [line for line in as_text(Report((outcome,))).splitlines() if line.startswith(" ")]
    assert [float(number) for number in printed.split()][2] == pytest.approx(0.7)
