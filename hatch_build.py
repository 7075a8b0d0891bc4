"""README for the package index, which cannot follow relative links: a build makes them absolute.

The addresses are those of [project.urls] in pyproject.toml. Pages of reports lead to the built site,
pictures to their bytes, and all other files to the repository at the tag of this version.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

RELATIVE = re.compile(r"\]\((?!https?://|#)([^)\s]+)\)")


class AbsoluteLinks(MetadataHookInterface):
    """Hatch makes the field `readme` with this."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Called by Hatch with the table [project]."""
        repository, site = metadata["urls"]["Source"], metadata["urls"]["Documentation"]
        tag = f"v{metadata['version']}"

        def absolute(match: re.Match[str]) -> str:
            path = match[1]
            if path.endswith(".html"):
                return f"]({site}/{path})"
            kind = "raw" if path.endswith((".svg", ".png")) else "blob"
            return f"]({repository}/{kind}/{tag}/{path})"

        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": RELATIVE.sub(absolute, text)}
