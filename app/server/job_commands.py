"""Which commands the page may have carried out, and with which options: paths stay below the folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from ...model.errors import BadInput
from ...model.files.validation import FileModel, as_tuple
from .begun import run_file
from .folder import Folder
from .named_files import require_named_inside


class AskedJob(FileModel):
    """A command to carry out."""

    command: Annotated[tuple[str, ...], BeforeValidator(as_tuple), Field(min_length=1, max_length=100)] = (
        Field(description="a command as it is typed after `zerobeam`, word by word")
    )
    password: str | None = Field(
        default=None, max_length=1000, repr=False, description="of an ABB controller; it is kept nowhere"
    )


class AskedLine(FileModel):
    """A line for a job that asks: joint values or a word of a run by hand, or yes or no."""

    text: str = Field(max_length=10_000, description="one line, or several")


Kind = Literal["read", "write", "value", "flag"]

_ANALYSE: dict[str, Kind] = {"--seed": "value", "--ess": "value", "--robust": "value", "--hold-out": "value"}
_EXPORT: dict[str, Kind] = {
    "--out": "write",
    "--allow-weak": "flag",
    "--allow-displaced": "flag",
    "--unvalidated": "flag",
    "--without": "value",
}
_PLAN: dict[str, Kind] = {
    "--out": "write",
    "--header": "read",
    "--obstacles": "read",
    **dict.fromkeys(
        (
            "--target",
            "--shots",
            "--candidates",
            "--criterion",
            "--tolerance",
            "--max-shots",
            "--facing",
            "--acceptance",
            "--beam",
            "--margin",
            "--seed",
        ),
        "value",
    ),
}
RIGS = ("simulated", "manual", "abb")
_IMPORT: dict[str, Kind] = {
    "--out": "write",
    "--header": "read",
    "--plan": "read",
    "--target": "value",
    "--dry-run": "flag",
}
_POINTS: dict[str, Kind] = {**_IMPORT, "--points": "value"}
_DWELLS: dict[str, Kind] = {
    **_IMPORT,
    **dict.fromkeys(("--still-deg", "--still-s", "--still-mm"), "value"),
}
_TABLES: dict[str, Kind] = {
    **_DWELLS,
    **dict.fromkeys(("--delimiter", "--decimal", "--marker-column"), "value"),
}
_CSV: dict[str, Kind] = {
    **_TABLES,
    **dict.fromkeys(("--header-row", "--small-angles"), "flag"),
    **dict.fromkeys(
        (
            "--units",
            "--lengths",
            "--columns",
            "--reversed",
            "--j3",
            "--target-column",
            "--spot-columns",
            "--shot-column",
            "--time-column",
            "--time-units",
        ),
        "value",
    ),
}
# By the words of a command: how many files it reads, and its options. `--force` is none of them: a job
# replaces nothing but an earlier report or comparison; nor is `--yes`: a person answers before a real arm
# moves.
ALLOWED: Mapping[tuple[str, ...], tuple[int, Mapping[str, Kind]]] = {
    ("plan", "x"): (0, _PLAN),
    ("plan", "y"): (0, _PLAN),
    ("plan", "optimal"): (0, _PLAN),
    ("plan", "verify"): (
        1,
        {"--out": "write", "--shots": "value", "--tolerance": "value", "--seed": "value"},
    ),
    ("analyse",): (1, _ANALYSE),
    ("report",): (1, {"--out": "write", **_ANALYSE}),
    ("compare",): (2, {"--out": "write", "--seed": "value"}),
    ("history", "add"): (1, {"--db": "write", "--replace": "flag"}),
    ("history", "report"): (
        0,
        {
            "--out": "write",
            "--db": "write",
            **dict.fromkeys(("--tolerance-mm", "--as-of", "--model"), "value"),
        },
    ),
    ("run",): (
        1,
        {
            "--out": "write",
            "--rig": "value",
            "--cell": "read",
            "--camera": "flag",
            "--no-camera": "flag",
            "--resume": "flag",
            "--adaptive": "flag",
            "--tolerance": "value",
            "--closing": "flag",
            "--seed": "value",
            "--sensors": "read",
            **dict.fromkeys(
                (
                    "--host",
                    "--port",
                    "--egm-port",
                    "--sensor-port",
                    "--user",
                    "--speed",
                    "--laser",
                    "--units",
                    "--j3",
                ),
                "value",
            ),
        },
    ),
    ("import", "csv"): (1, _CSV),
    **{("import", "log", kind): (1, {**_TABLES, "--j3": "value"}) for kind in ("ur", "egm", "robodk")},
    ("import", "ros"): (
        1,
        {**_DWELLS, **dict.fromkeys(("--columns", "--topic", "--marker-topic"), "value")},
    ),
    ("import", "rapid"): (1, {**_POINTS, "--tool": "value", "--frame": "value"}),
    ("import", "kuka"): (1, _POINTS),
    ("import", "fanuc"): (1, {**_POINTS, "--j3": "value", "--register": "value"}),
    ("import", "universal-robots"): (1, _IMPORT),
    ("import", "robodk"): (1, {**_IMPORT, "--j3": "value"}),
    **{("export", form): (1, _EXPORT) for form in ("robot", "urdf", "rapid", "ur", "kuka", "json", "csv")},
    **{
        ("export", "plan", form): (
            1,
            {
                "--out": "write",
                **dict.fromkeys(("--speed", "--zone", "--tool", "--j3", "--register"), "value"),
            },
        )
        for form in ("rapid", "urscript", "krl", "fanuc", "robodk", "ros", "csv", "pdf")
    },
}
_SHORT = {"-o": "--out"}
_SEVERAL = {("compare",), ("import",), ("history", "add")}  # read that many files or more
_NAMED = {("history", "report")}  # their one word is a name, and no file; behind `--` it may begin with -
_WITHIN = {"history": "--db"}  # what must be named, so that it is in the folder


def job_command(folder: Folder, words: Sequence[str]) -> list[str]:
    """The words of a command as they are to be carried out in the folder; BadInput for what may not be.

    Options are written as one word, files that are read come last, and the answer is asked for as JSON.
    """
    if any("\0" in word or len(word) > 1000 for word in words):
        raise BadInput("a word of the command cannot be used")
    for name, (files, options) in ALLOWED.items():
        if tuple(words[: len(name)]) == name:
            return _checked(folder, name, files, options, list(words[len(name) :]))
    raise BadInput(
        "the app does not carry out this command",
        found=" ".join(words)[:100],
        allowed="; ".join(" ".join(name) for name in ALLOWED),
        remedy="use the command line",
    )


def _checked(
    folder: Folder, name: tuple[str, ...], files: int, options: Mapping[str, Kind], rest: list[str]
) -> list[str]:
    called, stated = " ".join(name), list(name)
    read: list[str] = []
    named: list[str] = []
    names: list[str] = []
    rig = "simulated"
    while rest:
        word = rest.pop(0)
        if name in _NAMED and (word == "--" or not word.startswith("-")):
            names += [word] if word != "--" else rest
            if word == "--":
                break
            continue
        if not word.startswith("-"):
            read.append(_file(folder, word) if name[0] != "import" else folder.called(folder.file(word)))
            continue
        key, joined, value = word.partition("=")
        key = _SHORT.get(key, key)
        kind = options.get(key)
        if kind is None:
            allowed = ", ".join(options)
            raise BadInput(f"{called} has no such option in the app", found=key, allowed=allowed)
        if kind == "flag":
            if joined:
                raise BadInput(f"{key} takes no value", found=value)
            stated.append(key)
            continue
        if not joined:
            if not rest:
                raise BadInput(f"{key} takes a value")
            value = rest.pop(0)
        if kind in ("read", "write"):
            value = _file(folder, value)
        if kind == "read":
            named.append(value)
        if key == "--rig":
            rig = value
        stated.append(f"{key}={value}")
    if rig not in RIGS:
        raise BadInput(
            "the app does not carry out this command",
            found=f"--rig {rig}",
            allowed=", ".join(f"--rig {name}" for name in RIGS),
            remedy="use the command line",
        )
    several = any(name[: len(own)] == own for own in _SEVERAL)
    if len(read) < files or (len(read) > files and not several) or len(names) > 1:
        raise BadInput(f"{called} reads another number of files", found=len(read), allowed=files)
    if "--out" in options and not any(word.startswith("--out=") for word in stated):
        raise BadInput(f"{called} writes a file, and none is named", remedy="add --out")
    needed = _WITHIN.get(name[0])
    if needed is not None and not any(word.startswith(f"{needed}=") for word in stated):
        raise BadInput(f"{called} needs a file in the app's folder", remedy=f"add {needed}")
    # Recordings name no files, and to look for some in a long table would take long.
    for file in (*(() if name[0] == "import" else read), *named):
        require_named_inside(folder, folder.inside(file))
    if "--resume" in stated:
        require_named_inside(folder, folder.inside(run_file(stated)))
    if name == ("run",):
        stated += ["--json-lines", "--scene"]
    elif name[0] != "import" and name[:2] != ("export", "plan"):
        stated.append("--json")
    return [*stated, "--", *names, *read] if names or read else stated


def _file(folder: Folder, name: str) -> str:
    """The file as it is called from the folder, symbolic links followed."""
    return folder.called(folder.inside(name))
