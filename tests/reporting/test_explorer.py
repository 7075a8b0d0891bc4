"""The explorer in a real browser: every control, the keyboard, a phone,
the dark, and what axe-core says.
"""

from __future__ import annotations

import dataclasses
import json
import re
from functools import partial
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pytest
from small_results import ALPHAS, MASS, STIFFNESS, answer, small_results

import hcbench
from hcbench.benchmark.bounce_sequence import law_heights
from hcbench.benchmark.results import REST_COLUMNS, RUN_KEY, TRAIN_COLUMNS, ImpactTable, Results
from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.reporting.build import overview_drawing, page_text
from hcbench.reporting.measurement_page import explorer_of, measurement_page
from hcbench.reporting.page import draw
from hcbench.reporting.tables import views

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from playwright.sync_api import Page

HEIGHT, GRAVITY, ALPHA = 0.01, 9.81, ALPHAS[1]
SPEEDS = (0.1, 0.2, 0.4)
LAWS = [
    (alpha, speed) for alpha in (0.0, 0.05, 0.315, 3.0, 30.0) for speed in (1e-4, 0.02, 0.3, 5.0)
]
STEPS = {
    **{("single", name): (1e-3, 2e-3) for name in ("stock", "impulse")},
    ("explicit", "law"): (1e-6, 1e-5),
    ("explicit", "spring-damper"): (1e-5,),
    ("explicit", "stock"): (1e-5,),
}


def bouncing(step: float) -> pd.DataFrame:
    """Ten bounces of the setting "impulse" at a step, each a fifth lower."""
    place = ("steel-plane", GRAVITY, 0.0, 0.0, "single", "impulse", ALPHA, step)
    heights = HEIGHT * 0.8 ** np.arange(11)
    touch = np.cumsum(np.sqrt(2 * heights / GRAVITY) * [1, *[2] * 10])[:10]
    law = law_heights(HuntCrossley(STIFFNESS, ALPHA), MASS, HEIGHT)
    rows = zip(range(1, 11), touch, touch + step, heights[1:], law, strict=True)
    return pd.DataFrame([(*place, *row) for row in rows], columns=TRAIN_COLUMNS)


@pytest.fixture(scope="module")
def results() -> Results:
    """Two engines with and without gravity, one setting dropped too."""
    found = small_results(
        [(*key, h, ALPHAS, SPEEDS) for key, steps in STEPS.items() for h in steps]
    )
    with_gravity = {"gravity_m_per_s2": GRAVITY}
    tables = {
        name: pd.concat([getattr(found, name).assign(**with_gravity), getattr(found, name)])
        for name in ("impacts", "loops", "scores")
    }
    study = {
        **found.study,
        "speeds": SPEEDS,
        "loop_speeds": SPEEDS,
        "step_speed": SPEEDS[1],
        "train_height": HEIGHT,
    }
    lying = [
        *(
            dict(zip(RUN_KEY, ("steel-plane", GRAVITY, 0.0, 0.0, *key, ALPHA, h), strict=True))
            for key, steps in STEPS.items()
            for h in steps
        )
    ]
    rests = pd.DataFrame(
        [{**run, "followed_s": 6.0, "depth_m": 0.0, "motion_m": 0.0} for run in lying]
    )
    return dataclasses.replace(
        found,
        study=study,
        table=ImpactTable.of(tables.pop("impacts"), study),
        settings=[{**setting, **more} for more in (with_gravity, {}) for setting in found.settings],
        trains=pd.concat([bouncing(1e-3), bouncing(2e-3)]),
        rests=rests[REST_COLUMNS],
        answers=[
            answer(*key, h, alpha, gravity)
            for key, steps in STEPS.items()
            if key[1] in ("impulse", "law")
            for h in steps
            for alpha in ALPHAS
            for gravity in (0.0, GRAVITY)
        ],
        **tables,
    )


@pytest.fixture(scope="module")
def address(results: Results, tmp_path_factory: pytest.TempPathFactory) -> str:
    found = views(results)
    path = tmp_path_factory.mktemp("explorer") / "index.html"
    path.write_text(page_text(found, results, draw(overview_drawing(found.main))), encoding="utf-8")
    return path.as_uri()


@pytest.fixture
def opened(opening: Callable[..., Page], address: str) -> Callable[..., Page]:
    """Opens the page of `results`, or one at another address."""
    return partial(opening, address)


