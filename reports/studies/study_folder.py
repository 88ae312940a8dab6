"""A study's folder: study.html, study.pdf, study.json, its tables as CSV, figures; whole or not at all."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from ...experiments.studies.answer import SCHEMA, StudyAnswer, to_json
from ...model.records import dumps
from ..output import whole_folder
from ..output.whole_folder import Kind, write_folder, write_page
from .kinds import study_of, study_of_file

_JSON = "study.json"


@dataclass(frozen=True)
class StudyPaths:
    """The files of a study."""

    folder: Path
    html: Path
    pdf: Path
    study: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]


def write_study(folder: Path | str, answer: StudyAnswer) -> StudyPaths:
    """Write a study (`zerobeam/study/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written,
    ValueError where `answer` holds a number that is not finite.
    """
    folder = Path(folder)
    names = write_folder(folder, _kind(folder), lambda new_folder: _write_files(new_folder, answer))
    return StudyPaths(
        folder=folder,
        html=folder / "study.html",
        pdf=folder / "study.pdf",
        study=folder / _JSON,
        tables=tuple(folder / name for name in study_of(answer).tables),
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path | str) -> None:
    """Raise BadInput unless a study may be written to `folder`; to be asked before one is computed."""
    whole_folder.check_target(folder, _kind(Path(folder)))


def _kind(folder: Path) -> Kind:
    """The files that may be replaced in `folder`: those of the study that is there, and of no other study.

    So a table of somebody's own is safe even if another study has one of that name.
    """
    try:
        study = study_of_file(json.loads((folder / _JSON).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        study = None
    tables = study.tables if study is not None else ()
    return Kind("study", frozenset({"study.html", "study.pdf", _JSON, "figures", *tables}), _JSON, SCHEMA)


def _write_files(folder: Path, answer: StudyAnswer) -> list[str]:
    """All files of the study into an empty folder; the names of the figures."""
    study, text = study_of(answer), dumps(to_json(answer))
    return write_page(
        folder,
        "study",
        study.page(answer),
        study.pictures(answer),
        "study",
        answer=(_JSON, text),
        tables={name: rows(answer) for name, rows in study.tables.items()},
    )
