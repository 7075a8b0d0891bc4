"""Mutated files for every reader, in a worker process with a limit of
memory and of time for each file.
"""

from __future__ import annotations

import importlib
import io
import json
import multiprocessing
import random
import re
import resource
import shutil
import sys
import types
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[3]
MEMORY = 1 << 30  # bytes that a file may take above what the engines' libraries have
LONGEST_S = 60.0
_NUMBERS = (
    b"0", b"-1", b"1e-320", b"1e308", b"1e999", b"nan", b"inf", b"-0", b"99999999999999999999", b"0x10", b"1e9",
    b'""', b"null", b"true", b"[]", b"{}", b"'", b"\xff", b"\0", b"\n", b"%s", b"1:2:1e12", b"[" * 3000,
)  # fmt: skip
_TOKEN = re.compile(rb"[-+]?[\d.]+(?:e[-+]?\d+)?|\w+|\"[^\"\n]*\"|<[^<>]*>")


@dataclass(frozen=True)
class Reader:
    """Reader of a file, the suffixes of its files, and sound files to begin with."""

    read: Callable[[Path], Any]
    suffix: str
    seeds: tuple[bytes, ...]


def readers(folder: Path) -> dict[str, Reader]:
    """Every reader of a stranger's file, by the kind of file."""
    import hcbench as hb
    from hcbench.benchmark.study import load_study
    from hcbench.cases.score import read_scores
    from hcbench.checking.baseline import read_baseline, read_pairs
    from hcbench.fitting.recording import read_recording
    from hcbench.measuring.request import read_state
    from hcbench.reality.cube import read_tensor
    from hcbench.terms.scene import read_scene

    def scene(path: Path) -> Any:
        made = folder / "scene"
        shutil.copytree(ROOT / "scenes" / "steel-plane", made, dirs_exist_ok=True)
        (made / "scene.toml").write_bytes(path.read_bytes())
        return read_scene(made)

    for urdf in (ROOT / "scenes" / "steel-plane").glob("*.urdf"):
        (folder / urdf.name).write_bytes(urdf.read_bytes())
    plate = str(folder / "plate.urdf")
    models = _files("examples/*.xml", "examples/outside/*.xml")
    urdfs = _files("scenes/*/*.urdf", "examples/outside/*.urdf")
    state = {"qpos": [0, 0, 1, 1, 0, 0, 0], "ball": [0.0, 0, 1]}
    return {
        "pt": Reader(read_tensor, ".pt", tuple(_tensors())),
        "mjcf": Reader(hb.pairs, ".xml", models),
        "mjz": Reader(hb.pairs, ".mjz", tuple(_zip({"model.xml": model}) for model in models)),
        "mjb": Reader(hb.pairs, ".mjb", (_binary(models[1]),)),
        "urdf": Reader(
            lambda path: hb.pairs([str(path), plate], engine="pybullet"), ".urdf", urdfs
        ),
        "table": Reader(hb.fit, ".csv", _TABLES),
        "pairs": Reader(read_pairs, ".csv", (_TABLES[-1],)),
        "wav": Reader(
            lambda path: read_recording(path, lambda _: 1.0), ".wav", tuple(_sounds("wav"))
        ),
        "m4a": Reader(
            lambda path: read_recording(path, lambda _: 1.0), ".m4a", tuple(_sounds("m4a"))
        ),
        "study": Reader(load_study, ".toml", _files("examples/study.toml", "reports/*/study.toml")),
        "scene": Reader(scene, ".toml", _files("scenes/*/scene.toml")),
        "baseline": Reader(lambda path: read_baseline(path, ""), ".json", (_baseline(folder),)),
        "cases": Reader(lambda path: read_scores(path, [_CASE]), ".json", (_results(),)),
        "state in JSON": Reader(read_state, ".json", (json.dumps(state).encode(),)),
        "npz": Reader(read_state, ".npz", (_npz(np.savez), _npz(np.savez_compressed))),
    }


