"""The measured data: files of PyTorch without PyTorch, faults of
published numbers, starts of tosses.
"""

from __future__ import annotations

import io
import pickle
import struct
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hcbench.reality import ball, cube, data_sets, ellipse
from hcbench.reality.cube import read_tensor
from hcbench.reality.motion import LEAST_FLIGHT
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats


class DoubleStorage:
    """Stands for PyTorch's own, by name."""


def _rebuild_tensor_v2(*_: object) -> None:
    """Stands for PyTorch's own, by name."""


class _Tensor:
    def __init__(self, numbers: Floats) -> None:
        strides = tuple(s // numbers.itemsize for s in numbers.strides)
        self.arguments: tuple[Any, ...] = (numbers, 0, numbers.shape, strides, False, {})

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild_tensor_v2, self.arguments


class _Pickler(pickle.Pickler):
    def persistent_id(self, obj: object) -> object:
        return (
            ("storage", DoubleStorage, "0", "cpu", obj.size)
            if isinstance(obj, np.ndarray)
            else None
        )


@pytest.fixture
def torch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The names that PyTorch's files have, without PyTorch."""
    for module, thing in (("torch", DoubleStorage), ("torch._utils", _rebuild_tensor_v2)):
        made: Any = ModuleType(module)
        setattr(made, thing.__name__, thing)
        made.Tensor = DoubleStorage  # SciPy asks a module of this name for it
        monkeypatch.setitem(sys.modules, module, made)
        monkeypatch.setattr(thing, "__module__", module)


def _pickled(obj: object) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream, 2).dump(obj)
    return stream.getvalue()


def as_stream(numbers: Floats) -> bytes:
    """Save a tensor like PyTorch before 1.6."""
    parts = [0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}, _Tensor(numbers), ["0"]]
    return b"".join(map(_pickled, parts)) + struct.pack("<q", numbers.size) + numbers.tobytes()


