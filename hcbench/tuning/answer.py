"""Settings that make an engine bounce like a target: the one answer that all commands print.

A page, the command line, Python, README and the docs are made of this value: choices of up to three
kinds, each with its text, its error and its band, and the settings that are never to be used.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

from hcbench.recipes.target import minimax_constant, why_cut
from hcbench.sim import registry
from hcbench.system.errors import SettingError
from hcbench.system.text import Drawn, time_step, two_digits
from hcbench.terms.arguments import checked
from hcbench.terms.setting import Pair, Setting
from hcbench.tuning.tuned import MOST_ADVISED, Tuned, make_tuned

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.recipes.target import Target
    from hcbench.sim.passivity import Passivity
    from hcbench.sim.promise import Promise
    from hcbench.terms.scene import Scene

# Settings to avoid that an answer lists, at most.
_SHOWN = 4
# A setting that follows the law has a smaller error of e.
MAX_ERROR = 0.05
# A setting whose error is within this factor of the best constant's is no better than it.
_WORSE = 1.02
Kind = Literal["exact", "settings", "constant"]
KINDS: dict[Kind, str] = {
    "exact": "plug-in, exact",
    "settings": "settings only",
    "constant": "one e for all speeds",
}
# Kinds in the order in which they are taken; None: no kind was asked for.
_NEXT: dict[Kind | None, tuple[Kind, ...]] = {
    None: ("exact", "settings", "constant"),
    "exact": ("exact", "settings", "constant"),
    "settings": ("settings", "constant", "exact"),
    "constant": ("constant", "settings", "exact"),
}


@dataclass(frozen=True, slots=True)
class Choice:
    """A setting to use.

    tuned: what the engine did with it; None for a plug-in, which needs no run.

    kind: "exact" (a plug-in), "settings" (numbers of the engine's own), "constant" (one e for all
    speeds).
    text: to paste, with the user's two names.
    max_error: the largest error of e over `speeds`, m/s.
    max_e: the largest e in that band and below.
    passivity: None where it was not measured.
    rests: a body comes to rest on it.
    needs: what a user's model must have.
    notes: sentences on it.
    promise: what `measure` will compare with.
    """

    kind: Kind
    setting: Setting
    text: str
    max_error: float
    speeds: tuple[float, float]
    max_e: float
    passivity: Passivity | None
    rests: bool
    needs: tuple[str, ...]
    notes: tuple[str, ...] = ()
    tuned: Tuned | None = None
    promise: Promise | None = None

    @property
    def within(self) -> str:
        """The error with its band."""
        low, high = self.speeds
        return f"e within {two_digits(self.max_error)} from {low:.3g} to {high:.3g} m/s"

    @property
    def line(self) -> str:
        """The choice in one line: kind, name, error with its band, and whether it is for spheres
        alone.
        """
        words = f"{KINDS[self.kind]}: {self.setting.name}, {self.within}"
        return f"{words}, for spheres" if self.flat is False else words

    @property
    def energy(self) -> str:
        """Phrase on energy: the number of launches and drops in which it never grew and of which
        bodies, that and where it grows, or that it was not measured.
        """
        if self.passivity is None:
            return "energy was not measured"
        if self.passivity.warning:
            return self.passivity.warning
        if not self.max_e <= MOST_ADVISED:
            return "gains energy"
        words = f"energy never grew in {self.judged} launches and drops"
        if self.flat is True:
            return f"{words} of a ball, boxes and a capsule"
        if self.flat is False:
            return f"{words} of a ball; a flat face gains energy"
        return f"{words} of a ball"

    @property
    def judged(self) -> int:
        """Number of launches and drops in which energy never grew; 0 where it grew or was not
        measured.

        Launches that gave no e do not count. A plug-in that needs no run has the drops alone.
        """
        passivity = self.passivity
        if passivity is None or passivity.warning or not self.max_e <= MOST_ADVISED:
            return 0
        evaluated = 0
        if self.tuned is not None:
            evaluated = self.tuned.evaluation.launches - self.tuned.evaluation.failed
        return passivity.scenes + evaluated

    @property
    def sphere(self) -> bool | None:
        """True if a ball never gains energy; None if not tested."""
        return None if self.passivity is None else self.passivity.sphere

    @property
    def flat(self) -> bool | None:
        """True if a box on face, edge and vertex never gains energy; None if not tested."""
        return None if self.passivity is None else self.passivity.flat

    @property
    def record(self) -> dict[str, Any]:
        """Record of the choice for JSON: errors and e as numbers, speeds in m/s.

        Its "scenes" counts the launches and drops in which energy never grew, 0 where it grew;
        "passive" says of a sphere and of a flat face that it never grew, None where not tested.
        """
        return {
            "kind": self.kind,
            "setting": self.setting.name,
            "line": self.line,
            "within": self.within,
            "energy": self.energy,
            "scenes": self.judged,
            "text": self.text,
            "max_error": self.max_error,
            "speeds_m_per_s": list(self.speeds),
            "max_e": self.max_e,
            "passive": {"sphere": self.sphere, "flat": self.flat},
            "rests": self.rests,
            "needs": list(self.needs),
        }


@dataclass(frozen=True, slots=True)
class Never:
    """A setting never to be used in these conditions, and why."""

    setting: str
    why: str


@dataclass(frozen=True, repr=False)
class Answer(Drawn):
    """Choices in the order exact, settings, constant, where they
    exist; `best` is what was asked for.

    asked: the kind; None for the first that the engine has.
    never: settings that do not serve, and why.
    named: a setting that was asked for by its name, even one that fails.
    left_out: why the plug-in is not among the choices where it could not be compiled, and how to
    get it; or "".
    """

    engine: str
    target: Target
    scene: Scene
    pair: Pair
    asked: Kind | None
    choices: tuple[Choice, ...]
    never: tuple[Never, ...]
    named: Choice | None = field(default=None)
    left_out: str = ""

    def _lines(self) -> Iterator[str]:
        """Yield lines for a terminal: the best choice, the others, what never to use, and how to
        get the text.
        """
        best = self.best
        yield f"{self.engine}, step {time_step(self.target.timestep)} s: {best.line}"
        yield f"largest e {best.max_e:.4f}; {best.energy}"
        for choice in self.choices:
            if choice is not best:
                yield f"or {choice.line}"
        for never in self.never[:_SHOWN]:
            yield f"never {never.setting}: {never.why}"
        if self.left_out:
            yield self.left_out
        yield f"to paste: .text, {len(self.text.splitlines())} lines"

    def _rows(self) -> Iterator[dict[str, Any]]:
        """Yield a row for each choice; speeds in m/s."""
        for choice in self.choices:
            yield {
                "kind": choice.kind,
                "setting": choice.setting.name,
                "max_error": choice.max_error,
                "speed_min_m_per_s": choice.speeds[0],
                "speed_max_m_per_s": choice.speeds[1],
                "max_e": choice.max_e,
                "rests": choice.rests,
                "text": choice.text,
            }

    @property
    def text(self) -> str:
        """The text to paste of the best choice."""
        return self.best.text

    @property
    def max_error(self) -> float:
        """The largest error of e of the best choice, over its band `best.speeds`, m/s."""
        return self.best.max_error

    @property
    def remedy(self) -> str:
        """Advice where the error of the best choice is too large; "" where there is none."""
        exact = self.of("exact")
        if exact is None or exact is self.best:
            return "Try a smaller step, or a narrower band by --speeds"
        return f"--plugin prints the plug-in: {exact.within}"

    @checked
    def of(self, kind: Kind) -> Choice | None:
        """The choice of a kind; None without one."""
        for choice in self.choices:
            if choice.kind == kind:
                return choice
        return None

    def fits(self, choice: Choice) -> bool:
        """Say whether a choice is for the bodies of the question: for any body unless the user says
        at how many points they meet, and then `flaws` of a setting has what speaks against it.
        """
        return self.target.corners_asked or choice.flat is not False

    @property
    def best(self) -> Choice:
        """The setting that the user named; else the choice of the kind that was asked for, or, if
        there is none, of the next kind in `_NEXT`.

        Where no kind was asked for, a setting for spheres alone comes after those for any body.
        Raises SettingError without any choice, with the reasons.
        """
        if self.named is not None:
            return self.named
        found = []
        for kind in _NEXT[self.asked]:
            choice = self.of(kind)
            if choice is not None:
                found.append(choice)
        if self.asked is None:
            # The sort is stable: of those that fit, the order of the kinds stays.
            found.sort(key=lambda choice: not self.fits(choice))
        if found:
            return found[0]
        why = "; ".join(f"{never.setting}: {never.why}" for never in self.never)
        raise SettingError(
            "recipe",
            f"no setting of {self.engine!r} is recommended here ({why})",
            "another step, or the plug-in",
        )

    @property
    def is_as_asked(self) -> bool:
        """True where the best choice is of the kind that the user asked for, or the user named the
        setting or asked for no kind.

        Where the target is one e for all speeds, a choice "constant" also answers the question for
        "settings".
        """
        if self.named is not None or self.asked in (None, self.best.kind):
            return True
        return self.asked == "settings" and self.target.is_constant and self.best.kind == "constant"

    @property
    def tuned(self) -> Tuned:
        """The best choice with what the engine did with it.

        A plug-in has no run of its own: then this is the first other choice that was run; and if
        there is none, the plug-in is run now.
        Raises SettingError where there is no choice, and what the engine raises in that run.
        """
        for choice in (self.best, *self.choices):
            if choice.tuned is not None:
                return choice.tuned
        plug_in = registry.recipes(self.engine)[self.best.setting.name]
        why = "a law in place of the contact"
        return make_tuned(plug_in, why, self.target, self.scene, None).with_boxes()

    @property
    def _best_native(self) -> Choice | None:
        """The best choice that needs no plug-in; None where the engine has none."""
        if self.named is not None:
            return None if self.named.kind == "exact" else self.named
        return self.of("settings") or self.of("constant")

    @property
    def caution(self) -> str:
        """Warning that one e for all speeds would be nearer to the target than the best setting of
        the engine's own, though no setting of the engine has that e at all these speeds.

        "" where it would not be nearer, for a constant target, and without a setting of the
        engine's own.
        """
        native = self._best_native
        if native is None or self.target.is_constant:
            return ""
        e, error = minimax_constant(self.target)
        if native.max_error <= _WORSE * error:
            return ""
        low, high = native.speeds
        words = (
            f"One e = {e:.3g} for all speeds would be wrong by {two_digits(error)} from {low:.3g} to "
            f"{high:.3g} m/s, which is nearer, but no setting of the engine's own keeps it here."
        )
        exact = self.of("exact")
        return words if exact is None else f"{words} The plug-in follows the law: {exact.within}."

    @property
    def record(self) -> dict[str, Any]:
        """Record for JSON of the choices, of settings never to use, and of warnings."""
        return {
            "choices": [choice.record for choice in self.choices],
            "never": [asdict(never) for never in self.never],
            "band_note": self.band_note,
            "caution": self.caution,
        }

    @property
    def band_note(self) -> str:
        """Reason why the default band is cut, as a sentence; "" if it is not."""
        target = self.target
        return why_cut(target.speed_min, target.timestep, target.gravity)
