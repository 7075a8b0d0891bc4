"""Mutants: small changes of the physics, each of which the tests of its own room must notice.

`python -m mutants [WORDS]` copies the checkout, makes one change after another in the copy, and
runs the tests of each. With words, it takes the mutants whose file has one of them. It prints for
each mutant the test that killed it, or SURVIVED. At the end the killers run once more without a
change: one that fails then proves nothing. The exit code is 1 where a mutant survives, a text to
change is gone, or a killer proves nothing.

A survivor is a gap in the tests of its room: write the statement that
is missing, and keep the mutant.

No library does this plainly. mutmut 3 changes code in functions only, and a quarter of these
mutants are constants of a module or C code. cosmic-ray changes Python alone, by operators of its
own, none of which makes 1.3 of 1.6. Both run one command for all mutants.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
LIMIT_S = 400.0  # of the tests of one mutant, which take half a minute on an idle machine
_CULPRIT = re.compile(r"^(?:FAILED|ERROR) (tests/.+?)(?: - .*)?$", re.MULTILINE)
_EVENLY = ("share = step_shares(phase[rows], starts)", "share = np.repeat(1.0 / sizes, sizes)")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change: `before`, which the file has once, becomes `after`.

    file: in hcbench/. function: the function or constant that changes. why:
    the statement that is then wrong.
    tests: files of the room, or their folder.
    """

    file: str
    function: str
    before: str
    after: str
    why: str
    tests: tuple[str, ...]


