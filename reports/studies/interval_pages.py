"""The studies that count how often intervals contain the true value: `coverage`, `cell` and `geometry`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from ...experiments.procedure.beam_ports import PHASES
from ...experiments.studies.answer import JudgedPart, Share
from ...experiments.studies.cell import CellPlan, CellStudy
from ...experiments.studies.coverage import CoveragePlan, CoverageStudy, RankedParameter
from ...experiments.studies.geometry_coverage import GeometryParameter, GeometryPlan, GeometryStudy
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, sentence
from ..style.blocks import FigureBlock, Legend, Paragraph, Section, section_of
from ..style.canvas import Picture
from ..style.theme import light
from . import study_blocks as blocks
from .study_figures import (
    Across,
    Curve,
    CurvePanel,
    Dot,
    Look,
    MarkRow,
    Scale,
    Stretch,
    curves_picture,
    rows_picture,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HALF_WIDTH = 6.0  # of a panel, in binomial standard deviations
_ACROSS, _BAND = 5, 0.99  # histograms of ranks side by side; what the band holds of their bins
# Phases are no statuses: one hue, from dark to faint, and in the order of the legend.
_SHADES = dict(zip(PHASES, (1.0, 0.66, 0.4, 0.2), strict=True))
_SHARES = "held of share low high agrees"
_ERRORS = "bias bias_mcse rmse predicted_std"


def _hold(level: float) -> str:
    return f"How often the {blocks.percent(level)} intervals contain the true value"


def _shares_picture(
    parts: Sequence[JudgedPart], levels: Sequence[float], runs: int, name: str, title: str
) -> Picture | None:
    """Rows are the parameters of each part, dots their shares of `runs` with binomial intervals: on the line,
    or a diamond off it, hollow for a control. None where there are no parts.

    Each panel is as wide as six binomial standard deviations either side of its level, so that what
    agrees can be seen to; what lies outside is at the edge as a triangle with its share.
    """

    def mark(entry: Share, control: bool) -> Dot:
        at, low, high = (100 * value for value in (entry.share, entry.low, entry.high))
        look = Look(
            role=_role(entry, control), shape="o" if entry.agrees else "D", filled=not control, size=3.8
        )
        return Dot(at, low, high, look, beyond=blocks.share(entry))

    rows = []
    for part in parts:
        rows.append(MarkRow(f"{clipped(part.name, 32)} ({blocks.standing(part).text})", head=True))
        for row in part.parameters:
            at = [[mark(one, part.control) for one in row.shares if one.level == level] for level in levels]
            rows.append(MarkRow(label(row.name, 10), at, "" if row.shares else blocks.NOT_DETERMINED))
    title += ". Line: as stated; triangle: a share outside the panel, with its number"
    about = (
        f"Share of intervals that contain the true value, in %, at {', '.join(map(blocks.percent, levels))}."
    )
    return rows_picture(name, title, about, rows, [_panel(at, runs) for at in levels])


def _panel(level: float, runs: int) -> Across:
    half = _HALF_WIDTH * math.sqrt(level * (1 - level) / runs)
    step = 10.0 ** math.floor(math.log10(90 * half))
    step *= max(factor for factor in (1, 2, 5) if factor * step <= 90 * half)
    ticks = [tick for tick in (100 * level - step, 100 * level, 100 * level + step) if 0 <= tick <= 100]
    ends = (100 * max(level - half, 0.0), 100 * min(level + half, 1.0))
    return Across("share that holds, %", Scale(ends=ends, ticks=ticks), [100 * level], blocks.percent(level))


def _role(thing: Any, control: bool) -> str:
    return "identified" if thing.agrees else "held" if control else "weak"


# ── coverage ──────────────────────────────────────────────────────────────────────────────────


def _of_coverage(answer: CoverageStudy) -> list[Section]:
    plans = answer.plans
    estimators = [estimator for plan in plans for estimator in plan.estimators]
    every = blocks.overview(
        f"{blocks.FARTHEST} each level",
        "estimator",
        [(blocks.plan_title(plan), sentence(plan.words), plan.estimators) for plan in plans],
        [(blocks.percent(level), blocks.farthest(level)) for level in answer.settings.levels],
    )
    ranks = [part for plan in plans for part in plan.sbc]
    legend = Legend(blocks.meanings(estimators, ranks), [])
    return [section_of("All plans", every, legend, Paragraph(blocks.BY_CHANCE), brief=True)]


def _details_of_coverage(answer: CoverageStudy) -> Iterator[Section]:
    for number, plan in enumerate(answer.plans, start=1):
        parts = [part for part in plan.estimators if not part.control]
        without = dict.fromkeys(
            label(row.name) for part in parts for row in part.parameters if not row.shares
        )
        more = [(blocks.NOT_DETERMINED, listed(list(without)))] if without else []
        facts = blocks.plan_facts(plan, ("Data sets", str(plan.data_sets)), more=more)
        # Facts, sentences and figure fit one page; what else there is of the plan comes at the end.
        yield section_of(blocks.plan_title(plan), facts, new_page=True, brief=True)
        legend = Legend([], blocks.verdicts([*plan.estimators, *plan.sbc]))
        yield section_of("Coverage", legend, FigureBlock(f"coverage_{number}"), level=2, brief=True)
    if text := _comparison(answer.plans):
        title = "The midpoint fit against the likelihood fit"
        yield section_of(title, Paragraph(text), FigureBlock("accuracy"), brief=True)
    for number, plan in enumerate(answer.plans, start=1):
        yield from _numbers(plan, answer, number)


def _numbers(plan: CoveragePlan, answer: CoverageStudy, number: int) -> list[Section]:
    """The tables of a plan, and its ranks."""
    levels, bins = answer.settings.levels, answer.settings.bins

    def shares(row: Any, control: bool) -> blocks.Cells | None:
        entries = {entry.level: entry for entry in row.shares}
        return [blocks.share_cell(entries.get(level), control) for level in levels] if entries else None

    def errors(row: Any, control: bool) -> blocks.Cells | None:
        return blocks.error_cells(row, max(1, plan.data_sets))

    def ranks(row: RankedParameter, control: bool) -> blocks.Cells | None:
        tested = row.chi2 is not None and row.p_value is not None
        return [numbers.significant(row.chi2 or 0), numbers.p_value(row.p_value or 0)] if tested else None

    accuracy = "Bias and root mean square error, next to what was predicted"
    of_ranks = [f"χ² ({bins - 1} degrees of freedom)", "p-value"]
    tables = section_of(
        f"{blocks.plan_title(plan)}, numbers and ranks",
        blocks.parts_table(blocks.SHARES, [*map(blocks.percent, levels)], plan.estimators, shares),
        blocks.parts_table(accuracy, blocks.ERROR_COLUMNS, plan.estimators, errors),
        new_page=True,
    )
    powers = [
        Paragraph(f"{blocks.name_of(part)}, power of the test: {sentence(part.power)}.")
        for part in plan.sbc
        if part.power
    ]
    tests = blocks.parts_table("Are the ranks uniform?", of_ranks, plan.sbc, ranks) if plan.sbc else None
    title = "Ranks of the true value among the draws"
    return [
        replace(tables, folded=True),
        section_of(title, *powers, FigureBlock(f"ranks_{number}"), tests, level=2),
    ]


def _drawn_of_coverage(answer: CoverageStudy) -> Iterator[Picture | None]:
    """Two for each plan, and one for all."""
    levels = answer.settings.levels
    for number, plan in enumerate(answer.plans, start=1):
        # Numbered, since a plan's name may be anything.
        title = f"Plan {clipped(plan.name, 40)}: intervals that contain the true value"
        runs = max(1, plan.data_sets)
        yield _shares_picture(plan.estimators, levels, runs, f"coverage_{number}", title)
        yield _ranks_picture(plan, answer.settings.draws, f"ranks_{number}")
    yield _accuracy_picture(answer.plans)


def _ranks_picture(plan: CoveragePlan, draws: int, name: str) -> Picture | None:
    """Histograms of the ranks of the truth among the draws (Talts et al. 2018), with the band that holds 99 %
    of uniform bins; a bin outside it is solid. None where the plan has no ranks."""
    panels = [
        _histogram(row, f"{part.name}\n" if len(plan.sbc) > 1 else "")
        for part in plan.sbc
        for row in part.parameters
        if sum(row.ranks)
    ]
    title = (
        f"Plan {clipped(plan.name, 40)}: how many true values have each rank. Uniform ranks have 99 % of the"
        " bins within the grey band (solid: outside it)"
    )
    across = f"rank of the true value among {draws} draws, from lowest to highest"
    if not panels:
        return None
    return curves_picture(
        name,
        title,
        "Histograms of ranks.",
        panels,
        Scale(),
        wide=_ACROSS,
        panel_height=0.95,
        across=across,
        up="true values",
    )


def _histogram(row: RankedParameter, above: str) -> CurvePanel:
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
    head = f"{above}{label(row.name, 9)}{p_value}"
    return CurvePanel(
        [Curve(x.tolist(), ranks.tolist(), "", Look(shape="", stroke=""))],
        Scale(ends=(0, 1.1 * max(ranks.max(), high))),
        head=head,
        line=float(ranks.mean()),
        more=bars,
        words=f"{' '.join(head.split())}: {out.sum()} of {len(ranks)} bins lie outside the band",
    )


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


def _comparison(plans: Sequence[CoveragePlan]) -> str:
    """How much worse the midpoint fit is, in a sentence; empty where no plan has both fits."""
    parts = []
    for plan in plans:
        if ratios := sorted(_ratios(plan).values()):
            between = numbers.interval((ratios[0][0], ratios[-1][0]), ratios[-1][1])
            parts.append(f"{between} times for the plan {blocks.name_of(plan)}")
    text = "The rmse of the midpoint fit (eq. 8) as a multiple of the likelihood fit’s, from the same data: "
    return f"{text}{'; '.join(parts)}. Above 1 the midpoint fit is the worse." if parts else ""


def _accuracy_picture(plans: Sequence[CoveragePlan]) -> Picture | None:
    """The ratio of the two rmse; None where there are none. The biases are in the tables."""
    rows = list[MarkRow]()
    for plan in plans:
        ratios = _ratios(plan)
        rows += [MarkRow(f"plan {clipped(plan.name, 30)}", head=True)] if ratios else []
        for name, (ratio, std) in ratios.items():
            half, words = NORMAL_95 * std, numbers.estimate(ratio, std)
            dot = Dot(ratio, max(ratio - half, 0), ratio + half, Look(role="ink"), words)
            rows.append(MarkRow(label(name, 9), [[dot]]))
    title = (
        "The midpoint fit (eq. 8) against the likelihood fit, from the same data: ratio of their rmse, 95 %"
    )
    about = "The rmse of the midpoint fit as a multiple of the likelihood fit’s."
    across = Across("rmse, midpoint ÷ likelihood", lines=[1.0])
    return rows_picture("accuracy", title, about, rows, [across])


def _at_levels(answer: CoverageStudy, plan: CoveragePlan, part: JudgedPart, row: Any) -> Iterator[object]:
    entries = {entry.level: entry for entry in row.shares}
    return ((level, entries.get(level)) for level in answer.settings.levels)


_PARAMETER = "plan=1.name estimator=2.name 2: control parameter=3.name"
COVERAGE = blocks.Study[CoverageStudy](
    subtitle=lambda answer: (
        f"{answer.settings.data_sets} simulated data sets for each of {counted(len(answer.plans), 'plan')}"
    ),
    sections=_of_coverage,
    details=_details_of_coverage,
    drawn=lambda answer: [*_drawn_of_coverage(answer)],
    hold="coverage.csv and ranks.csv hold the shares and the ranks",
    tables={
        "coverage.csv": blocks.flat(
            "plans estimators parameters", f"{_PARAMETER} 3: status level=4.0 4.1: {_SHARES}", _at_levels
        ),
        "ranks.csv": blocks.flat(
            "plans sbc parameters",
            f"{_PARAMETER} bin=4.0 count=4.1",
            lambda answer, plan, part, row: enumerate(row.ranks),
        ),
    },
)

# ── cell ──────────────────────────────────────────────────────────────────────────────────────


def _seconds(value: float | None) -> str:
    """A time to three significant digits."""
    return blocks.NOT_GIVEN if value is None else numbers.significant(value, 3, "s")


def _times(plan: CellPlan) -> list[str]:
    """Mean time by phase and in total, and that of the longest run."""
    means = [_seconds(plan.seconds[name].mean) for name in (*PHASES, "total")]
    return [*means, _seconds(plan.seconds["total"].max)]


def _runs(plan: CellPlan) -> list[str]:
    used = plan.shots_used
    return [
        *map(str, (plan.runs, plan.failed, plan.refused, plan.contradicted)),
        numbers.or_words(used.mean, blocks.NOT_GIVEN),
        blocks.NOT_GIVEN if used.min is None else f"{used.min} to {used.max}",
        numbers.or_words(plan.saved, "not adaptive", digits=2),
        _seconds(plan.computing_s),
    ]


def _of_cell(answer: CellStudy) -> Iterator[Section]:
    plans, level = answer.plans, answer.settings.level
    within = blocks.percent(level)
    kept = {None: blocks.NOT_GIVEN, True: "kept", False: "exceeded"}
    every = blocks.overview(
        f"{blocks.FARTHEST} {within}; mean and longest time of a run, and its limit",
        "plan",
        [("", "", plans)],
        [
            ("farthest", blocks.farthest(level)),
            ("mean", lambda plan: _times(plan)[-2]),
            ("longest", lambda plan: _times(plan)[-1]),
            ("limit", lambda plan: kept[plan.within_limit]),
        ],
        "llrrrl",
    )
    legend = Legend(blocks.meanings(plans), blocks.verdicts(plans))
    yield section_of("All plans", every, legend, Paragraph(blocks.BY_CHANCE))
    yield section_of(
        f"Time against the limit of {numbers.exact(answer.settings.limit_s, 's')}",
        Paragraph("Simulated time of a run, by the cell’s own clock, with all repeated attempts."),
        FigureBlock("time"),
        blocks.plans_table(
            "Mean time of a run by phase, and the longest run", [*PHASES, "total", "longest"], plans, _times
        ),
    )
    caption = (
        "Runs, and how many have no result; measurements refused in all runs; runs that contradict the"
        " model; measurements used in a run, and saved by the adaptive order; real time to compute a run"
    )
    heads = [
        "runs",
        "no result",
        "refused",
        "contradicted",
        "used, mean",
        "range",
        "saved, mean",
        "computing",
    ]
    failures = [(plan, listed([*map(sentence, plan.failures)])) for plan in plans if plan.failures]
    yield section_of(
        "Runs and measurements",
        blocks.plans_table(caption, heads, plans, _runs),
        *(Paragraph(f"{blocks.plan_title(plan)}, runs without a result: {text}.") for plan, text in failures),
    )
    caption = f"{blocks.SHARES}; bias and root mean square error, next to what was predicted"
    columns = [f"within {within}", *blocks.ERROR_COLUMNS]
    table = blocks.parts_table(caption, columns, plans, blocks.share_and_errors)
    yield section_of(_hold(level), FigureBlock("coverage"), table)


def _drawn_of_cell(answer: CellStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    # The panel is as wide as the fewest runs require; a plan without any has nothing to draw.
    ended = min((plan.runs - plan.failed for plan in plans if plan.runs > plan.failed), default=1)
    title = f"{_hold(level)}, with binomial intervals"
    return [_shares_picture(plans, [level], ended, "coverage", title), _time_picture(answer)]


def _time_picture(answer: CellStudy) -> Picture | None:
    """A bar for each plan: the mean time by phase, a whisker to the longest run, and the limit; None where no
    plan has a time."""
    rows, limit = list[MarkRow](), answer.settings.limit_s
    plans = [plan for plan in answer.plans if plan.seconds["total"].mean is not None]
    for plan in plans:
        longest, begin = plan.seconds["total"].max or 0.0, 0.0
        bars: list[Dot | Stretch] = []
        for phase in PHASES:
            end = begin + (plan.seconds[phase].mean or 0.0)
            bars.append(Stretch(begin, end, _SHADES[phase], 0.6))
            begin = end
        bars.append(Dot(longest, begin, longest, Look(role="ink", shape="|", size=7)))
        *means, total, most = _times(plan)
        words = ", ".join(f"{phase} {mean}" for phase, mean in zip(PHASES, means, strict=True))
        rows.append(MarkRow(f"{clipped(plan.name, 36)}: {total}, longest {most}", head=True))
        rows.append(MarkRow("", [bars], words=words))
    text = numbers.exact(limit, "s")
    end = 1.03 * max([limit, *(plan.seconds["total"].max or 0.0 for plan in plans)])
    title = "Simulated time of a run by phase, mean; whisker: the longest run; line: the limit of"
    return rows_picture(
        "time",
        f"{title} {limit:g} s",
        f"Mean time of a run, against the limit of {text}.",
        rows,
        [Across("time of a run, s", Scale(ends=(0.0, end)), [limit], text)],
        [(Stretch(0, 1, shade), phase) for phase, shade in _SHADES.items()],
        row_height=0.23,
    )


CELL = blocks.Study[CellStudy](
    subtitle=lambda answer: (
        f"{answer.settings.runs} simulated runs for each of"
        f" {counted(len(answer.plans), 'plan')}, {'with' if answer.settings.camera else 'without'} camera"
    ),
    sections=_of_cell,
    details=lambda answer: [
        blocks.plans_in_words(answer.plans, lambda plan: blocks.noise_in_words(plan.noise))
    ],
    drawn=_drawn_of_cell,
    hold="parameters.csv, time.csv and plans.csv hold the shares and errors, the times and the runs",
    tables={
        "parameters.csv": blocks.flat(
            "plans parameters coverage",
            "plan=1.name 1: control parameter=2.name 2: unit status 0.settings: level"
            f" 3: {_SHARES} 2: {_ERRORS}",
        ),
        "time.csv": blocks.flat("plans seconds", "plan=1.name phase=2.0 mean_s=2.1.mean max_s=2.1.max"),
        "plans.csv": blocks.flat(
            "plans",
            "plan=1.name control agrees robot shots 1.noise: joint_deg spot_mm 1: runs failed refused"
            " contradicted within_limit shots_mean=1.shots_used.mean shots_min=1.shots_used.min"
            " shots_max=1.shots_used.max saved computing_s",
        ),
    },
)

# ── geometry ──────────────────────────────────────────────────────────────────────────────────

# What `check` predicts, in words, and the role of its colour.
_KINDS = (
    ("noise_only", "noise only", "held"),
    ("considered", "considered", "weak"),
    ("freed", "freed", "identified"),
)
_ABOUT = (
    "Noise only: geometry taken as nominal, of an arm that has it. Considered: geometry taken as nominal, of"
    " an arm that deviates by the tolerances. Freed: the geometry estimated, with the tolerances as priors."
    " From the smallest u of an offset to the largest, as `zerobeam check` predicts it."
)


def _zs(part: Any) -> list[float]:
    return [row.z for row in part.parameters if row.z is not None]


def _of_geometry(answer: GeometryStudy) -> Iterator[Section]:
    plans, level = answer.plans, answer.settings.level

    def z_range(part: Any) -> str:
        zs = _zs(part)
        ends = [numbers.significant(pick(zs)) for pick in (min, max)] if zs else []
        return " to ".join(ends) or blocks.NOT_DETERMINED

    def predicted(plan: GeometryPlan) -> list[str]:
        unit = plan.checked[0].unit if len({row.unit for row in plan.checked}) == 1 else ""
        by_kind = ([getattr(row, kind) for row in plan.checked] for kind, *_ in _KINDS)
        return [_tolerances(plan), *(blocks.smallest_to_largest(values, unit) for values in by_kind)]

    every = blocks.overview(
        f"{blocks.FARTHEST} {blocks.percent(level)}; errors in standard uncertainties; answers that say"
        " misfit",
        "geometry",
        [(blocks.plan_title(one), counted(one.shots, "measurement"), one.estimators) for one in plans],
        [
            ("farthest", blocks.farthest(level)),
            ("z", z_range),
            ("misfit", lambda part: f"{part.misfit} of {part.converged}"),
        ],
    )
    legend = Legend(blocks.meanings([estimator for plan in plans for estimator in plan.estimators]), [])
    heads = ["tolerances", *(words for _, words, _ in _KINDS)]
    caption = "Predicted u of the offsets, smallest to largest"
    z = "z is the root mean square of an offset’s errors in its own u: 1 if u is right."
    yield section_of("All plans", every, legend, Paragraph(blocks.BY_CHANCE))
    yield section_of(
        "What geometry does to the uncertainty",
        Paragraph(_ABOUT),
        blocks.plans_table(caption, heads, plans, predicted, "llr"),
        FigureBlock("uncertainty") if _uncertainty_picture(plans) else None,
    )
    z_figure = FigureBlock("z") if _z_picture(plans) else None
    yield section_of("Errors in standard uncertainties", Paragraph(z), z_figure)
    yield section_of(_hold(level), Paragraph("With the geometry estimated."), FigureBlock("coverage"))


def _tolerances(plan: GeometryPlan) -> str:
    """Both tolerances in words."""
    level = plan.tolerance
    return f"{numbers.exact(level.length_mm, 'mm')}, {numbers.exact(level.angle_deg, 'deg')}"


def _plan_of_geometry(plan: GeometryPlan, level: float) -> Section:
    certified = (
        [f"{numbers.significant(100 * plan.efficiency)}{numbers.NO_BREAK}%"] if plan.efficiency else []
    )

    def cells(row: GeometryParameter, control: bool) -> blocks.Cells | None:
        both = blocks.share_and_errors(row, control)
        return both and [both[0], _z_text(row), *both[1:], blocks.spread(row.checked_std, row.unit)]

    table = blocks.parts_table(
        f"{blocks.SHARES}; errors in standard uncertainties; bias and root mean square error, next to what"
        " was stated, and u by check",
        [f"within {blocks.percent(level)}", "z", *blocks.ERROR_COLUMNS, "u by check"],
        plan.estimators,
        cells,
    )
    facts = blocks.plan_facts(
        plan,
        ("Tolerances", _tolerances(plan)),
        ("Arms", str(plan.arms)),
        more=[("Certified efficiency", text) for text in certified],
    )
    legend = Legend([], blocks.verdicts(plan.estimators))
    return section_of(blocks.plan_title(plan), facts, legend, table, new_page=True)


def _z_text(row: GeometryParameter) -> str:
    """z with its 95 % interval."""
    if row.z is None or row.z_low is None or row.z_high is None:
        return blocks.NOT_GIVEN
    digits = numbers.decimals((row.z_high - row.z_low) / 4)
    z, low, high = (numbers.fixed(value, digits) for value in (row.z, row.z_low, row.z_high))
    return f"{z} ({low} to {high})"


def _drawn_of_geometry(answer: GeometryStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    parts = [replace(one, name=plan.name) for plan in plans for one in plan.estimators if one.name == "freed"]
    runs = min((share.of for part in parts for row in part.parameters for share in row.shares), default=1)
    shares = _shares_picture(parts, [level], runs, "coverage", f"{_hold(level)}, with the geometry estimated")
    return [_uncertainty_picture(plans), _z_picture(plans), shares]


def _uncertainty_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """Bands from the smallest u of an offset to the largest over the numbers of measurements, of the plans
    for nominal geometry that have the tolerances of the first; a dashed line is the largest of those chosen
    for free geometry. None where fewer than two numbers of measurements can be compared."""
    known = [plan for plan in plans if _all_known(plan)]
    chosen = [plan for plan in known if plan.chosen_for == "nominal"]
    known = [plan for plan in known if plan.tolerance == chosen[0].tolerance] if chosen else []
    chosen, better = ([plan for plan in known if plan.chosen_for == of] for of in ("nominal", "freed"))
    if len(chosen) < 2:
        return None
    shots = [plan.shots for plan in chosen]
    curves = []
    for kind, words, role in _KINDS:
        low, high = (
            [pick(getattr(row, kind) for row in plan.checked) for plan in chosen] for pick in (min, max)
        )
        curves.append(Curve(shots, high, words, Look(role=role, size=3.5), low, high, band=True))
    if len(better) > 1:
        highest = [max(row.freed or 0.0 for row in plan.checked) for plan in better]
        dashed = Look(stroke="--", filled=False, size=3.5)
        curves.append(Curve([one.shots for one in better], highest, "the same, plan chosen for it", dashed))
    return curves_picture(
        "uncertainty",
        "Predicted u of the offsets by the number of measurements: from the smallest (band) to the largest",
        "Smallest to largest u of the offsets, °, by",
        [CurvePanel(curves, Scale(log=True), across="measurements", up="u of the offsets, °")],
        Scale(log=True, ticks=shots),
    )


def _all_known(plan: GeometryPlan) -> bool:
    return bool(plan.checked) and all(
        getattr(row, kind) is not None and row.unit == "deg" for row in plan.checked for kind, *_ in _KINDS
    )


def _z_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """A row for each estimator of each plan, a dot for each offset; logarithmic, with a line at 1. None where
    there is nothing to draw."""
    rows = []
    for plan in plans:
        rows.append(MarkRow(f"Plan {clipped(plan.name, 36)}", head=True))
        for one in plan.estimators:
            zs = [z for z in _zs(one) if z]
            look = Look(role=_role(one, one.control), filled=not one.control, size=3.2, width=0.8)
            words = ", ".join(
                f"{label(row.name)} {numbers.or_words(row.z or None, blocks.NOT_DETERMINED)}"
                for row in one.parameters
            )
            words = f"({blocks.standing(one).text}): {words}"
            marks = [Dot(z, min(zs), max(zs), look) for z in zs]
            rows.append(MarkRow(one.name, [marks], "" if zs else blocks.NOT_DETERMINED, words=words))
    title = "Errors of the offsets in their standard uncertainties, a dot for each offset; line: u is right"
    about = "Root mean square of the errors in standard uncertainties."
    across = Across("root mean square of the errors, in standard uncertainties", Scale(log=True), [1.0])
    return (
        rows_picture("z", title, about, rows, [across])
        if any(row.panels and row.panels[0] for row in rows)
        else None
    )


GEOMETRY = blocks.Study[GeometryStudy](
    subtitle=lambda answer: (
        f"{answer.settings.arms} simulated arms for each of {counted(len(answer.plans), 'plan')}"
    ),
    sections=_of_geometry,
    details=lambda answer: [_plan_of_geometry(plan, answer.settings.level) for plan in answer.plans],
    drawn=_drawn_of_geometry,
    hold="parameters.csv and plans.csv hold the shares, the errors and the predictions",
    tables={
        "parameters.csv": blocks.flat(
            "plans estimators parameters coverage",
            "plan=1.name geometry=2.name 2: control parameter=3.name 3: unit status 0.settings: level"
            f" 4: {_SHARES} 3: {_ERRORS} z z_low z_high checked_std",
        ),
        "plans.csv": blocks.flat(
            "plans checked",
            "plan=1.name 1: chosen_for robot shots arms failed efficiency 1.tolerance: length_mm angle_deg"
            " 1.noise: joint_deg spot_mm parameter=2.name 2: unit noise_only considered freed",
        ),
    },
)
