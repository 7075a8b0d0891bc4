"""Results of one study under each of its gravities, and a cup compared
with its equivalent flat plate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from hcbench.benchmark.results import CONDITIONS, RUN_KEY, Results
from hcbench.reporting.view import View

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

_RUN = ["engine", "setting", "timestep_s"]


class Views(NamedTuple):
    """The same study with and without gravity, either of which may be
    missing, and where bodies slid.
    """

    with_gravity: View | None
    without_gravity: View | None
    sliding: View | None = None

    @property
    def shown(self) -> list[View]:
        """The views with gravity and without, those that there are."""
        return [view for view in (self.with_gravity, self.without_gravity) if view is not None]

    @property
    def main(self) -> View:
        """View that resembles a user's own scene: under gravity, if the study has it."""
        return self.shown[0]


def views(results: Results) -> Views:
    """A view for each gravity; the strongest where there are several."""
    gravities = {float(record["gravity_m_per_s2"]) for record in results.settings}
    strongest = max(gravities, default=0.0)
    with_gravity = None
    if strongest:
        with_gravity = View(under(results, strongest))
    without_gravity = None
    if 0.0 in gravities or not gravities:
        without_gravity = View(under(results, 0.0))
    friction = RUN_KEY.index("friction")
    rough = results.table.only([key for key in results.table.folded if key[friction] > 0.0])
    sliding = None
    if len(rough):
        sliding = View(replace(results, table=rough))
    return Views(with_gravity, without_gravity, sliding)


def under(results: Results, gravity: float) -> Results:
    """Select the results under a gravity, m/s², on the axis and with the least friction.

    In the study's own scene, or else in another one.
    """
    import pandas as pd

    rows = pd.DataFrame(results.settings, columns=["scene", *CONDITIONS, *_RUN])
    plain = (rows["gravity_m_per_s2"] == gravity) & (rows["off_axis_m"] == 0.0)
    plain &= rows["friction"] == rows["friction"][plain].min()
    foreign = rows["scene"] != results.study["scene"]
    # One row a run: where it ran in the study's own scene and in another,
    # the sort puts its own first.
    chosen = rows[plain].assign(foreign=foreign).sort_values("foreign", kind="stable")
    chosen = chosen.drop_duplicates(_RUN).drop(columns="foreign")
    chosen_values = set(chosen.itertuples(index=False, name=None))

    def is_chosen(values: Mapping[str, Any]) -> bool:
        return tuple(values[name] for name in chosen.columns) in chosen_values

    def pick(table: pd.DataFrame) -> pd.DataFrame:
        if table.empty:
            return table
        return table.merge(chosen)

    settings = [record for record in results.settings if is_chosen(record)]
    keys = [key for key in results.table.folded if is_chosen(dict(zip(RUN_KEY, key, strict=True)))]
    table = results.table.only(keys)
    study = dict(results.study)
    if gravity != study["gravity"]:
        # The study's band is that of its own gravity: here it is what was launched.
        launched: set[float] = set()
        for one in table.folded.values():
            launched.update(one.curve.speed.tolist())
        study |= {"gravity": gravity, "speeds": sorted(launched), "loop_speeds": []}
    return replace(
        results,
        study=study,
        settings=settings,
        table=table,
        loops=pick(results.loops),
        scores=pick(results.scores),
        trains=pick(results.trains),
        rests=pick(results.rests),
    )