MUTANTS = (
    Mutant(
        "terms/bounds.py",
        "require_bounds",
        "or low <= abs(value) <= high",
        "or low < abs(value) <= high",
        "a number at its lower bound is within the bounds",
        ("tests/terms/test_units.py",),
    ),
    Mutant(
        "terms/impact.py",
        "touching",
        "speed - gain * (steps + phase + share)",
        "speed - gain * (steps + phase - share)",
        "a launch under gravity touches at its speed",
        ("tests/terms/test_launches.py",),
    ),
    Mutant(
        "laws/coulomb.py",
        "tangential",
        "impact.speed_out + scene.gravity * impact.duration",
        "impact.speed_out - scene.gravity * impact.duration",
        "the contact carries the weight as well, for as long as it lasts",
        ("tests/laws/test_coulomb.py",),
    ),
    Mutant(
        "laws/restitution.py",
        "rebound",
        "left**2 + sunk)) - half",
        "left**2 + sunk)) + half",
        "flight under a semi-implicit step keeps (v + g h/2)² - 2 g x",
        ("tests/laws/test_restitution_curves.py",),
    ),
    Mutant(
        "laws/collision.c",
        "hcb_under_gravity",
        "exact_flight ? 0 : b * h / 2",
        "exact_flight ? 0 : b * h",
        "an impact takes out the half step of gravity within its step",
        ("tests/laws/test_simultaneous_impacts.py",),
    ),
    Mutant(
        "scoring.py",
        "loop_area",
        "(gone - float(x[-1]))",
        "(gone + float(x[-1]))",
        "a loop that ends inside the surface is closed towards where the force has gone",
        ("tests/scoring",),
    ),
    Mutant(
        "scoring.py",
        "_furthest",
        "return abs(math.log(ratio)) if",
        "return math.log(ratio) if",
        "half of the law is as far from it as twice the law",
        ("tests/scoring",),
    ),
    Mutant(
        "recipes/target.py",
        "SLOWEST",
        "SLOWEST = 1.6",
        "SLOWEST = 1.3",
        "a band begins where a body can leave the plate within a step",
        ("tests/recipes/test_band.py",),
    ),
    Mutant(
        "recipes/target.py",
        "resolvable_law",
        "** (target.law.exponent + 1.0)",
        "** (target.law.exponent - 1.0)",
        "a softened contact lasts the steps that it was softened for",
        ("tests/recipes/test_tune_constant.py",),
    ),
    Mutant(
        "sim/touch.py",
        "DEEPEST",
        "DEEPEST = 0.1",
        "DEEPEST = 0.15",
        "two that start deeper than a tenth of the smaller one are refused",
        ("tests/sim/test_touch.py",),
    ),
    Mutant(
        "sim/read_impact.py",
        "at_plane",
        "(v + added) ** 2 - 2.0 * gravity * x",
        "(v + added) ** 2 + 2.0 * gravity * x",
        "the speed at the touch plane follows from what flight conserves",
        ("tests/sim/test_read_impact.py",),
    ),
    Mutant(
        "sim/stop.py",
        "long_enough",
        "in_contact // 2",
        "in_contact // 4",
        "a body rests after half of its contact, not a quarter, was quiet",
        ("tests/sim/test_stop.py",),
    ),
    Mutant(
        "sim/passivity.py",
        "restitution",
        "(1.0 - e) / 2.0",
        "(1.0 - e) * 2.0",
        "an impact takes at least half of the loss that the target has",
        ("tests/sim/test_longest_train.py",),
    ),
    Mutant(
        "sim/touch.py",
        "PARTED_S",
        "PARTED_S = 0.005",
        "PARTED_S = 0.01",
        "a foot that is off the floor for more than 5 ms has left it",
        ("tests/sim/test_footfalls.py",),
    ),
    Mutant(
        "measuring/curve.py",
        "curve_of_columns",
        *_EVENLY,
        "the e that `measure` prints weighs each phase by its share of the time step",
        ("tests/measuring/test_curve.py",),
    ),
    Mutant(
        "measuring/curve.py",
        "worst_of",
        "key=lambda point: abs(point.worst_phase)",
        "key=lambda point: point.worst_phase",
        "an e that is too low is as wrong as one that is too high",
        ("tests/measuring/test_curve.py",),
    ),
    Mutant(
        "measuring/diagnose.py",
        "_tried_causes",
        "if after > before - notable:",
        "if after > before + notable:",
        "fixes that together cure nothing are not named as causes",
        ("tests/measuring/test_diagnose.py",),
    ),
    Mutant(
        "measuring/rest.py",
        "_HELPS",
        "_HELPS = 0.5",
        "_HELPS = 0.9",
        "a fix that alone leaves less than half is a cause",
        ("tests/measuring/test_rest_causes.py",),
    ),
    Mutant(
        "tuning/evaluate.py",
        "DEEPEST_STEPS",
        "DEEPEST_STEPS = 2.5",
        "DEEPEST_STEPS = 4.0",
        "a contact deeper than 2.5 steps of the fastest impact is a flaw",
        ("tests/tuning/test_evaluate.py",),
    ),
    Mutant(
        "tuning/find.py",
        "candidates",
        "recipe.steps_min_with_gravity > steps",
        "recipe.steps_min_with_gravity < steps",
        "a recipe that needs more steps under gravity than there are does not serve",
        ("tests/tuning/test_tuning.py",),
    ),
    Mutant(
        "fitting/flight.py",
        "dropped",
        "(1.0 - self.drag * speed * speed)",
        "(1.0 + self.drag * speed * speed)",
        "air slows a fall, so more height adds less speed",
        ("tests/fitting/test_laws_and_flights.py",),
    ),
    Mutant(
        "fitting/flight.py",
        "in_air",
        "(mass + 0.5 * displaced)",
        "(mass - 0.5 * displaced)",
        "a ball accelerates half of the air that it displaces",
        ("tests/fitting/test_laws_and_flights.py",),
    ),
    Mutant(
        "fitting/linear.py",
        "grams",
        "2.0 * self.rest_count * np.log(noise)",
        "1.0 * self.rest_count * np.log(noise)",
        "the likelihood of n readings has the determinant of their covariance",
        ("tests/fitting/test_linear.py",),
    ),
    Mutant(
        "benchmark/bounce_sequence.py",
        "bounces",
        "(8 * bend)",
        "(4 * bend)",
        "the top of a flight lies on the parabola through three samples",
        ("tests/benchmark/test_followed_drops.py",),
    ),
    Mutant(
        "benchmark/plan.py",
        "speeds_at",
        "low + stretch * (speed - first)",
        "low + stretch * (speed + first)",
        "speeds of a field page are moved into the band, end to end",
        ("tests/benchmark/test_launch_grid.py",),
    ),
    Mutant(
        "reporting/ranking.py",
        "DEEP",
        "DEEP = 2.5",
        "DEEP = 5.0",
        "a run that goes deeper than 2.5 v h lacks something",
        ("tests/reporting/test_report_advice.py",),
    ),
    Mutant(
        "checking/judge.py",
        "_within",
        "if abs(worst.worst_phase) > max_error:",
        "if worst.worst_phase > max_error:",
        "an e below the target fails the limit as one above it does",
        ("tests/checking/test_check.py",),
    ),
    Mutant(
        "measuring/curve.py",
        "curve_of_columns",
        *_EVENLY,
        "the e that `check` prints weighs each phase by its share of the time step",
        ("tests/checking/test_check.py",),
    ),
    Mutant(
        "checking/outcome.py",
        "excess",
        "beyond / (abs(self.value) or 1.0)",
        "beyond * (abs(self.value) or 1.0)",
        "of several limits the one that is exceeded by the largest share is named",
        ("tests/checking/test_limits.py",),
    ),
    Mutant(
        "paper/vibroimpact/system.py",
        "resultant",
        "pressing(self.left, -q - half, -v)",
        "pressing(self.left, -q + half, -v)",
        "the left block is touched at q = -g/2",
        ("tests/paper/test_vibroimpact.py",),
    ),
    Mutant(
        "reality/impacts.py",
        "_SURE",
        "_SURE = 0.05",
        "_SURE = 0.5",
        "an impact is good if its e is known to 0.05",
        ("tests/reality/test_impacts.py",),
    ),
    Mutant(
        "cases/score.py",
        "_ALIKE",
        "_ALIKE = 0.02",
        "_ALIKE = 0.2",
        "an engine ignores restitution if e varies by less than 0.02",
        ("tests/cases/test_true_values.py",),
    ),
    Mutant(
        "engines/mujoco/scene/rows.py",
        "combine",
        "keepdims=True) - gravity",
        "keepdims=True) + gravity",
        "gravity presses the bodies together",
        ("tests/engines/mujoco/test_passivity.py", "tests/engines/mujoco/test_tune_soft.py"),
    ),
    Mutant(
        "engines/mujoco/model/speed_shares.py",
        "add",
        "adhesion, -bias]",
        "adhesion, bias]",
        "the weight of a falling body adds to its approach speed",
        (
            "tests/engines/mujoco/test_speed_shares.py",
            "tests/engines/mujoco/test_compiled_loop.py",
        ),
    ),
    Mutant(
        "engines/mujoco/plugin/restitution.c",
        "collide",
        "u[i] += within * gains[i]",
        "u[i] -= within * gains[i]",
        "impacts of the plug-in are between rates with half of the step's gravity",
        ("tests/engines/mujoco/test_plugin_mujoco.py",),
    ),
    Mutant(
        "engines/pybullet/model/simulation.py",
        "_applied",
        "self.timestep + self.gravity)",
        "self.timestep - self.gravity)",
        "the contact's force is the change of momentum and the weight",
        ("tests/engines/bullet/test_measure_pybullet.py",),
    ),
    Mutant(
        "recipes/law_recipes.py",
        "exact_above",
        "0.5 / e",
        "0.4 / e",
        "the speed from which a plug-in's e is exact is the lowest such speed",
        ("tests/engines/bullet/test_plugin_slow_impacts.py",),
    ),
    Mutant(
        "engines/pybullet/plugin/restitution.c",
        "add_impacts",
        "all[i].rate[k] + w->h / 2 * rate_of(&s, i, k, falling)",
        "all[i].rate[k] - w->h / 2 * rate_of(&s, i, k, falling)",
        "impacts of the plug-in are between rates with half of the step's gravity",
        (
            "tests/engines/bullet/test_plugin_slow_impacts.py",
            "tests/engines/bullet/test_contact_pybullet.py",
        ),
    ),
    Mutant(
        "engines/reference.py",
        "kelvin_voigt_setting",
        "** 2 + decay**2)",
        "** 2 - decay**2)",
        "ω² of the damped oscillator is k/m less the square of its decay",
        ("tests/engines/test_reference_engine.py",),
    ),
    Mutant(
        "cli/tune_model.py",
        "_cure",
        "time_step(facts.timestep / 4)",
        "time_step(facts.timestep * 4)",
        "the step that is advised is smaller than the model's",
        ("tests/cli/test_advice.py",),
    ),
    Mutant(
        "workers/__init__.py",
        "map_surviving_crashes",
        "if crashes_in_a_row == give_up:",
        "if crashes_in_a_row > give_up:",
        "an engine that dies so many times in a row is given up",
        ("tests/workers",),
    ),
    Mutant(
        "environments.py",
        "find",
        "matching[-1]",
        "matching[0]",
        "an engine without a version is the newest of its versions",
        ("tests/environments/test_environments.py",),
    ),
    Mutant(
        "system/text.py",
        "two_digits",
        "2 if error >= 1e-5 else 1",
        "2 if error >= 1e-4 else 1",
        "an error of 1e-5 and more is printed in two digits",
        ("tests/system/test_text.py",),
    ),
)


