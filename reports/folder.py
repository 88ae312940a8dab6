"""The report's folder: report.html, report.pdf, result.json, posterior.nc, figures; whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ..analysis.result import Draws, Result
from ..analysis.result_json import SCHEMA, dumps, to_json
from ..model.errors import BadInput

RESULT = "result.json"
_OURS = {"report.html", "report.pdf", RESULT, "posterior.nc", "figures"}
# What file managers leave behind in any folder that was looked at.
_LITTER = {".DS_Store", "Thumbs.db", "desktop.ini"}


@dataclass(frozen=True)
class ReportPaths:
    """Where a report stands; `posterior` is None if there were no draws."""

    folder: Path
    html: Path
    pdf: Path
    result: Path
    posterior: Path | None
    figures: tuple[Path, ...]


def write_report(folder: Path, result: Result, draws: Draws | None) -> ReportPaths:
    """Write the whole report to `folder`, replacing one that zerobeam wrote there before.

    Everything is written to a folder beside it and renamed at the end, so that a fault leaves what
    was there as it was. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    target = Path(os.path.realpath(folder))
    check_target(target)
    made = _make_parents(target.parent)
    try:
        aside = _folder_beside(target, "new")
        try:
            names = _write_files(aside, result, draws)
            _swap(aside, target)
        except OSError as error:
            raise _cannot_write(target, error) from error
        finally:
            shutil.rmtree(aside, ignore_errors=True)
    except BaseException:
        for parent in made:
            _remove_if_empty(parent)
        raise
    return ReportPaths(
        folder=folder,
        html=folder / "report.html",
        pdf=folder / "report.pdf",
        result=folder / RESULT,
        posterior=None if draws is None else folder / "posterior.nc",
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path) -> None:
    """Raise BadInput unless a report may be written to `folder`: absent, empty, or a report of ours."""
    allowed = "a folder that does not exist, is empty, or holds a report of zerobeam and nothing else"
    if folder.is_dir():
        names = {entry.name for entry in folder.iterdir()} - _LITTER
        foreign = sorted(names - _OURS)
        if foreign:
            listed = ", ".join(repr(name) for name in foreign[:3]) + (", …" if len(foreign) > 3 else "")
            raise BadInput(
                f"the report's folder {str(folder)!r} holds other things, which would be lost",
                found=listed,
                allowed=allowed,
                remedy="name another folder, or move them away",
            )
        if names and not _is_report(folder):
            raise BadInput(
                f"the report's folder {str(folder)!r} was not written by zerobeam",
                found=f"no {RESULT} of schema {SCHEMA}",
                allowed=allowed,
                remedy="name another folder, or empty this one",
            )
    elif folder.exists() or folder.is_symlink():
        raise BadInput(
            f"the report's folder {str(folder)!r} is a file",
            allowed=allowed,
            remedy="name another folder",
        )


def _is_report(folder: Path) -> bool:
    try:
        content = json.loads((folder / RESULT).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and content.get("schema") == SCHEMA


def _write_files(folder: Path, result: Result, draws: Draws | None) -> list[str]:
    """All files of the report into an empty folder; the names of the figures."""
    # The heavy libraries (matplotlib, xarray) are loaded only once it is known that they are needed.
    answer = to_json(result)
    text = dumps(answer)

    from .figures import pictures
    from .html import html
    from .pdf import pdf
    from .posterior_file import write_posterior
    from .view import view

    shown = view(answer)
    drawn = pictures(answer, draws)
    (folder / RESULT).write_text(text, encoding="utf-8")
    (folder / "report.html").write_text(html(shown, drawn, text), encoding="utf-8")
    (folder / "report.pdf").write_bytes(pdf(shown, drawn))
    if draws is not None:
        write_posterior(folder / "posterior.nc", answer, draws)
    (folder / "figures").mkdir()
    for name, picture in drawn.items():
        (folder / "figures" / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
    return [f"{name}.svg" for name in drawn]


def _make_parents(parent: Path) -> list[Path]:
    """Make the folders above the report's; those that were made, the innermost first."""
    missing = [folder for folder in (parent, *parent.parents) if not folder.exists()]
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        for folder in missing:
            _remove_if_empty(folder)
        raise _cannot_write(parent, error) from error
    return missing


def _folder_beside(target: Path, purpose: str) -> Path:
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".zerobeam-{purpose}-", dir=target.parent))
        # mkdtemp's folder is private; the report gets the rights that any new folder would have.
        mask = os.umask(0)
        os.umask(mask)
        beside.chmod(0o777 & ~mask)
    except OSError as error:
        raise _cannot_write(target.parent, error) from error
    return beside


def _swap(new: Path, target: Path) -> None:
    """Put `new` in the place of `target`; what was there goes last, and comes back if the rename fails."""
    try:
        if not target.exists():
            new.rename(target)
            return
        old = _folder_beside(target, "old") / "report"
        try:
            target.rename(old)
            new.rename(target)
        except BaseException:
            if old.exists():
                old.rename(target)
            old.parent.rmdir()
            raise
        shutil.rmtree(old.parent, ignore_errors=True)
    except OSError as error:
        raise _cannot_write(target, error) from error


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _cannot_write(where: Path, error: OSError) -> BadInput:
    return BadInput(
        f"the report cannot be written to {str(where)!r}",
        found=error.strerror or str(error),
        remedy="name a folder that may be written to",
    )
