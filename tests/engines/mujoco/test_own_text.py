"""The user's own MJCF with lines added: outside comments, or not at all."""

from pathlib import Path

import pytest

mujoco = pytest.importorskip("mujoco")

from hcbench.engines.mujoco.model.write_pairs import own_text, spec_of  # noqa: E402
from hcbench.system.errors import UserError  # noqa: E402

MODEL = """<mujoco>
  <worldbody><geom name="floor" type="plane" size="1 1 1"/></worldbody>
</mujoco>
"""
LINE = '<custom><text name="mine" data="x"/></custom>'


@pytest.mark.parametrize("after", ["", "<!-- ends with </mujoco> -->\n", "<!-- plain -->\n"])
def test_lines_come_before_the_end_of_the_model_whatever_comments_say(after: str) -> None:
    text = own_text(MODEL + after, None, LINE)
    assert mujoco.MjModel.from_xml_string(text).ntext == 1
    assert text.endswith(f"</mujoco>\n{after}")


def test_a_file_that_is_not_utf_8_is_refused_before_any_search(tmp_path: Path) -> None:
    path = tmp_path / "latin.xml"
    declared = '<?xml version="1.0" encoding="ISO-8859-1"?>\n'
    text = MODEL.replace("<worldbody>", "<!-- café --><worldbody>")
    path.write_bytes((declared + text).encode("latin-1"))
    assert mujoco.MjModel.from_xml_path(str(path)).ngeom == 1
    for read in (lambda: spec_of(path), lambda: own_text(path, tmp_path, LINE)):
        with pytest.raises(UserError, match="has a byte that is not UTF-8"):
            read()


def test_text_without_the_end_of_a_model_is_not_kept() -> None:
    assert own_text("<mujoco><!-- </mujoco> -->", None, LINE) == ""
