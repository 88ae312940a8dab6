"""Which commands the page may have carried out, and with which options: paths stay below the folder; and
which runs were started by them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from ...experiments.command_options import (
    AddOptions,
    BackupOptions,
    CompareOptions,
    ExportOptions,
    HistoryPageOptions,
    ImportOptions,
    ProgramMotion,
    VerifyOptions,
    ZeroOptions,
)
from ...experiments.makers.known_logs import known_logs, read_log
from ...experiments.makers.maker import makers, plan_programs
from ...experiments.measuring_options import PlanOptions, RunOptions
from ...experiments.rigs.at_rest import SCHEMES, parse_address
from ...model.errors import BadInput
from ...model.files.run import is_run_name
from ...model.files.whole_file import write_whole
from ...model.options import AnalyseOptions, Option, OptionField, options_of
from ...model.records import read, record, to_json
from .index import Folder
from .requests import at_key

# values: it may be stated several times; held out: so may this one, as names or as a file that is read
Kind = Literal["read", "write", "value", "values", "held out", "flag"]


def kind_of(one: OptionField) -> Kind:
    if one.option.names is not None:
        return "write" if one.option.names == "write" else "held out"
    if one.box:
        return "flag"
    if Path in one.kinds:
        return "read"
    return "values" if one.several else "value"


_OUT = OptionField("out", str, None, Option("What is written.", names="write"))


def _options(*sources: Callable[..., object], out: bool = True) -> dict[str, OptionField]:
    """The options that the app may state, of records and functions; `out`: a file is written."""
    options = {"--out": _OUT} if out else {}
    for one in (each for source in sources for each in options_of(source)):
        if one.option.app and not one.option.argument:
            options |= dict.fromkeys(one.long_flags, one)
    return options


RIGS = ("simulated", "manual", "abb")
# By the words of a command: how many files it reads, and its options. `--force` is none of them: a job
# replaces nothing but an earlier report or comparison; nor is `--yes`: a person answers before a real arm
# moves.
ALLOWED: Mapping[tuple[str, ...], tuple[int, Mapping[str, OptionField]]] = {
    **{("plan", kind): (0, _options(PlanOptions)) for kind in ("x", "y", "optimal")},
    ("plan", "verify"): (1, _options(PlanOptions)),
    ("verify",): (2, _options(VerifyOptions)),
    ("analyse",): (1, _options(AnalyseOptions, out=False)),
    ("report",): (1, _options(AnalyseOptions)),
    ("compare",): (2, _options(CompareOptions)),
    ("history", "add"): (1, _options(AddOptions, out=False)),
    ("history", "report"): (0, _options(HistoryPageOptions)),
    ("run",): (1, _options(RunOptions)),
    **{
        ("import", reader.name): (1, _options(ImportOptions, reader.read))
        for maker in makers()
        for reader in maker.read
    },
    **{("import", "log", log.name): (1, _options(ImportOptions, read_log)) for log in known_logs()},
    **{
        ("export", kind.name): (1, _options(ExportOptions, kind.text))
        for maker in makers()
        for kind in maker.offsets
    },
    ("positions", "show"): (1, {}),
    ("positions", "keep"): (1, _options(ZeroOptions, BackupOptions)),
    **{
        ("export", "plan", form): (1, _options(ProgramMotion))
        for form in (*(program.name for program, _ in plan_programs()), "pdf")
    },
}
_SHORT = {"-o": "--out"}
_SEVERAL = {("compare",), ("import",), ("history", "add")}  # read that many files or more
_NAMED = {("history", "report")}  # their one word is a name, and no file; behind `--` it may begin with -
_WITHIN = {"history": "--db"}  # what must be named, so that it is in the folder
_Option = tuple[str, str | None]  # as it is called in full, and its value; None: it takes none


def job_command(folder: Folder, words: Sequence[str]) -> list[str]:
    """The words of a command as they are to be carried out in the folder; BadInput for what may not be.

    Options are written as one word, files that are read come last, and the answer is asked for as JSON.
    """
    if any("\0" in word or len(word) > 1000 for word in words):
        raise BadInput("a word of the command cannot be used")
    for name, (files, options) in ALLOWED.items():
        if tuple(words[: len(name)]) == name:
            return _checked(folder, name, files, options, words[len(name) :])
    raise BadInput(
        "the app does not carry out this command",
        found=" ".join(words)[:100],
        allowed="; ".join(" ".join(name) for name in ALLOWED),
        remedy="use the command line",
    )


def _checked(
    folder: Folder, name: tuple[str, ...], files: int, options: Mapping[str, OptionField], rest: Sequence[str]
) -> list[str]:
    called = " ".join(name)
    options_typed, words = _parsed(called, options, rest, ended=name in _NAMED)
    _require_once(called, options, options_typed)
    options_typed = [(key, _value(folder, key, options[key], value)) for key, value in options_typed]
    values = dict(options_typed)
    if (rig := values.get("--rig") or RIGS[0]) not in RIGS:
        _require_live(rig)
    names, read = (words, []) if name in _NAMED else ([], words)
    several = any(name[: len(prefix)] == prefix for prefix in _SEVERAL)
    if len(read) < files or (len(read) > files and not several) or len(names) > 1:
        raise BadInput(f"{called} reads another number of files", found=len(read), allowed=files)
    if "--out" in options and "--out" not in values:
        raise BadInput(f"{called} writes a file, and none is named", remedy="add --out")
    needed = _WITHIN.get(name[0])
    if needed is not None and needed not in values:
        raise BadInput(f"{called} needs a file in the app's folder", remedy=f"add {needed}")
    # A name of an import that is no file may stand for several.
    read = [folder.called(folder.file(word)) if name[0] == "import" else _file(folder, word) for word in read]
    made = [*name, *(key if value is None else f"{key}={value}" for key, value in options_typed)]
    if name == ("run",):
        made += ["--json-lines", "--scene"]
    elif name[0] != "import" and name[:2] != ("export", "plan"):
        made.append("--json")
    return [*made, "--", *names, *read] if words else made


def _require_live(rig: str) -> None:
    """BadInput unless a rig is the address of a controller whose joints are read."""
    if "://" in rig:
        parse_address(rig)
        return
    raise BadInput(
        "the app does not carry out this command",
        found=f"--rig {rig}",
        allowed=", ".join(f"--rig {name}" for name in (*RIGS, *(f"{name}://HOST" for name in SCHEMES))),
        remedy="use the command line",
    )


def _parsed(
    called: str, options: Mapping[str, OptionField], rest: Sequence[str], *, ended: bool
) -> tuple[list[_Option], list[str]]:
    """The options of a command and its other words. `ended`: behind `--` no word is an option."""
    options_typed: list[_Option] = []
    words: list[str] = []
    left = list(rest)
    while left:
        word = left.pop(0)
        if ended and word == "--":
            return options_typed, words + left
        if not word.startswith("-"):
            words.append(word)
            continue
        key, joined, value = word.partition("=")
        key = _SHORT.get(key, key)
        if key not in options:
            raise BadInput(f"{called} has no such option in the app", found=key, allowed=", ".join(options))
        kind = kind_of(options[key])
        if kind == "flag" and joined:
            raise BadInput(f"{key} takes no value", found=value)
        if kind != "flag" and not joined:
            if not left:
                raise BadInput(f"{key} takes a value")
            value = left.pop(0)
        options_typed.append((key, None if kind == "flag" else value))
    return options_typed, words


def _require_once(called: str, options: Mapping[str, OptionField], options_typed: Sequence[_Option]) -> None:
    """Of an option that stands twice one is carried out; that the other one was checked is worth nothing."""
    keys = [key for key, _ in options_typed if kind_of(options[key]) not in ("values", "held out")]
    for key in keys:
        if keys.count(key) > 1:
            raise BadInput(f"{key} of {called} is stated twice", allowed=f"{key} once")


def _value(folder: Folder, key: str, one: OptionField, value: str | None) -> str | None:
    """Refused, at the option, where it cannot have this value."""
    if value is None:
        return None
    kind = kind_of(one)
    with at_key("command", key):
        if kind in ("read", "write") or (kind == "held out" and is_run_name(value)):
            return _file(folder, value)
        one.require_typed(value)
    return value


def _file(folder: Folder, name: str) -> str:
    """The file as it is called from the folder, symbolic links followed."""
    return folder.called(folder.inside(name))


# Which runs the app has started, and by which command: so that they can be resumed after the server's end.
#
# It is kept in the folder, `.zerobeam/runs.json`. What was measured is in the run files alone.

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