@pytest.fixture
def page(opened: Callable[..., Page]) -> Page:
    return opened()


def words(page: Page, name: str) -> str:
    return page.locator(f"#explorer-{name}").inner_text()


def lines(page: Page, name: str) -> list[str]:
    """The lines of a plot, as they are drawn."""
    return list(
        page.locator(f"#explorer-{name} .line").evaluate_all(
            "all => all.map(e => e.getAttribute('d'))"
        )
    )


def reading(page: Page) -> str:
    return str(page.locator("#explorer-curve").get_attribute("aria-valuetext"))


def test_the_law_of_the_page_is_ours(page: Page) -> None:
    body = {"k": STIFFNESS, "n": 1.5, "m": MASS}
    found = page.evaluate(
        """([body, laws]) => laws.map(([alpha, speed]) => {
        const {t, x, f} = lawLoop(body, alpha, speed, 160);
        return [lawRestitution(alpha, speed), x[80], Math.max(...f), f[40], t[40], t[160]]; })""",
        [body, LAWS],
    )
    for (alpha, speed), values in zip(LAWS, found, strict=True):
        law = HuntCrossley(STIFFNESS, alpha)
        loop = closed_form.loop(law, MASS, speed, 161)
        exact = [
            float(closed_form.restitution(alpha, speed)),
            loop.penetration[80],
            loop.force.max(),
            loop.force[40],
        ]
        assert values[:4] == pytest.approx(exact, rel=1e-12 if alpha else 1e-6)
        assert values[4:] == pytest.approx([loop.time[40], loop.time[160]], rel=3e-5)
    drop = page.evaluate(
        "([body, alpha, h, g]) => lawDrop(body, alpha, h, g)", [body, ALPHA, HEIGHT, GRAVITY]
    )
    heights = [HEIGHT]
    for _ in drop["height"]:
        e = float(closed_form.restitution(ALPHA, np.sqrt(2 * GRAVITY * heights[-1])))
        heights.append(e**2 * heights[-1])
    assert drop["height"] == pytest.approx(heights[1:], rel=1e-12)
    # The report's own have gravity in the contact too: 0.7 % lower after ten bounces.
    assert drop["height"] == pytest.approx(
        law_heights(HuntCrossley(STIFFNESS, ALPHA), MASS, HEIGHT), rel=1e-2
    )


def test_each_choice_changes_the_answer_and_the_curves(page: Page) -> None:
    page.select_option("#explorer-engine", "single")
    for name, value in (
        ("step", "0.001"),
        ("gravity", "0"),
        ("alpha", str(ALPHAS[0])),
        ("engine", "explicit"),
    ):
        before = words(page, "say"), lines(page, "curve"), page.url
        page.select_option(f"#explorer-{name}", value)
        say, curves, url = words(page, "say"), lines(page, "curve"), page.url
        assert page.locator(f"#explorer-{name}").input_value() == value
        assert url != before[2]
        assert (say, curves) != before[:2] or name in ("step", "gravity"), name
    assert words(page, "say") == "Set law: e within 0.05 from 0.1 to 0.4 m/s."
    assert "explicit" in reading(page)


def test_any_alpha_draws_the_law_and_says_how_to_find_a_setting(page: Page) -> None:
    page.select_option("#explorer-alpha", "other")
    page.fill("#explorer-own-alpha", "0.5")
    page.press("#explorer-own-alpha", "Enter")
    assert "Not asked here" in words(page, "say")
    assert '--alpha "0.5 s/m"' in words(page, "paste-text")
    assert len(lines(page, "curve")) == 1, "nothing set, which no α changes"
    assert page.locator("#explorer-curve .law").count() == 1
    assert page.evaluate("data.alphas.includes(alphaNow())") is False


