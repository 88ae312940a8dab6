"""The study `coverage`: do the intervals of each estimator hold what they promise?"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
    Row,
    Section,
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
    has_errors,
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
    about_study,
    files_block,
    noise_in_words,
    plan_title,
    plans_counted,
    view_of,
)

Json = dict[str, Any]


def coverage_view(answer: Json) -> Page:
    """The display strings of a coverage study."""
    settings, plans = answer["settings"], answer["plans"]
    parts = [part for plan in plans for part in (*plan["estimators"], *plan["sbc"])]
    said = comparison(plans)
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings["levels"]),
            Legend(meanings(parts), []),
            Paragraph(BY_CHANCE),
        ),
        section_of(
            "How it was done",
            _settings(answer),
            files_block("coverage.csv and ranks.csv hold the shares and the ranks"),
        ),
        *(section for i, plan in enumerate(plans, start=1) for section in _plan(plan, settings, i)),
    ]
    if said:
        title = "The midpoint fit against the likelihood fit"
        sections.append(section_of(title, Paragraph(said), FigureBlock("accuracy")))
    subtitle = f"{settings['data_sets']} simulated data sets for each of {plans_counted(answer)}"
    return view_of(answer, f"{subtitle}, seed {settings['seed']}", sections)


# ── all plans ─────────────────────────────────────────────────────────────────────────────────


def overview_caption() -> str:
    return "Share of intervals that hold the truth, in %: the parameter farthest from each level"


def _overview(plans: list[Json], levels: list[float]) -> Table:
    # The standing second, so that a phone shows it without scrolling.
    columns = [("estimator", "left"), ("intervals", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for plan in plans:
        rows.append(row_of(plan_title(plan), Cell(sentence(plan["words"]), span=len(columns) - 1)))
        for estimator in plan["estimators"]:
            mark, words = standing(estimator)
            cells = [worst_cell(estimator, level) for level in levels]
            name = clipped(estimator["name"], LONGEST_NAME)
            rows.append(row_of(name, Cell(words, mark=mark), *cells, tone=mark))
    return table_of(overview_caption(), columns, rows)


def _settings(answer: Json) -> Facts:
    settings = answer["settings"]
    return about_study(
        answer,
        [
            ("Data sets for each plan", str(settings["data_sets"])),
            ("Seed", str(settings["seed"])),
            ("Levels", ", ".join(percent(level) for level in settings["levels"])),
            ("Draws behind each rank", str(settings["draws"])),
            ("Bins of the rank histograms", str(settings["bins"])),
            ("Posterior", sentence(str(settings["posterior"]))),
        ],
    )


# ── one plan ──────────────────────────────────────────────────────────────────────────────────


def _plan(plan: Json, settings: Json, number: int) -> list[Section]:
    facts = [
        ("Plan", sentence(plan["words"])),
        ("Robot", clipped(plan["robot"])),
        ("Shots", str(plan["shots"])),
        ("Noise", noise_in_words(plan["noise"])),
        ("Data sets", str(plan["data_sets"])),
        ("Truths not met", f"{plan['failed']} (others drawn in their place)" if plan["failed"] else "none"),
    ]
    powers, uniformity = _powers(plan["sbc"]), _ranks_table(plan["sbc"], settings["bins"])
    # The facts, the sentences and the first figure of a plan fit one page.
    return [
        section_of(plan_title(plan), Facts(facts), new_page=True),
        section_of(
            "Coverage",
            Legend([], verdicts(plan["estimators"])),
            FigureBlock(f"coverage_{number}"),
            _coverage_table(plan, settings["levels"]),
            _accuracy_table(plan),
            level=2,
        ),
        section_of(
            "Ranks of the truth among the draws",
            Legend([], verdicts(plan["sbc"])),
            Paragraph(powers) if powers else None,
            FigureBlock(f"ranks_{number}"),
            uniformity,
            level=2,
        ),
    ]


def _powers(parts: list[Json]) -> str:
    """What the uniformity test could have found, said once where it is the same for all."""
    said: dict[str, list[str]] = {}
    for part in parts:
        if part["power"]:
            said.setdefault(sentence(part["power"]).rstrip("."), []).append(
                clipped(part["name"], LONGEST_NAME)
            )
    if len(said) == 1:
        return f"Power of the test: {next(iter(said))}."
    return " ".join(f"Power of the test for {listed(names)}: {text}." for text, names in said.items())


def _coverage_table(plan: Json, levels: list[float]) -> Table:
    columns = [("parameter", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for estimator in plan["estimators"]:
        rows.append(_group(estimator, len(levels)))
        for row in estimator["parameters"]:
            if not determined(row, estimator["control"]):
                words = Cell(NOT_DETERMINED, span=len(levels))
                rows.append(row_of(label(row["name"]), words, tone="unidentifiable"))
                continue
            entries = {entry["level"]: entry for entry in row["coverage"]}
            cells = [share_cell(entries.get(level), estimator["control"]) for level in levels]
            tone = "weak" if any(cell.mark for cell in cells) else ""
            rows.append(row_of(label(row["name"]), *cells, tone=tone))
    return table_of(
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval", columns, rows
    )


def _group(part: Json, span: int) -> Row:
    """The row that heads an estimator's parameters."""
    mark, words = standing(part)
    # A name beside its own mark and words; what it does is said by the words of the estimator.
    about = f"{sentence(part['words'])} ({words})" if "words" in part else words
    return row_of(clipped(part["name"], LONGEST_NAME), Cell(about, span=span), tone=mark)


