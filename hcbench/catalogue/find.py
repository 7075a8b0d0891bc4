"""`hcbench.materials`: what is known of pairs of materials, by name or from a file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path
from typing import Any, overload

from hcbench.catalogue.material import KIND, LEVELS, MaterialPair
from hcbench.system.errors import UserError
from hcbench.system.files import parse_json, read_text
from hcbench.system.outputs import MARK_KEY
from hcbench.system.text import Shown, sanitized
from hcbench.terms.arguments import checked
from hcbench.terms.fields import validate
from hcbench.terms.options import MaterialName

FILE = Path(__file__).with_name("materials.json")
# Other words for the same.
_SAME = {
    "aluminum": "aluminium",
    "ceramic": "alumina",
    "delrin": "acetal",
    "hdpe": "polyethylene",
    "ping pong ball": "table tennis ball",
    "ping-pong ball": "table tennis ball",
    "plexiglass": "acrylic",
    "pmma": "acrylic",
    "pom": "acetal",
    "pp": "polypropylene",
    "soccer ball": "football",
}
# Names that an error lists, at most.
_NEAREST = 4
# Characters of a name.
_LONGEST_NAME = 200
_FEET = re.compile(r"\b(foot|feet|robot|sole|paw)s?\b")


@dataclass(frozen=True, repr=False)
class Materials(Shown, Sequence[MaterialPair]):
    """Measurements of pairs of materials; `to_frame` has one in each row."""

    all: tuple[MaterialPair, ...]

    @overload
    def __getitem__(self, place: int) -> MaterialPair: ...

    @overload
    def __getitem__(self, place: slice) -> Materials: ...

    def __getitem__(self, place: int | slice) -> MaterialPair | Materials:
        """One measurement, or several."""
        if isinstance(place, slice):
            return Materials(self.all[place])
        return self.all[place]

    def __len__(self) -> int:
        """The number of measurements."""
        return len(self.all)

    @property
    def names(self) -> tuple[str, ...]:
        """The pairs, each once."""
        return tuple(dict.fromkeys(each.name for each in self.all))

    def _lines(self) -> Iterator[str]:
        yield f"{len(self.names)} pairs of materials, {len(self.all)} measurements"
        for each in self.all:
            yield f"{each.name}: {each.numbers} {each.at}"

    def _rows(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of `to_frame`, by column: a measurement each; speeds in m/s, α in s/m, None
        for what a measurement lacks.
        """
        for each in self.all:
            low, high = each.speed_range_m_per_s or (None, None)
            least, most = each.restitution_interval or (None, None)
            yield {
                "name": each.name,
                "id": each.id,
                "bodies": " on ".join(each.bodies),
                "restitution": each.restitution,
                "restitution_low": least,
                "restitution_high": most,
                "alpha_s_per_m": each.alpha_s_per_m,
                "points": len(each.points),
                "speed_min_m_per_s": low,
                "speed_max_m_per_s": high,
                "measured": each.measured,
                "document": each.source.document,
                "place": each.source.place,
                "level": each.source.level,
                "note": each.note,
            }


@cache
def _known() -> tuple[MaterialPair, ...]:
    """All measurements that ship with hcbench; of one pair, the one to use first."""
    content = parse_json(FILE.read_text(encoding="utf-8"))
    return tuple(validate(MaterialPair, each, UserError, "materials: {}") for each in content)


@checked
def materials(name: MaterialName | None = None) -> Materials:
    """List pairs of materials whose restitution is published, as `hcbench materials` does.

    Parameters
    ----------
    name : text or path, optional
        A pair such as "rubber on concrete", one measurement's own name, or a file material.json; all by
        default.

    Returns
    -------
    Materials
        Each with its numbers, the speeds that they hold for and its source; where sources disagree,
        all of them. The first of a pair is the one that `material=` takes.

    Raises
    ------
    UserError
        For a name that is not known, with the nearest ones, and for a file of another form.

    Examples
    --------
    >>> import hcbench as hb
    >>> hb.materials("rubber on concrete")
    1 pairs of materials, 1 measurements
    rubber on concrete: e = 0.752 at 4.25 m/s
    >>> len(hb.materials().names) > 40
    True

    """
    if name is None:
        return Materials(_known())
    return Materials(tuple(_named(name)))


def find(name: MaterialName, folder: Path | None = None) -> MaterialPair:
    """One measurement: by its name, the first of a pair, or of a file; a MaterialPair is itself.

    folder: where paths of files start; the current one by default.
    Raises UserError as `materials` does.
    """
    if folder is not None and is_material_file(name):
        name = folder / str(name)
    return _named(name)[0]


