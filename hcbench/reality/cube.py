"""The cube tosses of ContactNets: poses of an acrylic cube that is
tossed onto a board, until it rests.

455 of the 570 tosses are shipped, those of i % 5 != 4, as integers; the others stay for a test that
nothing here has seen. The published lengths are too short by 2.04 %: gravity in flight is 9.614
m/s² by them, and the cube at rest stands 51.24 mm high. The published inertia, 0.00081 kg m², is
too small: impulses and trajectories give 0.00107.
"""

import io
import math
import pickle
import pickletools
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.reality.motion import LEAST_FLIGHT, TIMESTEP, Motion, SettingErrors, Tosses, motion
from hcbench.sim.toss import Body, ContactSetting, TossModule
from hcbench.system.errors import UserError
from hcbench.system.files import read_bytes
from hcbench.terms.impact import Floats

# A tensor that PyTorch saved, read without it: its zip archives, and its streams from before 1.6.
#
# Both are a pickle that names a storage, and the storage's bytes. The reader here takes files of
# strangers: it bounds every size before it reads, knows tensors only, and so runs no code and
# reads nothing outside the file. Source of the format: torch/serialization.py of PyTorch.

_KINDS = {"DoubleStorage": "<f8", "FloatStorage": "<f4", "LongStorage": "<i8", "IntStorage": "<i4"}
# A stream begins with a magic number, the protocol and the sizes of types.
_FIRST_PARTS = 3
# Bytes of a file, at most; a toss has 0.1 MB.
_MOST_BYTES = 4 << 20
# Bit of a zip member's flags.
_ENCRYPTED = 1

# Opcodes of a pickled tensor, protocols 2 to 5. Their number and the memo's are bounded before
# a file is unpickled: deeply nested tuples crash Python's unpickler, and a memo's index
# reserves memory up to itself.
_MOST_OPCODES = 1000
_OPCODES = frozenset(
    [
        *("PROTO", "FRAME", "STOP", "MARK", "NONE", "NEWTRUE", "NEWFALSE"),
        *("BININT", "BININT1", "BININT2", "LONG1", "BINUNICODE", "SHORT_BINUNICODE"),
        *("EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3"),
        *("EMPTY_LIST", "APPEND", "APPENDS", "EMPTY_DICT", "SETITEM", "SETITEMS"),
        *("BINPUT", "LONG_BINPUT", "MEMOIZE", "BINGET", "LONG_BINGET"),
        *("GLOBAL", "STACK_GLOBAL", "REDUCE", "BINPERSID"),
    ]
)
_PUTS = ("BINPUT", "LONG_BINPUT")

_Numbers = np.ndarray[Any, np.dtype[Any]]
_Load = Callable[[str, str], Callable[[], _Numbers]]


@dataclass(frozen=True, slots=True)
class _Tensor:
    """A tensor whose numbers may not be read yet, as the file describes it: nothing of it is
    checked before `array`.

    storage: reads its numbers.
    offset, strides: in numbers.
    """

    storage: Callable[[], _Numbers]
    offset: Any
    shape: Any
    strides: Any

    def array(self) -> Floats:
        """Numbers of the tensor, as an array of its shape, float64.

        Raises ValueError for a shape and strides that lead outside the storage.
        """
        numbers = self.storage()
        shape = _whole_numbers(self.shape)
        strides = _whole_numbers(self.strides)
        (offset,) = _whole_numbers((self.offset,))
        has_size = 0 < math.prod(shape) <= len(numbers)
        if len(shape) != len(strides) or not has_size:
            raise ValueError(
                f"shape {shape}, strides {strides} and {len(numbers)} numbers do not agree"
            )
        last = offset
        for count, stride in zip(shape, strides, strict=True):
            last += (count - 1) * stride
        if last >= len(numbers):
            raise ValueError("a tensor that is larger than its storage")
        # In bytes, as NumPy counts strides.
        steps = [stride * numbers.itemsize for stride in strides]
        return np.array(
            np.lib.stride_tricks.as_strided(numbers[offset:], shape, steps), dtype=np.float64
        )


def _whole_numbers(values: Any) -> tuple[int, ...]:
    """Sizes of a tensor; ValueError where they are not numbers of 0 or more."""
    # A pickle may hold anything, True among it.
    if isinstance(values, tuple) and all(type(value) is int and value >= 0 for value in values):
        return values
    raise ValueError("sizes or strides that are not whole numbers of 0 or more")


