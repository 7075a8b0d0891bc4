"""Tensors from files that PyTorch saved, without PyTorch: its zip archives, and its streams from before 1.6.

Both are a pickle that names storages, and the storages' bytes. The reader here rebuilds tensors and refuses
every other class, so that no file can run code. Source of the format: torch/serialization.py of PyTorch.
"""

import io
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from hcbench._files import read_bytes
from hcbench.errors import UserError
from hcbench.impact import Floats

_KINDS = {"DoubleStorage": "<f8", "FloatStorage": "<f4", "LongStorage": "<i8", "IntStorage": "<i4"}
_FIRST_PARTS = 3  # of a stream: magic number, protocol, sizes of types


@dataclass(frozen=True, slots=True)
class _Tensor:
    """A tensor whose numbers may not be read yet. strides: in numbers."""

    storage: Callable[[], Any]
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]

    def array(self) -> Floats:
        numbers = self.storage()
        last = self.offset + sum((n - 1) * s for n, s in zip(self.shape, self.strides, strict=True))
        if not 0 <= self.offset <= last < len(numbers):
            raise ValueError("a tensor that is larger than its storage")
        strides = [s * numbers.itemsize for s in self.strides]
        view = np.lib.stride_tricks.as_strided(numbers[self.offset :], self.shape, strides)
        return np.array(view, dtype=np.float64)


class _Unpickler(pickle.Unpickler):
    """Knows tensors and nothing else. load: what stands for a storage's key and type."""

    def __init__(self, file: Any, load: Callable[[str, str], Callable[[], Any]]) -> None:
        super().__init__(file)
        self.load_storage = load

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, shape, strides, *_: _Tensor(storage, offset, shape, strides)
        if module == "torch" and name in _KINDS:
            return _KINDS[name]
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        raise pickle.UnpicklingError(f"{module}.{name} is no tensor")

    def persistent_load(self, pid: Any) -> Callable[[], Any]:
        _, kind, key, *_ = pid
        return self.load_storage(str(key), str(kind))


def read_tensor(path: Path) -> Floats:
    """The tensor in a .pt file. UserError for what cannot be read or holds anything else."""
    try:
        content = read_bytes(path)
        tensor = _from_zip(content) if content[:2] == b"PK" else _from_stream(io.BytesIO(content))
        return tensor.array()
    except (OSError, ValueError, LookupError, TypeError, AttributeError, EOFError) as error:
        raise UserError("data", f"{path}: {error}", "one tensor that PyTorch saved") from None
    except (pickle.UnpicklingError, zipfile.BadZipFile) as error:
        raise UserError("data", f"{path}: {error}", "one tensor that PyTorch saved") from None


def _from_zip(content: bytes) -> _Tensor:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
        root = name.removesuffix("data.pkl")
        parts = {n: archive.read(n) for n in archive.namelist() if n.startswith(f"{root}data/")}
        pickled = archive.read(name)

    def load(key: str, kind: str) -> Callable[[], Any]:
        return lambda: np.frombuffer(parts[f"{root}data/{key}"], kind)

    return _one_tensor(_Unpickler(io.BytesIO(pickled), load).load())


def _from_stream(file: BinaryIO) -> _Tensor:
    kinds: dict[str, str] = {}
    storages: dict[str, Any] = {}

    def load(key: str, kind: str) -> Callable[[], Any]:
        kinds[key] = kind
        return lambda: storages[key]

    for _ in range(_FIRST_PARTS):
        _Unpickler(file, load).load()
    tensor = _one_tensor(_Unpickler(file, load).load())
    for key in _Unpickler(file, load).load():
        (count,) = np.frombuffer(file.read(8), "<i8")
        storages[key] = np.frombuffer(file.read(int(count) * np.dtype(kinds[key]).itemsize), kinds[key])
    return tensor


def _one_tensor(content: Any) -> _Tensor:
    if not isinstance(content, _Tensor):
        raise ValueError("holds more than one tensor")
    return content