def changed(mutant: Mutant, root: Path) -> str:
    """Return the text of the mutant's file with its change. ValueError unless it has `before` once."""
    text = (root / "hcbench" / mutant.file).read_text(encoding="utf-8")
    if text.count(mutant.before) != 1:
        raise ValueError(f"{mutant.file} has {text.count(mutant.before)} times: {mutant.before}")
    return text.replace(mutant.before, mutant.after)


def _copy_checkout(folder: Path) -> None:
    """Copy the files that git tracks, and new ones that it does not ignore, with their times.

    By its time and size Python knows whether a file is the one that it compiled.
    """
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(
        listed, cwd=ROOT, check=True, capture_output=True, encoding="utf-8"
    ).stdout
    for name in filter(None, names.split("\0")):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)


def _run(folder: Path, tests: Sequence[str], *options: str) -> subprocess.CompletedProcess[str]:
    """Run tests of the copy, on its own package. TimeoutExpired after
    LIMIT_S for each file or folder.
    """
    environment = {
        **os.environ,
        "PYTHONPATH": str(folder),  # before the checkout, which is installed as editable
        "XDG_CACHE_HOME": str(folder.parent / "cache"),  # of compiled mutants
    }
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, *tests],
        cwd=folder,
        env=environment,
        check=False,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        timeout=LIMIT_S * len(tests),
    )


