"""What a study found: tidy tables, the settings used, versions and provenance. Written whole or not at all.

restitution.csv  one row an impact           loops.csv     one row a sample of a kept loop
scores.csv       one row a setting, α, step  summary.json  schema, study, settings, versions
hcbench-files.json: what of a folder was written, so that the next time clears up after this one.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import shutil
import signal
import tempfile
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.compare import CLAIMS
from hcbench.errors import HcbenchError, OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import pandas as pd

SCHEMA = 1
MANIFEST = "hcbench-files.json"
_FILLED = "hcbench files"
RUN_KEY = ["scene", "engine", "setting", "alpha_s_per_m", "timestep_s"]  # one setting at one step for one α

IMPACT_COLUMNS = [
    *RUN_KEY,
    "speed_m_per_s",
    "phase",
    "status",
    "reason",
    "speed_in_m_per_s",
    "speed_out_m_per_s",
    "restitution",
    "restitution_law",
    "restitution_linear",
    "duration_s",
    "penetration_max_m",
    "force_max_n",
    "samples",
]
TABLES = ("restitution", "loops", "scores", "trains")
TRAIN_COLUMNS = [*RUN_KEY, "bounce", "height_m", "height_law_m"]
LOOP_COLUMNS = [*RUN_KEY, "speed_m_per_s", "phase", "time_s", "penetration_m", "rate_m_per_s", "force_n"]


def _no_trains() -> pd.DataFrame:
    import pandas as pd  # here, as sweeps and the processes that fly need none of it

    return pd.DataFrame(columns=TRAIN_COLUMNS)


@dataclass(frozen=True, slots=True)
class Results:
    """Everything a report or a check reads.

    study: the study file's content with its defaults filled in. settings: one record a run key.
    versions: package -> version. impacts, loops, scores: tables, columns as above.
    """

    study: Mapping[str, Any]
    settings: Sequence[Mapping[str, Any]]
    versions: Mapping[str, str]
    impacts: pd.DataFrame
    loops: pd.DataFrame
    scores: pd.DataFrame
    trains: pd.DataFrame = field(default_factory=_no_trains)

    def summary(self) -> dict[str, Any]:
        """The part that is not a table, JSON-able."""
        return {
            "schema": SCHEMA,
            "kind": "hcbench results",
            "study": self.study,
            "versions": self.versions,
            "settings": list(self.settings),
            "impacts": len(self.impacts),
            "scores": json.loads(self.scores.to_json(orient="records", double_precision=15)),
        }

    def write(self, folder: Path) -> None:
        """Write the files into an existing folder."""
        tables = {
            "restitution": self.impacts,
            "loops": self.loops,
            "scores": self.scores,
            "trains": self.trains,
        }
        for name, table in tables.items():
            write_text(folder / f"{name}.csv", csv_text(table))
        write_text(folder / "summary.json", json_text(self.summary()))

    @classmethod
    def read(cls, folder: Path) -> Results:
        """Read what `write` wrote; UserError for a folder that is not one, or of another schema."""
        try:
            summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
            tables = [_read_table(folder / f"{name}.csv") for name in TABLES]
        except (OSError, ValueError) as error:
            raise UserError("results", f"{folder}: {error}", "a folder that `hcbench report` wrote") from None
        if summary.get("schema") != SCHEMA:
            raise UserError(
                "results",
                f"{folder} has schema {summary.get('schema')!r}",
                f"schema {SCHEMA}",
                "Run the study again with this version of hcbench",
            )
        return cls(summary["study"], summary["settings"], summary["versions"], *tables)


def _read_table(path: Path) -> pd.DataFrame:
    import pandas as pd

    # Before version 3 pandas reads the last digit wrong unless told not to; since then it must not be told.
    exact: dict[str, Any] = (
        {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
    )
    # An empty number is NaN, but an empty reason is an empty text and an empty claim "not resolved".
    table: pd.DataFrame = pd.read_csv(path, dtype=dict.fromkeys(["reason", *CLAIMS], "object"), **exact)
    if "reason" in table:
        table["reason"] = table["reason"].fillna("")
    for claim in CLAIMS:
        if claim in table:
            table[claim] = table[claim].map({"True": True, "False": False}).astype("object")
            table.loc[table[claim].isna(), claim] = None
    return table


def csv_text(table: pd.DataFrame) -> str:
    """CSV with every float in the fewest digits that read back the same."""
    buffer = io.StringIO()
    table.to_csv(buffer, index=False, lineterminator="\n")
    return buffer.getvalue()


def json_text(content: Any) -> str:
    """JSON, stable and with no NaN (null instead)."""
    return json.dumps(_no_nan(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _no_nan(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: _no_nan(v) for k, v in content.items()}
    if isinstance(content, list | tuple):
        return [_no_nan(v) for v in content]
    return None if isinstance(content, float) and math.isnan(content) else content


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: into a neighbour first, then renamed."""
    try:
        handle, neighbour = tempfile.mkstemp(prefix=".hcbench-", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            mask = os.umask(0)
            os.umask(mask)
            Path(neighbour).chmod(0o666 & ~mask)  # mkstemp makes it private
            Path(neighbour).replace(path)
        except BaseException:
            Path(neighbour).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise _unwritable("output", path, error, "a place that can be written to") from None


def _unwritable(slot: str, path: Path, error: OSError, expected: str) -> HcbenchError:
    """Whose fault it is: a name that no disk takes is the user's, a full disk is not."""
    if error.errno == errno.ENAMETOOLONG:
        return UserError(slot, f"{str(path)[:80]}...: {error.strerror}", "a shorter path")
    return OutputError(slot, f"{path}: {error.strerror}", expected)


@contextmanager
def filled_folder(folder: Path) -> Iterator[Path]:
    """A scratch folder whose files move into `folder` when the block ends well; else nothing is left.

    Files of an earlier filling that are not of this one go, unless someone has changed them since: MANIFEST
    lists what was written, with a digest of each.
    """
    made: list[Path] = []
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".hcbench-", dir=folder))
    except OSError as error:
        raise _unwritable("output folder", folder, error, "a folder that can be written to") from None
    try:
        yield scratch
        with undisturbed():
            _move(scratch, folder)
    except BaseException as error:
        shutil.rmtree(scratch, ignore_errors=True)
        for path in made:
            if path.exists() and not any(path.iterdir()):
                path.rmdir()
        if isinstance(error, OSError):
            raise _unwritable("output folder", folder, error, "a folder that can be written to") from None
        raise
    shutil.rmtree(scratch, ignore_errors=True)