READERS = (
    "pt", "mjcf", "mjz", "mjb", "urdf", "table", "pairs", "wav", "m4a", "study", "scene", "baseline", "cases",
    "state in JSON", "npz",
)  # fmt: skip
_CASE = "C07"
_TABLES = (
    b"height [cm]\n30\n22\n17\n13.5\n11\n9.2\n7.8\n",
    b"time [s]\n0\n0.443\n0.842\n1.201\n1.524\n1.815\n",
    b"time [s],force [N]\n" + b"".join(b"%g,%g\n" % (i * 1e-5, max(0.0, 9 - (i - 20) ** 2)) for i in range(60)),
    b"bounce,Height (cm),\n,Trial 1,Trial 2\n1,61,60.2\n2,39.1,38.2\n3,25.5,25\n4,17,16.5\n",
    b"<table><tr><th colspan=2>t / 10^-2 s</th></tr><tr><td>1</td><td>0</td></tr><tr><td>2</td><td>44.3</td></tr>"
    b"<tr><td>3</td><td>84.2</td></tr><tr><td>4</td><td>120.1</td></tr><tr><td>5</td><td>152.4</td></tr></table>",
    b'<runs unit="cm/s"><run n="1"><vor>310</vor><nach>250</nach></run>\n<run n="2"><vor>250</vor><nach>205'
    b'</nach></run>\n<run n="3"><vor>205</vor><nach>170</nach></run></runs>',
    b'{"nbformat": 4, "cells": [{"source": ["# 48 kHz"]}, {"source": "onsets  # sample index", "outputs": [{"text":'
    b' ["[35089 44263 51140 56651 61273 65232]"]}]}]}',
    b"08:15:02.113 bounce 1: t = 3719 ms\n08:15:02.6 bounce 2: t = 4161 ms\n08:15:03 bounce 3: t = 4560 ms\n"
    b"08:15:03.4 bounce 4: t = 4919 ms\n",
    b"# gravity: (0, 0, -1.62), camera tilt 3 deg\ndrops:\n  - drop: 1.0 m\n    rebound: 61 cm\n  - drop: 0.8 m\n"
    b"    rebound: 50 cm\n  - drop: 0.6 m\n    rebound: 38 cm\n",
    b"INSERT INTO t (n, height_mm) VALUES (1, 610), (2, 391), (3, 255), (4, 170);\n",
    b"speed [m/s],restitution\n0.1,0.95\n0.3,0.9\n0.5,0.86\n0.8,0.8\n1.1,0.75\n",
)  # fmt: skip


def _files(*patterns: str) -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern)))


def _tensors() -> Iterator[bytes]:
    sys.path.insert(0, str(ROOT / "tests" / "reality"))
    data = importlib.import_module("test_data")

    named = (("torch", data.DoubleStorage), ("torch._utils", data._rebuild_tensor_v2))
    for module, thing in named:
        made: Any = types.ModuleType(module)
        setattr(made, thing.__name__, thing)
        thing.__module__ = module
        sys.modules[module] = made
    numbers = np.random.default_rng(0).random((1, 7, 19))
    yield from (data.as_stream(numbers), data.as_zip(numbers))
    sizes = (0, 1, 7, -1, 10**9, -(2**63), 2**62, 10**30, True, None, 1.5)
    chance = random.Random(0)
    for _ in range(60):
        shape, strides = (tuple(chance.choices(sizes, k=chance.randrange(4))) for _ in range(2))
        yield data._as_hostile((chance.choice(sizes), shape, strides), np.arange(200.0))
    for module, _ in named:  # SciPy asks a module of this name for its tensors
        del sys.modules[module]