def test_a_point_of_the_curve_shows_the_loop_of_that_impact(page: Page, results: Results) -> None:
    page.select_option("#explorer-engine", "explicit")
    page.select_option("#explorer-gravity", "0")
    dots = page.locator("#explorer-curve .dot")
    impacts = results.impacts
    seen = set()
    for i in range(dots.count()):
        box = dots.nth(i).bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        run, at, loop = page.evaluate("(c => [c.run, c.i, data.loops[c.run.loops[c.i]]])(chosen())")
        here = impacts[
            (impacts["gravity_m_per_s2"] == 0)
            & (impacts["engine"] == run["engine"])
            & (impacts["setting"] == run["setting"])
            & np.isclose(impacts["alpha_s_per_m"], run["alpha"])
            & (impacts["timestep_s"] == run["step"])
            & np.isclose(impacts["speed_m_per_s"], run["asked"][at])
            & (impacts["phase"] == run["phase"])
        ]
        assert len(here) == 1
        impact = here.iloc[0]
        seen.add((run["setting"], run["asked"][at]))
        assert max(loop[1]) == pytest.approx(impact["penetration_max_m"], rel=1e-3)
        assert max(loop[2]) == pytest.approx(impact["force_max_n"], rel=1e-3)
        assert run["e"][at] == pytest.approx(impact["restitution"], abs=1e-5)
        deep, hard = re.findall(r"([\d.]+) µm deep.*at most ([\d.]+) N", words(page, "loop-words"))[
            0
        ]
        assert float(deep) == pytest.approx(1e6 * impact["penetration_max_m"], rel=5e-3)
        assert float(hard) == pytest.approx(impact["force_max_n"], rel=5e-3)
        assert float(re.findall(r"e = ([\d.]+)", reading(page))[0]) == pytest.approx(
            run["e"][at], abs=6e-5
        )
        assert len(lines(page, "loop")) == len(lines(page, "force")) == 1
    assert len(seen) == dots.count() >= len(SPEEDS)


def test_pointing_at_a_point_reads_it_and_leaves_the_choice(page: Page) -> None:
    before = reading(page)
    box = page.locator("#explorer-curve .dot").last.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 3, box["y"] + 3)
    assert words(page, "reading") != before
    assert reading(page) == before
    page.mouse.move(1, 1)
    assert words(page, "reading") == before


def test_tabs_show_the_error_over_the_step_the_numbers_and_the_text(page: Page) -> None:
    page.select_option("#explorer-engine", "single")
    page.get_by_role("tab", name="Error over step").click()
    assert len(lines(page, "steps")) == 2
    assert "0.2 m/s" in words(page, "steps-words") or "0.4 m/s" in words(page, "steps-words")
    page.get_by_role("tab", name="What was measured").click()
    cells = page.locator("#explorer-numbers-body tr").first.locator("td, th").all_inner_texts()
    assert cells[:3] == ["0.1", "3.94", f"{closed_form.restitution(ALPHA, 0.1):.4f}"]
    page.get_by_role("tab", name="How it was set").click()
    assert "How impulse bounces." in words(page, "how")
    assert json.loads(words(page, "how-text")) == {"number": ALPHA}
    assert "Holds here." in words(page, "how-notes")
    assert page.locator("#explorer-body [role=tabpanel]:visible").count() == 1


def test_the_ranking_follows_the_choices_and_puts_settings_into_the_plots(page: Page) -> None:
    page.select_option("#explorer-engine", "single")
    shown = lines(page, "curve")
    page.get_by_role("checkbox", name="single, nothing set").uncheck()
    assert len(lines(page, "curve")) == len(shown) - 1
    rows = page.locator("#explorer-ranking-body tr")
    assert rows.count() == 3
    assert rows.nth(0).locator("th").inner_text() == "best constant e"
    page.get_by_role("button", name="single, nothing set").click()
    assert "How stock bounces." in words(page, "how")
    assert len(lines(page, "curve")) == len(shown)
    page.select_option("#explorer-engine", "explicit")
    page.select_option("#explorer-gravity", "0")
    page.select_option("#explorer-step", "0.00001")
    assert "without gravity" in words(page, "where")
    law = (
        page.locator("#explorer-ranking-body tr", has_text="explicit law")
        .locator("td")
        .all_inner_texts()
    )
    assert law[-5:-1] == ["–", "–", "–", "✓"], "the paper's claims, of few steps in contact"