def as_zip(numbers: Floats) -> bytes:
    """Save a tensor like PyTorch since 1.6."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("toss/data.pkl", _pickled(_Tensor(numbers)))
        archive.writestr("toss/data/0", numbers.tobytes())
    return stream.getvalue()


@pytest.mark.usefixtures("torch")
@pytest.mark.parametrize("saved", [as_stream, as_zip])
def test_a_tensor_is_read_without_torch(tmp_path: Path, saved: Callable[[Floats], bytes]) -> None:
    numbers = np.random.default_rng(0).random((1, 7, 19))
    (tmp_path / "0.pt").write_bytes(saved(numbers))
    assert np.array_equal(read_tensor(tmp_path / "0.pt"), numbers)


def test_a_file_that_would_run_code_is_refused(tmp_path: Path) -> None:
    class Harmful:
        def __reduce__(self) -> tuple[Any, ...]:
            return print, ("harm",)

    (tmp_path / "0.pt").write_bytes(
        b"".join(pickle.dumps(x) for x in (1, 2, 3)) + pickle.dumps(Harmful())
    )
    with pytest.raises(UserError, match="is not a tensor"):
        read_tensor(tmp_path / "0.pt")


@pytest.mark.parametrize("content", [b"", b"PK", b"not a pickle", pickle.dumps(1) * 5])
def test_a_file_that_holds_no_tensor_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "0.pt").write_bytes(content)
    with pytest.raises(UserError):
        read_tensor(tmp_path / "0.pt")


def test_the_shipped_tosses_leave_out_the_held_out_fifth() -> None:
    numbers = [number for number, _ in cube.poses()]
    assert len(numbers) == 456
    assert all(number % cube.PARTS != cube.HELD_OUT for number in numbers)
    assert cube.SHIPPED.stat().st_size < 1.7e6


@pytest.mark.usefixtures("torch")
def test_a_folder_of_the_original_repository_is_read(tmp_path: Path) -> None:
    number, rows = next(cube.poses())
    folder = tmp_path / cube.FOLDER
    folder.mkdir(parents=True)
    (folder / "4.pt").write_bytes(as_stream(np.pad(rows, ((0, 0), (0, 12)))[None]))
    (moved,) = cube.cases((4,), tmp_path).motions
    (same,) = (each for each in cube.cases((0,)).motions if each.number == number)
    assert moved.number == 4
    assert np.allclose(moved.position, same.position)


def test_gravity_by_the_published_lengths_is_too_small_by_the_scale() -> None:
    fitted = []
    for each in cube.cases((1,), variant="lengths as published").motions:
        n = each.flight
        if n >= 10:
            fitted.append(2.0 * np.polyfit(each.time[:n], each.position[:n], 2)[0])
    assert np.median(fitted, axis=0)[2] == pytest.approx(-9.614, abs=0.01)
    assert pytest.approx(9.81, abs=0.02) == 9.614 * cube.CORRECTED.scale


def test_455_tosses_have_a_flight_long_enough_to_know_their_start() -> None:
    motions = cube.cases((0, 1, 2, 3)).motions
    assert len(motions) == 455
    assert min(each.flight for each in motions) >= LEAST_FLIGHT
    for each in motions[::20]:
        assert np.linalg.norm(each.position[0] - each.start.position) < 3e-4


def test_the_ellipse_s_tangential_lever_has_the_wrong_sign() -> None:
    """No impulse at the contact, of any direction, explains the drops with the sign as published."""
    drops = ellipse.cases((1,))
    assert np.median(ellipse.free_impulse(drops)) < 0.1
    assert np.median(ellipse.free_impulse(drops.as_published())) > 0.5


def test_of_data_without_a_licence_the_download_is_named() -> None:
    with pytest.raises(UserError, match="spindoe"):
        ball.cases((0,))
    assert ball.SHA256 in data_sets.missing("ball")
    assert data_sets.missing("cube") == ""


def test_an_archive_without_a_clear_bounce_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trajectories.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("tracks/index.csv", "number,x,y,z\n1,0,10,0\n2,0,20,0\n")
    with pytest.raises(UserError, match="no track with a clear bounce"):
        ball.read(path)


def test_another_version_of_downloaded_data_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / "spindoe" / ball.FILE
    file.parent.mkdir(parents=True)
    file.write_bytes(b"another")
    folder = data_sets.find("ball", tmp_path)
    assert folder == tmp_path / "spindoe"
    assert data_sets.differs("ball", folder)


def _as_hostile(arguments: tuple[Any, ...], storage: Floats) -> bytes:
    """A stream whose tensor describes itself by these offset, shape and strides."""
    tensor = _Tensor(storage)
    tensor.arguments = (storage, *arguments, False, {})
    parts = [1, 2, 3, tensor, ["0"]]
    return b"".join(map(_pickled, parts)) + struct.pack("<q", storage.size) + storage.tobytes()


@pytest.mark.usefixtures("torch")
@pytest.mark.parametrize(
    "arguments",
    [
        (0, (10, 2), (-100, 999)),
        (0, (2, 2), (-(10**9), 10**9)),
        (0, (300_000_000,), (0,)),
        (0, (10**11,), (0,)),
        (-1, (2,), (1,)),
        (0, (2, 2), (1,)),
        (0, (True,), (1,)),
        (1, (200,), (1,)),
        (0, (0, 10**30), (1, 1)),
    ],
)
def test_a_tensor_is_read_from_within_its_storage_alone(
    tmp_path: Path, arguments: tuple[Any, ...]
) -> None:
    (tmp_path / "0.pt").write_bytes(_as_hostile(arguments, np.arange(200.0)))
    with pytest.raises(UserError, match=r"storage|do not agree|whole numbers"):
        read_tensor(tmp_path / "0.pt")


@pytest.mark.usefixtures("torch")
def test_an_archive_that_is_compressed_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "0.pt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("toss/data.pkl", _pickled(_Tensor(np.zeros(3))))
        archive.writestr("toss/data/0", bytes(1 << 20))
    with pytest.raises(UserError, match="is compressed or encrypted"):
        read_tensor(tmp_path / "0.pt")


@pytest.mark.parametrize(
    ("pickled", "reason"),
    [
        (b"\x80\x02r\xff\xff\xff\x7f.", "more than 1000 opcodes"),  # a memo of 2^31 places
        (b"\x80\x02)" + b"\x85" * 2000 + b".", "more than 1000 opcodes"),  # tuples within tuples
        (b"\x80\x02}b.", "opcode BUILD"),
        (b"\x80\x05\x96" + struct.pack("<Q", 1 << 40) + b".", "only 1 remain"),
    ],
)
def test_a_pickle_that_no_tensor_has_is_refused_unread(
    tmp_path: Path, pickled: bytes, reason: str
) -> None:
    (tmp_path / "0.pt").write_bytes(pickled)
    with pytest.raises(UserError, match=reason):
        read_tensor(tmp_path / "0.pt")
