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
from . import cell_page, coverage_page, drift_page, geometry_page, instruments_page, sweep_page, table2_page
from . import wrong_models_page as wrong_models
from .study_blocks import PlainRow
from .sweep_figures import sweep_pictures

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
        coverage_page.coverage_page,
        coverage_page.coverage_pictures,
        {"coverage.csv": coverage_page.coverage_rows, "ranks.csv": coverage_page.rank_rows},
    ),
    "cell": Study(
        cell_page.cell_page,
        cell_page.cell_pictures,
        {"parameters.csv": cell_page.PARAMETERS, "time.csv": cell_page.TIMES, "plans.csv": cell_page.PLANS},
    ),
    "table2": Study(
        table2_page.table2_page,
        table2_page.table2_pictures,
        {
            "scatter.csv": table2_page.SCATTER,
            "plans.csv": table2_page.PLANS,
            "paper.csv": table2_page.paper_rows,
        },
    ),
    "geometry": Study(
        geometry_page.geometry_page,
        geometry_page.geometry_pictures,
        {"parameters.csv": geometry_page.PARAMETERS, "plans.csv": geometry_page.PLANS},
    ),
    "drift": Study(drift_page.drift_page, drift_page.drift_pictures, {"power.csv": drift_page.POWER}),
    "instruments": Study(
        instruments_page.instruments_page,
        instruments_page.instruments_pictures,
        {"plans.csv": instruments_page.SETUPS},
    ),
    "wrong-models": Study(
        wrong_models.wrong_models_page, lambda answer: [], {"models.csv": wrong_models.MODELS}
    ),
}

# Every study over settings, whatever its name: people write their own.
SWEEP: Study[GridStudy] = Study(
    sweep_page.sweep_page,
    sweep_pictures,
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
