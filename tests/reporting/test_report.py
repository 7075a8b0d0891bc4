"""The report: words that follow from the scores, figures that show the numbers, the same bytes every time."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_results import ALPHAS, RUNS, SCENE, SPEEDS, small_results

from hcbench.benchmark.results import CONDITIONS, REST_COLUMNS, TRAIN_COLUMNS, Results
from hcbench.benchmark.study import study_from
from hcbench.errors import OutputError
from hcbench.laws import closed_form
from hcbench.reporting import (
    advice,
    bounce_figures,
    loop_figures,
    plot_style,
    ranking,
    restitution_figures,
    tables,
    wording,
)
from hcbench.reporting.build import build
from hcbench.reporting.conditions import Views, under, views
from hcbench.reporting.drawings import drawings, loop_speeds, step_speed
from hcbench.reporting.view import RunKey, View
from hcbench.setting import Setting
from hcbench.tuning.snippet import snippet

LAW = RunKey("explicit", "law", 1e-6)
SPRING = RunKey("explicit", "spring-damper", 1e-6)
IMPULSE = RunKey("single", "impulse", 1e-3)
STOCK = RunKey("single", "stock", 2e-3)
BROKEN = RunKey("explicit", "broken", 1e-3)


@pytest.fixture(scope="module")
def results() -> Results:
    return small_results()


@pytest.fixture(scope="module")
def view(results: Results) -> View:
    return View(results)


@pytest.fixture(scope="module")
def page(results: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(results, tmp_path_factory.mktemp("report"))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_a_later_report_leaves_no_figure_of_an_earlier_one(page: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    shutil.copytree(page.parent, folder)
    (folder / "study.toml").write_text("of the user", encoding="utf-8")
    fewer = small_results([run for run in RUNS if run[1] == "stock"])
    build(fewer, folder)
    assert "figures/error-fine.svg" in contents(page.parent).keys() - contents(folder).keys()
    fresh = contents(build(fewer, tmp_path / "fresh").parent)
    assert contents(folder) == {**fresh, "study.toml": b"of the user"}


def test_same_results_same_bytes(page: Path, tmp_path: Path) -> None:
    """Built again, from the files of the first report, on a machine whose user likes other figures."""
    with mpl.rc_context({"lines.linewidth": 9.0, "font.size": 30.0, "axes.facecolor": "red"}):
        again = build(Results.read(page.parent), tmp_path / "elsewhere")
        assert mpl.rcParams["font.size"] == 30.0
    assert contents(again.parent) == contents(page.parent)


def test_files_beside_the_page(page: Path, view: View) -> None:
    names = set(contents(page.parent))
    assert {"index.html", "restitution.csv", "loops.csv", "scores.csv", "summary.json"} <= names
    drawn = {d.name for d in drawings(Views(None, view)) if d.draw is not None}
    assert {n for n in names if n.startswith("figures/")} == {
        f"figures/{name}.{kind}" for name in drawn for kind in ("svg", "png")
    }


def test_nothing_of_this_machine_or_day_is_in_the_files(page: Path) -> None:
    for name, content in contents(page.parent).items():
        for trace in (str(Path.home()), str(page.parent), str(Path(__file__).parent), "Software", "dc:date"):
            assert trace.encode() not in content, (name, trace)


def test_page_loads_nothing(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    markup = re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    loaded = re.findall(r'(?:src|srcset|data)="([^"]*)"', markup) + re.findall(r"url\(([^)]*)\)", markup)
    assert loaded
    assert all(link.startswith(("data:", "%23")) for link in loaded)  # or a part of the same picture
    assert "<script src" not in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|import|WebSocket|sendBeacon)\b\s*\(", text)
    assert "@import" not in text
    assert len(text) < 6_000_000


def test_nothing_is_left_behind_where_nothing_can_be_written(results: Results, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="can be written"):
        build(results, tmp_path / "file" / "report")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


# Words


def test_the_headline_names_what_follows_the_law_and_what_does_not(view: View) -> None:
    said = " ".join(advice.headline(view)).replace(wording.NBSP, " ")
    assert "single does not bounce like the law" in said
    assert "In single set impulse at 1 ms: the best constant e" in said
    assert "In explicit set law at 1 µs: the bounce follows the law" in said
    assert "spring-damper" not in said


def test_a_bounce_in_a_soft_contact_is_promised_without_gravity(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "law", "penetration_ratio"] = 30.0
    said = advice.headline(View(dataclasses.replace(results, scores=scores)))
    promise = "the bounce follows the law, without gravity and in a far softer contact."
    assert promise in said[-1] + said[-2]


@pytest.mark.parametrize("count", range(1, 13))
def test_no_panel_stands_alone_in_the_last_row(count: int) -> None:
    columns = loop_figures.panel_columns(count)
    assert count == columns or count % columns != 1


def test_a_plug_in_is_told_apart_from_what_can_be_set(results: Results) -> None:
    settings = [
        {**s, "options": {"law": {"alpha": 1.0}}} if s["setting"] == "law" else s for s in results.settings
    ]
    view = View(dataclasses.replace(results, settings=settings))
    said = " ".join(advice.headline(view)).replace(wording.NBSP, " ")
    assert "In explicit set spring-damper at 1 µs: further from the law than the best constant e." in said
    assert advice.plugin_sentence(view).replace(wording.NBSP, " ") == (
        "The plug-in law at 1 µs (in explicit) follows the law."
    )
    titles = {card.question: [a.title for a in card.advice] for card in advice.cards(view)}
    assert [t.replace(wording.NBSP, " ") for t in titles["A plug-in in your own simulation"]] == [
        "explicit law, 1 µs"
    ]


def test_the_headline_says_when_nothing_follows_the_law() -> None:
    constant_only = small_results([run for run in RUNS if run[1] in ("impulse", "stock")])
    said = " ".join(advice.headline(View(constant_only)))
    assert "follows the law" not in said
    assert "the best constant e" in said


def test_settings_that_differ_by_round_off_are_both_named(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "impulse", "max_error_law"] = 1e-13
    scores.loc[scores["setting"] == "law", "max_error_law"] = 1e-16
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.best(view, view.band_runs) == [LAW, IMPULSE]


def test_an_engine_as_it_comes_is_no_advice() -> None:
    stock_only = View(small_results([run for run in RUNS if run[1] == "stock"]))
    assert advice.headline(stock_only) == ["With nothing set single does not bounce like the law."]


def test_a_law_without_damping_has_a_page_too(tmp_path: Path) -> None:
    """α = 0: no constant to beat, no energy to plot; nothing divides by either."""
    lossless = small_results([("explicit", "law", 1e-6, (0.0,), SPEEDS)])
    study = {**lossless.study, "alphas": [0.0], "main_alpha": 0.0}
    page = build(dataclasses.replace(lossless, study=study), tmp_path)
    words_of_it = re.sub(r"base64,[^\"]*|<style>.*</style>", "", page.read_text(encoding="utf-8"), flags=re.S)
    assert "explicit" in words_of_it
    assert not re.search(r"\b(nan|inf)\b", words_of_it)


def test_a_study_of_the_law_alone_has_a_page_too(results: Results, tmp_path: Path) -> None:
    nothing = {n: getattr(results, n).iloc[:0] for n in ("impacts", "loops", "scores")}
    empty = Results(results.study, [], results.versions, **nothing)
    assert "The law alone" in build(empty, tmp_path).read_text(encoding="utf-8")
    assert not [p.name for p in tmp_path.rglob("*.svg")]


@pytest.mark.parametrize(
    ("run", "bounce", "grade", "loop"),
    [
        (LAW, "follows the law", "good", "loop right"),
        (SPRING, "worse than the best constant e", "bad", "loop wrong"),
        (IMPULSE, "as good as the best constant e", "even", "no loop to judge"),
        (STOCK, "worse than the best constant e", "bad", "no loop to judge"),
        (BROKEN, "loses impacts", "bad", "no loop to judge"),
    ],
)
def test_verdicts_go_by_the_scores(view: View, run: RunKey, bounce: str, grade: str, loop: str) -> None:
    assert ranking.verdict(view, run) == ranking.RunVerdict(bounce, grade, loop)


def test_energy_gained_is_said_whatever_the_error(results: Results) -> None:
    scores = results.scores.copy()
    scores.loc[scores["setting"] == "law", "energy_gained"] = True
    view = View(dataclasses.replace(results, scores=scores))
    assert ranking.verdict(view, LAW).restitution == "gains energy"
    assert LAW not in ranking.best(view, view.band_runs)
    assert LAW not in ranking.best_loops(view, view.band_runs)


def test_runs_are_ranked_by_their_error(view: View) -> None:
    for group in tables.ranking(view):
        grades = [row["verdict"].grade for row in group["rows"]]
        assert grades == sorted(grades, key=["good", "even", "bad"].index)


def test_claims_tell_pass_fail_and_not_resolved_apart(view: View) -> None:
    said = {row["run"].setting: [cell["words"] for cell in row["cells"]] for row in tables.claims(view)}
    assert said["law"] == ["pass"] * 4
    assert said["impulse"][:3] == ["not resolved"] * 3
    assert said["impulse"][3] == "fail"
    assert said["broken"] == ["not resolved"] * 4


def test_one_bad_alpha_fails_a_claim(results: Results) -> None:
    scores = results.scores.copy()
    hit = (scores["setting"] == "law") & np.isclose(scores["alpha_s_per_m"], ALPHAS[0])
    scores.loc[hit, "no_tension"] = False
    cells = tables.claims(View(dataclasses.replace(results, scores=scores)))[0]["cells"]
    assert [cell["words"] for cell in cells] == ["pass", "fail for 1 of 2 α", "pass", "pass"]


def test_lost_impacts_are_told_not_dropped(view: View) -> None:
    lost = {row["run"].setting: row for row in tables.failed_impacts(Views(None, view))}
    assert lost["broken"]["impacts"] == len(SPEEDS) * 2 * len(ALPHAS)
    assert lost["broken"]["reason"] == "the engine's process died on it"
    assert view.curve(BROKEN, ALPHAS[1]) is None


# Under gravity


def dropped(results: Results, gravity: float, **rests: tuple[float, float]) -> Results:
    """The same results as if they had been measured under gravity; rests: depth and motion, m, by setting."""

    def heavy(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(gravity_m_per_s2=gravity)

    rows = []
    for run in (LAW, SPRING, IMPULSE, STOCK):
        rest = rests.get(run.setting.replace("-", "_"), (1e-9, 0.0))
        rows.append((SCENE, gravity, 0.0, 0.0, *run[:2], ALPHAS[1], run.timestep, 6.0, *rest))
    return dataclasses.replace(
        results,
        settings=[{**record, "gravity_m_per_s2": gravity} for record in results.settings],
        impacts=heavy(results.impacts).assign(penetration_max_m=1e-7),
        loops=heavy(results.loops).iloc[:0],
        scores=heavy(results.scores),
        rests=pd.DataFrame(rows, columns=REST_COLUMNS),
    )


def both(free: Results, heavy: Results) -> Results:
    names = ("impacts", "loops", "scores", "rests")
    pairs = {name: (getattr(free, name), getattr(heavy, name)) for name in names}
    tables_of_both = {name: pd.concat([t for t in pair if len(t)]) for name, pair in pairs.items()}
    return dataclasses.replace(free, settings=[*free.settings, *heavy.settings], **tables_of_both)


def test_the_page_leads_with_what_was_dropped_and_marks_the_rest(results: Results, tmp_path: Path) -> None:
    found = both(results, dropped(results, 9.81, law=(5e-3, 0.0), spring_damper=(5e-3, 0.0)))
    page = build(found, tmp_path).read_text(encoding="utf-8")
    said = re.sub(r'src="[^"]*"', "", page)
    said = re.sub(r"<style>.*</style>|<script.*?</script>|<[^>]*>", " ", said, flags=re.S)
    said = said.replace(wording.NBSP, " ").split("Restitution over impact speed, under gravity")[0]
    first, rest, answer = re.split("Every setting in one line, under gravity|Which setting to use when", said)
    assert "Set impulse: e within 0.042 of the law." in first
    assert "In explicit no setting of this study both bounces and rests under gravity." in answer
    assert "In single set impulse at 1 ms" in answer
    warned = answer.split("Do not use under gravity")[1]
    assert "explicit law, 1 µs" in warned
    assert "sinks 5 mm at rest" in warned
    assert "follows the law" in rest
    headings = re.findall(r"<h2>([^<]*)</h2>", page)
    free = headings[headings.index("Without gravity") + 1 : headings.index("How each setting was set")]
    free = [heading for heading in free if "swatch" not in heading and heading.strip()]
    assert free
    assert all(heading.endswith("without gravity") for heading in free)


@pytest.mark.parametrize(
    ("depth", "motion", "lacks"),
    [
        (9e-5, 9e-6, ()),
        (1.1e-4, 0.0, ("sinks 0.11 mm at rest",)),
        (1e-6, 1.1e-5, ("does not come to rest",)),
        (math.nan, math.nan, ("does not come to rest",)),
    ],
)
def test_a_setting_that_sinks_or_moves_at_rest_is_not_advised(
    results: Results, depth: float, motion: float, lacks: tuple[str, ...]
) -> None:
    """By g h², 9.81 µm at 1 ms: ten times of it deep, once of it in motion."""
    view = View(under(dropped(results, 9.81, impulse=(depth, motion)), 9.81))
    found = tuple(text.replace(wording.NBSP, " ") for text in ranking.lacks(view, IMPULSE))
    assert found == lacks
    assert (IMPULSE in ranking.best(view, [IMPULSE])) == (not lacks)
    assert (ranking.verdict(view, IMPULSE).grade == "bad") == bool(lacks)


def test_a_contact_deeper_than_any_step_needs_is_not_advised(results: Results) -> None:
    heavy, limit = dropped(results, 9.81), ranking.DEEP * SPEEDS[-1] * 1e-3
    for share, advised in ((0.99, True), (1.01, False)):
        impacts = heavy.impacts.assign(penetration_max_m=share * limit)
        view = View(under(dataclasses.replace(heavy, impacts=impacts), 9.81))
        assert (ranking.best(view, [IMPULSE]) == [IMPULSE]) == advised


def test_what_ran_on_the_flat_alone_stands_in_and_is_marked(results: Results) -> None:
    flat = {"scene": "elsewhere"}
    moved = dropped(results, 0.0)
    scenes = {name: {"form": "plane", "relative_radius_m": 0.05} for name in (SCENE, "elsewhere")}
    own = [record for record in results.settings if record["setting"] != "law"]
    there = [{**record, **flat} for record in results.settings]

    def also_there(table: pd.DataFrame) -> pd.DataFrame:
        return pd.concat([table[table["setting"] != "law"], table.assign(**flat)])

    found = dataclasses.replace(
        moved,
        study={**results.study, "scenes": scenes},
        settings=[*own, *there],
        impacts=also_there(results.impacts),
        loops=also_there(results.loops),
        scores=also_there(results.scores),
    )
    view = View(under(found, 0.0))
    assert RunKey(*LAW[:3], "on a flat plate") in view.band_runs
    assert IMPULSE in view.band_runs
    assert RunKey(*IMPULSE[:3], "on a flat plate") not in view.band_runs
    sentences = " ".join(advice.headline(view)).replace(wording.NBSP, " ")
    assert "In explicit set law on a flat plate at 1 µs" in sentences


# Figures


def test_curves_show_the_measured_restitution(view: View) -> None:
    figure = restitution_figures.restitution_figure(view, restitution_figures.columns_of_alphas(view, True))
    panel = figure.axes[1]  # the only fine engine's row, the second α
    law, linear, *engines = [np.asarray(line.get_xydata()) for line in panel.get_lines()]
    np.testing.assert_allclose(law[:, 1], closed_form.restitution(ALPHAS[1], law[:, 0]))
    np.testing.assert_allclose(linear[:, 1], 1 - ALPHAS[1] * linear[:, 0])
    curve = view.curve(LAW, ALPHAS[1])
    assert curve is not None
    np.testing.assert_array_equal(engines[0], np.column_stack([curve.speed, curve.middle]))
    np.testing.assert_allclose(curve.middle, closed_form.restitution(ALPHAS[1], curve.speed), atol=1e-3)


def test_what_lies_below_the_frame_is_named(view: View) -> None:
    figure = restitution_figures.restitution_figure(view, restitution_figures.columns_of_alphas(view, False))
    said = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert [s for s in said if "stock" in s] == ["▼ stock: e = 0.10"] * len(ALPHAS)


def test_a_figure_without_content_says_why() -> None:
    coarse_only = View(small_results([run for run in RUNS if run[1] in ("impulse", "stock")]))
    by_name = {d.name: d for d in drawings(Views(None, coarse_only))}
    for name in ("restitution-fine", "error-fine", "loops", "steps"):
        assert by_name[name].draw is None
        assert by_name[name].why
    assert by_name["restitution-coarse"].draw is not None


def test_a_bounce_train_is_drawn_over_the_laws(results: Results) -> None:
    """A constant e loses the same share each time: a straight line on the log axis."""
    heights = 0.01 * 0.9 ** (2 * np.arange(1, 6))
    key = (SCENE, 0.0, 0.0, 0.0, *IMPULSE[:2], ALPHAS[1], 1e-3)
    rows = [(*key, i, 0.1 * i, 0.1 * i, h, 0.01 * 0.8**i) for i, h in enumerate(heights, 1)]
    study = {**results.study, "train_height": 0.01}
    dropped = dataclasses.replace(results, study=study, trains=pd.DataFrame(rows, columns=TRAIN_COLUMNS))
    left, right = bounce_figures.bounces_figure(View(dropped)).axes
    law, train = (np.asarray(line.get_xydata()) for line in left.get_lines())
    np.testing.assert_allclose(law[:, 1], 10 * 0.8 ** np.arange(6))
    np.testing.assert_allclose(np.diff(np.log(train[:, 1])), 2 * np.log(0.9))
    over = np.asarray(right.get_lines()[1].get_xydata())
    np.testing.assert_allclose(over[:, 1], 1e3 * heights / law[1:, 1])
    by_name = {d.name: d for d in drawings(views(results))}
    assert by_name["trains"].draw is None


def test_every_figure_has_a_text_for_who_cannot_see_it(view: View, page: Path) -> None:
    for drawing in drawings(Views(None, view)):
        assert len(drawing.alt) > 40
        assert not re.search(r"\bnan\b", drawing.alt)
    captions = re.findall(
        r'<figure id="figure-[^>]*>\n<figcaption>(.*?)</figcaption>', page.read_text("utf-8")
    )
    assert len(captions) == sum(drawing.draw is not None for drawing in drawings(Views(None, view)))
    assert not [caption for caption in captions if re.search(r"\bnan\b", caption)]


def test_no_two_settings_of_an_engine_look_alike() -> None:
    known = list(
        plot_style.plot_styles(
            [("mujoco", name) for name in plot_style._RECIPES if name != "restitution"], "reference"
        ).values()
    )
    new = list(plot_style.plot_styles([("mujoco", f"new {i}") for i in range(5)], "reference").values())
    assert len({look.colour for look in known + new}) == len(known + new)
    assert len({look.marker for look in known + new}) == len(known + new)


def test_a_setting_looks_the_same_in_every_study() -> None:
    alone = plot_style.plot_styles([("mujoco", "impulse")], "reference")
    among = plot_style.plot_styles(
        [("mujoco", "impulse"), ("mujoco", "aaa"), ("nobodys", "impulse"), ("pybullet", "x")], "reference"
    )
    assert alone["mujoco", "impulse"] == among["mujoco", "impulse"]
    assert among["nobodys", "impulse"].dashes != among["mujoco", "impulse"].dashes


def test_engines_have_their_titles_and_those_that_are_not_installed_their_names() -> None:
    assert [wording.engine_title(name) for name in ("mujoco", "nowhere")] == ["MuJoCo", "nowhere"]


@given(st.lists(st.floats(0, 1), min_size=1, max_size=14))
def test_labels_keep_their_order_and_never_overlap(wanted: list[float]) -> None:
    places = plot_style.declutter(np.array(wanted), 0.05, 0.0, 1.0)
    assert (np.diff(np.sort(places)) >= 0.05 - 1e-6).all() or len(wanted) == 1
    assert (np.diff(places[np.argsort(wanted, kind="stable")]) >= 0).all()
    assert places.min() >= -1e-6


# Text to paste, numbers in words


def text_of(engine: str, options: dict[str, Any], form: str = "plane") -> str:
    return snippet(Setting(engine, "x", 1e-3, options), form)


SPRING_ROW: dict[str, Any] = {
    "solref": [-1.1 / 3, 0.0],
    "solimp": [1e-4, 1e-4, 1.0, 0.5, 1.0],
    "onset": 1e-6,
    "adhesion": 0.0,
}
DAMPER_ROW: dict[str, Any] = {"solref": [0.0, -1926.9348713286079], "solimp": [0.1, 0.9, 1e-3, 0.5, 2.0]}


def test_pasted_mujoco_text_compiles_to_the_same_numbers() -> None:
    mujoco = pytest.importorskip("mujoco")
    rows = [SPRING_ROW, DAMPER_ROW]
    lines = text_of("mujoco", {"integrator": "implicitfast", "rows": rows}).splitlines()
    parts = {tag: "".join(s for s in lines if s.startswith(f"<{tag}")) for tag in ("option", "geom", "pair")}
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>{parts["option"]}<worldbody><geom name="plate" type="plane" size="1 1 .1"/>
        <body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".0508" mass="2"/>{parts["geom"]}
        </body></worldbody><contact>{parts["pair"]}</contact></mujoco>"""
    )
    assert model.opt.timestep == 1e-3
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert model.body("ball").mass == 2.0
    assert model.pair_solref.tolist() == [row["solref"] for row in rows]
    assert model.pair_solimp.tolist() == [row["solimp"] for row in rows]
    assert model.pair_margin.tolist() == [-1e-6, 0.0]


