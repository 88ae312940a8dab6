"""Which runs the app has started, and by which command: so that they can be resumed after the server's end.

It is kept in the folder, `.zerobeam/runs.json`. What was measured is in the run files alone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Literal

from ...model.errors import BadInput
from ...model.files.whole_file import write_whole
from ...model.records import read, record, to_json
from .folder import Folder
from .job_commands import job_command

_FILE = "runs.json"
_SCHEMA: Literal["zerobeam/app-runs/1"] = "zerobeam/app-runs/1"
_MOST = 200  # the oldest are forgotten
_RESUME = "--resume"
_OURS = ("--json-lines", "--scene", "--")  # what the server adds to what was asked for


@record(kw_only=True, strict_keys=True)
class StartedRun:
    """A run that the app has started."""

    command: list[str]
    ended: bool


@record(kw_only=True, strict_keys=True)
class _RunsFile:
    """The content of the file, by the names of run files."""

    schema: Literal["zerobeam/app-runs/1"] = _SCHEMA
    runs: dict[str, StartedRun]


class StartedRuns:
    """By the name of the run file in the folder; `ended` ones reached their end."""

    def __init__(self, folder: Folder) -> None:
        self._folder = folder

    def command(self, file: str) -> list[str] | None:
        """The command that goes on with a run, None where the app has not started it or would not."""
        entry = self._read().get(file)
        if entry is None:
            return None
        try:
            command = job_command(self._folder, [word for word in entry.command if word not in _OURS])
        except BadInput:
            return None
        return [*command[:1], _RESUME, *(word for word in command[1:] if word not in (_RESUME, *_OURS))]

    def unfinished(self) -> list[str]:
        """Run files that are there and have not reached their end, the newest first."""
        names = [name for name, entry in self._read().items() if not entry.ended]
        return [name for name in reversed(names) if self._there(name)]

    def ended(self, file: str) -> bool:
        entry = self._read().get(file)
        return entry is not None and entry.ended

    def begin(self, command: Sequence[str]) -> None:
        """A run begins, or goes on."""
        self._put(run_file(command), StartedRun(command=list(command), ended=False))

    def end(self, command: Sequence[str]) -> None:
        """It has reached its end."""
        self._put(run_file(command), StartedRun(command=list(command), ended=True))

    def _there(self, name: str) -> bool:
        try:
            return self._folder.inside(name).is_file()
        except BadInput:
            return False

    def _read(self) -> dict[str, StartedRun]:
        """What is not as it was written counts as nothing: it only spares a person the typing."""
        try:
            content = json.loads(self._folder.private(_FILE).read_text(encoding="utf-8"))
            return read(_RunsFile, content).runs
        except (OSError, ValueError, BadInput):
            return {}

    def _put(self, name: str, entry: StartedRun) -> None:
        runs = self._read()
        runs.pop(name, None)
        runs[name] = entry
        content = to_json(_RunsFile(runs=dict(list(runs.items())[-_MOST:])))
        try:
            path = self._folder.private(_FILE)
            path.parent.mkdir(exist_ok=True)
            write_whole(path, json.dumps(content, indent=1) + "\n", force=True)
        except (OSError, BadInput):
            return  # a folder that cannot be written is said by the run itself


def run_file(command: Sequence[str]) -> str:
    """The run file that a checked command writes."""
    return next(word.removeprefix("--out=") for word in command if word.startswith("--out="))
