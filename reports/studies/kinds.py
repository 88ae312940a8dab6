"""The studies that can be shown, and their folder: to add one, write how it is shown, and enter it here."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...experiments.studies.answer import SCHEMA, StudyAnswer
from ...experiments.studies.sweeps.grid_answer import GridStudy
from ...model.records import to_json
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from ..style.blocks import Page
from .drift_page import DRIFT
from .instruments_page import INSTRUMENTS
from .interval_pages import CELL, COVERAGE, GEOMETRY
from .study_blocks import Study
from .sweep_page import SWEEP
from .table2_page import TABLE2
from .wrong_models_page import WRONG_MODELS

# All but the studies over settings, which people write themselves, whatever their names.
STUDIES: dict[str, Study[Any]] = {
    "coverage": COVERAGE,
    "cell": CELL,
    "table2": TABLE2,
    "geometry": GEOMETRY,
    "drift": DRIFT,
    "instruments": INSTRUMENTS,
    "wrong-models": WRONG_MODELS,
}


def study_of(answer: StudyAnswer) -> Study[Any]:
    """The kind of an answer. Raises ValueError where it is of none."""
    study = SWEEP if isinstance(answer, GridStudy) else STUDIES.get(answer.study)
    if study is None:
        raise ValueError(f"a study is one of {', '.join(STUDIES)}, or over settings, not {answer.study!r}")
    return study


def study_of_file(content: object) -> Study[Any] | None:
    """The kind of the content of a study.json; None where it is of no known kind.

    A study over settings is known by its axes and cases, any other by its name.
    """
    if not isinstance(content, dict):
        return None
    if isinstance(content.get("axes"), list) and isinstance(content.get("cases"), list):
        return SWEEP
    return STUDIES.get(str(content.get("study")))


def study_page(answer: StudyAnswer) -> Page:
    """All that the page of a study says."""
    return study_of(answer).page(answer)


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
