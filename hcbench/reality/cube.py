"""The cube tosses of ContactNets: poses of an acrylic cube that is
tossed onto a board, until it rests.

455 of the 570 tosses are shipped, those of i % 5 != 4, as integers; the others stay for a test that
nothing here has seen. The published lengths are too short by 2.04 %: gravity in flight is 9.614
m/s² by them, and the cube at rest stands 51.24 mm high. The published inertia, 0.00081 kg m², is
too small: impulses and trajectories give 0.00107.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hcbench.reality.motion import LEAST_FLIGHT, TIMESTEP, Motion, Tosses, motion
from hcbench.reality.outcome import SettingErrors
from hcbench.reality.torch_file import read_tensor
from hcbench.sim.toss import Body, ContactSetting, TossModule
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

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
    z).

    folder: of the original repository; None: the shipped tosses. UserError for a folder of anything
    else.
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
    """Tosses with number % 5 in `parts` that have a flight long enough
    to know their start, by number.

    variant: what of the data is left as published.
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
    """Errors of an engine's setting."""
    return tosses.outcome(module, setting, values, TIMESTEP)


def as_motion(number: int, rows: Floats, corrections: Corrections = CORRECTED) -> Motion:
    """A toss in metres and seconds."""
    time = np.arange(len(rows), dtype=np.float64) * PERIOD
    place = rows[:, :3] * HALF_WIDTH * corrections.scale
    length: Floats = np.sqrt((rows[:, 3:] ** 2).sum(axis=1, keepdims=True))
    turn = np.asarray(rows[:, 3:] / length, dtype=np.float64)
    return motion(number, body(corrections), time, place, turn)


def pack(folder: Path, path: Path) -> None:
    """Write the tosses that are shipped, all but the held-out ones, as differences of integers.

    folder: the original repository's tosses. Each number keeps 1e-5 of its unit: half widths, or 1.
    """
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
