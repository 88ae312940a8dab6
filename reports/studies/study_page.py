"""A study's folder: study.html, study.pdf, study.json, its tables as CSV, figures; whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...analysis.status import UnsoundResult
from ...experiments.studies.sweeps.grid_answer import GridStudy
from ..output import whole_folder
from ..output.page_files import write_page
from ..output.whole_folder import Kind, write_folder
from ..words.result_json import dumps
from .studies import Answer, Study, known_study, study_of

Json = dict[str, Any]

SCHEMA = "zerobeam/study/1"
_JSON = "study.json"


@dataclass(frozen=True)
class StudyPaths:
    """Where a study stands."""

    folder: Path
    html: Path
    pdf: Path
    study: Path
    tables: tuple[Path, ...]
    figures: tuple[Path, ...]


def write_study(folder: Path | str, answer: GridStudy | Json) -> StudyPaths:
    """Write a study (`zerobeam/study/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written,
    UnsoundResult where a parameter that a data set cannot tell has a number, ValueError where `answer` is
    of another schema or of no known study, or holds a number that is not finite.
    """
    folder = Path(folder)
    names = write_folder(folder, _kind(folder), lambda aside: _write_files(aside, answer))
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
    """What may be replaced in `folder`: the files of the study that stands there, and of no other study.

    So a table of somebody's own is safe even if another study has one of that name.
    """
    try:
        study = known_study(json.loads((folder / _JSON).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        study = None
    tables = study.tables if study is not None else ()
    return Kind("study", frozenset({"study.html", "study.pdf", _JSON, "figures", *tables}), _JSON, SCHEMA)


def _write_files(folder: Path, answer: GridStudy | Json) -> list[str]:
    """All files of the study into an empty folder; the names of the figures."""
    if isinstance(answer, dict) and answer.get("schema") != SCHEMA:
        raise ValueError(f"a study is of schema {SCHEMA}, not {answer.get('schema')!r}")
    return _write_study(folder, answer, study_of(answer))


def _write_study(folder: Path, answer: Answer, study: Study[Answer]) -> list[str]:
    content = study.to_json(answer)
    refuse_made_up(content, study)
    return write_page(
        folder,
        "study",
        study.view(answer),
        study.pictures(answer),
        "study",
        answer=(_JSON, dumps(content)),
        tables={name: rows(answer) for name, rows in study.tables.items()},
    )


def refuse_made_up(answer: Json, study: Study[Any]) -> None:
    """UnsoundResult if anything that is no control claims a number of what a data set cannot tell.

    A parameter is whatever has a `status`, wherever it stands in the answer.
    """
    for where in _made_up(answer, study.stated):
        names = ", ".join(map(repr, where))
        raise UnsoundResult(
            f"the study is unsound and was not written: {names} is unidentifiable, but has numbers"
        )


def _made_up(
    value: object, stated: frozenset[str], control: bool = False, where: tuple[str, ...] = ()
) -> Iterator[tuple[str, ...]]:
    """Names, from the plan down, of the unidentifiable parameters with a number that is not `stated`."""
    if isinstance(value, dict):
        control = value.get("control", control) is True
        where = (*where, str(value["name"])) if "name" in value else where
        if value.get("status") == "unidentifiable" and not control:
            if any(_has_number(item) for key, item in value.items() if key not in stated):
                yield where
            return
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _made_up(item, stated, control, where)


def _has_number(value: object) -> bool:
    if isinstance(value, dict | list):
        return any(map(_has_number, value.values() if isinstance(value, dict) else value))
    return isinstance(value, int | float) and not isinstance(value, bool)
