"""Processes for environments: what a worker there imports; what installs one ends with its command."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

_CODE = """
import pickle, sys
LACKING = {"pandas", "pyarrow", "fsspec", "matplotlib", "rich", "click", "jinja2", "distributed", "uv"}

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in LACKING:
            raise ModuleNotFoundError(f"No module named {name!r}, which no environment of an engine has")

sys.meta_path.insert(0, Refuse())
from hcbench.benchmark.batch import Batch, run_batch
from hcbench.benchmark.bounce_sequence import plan_drops, simulate_bounces
from hcbench.benchmark.plan import make_plan
from hcbench.benchmark.study import study_from
study = study_from({
    "scene": "steel-plane", "alphas": 0.3, "speeds": 0.2, "phases": 1,
    "train_height": "1 mm", "train_step": 1e-5,
    "run": [{"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-5}],
})
plan = make_plan(study)
(drop,) = pickle.loads(pickle.dumps(plan_drops(plan)))
assert simulate_bounces(study.scene, drop).bounces
shard = pickle.loads(pickle.dumps(plan.shard(0)))
batch = Batch(study.scene, shard.grid.setting, shard.grid.launches(shard.part), [])
assert run_batch(batch).columns["restitution"][0] > 0.9
"""


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a process with its parent")
def test_what_installs_an_environment_ends_with_a_killed_command(tmp_path: Path) -> None:
    code = "import os, pathlib; from hcbench.environments import run_with_parent; "
    child = "import os, time; open('pid', 'w').write(str(os.getpid())); time.sleep(60)"
    code += (
        f"run_with_parent([{sys.executable!r}, '-c', {child!r}], pathlib.Path.cwd(), os.environ)"
    )
    with subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path) as command:
        written = tmp_path / "pid"
        while not (written.exists() and written.read_text()):
            time.sleep(0.05)
        command.kill()
    number = int(written.read_text())
    for _ in range(100):
        if (
            not Path(f"/proc/{number}").exists()
            or " Z " in Path(f"/proc/{number}/stat").read_text()
        ):
            return
        time.sleep(0.05)
    raise AssertionError("it runs on")


def test_batches_and_drops_need_no_more_than_an_environment_has() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _CODE], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