def test_the_cup_takes_its_numbers_on_the_tendon() -> None:
    text = text_of("mujoco", {"rows": [DAMPER_ROW]}, form="cup")
    assert 'solreflimit="0 -1926.9348713286079" solimplimit="0.1 0.9 0.001 0.5 2"' in text
    assert "<pair" not in text


def test_pasted_pybullet_text_makes_every_call_in_order() -> None:
    options = {
        "world": {"contactSlop": 0.0, "contactBreakingThreshold": 0.02},
        "ball": {"restitution": 1 / 3},
        "plate": {"restitution": 1.0},
        "maximal_coordinates": True,
    }
    calls: list[tuple[Any, ...]] = []

    class Recorder:
        def __getattr__(self, name: str) -> Any:
            def call(*args: Any, **kwargs: Any) -> str:
                calls.append((name, args, kwargs))
                return f"body {len(calls)}"

            return call

    exec(text_of("pybullet", options), {"pybullet": Recorder()})
    world = {"fixedTimeStep": 1e-3, "contactSlop": 0.0, "contactBreakingThreshold": 0.02}
    assert calls == [
        ("setPhysicsEngineParameter", (), world),
        ("loadURDF", ("ball.urdf",), {"useMaximalCoordinates": True}),
        ("loadURDF", ("plate.urdf",), {"useMaximalCoordinates": True}),
        ("changeDynamics", ("body 2", -1), {"restitution": 1 / 3}),
        ("changeDynamics", ("body 3", -1), {"restitution": 1.0}),
    ]


