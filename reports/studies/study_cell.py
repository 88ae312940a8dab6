"""The study `cell`: the whole chain of the simulated cell, from a plan to intervals, many times over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..words import numbers
from ..words.wording import clipped, label, listed, sentence
from .study_shares import (
    BY_CHANCE,
    ERROR_COLUMNS,
    determined,
    error_cells,
    meanings,
    percent,
    share_cell,
    standing,
    verdicts,
    worst_cell,
)
from .study_view import (
    LONGEST_NAME,
    NOT_DETERMINED,
    NOT_GIVEN,
    about_study,
    files_block,
    plan_in_words,
    plan_title,
    plans_counted,
    seconds,
    view_of,
)

Json = dict[str, Any]

# What a run's time is spent on, in the order of a shot.
PHASES = ("move", "search", "servo", "settle")
_SHARE = ("held", "of", "share", "low", "high", "agrees")
_ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std")


def cell_view(answer: Json) -> Page:
    """The display strings of a study of the simulated cell."""
    settings, plans = answer["settings"], judged(answer)
    limit = numbers.exact(settings["limit_s"], "s")
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings),
            Legend(meanings(plans), verdicts(plans)),
            Paragraph(BY_CHANCE),
        ),
        section_of(
            f"Time against the limit of {limit}",
            Paragraph("Simulated time of a run, by the cell’s own clock, with what was tried again in it."),
            FigureBlock("time"),
            _time(plans),
        ),
        section_of("Runs and shots", _runs(plans), *map(_failures, plans)),
        section_of(
            f"How often the {percent(settings['level'])} intervals hold the truth",
            FigureBlock("coverage"),
            _parameters(plans, settings["level"]),
        ),
        section_of(
            "How it was done",
            about_study(
                answer,
                [
                    ("Runs of each plan", str(settings["runs"])),
                    ("Seed", str(settings["seed"])),
                    ("Level of the intervals", percent(settings["level"])),
                    ("Chance of a false alarm", percent(settings["chance"])),
                    ("Limit of a run’s time", limit),
                    ("Search", "by camera images" if settings["camera"] else "without a camera"),
                ],
            ),
            files_block(
                "parameters.csv, time.csv and plans.csv hold the shares and errors, the times and the runs"
            ),
        ),
        section_of("Plans", Facts(_plans(plans)), level=2),
    ]
    camera = "with" if settings["camera"] else "without"
    subtitle = f"{settings['runs']} simulated runs for each of {plans_counted(answer)}, {camera} camera"
    return view_of(answer, f"{subtitle}, seed {settings['seed']}", sections)


def judged(answer: Json) -> list[Json]:
    """The plans with `coverage` as a list, as of an estimator: empty where there is none."""
    return [
        {
            **plan,
            "parameters": [
                {**row, "coverage": [row["coverage"]] if row["coverage"] else []}
                for row in plan["parameters"]
            ],
        }
        for plan in answer["plans"]
    ]


def solved(plan: Json) -> int:
    """The number of runs with a result, at least one."""
    return max(1, int(plan["runs"]) - int(plan["failed"]))


def _overview(plans: list[Json], settings: Json) -> Table:
    # The standing second, so that a phone shows it without scrolling.
    columns = [
        ("plan", "left"),
        ("intervals", "left"),
        ("farthest", "right"),
        ("mean", "right"),
        ("longest", "right"),
        ("limit", "left"),
    ]
    rows = []
    for plan in plans:
        mark, words = standing(plan)
        total = plan["seconds"]["total"]
        rows.append(
            row_of(
                clipped(plan["name"], LONGEST_NAME),
                Cell(words, mark=mark),
                worst_cell(plan, settings["level"]),
                seconds(total["mean"]),
                seconds(total["max"]),
                _within(plan),
                tone=mark,
            )
        )
    caption = (
        "Share of intervals that hold the truth, in %: the parameter farthest from"
        f" {percent(settings['level'])}; mean and longest time of a run, and its limit"
    )
    return table_of(caption, columns, rows)


def _within(plan: Json) -> Cell:
    if plan["within_limit"] is None:
        return Cell(NOT_GIVEN)
    return Cell("kept" if plan["within_limit"] else "exceeded")


def _parameters(plans: list[Json], level: float) -> Table:
    columns = [("parameter", "left"), (f"within {percent(level)}", "right"), *ERROR_COLUMNS]
    rows = []
    for plan in plans:
        mark, words = standing(plan)
        about = f"{sentence(plan['words'])} ({words})"
        rows.append(
            row_of(clipped(plan["name"], LONGEST_NAME), Cell(about, span=len(columns) - 1), tone=mark)
        )
        for row in plan["parameters"]:
            name = label(row["name"])
            if not determined(row, plan["control"]):
                untold = Cell(NOT_DETERMINED, span=len(columns) - 1)
                rows.append(row_of(name, untold, tone="unidentifiable"))
                continue
            cell = share_cell(row["coverage"][0], plan["control"])
            rows.append(row_of(name, cell, *error_cells(row, row["coverage"][0]["of"]), tone=cell.mark))
    caption = (
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval; bias and root mean"
        " square error, next to what was predicted"
    )
    return table_of(caption, columns, rows)


def _time(plans: list[Json]) -> Table:
    columns = [("plan", "left"), *((name, "right") for name in (*PHASES, "total", "longest"))]
    rows = []
    for plan in plans:
        told = plan["seconds"]
        means = [seconds(told[name]["mean"]) for name in (*PHASES, "total")]
        rows.append(row_of(clipped(plan["name"], LONGEST_NAME), *means, seconds(told["total"]["max"])))
    return table_of("Mean time of a run by phase, and the longest run", columns, rows)


def _runs(plans: list[Json]) -> Table:
    columns = [
        ("plan", "left"),
        ("runs", "right"),
        ("no result", "right"),
        ("refused", "right"),
        ("contradicted", "right"),
        ("used, mean", "right"),
        ("range", "right"),
        ("saved, mean", "right"),
        ("computing", "right"),
    ]
    rows = []
    for plan in plans:
        used = plan["shots_used"]
        rows.append(
            row_of(
                clipped(plan["name"], LONGEST_NAME),
                str(plan["runs"]),
                str(plan["failed"]),
                str(plan["refused"]),
                str(plan["contradicted"]),
                NOT_GIVEN if used["mean"] is None else numbers.significant(used["mean"]),
                NOT_GIVEN if used["min"] is None else f"{used['min']} to {used['max']}",
                "not adaptive" if plan["saved"] is None else numbers.significant(plan["saved"], 2),
                seconds(plan["computing_s"]),
            )
        )
    caption = (
        "Runs, and how many have no result; shots refused in all runs; runs that say that they"
        " contradict the model; shots used in a run, and saved by the"
        " adaptive order; real time to compute a run"
    )
    return table_of(caption, columns, rows)


def _failures(plan: Json) -> Paragraph | None:
    """Why runs of a plan have no result; None where all have one."""
    told = [sentence(failure) for failure in plan["failures"]]
    return Paragraph(f"{plan_title(plan)}, runs without a result: {listed(told)}.") if told else None


def _plans(plans: list[Json]) -> list[tuple[str, str]]:
    return [(clipped(plan["name"], LONGEST_NAME), plan_in_words(plan, plan["noise"])) for plan in plans]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def parameter_rows(answer: Json) -> Iterator[Json]:
    """One row for each plan and parameter; nothing but names where the plan cannot tell it."""
    for plan in judged(answer):
        for row in plan["parameters"]:
            told = plan["control"] or row["status"] != "unidentifiable"
            entry = row["coverage"][0] if determined(row, plan["control"]) else {}
            yield {
                "plan": plan["name"],
                "control": plan["control"],
                "parameter": row["name"],
                "unit": row["unit"],
                "status": row["status"],
                "level": answer["settings"]["level"],
                **{key: entry.get(key) for key in _SHARE},
                **{key: row[key] if told else None for key in _ERRORS},
            }


def time_rows(answer: Json) -> Iterator[Json]:
    """One row for each plan and phase, and one for its total, seconds."""
    for plan in answer["plans"]:
        for phase in (*PHASES, "total"):
            told = plan["seconds"][phase]
            yield {"plan": plan["name"], "phase": phase, "mean_s": told["mean"], "max_s": told["max"]}


def plan_rows(answer: Json) -> Iterator[Json]:
    """One row for each plan."""
    for plan in answer["plans"]:
        yield {
            "plan": plan["name"],
            **{key: plan[key] for key in ("control", "agrees", "robot", "shots")},
            **plan["noise"],
            **{key: plan[key] for key in ("runs", "failed", "refused", "contradicted", "within_limit")},
            **{f"shots_{key}": plan["shots_used"][key] for key in ("mean", "min", "max")},
            **{key: plan[key] for key in ("saved", "computing_s")},
        }
