"""Files that a file names: what a job reads leads out of the folder no more than what its command names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...model.errors import BadInput
from ...model.files.reading import LARGEST_YAML, parse_json, read_yaml
from ...model.files.robot_file import built_in_robots
from .folder import Folder

# Keys of our files of which a text is a path relative to the file's folder. A key of the same name elsewhere
# (a target called so) has no text.
_PATHS = frozenset({"urdf", "calibration", "folder", "video"})
_ROBOT = "robot"
_SAID_ONLY = "provenance"  # what is written there is never opened
_STREAM = re.compile(r"(https?|rtsps?|rtmp|udp|tcp)://")


def require_named_inside(folder: Folder, path: Path) -> None:
    """BadInput where the YAML file or the run at `path`, below the folder, names a file that is not below it.

    What cannot be read names nothing: the command that reads it says what is wrong.
    """
    for name in _named(_content(path)):
        try:
            folder.inside(name, path.parent)
        except BadInput as error:
            raise BadInput(
                "the file names a path that is not below the app's folder",
                found=name[:100],
                allowed=error.allowed,
                remedy="put the file that it names into the folder, and name it from there",
                file=Path(folder.called(path)),
            ) from None


def _content(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            while (first := file.readline(LARGEST_YAML)) and not first.strip():
                pass
        if first.lstrip().startswith(b"{"):
            return parse_json(first.decode("utf-8"), file=path, line=1)
    except (OSError, ValueError, RecursionError, BadInput):
        pass  # no run
    try:
        return read_yaml(path).data
    except BadInput:
        return None


def _named(content: Any) -> Iterator[str]:
    if isinstance(content, list):
        for item in content:
            yield from _named(item)
    if not isinstance(content, dict):
        return
    for key, value in content.items():
        if key == _SAID_ONLY:
            continue
        if not isinstance(value, str):
            yield from _named(value)
        elif key == _ROBOT:
            if value not in built_in_robots() and "." in value:
                yield value
        elif key in _PATHS and not _STREAM.match(value):
            yield value