class _Unpickler(pickle.Unpickler):
    """Unpickler that reads tensors and nothing else.

    load: what stands for a storage's key and type.
    """

    def __init__(self, content: bytes, load: _Load) -> None:
        super().__init__(io.BytesIO(content))
        self.load_storage = load

    def find_class(self, module: str, name: str) -> Any:
        """The few names that a tensor is made of; `module` and `name` are those that the file asks
        for.

        Raises UnpicklingError for any other: it could run code.
        """
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, shape, strides, *_: _Tensor(
                storage, offset, shape, strides
            )
        if module == "torch" and name in _KINDS:
            return _KINDS[name]
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        raise pickle.UnpicklingError(f"{module}.{name} is not a tensor")

    def persistent_load(self, pid: Any) -> Callable[[], _Numbers]:
        """A function that reads a storage, since its numbers follow later in the file.

        pid: what the file names the storage by, whose second and third parts are the kind of its
        numbers and its key.
        Raises UnpicklingError for a kind of numbers that is not known.
        """
        _, kind, key, *_ = pid
        if kind not in _KINDS.values():
            raise pickle.UnpicklingError("a storage of unknown numbers")
        return self.load_storage(str(key), kind)


def read_tensor(path: Path) -> Floats:
    """The tensor in a .pt file, as float64 in the tensor's shape.

    Raises UserError for a file that cannot be read, is larger than _MOST_BYTES, or holds anything
    else than one tensor.
    """
    try:
        content = read_bytes(path, _MOST_BYTES)
        tensor = _from_zip(content) if content[:2] == b"PK" else _from_stream(io.BytesIO(content))
        return tensor.array()
    except Exception as error:
        # Damaged archives and pickles raise errors of any kind.
        reason = getattr(error, "strerror", None) or f"{error}" or type(error).__name__
        raise UserError("data", f"{path}: {reason}", "one tensor that PyTorch saved") from None


def _from_zip(content: bytes) -> _Tensor:
    """Read the newer format: a zip archive with a pickle and a file for each storage.

    A storage is read only when its numbers are needed. Raises any error that a damaged archive
    leads to.
    """
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
        pickled = io.BytesIO(_stored(archive, name))

    def load(key: str, kind: str) -> Callable[[], _Numbers]:
        def numbers() -> _Numbers:
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                stored = _stored(archive, f"{name.removesuffix('data.pkl')}data/{key}")
            return np.frombuffer(stored, kind)

        return numbers

    return _one_tensor(_unpickled(pickled, load))


def _stored(archive: zipfile.ZipFile, name: str) -> bytes:
    """A member that is written as it is, as PyTorch does: it cannot be longer than the file."""
    member = archive.getinfo(name)
    if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & _ENCRYPTED:
        raise ValueError(f"{name} is compressed or encrypted")
    return archive.read(member)


def _from_stream(file: io.BytesIO) -> _Tensor:
    """Read the older format: pickles one after another, then the storages.

    The pickle of a tensor comes before its storage, so `load` returns a function that finds the
    storage later.
    Raises ValueError for a storage larger than the file.
    """
    kinds: dict[str, str] = {}
    storages: dict[str, _Numbers] = {}

    def load(key: str, kind: str) -> Callable[[], _Numbers]:
        kinds[key] = kind
        return lambda: storages[key]

    for _ in range(_FIRST_PARTS):
        _unpickled(file, load)
    tensor = _one_tensor(_unpickled(file, load))
    for key in _unpickled(file, load):
        (count,) = np.frombuffer(file.read(8), "<i8").tolist()
        size = count * np.dtype(kinds[key]).itemsize
        if not 0 <= size <= file.getbuffer().nbytes - file.tell():
            raise ValueError(f"{count} numbers, more than the file has")
        storages[key] = np.frombuffer(file.read(size), kinds[key])
    return tensor


def _unpickled(file: io.BytesIO, load: _Load) -> Any:
    """The next object of a stream of pickles, of which the file then stands at the end.

    load: what stands for a storage's key and type.
    Raises ValueError where no tensor is written like that, and what a damaged pickle leads to.
    """
    begin = file.tell()
    for count, (opcode, argument, _) in enumerate(pickletools.genops(file)):
        if opcode.name not in _OPCODES:
            raise ValueError(f"the opcode {opcode.name} does not belong to a tensor")
        if count >= _MOST_OPCODES or (opcode.name in _PUTS and int(argument or 0) >= _MOST_OPCODES):
            raise ValueError(f"a pickle of more than {_MOST_OPCODES} opcodes")
    return _Unpickler(file.getvalue()[begin : file.tell()], load).load()


def _one_tensor(content: Any) -> _Tensor:
    if not isinstance(content, _Tensor):
        raise ValueError("holds more than one tensor")
    return content


TITLE = "cube tosses"
UNIT = "% of its width"
# m: the published positions are multiples of it.
HALF_WIDTH = 0.0524
MASS = 0.37  # kg
# Time between two frames, s.
PERIOD = 1.0 / 148.0
# Unit of the shipped integers.
DIGIT = 1e-5
# Every fifth toss is of one part: parts to learn from, to judge by, and held out.
PARTS = 5
TRAINING = (0,)
VALIDATION = (1, 2, 3)
HELD_OUT = 4
# Parameters that are known from elsewhere; none.
FIXED: dict[str, float] = {}
SHIPPED = Path(__file__).parent / "data" / "cube_tosses.npz"
FOLDER = "data/tosses_processed"


