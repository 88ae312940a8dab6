"""A study's folder: study.html, study.pdf, study.json, its tables as CSV, figures."""

from __future__ import annotations

import json
from pathlib import Path

from ...experiments.studies.answer import SCHEMA, StudyAnswer
from ...model.records import to_json
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from .kinds import study_of, study_of_file

_JSON = "study.json"


def write_study(folder: Path | str, answer: StudyAnswer) -> Written:
    """Write a study (`zerobeam/study/1`) to `folder`. Raises as `write_answer`, and ValueError where `answer`
    holds a number that is not finite."""
    study = study_of(answer)
    tables = {name: rows(answer) for name, rows in study.tables.items()}
    contents = FolderContents(to_json(answer), study.page(answer), study.drawn(answer), tables)
    return write_answer(folder, study_kind(folder), contents)


def study_kind(folder: Path | str) -> Kind:
    """The files that may be replaced in `folder`: those of the study that is there, and of no other study.

    So a table of somebody's own is safe even if another study has one of that name.
    """
    try:
        study = study_of_file(json.loads((Path(folder) / _JSON).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        study = None
    return Kind.of_answer("study", _JSON, SCHEMA, *(study.tables if study is not None else ()))
