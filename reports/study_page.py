"""A study's folder: study.html, study.pdf, study.json, its tables as CSV, figures; whole or not at all."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..analysis.result_json import UnsoundResult, dumps
from . import whole_folder
from .canvas import Picture, themed
from .html import TEMPLATES, style, template
from .study_view import determined, study_view
from .whole_folder import Kind, write_folder
from .wording import shown

Json = dict[str, Any]

SCHEMA = "zerobeam/study/1"
_JSON, _COVERAGE, _RANKS = "study.json", "coverage.csv", "ranks.csv"
_STUDY = Kind(
    noun="study",
    names=frozenset({"study.html", "study.pdf", _JSON, _COVERAGE, _RANKS, "figures"}),
    mark=_JSON,
    schema=SCHEMA,
)


@dataclass(frozen=True)
class StudyPaths:
    """Where a study stands."""

    folder: Path
    html: Path
    pdf: Path
    study: Path
    coverage: Path
    ranks: Path
    figures: tuple[Path, ...]


def write_study(folder: Path, answer: Json) -> StudyPaths:
    """Write a study (`zerobeam/study/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written,
    UnsoundResult where a parameter that a data set cannot tell has a number, ValueError where `answer` is
    of another schema or holds a number that is not finite.
    """
    names = write_folder(folder, _STUDY, lambda aside: _write_files(aside, answer))
    return StudyPaths(
        folder=folder,
        html=folder / "study.html",
        pdf=folder / "study.pdf",
        study=folder / _JSON,
        coverage=folder / _COVERAGE,
        ranks=folder / _RANKS,
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path) -> None:
    """Raise BadInput unless a study may be written to `folder`; to be asked before one is computed."""
    whole_folder.check_target(folder, _STUDY)


def study_html(view: Json, pictures: dict[str, Picture]) -> str:
    """The study as one self-contained HTML file: no script, no network."""
    from markupsafe import Markup

    return template("study.html.j2").render(
        view=view,
        pictures={
            name: {"picture": picture, "svg": Markup(themed(picture.svg))}
            for name, picture in pictures.items()
        },
        # Our own text, with nothing of the study in it.
        css=Markup(style() + (TEMPLATES / "study.css").read_text(encoding="utf-8")),
    )


def _write_files(folder: Path, answer: Json) -> list[str]:
    """All files of the study into an empty folder; the names of the figures."""
    if answer.get("schema") != SCHEMA:
        raise ValueError(f"a study is of schema {SCHEMA}, not {answer.get('schema')!r}")
    _refuse_made_up(answer)
    text = dumps(answer)

    from .study_figures import study_pictures
    from .typeset import typeset

    view, drawn = study_view(answer), study_pictures(answer)
    (folder / _JSON).write_text(text, encoding="utf-8")
    (folder / _COVERAGE).write_text(_table(_coverage_rows(answer)), encoding="utf-8")
    (folder / _RANKS).write_text(_table(_rank_rows(answer)), encoding="utf-8")
    (folder / "study.html").write_text(study_html(view, drawn), encoding="utf-8")
    (folder / "study.pdf").write_bytes(typeset("study.typ", view, drawn))
    (folder / "figures").mkdir()
    for name, picture in drawn.items():
        (folder / "figures" / f"{name}.svg").write_text(picture.svg, encoding="utf-8")
    return [f"{name}.svg" for name in drawn]


def _refuse_made_up(answer: Json) -> None:
    """UnsoundResult if an estimator that is no control claims anything about what a data set cannot tell."""
    for plan in answer["plans"]:
        for estimator in plan["estimators"]:
            for row in estimator["parameters"]:
                if row["status"] == "unidentifiable" and not estimator["control"]:
                    numbers = (row[key] for key in ("bias", "bias_mcse", "rmse", "predicted_std"))
                    if row["coverage"] or any(number is not None for number in numbers):
                        raise UnsoundResult(
                            f"the study is unsound and was not written: plan {plan['name']!r}, estimator"
                            f" {estimator['name']!r}: {row['name']!r} is unidentifiable, but has numbers"
                        )


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def _table(rows: Iterator[Json]) -> str:
    """Rows with the same keys as CSV with a header; what is not known is an empty cell."""
    out = io.StringIO()
    writer: csv.DictWriter[str] | None = None
    for row in rows:
        if writer is None:
            writer = csv.DictWriter(out, fieldnames=list(row), lineterminator="\n")
            writer.writeheader()
        writer.writerow({key: shown(cell) if isinstance(cell, str) else cell for key, cell in row.items()})
    return out.getvalue()


def _coverage_rows(answer: Json) -> Iterator[Json]:
    """One row for each plan, estimator, parameter and level."""
    for plan in answer["plans"]:
        for estimator in plan["estimators"]:
            for parameter in estimator["parameters"]:
                told = determined(parameter, estimator["control"])
                entries = {entry["level"]: entry for entry in parameter["coverage"]} if told else {}
                for level in answer["settings"]["levels"]:
                    entry = entries.get(level, {})
                    yield {
                        "plan": plan["name"],
                        "estimator": estimator["name"],
                        "control": estimator["control"],
                        "parameter": parameter["name"],
                        "status": parameter["status"],
                        "level": level,
                        **{key: entry.get(key) for key in ("held", "of", "share", "low", "high", "agrees")},
                    }


def _rank_rows(answer: Json) -> Iterator[Json]:
    """One row for each plan, sampler, parameter and bin."""
    for plan in answer["plans"]:
        for part in plan["sbc"]:
            for parameter in part["parameters"]:
                for number, count in enumerate(parameter["ranks"]):
                    yield {
                        "plan": plan["name"],
                        "estimator": part["name"],
                        "control": part["control"],
                        "parameter": parameter["name"],
                        "bin": number,
                        "count": count,
                    }