def _zip(members: Mapping[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return stream.getvalue()


def _binary(model: bytes) -> bytes:
    import mujoco

    made = mujoco.MjModel.from_xml_string(model.decode())
    buffer = np.empty(mujoco.mj_sizeModel(made), np.uint8)
    mujoco.mj_saveModel(made, None, buffer)
    return buffer.tobytes()


def _npz(save: Callable[..., None]) -> bytes:
    stream = io.BytesIO()
    save(stream, qpos=np.array([0.0, 0, 1, 1, 0, 0, 0]), ball=np.array([0.0, 0, 1]))
    return stream.getvalue()


def _sounds(kind: str) -> Iterator[bytes]:
    import wave

    sound = (ROOT / "examples" / "recording" / "drop.wav").read_bytes()
    with wave.open(io.BytesIO(sound)) as source:
        rate, short = source.getframerate(), source.readframes(20_000)
        layout = source.getparams()
    if kind == "wav":
        stream = io.BytesIO()
        with wave.open(stream, "wb") as made:
            made.setparams(layout)
            made.writeframes(short)
        yield stream.getvalue()
        return
    import av

    stream = io.BytesIO()
    with av.open(stream, "w", format="mp4") as container:
        track: Any = container.add_stream("aac", rate=rate)
        samples = np.frombuffer(short, np.int16).reshape(1, -1)
        frame = av.AudioFrame.from_ndarray(samples[:, ::1].copy(), format="s16", layout="mono")
        frame.sample_rate = rate
        container.mux([*track.encode(frame), *track.encode(None)])
    yield stream.getvalue()


def _baseline(folder: Path) -> bytes:
    import hcbench as hb
    from hcbench.checking.baseline import write_baseline

    path = folder / "baseline.json"
    model = str(ROOT / "examples" / "good.xml")
    measured = hb.measure(
        model, "ball,plate", speeds="0.3, 0.5 m/s", phases=1, rest=False, diagnose=False
    )
    write_baseline(path, {"": measured}, force=True)
    return path.read_bytes()


def _results() -> bytes:
    from hcbench.cases.score import run_engines

    return json.dumps(run_engines(["mujoco"], only=[_CASE])).encode()


def mutated(seed: bytes, chance: random.Random) -> bytes:
    """A file with a few changes of bytes, of words, or, in a zip, of a
    member with its checksum made again.
    """
    if seed[:2] == b"PK" and chance.random() < 0.6:
        with zipfile.ZipFile(io.BytesIO(seed)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = chance.choice(list(members))
        members[name] = mutated(members[name], chance)
        return _zip(members)
    data = bytearray(seed)
    for _ in range(chance.choice((1, 1, 2, 4, 16))):
        (_change_word if chance.random() < 0.5 else _change_bytes)(data, chance)
    return bytes(data)


def _change_word(data: bytearray, chance: random.Random) -> None:
    start = chance.randrange(max(1, len(data) - 4000)) if len(data) > 4000 else 0
    words = [match.span() for match in _TOKEN.finditer(data, start, start + 4000)]
    if not words:
        return
    (begin, end), (other, stop) = chance.choice(words), chance.choice(words)
    kept = bytes(data[begin:end])
    data[begin:end] = chance.choice(
        (chance.choice(_NUMBERS), b"", kept + b" " + kept, bytes(data[other:stop]))
    )


def _change_bytes(data: bytearray, chance: random.Random) -> None:
    head = min(len(data), 400) if chance.random() < 0.6 else len(data)
    at = chance.randrange(head) if head else 0
    some = bytes(
        chance.choice((0, 255, 127, 128, chance.randrange(256)))
        for _ in range(chance.randrange(1, 9))
    )
    length = chance.choice((1, 1, 4, 8, 40))
    match chance.randrange(5):
        case 0:
            data[at : at + len(some)] = some
        case 1:
            data[at:at] = some
        case 2:
            del data[at : at + length]
        case 3:
            data[at:at] = bytes(data[at : at + length]) * chance.choice((1, 3, 300))
        case _:
            del data[at + chance.randrange(1, 4000) :]


def _verdict(reader: Reader, path: Path) -> str:
    from hcbench.system.errors import HcbenchError

    try:
        reader.read(path)
    except HcbenchError as error:
        if "\n" in str(error):
            return f"lines: {str(error)[:200]!r}"
        return "refused"
    except BaseException as error:
        where = error.__traceback__
        while where is not None and where.tb_next is not None:
            where = where.tb_next
        place = f"{where.tb_frame.f_code.co_filename}:{where.tb_lineno}" if where else ""
        return f"unnamed: {type(error).__name__} {str(error)[:160]!r} {place}"
    return "read"


def _work(name: str, numbers: range, folder: Path, answers: Connection) -> None:
    warnings.simplefilter("ignore")
    reader = readers(folder)[name]
    path = folder / f"file{reader.suffix}"
    held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (held + MEMORY, held + MEMORY))
    for number in numbers:
        path.write_bytes(file_of(reader, name, number))
        answers.send((number, _verdict(reader, path)))


def file_of(reader: Reader, name: str, number: int) -> bytes:
    """The file of a number."""
    chance = random.Random(f"{name} {number}")
    seed = chance.choice(reader.seeds)
    return seed if number < len(reader.seeds) else mutated(seed, chance)


def mutate(name: str, numbers: range, folder: Path) -> list[str]:
    """Let a reader read its mutated files. Prints the counts, and returns what went wrong."""
    counts, wrong = Counter[str](), []
    context = multiprocessing.get_context("spawn")
    left = numbers
    while left:
        answers, theirs = context.Pipe(duplex=False)
        worker = context.Process(target=_work, args=(name, left, folder, theirs), daemon=True)
        worker.start()
        theirs.close()
        verdict = ""
        try:
            while left and answers.poll(LONGEST_S):
                number, verdict = answers.recv()
                left = range(number + 1, numbers.stop)
                kind = verdict.partition(":")[0]
                counts[kind] += 1
                if kind not in ("read", "refused"):
                    wrong.append(f"{name} {number}: {verdict}")
                    print(wrong[-1], flush=True)
            ended = "hang" if left else ""
        except EOFError:
            ended = "crash"
        if ended == "hang":
            worker.kill()
        worker.join()
        if ended:
            counts[ended] += 1
            wrong.append(f"{name} {left.start}: {ended}, exit code {worker.exitcode}")
            print(wrong[-1], flush=True)
            left = range(left.start + 1, numbers.stop)
    print(f"{name}: {len(numbers)} files, {dict(sorted(counts.items()))}", flush=True)
    return wrong
