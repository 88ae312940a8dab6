"""Foreign text made fit to be shown: names in a run may hold anything, and no text in a table is taken for a
formula.

HTML and typst take text as data, so markup in a name does no harm there. What is left is what a
person would not see: control characters, marks that turn the reading direction, letters that the
report's font lacks. They are written as visible escapes.
"""

from __future__ import annotations

import csv
import io
import re
import shlex
import unicodedata
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence, Sized
from typing import Literal

Namer = Callable[[str], str]  # writes the name of a parameter or target: `str` in files, `label` for people

NAME_WIDTH = 32
LONGEST_WORD = 60

# Cc control, Cs lone surrogates, Cn unassigned, Zl and Zp separators: nothing to see in any font.
_UNSEEN = {"Cc", "Cs", "Cn", "Zl", "Zp"}
_PERHAPS = re.compile(r"[^\n -~]")
_TURNING = frozenset("\u061c\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")


_OFFSET = re.compile(r"delta(\d+)")
_GEOMETRY = re.compile(r"(link|joint)(\d+)\.(a|b|d|alpha|beta|theta|gravity|cos|sin)")
_GREEK = {"alpha": "α", "beta": "β", "theta": "θ", "cos": "cos q", "sin": "sin q"}

NOT_DETERMINED = "not determined by these data"
WEAK = "weakly observable"


def status_words(status: str) -> str:
    """A status, or the verdict of that name, as people read it."""
    return WEAK if status == "weak" else status


def shown(text: str) -> str:
    """`text` with what cannot be seen written out (`\\x00`, `\\u202e`); line breaks become spaces."""
    return visible(re.sub(r"[\r\n\t]+", " ", text))


def path_argument(name: str, stand_in: str = "FILE") -> str:
    """The path of a file as it is typed in a command: what a shell would read is quoted, and it is no option;
    `stand_in` for one with letters that cannot be seen."""
    if shown(name) != name:
        return stand_in
    return shlex.quote(f"./{name}" if name.startswith("-") else name)


def visible(text: str, escape: Callable[[str], str] | None = None) -> str:
    """`text` with what cannot be seen, but for line breaks, as `escape` writes it (default: `escaped`)."""
    write = escape or escaped

    def one(match: re.Match[str]) -> str:
        letter = match.group()
        return write(letter) if letter in _TURNING or unicodedata.category(letter) in _UNSEEN else letter

    return _PERHAPS.sub(one, text)


def clipped(name: str, width: int = NAME_WIDTH) -> str:
    """A name as `shown`, at most `width` letters: the middle of a longer one gives way to an ellipsis."""
    name = shown(name)
    if len(name) <= width:
        return name
    head = (width - 1) * 2 // 3
    return f"{name[:head]}…{name[len(name) - (width - 1 - head) :]}"


def label(name: str, width: int = NAME_WIDTH) -> str:
    """A parameter's name as people write it: `delta2` is J2 (δ2), `link2.alpha` is link 2, α; others stay as
    they are."""
    if match := _OFFSET.fullmatch(name):
        return f"J{match.group(1)} (δ{match.group(1)})"
    if match := _GEOMETRY.fullmatch(name):
        body, number, axis = match.groups()
        return f"{'link ' if body == 'link' else 'J'}{number}, {_GREEK.get(axis, axis)}"
    return clipped(name, width)


def person(name: str) -> str:
    """A parameter or target in a sentence for people."""
    return label(name)


def sentence(text: str) -> str:
    """A sentence that holds foreign text, made fit to be shown; endless words clipped."""
    words = re.sub(
        rf"\S{{{LONGEST_WORD + 1},}}", lambda word: clipped(word.group(), LONGEST_WORD), shown(text)
    )
    return re.sub(r"(?<=\d) %", "\u00a0%", words)


def capital(text: str) -> str:
    """`text` with a capital at its beginning."""
    return f"{text[:1].upper()}{text[1:]}"


def ended(text: str) -> str:
    """`text` with a full stop, unless it ends as a sentence does."""
    return text if text.endswith((".", "?", "!")) else f"{text}."


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def be(subjects: Sized) -> str:
    """`is` of one, `are` of several."""
    return "is" if len(subjects) == 1 else "are"


def are(names: Collection[str], name: Namer) -> str:
    """The names with their verb: `J2 (δ2) and J3 (δ3) are`."""
    return f"{listed(list(map(name, names)))} {be(names)}"


def listed(names: list[str], most: int = 8, last: Literal["and", "or"] = "and") -> str:
    """`a, b and c`; of more than `most` names the first and how many more."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def joints(names: Sequence[str], name: Namer = person) -> list[str]:
    """The names of parameters, in their order; of offsets for a `person` the joints alone, three and more
    in a row as `J2 to J5`.

    >>> joints(["delta2", "delta3", "delta4", "delta6"])
    ['J2 to J4', 'J6']
    """
    numbers = [int(match.group(1)) if (match := _OFFSET.fullmatch(each)) else None for each in names]
    if name is not person or None in numbers:
        return list(map(name, names))
    rows: list[list[int]] = []
    for number in (each for each in numbers if each is not None):
        if rows and number == rows[-1][-1] + 1:
            rows[-1].append(number)
        else:
            rows.append([number])
    return [
        text
        for row in rows
        for text in ([f"J{row[0]} to J{row[-1]}"] if len(row) > 2 else [f"J{number}" for number in row])
    ]


def escaped(letter: str) -> str:
    code = ord(letter)
    if code <= 0xFF:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"


def measured_at(names: Collection[str], instruments: Collection[str]) -> str:
    """What measurements of these `names` belong to: a target, or one of the `instruments` that has none."""
    targets, stations = _apart(names, instruments)
    return " or ".join(filter(None, ("target" * bool(targets), "instrument" * bool(stations))))


def places_counted(names: Collection[str], instruments: Collection[str]) -> str:
    """How many targets, and instruments that have none, are among the `names`."""
    targets, stations = _apart(names, instruments)
    parts = [
        f"one {noun}" if count == 1 else f"{count} {noun}s"
        for noun, count in (("target", targets), ("instrument", stations))
        if count
    ]
    return " and ".join(parts)


def _apart(names: Collection[str], instruments: Collection[str]) -> tuple[int, int]:
    every = set(names)
    stations = len(every & set(instruments))
    return len(every) - stations, stations


def again_words(posture: int | None) -> str:
    """What follows the name of what is measured where it is measured in that posture once more; empty where
    it is new."""
    return "" if posture is None else f", posture {posture} again"


Row = Mapping[str, object]

_FORMULA = ("=", "+", "-", "@")  # what a cell begins with that a spreadsheet evaluates


def csv_text(rows: Iterable[Row]) -> str:
    """Rows with the same keys as CSV with a header; what is not known is an empty cell."""
    return "".join(csv_lines(rows))


def csv_lines(rows: Iterable[Row]) -> Iterator[str]:
    """The same line by line, as the rows come."""
    names: list[str] = []
    for row in rows:
        if not names:
            names = list(row)
            yield _line(names)
        yield _line(row[name] for name in names)


def _line(cells: Iterable[object]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(map(_cell, cells))
    return out.getvalue()


def _cell(value: object) -> object:
    """Text on one line; an apostrophe before it keeps a spreadsheet from evaluating it. Numbers stay."""
    if not isinstance(value, str):
        return value
    text = shown(value)
    return f"'{text}" if text.lstrip().startswith(_FORMULA) else text
