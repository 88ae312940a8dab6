"""The finished cases of a study on the disk, so that a study that was stopped can be resumed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from ...analysis.status import versions
from ...model.arrays import Progress
from ...model.errors import BadInput, NotWritten, UnsoundResult, located
from ...model.files.journal import LineJournal
from ...model.files.whole_file import Closing
from ...model.parsing.reading import json_line, parse_json, shown
from ...model.records import read, to_json
from ..processes import side_by_side

CASES_SCHEMA = "zerobeam/study-cases/1"

Case = TypeVar("Case")
Piece = TypeVar("Piece")


class CaseStore(Closing, Generic[Case]):
    """A file of JSON lines: first what the cases are of, then a line a finished case, a dataclass `kind`.

    A torn last line, of a process that was killed, is taken out. BadInput, and the file is left as it is,
    where it is of another study, other settings or another seed, or was made by other versions: such cases do
    not belong together.
    """

    def __init__(
        self, path: Path, heading: Mapping[str, object], kind: type[Case], *, of: str = "study"
    ) -> None:
        self._path, self._of = path, of
        self._kind = kind
        self._done: dict[int, Case] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
        except OSError as error:
            raise self._failed(error) from None
        busy = BadInput(
            f"another process carries this {of} out",
            remedy=f"wait until it has ended, stop it, or name another folder for the {of}",
            file=path,
        )
        self._lines = LineJournal(path, busy, self._failed)
        with self._lines.closed_on_failure(), located(path):
            self._begin({"schema": CASES_SCHEMA, **heading})

    @property
    def done(self) -> dict[int, Case]:
        """The finished cases by their number."""
        return dict(self._done)

    def add(self, number: int, answer: Case) -> None:
        """Keep a finished case."""
        self._lines.write(json_line({"case": number, "answer": to_json(answer)}))
        self._done[number] = answer

    def close(self) -> None:
        self._lines.close()

    def _failed(self, error: OSError) -> NotWritten:
        return NotWritten(
            f"the finished cases cannot be kept: {error.strerror or error}",
            file=self._path,
            remedy="name a folder beside which files may be written",
        )

    def _begin(self, heading: Mapping[str, object]) -> None:
        content, first = self._lines.content, json_line(heading)
        whole = content[: content.rfind(b"\n") + 1]
        if whole or not first.encode().startswith(content):
            self._read(whole, heading)
            self._lines.cut(len(whole))
        else:
            # Of a process that was killed while it wrote the first line, if of any.
            self._lines.cut(0)
            self._lines.write(first)

    def _read(self, content: bytes, heading: Mapping[str, object]) -> None:
        lines = content.splitlines()
        try:
            first = parse_json(lines[0].decode(), file=self._path, line=1)
            if not isinstance(first, dict) or first.get("schema") != CASES_SCHEMA:
                raise ValueError
        except (ValueError, IndexError):
            raise BadInput(
                f"this file was not written by a {self._of}, or is spoilt",
                allowed=f"a first line of schema {CASES_SCHEMA}",
                remedy=f"move it away, or name another folder for the {self._of}",
            ) from None
        for key, value in heading.items():
            if first.get(key) != value:
                raise BadInput(
                    f"the finished cases that are kept here are of another {self._of}: {key} differs",
                    found=shown(first.get(key)),
                    allowed=shown(value),
                    remedy="resume with the same settings, remove the file to begin again, or name"
                    f" another folder for the {self._of}",
                    line=1,
                )
        for number, line in enumerate(lines[1:], start=2):
            try:
                row = parse_json(line.decode(), file=self._path, line=number)
                self._done[int(row["case"])] = read(self._kind, row["answer"])
            except (ValueError, TypeError, KeyError, UnsoundResult):
                raise BadInput(
                    "a finished case cannot be read",
                    remedy="remove the file to begin again",
                    line=number,
                ) from None


def any_kept(path: Path) -> bool:
    """Whether a store there has a finished case: a whole line behind its first."""
    return path.exists() and path.read_bytes().count(b"\n") > 1


@dataclass(frozen=True)
class Engine:
    """How a study is carried out: its `seed`, who is told of the `progress`; with a `store` finished pieces
    are kept in that file at once, and a study that was stopped goes on from there; as many `processes` as
    there are cores, or the workers of a cluster."""

    seed: int
    progress: Progress = lambda stage, share: None
    store: Path | None = None
    processes: int | None = None

    def each(
        self,
        study: str,
        kind: type[Case],
        work: Callable[[Piece], Case],
        pieces: Sequence[Piece],
        *,
        called: str = "piece",
        **settings: object,
    ) -> list[Case]:
        """The answers of all pieces: those that the store has, else worked out side by side by `work`, a
        function of a module. Kept pieces are of the same `settings`, seed and versions; `called` is the name
        of a piece in the progress."""
        heading = {"study": study, "seed": self.seed, **settings, "versions": versions()}

        def tell() -> None:
            share = len(finished) / max(len(pieces), 1)
            self.progress(f"{called} {len(finished)}/{len(pieces)}", share)

        store = contextlib.nullcontext() if self.store is None else CaseStore(self.store, heading, kind)
        with store as kept:
            finished = {} if kept is None else kept.done
            tell()
            numbers = [number for number in range(len(pieces)) if number not in finished]
            jobs = [pieces[number] for number in numbers]
            with closing(side_by_side(work, jobs, self.processes)) as answered:
                for job, answer in answered:
                    finished[numbers[job]] = answer
                    if kept is not None:
                        kept.add(numbers[job], answer)
                    tell()
        return [finished[number] for number in range(len(pieces))]