def _accuracy_table(plan: Json) -> Table:
    rows = []
    for estimator in plan["estimators"]:
        rows.append(_group(estimator, len(ERROR_COLUMNS)))
        for row in estimator["parameters"]:
            tone = "" if has_errors(row) else "unidentifiable"
            rows.append(row_of(label(row["name"]), *error_cells(row, solved(plan)), tone=tone))
    columns = [("parameter", "left"), *ERROR_COLUMNS]
    return table_of("Bias and root mean square error, next to what was predicted", columns, rows)


def solved(plan: Json) -> int:
    """The number of data sets, on which bias and rmse rest."""
    return max(1, int(plan["data_sets"]))


def _ranks_table(parts: list[Json], bins: int) -> Table | None:
    rows = []
    for part in parts:
        rows.append(_group(part, 2))
        for row in part["parameters"]:
            chi2, p = row["chi2"], row["p_value"]
            if chi2 is None or p is None:
                words = Cell(NOT_DETERMINED, span=2)
                rows.append(row_of(label(row["name"]), words, tone="unidentifiable"))
            else:
                rows.append(row_of(label(row["name"]), numbers.significant(chi2), numbers.p_value(p)))
    columns = [("parameter", "left"), (f"χ² ({bins - 1} degrees of freedom)", "right"), ("p-value", "right")]
    return table_of("Are the ranks uniform?", columns, rows) if rows else None


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


def rmse_ratios(plan: Json) -> list[tuple[Json, Json, float]] | None:
    """Midpoint row, likelihood row and the ratio of their rmse for each parameter that both tell.

    None if the plan lacks one of the two estimators.
    """
    estimators = {estimator["name"]: estimator for estimator in plan["estimators"]}
    if "midpoint" not in estimators or "likelihood" not in estimators:
        return None
    likelihood = {row["name"]: row for row in estimators["likelihood"]["parameters"]}
    pairs = [(row, likelihood.get(row["name"])) for row in estimators["midpoint"]["parameters"]]
    return [
        (midpoint, other, midpoint["rmse"] / other["rmse"])
        for midpoint, other in pairs
        if other is not None and has_errors(midpoint) and has_errors(other)
    ]


def ratio_std(ratio: float, plan: Json) -> float:
    """An upper bound for the standard error of such a ratio.

    Each rmse of n data sets has the relative error 1/√(2n); the two share their data and are
    correlated, so that the error of the ratio is at most √2 times that.
    """
    return ratio / math.sqrt(solved(plan))


def comparison(plans: list[Json]) -> str:
    """How much worse the midpoint fit is, in a sentence; empty where no plan has both fits."""
    found = [(plan, ratios) for plan in plans if (ratios := rmse_ratios(plan))]
    if not found:
        return ""
    parts = []
    for plan, ratios in found:
        low, high = min(r for *_, r in ratios), max(r for *_, r in ratios)
        told = numbers.interval((low, high), ratio_std(high, plan))
        parts.append(f"{told} times for the plan {clipped(plan['name'], LONGEST_NAME)}")
    return (
        "The rmse of the midpoint fit (eq. 8) as a multiple of the likelihood fit’s, from the"
        f" same data: {'; '.join(parts)}. Above 1 the midpoint fit is the worse."
    )


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def coverage_rows(answer: Json) -> Iterator[Json]:
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


def rank_rows(answer: Json) -> Iterator[Json]:
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
