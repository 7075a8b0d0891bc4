"""hcbench land: drop a robot on its floor under its controller, and report how it lands."""

from __future__ import annotations

from pathlib import Path

from hcbench.cli.console import (
    as_json,
    force_option,
    model_source,
    options,
    output_option,
    print_json,
)
from hcbench.cli.help import command
from hcbench.cli.terminal import show, status
from hcbench.system.errors import UserError


@command()
@model_source
@options("heights", "tilt", "controller", "key", "qpos", "state", "timestep", "gravity", "package")
@output_option("--page", help="Also write a one-page report with the force over time (HTML).")
@force_option
@as_json
def land(
    models: tuple[str, ...],
    python: str | None,
    heights: str | None,
    tilt: str | None,
    controller: str | None,
    engine: str | None,
    limit: str | None,
    page: Path | None,
    force: bool,
    as_json: bool,
    **pose: object,
) -> None:
    """Drop a robot on its floor, and measure how it lands.

    Report e of its centre of mass, the peak force, and what each foot does. Of two MODELS, such as
    before and after `hcbench tune`, the drops stand side by side.
    """
    from hcbench.measuring.landing import as_record, as_text, land_job, make_drops
    from hcbench.measuring.measure import Job
    from hcbench.measuring.measurement import TOLERANCE
    from hcbench.measuring.request import make_request, read_limit
    from hcbench.system.outputs import write_output

    if not models and python is None:
        raise UserError("model", "none given", "a file with a robot, or --python FILE:FUNCTION")
    sources = list(models)
    if python is not None:
        sources.append(python)
    given = {"heights": heights, "tilt": tilt, "controller": controller}
    drops = make_drops(**{name: value for name, value in given.items() if value is not None})
    request = make_request(None, **pose)  # type: ignore[arg-type]
    seconds = read_limit(limit)
    robots = []
    with status("dropping the robot"):
        for source in sources:
            job = Job(source, engine, request, None, TOLERANCE, False)
            robots.append(land_job(job, drops, seconds))
    if page is not None:
        from hcbench.reporting.measurement_page import landing_page

        write_output(page, landing_page(robots), "--page", force)
    if not as_json:
        show(as_text(robots).rstrip())
    elif len(robots) == 1:
        print_json(as_record(robots[0]))
    else:
        print_json(list(map(as_record, robots)))