def _fate(mutant: Mutant, folder: Path) -> str:
    """Return the test that kills the mutant, or a word in capitals: SURVIVED, NOT RUN, GONE."""
    file = folder / "hcbench" / mutant.file
    try:
        file.write_text(changed(mutant, folder), encoding="utf-8")
    except ValueError as error:
        return f"GONE: {error}"
    try:
        done = _run(folder, mutant.tests, "-x")
    except subprocess.TimeoutExpired:
        return f"no end within {LIMIT_S * len(mutant.tests):g} s"
    finally:
        shutil.copy2(ROOT / "hcbench" / mutant.file, file)
    if done.returncode == 0:
        return "SURVIVED"
    culprit = _CULPRIT.search(done.stdout)
    return culprit[1] if culprit else f"NOT RUN: {(done.stdout + done.stderr)[-300:]}"


def main(words: list[str]) -> int:
    """Run the mutants, and print the table. 1 where one survives, or where that could not be told."""
    mutants = [each for each in MUTANTS if not words or any(word in each.file for word in words)]
    if not mutants:
        print(f"No mutant's file has one of these words: {' '.join(words)}")
        return 1
    with tempfile.TemporaryDirectory(
        prefix="hcbench-mutants-", ignore_cleanup_errors=True
    ) as above:
        folder = Path(above) / "checkout"
        _copy_checkout(folder)
        fates = []
        for mutant in mutants:
            fates.append(_fate(mutant, folder))
            print(f"{mutant.file}: {mutant.after} | {fates[-1]}", flush=True)
        killers = list(dict.fromkeys(fate for fate in fates if fate.startswith("tests/")))
        unchanged = _run(folder, killers) if killers else None
    alive = []
    for mutant, fate in zip(mutants, fates, strict=True):
        if fate.startswith(("SURVIVED", "NOT RUN", "GONE")):
            alive.append(
                f"{mutant.file}, {mutant.function}: {', '.join(mutant.tests)} must say: {mutant.why}"
            )
    print(f"\n{len(mutants) - len(alive)} of {len(mutants)} mutants are killed.", *alive, sep="\n")
    if unchanged is not None and unchanged.returncode:
        print(f"Nothing is changed, and some killers fail:\n{unchanged.stdout[-3000:]}")
        return 1
    return 1 if alive else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