def test_the_address_holds_the_choice(page: Page, opened: Callable[..., Page]) -> None:
    assert "#" not in page.url
    page.select_option("#explorer-engine", "explicit")
    page.select_option("#explorer-gravity", "0")
    page.locator("#explorer-curve").press("End")
    page.get_by_role("tab", name="What was measured").click()
    page.get_by_role("checkbox", name=re.compile("spring")).check()
    again = opened(page.url[page.url.index("#") :])
    for name in ("say", "reading", "ranking-body"):
        assert words(again, name) == words(page, name)
    assert lines(again, "curve") == lines(page, "curve")
    assert again.get_by_role("checkbox", name=re.compile("spring")).is_checked()
    nonsense = opened(
        "#engine=ode&step=x&gravity=7&alpha=-3&setting=%3Cb%3E&speed=1e999&toggled=,,&tab=no"
    )
    assert words(nonsense, "say") == words(opened(), "say")


def test_it_works_by_keyboard_alone(page: Page) -> None:
    focused = "document.activeElement.id"
    found = {}
    for _ in range(60):
        page.keyboard.press("Tab")
        found[page.evaluate(focused)] = True
        if page.evaluate(focused) in ("explorer-engine", "explorer-gravity"):
            page.keyboard.press("ArrowDown")
        if page.evaluate(focused) == "explorer-curve":
            before = reading(page)
            page.keyboard.press("Home")
            page.keyboard.press("ArrowRight")
            assert "0.2 m/s" in reading(page)
            page.keyboard.press("ArrowUp")
            assert reading(page) != before
        if page.evaluate(focused) == "explorer-time":
            page.keyboard.press("ArrowRight")
            assert page.locator("#explorer-time").input_value() != "0"
        if page.evaluate(focused) == "explorer-tab-loop":
            page.keyboard.press("ArrowRight")
            assert page.evaluate(focused) == "explorer-tab-steps"
            page.keyboard.press("ArrowLeft")
            break
    wanted = (
        "engine",
        "step",
        "gravity",
        "alpha",
        "copy",
        "curve",
        "play",
        "rate",
        "time",
        "tab-loop",
    )
    assert {f"explorer-{name}" for name in wanted} <= set(found)
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"


def test_copying_gives_what_to_paste(opened: Callable[..., Page]) -> None:
    page = opened(permissions=["clipboard-read", "clipboard-write"])
    page.click("#explorer-copy")
    page.get_by_text("Copied.").wait_for()
    pasted = page.evaluate("navigator.clipboard.readText()")
    assert json.loads(pasted) == {"number": ALPHA, "first": "ball", "second": "plate"}
    assert pasted == page.locator("#explorer-paste-text").text_content()


def test_the_text_takes_the_readers_two_names_and_kind(
    page: Page, opened: Callable[..., Page]
) -> None:
    page.fill("#explorer-first-name", "foot")
    page.fill("#explorer-second-name", "floor")
    text = json.loads(page.locator("#explorer-paste-text").text_content() or "")
    assert (text["first"], text["second"]) == ("foot", "floor")
    page.fill("#explorer-first-name", "<b>")
    assert page.locator("#explorer-first-name").get_attribute("aria-invalid") == "true"
    assert "“<b>” cannot stand in this text" in words(page, "say")
    assert not page.locator("#explorer-paste-text").text_content()
    page.fill("#explorer-first-name", "foot")
    assert words(page, "say") == "Set impulse: e within 0.05 from 0.1 to 0.4 m/s."
    for line in (
        "One e would do.",
        "Cut.",
        "Energy never grew in 88 launches",
        "Never use spring-damper: gains",
    ):
        assert line in words(page, "more")
    page.get_by_role("tab", name="Plug-in").click()
    assert words(page, "say") == "Attach law: e within 1e-7 from 0.1 to 0.4 m/s."
    again = opened(page.url[page.url.index("#") :])
    assert words(again, "say") == words(page, "say")
    assert again.locator("#explorer-second-name").input_value() == "floor"


