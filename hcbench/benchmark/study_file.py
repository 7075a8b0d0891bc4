"""The keys of a study file and of its runs."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, StrictBool, StrictInt

from hcbench.terms.fields import (
    Acceleration,
    Alpha,
    Alphas,
    Angles,
    Clearance,
    Clearances,
    FileTable,
    Friction,
    Length,
    Speed,
    Speeds,
    Spin,
    Step,
    Steps,
    Text,
)

_MOST_PHASES = 1000


class SentTable(FileTable):
    """Gravity, friction, angles and spin of the launches: for all runs of a study, or one."""

    gravity: Acceleration | None = None
    friction: Friction | None = None
    angles: Angles | None = None
    spin: Spin | None = None


class RunTable(SentTable):
    """A [[run]] of a study file."""

    engine: Text = Field(description="an engine's name")
    recipe: Text = Field(description="a recipe's name")
    timesteps: Steps
    alphas: Alphas | None = None
    speeds: Speeds | None = None
    heights: Clearances | None = None
    default_band: StrictInt | None = Field(
        None, ge=2, le=1000, description="how many speeds over the default band of each step"
    )
    scene: Any = None
    off_axis: Length = 0.0


class StudyFile(SentTable):
    """A study file: its keys, without those of its runs."""

    schema_: StrictInt = Field(
        1, alias="schema", ge=1, le=1, description="the number 1; a newer hcbench may read others"
    )
    title: Text | None = Field(None, description="text")
    scene: Any = Field(description="a scene's name or folder")
    alphas: Alphas
    speeds: Speeds
    loop_speeds: Speeds = ()
    phases: StrictInt = Field(
        8, ge=1, le=_MOST_PHASES, description=f"a whole number from 1 to {_MOST_PHASES}"
    )
    main_alpha: Alpha | None = None
    step_speed: Speed | None = None
    train_height: Clearance | None = None
    train_step: Step | None = None
    page: Literal["report", "field"] = "report"
    all_loops: StrictBool = Field(False, description="true or false")
    run: list[dict[str, Any]] = Field(min_length=1, description="[[run]] tables")
