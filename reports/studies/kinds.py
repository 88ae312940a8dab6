"""The studies that can be shown: to add one, write its page with pictures and plain tables, enter it here."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from ...experiments.studies.answer import SCHEMA, StudyAnswer
from ...experiments.studies.sweeps.grid_answer import GridStudy
from ...model.records import to_json
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from ..style.blocks import Page
from ..style.canvas import Picture
from .cell_page import cell_page, cell_pictures, parameter_rows, time_rows
from .cell_page import plan_rows as cell_plan_rows
from .coverage_page import coverage_page, coverage_pictures, coverage_rows, rank_rows
from .drift_page import drift_page, drift_pictures, power_rows
from .geometry_page import geometry_page, geometry_pictures
from .geometry_page import parameter_rows as geometry_parameter_rows
from .geometry_page import plan_rows as geometry_plan_rows
from .instruments_page import instruments_page, instruments_pictures, setup_rows
from .study_blocks import PlainRow
from .sweeps import sweep_page
from .table2_page import paper_rows, scatter_rows, table2_page, table2_pictures
from .table2_page import plan_rows as table2_plan_rows
from .wrong_models_page import model_rows, wrong_models_page, wrong_models_pictures

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Study(Generic[Answer]):
    """How an answer of one kind is shown; all of it follows from the answer alone."""

    page: Callable[[Answer], Page]
    drawn: Callable[[Answer], Sequence[Picture | None]]  # None where a figure has nothing to show
    tables: Mapping[str, Callable[[Answer], Iterator[PlainRow]]]  # rows by the name of the CSV file

    def pictures(self, answer: Answer) -> dict[str, Picture]:
        """The figures by name."""
        return {picture.name: picture for picture in self.drawn(answer) if picture is not None}


STUDIES: dict[str, Study[Any]] = {
    "coverage": Study(
        coverage_page, coverage_pictures, {"coverage.csv": coverage_rows, "ranks.csv": rank_rows}
    ),
    "cell": Study(
        cell_page,
        cell_pictures,
        {"parameters.csv": parameter_rows, "time.csv": time_rows, "plans.csv": cell_plan_rows},
    ),
    "table2": Study(
        table2_page,
        table2_pictures,
        {"scatter.csv": scatter_rows, "plans.csv": table2_plan_rows, "paper.csv": paper_rows},
    ),
    "geometry": Study(
        geometry_page,
        geometry_pictures,
        {"parameters.csv": geometry_parameter_rows, "plans.csv": geometry_plan_rows},
    ),
    "drift": Study(drift_page, drift_pictures, {"power.csv": power_rows}),
    "instruments": Study(instruments_page, instruments_pictures, {"plans.csv": setup_rows}),
    "wrong-models": Study(wrong_models_page, wrong_models_pictures, {"models.csv": model_rows}),
}

# Every study over settings, whatever its name: people write their own.
SWEEP: Study[GridStudy] = Study(
    sweep_page.sweep_page,
    sweep_page.sweep_pictures,
    {"cases.csv": sweep_page.case_rows, "offsets.csv": sweep_page.parameter_rows},
)


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
