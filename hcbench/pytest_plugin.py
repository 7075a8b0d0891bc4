"""pytest plug-in: restitution as a test.

    def test_ball_bounces(restitution):
        restitution("models/ball.xml", pair="ball,plate").matches(0.9)

    @pytest.mark.restitution(speeds="0.1:1:5 m/s", max_error=0.01)
    def test_ball_follows_the_law(restitution):
        restitution("models/ball.xml", pair="ball,plate").follows(alpha="0.008 s/in")

A failure shows the curve, the worst speed and the likely cause. Defaults come from the
marker, then from the ini options `restitution_max_error`, `restitution_speeds`,
`restitution_phases`, `restitution_timeout`. Nothing of hcbench but this file and the names of
the options is imported before the fixture is used.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

import pytest

from hcbench.terms.options import (
    LAUNCHES,
    LIMITS,
    BodyPair,
    LaunchOptions,
    LimitOptions,
    MaterialName,
    ModelSource,
    Quantity,
    hint_at,
)

# A failure then shows both numbers.
pytest.register_assert_rewrite("hcbench.testing")

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from hcbench.checking.outcome import Outcome
    from hcbench.measuring.measurement import Measurement

_INI = {
    "restitution_max_error": "largest error of e that restitution tests allow (default 0.02)",
    "restitution_speeds": "launch speeds of restitution tests, like '0.1:1:5 m/s'",
    "restitution_phases": "how many phases of a time step restitution tests launch at (default 4)",
    "restitution_timeout": "seconds after which an engine counts as hung (default 60)",
}
_KEYS = (*LIMITS, *LAUNCHES, "engine", "timeout")
_EXPECTED = (
    "expected .matches(e), .follows(alpha=...), (points=...) or (material=...), .equals(baseline), "
    ".rests(max_depth=...) or (max_vibration=...), or .measured()"
)
_MARKER = (
    f"restitution({'=..., '.join(_KEYS)}=...): defaults of the restitution fixture for this test"
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The ini options."""
    for name, words in _INI.items():
        parser.addini(name, words, default=None)


def pytest_configure(config: pytest.Config) -> None:
    """Declare the markers, for --strict-markers and --markers."""
    config.addinivalue_line("markers", _MARKER)
    # pytest-xdist declares this marker itself; `hcbench.testing` sets it for its tests.
    if not config.pluginmanager.hasplugin("xdist"):
        config.addinivalue_line(
            "markers", "xdist_group(name): tests that run in one process of pytest-xdist"
        )


@pytest.fixture
def restitution(request: pytest.FixtureRequest) -> Iterator[RestitutionFixture]:
    """Fixture that measures a model: `restitution(model, pair=...)`, then `.matches(e)`, ....

    Fails the test for unknown options of the marker, and at its end for a model that was named and
    not measured.
    """
    defaults: dict[str, Any] = {}
    for name in _INI:
        value = request.config.getini(name)
        if value not in (None, "", []):
            defaults[name.removeprefix("restitution_")] = value
    # The nearest marker is applied last and wins.
    for marker in reversed(list(request.node.iter_markers("restitution"))):
        if marker.args:
            pytest.fail(
                "@pytest.mark.restitution: positional arguments; expected keywords", pytrace=False
            )
        _require_known("@pytest.mark.restitution", marker.kwargs)
        defaults.update(marker.kwargs)
    folder = request.path.parent
    fixture = RestitutionFixture(defaults, folder if folder.is_dir() else Path.cwd())
    yield fixture
    for bounce in fixture.bounces:
        if not bounce.is_measured:
            pytest.fail(f"restitution({bounce.name!r}): not measured; {_EXPECTED}", pytrace=False)


class FixtureOptions(LaunchOptions, LimitOptions, total=False):
    """Options of the fixture.

    timeout: time after which an engine counts as hung.
    """

    engine: str | None
    timeout: Quantity | None


class RestitutionFixture:
    """The fixture: call it with a model and a pair.

    bounces: those that this test asked for.
    """

    def __init__(self, defaults: Mapping[str, Any], folder: Path) -> None:
        self._defaults = dict(defaults)
        self._folder = folder
        self.bounces: list[ModelBounce] = []

    def __call__(
        self, model: ModelSource, pair: BodyPair | None = None, **options: Unpack[FixtureOptions]
    ) -> ModelBounce:
        """Name a model and a pair in it; one of the methods of the result, such as `.matches(e)`,
        measures it.

        model: a path (looked for in the test's own folder first), two paths, or an engine's own
        model object.
        pair: names of the two, the body that moves first.
        options: those of launches (`hcbench.terms.options`), limits such as max_error, engine, and
        timeout; they go before those of the marker. Fails the test for an unknown option.
        """
        __tracebackhide__ = True
        _require_known("restitution()", options)
        bounce = ModelBounce(self._resolve(model), pair, {**self._defaults, **options})
        self.bounces.append(bounce)
        return bounce

    def _resolve(self, model: Any) -> Any:
        """Model with paths from the folder of the test, where there is such a file; else as it is."""
        if isinstance(model, list | tuple):
            return [self._resolve(part) for part in model]
        if isinstance(model, str | Path) and not str(model).lstrip().startswith("<"):
            # "FILE.py:FUNCTION", or a file alone.
            file, colon, function = str(model).partition(".py:")
            path = str(model)
            ending = ""
            if colon:
                path = f"{file}.py"
                ending = f":{function}"
            beside = self._folder / path
            if beside.exists():
                path = str(beside)
            return path + ending
        return model


