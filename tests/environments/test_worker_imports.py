"""What a worker process in an engine's environment imports: no package that such an environment lacks."""

from __future__ import annotations

import subprocess
import sys

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
batch = Batch(study.scene, shard.setting, shard.launches, shard.kept)
assert run_batch(batch).columns["restitution"][0] > 0.9
"""


def test_batches_and_drops_need_no_more_than_an_environment_has() -> None:
    done = subprocess.run([sys.executable, "-c", _CODE], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
