"""Do repeated runs agree? Their scatter against what each run predicts, drift, and an outlying run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from itertools import compress
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal, Self, TypeVar

import numpy as np

from ...model.arrays import Matrix, Progress
from ...model.errors import UnsoundResult
from ...model.files.run import Run
from ...model.records import inline, internal, it, key, record, worded
from ..left_over import holm
from ..row import StatusRow
from ..status import versions
from .consistency import (
    LEVEL,
    AgainstOthers,
    Consistency,
    Mean,
    RunDrift,
    RunSample,
    Scatter,
    against_others,
    consistency,
    drift,
    mean_of,
    scatter,
)
from .repeats import Kind, Repeat, RunFinding, read_repeats, times

Question = Literal["consistency", "offsets", "odd", "drift"]
Agreement = Literal["agrees", "does not agree", "not tested", "misfit"]

Adjustable = Consistency | RunDrift | AgainstOthers
Row = TypeVar("Row", Consistency, RunDrift, AgainstOthers)

COMPARE_SCHEMA: Final = "zerobeam/compare/1"
FALSE_ALARM = 0.01  # of a false alarm over all questions together


@record
class ComparedOffset:
    """One offset over the `runs` that determine it; without two of them the rest is None.

    `predicted_std` is the root mean square of the scatter that the runs predict, their standard uncertainties
    without what the geometry adds to all of them; it and `test` are None where nothing is predicted.
    `unvalidated`: it is so in a run that its numbers are from, and so are they; `assumed`: as good as what
    one of these runs assumes.
    """

    name: str
    unit: str
    runs: Annotated[int, it("in how many runs it is identifiable; 0: it is not compared, all else is null")]
    unvalidated: Annotated[bool, it("the model does not describe a run that its numbers are from")]
    assumed: Annotated[bool, internal]
    mean: Annotated[Mean | None, inline(value="mean", interval95="mean_interval95", by="mean_by")]
    scatter: Annotated[Scatter | None, inline(std="std", interval95="std_interval95")]
    predicted_std: Annotated[float | None, it("root mean square of the predicted ones")]
    test: Annotated[
        Consistency | None,
        inline(
            ratio="ratio",
            ratio_interval95="ratio_interval95",
            chi2="chi2",
            dof="dof",
            p_value="p_value",
            p_holm="p_holm",
        ),
    ]
    drift: Annotated[
        RunDrift | None, it("`slope` (unit per `at_unit`), `interval95`, `dof`, `p_value`, `p_holm`")
    ]


@record(repr=False)
class OffsetOfRun(StatusRow):
    """One offset of one run without any prior, `std` as predicted."""

    absent: ClassVar[tuple[str, ...]] = ("held",)

    estimate: float | None
    std: float | None


@record
class ComparedRun:
    """One run: `at` is hours from the first or its number, `odd` the test against the others. `reason` is
    why its fit did not converge: then it has no numbers. `misfit`: the model does not describe it."""

    name: Annotated[str, it("of the file; of a table the name of the row")]
    sha256: str | None
    robot: str | None
    shots: int | None
    when: str | None
    at: Annotated[float, it("hours from the first run, or its number")]
    reason: Annotated[str | None, internal]
    misfit: Annotated[bool, it("whether the model does not describe it")]
    odd: Annotated[
        AgainstOthers | None,
        it("this run against the others: `chi2`, `dof` (null without covariances), `p_value`, `p_holm`"),
    ]
    offsets: Annotated[
        tuple[OffsetOfRun, ...],
        it(
            "`name`, `unit`, `estimate` and `std` without prior, `status`: that of the result, or `prior`"
            " (of a result: a prior has a part, so it is not compared), `stated` or `not stated` (of a table)"
        ),
    ]
    findings: Annotated[tuple[RunFinding, ...], internal]
    failure: Annotated[str | None, worded("why it has no numbers, or null")] = None

    @property
    def undetermined(self) -> list[str]:
        """Names of the free offsets that the run does not determine."""
        return [row.name for row in self.offsets if row.status == "unidentifiable" and self.reason is None]


@record
class ComparisonSettings:
    """How runs were compared."""

    seed: int
    level: Annotated[float, it("of intervals")]
    chance: Annotated[float, it("probability of a false alarm in all tests")]
    asked: Annotated[tuple[Question, ...], it("which tests were possible")]
    order: Literal["time", "given"]
    at_unit: Annotated[Literal["h", "run"], it("hours from the first run, or its number")]


@record
class Comparison:
    """The answer to `zerobeam compare`, in units that people read.

    `differing` and `drifting` are names of offsets, `odd_run` of the run that alone disagrees. `asked` are
    the questions that could be asked; runs are in the order of time if `by_time`, else as given. Where the
    model does not describe a run (`misfits`) the verdict is "misfit", unless the runs do not even agree.

    Raises UnsoundResult where such runs are said to agree.
    """

    schema: Annotated[Literal["zerobeam/compare/1"], it("kind and version of the document")] = field(
        default=COMPARE_SCHEMA, kw_only=True
    )
    kind: Annotated[Kind, it("what was compared")]
    verdict: Annotated[Agreement, it("`misfit`: the model does not describe one of the runs, or more")]
    headline: Annotated[str | None, worded("the answer in a sentence")] = field(default=None, kw_only=True)
    odd_run: Annotated[str | None, it("name of the outlying run")]
    differing: Annotated[tuple[str, ...], it("names of the offsets that scatter more than predicted")]
    drifting: Annotated[tuple[str, ...], it("names of the offsets that drift")]
    consistency: Annotated[
        Consistency | None,
        it(
            "all offsets together: `chi2`, `dof`, `noise_dof` (degrees of freedom of an estimated noise; null"
            " if known), `p_value`, `p_holm` (the same: there is one), `ratio` (observed over predicted"
            " scatter, as standard deviations) with `ratio_interval95`; null without covariances"
        ),
    ]
    offsets: Annotated[tuple[ComparedOffset, ...], it("each over the runs")]
    runs: Annotated[tuple[ComparedRun, ...], it("in the order used")]
    held: Annotated[tuple[str, ...], it("offsets that all runs hold")]
    noise_estimated: Annotated[bool, internal]
    asked: Annotated[tuple[Question, ...], internal]
    by_time: Annotated[bool, internal]
    seed: Annotated[int, internal]
    versions: Annotated[dict[str, str], it("of Python and the libraries")]
    notes: Annotated[tuple[str, ...] | None, worded("in sentences")] = field(default=None, kw_only=True)

    @property
    @key("how runs were compared")
    def settings(self) -> ComparisonSettings:
        """How they were compared."""
        return ComparisonSettings(
            self.seed,
            LEVEL,
            FALSE_ALARM,
            self.asked,
            order="time" if self.by_time else "given",
            at_unit="h" if self.by_time else "run",
        )

    def __post_init__(self) -> None:
        if self.misfits and self.verdict not in ("misfit", "does not agree"):
            raise UnsoundResult(f"{', '.join(self.misfits)}: a misfit, but the verdict is {self.verdict}")

    @property
    @key("names of the runs that the model does not describe", name="misfit")
    def misfits(self) -> list[str]:
        """Names of the runs that the model does not describe."""
        return [run.name for run in self.runs if run.misfit]

    @property
    @key("runs whose fit did not converge, which have no numbers")
    def failed(self) -> list[str]:
        """Names of the runs whose fit did not converge."""
        return [run.name for run in self.runs if run.reason is not None]

    @property
    def used(self) -> int:
        """How many runs are compared."""
        return len(self.runs) - len(self.failed)

    @classmethod
    def of(cls, runs: Sequence[Path | str | Run], *, seed: int = 0, progress: Progress | None = None) -> Self:
        """Compare repeated runs: two runs, run files or results at least, or one table of published offsets
        (see docs/compare.md).

        Raises BadInput for files that cannot be used or runs that cannot be compared. A run whose fit did not
        converge is named under `failed` and has no numbers.
        """
        paths = [Path(one) if isinstance(one, str) else one for one in runs]
        kind, repeats = read_repeats(paths, seed, progress or (lambda stage, share: None))
        return cls.of_repeats(kind, repeats, seed)

    @classmethod
    def of_repeats(cls, kind: Kind, repeats: Sequence[Repeat], seed: int) -> Self:
        """The same of runs that have been read."""
        repeats, at, by_time = _in_order(repeats)
        names, units = repeats[0].names, repeats[0].units
        used = [r for r, repeat in enumerate(repeats) if repeat.failure is None]
        sample = sample_of([repeats[r] for r in used], at[used], len(names))
        each = [sample.offset(i) for i in range(len(names))]
        whole = consistency(sample)
        tests = _adjusted(
            [
                consistency(sample_of_offset) if len(sample_of_offset.values) else None
                for sample_of_offset in each
            ]
        )
        drifts = _adjusted([drift(sample_of_offset) for sample_of_offset in each])
        against = _adjusted([against_others(sample, k) for k in range(len(used))])
        answers: dict[Question, Sequence[Adjustable | None]] = {
            "consistency": [whole],
            "offsets": tests,
            "odd": against,
            "drift": drifts,
        }
        questions = tuple(question for question, rows in answers.items() if any(rows))
        bound = FALSE_ALARM / max(len(questions), 1)
        significant = {
            question: [row is not None and row.p_holm < bound for row in rows]
            for question, rows in answers.items()
        }
        verdict: Agreement = "not tested"
        if any(map(any, significant.values())):
            verdict = "does not agree"
        elif whole or any(tests):
            verdict = "agrees"
        if verdict != "does not agree" and any(repeats[r].misfit for r in used):
            verdict = "misfit"
        outlier = _outlier(sample, against, bound) if any(significant["odd"]) else None
        of_run = dict(zip(used, against, strict=True))
        return cls(
            kind=kind,
            verdict=verdict,
            odd_run=None if outlier is None else repeats[used[outlier]].name,
            differing=tuple(compress(names, significant["offsets"])),
            drifting=tuple(compress(names, significant["drift"])),
            consistency=whole,
            offsets=tuple(
                ComparedOffset(
                    name=names[i],
                    unit=units[i],
                    runs=len(sample_of_offset.values),
                    unvalidated=any(repeats[r].status[i] == "unvalidated" for r in used),
                    assumed=any(repeats[r].status[i] == "assumed" for r in used),
                    mean=mean_of(sample, i, verdict == "agrees"),
                    scatter=scatter(sample_of_offset),
                    predicted_std=None if tests[i] is None else sample_of_offset.predicted_std,
                    test=tests[i],
                    drift=drifts[i],
                )
                for i, sample_of_offset in enumerate(each)
            ),
            runs=tuple(
                _run(repeat, float(at[r]), _factor(repeats), of_run.get(r))
                for r, repeat in enumerate(repeats)
            ),
            held=repeats[0].held,
            noise_estimated=any(repeat.noise_dof is not None for repeat in repeats),
            asked=questions,
            by_time=by_time,
            seed=seed,
            versions=versions(),
        )


compare = Comparison.of


def _in_order(repeats: Sequence[Repeat]) -> tuple[Sequence[Repeat], Matrix, bool]:
    """The runs by time, hours from the first and True; or as they were given, numbers from 1 and False."""
    made = times(repeats)
    if made is None:
        return repeats, np.arange(1.0, len(repeats) + 1), False
    order = sorted(range(len(repeats)), key=lambda r: made[r])
    hours = [(made[r] - made[order[0]]).total_seconds() / 3600 for r in order]
    return [repeats[r] for r in order], np.array(hours), True


def _factor(repeats: Sequence[Repeat]) -> float:
    """The noise over the stated one by all runs together (its square averaged by their degrees of freedom);
    1 where the noise is known."""
    estimated = [repeat for repeat in repeats if repeat.noise_dof is not None and repeat.failure is None]
    if not estimated:
        return 1.0
    dof = [repeat.noise_dof or 0 for repeat in estimated]
    return float(np.sqrt(np.average([repeat.noise_scale**2 for repeat in estimated], weights=dof)))


def sample_of(repeats: Sequence[Repeat], at: Matrix, size: int) -> RunSample:
    """The sample of `size` offsets of runs that have numbers; an offset that fewer than two of them determine
    is compared in none."""
    values = np.array([repeat.value for repeat in repeats]).reshape(-1, size)
    values[:, np.isfinite(values).sum(axis=0) < 2] = np.nan
    known = [repeat.covariance for repeat in repeats if repeat.covariance is not None]
    covariances = np.array(known) * _factor(repeats) ** 2 if len(known) >= 2 else None
    if any("unidentifiable" in repeat.status for repeat in repeats):
        # Then the residuals are far from linear, and what is predicted of the others varies from run to run.
        covariances = None
    names = sorted({name for repeat in repeats for name in repeat.geometry})
    by_geometry = np.zeros((len(repeats), size, len(names)))
    for rows, repeat in zip(by_geometry, repeats, strict=True):
        rows[:, [names.index(name) for name in repeat.geometry]] = repeat.by_geometry
    dof = [repeat.noise_dof for repeat in repeats if repeat.noise_dof is not None]
    joint = all(repeat.joint for repeat in repeats)
    return RunSample(values, covariances, joint, sum(dof) if dof else None, at, by_geometry)


def _adjusted(rows: Sequence[Row | None]) -> list[Row | None]:
    """The rows with their p-values adjusted for how many they are."""
    p_holm = iter(holm([row.p_value for row in rows if row is not None]))
    return [None if row is None else replace(row, p_holm=next(p_holm)) for row in rows]


def _outlier(sample: RunSample, against: Sequence[AgainstOthers | None], bound: float) -> int | None:
    """The run that is farthest from the others; None where they disagree without it as well."""
    worst = min((test.p_value, k) for k, test in enumerate(against) if test is not None)[1]
    rest = consistency(sample.without(worst))
    return worst if rest is None or rest.p_value >= bound else None


def _run(repeat: Repeat, at: float, factor: float, against: AgainstOthers | None) -> ComparedRun:
    std = np.full(len(repeat.names), np.nan)
    if repeat.covariance is not None:
        std = np.sqrt(factor**2 * np.diag(repeat.covariance) + (repeat.by_geometry**2).sum(axis=1))
    rows = zip(repeat.names, repeat.units, repeat.status, repeat.value.tolist(), std.tolist(), strict=True)
    return ComparedRun(
        name=repeat.name,
        sha256=repeat.sha256,
        robot=repeat.robot,
        shots=repeat.shots,
        when=repeat.when,
        at=at,
        reason=repeat.failure,
        misfit=repeat.misfit and repeat.failure is None,
        odd=against,
        offsets=tuple(
            OffsetOfRun(
                name=name,
                unit=unit,
                status=status,
                estimate=value if np.isfinite(value) else None,
                std=deviation if np.isfinite(value + deviation) else None,
            )
            for name, unit, status, value, deviation in rows
        ),
        findings=repeat.findings,
    )
