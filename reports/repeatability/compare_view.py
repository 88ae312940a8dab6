"""The page of `compare`: what repeated runs have in common, and whether they agree; its folder and table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...analysis.repeatability.compare import SCHEMA
from ..output import whole_folder
from ..output.whole_folder import Kind, write_folder
from ..studies.studies import Study, as_it_is
from ..studies.study_page import write_files
from ..studies.study_view import LONGEST_NAME, NOT_DETERMINED, NOT_GIVEN, spread, spread_range
from ..style.blocks import (
    Block,
    Cell,
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture
from ..words import numbers
from ..words.wording import clipped, counted, label, listed, sentence, shown
from .figure_compare import compare_picture

Json = dict[str, Any]

_JSON, _TABLE = "compare.json", "offsets.csv"
_KIND = Kind(
    "comparison", frozenset({"compare.html", "compare.pdf", _JSON, _TABLE, "figures"}), _JSON, SCHEMA
)
_VERDICT = {
    "agrees": ("pass", "Agrees"),
    "does not agree": ("weak", "Does not agree"),
    "not tested": ("weak", "Not tested"),
}
_NORMAL_95 = 1.959964
_NOT_COMPARED = "not compared"


@dataclass(frozen=True)
class ComparePaths:
    """Where a comparison stands."""

    folder: Path
    html: Path
    pdf: Path
    compare: Path
    table: Path
    figures: tuple[Path, ...]


def compare_view(answer: Json) -> Page:
    """The display strings of a comparison (see `blocks.py`)."""
    key, word = _VERDICT[answer["verdict"]]
    runs = counted(len(answer["runs"]), "run")
    return Page(
        "Repeated runs, compared",
        runs if answer["kind"] != "table" else f"{runs} of a table of published offsets",
        Verdict(key, word, sentence(answer["headline"])),
        [sentence(note) for note in answer["notes"]],
        [
            section_of(
                "Mean and scatter of each offset",
                _means(answer),
                _prediction(answer),
                Paragraph(_whole(answer)),
                FigureBlock("runs"),
            ),
            section_of("Drift", *_drift(answer)),
            section_of("Each run", _against(answer), Paragraph(_on_the_odd_one(answer))),
            section_of("Offsets of each run", _runs(answer), level=2),
            section_of("How it was done", Facts(_about(answer))),
        ],
    )


def compare_pictures(answer: Json) -> dict[str, Picture]:
    picture = compare_picture(answer)
    return {} if picture is None else {picture.name: picture}


def offset_rows(answer: Json) -> Iterator[Json]:
    """`offsets.csv`: one row for each offset and run, with what holds for the offset over all runs."""
    for i, row in enumerate(answer["offsets"]):
        low, high = row["mean_interval95"] or (None, None)
        drift = row["drift"] or {}
        for run in answer["runs"]:
            own = run["offsets"][i]
            yield {
                "offset": row["name"],
                "unit": row["unit"],
                "run": run["name"],
                "at": run["at"],
                **{key: own[key] for key in ("status", "estimate", "std")},
                "mean": row["mean"],
                "mean_low": low,
                "mean_high": high,
                "observed_std": row["std"],
                **{key: row[key] for key in ("predicted_std", "ratio", "p_holm")},
                "slope": drift.get("slope"),
                "slope_p_holm": drift.get("p_holm"),
            }


def write_comparison(folder: Path, answer: Json) -> ComparePaths:
    """Write a comparison (`zerobeam/compare/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written,
    UnsoundResult where an offset that a run cannot tell has a number.
    """
    names = write_folder(folder, _KIND, lambda aside: write_files(aside, answer, COMPARISON, "compare"))
    return ComparePaths(
        folder=folder,
        html=folder / "compare.html",
        pdf=folder / "compare.pdf",
        compare=folder / _JSON,
        table=folder / _TABLE,
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path) -> None:
    """Raise BadInput unless a comparison may be written to `folder`."""
    whole_folder.check_target(folder, _KIND)


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _means(answer: Json) -> Table:
    columns = [
        ("offset", "left"),
        ("mean", "right"),
        ("95 % interval", "right"),
        ("std", "right"),
        ("95 % of the true one", "right"),
    ]
    rows = []
    for row in answer["offsets"]:
        name = label(row["name"])
        if row["mean"] is None:
            rows.append(row_of(name, Cell(_NOT_COMPARED, span=4), tone="unidentifiable"))
            continue
        told = _mean(row, answer["kind"] == "table")
        low, high = row["std_interval95"]
        rows.append(row_of(name, *told, spread_range(low, high, row["unit"])))
    by = {row["mean_by"] for row in answer["offsets"]} - {None}
    source = "the prediction" if by == {"prediction"} else "the runs’ own scatter (Student’s t)"
    caption = f"Mean over the runs, its interval from {source}; standard deviation of a run"
    return table_of(caption, columns, rows)


def _prediction(answer: Json) -> Table | None:
    """Observed against predicted scatter, where anything is predicted."""
    told = [row for row in answer["offsets"] if row["ratio"] is not None]
    if not told:
        return None
    columns = [
        ("offset", "left"),
        ("observed", "right"),
        ("predicted", "right"),
        ("observed / predicted", "right"),
        ("95 % interval", "right"),
        ("p", "right"),
    ]
    rows = [
        row_of(
            label(row["name"]),
            spread(row["std"], row["unit"]),
            spread(row["predicted_std"], row["unit"]),
            spread(row["ratio"]),
            spread_range(*row["ratio_interval95"]),
            numbers.p_value(row["p_holm"]),
            tone="weak" if row["name"] in answer["differing"] else "",
        )
        for row in told
    ]
    caption = (
        "Standard deviation over the runs; p of one as large, corrected for the number of offsets (Holm)"
    )
    return table_of(caption, columns, rows)


def _mean(row: Json, published: bool) -> list[str]:
    """Mean, interval and std: by the mean's uncertainty, or with the std to three digits, as papers print."""
    (low, high), unit = row["mean_interval95"], row["unit"]
    half = (high - low) / 2
    if half == 0:
        return [numbers.exact(row["mean"], unit), NOT_GIVEN, spread(row["std"], unit)]
    own = half / _NORMAL_95
    between = numbers.interval((low, high), own, unit)
    if not published:
        return [numbers.estimate(row["mean"], own, unit), between, spread(row["std"], unit)]
    digits = numbers.decimals(row["std"]) + 1
    mean, std = (numbers.with_unit(numbers.fixed(row[key], digits), unit) for key in ("mean", "std"))
    return [mean, between, std]


def _whole(answer: Json) -> str:
    whole = answer["consistency"]
    if whole is None:
        return (
            "A standard deviation of few runs tells the true one to a wide interval only. There is no joint"
            " test of all offsets: that takes run files that determine every free offset."
        )
    low, high = whole["ratio_interval95"]
    test = f"χ² {numbers.significant(whole['chi2'])} for {whole['dof']} degrees of freedom"
    if whole["noise_dof"] is not None:
        test += f", against a noise estimated from {whole['noise_dof']} numbers (F)"
    return (
        f"All offsets together, with their covariances: {test}, p {numbers.p_value(whole['p_value'])}. The"
        f" runs scatter {spread(whole['ratio'])} times as much as predicted ({spread_range(low, high)})."
    )


def _drift(answer: Json) -> Iterator[Block]:
    rows = []
    at = "h" if answer["settings"]["at_unit"] == "h" else "run"
    for row in answer["offsets"]:
        drift = row["drift"]
        if drift is None:
            rows.append(row_of(label(row["name"]), Cell("cannot be told", span=3), tone="unidentifiable"))
            continue
        low, high = drift["interval95"]
        own, unit = (high - low) / (2 * _NORMAL_95), "°" if row["unit"] == "deg" else f" {row['unit']}"
        rows.append(
            row_of(
                label(row["name"]),
                f"{numbers.estimate(drift['slope'], own)}{unit}/{at}",
                f"{numbers.interval((low, high), own)}{unit}/{at}",
                numbers.p_value(drift["p_holm"]),
                tone="weak" if row["name"] in answer["drifting"] else "",
            )
        )
    by = "when the runs were made" if at == "h" else "the order in which the runs were given"
    yield Paragraph(
        f"Slope of each offset over {by}, its interval from the scatter about the line (Student’s t): it"
        " holds whatever was predicted, and few runs tell little."
    )
    columns = [("offset", "left"), ("slope", "right"), ("95 % interval", "right"), ("p", "right")]
    yield table_of("Drift; p corrected for the number of offsets (Holm)", columns, rows)


def _against(answer: Json) -> Table:
    hours = answer["settings"]["at_unit"] == "h"
    columns = [("run", "left"), ("at", "right"), ("shots", "right"), ("against the others", "left")]
    rows = []
    for number, run in enumerate(answer["runs"], start=1):
        cell: str | Cell = NOT_GIVEN if run["odd"] is None else f"p {numbers.p_value(run['odd']['p_holm'])}"
        is_odd = run["name"] == answer["odd_run"]
        if is_odd:
            cell = Cell(f"the odd one, {cell}", mark="weak")
        if run["failure"] is not None:
            cell = Cell("no result", mark="weak")
        at = numbers.significant(run["at"], 3, "h") if hours else str(number)
        shots = NOT_GIVEN if run["shots"] is None else str(run["shots"])
        name = clipped(run["name"], LONGEST_NAME)
        rows.append(row_of(name, at, shots, cell, tone="weak" if is_odd else ""))
    caption = "Each run against all others; p corrected for the number of runs (Holm)"
    return table_of(caption, columns, rows)


def _runs(answer: Json) -> Table:
    columns = [("run", "left")]
    columns += [(label(own["name"]), "right") for own in answer["runs"][0]["offsets"]]
    rows = [
        row_of(clipped(run["name"], LONGEST_NAME), *(_estimate(own) for own in run["offsets"]))
        for run in answer["runs"]
    ]
    caption = "Offsets of each run from its shots alone, without any prior, ± predicted standard deviation"
    if answer["kind"] == "table":
        caption = "Offsets of each run as published"
    return table_of(caption, columns, rows)


def _estimate(own: Json) -> str:
    if own["estimate"] is None:
        return {"unidentifiable": NOT_DETERMINED, "prior": _NOT_COMPARED}.get(own["status"], NOT_GIVEN)
    if own["std"] is None:
        return numbers.exact(own["estimate"], own["unit"])
    value = numbers.estimate(own["estimate"], own["std"])
    return f"{value} ± {spread(own['std'], own['unit'])}"


def _on_the_odd_one(answer: Json) -> str:
    if answer["odd_run"] is not None:
        return f"{clipped(answer['odd_run'], LONGEST_NAME)} is the odd one."
    if len(answer["runs"]) - len(answer["failed"]) < 3:
        return "Which run is the odd one cannot be told from fewer than three."
    return "No single run is the odd one."


def _about(answer: Json) -> list[tuple[str, str]]:
    settings = answer["settings"]
    order = "by provenance.when" if settings["order"] == "time" else "as given"
    hashes = dict.fromkeys(run["sha256"][:12] for run in answer["runs"] if run["sha256"])
    held = listed([label(name) for name in answer["held"]]) if answer["held"] else "none"
    robots = dict.fromkeys(clipped(run["robot"]) for run in answer["runs"] if run["robot"])
    return [
        ("Robot", ", ".join(robots) or NOT_GIVEN),
        ("Held", held),
        ("Order", order),
        ("Questions", f"{', '.join(settings['asked'])}: each at {settings['chance']:g} over their number"),
        ("Seed", str(settings["seed"])),
        ("SHA-256", ", ".join(hashes)),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer["versions"].items())),
        ("Files", f"{_JSON} beside this page holds every number unrounded; {_TABLE} as a plain table"),
    ]


COMPARISON: Study[Json] = Study(compare_view, compare_pictures, {_TABLE: offset_rows}, as_it_is)
