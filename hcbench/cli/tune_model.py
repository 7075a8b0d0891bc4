"""hcbench tune MODEL: a setting for pairs of a user's own model, tuned in it, and how wrong it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench._text import time_step
from hcbench.cli.console import print_json
from hcbench.errors import LimitPassed, UserError

if TYPE_CHECKING:
    from hcbench.impact import Floats
    from hcbench.laws.restitution import Reading
    from hcbench.tuning.model import TunedModel, TunedPair


def tune_model(
    source: str,
    *,
    pair: tuple[str, ...],
    alpha: tuple[float, float] | None,
    restitution: float | None,
    points: tuple[tuple[float, float], ...],
    reading: Reading,
    speeds: Floats | None,
    max_error: float | None,
    write_model: Path | None,
    force: bool,
    as_json: bool,
    **launch: Any,
) -> None:
    """Tune pairs of a model, print the lines and how wrong they are, and write the model with them."""
    from hcbench._outputs import write_output
    from hcbench.measuring.measurement import Wanted
    from hcbench.measuring.request import make_request
    from hcbench.sim.model_under_test import DEFAULT_SPEEDS
    from hcbench.tuning import model as tuning
    from hcbench.tuning.tune import MAX_ERROR

    if not pair:
        raise UserError("--pair", "missing", "two bodies or geoms", f"`hcbench pairs {source}` lists them")
    wanted = Wanted(None if alpha is None else alpha[0], restitution, points, reading)
    band = [v for v, _ in points] if len(points) > 1 else list(DEFAULT_SPEEDS)
    if speeds is not None:
        band = speeds.tolist()
    ends = sorted({min(band), max(band)})
    requests = [make_request(each, speeds=ends, **launch) for each in pair]
    if len({frozenset(request.pair or ()) for request in requests}) < len(requests):
        raise UserError("--pair", " and ".join(pair), "each pair once")
    limit = MAX_ERROR if max_error is None else max_error
    tuned = tuning.tune_model(source, requests, wanted, max_error=limit)
    if write_model is not None:
        if not tuned.written:
            got = f"a model of {tuned.pairs[0].facts.engine}"
            raise UserError("--write-model", got, "a model that is one file")
        write_output(write_model, tuned.written, "--write-model", force)
    if as_json:
        print_json(_record(tuned))
    else:
        _print(tuned)
    if max_error is not None and not tuned.max_error <= max_error:
        raise LimitPassed("max-error", f"{tuned.max_error:.3g}", f"{max_error:g} or less")


def _record(tuned: TunedModel) -> dict[str, Any]:
    facts = tuned.pairs[0].facts
    return {
        "schema": 1,
        "kind": "hcbench tuned model",
        "model": facts.model,
        "engine": facts.engine,
        "timestep_s": facts.timestep,
        "gravity_m_per_s2": list(facts.gravity),
        "setting": tuned.name,
        "max_error": tuned.max_error,
        "pairs": [_pair_record(pair) for pair in tuned.pairs],
        "paste": tuned.paste,
        "notes": list(tuned.notes),
    }


def _pair_record(tuned: TunedPair) -> dict[str, Any]:
    names = ("speed_in_m_per_s", "target", "restitution_min", "restitution_max")
    return {
        "pair": list(tuned.facts.pair),
        "effective_mass_kg": tuned.facts.effective_mass,
        "max_error": tuned.max_error,
        "curve": [dict(zip(names, point, strict=True)) for point in tuned.points],
    }


def _print(tuned: TunedModel) -> None:
    facts = tuned.pairs[0].facts
    gravity = " ".join(f"{g + 0.0:.4g}" for g in facts.gravity)
    print(f"{facts.model}, step {time_step(facts.timestep)} s, gravity {gravity} m/s^2")
    print(f"setting: {tuned.name}")
    for pair in tuned.pairs:
        facts = pair.facts
        print(f"\n{facts.pair[0]} on {facts.pair[1]}, effective mass {facts.effective_mass:.4g} kg")
        print(f"contact {facts.meeting}; moved by {facts.moved}")
        print(f"largest error of e: {pair.max_error:.2g}, tuned, at other speeds, 8 phases")
        print("at touch:")
        for speed, wanted, low, high in pair.points:
            print(f"  {speed:.3g} m/s: target {wanted:.4f}, {low:.4f} ... {high:.4f}")
    print(f"\npaste:\n\n{tuned.paste}\n\nNotes:")
    for note in tuned.notes:
        print(f"- {note}")