def test_balls_play_once_and_stop_when_asked(page: Page, opened: Callable[..., Page]) -> None:
    time = page.locator("#explorer-time")
    page.evaluate("pause(); moveTo(0)")
    stopped, passed = page.evaluate(
        """() => new Promise(done => { const begin = performance.now(); at("play").click();
        setTimeout(() => { at("play").click(); done([clock.time, performance.now() - begin]); }, 200); })"""
    )
    assert 0.0 < stopped <= 0.25e-3 * passed, "a quarter of the time that has passed"
    page.wait_for_timeout(100)
    assert float(time.input_value()) == pytest.approx(stopped, abs=2e-3)
    time.fill("0.3")
    balls = page.locator("#explorer-drop .ball")
    spoken = str(time.get_attribute("aria-valuetext"))
    assert spoken.startswith("0.3")
    assert balls.count() == len(re.findall("mm", spoken)) >= 2
    assert opened().evaluate("clock.running") > 0, "it plays as the page opens"
    calm = opened(reduced_motion="reduce")
    assert calm.evaluate("[clock.running, clock.time]") == [0, 0], (
        "but for readers who want no motion"
    )
    moments = []
    for _ in range(3):
        calm.click("#explorer-play")
        calm.wait_for_timeout(30)
        moments.append(float(calm.locator("#explorer-time").input_value()))
    first = np.sqrt(2 * HEIGHT / GRAVITY)
    assert moments[0] == pytest.approx(first, abs=2e-3)
    assert moments == sorted(set(moments))


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1300, 380])
def test_axe_finds_nothing_and_nothing_sticks_out(
    opened: Callable[..., Page], width: int, scheme: Any
) -> None:
    pytest.importorskip(
        "axe_playwright_python", reason="axe-core, which checks accessibility, is not here"
    )
    page = opened(width=width, color_scheme=scheme)
    page.evaluate((resources.files("axe_playwright_python") / "axe.min.js").read_text("utf-8"))
    for tab in ("loop", "steps", "numbers", "text"):
        page.click(f"#explorer-tab-{tab}")
        scope = "document" if tab == "loop" else "'#explorer-body'"
        found = page.evaluate(
            f"axe.run({scope}, {{resultTypes: ['violations']}}).then(r => r.violations)"
        )
        assert [(v["id"], [n["target"] for n in v["nodes"]][:3]) for v in found] == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", background)[:3])) < 200) == (scheme == "dark")


def test_without_a_script_the_answer_and_a_picture_stay(
    opened: Callable[..., Page], page: Page
) -> None:
    still = opened(java_script_enabled=False)
    assert words(still, "say") == words(page, "say")
    assert still.locator("#figure-overview img").is_visible()
    assert not still.locator("#explorer-choices").is_visible()
    assert not page.locator("#figure-overview img").is_visible()


SOFT = """<mujoco><option timestep="0.0002" integrator="Euler"/><worldbody>
<geom name="plate" type="plane" size="1 1 .1" solref="-3e5 -40"/>
<body pos="0 0 .2"><freejoint/><geom name="ball" type="sphere" size=".05" mass=".5" solref="-3e5 -40"/></body>
</worldbody></mujoco>"""


def test_a_measurements_page_has_the_same_explorer(
    opened: Callable[..., Page], tmp_path: Path
) -> None:
    (tmp_path / "soft.xml").write_text(SOFT)
    verb: Any = hcbench.measure
    found = verb(tmp_path / "soft.xml", pair="ball,plate", speeds=[0.2, 0.4], phases=2, alpha=0.1)
    (tmp_path / "page.html").write_text(measurement_page(found), encoding="utf-8")
    page = opened(to=(tmp_path / "page.html").as_uri())
    page.locator("#explorer-curve").press("Home")
    slow = min(found.loops, key=lambda impact: impact.speed_in)
    shown = re.findall(r"e = ([\d.]+)", reading(page))
    assert float(shown[0]) == pytest.approx(slow.restitution, abs=6e-5)
    assert f"at most {slow.force_max:.3g} N" in words(page, "loop-words")
    assert page.locator("#explorer-panel-loop .plot:visible").count() == 2
    assert not page.locator(".still img").first.is_visible()


def test_a_measurements_explorer_shows_impacts_along_the_normal_alone(tmp_path: Path) -> None:
    (tmp_path / "soft.xml").write_text(SOFT)
    launches = {"pair": "ball,plate", "speeds": [0.2, 0.4], "phases": 1, "alpha": 0.1}
    verb: Any = hcbench.measure
    curves = []
    for angle in ("0, 80 deg", "80 deg, 0 deg"):
        explored = explorer_of(verb(tmp_path / "soft.xml", angle=angle, **launches))
        assert explored is not None
        curves.append(json.loads(explored.data)["runs"][0]["e"])
    straight = verb(tmp_path / "soft.xml", **launches)
    assert curves[0] == curves[1]
    assert curves[0] == pytest.approx([i.restitution for i in straight.impacts], abs=6e-6)
