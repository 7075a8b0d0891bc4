"""Output files: an input is never replaced, nor a file that hcbench did not write."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from covering import every_pair

import hcbench as hb
from hcbench import cli
from hcbench.reporting.page import png_bytes
from hcbench.reporting.plot_style import new_figure
from hcbench.system.errors import OutputError, UserError
from hcbench.system.files import json_text
from hcbench.system.outputs import require_outputs, write_output

EXAMPLES = Path(__file__).parents[2] / "examples"
HEIGHTS = "height [cm]\n30\n22\n17\n13.5\n11\n9.2\n7.8\n"
MODEL = (EXAMPLES / "good.xml").read_text(encoding="utf-8")
LAUNCH = ["good.xml", "--pair=ball,plate", "--speeds=0.5", "--phases=1"]
HELD = ["check", *LAUNCH, "--restitution=0.9"]
TUNED = ["tune", "mujoco", "--restitution=0.9", "--timestep=1e-3", "--plugin"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "h.csv").write_text(HEIGHTS, encoding="utf-8")
    (tmp_path / "good.xml").write_text(MODEL, encoding="utf-8")
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def same(path: str) -> str:
    return path


def linked(path: str) -> str:
    Path("link").symlink_to(path)
    return "link"


def hard_linked(path: str) -> str:
    os.link(path, "hard")
    return "hard"


def spelled(path: str) -> str:
    Path("sub").mkdir()
    return f"sub/../{path}"


INTO_AN_INPUT = [
    (["fit", "h.csv"], "--page", "h.csv"),
    (["fit", "h.csv"], "--write-points", "h.csv"),
    (["measure", *LAUNCH], "--page", "good.xml"),
    (HELD, "--junit", "good.xml"),
    (HELD, "--markdown", "good.xml"),
    (HELD, "--png", "good.xml"),
    (HELD, "--write-baseline", "good.xml"),
    (["tune", "good.xml", "--pair=ball,plate", "--alpha=0.3"], "--write-model", "good.xml"),
    (["tune", "mujoco", "--points=h.csv", "--timestep=1e-3"], "--write-scene", "h.csv"),
]


@pytest.mark.parametrize(
    ("asked", "name", "force"),
    every_pair(INTO_AN_INPUT, [same, linked, hard_linked, spelled], [[], ["--force"]]),
)
def test_an_input_is_never_an_output(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    asked: tuple[list[str], str, str],
    name: Callable[[str], str],
    force: list[str],
) -> None:
    arguments, option, file = asked
    before = Path(file).read_bytes()
    assert cli.run([*arguments, option, name(file), *force]) == 2
    assert f"{option}: " in (told := capsys.readouterr().err)
    assert "is an input; expected another file" in told
    assert Path(file).read_bytes() == before


def test_files_that_an_input_names_are_inputs(folder: Path) -> None:
    (folder / "meshes").mkdir()
    for name in ("part.xml", "meshes/ball.stl"):
        (folder / name).write_text("<mujocoinclude/>", encoding="utf-8")
    (folder / "all.xml").write_text(
        '<mujoco><compiler meshdir="meshes"/><include file="part.xml"/><mesh file="ball.stl"/></mujoco>',
        encoding="utf-8",
    )
    (folder / "checks.toml").write_text("model = 'all.xml'", encoding="utf-8")
    for name in ("part.xml", "meshes/ball.stl", "all.xml"):
        with pytest.raises(UserError, match="is an input"):
            require_outputs({"--page": Path(name)}, ["checks.toml"], force=True)


@pytest.mark.parametrize(
    "option", ["--page", "--write-points", "--junit", "--markdown", "--write-scene"]
)
def test_a_file_of_another_hand_is_replaced_by_force_alone(folder: Path, option: str) -> None:
    notes, content = Path("notes.txt"), "<p>" if option == "--page" else "1"
    with pytest.raises(UserError, match=rf"notes\.txt exists, and {option} did not write it"):
        write_output(notes, content, option)
    assert notes.read_text(encoding="utf-8") == "mine"
    write_output(notes, content, option, force=True)
    write_output(notes, content * 2, option)
    assert notes.read_text(encoding="utf-8").startswith(content * 2)
    other = "--junit" if option != "--junit" else "--page"
    with pytest.raises(UserError, match="did not write it"):
        write_output(notes, "of another kind", other)


def appended(content: bytes) -> bytes:
    return content + b"9.9,0.1\n"


def put_first(content: bytes) -> bytes:
    return b"1 2\n" + content


def with_a_key(content: bytes) -> bytes:
    return json.dumps({**json.loads(content), "mine": 1}, indent=1).encode()


@pytest.mark.parametrize(
    ("option", "content"),
    [
        ("--write-points", "speed [m/s],restitution\n1,0.8\n"),
        ("--page", "<!DOCTYPE html>\n<p>e</p>"),
        ("--markdown", "### 1"),
        ("--write-baseline", json_text({"kind": "hcbench baseline", "checks": {"a": {"e": [1]}}})),
        ("--out", '[{"set":"hcbench-cases-1","runs":{}}]\n'),
    ],
)
def test_a_file_that_was_changed_is_replaced_by_force_alone(
    folder: Path, option: str, content: str
) -> None:
    """Rows appended to what hcbench wrote were lost without a word."""
    path = Path("q")
    changes = [appended, put_first]
    if content.startswith("{"):
        changes.append(with_a_key)
    for change in changes:
        write_output(path, content, option, force=True)
        path.write_bytes(changed := change(path.read_bytes()))
        with pytest.raises(UserError, match=f"q was changed since {option} wrote it"):
            write_output(path, content, option)
        assert path.read_bytes() == changed


def test_a_mark_in_the_midst_of_a_file_is_not_hcbenchs(folder: Path) -> None:
    Path("q").write_text(f"# written by hcbench page\n{'mine ' * 2000}", encoding="utf-8")
    with pytest.raises(UserError, match="--page did not write it"):
        write_output(Path("q"), "<p>", "--page")


def test_json_with_its_mark_has_the_same_content(folder: Path) -> None:
    contents: list[Any] = [{"checks": {"a": {}}}, [{"runs": {}}, {"runs": {"C01": [{}]}}]]
    for content in contents:
        write_output(Path("b.json"), json.dumps(content), "--out", force=True)
        marked = json.loads(Path("b.json").read_bytes())
        last = marked if isinstance(marked, dict) else marked[-1]
        assert last.pop("mark").startswith("written by hcbench out, digest ")
        assert marked == content


@pytest.mark.parametrize("content", [{}, [], [1, 2], [{}], [{"a": 1}, 2], [[{"a": 1}]]])
def test_json_without_a_place_for_a_mark_is_refused(folder: Path, content: Any) -> None:
    with pytest.raises(ValueError, match="no last object with a key"):
        write_output(Path("b.json"), json.dumps(content), "--out")
    assert not Path("b.json").exists()


@pytest.mark.parametrize(
    ("option", "text", "begin"),
    [
        ("--markdown", "[![badge](b.svg)](https://a.org) {x}", "<!-- written"),
        ("--out", "[check]\nspeeds = {low = 1}", "# written"),
    ],
)
def test_a_text_that_begins_with_a_bracket_is_no_json(
    folder: Path, option: str, text: str, begin: str
) -> None:
    for _ in range(2):
        write_output(Path("t"), text, option)
    kept, mark = Path("t").read_text(encoding="utf-8").rsplit("\n", 2)[:2]
    assert (kept, mark.startswith(begin)) == (text, True)


def test_an_archive_with_its_mark_is_an_archive(folder: Path) -> None:
    archive = io.BytesIO()
    np.savez(archive, e=[0.5])
    for _ in range(2):
        write_output(Path("w.npz"), archive.getvalue(), "--out")
    assert np.load("w.npz")["e"] == [0.5]
    with Path("w.npz").open("ab") as file:
        file.write(b"mine")
    with pytest.raises(UserError, match="was changed since"):
        write_output(Path("w.npz"), archive.getvalue(), "--out")


def test_an_empty_file_and_a_pipe_are_written_to(folder: Path) -> None:
    empty, pipe = folder / "empty", folder / "pipe"
    empty.touch()
    require_outputs({"--markdown": empty})
    write_output(empty, "### 1", "--markdown")
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    require_outputs({"--markdown": pipe})
    write_output(pipe, "### 1", "--markdown")
    assert os.read(end, 100).startswith(b"### 1")
    os.close(end)


def test_a_marked_figure_is_still_a_figure(folder: Path) -> None:
    from matplotlib.image import imread

    figure = new_figure(2.0, 1.0)
    for _ in range(2):
        write_output(Path("e.png"), png_bytes(figure), "--png")
    assert np.asarray(imread("e.png")).shape == (110, 220, 4)


def test_commands_replace_what_they_wrote(folder: Path) -> None:
    for _ in range(2):
        assert cli.run(["fit", "h.csv", "--page", "p.html", "--write-points", "p.csv"]) == 0
        assert cli.run([*HELD, "--junit=j.xml", "--markdown=m.md"]) == 0
        assert cli.run(["check", *LAUNCH, "--write-baseline=b.json"]) == 0
        assert cli.run([*TUNED, "--write-scene=s.xml"]) == 0
    again = ["check", *LAUNCH[:2], "--speeds=2", "--points=p.csv", "--max-error=1"]
    assert cli.run(again) == 0, "the mark is a comment"
    assert cli.run(["pairs", "s.xml"]) == 0


def test_two_outputs_are_two_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["fit", "h.csv", "--page=out", "--write-points=./out"]) == 2
    assert "the file of --page too" in capsys.readouterr().err
    assert not Path("out").exists()


def test_a_link_to_itself_is_no_place_for_an_output(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("loop").symlink_to("loop")
    assert cli.run(["fit", "h.csv", "--page=loop"]) == 2
    assert "--page: loop is a link that leads back to itself" in capsys.readouterr().err


def test_a_bad_place_is_refused_before_the_search(folder: Path) -> None:
    with pytest.raises(UserError, match="in a folder that does not exist"):
        require_outputs({"--write-model": Path("no/model.xml")})
    assert (
        cli.run(["tune", "gone.xml", "--pair=ball,plate", "--alpha=0.3", "--write-model=no/m.xml"])
        == 2
    )


@pytest.mark.parametrize("name", [same, linked, hard_linked, spelled])
@pytest.mark.parametrize("file", ["good.xml", "part.xml", "all.xml"])
def test_python_replaces_no_input_either(
    folder: Path, name: Callable[[str], str], file: str
) -> None:
    """`force` replaced the model itself, and a file that it includes."""
    Path("all.xml").write_text(
        MODEL.replace("<worldbody>", '<include file="part.xml"/><worldbody>')
    )
    Path("part.xml").write_text("<mujocoinclude/>")
    model = "good.xml" if file == "good.xml" else "all.xml"
    before = Path(file).read_bytes()
    with pytest.raises(UserError, match="is an input; expected another file"):
        hb.tune_model(model, "ball,plate", restitution=0.5, write_model=name(file), force=True)
    assert Path(file).read_bytes() == before


def test_python_refuses_a_bad_place_before_the_search(folder: Path) -> None:
    """A setting that gained nothing hid it."""
    places = {"no/m.xml": "does not exist", ".": "is a folder", "notes.txt": "did not write it"}
    for place, message in places.items():
        with pytest.raises(UserError, match=f"write_model: .*{message}"):
            hb.tune_model("gone.xml", "ball,plate", restitution=0.9, write_model=place)
    with pytest.raises(UserError, match=r"write_include: m\.xml is the file of write_model too"):
        hb.tune_model(
            "good.xml",
            "ball,plate",
            restitution=0.9,
            write_model="m.xml",
            write_include="m.xml",
            force=True,
        )


@pytest.mark.parametrize(
    "arguments",
    [
        ["measure", *LAUNCH, "--page"],
        ["check", *LAUNCH, "--restitution=0.9", "--junit"],
        ["check", *LAUNCH, "--write-baseline"],
        ["tune", "good.xml", "--pair=ball,plate", "--alpha=0.3", "--write-model"],
        ["fit", "h.csv", "--page"],
    ],
)
@pytest.mark.parametrize("place", ["no/such/file", "."])
def test_a_path_that_cannot_be_a_file_is_the_users_mistake(
    folder: Path, arguments: list[str], place: str
) -> None:
    assert cli.run([*arguments, place]) == 2


@pytest.mark.parametrize("command", ["report", "sweep"])
def test_a_file_in_place_of_a_folder_is_the_users_mistake(
    folder: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run = '[[run]]\nengine = "reference"\nrecipe = "hunt-crossley"\ntimesteps = 1e-3\n'
    Path("mine.toml").write_text(f'scene = "steel-plane"\nalphas = 0.3\nspeeds = 0.2\n{run}')
    for place in ("notes.txt", "notes.txt/below"):
        assert cli.run([command, "mine.toml", "--out", place, "-j", "1"]) == 2
        assert "notes.txt" in capsys.readouterr().err
    Path("index.html").write_text("mine")
    if command == "report":
        assert cli.run([command, "mine.toml", "--out", ".", "-j", "1"]) == 2
    assert Path("index.html").read_text() == "mine"


def test_a_preview_does_not_take_the_place_of_the_whole_report(folder: Path) -> None:
    run = '[[run]]\nengine = "reference"\nrecipe = "hunt-crossley"\ntimesteps = 1e-3\n'
    study = 'scene = "steel-plane"\nalphas = 0.3\nspeeds = 0.2\n'
    (folder / "mine.toml").write_text(study + run, encoding="utf-8")
    assert cli.run(["report", "mine.toml", "--quick", "-j", "1"]) == 0
    assert [path.name for path in (folder / "reports").iterdir()] == ["mine-quick"]


def test_the_option_of_a_file_that_cannot_be_opened_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Click's own words came through for a file that cannot be read."""
    for arguments, message in {
        ("measure", *LAUNCH, "--state=."): "--state: File '.' is a directory; expected a file that",
        (*HELD, "--junit=-"): "--junit: -; expected a file. /dev/stdout is standard output",
    }.items():
        assert cli.run(list(arguments)) == 2
        assert message in capsys.readouterr().err
    assert not Path("-").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="no file can be made in /proc of Linux alone")
def test_a_file_that_the_system_refuses_is_no_mistake_of_the_user() -> None:
    with pytest.raises(OutputError, match=r"^--junit: /proc/x\.xml: "):
        write_output(Path("/proc/x.xml"), "<p>", "--junit")
