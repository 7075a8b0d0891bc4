"""Results of one study under each of its gravities, and a cup compared with its equivalent flat plate."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from hcbench.benchmark.results import CONDITIONS, RUN_KEY, Results
from hcbench.reporting.view import View

if TYPE_CHECKING:
    import pandas as pd

_RUN = ["engine", "setting", "timestep_s"]


class Views(NamedTuple):
    """The same study with and without gravity, either of which may be missing, and where bodies slid."""

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
    without_gravity = View(under(results, 0.0)) if 0.0 in gravities or not gravities else None
    friction = RUN_KEY.index("friction")
    rough = results.table.only([key for key in results.table.folded if key[friction] > 0.0])
    sliding = View(replace(results, table=rough)) if len(rough) else None
    return Views(View(under(results, strongest)) if strongest else None, without_gravity, sliding)


def under(results: Results, gravity: float) -> Results:
    """Select the results under a gravity, m/s², on the axis and with the least friction.

    In the study's own scene, or else in another one.
    """
    import pandas as pd

    rows = pd.DataFrame(results.settings, columns=["scene", *CONDITIONS, *_RUN])
    plain = (rows["gravity_m_per_s2"] == gravity) & (rows["off_axis_m"] == 0.0)
    plain &= rows["friction"] == rows["friction"][plain].min()
    foreign = rows["scene"] != results.study["scene"]
    chosen = rows[plain].assign(foreign=foreign).sort_values("foreign", kind="stable")
    chosen = chosen.drop_duplicates(_RUN).drop(columns="foreign")

    def pick(table: pd.DataFrame) -> pd.DataFrame:
        return table if table.empty else table.merge(chosen)

    keys = {tuple(row) for row in chosen.itertuples(index=False)}
    settings = [r for r in results.settings if tuple(r[name] for name in chosen.columns) in keys]
    places = [RUN_KEY.index(name) for name in chosen.columns]
    table = results.table.only([key for key in results.table.folded if tuple(key[i] for i in places) in keys])
    study = dict(results.study)
    if gravity != study["gravity"]:
        speeds = sorted({float(v) for one in table.folded.values() for v in one.curve.speed})
        study |= {"gravity": gravity, "speeds": speeds, "loop_speeds": []}
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
