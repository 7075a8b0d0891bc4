"""The repository keeps of reports/ the pages that a reader opens: small, and with the digests of
hcbench-files.json.
"""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MANIFEST = "hcbench-files.json"


@pytest.fixture(scope="module")
def tracked() -> dict[str, bytes]:
    """The files of reports/ that a clone has, as they are here."""
    done = subprocess.run(
        ["git", "ls-files", "reports"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode or not done.stdout:
        pytest.skip("not a clone")
    return {name: (ROOT / name).read_bytes() for name in done.stdout.splitlines()}


def test_the_reports_of_a_clone_are_small(tracked: dict[str, bytes]) -> None:
    """They hold what a reader opens, in at most 5 MB."""
    assert sum(map(len, tracked.values())) <= 5e6


def test_each_file_of_a_report_is_the_one_that_was_written_with_the_others(
    tracked: dict[str, bytes],
) -> None:
    """The costs of steps apart, which no two runs have the same."""
    for manifest in (name for name in tracked if name.endswith(MANIFEST)):
        digests = json.loads(tracked[manifest])["files"]
        folder = manifest.removesuffix(MANIFEST)
        here = {name: tracked[folder + name] for name in digests if folder + name in tracked}
        assert "index.html" in here
        wrong = [name for name in here if hashlib.sha256(here[name]).hexdigest() != digests[name]]
        assert wrong in ([], ["cost.csv"]), manifest


def test_pages_link_to_nothing_that_a_clone_lacks(tracked: dict[str, bytes]) -> None:
    for name, content in tracked.items():
        if name.endswith(".html"):
            links = re.findall(r'<a [^>]*href="([^"#:]+)"', content.decode("utf-8"))
            assert not [link for link in links if str(Path(name).parent / link) not in tracked], (
                name
            )
