"""The repository keeps of reports/ the pages that a reader opens: small, and with the digests of
hcbench-files.json.
"""

from __future__ import annotations

import hashlib
import json
import posixpath
import re
import subprocess
from pathlib import Path

import pytest

from hcbench.reporting import page
from hcbench.reporting.page import PAGES, header_html, page_header

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


def test_every_link_of_a_page_leads_to_a_file_of_the_clone(tracked: dict[str, bytes]) -> None:
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    of_clone = set(done.stdout.splitlines())
    for name, content in tracked.items():
        if name.endswith(".html"):
            links = re.findall(r'<a [^>]*href="([^"#:]+)"', content.decode("utf-8"))
            paths = [posixpath.normpath(posixpath.join(posixpath.dirname(name), a)) for a in links]
            assert not set(paths) - of_clone, name


def test_every_page_opens_with_the_header_and_links_to_all_others(
    tracked: dict[str, bytes],
) -> None:
    for name, content in tracked.items():
        if name.endswith(".html"):
            html = header_html(page_header((ROOT / name).parent))
            assert content.decode("utf-8").count(html) == 1, name
            assert html.count("<a ") >= len(PAGES), name


def test_a_page_of_a_user_has_no_dead_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands while the project has no address, and links to it once it has one."""
    monkeypatch.setattr(page, "address", lambda name: "")
    html = header_html(page_header(tmp_path))
    assert "href" not in html and "<code>hcbench docs</code>" in html
    monkeypatch.setattr(page, "address", lambda name: f"https://example.org/{name}")
    html = header_html(page_header(tmp_path))
    assert 'href="https://example.org/Documentation/reports/field/index.html"' in html
    assert 'href="https://example.org/Source"' in html
