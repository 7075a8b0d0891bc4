"""A model whose contacts a flag disables has no pairs: `pairs` and `measure` say so."""

from __future__ import annotations

import pytest

import hcbench as hb
from hcbench.system.errors import UserError

pytest.importorskip("mujoco")

BALL = """<mujoco><option><flag {}="disable"/></option><worldbody>
<geom name="floor" type="plane" size="1 1 1"/>
<body pos="0 0 1"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("flag", ["contact", "constraint"])
def test_no_pair_of_a_model_without_contacts_is_listed(flag: str) -> None:
    with pytest.raises(UserError, match=f'contacts are disabled, by <flag {flag}="disable"/>'):
        hb.pairs(BALL.format(flag))


@pytest.mark.parametrize("flag", ["gravity", "actuation"])
def test_other_flags_leave_the_pairs(flag: str) -> None:
    assert [each.pair for each in hb.pairs(BALL.format(flag))] == ["ball,floor"]


def test_a_pose_given_as_a_list_is_told_that_a_mapping_was_expected() -> None:
    with pytest.raises(UserError, match=r"qpos: \[0.1, 0.2\]; expected text or a mapping"):
        hb.pairs(BALL.format("gravity"), qpos=[0.1, 0.2])  # type: ignore[arg-type]
