"""The page of the study `coverage`: do the intervals of each estimator contain the true value as often as
stated?"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from ...experiments.studies.answer import ObservedParameter, Share
from ...experiments.studies.coverage import CoveragePlan, CoverageStudy, RankedParameter
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, sentence
from ..style.blocks import FigureBlock, Legend, Page, Paragraph, Section, section_of
from ..style.canvas import Picture
from ..style.palette import light
from . import study_blocks as blocks
from .study_figures import Across, Curve, CurvePanel, Dot, Look, MarkRow, Scale, curves_picture, rows_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HALF_WIDTH = 6.0  # of a panel, in binomial standard deviations
_ACROSS, _BAND = 5, 0.99  # histograms of ranks side by side; what the band holds of their bins


def coverage_page(answer: CoverageStudy) -> Page:
    """The display strings of a coverage study."""
    settings, plans = answer.settings, answer.plans
    estimators = [estimator for plan in plans for estimator in plan.estimators]
    sections = [
        section_of(
            "All plans",
            blocks.overview(
                f"{blocks.FARTHEST} each level",
                ["estimator", "intervals", *map(blocks.percent, settings.levels)],
                [(blocks.plan_title(plan.name), sentence(plan.words), plan.estimators) for plan in plans],
                lambda part: [blocks.worst_cell(part, level) for level in settings.levels],
            ),
            Legend(blocks.meanings(estimators, [part for plan in plans for part in plan.sbc]), []),
            Paragraph(blocks.BY_CHANCE),
            brief=True,
        )
    ]
    details = [section for i, plan in enumerate(plans, start=1) for section in _plan(plan, i)]
    if text := comparison(plans):
        title = "The midpoint fit against the likelihood fit"
        details.append(section_of(title, Paragraph(text), FigureBlock("accuracy"), brief=True))
    for number, plan in enumerate(plans, start=1):
        details += _numbers(plan, answer, number)
    return blocks.view_of(
        answer,
        f"{settings.data_sets} simulated data sets for each of {counted(len(plans), 'plan')}",
        sections,
        "coverage.csv and ranks.csv hold the shares and the ranks",
        details=details,
    )


def _plan(plan: CoveragePlan, number: int) -> list[Section]:
    without = [
        label(row.name)
        for part in plan.estimators
        for row in part.parameters
        if not (part.control or row.shares)
    ]
    more = [("Data sets", str(plan.data_sets)), blocks.unmet_fact(plan.failed)]
    more += [(blocks.NOT_DETERMINED, listed(list(dict.fromkeys(without))))] if without else []
    # Facts, sentences and figure fit one page; what else there is of the plan comes at the end.
    legend = Legend([], blocks.verdicts([*plan.estimators, *plan.sbc]))
    return [
        section_of(blocks.plan_title(plan.name), blocks.plan_facts(plan, *more), new_page=True, brief=True),
        section_of("Coverage", legend, FigureBlock(f"coverage_{number}"), level=2, brief=True),
    ]


def _numbers(plan: CoveragePlan, answer: CoverageStudy, number: int) -> list[Section]:
    """The tables of a plan, and its ranks."""
    levels, bins = answer.settings.levels, answer.settings.bins

    def shares(row: ObservedParameter, control: bool) -> blocks.Cells | None:
        entries = {entry.level: entry for entry in row.shares}
        return [blocks.share_cell(entries.get(level), control) for level in levels] if entries else None

    def ranks(row: RankedParameter, control: bool) -> blocks.Cells | None:
        tested = row.chi2 is not None and row.p_value is not None
        return [numbers.significant(row.chi2 or 0), numbers.p_value(row.p_value or 0)] if tested else None

    accuracy = "Bias and root mean square error, next to what was predicted"
    of_ranks = [f"χ² ({bins - 1} degrees of freedom)", "p-value"]
    tables = section_of(
        f"{blocks.plan_title(plan.name)}, numbers and ranks",
        blocks.parts_table(blocks.SHARES, [*map(blocks.percent, levels)], plan.estimators, shares),
        blocks.parts_table(
            accuracy,
            blocks.ERROR_COLUMNS,
            plan.estimators,
            lambda row, _: blocks.error_cells(row, max(1, plan.data_sets)),
        ),
        new_page=True,
    )
    return [
        replace(tables, folded=True),
        section_of(
            "Ranks of the true value among the draws",
            *(
                Paragraph(
                    f"{clipped(part.name, blocks.LONGEST_NAME)}, power of the test: {sentence(part.power)}."
                )
                for part in plan.sbc
                if part.power
            ),
            FigureBlock(f"ranks_{number}"),
            blocks.parts_table("Are the ranks uniform?", of_ranks, plan.sbc, ranks) if plan.sbc else None,
            level=2,
        ),
    ]


def coverage_pictures(answer: CoverageStudy) -> list[Picture | None]:
    """Two for each plan, and one for all."""
    drawn: list[Picture | None] = []
    for number, plan in enumerate(answer.plans, start=1):
        # Numbered, since a plan's name may be anything.
        title = f"Plan {clipped(plan.name, 40)}: intervals that contain the true value"
        name, runs = f"coverage_{number}", max(1, plan.data_sets)
        drawn.append(shares_picture(plan.estimators, answer.settings.levels, runs, name, title))
        drawn.append(_ranks_picture(plan, answer.settings.draws, f"ranks_{number}"))
    return [*drawn, _accuracy_picture(answer.plans)]


def coverage_rows(answer: CoverageStudy) -> Iterator[blocks.PlainRow]:
    """One row for each plan, estimator, parameter and level."""
    for plan, part, row in _rows(answer, "estimators"):
        entries = {entry.level: entry for entry in row.shares}
        names = {"plan": plan.name, "estimator": part.name, "control": part.control, "parameter": row.name}
        for level in answer.settings.levels:
            share_columns = blocks.columns_of(entries.get(level), *blocks.SHARE_COLUMNS.split())
            yield {**names, "status": row.status, "level": level, **share_columns}


def rank_rows(answer: CoverageStudy) -> Iterator[blocks.PlainRow]:
    """One row for each plan, sampler, parameter and bin."""
    for plan, part, row in _rows(answer, "sbc"):
        names = {"plan": plan.name, "estimator": part.name, "control": part.control, "parameter": row.name}
        for number, count in enumerate(row.ranks):
            yield {**names, "bin": number, "count": count}


def _rows(answer: CoverageStudy, kind: str) -> Iterator[tuple[CoveragePlan, Any, Any]]:
    for plan in answer.plans:
        for part in getattr(plan, kind):
            for row in part.parameters:
                yield plan, part, row


# ── shares of intervals, of any study ─────────────────────────────────────────────────────────


def shares_picture(
    parts: Sequence[blocks.Marked], levels: Sequence[float], runs: int, name: str, title: str
) -> Picture:
    """Rows are the parameters of each part, dots their shares of `runs` with binomial intervals.

    Each panel is as wide as six binomial standard deviations either side of its level, so that what
    agrees can be seen to; what lies outside is at the edge as a triangle with its share.
    """
    rows = []
    for part in parts:
        rows.append(MarkRow(f"{clipped(part.name, 32)} ({blocks.standing(part)[1]})", head=True))
        for row in part.parameters:
            marks = [
                [_share_mark(entry, part.control) for entry in row.shares if entry.level == level]
                for level in levels
            ]
            gap = "" if row.shares else blocks.NOT_DETERMINED
            rows.append(MarkRow(label(row.name, 10), marks, gap))
    title += ". Line: as stated; triangle: a share outside the panel, with its number"
    return rows_picture(name, title, _shares_alt(parts, levels), rows, [_panel(at, runs) for at in levels])


def _panel(level: float, runs: int) -> Across:
    half = _HALF_WIDTH * math.sqrt(level * (1 - level) / runs)
    step = 10.0 ** math.floor(math.log10(90 * half))
    step *= max(factor for factor in (1, 2, 5) if factor * step <= 90 * half)
    ticks = [tick for tick in (100 * level - step, 100 * level, 100 * level + step) if 0 <= tick <= 100]
    low, high = 100 * max(level - half, 0.0), 100 * min(level + half, 1.0)
    scale = Scale(ends=(low, high), ticks=ticks)
    return Across("share that holds, %", scale, [100 * level], blocks.percent(level))


def _share_mark(entry: Share, control: bool) -> Dot:
    """A dot on the line, a diamond off it; hollow for a control."""
    role = "identified" if entry.agrees else "held" if control else "weak"
    at, low, high = (100 * value for value in (entry.share, entry.low, entry.high))
    look = Look(role=role, shape="o" if entry.agrees else "D", filled=not control, size=3.8)
    return Dot(at, low, high, look, beyond=blocks.share(entry))


def _shares_alt(parts: Sequence[blocks.Marked], levels: Sequence[float]) -> str:
    texts = []
    for part in parts:
        worst = [(level, pair) for level in levels if (pair := blocks.worst_at(part, level)) is not None]
        text = ", ".join(
            f"{blocks.percent(level)}: {label(row.name)} {blocks.share(entry)}{numbers.NO_BREAK}%"
            for level, (row, entry) in worst
        )
        texts.append(
            f"{clipped(part.name, 40)} ({blocks.standing(part)[1]}): {text or blocks.NOT_DETERMINED}"
        )
    return (
        "Share of intervals that contain the true value, of each estimator the parameter farthest from each"
        f" level. {'; '.join(texts)}. The table below it has every share."
    )


# ── rank histograms of simulation-based calibration (Talts et al. 2018), a panel a parameter ──


def _ranks_picture(plan: CoveragePlan, draws: int, name: str) -> Picture | None:
    """Histograms of the ranks of the truth among the draws, with the band that holds 99 % of uniform bins; a
    bin outside it is solid. None where the plan has no ranks."""
    panels, texts = [], []
    for part in plan.sbc:
        heading, tests, beyond = f"{clipped(part.name, 40)} ({blocks.standing(part)[1]})", [], 0
        rows = [row for row in part.parameters if sum(row.ranks)]
        for row in rows:
            panel, outside = _histogram(row, f"{part.name}\n" if len(plan.sbc) > 1 else "")
            panels.append(panel)
            beyond += outside
            tests += [] if row.p_value is None else [f"{label(row.name)} {numbers.p_value(row.p_value)}"]
        text = f"{heading}: {beyond} of {sum(len(row.ranks) for row in rows)} bins lie outside the band"
        texts.append(f"{text}; p-values {', '.join(tests)}." if tests else f"{text}.")
    if not panels:
        return None
    title = (
        f"Plan {clipped(plan.name, 40)}: how many true values have each rank. Uniform ranks have 99 % of the"
        " bins within the grey band (solid: outside it)"
    )
    return curves_picture(
        name,
        title,
        f"Histograms of ranks. {' '.join(texts)}",
        panels,
        Scale(),
        wide=_ACROSS,
        panel_height=0.95,
        across=f"rank of the true value among {draws} draws, from lowest to highest",
        up="true values",
    )


def _histogram(row: RankedParameter, above: str) -> tuple[CurvePanel, int]:
    """A panel, and how many bins lie outside the band."""
    ranks, x = np.asarray(row.ranks), np.arange(len(row.ranks))
    low, high = stats.binom.interval(_BAND, ranks.sum(), 1 / len(ranks))
    out = (ranks < low) | (ranks > high)

    def bars(axes: Axes) -> None:
        axes.axhspan(low, high, facecolor=light("line"), edgecolor="none", alpha=0.65)
        for which, role, alpha in ((~out, "identified", 0.4), (out, "weak", 1.0)):
            axes.bar(x[which], ranks[which], width=0.86, color=light(role), alpha=alpha, linewidth=0)
        axes.set(xticks=[], yticks=[float(ranks.mean())])
        axes.grid(visible=False)
        axes.tick_params(labelsize=7.5, length=2)

    p_value = "" if row.p_value is None else f"  p {numbers.p_value(row.p_value)}"
    scale, head = Scale(ends=(0, 1.1 * max(ranks.max(), high))), f"{above}{label(row.name, 9)}{p_value}"
    panel = CurvePanel(
        [Curve(x.tolist(), ranks.tolist(), "", Look(shape="", stroke=""))], scale, head=head, more=bars
    )
    return replace(panel, line=float(ranks.mean())), int(out.sum())


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


def _ratios(plan: CoveragePlan) -> dict[str, tuple[float, float]]:
    """The rmse of the midpoint fit over that of the likelihood fit, from the same data, with its standard
    error, by the parameters that both determine; empty if the plan lacks one of the two.

    Each rmse of n data sets has the relative error 1/√(2n); the two share their data and are correlated, so
    that the standard error of the ratio is at most √2 times that.
    """
    rows = {one.name: {row.name: row.rmse for row in one.parameters} for one in plan.estimators}
    likelihood, n = rows.get("likelihood", {}), max(1, plan.data_sets)
    ratios = {
        name: rmse / other
        for name, rmse in rows.get("midpoint", {}).items()
        if rmse and (other := likelihood.get(name))
    }
    return {name: (ratio, ratio / math.sqrt(n)) for name, ratio in ratios.items()}


def comparison(plans: Sequence[CoveragePlan]) -> str:
    """How much worse the midpoint fit is, in a sentence; empty where no plan has both fits."""
    parts = []
    for plan in plans:
        if ratios := sorted(_ratios(plan).values()):
            between = numbers.interval((ratios[0][0], ratios[-1][0]), ratios[-1][1])
            parts.append(f"{between} times for the plan {clipped(plan.name, blocks.LONGEST_NAME)}")
    if not parts:
        return ""
    return (
        "The rmse of the midpoint fit (eq. 8) as a multiple of the likelihood fit’s, from the"
        f" same data: {'; '.join(parts)}. Above 1 the midpoint fit is the worse."
    )


def _accuracy_picture(plans: Sequence[CoveragePlan]) -> Picture | None:
    """The ratio of the two rmse; None where there are none. The biases are in the tables."""
    rows, texts = [], []
    for plan in plans:
        if ratios := _ratios(plan):
            rows.append(MarkRow(f"plan {clipped(plan.name, 30)}", head=True))
            words = [numbers.estimate(*ratio) for ratio in ratios.values()]
            for (name, (ratio, std)), text in zip(ratios.items(), words, strict=True):
                half = NORMAL_95 * std
                dot = Dot(ratio, max(ratio - half, 0), ratio + half, Look(role="ink"), text)
                rows.append(MarkRow(label(name, 9), [[dot]]))
            by_name = (f"{label(name)} {text}" for name, text in zip(ratios, words, strict=True))
            texts.append(f"plan {clipped(plan.name, 40)}: {', '.join(by_name)}")
    if not rows:
        return None
    return rows_picture(
        "accuracy",
        "The midpoint fit (eq. 8) against the likelihood fit, from the same data: ratio of their rmse, 95 %",
        f"The rmse of the midpoint fit as a multiple of the likelihood fit’s: {'; '.join(texts)}.",
        rows,
        [Across("rmse, midpoint ÷ likelihood", lines=[1.0])],
    )