def is_material_file(name: object) -> bool:
    """True for the name of a file of JSON."""
    return isinstance(name, str | Path) and Path(name).suffix.lower() == ".json"


def _named(name: object) -> list[MaterialPair]:
    """All measurements of a name, one or more; of one pair, the one to use first.

    name: as of `materials`; a pair counts in either order of its bodies.
    Raises UserError for a name that is not known, for a file as `read_material`, and for anything
    else.
    """
    if isinstance(name, MaterialPair):
        return [name]
    if not isinstance(name, str | Path) or not str(name).strip():
        raise UserError("material", f"{name!r:.80}", "a pair such as 'rubber on concrete'")
    if len(str(name)) > _LONGEST_NAME:
        # The nearest names would be looked for in time that grows with its square.
        got = f"a name of {len(str(name))} characters"
        raise UserError("material", got, f"up to {_LONGEST_NAME}")
    if is_material_file(name):
        return [read_material(Path(name))]
    wanted = _plain(str(name))
    swapped = " on ".join(reversed(wanted.split(" on ")))
    found = [each for each in _known() if each.id == str(name).strip().lower()]
    if not found:
        found = [each for each in _known() if _plain(each.name) in (wanted, swapped)]
    if not found:
        raise _unknown(str(name), wanted)
    return found


def _plain(name: str) -> str:
    """A name in small letters, without articles, in the words that hcbench uses."""
    words = re.sub(r"\b(the|an?)\b", " ", name.lower())
    words = " ".join(words.split())
    for other, same in _SAME.items():
        words = re.sub(rf"\b{re.escape(other)}\b", same, words)
    return words


def _unknown(name: str, wanted: str) -> UserError:
    """The error for a name of no material, with the nearest names.

    name: as the user wrote it.
    wanted: the same by `_plain`.
    """
    names = Materials(_known()).names
    parts = set(re.findall(r"\w+", wanted)) - {"on", "ball"}

    def nearness(known: str) -> tuple[int, float]:
        """Nearness of a known name: words that it shares, then likeness of letters, 0 to 1."""
        shared = parts & set(re.findall(r"\w+", known.lower()))
        return len(shared), SequenceMatcher(None, wanted, known.lower()).ratio()

    nearest = sorted(names, key=nearness, reverse=True)[:_NEAREST]
    advice = "`hcbench materials` lists them; `hcbench fit drop.wav` measures yours"
    if _FEET.search(wanted):
        advice = (
            "No e of a robot's foot is published: `hcbench fit` finds it from a recording,"
            " `hcbench land` drops your model"
        )
    expected = "one of: " + ", ".join(f"'{each}'" for each in nearest)
    return UserError("material", f"{sanitized(name, 60)!r} is not known", expected, advice)


def read_material(path: Path) -> MaterialPair:
    """The material of a file that `hcbench materials NAME --json` or `fit --write-material` wrote.

    Raises UserError for a file that cannot be read or is not such a file, with the key that is
    wrong.
    """
    try:
        content = parse_json(read_text(path))
    except OSError as error:
        raise UserError("material", f"{path}: {error.strerror}", "a file") from None
    except ValueError:
        raise UserError("material", f"{path} is not JSON", "a material.json") from None
    if not isinstance(content, dict) or content.get("kind") != KIND:
        advice = "`hcbench materials NAME --json` writes one"
        raise UserError("material", f"{path} is not a material", f"the kind {KIND!r}", advice)
    content.pop(MARK_KEY, None)
    return validate(MaterialPair, content, UserError, f"{path}: {{}}")


def as_record(material: MaterialPair) -> dict[str, Any]:
    """The material for JSON, as a material.json has it."""
    record: dict[str, Any] = material.model_dump(mode="json", by_alias=True)
    return record


def as_text(found: Sequence[MaterialPair]) -> str:
    """Measurements in full, for a terminal: a block of lines for each, with a row for every field
    that it states.

    found: measurements, one or more; blocks are apart by an empty line.
    """
    blocks = []
    for each in found:
        # Heads of the rows, and their values; those with "" are left out.
        rows = {
            each.name: f"{each.numbers} {each.at}",
            "bodies": " on ".join(each.bodies) + (f", {each.size}" if each.size else ""),
            "points": ", ".join(f"{v:g}:{e:g}" for v, e in each.points),
            "interval": each.uncertainty,
            "friction": each.friction,
            "measured": each.measured,
            "source": each.source.document,
            "place": each.source.place,
            "read at": f"{each.source.read_at} ({LEVELS[each.source.level]})",
            "note": each.note,
            "name": each.id,
        }
        width = max(len(row) for row, value in rows.items() if value)
        lines = [f"{row:<{width}}  {value}" for row, value in rows.items() if value]
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)
