"""Results of long searches that the processes of a run of the suite share: whichever needs one
first finds it, and the others read what it found.
"""

from __future__ import annotations

import hashlib
import os
import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


class FoundOnce:
    """Results by their questions, in memory and in a folder that the processes of one run share.

    folder: new for each run, so that no result outlives the code that found it.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._here: dict[str, Any] = {}

    def __call__(self, question: str, find: Callable[[], Any]) -> Any:
        """The answer to a question: found here before, or by another process, or by `find` now.

        question: its repr, all that the answer depends on. What `find` raises is not kept.
        """
        key = hashlib.sha256(question.encode()).hexdigest()
        if key not in self._here:
            file = self._folder / f"{key}.found"
            if not file.exists():
                # Whole or not at all: another process may look for it now.
                part = self._folder / f"{key}.{os.getpid()}"
                part.write_bytes(pickle.dumps(find()))
                part.replace(file)
            self._here[key] = pickle.loads(file.read_bytes())
        return self._here[key]


def content(source: Any) -> str | None:
    """Name and text of a model that is a text, or a file that refers to no other; None for another."""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return source
    if isinstance(source, str | Path) and Path(source).suffix == ".xml" and Path(source).is_file():
        text = Path(source).read_text(encoding="utf-8")
        return f"{Path(source).name} {text}" if "file=" not in text else None
    return None
