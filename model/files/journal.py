"""Files that grow by a line at a time and can be gone on with after a stop at any instant: runs, and whatever
else is finished piece by piece."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from io import FileIO
from pathlib import Path
from typing import Self

import numpy as np

from ...interruption import uninterrupted
from ..errors import BadInput, NotWritten, RigFault
from ..parsing.confinement import require_within
from ..parsing.reading import shown
from .header import RUN_SCHEMA, Header, check_header, header_content
from .robot_file import load_robot
from .run import Run, header_text, recorded, shot_text
from .shot import Shot, ShotRules
from .whole_file import Closing, lock, refuse_existing, sync_folder, write_whole

RunCheck = Callable[[Run], None]  # raises BadInput for a recording that must not be gone on with


class LineJournal(Closing):
    """A file of lines, each on the disk before `write` returns, whole or taken back.

    One process at a time may write to it: the lock is the system's and goes with the process, however that
    ends. `path` must be there. BadInput `busy` where another process has it; where the system fails, the file
    is closed and what `failed` makes of the error is raised.
    """

    def __init__(self, path: Path, busy: BadInput, failed: Callable[[OSError], Exception]) -> None:
        self.path, self._failed = path, failed
        try:
            self._file = FileIO(path, "r+")
        except OSError as error:
            raise NotWritten(f"the file cannot be written to: {error.strerror}", file=path) from None
        with self.closed_on_failure():
            if not lock(self._file):
                raise busy
            self.content = self._file.readall()
            self._end = len(self.content)

    @property
    def closed(self) -> bool:
        return self._file.closed

    @property
    def end(self) -> int:
        """How long the file is, bytes."""
        return self._end

    def cut(self, length: int) -> None:
        """Leave only so many bytes of it, and go on behind them."""
        with self.closed_on_failure():
            self._file.truncate(length)
            self._end = self._file.seek(length)

    def write(self, text: str) -> None:
        """Text at the end of the file, brought to the disk whole or taken back."""
        rest = content = text.encode("utf-8")
        with uninterrupted(), self.closed_on_failure():
            try:
                while rest:
                    rest = rest[self._file.write(rest) :]
                os.fsync(self._file.fileno())
            except BaseException:
                # What is left of the line would spoil the file for whatever came after it.
                with contextlib.suppress(OSError):
                    self._file.truncate(self._end)
                raise
        self._end += len(content)

    def blank(self, start: int, length: int) -> None:
        """Blanks in place of so many bytes, at once; all others stay as they are."""
        with uninterrupted(), self.closed_on_failure():
            self._file.seek(start)
            self._file.write(b" " * length)
            os.fsync(self._file.fileno())
            self._file.seek(self._end)

    @contextlib.contextmanager
    def closed_on_failure(self) -> Iterator[None]:
        """Close the file if what is done with it fails; raise a failure of the system as `failed` says."""
        try:
            yield
        except BaseException as error:
            with contextlib.suppress(OSError):
                self.close()
            if isinstance(error, OSError):
                raise self._failed(error) from error
            raise

    def close(self) -> None:
        """Let others write to the file; nothing happens the second time."""
        self._file.close()


class RunJournal(Closing):
    """A run file that grows measurement by measurement; each is on the disk before `append` returns.

    `RunJournal(path, header)` makes a new file, which gets its name once the whole header is on the
    disk, and never writes into or over another; `RunJournal.resumed` goes on with one. Joints outside
    their limits are recorded as they are: what happened, happened; `read_run` judges them, and so does
    `resumed`.
    """

    def __init__(self, path: Path | str, header: Header) -> None:
        path = Path(path)
        refuse_existing(path, or_else="go on with it (--resume)")
        check_header(header, load_robot(header.robot, path.parent), file=None, line=lambda _: None)
        write_whole(path, header_text(header))
        self._open(path, header)

    @classmethod
    def resumed(cls, path: Path | str, header: Header, fits: RunCheck | None = None) -> Self:
        """Go on with a run file that was begun with the same header, even if it has no shot yet.

        A torn last line is taken out, and `torn` is a sentence that says so. BadInput, and the file is
        left as it is, if it is not there, cannot be read, has another header or is being recorded to, or
        if `fits` raises it.
        """
        journal = cls.__new__(cls)
        journal._open(Path(path), header, fits)
        return journal

    @property
    def shots(self) -> tuple[Shot, ...]:
        """All measurements on the disk, in the order of the file."""
        return tuple(self._shots.values())

    def append(self, shot: Shot) -> None:
        """Record one measurement; RigFault if it cannot be brought to the disk."""
        if self._lines.closed:
            raise RigFault(f"{self.path}: the run is closed, measurement {shot.shot} was not recorded")
        self._rules.check(shot, file=self.path, line=None)
        if shot.posture is not None:
            same = [other for other in self.shots if other.posture == shot.posture]
            self._rules.check_postures([*same, shot], [None] * (len(same) + 1), file=self.path)
        if shot.shot in self._shots:
            raise BadInput(
                f"the measurement number {shot.shot} is recorded already",
                allowed="each number once",
                file=self.path,
            )
        began, text = self._lines.end, shot_text(shot)
        self._lines.write(text)
        self._shots[shot.shot] = shot
        self._places[shot.shot] = began, len(text.encode("utf-8")) - 1

    def withdraw(self, number: int) -> None:
        """Take a measurement out: its line becomes a blank one, at once, and all others stay as they are."""
        self._lines.blank(*self._places[number])
        del self._shots[number], self._places[number]

    def _open(self, path: Path, header: Header, fits: RunCheck | None = None) -> None:
        require_within(path)
        if not path.is_file():
            raise BadInput(
                "there is no recording to go on with",
                found="not a file" if path.exists() else "no file of this name",
                remedy="correct the name, or start without --resume",
                file=path,
            )
        self.path = path
        busy = BadInput(
            "another process is recording to this file",
            remedy="wait until it has ended, or stop it",
            file=path,
        )
        self._lines = LineJournal(path, busy, self._failed)
        with self._lines.closed_on_failure():
            content = self._lines.content
            if not content.strip():
                raise BadInput("the file is empty", remedy="remove it, start without --resume", file=path)
            run, torn = recorded(content, path)
            _require_same(run.header, header, file=path, line=run.header_line)
            if fits is not None:
                fits(run)
            self.header, self.robot = run.header, run.robot
            self._rules = ShotRules(run.header, run.robot)
            self._shots = {shot.shot: shot for shot in run.shots}
            starts = np.cumsum([0, *(len(line) + 1 for line in content.split(b"\n"))])
            self._places = {
                shot.shot: (int(starts[line - 1]), int(starts[line] - starts[line - 1]) - 1)
                for shot, line in zip(run.shots, run.lines, strict=True)
                if line is not None
            }
            self.torn: str | None = None
            if torn is not None:
                self.torn = (
                    f"line {torn}, the last, was torn: it is removed, the measurements before it are kept"
                )
                content = content[: content.rstrip().rfind(b"\n") + 1]  # blank lines may follow it
                self._lines.cut(len(content))
            # Whoever recorded this may have been killed before it was on the disk.
            self._lines.write("" if content.endswith(b"\n") else "\n")
            sync_folder(path.parent)

    def _failed(self, error: OSError) -> RigFault:
        return RigFault(f"{self.path}: the run cannot be recorded: {error.strerror}")

    def close(self) -> None:
        """End the recording and let others record to the file; nothing happens the second time."""
        self._lines.close()


def _require_same(recorded: Header, required: Header, *, file: Path, line: int | None) -> None:
    """BadInput for the first key in which a recorded header is not the wanted one."""
    difference = _first_difference(
        header_content(recorded, RUN_SCHEMA),
        header_content(required, RUN_SCHEMA),
    )
    if difference:
        key, actual, allowed = difference
        raise BadInput(
            f"the recording was begun with another header: {key} differs",
            found=actual,
            allowed=allowed,
            remedy="go on with the plan, the cell and the seed that it was begun with, or start without"
            " --resume under another name",
            file=file,
            line=line,
        )


def _first_difference(one: Mapping[str, object], other: Mapping[str, object]) -> tuple[str, str, str] | None:
    """The first key that differs, such as 'noise.joint_deg', and its values as in a file."""
    for key in dict.fromkeys((*other, *one)):
        a, b = one.get(key), other.get(key)  # a stated value is never None
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            if inner := _first_difference(a, b):
                return f"{key}.{inner[0]}", *inner[1:]
        elif json.dumps(a) != json.dumps(b):  # where 1, 1.0 and true are three values
            actual, required = ("not stated" if value is None else shown(value) for value in (a, b))
            return key, actual, required
    return None