def _move(scratch: Path, folder: Path) -> None:
    earlier = _listed(folder)
    (scratch / MANIFEST).unlink(missing_ok=True)  # of a filling within this one
    items = [item for item in sorted(scratch.rglob("*")) if item.is_file()]
    own = {item.relative_to(scratch).as_posix(): _digest(item) for item in items}
    # Listed before they are there: however this ends, the next filling knows what is not someone else's.
    write_text(folder / MANIFEST, json_text({"schema": 1, "kind": _FILLED, "files": {**earlier, **own}}))
    for item in items:
        target = folder / item.relative_to(scratch)
        target.parent.mkdir(parents=True, exist_ok=True)
        item.replace(target)
    for name in earlier.keys() - own.keys():
        stale = folder / name
        if stale.is_file() and not stale.is_symlink() and _digest(stale) == earlier[name]:
            stale.unlink()
            if stale.parent != folder and not any(stale.parent.iterdir()):
                stale.parent.rmdir()
    write_text(folder / MANIFEST, json_text({"schema": 1, "kind": _FILLED, "files": own}))


def _listed(folder: Path) -> dict[str, str]:
    """Files below `folder` that an earlier filling wrote, and their digests; none where nothing says so."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        files = content["files"] if content["kind"] == _FILLED else {}
        below = {str(name): str(digest) for name, digest in files.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}
    return {n: d for n, d in below.items() if not Path(n).is_absolute() and ".." not in Path(n).parts}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ctrl-C and its kin wait until the block is through; for moments, in the main thread."""
    came: list[int] = []
    kept: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and callable(signal.getsignal(number)):
                kept[number] = signal.signal(number, lambda n, _: came.append(n))
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    for number in came[:1]:
        signal.raise_signal(number)
