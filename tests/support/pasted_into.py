"""Models of others for a text of hcbench: a covering design of what their
options, defaults and pairs say.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from covering import covering_rows

if TYPE_CHECKING:
    from collections.abc import Sequence

FACTORS: dict[str, Sequence[Any]] = {
    "defaults": ("", "margin", "solref", "frictionless", "class"),
    "option before": ("", "1 ms", "5 ms RK4", "elliptic", "implicitfast"),
    "option after": ("", "1 ms", "5 ms", "RK4", "implicitfast", "elliptic", "impratio"),
    "own pair": ("", "before", "after", "of two others"),
    "flag": ("", "override", "multiccd", "refsafe off"),
    "geom": ("plain", "margin", "solref", "priority", "contype 0", "two geoms"),
    "unit": ("m", "mm"),
    "place": ("first", "last"),
}
_OPTION = {
    "1 ms": 'timestep="0.001"',
    "5 ms": 'timestep="0.005"',
    "5 ms RK4": 'timestep="0.005" integrator="RK4"',
    "RK4": 'integrator="RK4"',
    "implicitfast": 'integrator="implicitfast"',
    "elliptic": 'cone="elliptic"',
    "impratio": 'impratio="10"',
}
_DEFAULT = {
    "margin": '<pair margin="0.001" gap="0.0005"/>',
    "solref": '<geom solref="0.005 0.3"/><pair solref="0.005 0.3" solimp="0.5 0.9 0.01 0.5 2"/>',
    "frictionless": '<geom condim="1"/><pair condim="1"/>',
    "class": '<default class="soft"><pair margin="0.002" friction="0.1 0.1"/></default>',
}
_FLAG = {
    "override": '<flag override="enable"/>',
    "multiccd": '<flag multiccd="enable"/>',
    "refsafe off": '<flag refsafe="disable"/>',
}
_GEOM = {"margin": 'margin="0.002"', "solref": 'solref="0.01 0.2"', "priority": 'priority="3"'}


def strangers(count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Rows of the design, each the factors of one model."""
    return covering_rows(FACTORS, count, lambda _: True, seed)


def model_of(row: dict[str, Any], text: str, ball: str = "ball", plate: str = "plate") -> str:
    """A ball over a plane as the row says, with the text in it, as MJCF."""
    scale = 1000.0 if row["unit"] == "mm" else 1.0
    masks = 'contype="0" conaffinity="0"' if row["geom"] == "contype 0" else ""
    geom = f"{_GEOM.get(row['geom'], '')} {masks}"
    second = f'<geom name="{ball} 2" size="{0.01 * scale}" pos="0 0 {0.02 * scale}" mass="0.1"/>'
    own = f'<contact><pair geom1="{ball}" geom2="{plate}" solref="0.01 0.5"/></contact>'
    others = f'<contact><pair geom1="other" geom2="{plate}" solref="0.01 0.5"/></contact>'
    parts = [
        f"<default>{_DEFAULT[row['defaults']]}</default>" if row["defaults"] else "",
        f'<option gravity="0 0 {-9.81 * scale}">{_FLAG.get(row["flag"], "")}</option>',
        f"<option {_OPTION.get(row['option before'], '')}/>",
        {"before": own, "of two others": others}.get(row["own pair"], ""),
    ]
    after = [
        f"<option {_OPTION[row['option after']]}/>" if row["option after"] else "",
        own if row["own pair"] == "after" else "",
    ]
    world = f"""<worldbody><geom name="{plate}" type="plane" size="{3 * scale} {3 * scale} 1" {geom}/>
      <body name="{ball}" pos="0 0 {0.05 * scale}"><freejoint/>
        <geom name="{ball}" size="{0.05 * scale}" mass="0.45" {geom}/>{second * (row["geom"] == "two geoms")}
      </body>
      <body pos="{scale} 0 {0.1 * scale}"><freejoint/><geom name="other" size="{0.1 * scale}"/></body>
    </worldbody>"""
    order = (
        [text, *after, world] if row["place"] == "first" else [world, *after[1:], text, after[0]]
    )
    return "\n".join(["<mujoco>", *parts, *order, "</mujoco>"])
