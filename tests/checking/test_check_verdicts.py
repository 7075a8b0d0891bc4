"""A check holds a model to what is wanted: one e, a law, measured pairs."""

from __future__ import annotations

from pathlib import Path

import pytest
from checks import BROKEN, GOOD, ask, one

from hcbench.checking import CheckSpec, Verdict, check
from hcbench.checking.text import as_text
from hcbench.laws.restitution import Reading
from hcbench.measuring import Wanted


def test_a_good_model_passes_and_a_broken_one_fails_with_its_cause() -> None:
    report = check(ask(restitution=0.9))
    assert report.exit_code == 0
    # The touch is seen up to one step late and that much deeper: of a body under gravity
    # this scatters e by (1/e - e) g h / v, 0.0040 here, 3/4 of it below 0.9. Four phases
    # saw no more than 0.0028 of that.
    row = one(report).rows[0]
    scatter = (1 / 0.9 - 0.9) * 9.81 * 2e-4 / row.speed_in
    assert row.highest - row.lowest == pytest.approx(scatter, rel=0.03)
    assert one(report).worst.worst_phase == pytest.approx(-0.765 * scatter, rel=0.03)
    report = check(ask(BROKEN, restitution=0.9))
    assert report.exit_code == 1
    assert one(report).worst.worst_phase < -0.05
    assert "solimp-mixing" in as_text(report)
    assert 'solimp="0.9999 0.9999' in as_text(report)


def test_the_limit_is_the_limit() -> None:
    off = abs(one(check(ask(BROKEN, restitution=0.9))).worst.worst_phase)
    assert check(ask(BROKEN, restitution=0.9, max_error=off * 1.001)).exit_code == 0
    assert check(ask(BROKEN, restitution=0.9, max_error=off * 0.999)).exit_code == 1


@pytest.mark.parametrize("reading", ["law", "linear"])
def test_the_law_and_its_linear_reading_are_distinguished(reading: Reading) -> None:
    outcome = one(check(ask(alpha="0.016 s/in", target=reading, speeds="0.5 m/s", max_error=1)))
    wanted = Wanted(alpha=0.016 / 0.0254, reading=reading)
    (row,) = outcome.rows
    assert row.target == pytest.approx(float(wanted.at(row.speed_in)), abs=1e-3)
    assert ("by the law" in outcome.against) == (reading == "law")


def test_measured_pairs_in_the_units_of_their_header(tmp_path: Path) -> None:
    csv = tmp_path / "pairs.csv"
    csv.write_text("# a rig\nspeed [in/s],restitution\n20,0.90\n4,0.91\n")
    outcome = one(check(CheckSpec(model=GOOD, pair="ball,plate", points=csv)))
    assert [row.speed for row in outcome.rows] == pytest.approx([4 * 0.0254, 20 * 0.0254])
    assert outcome.verdict is Verdict.PASSED
    assert outcome.rows[0].error == pytest.approx(-0.01, abs=3e-3)
    tight = check(CheckSpec(model=GOOD, pair="ball,plate", points=csv, max_error=0.005))
    assert tight.exit_code == 1
