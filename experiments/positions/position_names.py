"""Positions by what statements call them, and the goals of motions."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from .position import FileReading, SourceFile


@dataclass
class PositionNames:
    """`word` is a name with its index. `keys` are names in the backup by those of statements, `scope` is
    whose they are, if not of a file alone."""

    word: re.Pattern[str]
    keys: dict[str, list[str]] = field(default_factory=dict)
    scope: str | None = None
    arrays: dict[str, list[str]] = field(default_factory=dict)  # by their names without an index

    def plain(self, name: str) -> str:
        """A name without blanks, in small letters."""
        return re.sub(r"\s", "", name).lower()

    def store(self, name: str, *keys: str) -> None:
        """A name of positions that are in the backup."""
        plain = self.plain(name)
        self.keys.setdefault(plain, []).extend(keys)
        self.arrays.setdefault(stem_of(plain), []).extend(keys)

    def of(self, file: SourceFile, name: str) -> list[str]:
        """Those of a name, which may be stored elsewhere."""
        return self.keys.get(
            self.plain(name), [f"{file.name if self.scope is None else self.scope}:{self.plain(name)}"]
        )

    def elements(self, text: str) -> list[str] | None:
        """Those of an array, in the backup, of which a name has no index, or a variable for it; None of
        another name."""
        name, index = self.plain(text), re.search(r"[\[(].*", text, re.DOTALL)
        if name in self.keys or (index is not None and re.fullmatch(r".[\d,\s]+.", index[0])):
            return None
        return sorted(self.arrays.get(stem_of(name), ()))

    def goals(self, here: FileReading, pos: int, text: str) -> list[str]:
        """Those of a goal; of an array whose index is a variable all its elements."""
        if self.word.fullmatch(text) is None:
            here.computed(pos, text)
            here.reading.added |= {
                key for word in self.stored_in(text) for key in self.keys.get(self.plain(word), ())
            }
            return []
        elements = self.elements(text)
        if elements is None or not re.search(r"[\[(]", text):
            return self.of(here.file, text)
        here.computed(pos, text)
        return elements

    def changed(self, here: FileReading, pos: int, text: str) -> None:
        """A statement changes the position of this name when the program runs."""
        if re.search(r"[\[(]", text) and self.elements(text):
            return here.refuse(pos, f"{text}: which position is overwritten is not known before it runs")
        for each in self.of(here.file, text):
            here.overwrites(pos, each, text)
        return None

    def used(self, here: FileReading, pos: int, text: str) -> None:
        """A statement that is no motion has these names."""
        for word in self.stored_in(text):
            keys = self.elements(word) or self.of(here.file, word)
            here.doubt(pos, "call", f"{word} is used by this statement", keys[0])

    def stored_in(self, text: str) -> list[str]:
        """The names of positions of the backup that are in a text, or of arrays of them."""
        words = []
        for word in self.word.findall(text):
            if self.keys.get(self.plain(word)) or self.elements(word):
                words.append(word)
            elif inner := re.search(r"[\[(].*", word, re.DOTALL):
                words += self.stored_in(inner[0][1:])
        return words


def stem_of(name: str) -> str:
    """That of an array, without an index."""
    return re.split(r"[\[(]", name)[0]


class SharedNames(PositionNames):
    """Names that belong to all files: what is stored nowhere has its own."""

    def of(self, file: SourceFile, name: str) -> list[str]:
        return self.keys.get(self.plain(name), [self.plain(name)])
