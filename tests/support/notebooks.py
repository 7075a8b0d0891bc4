"""Notebooks run without Jupyter: a cell prints, and shows its last
expression as text, HTML or a picture.
"""

from __future__ import annotations

import ast
import io
import json
import re
from contextlib import chdir, redirect_stdout
from itertools import chain
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure
from same_text import is_same

PAGES = (Path(__file__).parents[2] / "docs" / "tutorial.ipynb",)
_LONGEST_HTML = 32_000  # characters: longer ones are for Jupyter alone


def executed(path: Path) -> list[list[dict[str, Any]]]:
    """The outputs of each code cell of a notebook, as its format has them, run in its own folder."""
    names: dict[str, Any] = {}
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    with chdir(path.parent):
        return [
            _run("".join(cell["source"]), names) for cell in cells if cell["cell_type"] == "code"
        ]


def _run(source: str, names: dict[str, Any]) -> list[dict[str, Any]]:
    tree = ast.parse(source)
    last = tree.body[-1]
    if isinstance(last, ast.Expr):
        del tree.body[-1]
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        shown = None
        if isinstance(last, ast.Expr):
            shown = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append(
            {"output_type": "stream", "name": "stdout", "text": _lines(printed.getvalue())}
        )
    if shown is not None:
        about: dict[str, Any] = {
            "output_type": "execute_result",
            "metadata": {},
            "execution_count": None,
        }
        outputs.append({**about, "data": _data(shown)})
    return outputs


def _data(shown: Any) -> dict[str, list[str]]:
    if isinstance(shown, Figure):
        svg = io.StringIO()
        with mpl.rc_context({"svg.hashsalt": "hcbench", "svg.fonttype": "none"}):
            shown.savefig(svg, format="svg", metadata={"Date": None})
        return {"image/svg+xml": _lines(svg.getvalue()), "text/plain": ["a figure"]}
    data = {"text/plain": _lines(repr(shown))}
    html = shown._repr_html_() if hasattr(shown, "_repr_html_") else ""
    return data | ({"text/html": _lines(html)} if 0 < len(html) < _LONGEST_HTML else {})


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def texts(outputs: list[list[dict[str, Any]]]) -> list[list[str]]:
    """Texts of outputs, without versions of engines."""
    said = [["".join(o.get("text") or o["data"]["text/plain"]) for o in each] for each in outputs]
    return [[re.sub(r"\b\d+\.\d+\.\d+\b", "...", text) for text in each] for each in said]


def agrees(old: list[list[str]], new: list[list[str]]) -> bool:
    """Say whether texts of cells are the same, numbers by value."""
    if [len(each) for each in old] != [len(each) for each in new]:
        return False
    return all(map(is_same, chain.from_iterable(old), chain.from_iterable(new)))


def stored(path: Path) -> list[list[dict[str, Any]]]:
    """The outputs that a notebook has."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell["outputs"] for cell in cells if cell["cell_type"] == "code"]


def update(path: Path) -> bool:
    """Write what the cells show now, if they say something else. Whether the notebook changed."""
    new = executed(path)
    if agrees(texts(stored(path)), texts(new)):
        return False
    notebook = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, (cell, outputs) in enumerate(zip(code, new, strict=True), 1):
        cell["execution_count"] = number
        cell["outputs"] = [o | {"execution_count": number} if "data" in o else o for o in outputs]
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return True
