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

    def plain(self, name: str) -> str:
        """A name without blanks, in small letters."""
        return re.sub(r"\s", "", name).lower()

    def store(self, name: str, *keys: str) -> None:
        """A name of positions that are in the backup."""
        self.keys.setdefault(self.plain(name), []).extend(keys)

    def of(self, file: SourceFile, name: str) -> list[str]:
        """Those of a name, which may be stored elsewhere."""
        return self.keys.get(
            self.plain(name), [f"{file.name if self.scope is None else self.scope}:{self.plain(name)}"]
        )

    def goals(self, here: FileReading, pos: int, text: str) -> list[str]:
        """Those of a goal; of an array whose index is a variable all its elements."""
        name = self.plain(text)
        if self.word.fullmatch(text) is None:
            here.computed(pos, text)
            here.reading.added |= {
                key for word in self.stored_in(text) for key in self.keys[self.plain(word)]
            }
            return []
        index = re.search(r"[\[(].*", name)
        if index is not None and name not in self.keys and not re.fullmatch(r".[\d,]+.", index[0]):
            here.computed(pos, text)
            stem = name[: index.start() + 1]
            return sorted(key for each, keys in self.keys.items() if each.startswith(stem) for key in keys)
        return self.of(here.file, text)

    def used(self, here: FileReading, pos: int, text: str) -> None:
        """A statement that is no motion has these names."""
        for word in self.stored_in(text):
            here.doubt(pos, "call", f"{word} is used by this statement")

    def stored_in(self, text: str) -> list[str]:
        """The names of positions of the backup that are in a text."""
        return [word for word in self.word.findall(text) if self.keys.get(self.plain(word))]


class SharedNames(PositionNames):
    """Names that belong to all files: what is stored nowhere has its own."""

    def of(self, file: SourceFile, name: str) -> list[str]:
        return self.keys.get(self.plain(name), [self.plain(name)])
