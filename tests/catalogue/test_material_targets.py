"""Every verb that takes α takes a material: it gives the same target, says which, and warns."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import hcbench as hb
from hcbench.benchmark.study import study_from
from hcbench.catalogue.find import find, read_material
from hcbench.checking import CheckSpec, plan
from hcbench.checking.text import checks_of
from hcbench.cli import run
from hcbench.laws.restitution import ConstantRestitution, MeasuredRestitution, Restitution
from hcbench.system.errors import StudyError, UserError
from hcbench.tuning.ask import make_target

pytest_plugins = ["pytester"]
ROOT = Path(__file__).parents[2]
BALL = str(ROOT / "examples" / "good.xml")
PAIR = "ball,plate"
RUBBER = "rubber on concrete"
WOOD = "croquet ball on wood"
STEEL = "steel on steel"
# One e over a band, and one whose source states no speed.
CROQUET = "croquet ball on croquet ball"
NO_SPEED = "ABS on steel"


def spec(**options: object) -> CheckSpec:
    return CheckSpec(model=BALL, pair=PAIR, **options)


def test_law_takes_the_alpha_of_a_material_and_no_other() -> None:
    assert hb.law(material=STEEL).alpha == 0.2
    for name in (RUBBER, WOOD):
        with pytest.raises(UserError, match=r"^material: .*gives no α.*tune"):
            hb.law(material=name)
    with pytest.raises(UserError, match=r"^target: material and alpha are given; expected one"):
        hb.law(0.3, material=STEEL)


def test_an_engine_is_tuned_to_the_numbers_of_the_material() -> None:
    with pytest.warns(UserWarning, match=r"measured at 4.25 m/s; its e at .* is a guess"):
        _, one_e = make_target(material=RUBBER, timestep=1e-3)
    _, asked = make_target(restitution=0.752, timestep=1e-3)
    assert one_e == asked
    assert one_e.material.startswith(
        "rubber on concrete: e = 0.752 at 4.25 m/s (factbook-handball;"
    )
    _, wood = make_target(material=WOOD, timestep=1e-3)
    assert wood.points == find(WOOD).target.points
    assert (wood.speed_min, wood.speed_max) == (0.5, 6.01)
    _, steel = make_target(material=STEEL, timestep=1e-3)
    _, alpha = make_target(alpha=0.2, timestep=1e-3)
    assert steel == alpha
    _, band = make_target(material=CROQUET, timestep=1e-3)
    assert (band.speed_min, band.speed_max) == (1.9, 7.64)
    with pytest.raises(UserError, match=r"^target: 'linear'.*no α"):
        make_target(material=WOOD, reading="linear", timestep=1e-3)
    with pytest.raises(UserError, match=r"^target: --material and --alpha are given; expected one"):
        make_target(material=WOOD, alpha=0.3, timestep=1e-3)


def test_tune_prints_the_material_and_its_source(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["tune", "reference", "--material", STEEL, "--timestep", "1e-5"]
    assert run([*words, "--gravity", "0", "--recipe", "hunt-crossley"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "steel on steel: α = 0.2 s/m (0.08 ... 0.32) up to 0.508 m/s" in printed
    assert "Hunt" in printed


def test_a_model_is_tuned_to_the_material(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["tune", BALL, "--pair", PAIR, "--material", CROQUET, "--speeds", "2, 3 m/s"]
    assert run([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["material"].startswith("croquet ball on croquet ball: e = 0.72")
    targets = {point["target"] for pair in record["pairs"] for point in pair["curve"]}
    assert targets == {0.72}
    assert record["max_error"] < 0.05


def test_measure_takes_the_speeds_at_which_e_was_measured() -> None:
    found = hb.measure(BALL, PAIR, material=CROQUET, diagnose=False)
    assert isinstance(found.wanted, ConstantRestitution)
    assert found.request.speeds == find(CROQUET).speeds
    assert found.wanted.description.startswith("croquet ball on croquet ball: e = 0.72")
    with pytest.warns(UserWarning, match=r"at 1 m/s is a guess"):
        hb.measure(BALL, PAIR, material=CROQUET, speeds="1 m/s", diagnose=False)
    with pytest.warns(UserWarning, match="measured at an unstated speed"):
        hb.measure(BALL, PAIR, material=NO_SPEED, diagnose=False)


def test_measure_prints_the_material(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["measure", BALL, "--pair", PAIR, "--material", CROQUET]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "material: croquet ball on croquet ball: e = 0.72" in printed
    assert "--material 'croquet ball on croquet ball'" in printed


def test_a_check_has_the_curve_of_the_material() -> None:
    check = plan(spec(material=WOOD))
    assert isinstance(check.wanted, MeasuredRestitution)
    assert check.request.speeds == tuple(v for v, _ in find(WOOD).points)
    assert check.against == find(WOOD).line
    steel = plan(spec(material=STEEL, target="linear"))
    assert steel.wanted == Restitution(0.2, "linear")
    with pytest.warns(
        UserWarning, match=r"from 0.5 to 6.01 m/s; its e at 0.1 to 0.2 m/s is a guess"
    ):
        plan(spec(material=WOOD, speeds="0.1, 0.2 m/s"))
    with pytest.raises(UserError, match="material and alpha are given"):
        plan(spec(material=WOOD, alpha=0.3))


def test_a_check_fails_where_the_model_bounces_otherwise() -> None:
    with pytest.warns(UserWarning, match="is a guess"):
        report = hb.check(BALL, PAIR, material=RUBBER, speeds="0.5 m/s")
    assert report.exit_code == 1
    assert "rubber on concrete" in report.outcomes[0].against


def test_a_file_of_checks_names_a_material_from_its_folder(tmp_path: Path) -> None:
    (tmp_path / "ball.xml").write_text(Path(BALL).read_text(encoding="utf-8"), encoding="utf-8")
    record = find(WOOD).model_dump(mode="json", by_alias=True) | {"name": "mine on floor"}
    (tmp_path / "mine.json").write_text(json.dumps(record), encoding="utf-8")
    file = tmp_path / "checks.toml"
    for name, expected in (("mine.json", "mine on floor"), (WOOD, WOOD)):
        file.write_text(
            f'[tool.hcbench]\n[[tool.hcbench.check]]\nmodel = "ball.xml"\npair = "{PAIR}"\n'
            f'material = "{name}"\n',
            encoding="utf-8",
        )
        (check,) = checks_of(file)
        assert check.against.startswith(expected)


def test_convert_takes_one_e_at_its_speed() -> None:
    contact = hb.convert(material=RUBBER)
    assert contact.speed == 4.25
    assert contact.restitution == pytest.approx(0.752)
    assert hb.convert(material=STEEL).alpha == pytest.approx(0.2)
    assert hb.convert(material=WOOD, speed="2.83 m/s").restitution == pytest.approx(0.817)
    with pytest.warns(UserWarning, match=r"its e at 1 m/s is a guess"):
        hb.convert(material=RUBBER, speed="1 m/s")
    with pytest.raises(UserError, match=r"^speed: none, and the source of 'ABS on steel'"):
        hb.convert(material=NO_SPEED)


def test_a_study_takes_a_material_with_an_alpha() -> None:
    content = {
        "scene": "steel-plane",
        "speeds": "4, 8 in/s",
        "material": STEEL,
        "run": [{"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-5 s"}],
    }
    study = study_from(content)
    assert study.alphas == (0.2,)
    assert study.runs[0].alphas == (0.2,)
    for change, message in (
        ({"material": RUBBER}, "study: material: .*gives no α"),
        ({"material": "nonsense"}, "study: material: 'nonsense' is not known"),
        ({"alphas": "0.3 s/m"}, "study: material: given with alphas"),
        ({"material": None}, "study: alphas: missing"),
    ):
        changed = {key: value for key, value in (content | change).items() if value is not None}
        with pytest.raises(StudyError, match=message):
            study_from(changed)


def test_the_fixture_follows_a_material(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        f"""
        def test_ball(restitution):
            bounce = restitution({BALL!r}, pair={PAIR!r}, speeds="2 m/s", max_error=0.5)
            bounce.follows(material={CROQUET!r})
        """
    )
    pytester.runpytest_inprocess("-p", "no:cacheprovider").assert_outcomes(passed=1)


def test_a_recording_becomes_a_material(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "steel-on-glass.json"
    drop = str(ROOT / "examples" / "recording" / "drop.wav")
    assert run(["fit", drop, "--write-material", str(path)]) == 0
    fitted = hb.fit(drop)
    mine = read_material(path)
    assert fitted.alpha is not None
    assert mine.name == "steel on glass"
    assert mine.source.level == "own"
    assert mine.alpha_s_per_m == pytest.approx(fitted.alpha.value, rel=1e-5)
    assert mine.speed_range_m_per_s == pytest.approx(fitted.speeds, rel=1e-5)
    assert hb.law(material=path).alpha == mine.alpha_s_per_m
    assert fitted.material("steel on glass") == mine
    # It replaces its own file, and no other.
    assert run(["fit", drop, "--write-material", str(path)]) == 0
    path.write_text("{}")
    assert run(["fit", drop, "--write-material", str(path)]) == 2
    capsys.readouterr()


def test_a_fit_without_one_law_becomes_points(tmp_path: Path) -> None:
    pairs = tmp_path / "p.csv"
    rows = ["speed [m/s],restitution", "0.5,0.9", "1,0.7", "1.5,0.69", "2,0.68"]
    pairs.write_text("\n".join(rows), encoding="utf-8")
    mine = hb.fit(pairs).material("a on b")
    assert len(mine.points) == 20
    assert mine.speed_range_m_per_s == (0.5, 2.0)
    assert "not ruled out" in mine.source.place
