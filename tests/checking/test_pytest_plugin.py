"""The pytest plug-in, run by pytest on the tests that a user would write."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

import hcbench
from hcbench.checking.baseline import read_pairs

pytest_plugins = ["pytester"]

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module", autouse=True)
def _imports(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Imports what the inner runs need: as they end they forget what they were the first to import,
    and parts of NumPy cannot be imported twice.
    """
    pairs = tmp_path_factory.mktemp("pairs") / "pairs.csv"
    pairs.write_text("v [m/s],e\n0.1,0.9\n0.5,0.9\n")
    read_pairs(pairs)
    model = mujoco.MjModel.from_xml_path(str(EXAMPLES / "broken.xml"))
    hcbench.measure(model, "ball,plate", speeds=[0.1], phases=1, restitution=0.9)


@pytest.fixture
def models(pytester: pytest.Pytester) -> pytest.Pytester:
    for name in ("good.xml", "broken.xml"):
        (pytester.path / name).write_text((EXAMPLES / name).read_text())
    return pytester


def test_a_good_model_passes_and_a_broken_one_shows_why(models: pytest.Pytester) -> None:
    models.makepyfile(
        """
        def test_good(restitution):
            found = restitution("good.xml", pair="ball,plate", speeds="0.1, 0.5 m/s").matches(0.9)
            assert len(found.curve) == 2

        def test_broken(restitution):
            restitution("broken.xml", pair="ball,plate", speeds="0.1, 0.5 m/s").matches(0.9)
        """
    )
    result = models.runpytest_inprocess()
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        [
            "*largest error -0.05* at 0.105* m/s, limit 0.02*",
            "*launch m/s*impact m/s*",
            "*solimp-mixing*averages the solimp*",
            '*fix *ball and plate: solimp="0.9999*',
        ]
    )
    assert "pytest_plugin.py" not in result.stdout.str(), "the plug-in's own frames are of no use"


def test_marker_and_ini_give_defaults_and_the_nearest_wins(models: pytest.Pytester) -> None:
    models.makeini(
        """
        [pytest]
        addopts = --strict-markers
        restitution_speeds = 0.1 m/s
        restitution_max_error = 0.5
        restitution_phases = 2
        restitution_timeout = 30
        """
    )
    models.makepyfile(
        """
        import pytest

        def test_ini(restitution):
            found = restitution("broken.xml", pair="ball,plate").matches(0.9)
            assert found.request.speeds == (0.1,)
            assert len(found.impacts) == 2

        @pytest.mark.restitution(speeds="0.2, 0.3 m/s", phases=1)
        class TestMarked:
            def test_class(self, restitution):
                found = restitution("broken.xml", pair="ball,plate").matches(0.9)
                assert found.request.speeds == (0.2, 0.3)

            @pytest.mark.restitution(speeds=[0.4])
            def test_function(self, restitution):
                found = restitution("broken.xml", pair="ball,plate").matches(0.9)
                assert found.request.speeds == (0.4,)

            @pytest.mark.restitution(max_error=0.001)
            def test_tight(self, restitution):
                restitution("broken.xml", pair="ball,plate").matches(0.9)
        """
    )
    models.runpytest_inprocess().assert_outcomes(passed=3, failed=1)


def test_the_law_pairs_baselines_and_objects(models: pytest.Pytester) -> None:
    (models.path / "pairs.csv").write_text("v [m/s],e\n0.1,0.9\n0.5,0.9\n")
    models.makepyfile(
        """
        import mujoco
        from pathlib import Path
        from hcbench.checking.baseline import write_baseline

        HERE = Path(__file__).parent

        def test_law(restitution):
            bounce = restitution("good.xml", pair="ball,plate", speeds="0.1 m/s")
            bounce.follows(alpha=1.0)

        def test_not_the_law(restitution):
            restitution("good.xml", pair="ball,plate", speeds="2 m/s").follows(alpha="0.008 s/in")

        def test_pairs(restitution):
            restitution("good.xml", pair="ball,plate").follows(points=HERE / "pairs.csv")

        def test_baseline(restitution):
            bounce = restitution("good.xml", pair="ball,plate", speeds="0.1 m/s")
            write_baseline(HERE / "b.json", {"good.xml": bounce.measured()})
            bounce.equals(HERE / "b.json")

        def test_object(restitution):
            model = mujoco.MjModel.from_xml_path(str(HERE / "good.xml"))
            restitution(model, pair=("ball", "plate"), speeds="0.1 m/s").matches(0.9)

        def test_mistake(restitution):
            restitution("good.xml", pair="ball,plat", speeds="0.1 m/s").matches(0.9)
        """
    )
    result = models.runpytest_inprocess()
    result.assert_outcomes(passed=4, failed=2)
    result.stdout.fnmatch_lines(["*no body or geom 'plat'*Did you mean 'plate'*"])


