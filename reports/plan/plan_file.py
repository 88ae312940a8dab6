"""The file of a plan's page: written whole, and over nothing but such a page."""

from __future__ import annotations

import os
from pathlib import Path

from ...analysis.observability.aim import AimedPlan
from ...analysis.observability.check import Check
from ...model.errors import BadInput
from ...model.files.whole_file import write_whole
from .plan_page import MARK, plan_page

_HEAD = 1000  # bytes: where the mark is, before anything that comes from a plan


def write_plan_page(path: Path | str, aimed: AimedPlan, check: Check) -> None:
    """Write the page of a plan (`plan_page`) to `path`, replacing nothing but such a page.

    BadInput if something else is there or the folder does not exist, NotWritten where it cannot be written.
    """
    path = Path(path)
    target = Path(os.path.realpath(path))
    _check_target(path, target)
    text = plan_page(aimed, check)
    write_whole(target, text, force=True)


def _check_target(path: Path, target: Path) -> None:
    allowed = "a file that does not exist, or a picture of a plan that zerobeam wrote"
    if not target.parent.is_dir():
        raise BadInput(
            "the folder to write the picture into does not exist",
            found=path.parent,
            remedy="make it first",
            file=path,
        )
    if target.is_dir():
        raise BadInput("there is a folder of this name", allowed=allowed, file=path)
    if target.exists() and not _is_plan_page(target):
        raise BadInput(
            "the file exists already and is no picture of a plan; it would be lost",
            allowed=allowed,
            remedy="choose another name, or move it away first",
            file=path,
        )


def _is_plan_page(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    return head.startswith(b"<!doctype html>") and MARK.encode() in head