def test_nothing_to_paste_for_an_engine_as_it_comes() -> None:
    assert text_of("mujoco", {}) == ""


def test_options_of_an_unknown_engine_are_shown_as_they_are() -> None:
    assert json.loads(text_of("nobodys", {"time_step": 0.0, "dissipation": 1.5})) == {
        "time_step": 0.0,
        "dissipation": 1.5,
    }


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.06513, "0.0651"),
        (2.14e-5, "2.1·10⁻⁵"),
        (1e-16, "<10⁻¹²"),
        (math.nan, "–"),
        (1234.5, "1234"),
    ],
)
def test_small_numbers_in_words(value: float, text: str) -> None:
    assert wording.number(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(1e-6, "1 µs"), (5e-5, "50 µs"), (1e-3, "1 ms"), (1 / 240, "1/240 s"), (4e-3, "4 ms"), (2.0, "2 s")],
)
def test_times_in_words(seconds: float, text: str) -> None:
    assert wording.time(seconds).replace(wording.NBSP, " ") == text


def test_results_of_the_former_schema_are_read(results: Results, tmp_path: Path) -> None:
    """Schema 1 has no columns of gravity, place and friction, and no table of rests."""
    results.write(tmp_path)
    (tmp_path / "rests.csv").unlink()
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    summary["schema"] = 1
    for record in summary["settings"]:
        for name in CONDITIONS:
            del record[name]
    (tmp_path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    for name in ("restitution", "loops", "scores", "trains"):
        table = pd.read_csv(tmp_path / f"{name}.csv").drop(columns=CONDITIONS)
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    again = views(Results.read(tmp_path)).main
    assert again.band_runs == views(results).main.band_runs
    assert advice.headline(again) == advice.headline(views(results).main)


@pytest.mark.parametrize("unit", ["m/s", "in/s"])
def test_a_study_is_reported_in_the_unit_that_it_is_written_in(results: Results, unit: str) -> None:
    written = {"scene": "steel-plane", "alphas": "0.3 s/m", "speeds": f"0.1, 0.4 {unit}"}
    run = {"engine": "reference", "recipe": "hunt-crossley", "timesteps": "1e-5 s"}
    study = study_from({**written, "run": [run]}).described()
    assert study["speed_unit"] == unit
    shown = View(dataclasses.replace(results, study={**results.study, "speed_unit": unit}))
    for text in (advice.band_text(shown), loop_speeds(shown), step_speed(shown)):
        assert ("in/s" in text) == (unit == "in/s")
        assert unit in text
    figure = restitution_figures.restitution_figure(shown, [restitution_figures.Column("", ALPHAS[1], [LAW])])
    tops = [axis.get_xlabel() for axes in figure.axes for axis in axes.child_axes]
    assert ("in/s" in tops) == (unit == "in/s")