@dataclass(frozen=True, slots=True)
class Corrections:
    """Corrections of the published data.

    scale: of all lengths.
    inertia: kg m².
    """

    scale: float = 1.0204
    inertia: float = 1.07e-3


CORRECTED = Corrections()
_LENGTHS = {"scale": 1.0}
_INERTIA = {"inertia": 8.1e-4}
VARIANTS = {
    "": CORRECTED,
    "lengths as published": Corrections(**_LENGTHS),
    "inertia as published": Corrections(**_INERTIA),
    "lengths and inertia as published": Corrections(**_LENGTHS, **_INERTIA),
}


def body(corrections: Corrections = CORRECTED) -> Body:
    """The cube."""
    return Body("box", (HALF_WIDTH,) * 3, MASS, (corrections.inertia,) * 3)


def poses(folder: Path | None = None) -> Iterator[tuple[int, Floats]]:
    """(number, poses) of each toss: shape (n, 7), position in half widths and quaternion (w, x, y,
    z), as published.

    folder: of the original repository; None: the shipped tosses.
    Raises UserError for a folder of anything else, and for a file that is not of a toss.
    """
    if folder is None:
        with np.load(SHIPPED) as shipped:
            numbers = shipped["numbers"]
            lengths = shipped["lengths"]
            steps = shipped["differences"]
        for number, of_toss in zip(numbers, np.split(steps, np.cumsum(lengths)[:-1]), strict=True):
            rows: Floats = np.cumsum(of_toss, axis=0, dtype=np.float64) * DIGIT
            yield int(number), rows
        return
    files = {int(p.stem): p for p in (folder / FOLDER).glob("*.pt") if p.stem.isdigit()}
    if not files:
        raise UserError(
            "--data", f"{folder} has no {FOLDER}/N.pt", "the folder of DAIRLab/contact-nets"
        )
    for number, path in sorted(files.items()):
        tensor = read_tensor(path)
        if tensor.ndim != 3 or tensor.shape[0] != 1 or tensor.shape[2] < 7:
            raise UserError(
                "--data", f"{path}: shape {tensor.shape}", "a tensor of shape (1, n, 19)"
            )
        yield number, tensor[0, :, :7]


def cases(parts: tuple[int, ...], folder: Path | None = None, variant: str = "") -> Tosses:
    """Tosses with number % 5 in `parts` that have a flight long enough to know their start, by
    number.

    folder: of the original repository; None: the shipped tosses, without part 4.
    variant: the part of the data that is left as published, one of VARIANTS. Raises UserError for a
    folder of anything else, and for a file that is not of a toss.
    """
    corrections = VARIANTS[variant]
    motions = []
    for number, rows in poses(folder):
        if number % PARTS not in parts:
            continue
        motion = as_motion(number, rows, corrections)
        if motion.flight >= LEAST_FLIGHT:
            motions.append(motion)
    return Tosses(body(corrections), motions)


def outcome(
    module: TossModule, setting: ContactSetting, values: tuple[float, ...], tosses: Tosses
) -> SettingErrors:
    """Errors of an engine's setting on tosses of the cube: mean distances over a toss, in per cent
    of the cube's width, and angles, rad.

    module: `toss` of the engine, which runs in this process.
    values: of the setting's parameters.
    Raises what the engine raises.
    """
    return tosses.outcome(module, setting, values, TIMESTEP)


def as_motion(number: int, rows: Floats, corrections: Corrections = CORRECTED) -> Motion:
    """A toss in metres and seconds, with the plate at z = 0.

    number: of the toss.
    rows: a frame each, (n, 7): position in half widths and quaternion w first, as published.
    corrections: of the published lengths and inertia.
    """
    time = np.arange(len(rows), dtype=np.float64) * PERIOD
    place = rows[:, :3] * HALF_WIDTH * corrections.scale
    length: Floats = np.sqrt((rows[:, 3:] ** 2).sum(axis=1, keepdims=True))
    turn = np.asarray(rows[:, 3:] / length, dtype=np.float64)
    return motion(number, body(corrections), time, place, turn)


def pack(folder: Path, path: Path) -> None:
    """Write the tosses that are shipped, all but the held-out ones, as differences of integers.

    folder: the original repository's tosses. Each number keeps 1e-5 of its unit: half widths, or 1.
    """
    # Of each toss its number, its frames, and the frames themselves, (frames, 7).
    numbers = []
    lengths = []
    differences = []
    for number, rows in poses(folder):
        if number % PARTS == HELD_OUT:
            continue
        digits = np.rint(rows / DIGIT).astype(np.int32)
        numbers.append(number)
        lengths.append(len(digits))
        # Frames are alike: their differences are small numbers, which compress well.
        differences.append(np.diff(digits, axis=0, prepend=0).astype(np.int32))
    np.savez_compressed(
        path,
        numbers=np.array(numbers, dtype=np.int16),
        lengths=np.array(lengths, dtype=np.int16),
        differences=np.concatenate(differences),
    )
