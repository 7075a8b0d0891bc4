"""An engine from outside, whose package is in the wheels of a test only: the
law, with an α of its version.

`registered` makes its adapter known here by an entry point, as any engine's is; `wheels`
makes what an index would have: versions of its package, and of what a worker needs
stand-ins that lead to packages here.
"""

from __future__ import annotations

import os
import signal
import sysconfig
import zipfile
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.recipes.recipe import Recipe, stock
from hcbench.sim import entry_points, registry
from hcbench.sim.backend import Backend
from hcbench.sim.engine import Engine
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import pytest

    from hcbench.terms.impact import Impact, Launch
    from hcbench.terms.scene import Scene

SHARED = ("numpy", "scipy", "pint", "pydantic", "mujoco")
ABOUT = "Metadata-Version: 2.1\nName: {}\nVersion: {}\n"
CRASH_SPEED = 7.0  # m/s


class ToyEngine(Engine):
    """The law, with the α that its package says: 0.1 s/m times its version."""

    name = "toy"
    title = "Toy"
    backend = Backend("toy", "toyphysics", "1", "2", "pip install toyphysics")

    def recipes(self) -> Sequence[Recipe]:
        return [stock("toy", "As it comes.")]

    def impacts(
        self, scene: Scene, setting: Setting, launches: Sequence[Launch]
    ) -> Sequence[Impact]:
        import toyphysics  # type: ignore[import-not-found]  # in environments only

        if any(launch.speed == CRASH_SPEED for launch in launches):
            os.kill(os.getpid(), signal.SIGSEGV)
        own = Setting("reference", "hunt-crossley", setting.timestep, {"alpha": toyphysics.ALPHA})
        return registry.engine("reference").impacts(
            scene, own, launches
        )  # as engines borrow from others


def registered(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """While a folder that Python looks in says that the adapter is installed."""
    about = folder / "toy_adapter-1.dist-info"
    about.mkdir(exist_ok=True)
    (about / "METADATA").write_text(ABOUT.format("toy_adapter", "1"))
    (about / "entry_points.txt").write_text("[hcbench.engines]\ntoy = toy_engine:ToyEngine\n")
    monkeypatch.syspath_prepend(folder)
    _look_again()
    yield
    _look_again()


def _look_again() -> None:
    entry_points.registered.cache_clear()
    entry_points.adapter.cache_clear()


def wheels(folder: Path) -> Path:
    """Wheels as an index has them: toyphysics 1.0, 2.0, 3.0, which is
    broken, and 4.0, for another Python.
    """
    for number in (1, 2):
        wheel(folder, "toyphysics", f"{number}.0", {"toyphysics.py": f"ALPHA = {0.1 * number}\n"})
    wheel(
        folder, "toyphysics", "3.0", {"toyphysics.py": "raise OSError('libtoy.so: cannot open')\n"}
    )
    wheel(folder, "toyphysics", "4.0", {}, "cp27-cp27m")
    places = [sysconfig.get_path("purelib"), str(Path(str(np.__file__)).parents[1])]
    for name in SHARED:
        here = "3.9" if name == "mujoco" else metadata.version(name)
        wheel(folder, name, here, {f"{name}_here.pth": "".join(f"{place}\n" for place in places)})
    return folder


def wheel(
    folder: Path, name: str, version: str, files: dict[str, Any], tag: str = "py3-none"
) -> None:
    """One wheel with these files."""
    about = f"{name}-{version}.dist-info"
    files |= {
        f"{about}/METADATA": ABOUT.format(name, version),
        f"{about}/WHEEL": f"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: {tag}-any\n",
    }
    record = "".join(f"{file},,\n" for file in (*files, f"{about}/RECORD"))
    with zipfile.ZipFile(folder / f"{name}-{version}-{tag}-any.whl", "w") as archive:
        for file, content in {**files, f"{about}/RECORD": record}.items():
            archive.writestr(file, content)
