"""The pages of the documentation and their blocks.

A fenced block with `title="name"` is a file of that name. A block of `sh` or `console` whose first command is
`zerobeam` is run, in the order of its page, in a folder with that page's files; each command must end with
status 0, or with the one that the fence states (`status=1`). In a `console` block commands stand behind `$ `
and below each is what it prints; `…` alone stands for lines left out. A block whose first line is
`# not run: why` is for a reader only: it is told, and its commands are still held against the command line.
What a program prints stands in a block `text output` below it.
"""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = {
    path.relative_to(ROOT).as_posix(): path for path in [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
}
# The pages that state the keys of all files.
FILE_PAGES = [name for name in PAGES if re.fullmatch(r"docs/files(-\w+)?\.md", name)]
NOT_RUN = "# not run: "


class Command(NamedTuple):
    """Words of a command, `zerobeam` first, and the lines that it is to print (none stated: None)."""

    words: list[str]
    printed: list[str] | None

    @property
    def text(self) -> str:
        return shlex.join(self.words)


class Block(NamedTuple):
    """A fenced block: `title` of the file that it is, `status` that its commands end with."""

    language: str
    title: str | None
    status: int
    text: str

    @property
    def not_run(self) -> bool:
        return self.text.startswith(NOT_RUN)

    @property
    def commands(self) -> list[Command]:
        """Each `zerobeam …` of a block of commands that is to be run; none for other blocks."""
        if self.language not in ("sh", "console") or self.not_run:
            return []
        if self.language == "console":
            return list(_transcript(self.text))
        lines = [shlex.split(line, comments=True) for line in joined(self.text)]
        found = [Command(words, None) for words in lines if words]
        return found if found and found[0].words[0] == "zerobeam" else []


def joined(text: str) -> list[str]:
    """The lines of a text, those that end with a backslash put together."""
    return text.replace("\\\n", " ").splitlines()


def _transcript(text: str) -> Iterator[Command]:
    for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
        first, *printed = joined(part)
        yield Command(shlex.split(first), printed)


def read(name: str) -> str:
    return PAGES[name].read_text(encoding="utf-8")


def blocks(text: str) -> list[Block]:
    found = []
    for fence, body in re.findall(r"^```(\S[^\n]*)\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL):
        title = re.search(r'title="([^"]+)"', fence)
        status = re.search(r"status=(\d+)", fence)
        language = "text output" if fence == "text output" else fence.split()[0]
        found.append(Block(language, title and title.group(1), int(status.group(1)) if status else 0, body))
    return found


def prose(text: str) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


# Lines that are no sentences: tables, headings, pictures, marks, indented commands.
_NO_SENTENCE = re.compile(r"\s*(?:\||#+ |!\[|<!--)|    ")
_ENDS = re.compile(r"(?<=[.!?])[)\"*]*\s+(?=[A-Z0-9*(\[`\"“$χδθΩ])")
_ITEM = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )")


def words(text: str) -> int:
    """How many words: what has a letter."""
    return sum(any(letter.isalpha() for letter in word) for word in text.split())


def sentences(text: str) -> list[str]:
    """The sentences of a page outside blocks, tables, headings and equations. The text of a link counts and
    its address does not; code is one word."""
    text = re.sub(r"\$\$.*?\$\$", "", prose(text), flags=re.DOTALL)
    text = re.sub(r"\]\([^)\s]*\)", "]", text)
    text = re.sub(r"`[^`\n]+`", "`code`", text)
    paragraphs = (
        " ".join(line.strip() for line in part.splitlines() if not _NO_SENTENCE.match(line))
        for part in _ITEM.split(text)
    )
    return [one for part in paragraphs for one in _ENDS.split(part) if words(one)]


def prepare(text: str, folder: Path) -> list[Path]:
    """Write the files that a page states; their paths."""
    paths = []
    for block in blocks(text):
        if block.title is not None:
            path = folder / block.title
            assert path.parent == folder
            assert not path.exists(), f"{block.title} stands twice"
            path.write_text(block.text, encoding="utf-8")
            paths.append(path)
    return paths


def told_commands(text: str) -> Iterator[list[str]]:
    """Every `zerobeam …` line in a block, fenced or indented, run or not; `…` in it left out."""
    indented = re.findall(r"^    (.+)$", prose(text), flags=re.MULTILINE)
    fenced = [block.text for block in blocks(text) if block.language in ("sh", "console")]
    for line in [*indented, *(line for part in fenced for line in joined(part))]:
        call = re.match(r"(?:\$ )?(?:[A-Z_]+=\S+ )*(?:\.venv[/\\]\w+[/\\])?zerobeam( .*)?$", line)
        if call:
            words = shlex.split(call.group(1) or "", comments=True)
            yield [word for word in words if word != "…"]