class ModelBounce:
    """One model, measured when it is held against something.

    is_measured: a test held it against something.
    """

    def __init__(self, model: Any, pair: Any, options: Mapping[str, Any]) -> None:
        self._model = model
        self._pair = pair
        self._options = dict(options)
        self.name = _name(model)
        self.is_measured = False

    def matches(self, restitution: float, max_error: float | None = None) -> Measurement:
        """Assert one e at all speeds."""
        self._require_target("matches", restitution)
        return self._hold(restitution=restitution, max_error=max_error)

    def follows(
        self,
        alpha: float | str | None = None,
        *,
        points: str | Path | None = None,
        pairs: str | Path | None = None,
        material: MaterialName | None = None,
        target: Literal["law", "linear"] = "law",
        max_error: float | None = None,
    ) -> Measurement:
        """Measure the pair, and fail the test unless e over speed follows a target: the law of 1975
        with α, a CSV file of points, or a pair of materials. Exactly one is given.

        alpha: such as "0.008 s/in", or a number in s/m.
        points: path of a file with columns of speed and e.
        material: such as "rubber on concrete".
        target: "linear" for e = 1 - α v.
        pairs: the old name of points.
        max_error: error of e that is allowed; None: as the options of the fixture have it.
        """
        if pairs is not None:
            hint_at("pairs", "points")
            points = points or pairs
        self._require_target("follows", alpha, points, material)
        return self._hold(
            alpha=alpha, points=points, material=material, target=target, max_error=max_error
        )

    def equals(self, baseline: str | Path, max_error: float | None = None) -> Measurement:
        """Assert the same bounce as a baseline that `hcbench check --write-baseline` wrote."""
        self._require_target("equals", baseline)
        return self._hold(baseline=baseline, max_error=max_error)

    def rests(
        self, max_depth: float | str | None = None, max_vibration: float | str | None = None
    ) -> Measurement:
        """Measure the pair, and fail the test if at rest one body lies deeper in the other than
        max_depth, or vibrates by more than max_vibration.

        max_depth: "1 mm", or a number in m.
        max_vibration: rms, "1e-4 m/s", or a number in m/s. None: as the options of the fixture have
        it; the test fails if these have neither limit.
        """
        limits = {"max_depth": max_depth, "max_vibration": max_vibration}
        for name, value in limits.items():
            if value is None:
                limits[name] = self._options.get(name)
        self._require_target("rests", *limits.values())
        return self._hold(None, **limits)

    def measured(self) -> Measurement:
        """Measurement of the pair, compared with no target."""
        return self._hold()

    def _require_target(self, verb: str, *targets: object) -> None:
        """Fail a test whose target is None: it would hold the pair to nothing, and pass."""
        __tracebackhide__ = True
        if all(target is None for target in targets):
            # This failure says enough: the next check need not complain that nothing was measured.
            self.is_measured = True
            pytest.fail(
                f"restitution({self.name!r}).{verb}(): no target; {_EXPECTED}", pytrace=False
            )

    def _hold(self, max_error: float | None = None, **against: Any) -> Measurement:
        """Measure the pair, and fail the test where a limit is passed or nothing could be measured.

        max_error: error of e that is allowed; None: as the options of the fixture have it.
        against: the target or limits, as options of `hcbench check` by name.
        """
        __tracebackhide__ = True
        self.is_measured = True
        outcome = self._check(max_error, against)
        if outcome.exit_code == 1:
            from hcbench.checking.text import outcome_text

            pytest.fail(f"{outcome.message}\n{outcome_text(outcome)}", pytrace=False)
        if outcome.measurement is None:
            pytest.fail(outcome.message, pytrace=False)
        return outcome.measurement

    def _check(self, max_error: float | None, against: Mapping[str, Any]) -> Outcome:
        """Measure and judge the pair with the options of the fixture and those of this call.

        max_error: error of e that is allowed; None: that of the fixture.
        against: the target or limits, by their options' names. Fails the test for options that are
        refused.
        """
        from hcbench.checking import CheckSpec, plan, run_check
        from hcbench.system.errors import HcbenchError, UserError
        from hcbench.terms.arguments import name_parameters
        from hcbench.terms.fields import validate

        options = {**self._options, **against, "name": self.name, "pair": self._pair, "model": ()}
        options["limit"] = options.pop("timeout", None)
        if max_error is not None:
            options["max_error"] = max_error
        try:
            spec = validate(CheckSpec, options, UserError, "restitution: {}")
            return run_check(dataclasses.replace(plan(spec), source=self._model))
        except HcbenchError as error:
            name_parameters(error, (*CheckSpec.model_fields, "timeout"))
            refusal = str(error)
        # Outside the handler, or pytest prints the error as its context, too.
        pytest.fail(refusal, pytrace=False)


def _require_known(slot: str, options: Mapping[str, Any]) -> None:
    """Fail a test with an option that the fixture does not have.

    slot: where it was given.
    """
    __tracebackhide__ = True
    unknown = sorted(set(options) - set(_KEYS))
    if unknown:
        names = f"unknown {', '.join(unknown)}; expected one of: {', '.join(_KEYS)}"
        pytest.fail(f"{slot}: {names}", pytrace=False)


def _name(model: Any) -> str:
    """Names of a model's files, joined by " + "; of an object its type, and "MJCF" of its text."""
    parts = model if isinstance(model, list | tuple) else [model]
    names = []
    for part in parts:
        if isinstance(part, str) and part.lstrip().startswith("<"):
            names.append("MJCF")
        elif isinstance(part, str | Path):
            names.append(Path(part).name)
        else:
            names.append(type(part).__name__)
    return " + ".join(names)
