"""Every cause that code can name has its paragraph, at the address that `measure` prints."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import hcbench
from hcbench.measuring.measurement import Cause
from hcbench.measuring.text import cause_lines

PACKAGE = Path(hcbench.__file__).parent
PAGE = PACKAGE.parent / "docs" / "reference" / "causes.md"
ANCHORS = re.findall(r"^### ([\w-]+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
CODE = re.compile(r"[a-z]+(-[a-z]+)*")
MIXED = {
    "{name}-mixing": ("solref-mixing", "solimp-mixing"),
    "promised-{name}": tuple(
        f"promised-{name}" for name in ("timestep", "integrator", "cone", "impratio")
    ),
}
NO_CAUSE = {"feet", "restitution"}  # fixes alone, of other modules


def codes(tree: ast.Module) -> Iterator[str]:
    """The codes of a module's suspects: as written, and as its names may have them."""
    for function in (f for f in ast.walk(tree) if isinstance(f, ast.FunctionDef)):
        for call in (c for c in ast.walk(function) if isinstance(c, ast.Call) and c.args):
            name = getattr(call.func, "id", getattr(call.func, "attr", ""))
            if name in ("Suspect", "report"):
                yield from _values(call.args[0], function, tree)


def _values(node: ast.expr, function: ast.FunctionDef, tree: ast.Module) -> Iterator[str]:
    if isinstance(node, ast.Constant):
        yield str(node.value)
    elif isinstance(node, ast.IfExp):
        yield from (*_values(node.body, function, tree), *_values(node.orelse, function, tree))
    elif isinstance(node, ast.JoinedStr):
        yield from MIXED["".join(ast.unparse(node)[2:-1])]
    elif isinstance(node, ast.Name):
        yield from _bound(node.id, function)
        yield from _bound(node.id, tree)


def _bound(name: str, scope: ast.AST) -> Iterator[str]:
    """Texts that a scope gives a name: alone, as the first of several, or in a loop over tuples."""
    for node in ast.walk(scope):
        if isinstance(node, ast.Assign):
            target, values = node.targets[0], [node.value]
        elif isinstance(node, ast.For) and isinstance(node.iter, ast.Tuple):
            target, values = node.target, node.iter.elts
        else:
            continue
        if isinstance(target, ast.Tuple):
            target, values = target.elts[0], [v.elts[0] for v in values if isinstance(v, ast.Tuple)]
        if isinstance(target, ast.Name) and target.id == name:
            yield from (str(v.value) for v in values if isinstance(v, ast.Constant))


def test_every_cause_has_its_paragraph_and_every_paragraph_its_cause() -> None:
    texts = [path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")]
    trees = [ast.parse(text) for text in texts if "Suspect" in text]
    named = {code for tree in trees for code in codes(tree)} - NO_CAUSE | {"no-push"}
    assert len(ANCHORS) == len(set(ANCHORS))
    assert sorted(named) == sorted(ANCHORS)
    assert all(CODE.fullmatch(code) for code in named)


def test_a_cause_is_printed_with_the_command_that_shows_its_paragraph() -> None:
    cause = Cause("few-steps", "Too few steps.", "2 steps", "a smaller step", 0.1, 0.2)
    assert f"  more   hcbench docs {PAGE.stem}#few-steps" in cause_lines((cause,), "")
