"""Ends of commands: output that cannot be written, signals, and mistakes reported under the
option's own name.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from hcbench.cli import run
from hcbench.system.errors import OutputError, UserError
from hcbench.system.files import MANIFEST, atomic_folder, write_bytes

HCBENCH = [sys.executable, "-c", "from hcbench.cli import main; main()"]
LAW = ["law", "--alpha", "0.1", "--speeds", "0.1"]
STUDY = """scene = "steel-plane"
alphas = 0.3
speeds = 0.2
[[run]]
engine = "reference"
recipe = "hunt-crossley"
timesteps = 1e-6
"""
LONG = 300 * "x"


def in_a_shell(
    arguments: list[str], redirection: str, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["sh", "-c", f'"$@" {redirection}', "sh", *HCBENCH, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
    )


# --- standard output ---

needs_full = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="no /dev/full on this system"
)


COMMANDS = [LAW, [*LAW, "--json"], ["--help"], ["engines"]]
UNWRITABLE = [
    (">&-", "closed"),
    (">&- 2>&- <&-", "closed"),
    (">/dev/full", "No space left on device"),
    ("1</dev/null", "Bad file descriptor"),
]
ENDS = [  # each command with each end and each with both ways to buffer
    pytest.param(command, *end, "1" * ((i + j) % 2), marks=[needs_full] if "full" in end[0] else [])
    for i, command in enumerate(COMMANDS)
    for j, end in enumerate(UNWRITABLE)
]


@pytest.mark.parametrize(("arguments", "redirection", "why", "unbuffered"), ENDS)
def test_output_that_cannot_be_written_is_one_line_and_exit_3(
    arguments: list[str], redirection: str, why: str, unbuffered: str
) -> None:
    done = in_a_shell(arguments, redirection, PYTHONUNBUFFERED=unbuffered)
    assert done.returncode == 3
    if "2>&-" in redirection:  # nowhere to say it
        assert done.stdout == done.stderr == ""
    else:
        assert (
            done.stderr == f"hcbench: standard output: {why}; expected one that can be written to\n"
        )


@pytest.mark.parametrize("redirection", ["2>&-", "<&-", "<&- 2>&-", "2>/dev/full"])
def test_other_streams_may_be_closed(redirection: str) -> None:
    assert in_a_shell(LAW, redirection).returncode == 0
    assert in_a_shell(["law"], redirection).returncode == 2


@pytest.mark.parametrize("warnings", [[], ["-W", "error"]])
def test_a_reader_that_goes_away_is_no_failure(warnings: list[str]) -> None:
    many = ["law", "--alpha", "0.1", "--speeds", "1:2:700", "--json"]
    command = [HCBENCH[0], *warnings, *HCBENCH[1:], *many]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0


# --- files and folders ---


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    "arguments",
    [
        ["report", "study.toml", "--out", LONG],
        ["report", "study.toml", "--out", f"new/{LONG}/in"],
        ["report", LONG],
        ["sweep", LONG],
        ["sweep", "study.toml", "--out", LONG],
        ["measure", LONG, "--pair", "a,b"],
        ["paper", "--quick", "--out", LONG],
        ["tune", "mujoco", "--restitution", ".5", "--timestep", "1e-3", "--write-scene", LONG],
        ["tune", "mujoco", "--restitution", ".5", "--timestep", "1e-3", "--scene", LONG],
        ["check", "study.toml", "--junit", LONG],
        ["check", LONG, "--pair", "a,b"],
        ["tune", "mujoco", "--points", LONG, "--timestep", "1e-3"],
    ],
)
def test_a_name_that_no_disk_takes_is_one_line_and_exit_2(
    study: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(arguments) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    (line,) = caught.err.splitlines()
    assert "ile name too long" in line or "pairs like" in line or "was not found" in line
    assert "unexpected" not in line
    assert there(study) == ["study.toml"]


def test_pairs_may_be_longer_than_a_files_name(capsys: pytest.CaptureFixture[str]) -> None:
    pairs = ", ".join(f"{0.1 + 0.01 * i:.2f}:{0.9 - 0.005 * i:.3f}" for i in range(40))
    assert len(pairs) > 300
    asked = [
        "tune",
        "mujoco",
        "--points",
        pairs,
        "--timestep",
        "1e-3",
        "--recipe",
        "impulse",
        "--friction=0",
    ]
    assert run([*asked, "--max-error", "0.5"]) == 0


@pytest.mark.parametrize(
    ("arguments", "option"),
    [
        (["report", "study.toml", "--out", ""], "--out"),
        (["sweep", "study.toml", "--out", ""], "--out"),
        (["report", ""], "study"),
        (["measure", ""], "models"),
        (["paper", "--out", ""], "--out"),
        (
            ["tune", "mujoco", "--alpha", "1", "--timestep", "1e-3", "--write-scene", ""],
            "--write-scene",
        ),
        (["measure", "m.xml", "--page", ""], "--page"),
        (["check", "m.xml", "--junit", ""], "--junit"),
        (["check", "m.xml", "--baseline", ""], "--baseline"),
    ],
)
def test_an_empty_path_is_not_the_working_directory(
    study: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], option: str
) -> None:
    assert run(arguments) == 2
    assert capsys.readouterr().err.startswith(f"hcbench: {option}: an empty path; expected a path")
    assert there(study) == ["study.toml"]


def test_an_output_is_written_through_what_is_no_file(tmp_path: Path) -> None:
    import threading

    pipe, link, file = tmp_path / "pipe", tmp_path / "link", tmp_path / "file"
    os.mkfifo(pipe)
    got: list[bytes] = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_bytes(pipe, b"through")
    reader.join()
    assert got == [b"through"]
    assert pipe.is_fifo()
    link.symlink_to("/dev/null")
    write_bytes(link, b"gone")
    assert link.readlink() == Path("/dev/null")
    assert Path("/dev/null").is_char_device()
    link.unlink()
    link.symlink_to(file)
    write_bytes(link, b"kept")
    assert link.is_symlink()
    assert file.read_bytes() == b"kept"


def test_an_output_that_cannot_be_written_is_refused_and_left(tmp_path: Path) -> None:
    socket_path, link = tmp_path / "s", tmp_path / "full"
    link.symlink_to("/dev/full")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(socket_path))
        for path, kind in ((socket_path, OutputError), (link, OutputError), (tmp_path, UserError)):
            with pytest.raises(kind, match="output"):
                write_bytes(path, b"x")
    assert socket_path.is_socket()
    assert link.readlink() == Path("/dev/full")


def test_standard_output_in_a_file_keeps_both(tmp_path: Path) -> None:
    file, link = tmp_path / "out", tmp_path / "link"
    link.symlink_to("/dev/stdout")
    code = "import pathlib, hcbench.system.files as files; "
    code += f"files.write_bytes(pathlib.Path({str(link)!r}), b'1 ')"
    with file.open("wb") as stream:
        subprocess.run([sys.executable, "-c", f"{code}; print(2)"], stdout=stream, check=True)
    assert file.read_bytes().split() == [b"1", b"2"]
    assert link.readlink() == Path("/dev/stdout")


def fill(folder: Path, files: dict[str, str]) -> None:
    with atomic_folder(folder) as scratch:
        for name, text in files.items():
            (scratch / name).parent.mkdir(exist_ok=True)
            (scratch / name).write_text(text, encoding="utf-8")


def there(folder: Path) -> list[str]:
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def test_what_an_earlier_report_wrote_and_the_new_one_has_not_goes(tmp_path: Path) -> None:
    fill(
        tmp_path,
        {"index.html": "1", "figures/old.svg": "o", "figures/both.svg": "b", "gone/a.png": "a"},
    )
    (tmp_path / "figures" / "mine.svg").write_text("of someone else", encoding="utf-8")
    fill(tmp_path, {"index.html": "2", "figures/both.svg": "c"})
    assert there(tmp_path) == ["figures/both.svg", "figures/mine.svg", MANIFEST, "index.html"]
    assert (tmp_path / "index.html").read_text(encoding="utf-8") == "2"
    assert not (tmp_path / "gone").exists(), "no empty folders"


def test_a_file_changed_since_is_its_owners(tmp_path: Path) -> None:
    fill(tmp_path, {"a.csv": "1", "b.csv": "1"})
    (tmp_path / "a.csv").write_text("edited", encoding="utf-8")
    fill(tmp_path, {"c.csv": "2"})
    assert there(tmp_path) == ["a.csv", "c.csv", MANIFEST]


@pytest.mark.parametrize(
    "manifest",
    [
        "not JSON",
        "[]",
        "null",
        '{"files": {"mine.txt": "DIGEST"}}',
        '{"kind": "hcbench files", "files": ["mine.txt"]}',
        '{"kind": "hcbench files", "files": {"../mine.txt": "DIGEST"}}',
        '{"kind": "hcbench files", "files": {"FOLDER/mine.txt": "DIGEST"}}',
    ],
)
def test_a_list_that_is_not_ours_removes_nothing(tmp_path: Path, manifest: str) -> None:
    import hashlib

    folder, digest = tmp_path / "out", hashlib.sha256(b"precious").hexdigest()
    folder.mkdir()
    for place in (tmp_path, folder):
        (place / "mine.txt").write_bytes(b"precious")
    text = manifest.replace("DIGEST", digest).replace("FOLDER", str(tmp_path))
    (folder / MANIFEST).write_text(text, encoding="utf-8")
    fill(folder, {"index.html": "1"})
    assert there(tmp_path) == ["mine.txt", f"out/{MANIFEST}", "out/index.html", "out/mine.txt"]


@pytest.mark.parametrize("name", ["index.html", "figures/a.svg", "figures"])
def test_a_file_of_someone_else_is_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("precious", encoding="utf-8")
    with pytest.raises(UserError, match="not of an earlier report"):
        fill(tmp_path, {"index.html": "1", "figures/a.svg": "1"})
    assert (tmp_path / name).read_text(encoding="utf-8") == "precious"
    assert there(tmp_path) == [name]


def test_the_file_in_the_way_is_named_before_anything_runs(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("precious", encoding="utf-8")
    with pytest.raises(UserError, match=r"index\.html"), atomic_folder(tmp_path, "index.html"):
        raise AssertionError("has begun")


@pytest.mark.parametrize("name", ["figures", "index.html", MANIFEST])
def test_no_link_leads_out_of_the_folder(tmp_path: Path, name: str) -> None:
    folder, outside = tmp_path / "out", tmp_path / "outside"
    fill(folder, {"figures/a.svg": "1", "index.html": "1"})
    (folder / name).rename(outside)
    (folder / name).symlink_to(outside)
    before = [p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()]
    with pytest.raises(UserError, match=name):
        fill(folder, {"figures/a.svg": "2", "index.html": "2"})
    assert [p.read_bytes() for p in sorted(tmp_path.rglob("*")) if p.is_file()] == before


def test_an_edited_list_deletes_nothing_behind_a_link_nor_of_another_kind(tmp_path: Path) -> None:
    folder, outside = tmp_path / "out", tmp_path / "outside"
    outside.mkdir()
    fill(folder, {"index.html": "1", "figures/a.svg": "1"})
    for path in (outside / "a.svg", folder / "notes.txt"):
        path.write_text("1", encoding="utf-8")
    (folder / "others").symlink_to(outside)
    content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    digest = content["files"]["index.html"]
    content["files"] |= {"others/a.svg": digest, "notes.txt": digest}
    (folder / MANIFEST).write_text(json.dumps(content), encoding="utf-8")
    fill(folder, {"index.html": "2"})
    assert there(tmp_path) == [
        f"out/{MANIFEST}",
        "out/index.html",
        "out/notes.txt",
        "outside/a.svg",
    ]


def test_what_a_killed_report_left_goes_and_what_runs_stays(tmp_path: Path) -> None:
    code = "import os, pathlib, hcbench.system.files as f\n"
    code += f"with f.atomic_folder(pathlib.Path({str(tmp_path)!r})): os.kill(os.getpid(), 9)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == -9
    (left,) = tmp_path.iterdir()
    with atomic_folder(tmp_path) as running:
        assert not left.exists()
        with pytest.raises(OutputError, match="another command is writing"):
            fill(tmp_path, {"index.html": "1"})
        assert running.is_dir()
    assert not list(tmp_path.glob(".hcbench-*"))


def test_a_failed_filling_removes_nothing(tmp_path: Path) -> None:
    fill(tmp_path, {"old.csv": "1"})
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path) as scratch:
        (scratch / "new.csv").write_text("2", encoding="utf-8")
        raise KeyboardInterrupt
    assert there(tmp_path) == [MANIFEST, "old.csv"]


# --- options by name ---

TUNE = ["tune", "mujoco", "--timestep", "1e-3"]
MEASURE = [
    "measure",
    str(Path(__file__).parents[2] / "examples" / "good.xml"),
    "--pair",
    "ball,plate",
]
CHECK = ["check", *MEASURE[1:]]
TUNED = ["tune", *MEASURE[1:], "--alpha=0.3"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["law", "--alpha=-0.1", "--speeds=1"], "--alpha: -0.1; expected 0 s/m or more"),
        ([*LAW, "--stiffness=-1"], "--stiffness: -1; expected a value above 0"),
        ([*LAW, "--exponent=.5", "--stiffness=1"], "--exponent: 0.5; expected 1 ... 5"),
        ([*LAW, "--mass=-1"], "--mass: -1 kg; expected a value above 0"),
        ([*TUNE, "--alpha=-1"], "--alpha: -1; expected 0 s/m or more"),
        ([*TUNE, "--alpha=1", "--stiffness=-1"], "--stiffness: -1; expected a value above 0"),
        ([*TUNE, "--restitution=2"], "--restitution: 2; expected 0 ... 1"),
        ([*TUNE, "--points=1:2"], "--points: 2; expected 0 ... 1"),
        ([*TUNE, "--points=-1:0.5"], "--points: -1 m/s; expected a value above 0"),
        ([*TUNE, "--alpha=.1", "--max-error=-1"], "--max-error: -1; expected 0 ... 1"),
        (
            [*TUNE, "--alpha=.1", "--max-error=nan"],
            "--max-error: 'nan' is not a number; expected 0 ... 1",
        ),
        (
            [*TUNE, "--alpha=.1", "--recipe=magic"],
            "--recipe: 'magic' for 'mujoco'; expected one of: auto",
        ),
        (
            [*TUNE, "--alpha=.1", "--integrator=magic"],
            "--integrator: 'magic' for 'mujoco'; expected one of: Euler",
        ),
        ([*TUNE, "--alpha=.1", "--scene=nowhere"], "--scene: 'nowhere' was not found"),
        ([*TUNE, "--alpha=.1", "--pair=a"], "--pair: 'a'; expected two names"),
        ([*TUNE, "--alpha=.1", "--from=above"], "--from: given with the engine 'mujoco'"),
        (
            [*TUNE, "--alpha=.1", "--write-model=a.xml"],
            "--write-model: given with the engine 'mujoco'",
        ),
        ([*TUNED, "--scene=steel-cup"], "--scene: given with the model"),
        ([*TUNED, "--recipe=impulse"], "--recipe: given with the model"),
        ([*TUNED, "--friction=0"], "--friction: given with the model"),
        ([*TUNED, "--write-scene=a.xml"], "--write-scene: given with the model"),
        ([*TUNED, "--max-error=7"], "--max-error: 7; expected 0 ... 1"),
        (
            [*TUNED, "--pair=plate,ball"],
            "--pair: ball,plate and plate,ball; expected each pair once",
        ),
        ([*MEASURE, "--alpha=-1"], "--alpha: -1.0 s/m; expected 0 s/m or more"),
        ([*MEASURE, "--restitution=-1"], "--restitution: -1; expected 0 or more"),
        ([*MEASURE, "--speeds=-1"], "--speeds: -1 m/s; expected a value above 0"),
        ([*MEASURE, "--timestep=-1"], "--timestep: -1 s; expected a value above 0"),
        ([*MEASURE, "--height=-1"], "--height: -1 m; expected a value above 0"),
        ([*MEASURE, "--limit=-1"], "--limit: -1 s; expected above 0 s"),
        ([*MEASURE, "--key=nope"], "--key: 'nope'; expected one of"),
        ([*CHECK, "--alpha=-1"], "--alpha: -1.0 s/m; expected 0 s/m or more"),
        ([*CHECK, "--restitution=2"], "--restitution: 2; expected 0 ... 1"),
        ([*CHECK, "--restitution=1", "--max-error=-1"], "--max-error: -1; expected 0 ... 1"),
        ([*CHECK, "--restitution=1", "--limit=-1"], "--limit: -1 s; expected above 0 s"),
        (["convert", "--alpha=-1"], "--alpha: -1; expected 0 s/m or more"),
        (["convert", "--drake=-1"], "--drake: -1; expected 0 s/m or more"),
        (
            ["convert", "--alpha=1", "--speed=1", "--contact-time=-1"],
            "--contact-time: -1; expected a value above 0",
        ),
    ],
)
def test_a_mistake_in_a_value_names_its_option(
    capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert run(arguments) == 2
    caught = capsys.readouterr()
    assert caught.out == ""
    (line,) = caught.err.splitlines()
    assert line.startswith(f"hcbench: {says}")


def test_a_folder_within_a_scratch_folder_is_written_without_waiting_for_itself(
    tmp_path: Path,
) -> None:
    with atomic_folder(tmp_path / "out") as outer, atomic_folder(outer) as inner:
        (inner / "page.html").write_text("page")
    assert (tmp_path / "out" / "page.html").read_text() == "page"


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps this limit")
def test_too_little_memory_for_numpy_is_said_before_it_is_imported() -> None:
    short = subprocess.run(
        ["sh", "-c", 'ulimit -v 200000; exec "$@"', "sh", sys.executable, "-m", "hcbench", *LAW],
        capture_output=True,
        text=True,
        check=False,
    )
    assert short.returncode == 3
    (line,) = short.stderr.splitlines()
    assert line.startswith("hcbench: memory: limited to 195 MB of addresses; expected 480 MB")