def test_a_marker_with_a_mistake_says_what_there_is(models: pytest.Pytester) -> None:
    models.makepyfile(
        """
        import pytest

        @pytest.mark.restitution(speed="1 m/s")
        def test_it(restitution):
            pass
        """
    )
    result = models.runpytest_inprocess()
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(
        ["*mark.restitution: unknown speed; expected one of: max_error, max_depth, *"]
    )


def test_the_fixture_and_the_marker_take_every_option_of_launches(models: pytest.Pytester) -> None:
    models.makepyfile(
        """
        import pytest
        from hcbench.terms.options import LAUNCHES

        OBLIQUE = {"angle": "45 deg", "along": "1, 0, 0", "spin": "1 rad/s"}
        GIVEN = {"coming_from": "above", "actuators": False, **OBLIQUE}

        @pytest.mark.restitution(**dict.fromkeys(LAUNCHES))
        def test_all(restitution):
            found = restitution("good.xml", "ball,plate", speeds="0.1 m/s", phases=1, **GIVEN).measured()
            assert found.request.coming_from == (0, 0, 1)
            assert not found.request.actuators
            assert found.request.is_oblique
        """
    )
    models.runpytest_inprocess("--strict-markers").assert_outcomes(passed=1)


def test_it_works_under_xdist(models: pytest.Pytester) -> None:
    pytest.importorskip("xdist")
    models.makepyfile(
        """
        import pytest

        @pytest.mark.parametrize("i", range(4))
        def test_it(restitution, i):
            restitution("good.xml", pair="ball,plate", speeds="0.1 m/s").matches(0.9)
        """
    )
    models.runpytest_subprocess("-n", "1").assert_outcomes(passed=4)


def test_users_who_do_not_ask_for_it_pay_nothing(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        """
        import sys

        def test_nothing_is_imported():
            heavy = {"numpy", "mujoco", "pybullet", "hcbench.measuring", "hcbench.checking"}
            assert not heavy & set(sys.modules)
        """
    )
    pytester.runpytest_subprocess("-W", "error").assert_outcomes(passed=1)


def test_marker_and_options_are_listed(pytester: pytest.Pytester) -> None:
    markers = pytester.runpytest_inprocess("--markers").stdout.str()
    assert "@pytest.mark.restitution(max_error=" in markers
    options = pytester.runpytest_inprocess("--help").stdout.str()
    for name in ("max_error", "speeds", "phases", "timeout"):
        assert f"restitution_{name}" in options


def test_an_unknown_option_fails_with_all_that_there_are(models: pytest.Pytester) -> None:
    models.makepyfile(
        """
        import pytest

        def test_call(restitution):
            restitution("good.xml", pair="ball,plate", sped="1 m/s").matches(0.9)

        @pytest.mark.restitution(sped="1 m/s")
        def test_marker(restitution):
            restitution("good.xml", pair="ball,plate").matches(0.9)
        """
    )
    result = models.runpytest_inprocess("-rfE")
    assert result.ret == 1
    text = result.stdout.str()
    assert "TypeError" not in text
    for what in ("restitution()", "@pytest.mark.restitution"):
        assert f"{what}: unknown sped; expected one of: max_error, max_depth" in text
    assert text.count("engine, timeout") >= 2


def test_a_test_without_a_target_fails(models: pytest.Pytester) -> None:
    models.makepyfile(
        """
        import pytest

        @pytest.mark.parametrize("hold", [
            lambda bounce: bounce.follows(),
            lambda bounce: bounce.matches(None),
            lambda bounce: bounce.rests(),
            lambda bounce: bounce.equals(None),
        ])
        def test_nothing_to_hold_it_to(restitution, hold):
            hold(restitution("good.xml", pair="ball,plate", speeds="0.5 m/s"))

        def test_the_verdict_is_forgotten(restitution):
            restitution("good.xml", pair="ball,plate", speeds="0.5 m/s")

        @pytest.mark.restitution(max_depth="1 m", max_vibration="1 m/s")
        def test_the_marker_has_the_limits(restitution):
            restitution("good.xml", pair="ball,plate", speeds="0.5 m/s", phases=1).rests()
        """
    )
    result = models.runpytest_inprocess()
    result.assert_outcomes(failed=4, passed=2, errors=1)
    result.stdout.fnmatch_lines(["*follows(): no target; expected .matches(e), *"])
    result.stdout.fnmatch_lines(["*not measured; expected .matches(e), *"])
