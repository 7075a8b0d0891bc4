"""The user's own MJCF with lines added: outside comments, or not at all."""

from pathlib import Path

import pytest

mujoco = pytest.importorskip("mujoco")

from hcbench.engines.mujoco.model.write_pairs import (  # noqa: E402
    own_text,
    spec_of,
    whole_text,
)
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


INCLUDING = MODEL.replace("</mujoco>", '<include file="{file}"/></mujoco>')
BODY = """<mujocoinclude><worldbody><body pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody>
</mujocoinclude>"""


def test_a_copy_elsewhere_finds_files_whose_names_have_escapes(tmp_path: Path) -> None:
    """A second escape of "&amp;" gave "&amp;amp;"."""
    there, here = tmp_path / "a&b", tmp_path / "here"
    there.mkdir()
    here.mkdir()
    (there / "c&d.xml").write_text(BODY)
    (there / "tetrahedron.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    mesh = '<asset><mesh file="tetrahedron.obj"/></asset><worldbody>'
    source = there / "model.xml"
    source.write_text(
        INCLUDING.format(file="c&amp;d.xml").replace("<worldbody>", mesh, 1), encoding="utf-8"
    )
    copy = here / "copy.xml"
    for text in (own_text(source, here, LINE), whole_text(spec_of(source), here)):
        copy.write_text(text)
        assert mujoco.MjModel.from_xml_path(str(copy)).nmesh == 1


def test_includes_in_included_files_are_not_left_to_lead_from_elsewhere(tmp_path: Path) -> None:
    """MuJoCo finds them from the folder of the model, so MuJoCo's whole text is written instead."""
    (tmp_path / "there" / "parts").mkdir(parents=True)
    source = tmp_path / "there" / "model.xml"
    source.write_text(INCLUDING.format(file="parts/one.xml"))
    outer = '<mujocoinclude><include file="parts/two.xml"/></mujocoinclude>'
    (source.parent / "parts" / "one.xml").write_text(outer)
    (source.parent / "parts" / "two.xml").write_text(BODY)
    assert mujoco.MjModel.from_xml_path(str(source)).nbody == 2
    assert own_text(source, tmp_path, LINE) == ""
    assert LINE in own_text(source, source.parent, LINE)
    # One file within another is found from anywhere.
    (source.parent / "parts" / "one.xml").write_text(f"<!-- {outer} -->{BODY}")
    copy = tmp_path / "copy.xml"
    copy.write_text(own_text(source, tmp_path, LINE))
    assert mujoco.MjModel.from_xml_path(str(copy)).nbody == 2
