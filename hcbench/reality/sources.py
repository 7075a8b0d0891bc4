"""Sources of the data sets: a description, citation, licence and files of each."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from hcbench.reality import ball, cube, ellipse
from hcbench.system.files import read_bytes


@dataclass(frozen=True, slots=True)
class Source:
    """A data set.

    repository, commit and path: of the original; shipped: whether hcbench has it.

    sha256: of the file at `path`; "" for a folder.
    """

    sentence: str
    citation: str
    licence: str
    repository: str
    commit: str
    path: str
    shipped: bool
    sha256: str = ""


SOURCES = {
    "cube": Source(
        "An acrylic cube of 105 mm is tossed onto a board 570 times, and tracked at 148 Hz until it rests.",
        "Pfrommer, Halm, Posa: ContactNets. Conference on Robot Learning, 2020, arXiv 2009.11193.",
        "BSD-3-Clause; its text is beside the shipped numbers.",
        "https://github.com/DAIRLab/contact-nets",
        "c3dc21c94577ff4ed99123f0b00bfe57bb2d1d90",
        cube.FOLDER,
        True,
    ),
    "ellipse": Source(
        "A plastic ellipse of 70 mm x 50 mm is dropped between two panes; 1718 impacts have velocities before"
        " and after.",
        "Fazeli, Donlon, Drumwright, Rodriguez: Empirical evaluation of common contact models for planar"
        " impact. ICRA 2017.",
        "BSD-3-Clause, of DAIRLab's copy; the original states none.",
        "https://github.com/DAIRLab/ImpactModeling",
        "f6c28898845da6d48efdd6c1c696db2fb3716edf",
        ellipse.FILE,
        True,
        "fafcb329cca4325659ca384bc9a3f43057608f21a178d37e45eefd6032ddf224",
    ),
    "ball": Source(
        "Table tennis balls with a measured spin bounce on a table; 109 bounces are seen well on both sides.",
        "Gossard, Tebbe, Ziegler, Zell: SpinDOE. IROS 2023, arXiv 2303.03879.",
        "None stated: not shipped.",
        "https://github.com/cogsys-tuebingen/spindoe",
        "e7046a84304c20ab53b3ead87d9f8ce96a050e0a",
        ball.FILE,
        False,
        ball.SHA256,
    ),
    "alumina": Source(
        "Alumina balls of 5 mm hit glass at 3.9 m/s and at any angle; 31 points are digitised from figures.",
        "Kharaz, Gorham, Salman: An experimental study of the elastic rebound of spheres. Powder Technology"
        " 120 (2001) 281.",
        "Facts; digitised in Kratos Multiphysics (BSD).",
        "https://github.com/KratosMultiphysics/Kratos",
        "650ccb263d910608aa74112ddb4c8fa45ca5ba96",
        "applications/DEMApplication/test_examples/basic_benchmarks/paper_data",
        True,
    ),
}


def find(name: str, data: Path | None) -> Path | None:
    """Folder of a data set's original repository: `data` itself, or a folder in it; None for
    neither.
    """
    if data is None or name == "alumina":
        return None
    path = SOURCES[name].path
    return next((each for each in (data, *sorted(data.glob("*"))) if (each / path).exists()), None)


def missing(name: str) -> str:
    """Description of the files to download before a data set can be used; "" for one that is
    shipped.
    """
    source = SOURCES[name]
    if source.shipped:
        return ""
    return (
        f"a folder with {source.path} of {source.repository} "
        f"({source.commit[:7]}, SHA-256 {source.sha256})"
    )


def differs(name: str, folder: Path) -> bool:
    """Say whether a data set's file differs from the one that the parameters and numbers here
    belong to.
    """
    source = SOURCES[name]
    if not source.sha256:
        return False
    return hashlib.sha256(read_bytes(folder / source.path)).hexdigest() != source.sha256
