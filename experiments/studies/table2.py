"""Table 2 of the paper as a study: what joint noise would make three runs scatter as the paper's did?

The offsets of three runs of one arm scatter about their mean with the covariance that the plan predicts for
the noise. So the scatter determines the noise, and tests whether one noise explains that of all five offsets.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np
from scipy import optimize, stats

from ...analysis.estimation.midpoint import fit_midpoints
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.observability.identifiability import identify
from ...analysis.row import StatusRow
from ...analysis.status import Status
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ...words.wording import label
from ..rigs.simulated.cell_file import ArmInCell, CellFile
from .answer import StudyAnswer
from .cases import Engine
from .cell import OPTIMAL, Y_PATTERN, CellRun, Repeated, carried, optimal_plan, paper_plan, seeds_of
from .data_sets import laser_header

OFFSETS = ("delta2", "delta3", "delta4", "delta5", "delta6")
EXPERIMENTS = np.array(
    [
        [-1.136002, -0.653953, 0.133136, 0.065242, -0.040463],
        [-1.217583, -0.735420, 0.116557, 0.016004, -0.040011],
        [-1.296875, -0.689902, 0.088857, -0.065201, -0.034254],
    ]
)
PRINTED_MEAN = (-1.2168, -0.6931, 0.1129, 0.0053, -0.0382)
PRINTED_STD = (0.0804, 0.0408, 0.0224, 0.0659, 0.0035)

TRIPLES = 9999
_SPOT_MM = 0.001  # negligible: the joints' noise is to explain all
_NOMINAL_DEG = 0.01  # for the choice of the optimal plan: next to no spot noise, any will do
_ALARM = 0.01  # probability of a false alarm over both plans
_LOG_ENDS = (np.log(1e-6), np.log(1.0))  # of the joint noises, deg, among which one is sought
_LEVEL = 0.95


@dataclass(frozen=True)
class SimulatedStd:
    """Quantiles of the std of three simulated runs, deg."""

    q2_5: float
    median: float
    q97_5: float


@record(repr=False)
class ScatterParameter(StatusRow):
    """An offset: the paper's std of three runs with its 95 % interval, the std predicted at the joint noise
    that explains the scatter best, the joint noise that this offset alone requires, the std of three runs in
    the simulated cell, and of many simulated triples."""

    claims = ("predicted_std", "alone_deg", "simulated_std", "simulated")
    absent: ClassVar[tuple[str, ...]] = ("held",)

    paper_std: float
    low: float
    high: float
    predicted_std: float | None = None
    alone_deg: float | None = None
    simulated_std: float | None = None
    simulated: SimulatedStd | None = None


@dataclass(frozen=True)
class PrincipalAxis:
    """A principal axis of the predicted covariance, with the joint noise that it alone requires."""

    combination: dict[str, float]
    predicted_std: float
    paper_std: float
    alone_deg: float


@dataclass(frozen=True)
class Table2Plan:
    """One plan: the joint noise that explains the paper's scatter best with its 95 % interval, the p-value of
    one noise for all offsets; `chi2`, `dof` and `chance` (its p-value) compare runs in the cell with the
    prediction. None where there is no result."""

    name: str
    words: str
    shots: int
    spot_mm: float
    joint_deg: float | None
    low: float | None
    high: float | None
    p_value: float | None
    agrees: bool
    chi2: float | None
    dof: int
    chance: float | None
    sentence: str
    axes: tuple[PrincipalAxis, ...]
    parameters: tuple[ScatterParameter, ...]


@dataclass(frozen=True)
class PaperTable:
    """Table 2 of the paper, deg: the runs, mean and std as printed, and as they follow from the runs."""

    offsets: tuple[str, ...]
    experiments: tuple[tuple[float, ...], ...]
    mean: tuple[float, ...]
    std: tuple[float, ...]
    printed_mean: tuple[float, ...]
    printed_std: tuple[float, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Table2Settings:
    """How the study was carried out."""

    seed: Annotated[int, it("seed")]
    runs: Annotated[int, it("runs in a set")]
    simulated: Annotated[int, it("simulated sets")]
    chance: Annotated[float, it("probability of a false alarm over both plans")]


@dataclass(frozen=True, kw_only=True)
class Table2Study(StudyAnswer):
    """The whole answer."""

    settings: Table2Settings
    paper: PaperTable
    plans: tuple[Table2Plan, ...]


def scatter(values: Matrix) -> Matrix:
    """(..., p, p) sums of squares and products about the mean of runs (..., n, p)."""
    off = values - values.mean(axis=-2, keepdims=True)
    return np.asarray(np.swapaxes(off, -1, -2) @ off)


class Prediction:
    """The covariances that a plan predicts for the free offsets of an arm; `truth` are its true offsets by
    name, deg."""

    def __init__(self, plan: Plan, truth: dict[str, float]) -> None:
        problem = Problem.from_plan(plan)
        self._x = problem.nominal()
        for name, value in truth.items():
            i = problem.parameters.index(name)
            self._x[i] = value / problem.parameters.items[i].display
        self._problem = aim(problem, self._x, servo_joints(problem)).problem

    def _at(self, joint_deg: float) -> Problem:
        noise = self._problem.noise
        joint = np.full_like(noise.joint, np.radians(joint_deg))
        return replace(self._problem, noise=replace(noise, joint=joint))

    def covariance(self, joint_deg: float) -> Matrix:
        """(p, p) deg^2 of the likelihood's estimates, at that joint noise and the plan's spot noise,
        without prior."""
        problem = self._at(joint_deg)
        parameters, free = problem.parameters, problem.parameters.free
        jacobian = problem.whiten(self._x).jacobian[:, free]
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        scale = (parameters.prior_std * parameters.display)[free]
        offsets = parameters.group("offset")[free]
        return np.asarray((inverse * np.outer(scale, scale))[np.ix_(offsets, offsets)])

    def midpoint_covariance(self, joint_deg: float) -> Matrix:
        """(p, p) deg^2 of the estimates by eq. 8, which the paper fits: its sandwich."""
        problem = self._at(joint_deg)
        fits = fit_midpoints(problem, problem.joints[None])
        scale = (problem.parameters.prior_std * problem.parameters.display)[fits.free]
        return np.asarray(fits.covariance[0] * np.outer(scale, scale))

    def statuses(self, joint_deg: float) -> dict[str, Status]:
        status = identify(self._at(joint_deg), self._x).status
        return dict(zip(self._problem.parameters.names, status, strict=True))


@dataclass(frozen=True)
class ExplainingNoise:
    """The joint noise, deg, that explains a scatter best, and the 95 % interval."""

    joint_deg: float
    low: float
    high: float


def explained(covariance: Callable[[float], Matrix], scattered: Matrix, dof: int) -> ExplainingNoise:
    """The joint noise by maximum likelihood: `scattered` (p, p) is Wishart with `dof` degrees of freedom.

    tr(C^-1 A) is chi-squared with p dof degrees of freedom at the true noise, whatever the spot adds to C.
    The interval has the noises for which it is not in the tails; where the spot's share is negligible that
    is the usual interval of a standard deviation.
    """

    def deviance(log_joint: float) -> float:
        predicted = covariance(float(np.exp(log_joint)))
        return float(dof * np.linalg.slogdet(predicted)[1] + np.trace(np.linalg.solve(predicted, scattered)))

    def excess(log_joint: float, quantile: float) -> float:
        return float(np.trace(np.linalg.solve(covariance(float(np.exp(log_joint))), scattered))) - quantile

    best = optimize.minimize_scalar(deviance, bounds=_LOG_ENDS, method="bounded", options={"xatol": 1e-6})
    tails = ((1 + _LEVEL) / 2, (1 - _LEVEL) / 2)
    quantiles = [float(stats.chi2.ppf(tail, dof * len(scattered))) for tail in tails]
    # Where the spot alone scatters more than that, the joints' noise may be as small as one likes.
    low, high = (_noise_where(partial(excess, quantile=quantile)) for quantile in quantiles)
    return ExplainingNoise(float(np.exp(best.x)), low, high)


def _noise_where(falling: Callable[[float], float]) -> float:
    """The joint noise, deg, at whose logarithm a function is zero; 0 where even at the least it is not
    above."""
    return 0.0 if falling(_LOG_ENDS[0]) <= 0 else float(np.exp(optimize.brentq(falling, *_LOG_ENDS)))


def unevenness(covariance: Matrix, scattered: Matrix, dof: int) -> Matrix:
    """(T,) how much better a noise for each principal axis of `covariance` (p, p) explains the scatters
    (T, p, p) than one for all: twice the logarithm of the likelihoods' ratio (Bartlett 1937).

    With fewer runs than offsets nothing more general can be asked. It does not change with the noise.
    """
    variance = along_axes(covariance, scattered) / dof
    return np.asarray(dof * (len(covariance) * np.log(variance.mean(axis=1)) - np.log(variance).sum(axis=1)))


def along_axes(covariance: Matrix, scattered: Matrix) -> Matrix:
    """(T, p) sums of squares along the principal axes, the best observable first, over the
    variances predicted."""
    variance, axes = np.linalg.eigh(covariance)
    return np.asarray(np.einsum("pa,...pq,qa->...a", axes, scattered, axes) / variance)


def table2_study(engine: Engine, *, triples: int = TRIPLES) -> Table2Study:
    """Carry out the whole study.

    It agrees if three runs through the simulated cell, at the noise that explains the paper's scatter,
    scatter as predicted: the paper's numbers are only compared.
    """
    header = laser_header(_NOMINAL_DEG, _SPOT_MM)
    engine.progress("plans", 0.0)
    mean, std = EXPERIMENTS.mean(axis=0).tolist(), EXPERIMENTS.std(axis=0, ddof=1).tolist()
    truth = dict(zip(OFFSETS, mean, strict=True))
    plans = [
        ("y-pattern", f"our {Y_PATTERN}", paper_plan(header)),
        ("optimal", OPTIMAL, optimal_plan(header, engine.seed)),
    ]
    predictions = [Prediction(plan, truth) for _, _, plan in plans]
    noises = [explained(one.covariance, scatter(EXPERIMENTS), len(EXPERIMENTS) - 1) for one in predictions]
    cell = CellFile(arm=ArmInCell(offsets_deg=truth))
    normal = np.random.default_rng(engine.seed).normal(size=(len(plans), triples, *EXPERIMENTS.shape))
    pieces = []
    for (_, _, plan), noise in zip(plans, noises, strict=True):
        stated_noise = plan.header.noise.model_copy(update={"joint_deg": noise.joint_deg})
        noisy = replace(plan, header=plan.header.model_copy(update={"noise": stated_noise}))
        repeated = Repeated(noisy, cell)
        pieces += [(repeated, one) for one in seeds_of(engine.seed, len(EXPERIMENTS))]
    runs = engine.each("table2", CellRun, carried, pieces, called="run", triples=triples)
    answers = []
    for k, (name, words, plan) in enumerate(plans):
        of_plan = runs[k * len(EXPERIMENTS) : (k + 1) * len(EXPERIMENTS)]
        whole = [run.estimates.offsets for run in of_plan if run.estimates is not None]
        whole = [one for one in whole if set(one) == set(OFFSETS)]
        estimates = np.array([[one[offset][0] for offset in OFFSETS] for one in whole])
        count = len(plan.postures)
        answers.append(compared(name, words, count, predictions[k], noises[k], estimates, normal[k]))
    agrees, joint_deg = all(answer.agrees for answer in answers), noises[0].joint_deg
    by_fit = (predictions[0].midpoint_covariance, predictions[0].covariance)
    variances = [np.diag(covariance(joint_deg)) for covariance in by_fit]
    ratio = np.sqrt(variances[0] / variances[1])
    return Table2Study(
        study="table2",
        title="What joint noise does the paper's Table 2 imply?",
        headline=(
            f"{_one_for_all(answers[0].words, noises[0], answers[0].p_value)} Three simulated runs at that"
            f" noise {'scatter' if agrees else 'do not scatter'} as predicted."
        ),
        agrees=agrees,
        settings=Table2Settings(seed=engine.seed, runs=len(EXPERIMENTS), simulated=triples, chance=_ALARM),
        paper=PaperTable(
            offsets=OFFSETS,
            experiments=tuple(tuple(run) for run in EXPERIMENTS.tolist()),
            mean=tuple(mean),
            std=tuple(std),
            printed_mean=PRINTED_MEAN,
            printed_std=PRINTED_STD,
            notes=tuple(_on_the_paper()),
        ),
        plans=tuple(answers),
        notes=(
            "The paper prints neither its postures nor the position of its PSD. All this holds for our plans:"
            " where a scatter is smaller than predicted, that offset was better observable from the paper's"
            " postures than from ours, or the paper's noise was smaller.",
            f"The spot noise is taken as {_SPOT_MM:g} mm, so that the joint noise explains all: with a larger"
            " spot noise the joint noise would be smaller.",
            "All predictions are for the likelihood fit. The paper fits eq. 8, by which the same measurements"
            f" of our Y-Pattern scatter {ratio.min():.2g} to {ratio.max():.2g} times as much.",
            "Whether one noise explains all is tested along the principal axes of the predicted covariance"
            " (likelihood ratio; its p-value from the simulated triples, which follow the linear model). It"
            " is the second statistic that was tried, after one factor for each offset, which does not detect"
            " standard deviations far below the predicted ones: take its p-value as an indication, not as a"
            " proof.",
            "The joint noise is what differs from one measurement to another. Errors that are the same in all"
            " three runs, of the arm's geometry above all, do not contribute to their scatter.",
        ),
    )


def compared(
    name: str,
    words: str,
    shots: int,
    prediction: Prediction,
    noise: ExplainingNoise,
    estimates: Matrix,
    normal: Matrix,
) -> Table2Plan:
    """One plan of the study: `estimates` (3, p) deg of the runs in the cell, `normal` (T, 3, p)."""
    dof, size = len(EXPERIMENTS) - 1, len(OFFSETS)
    covariance = prediction.covariance(noise.joint_deg)
    simulated = normal @ np.linalg.cholesky(covariance).T
    spread = np.quantile(simulated.std(axis=1, ddof=1), [0.025, 0.5, 0.975], axis=0)
    observed = unevenness(covariance, scatter(EXPERIMENTS)[None], dof)[0]
    p_value = (1 + int((unevenness(covariance, scatter(simulated), dof) >= observed).sum())) / (
        1 + len(normal)
    )
    chi2, chi2_p_value = None, 0.0  # a run without a result leaves no triple to compare
    if estimates.shape == EXPERIMENTS.shape:
        chi2 = float(np.trace(np.linalg.solve(covariance, scatter(estimates))))
        below = float(stats.chi2.cdf(chi2, dof * size))
        chi2_p_value = 2 * min(below, 1 - below)
    status, axes = prediction.statuses(noise.joint_deg), _axes(covariance, noise.joint_deg)
    rows = []
    for k, offset in enumerate(OFFSETS):
        std = float(EXPERIMENTS[:, k].std(ddof=1))
        low, high = (float(std * np.sqrt(dof / stats.chi2.ppf((1 + s * _LEVEL) / 2, dof))) for s in (1, -1))
        row = ScatterParameter(offset, "deg", status[offset], std, low, high)
        if row.has_numbers:
            row = replace(
                row,
                predicted_std=float(np.sqrt(covariance[k, k])),
                alone_deg=_alone(prediction, k, std),
                simulated_std=float(estimates[:, k].std(ddof=1)) if chi2 is not None else None,
                simulated=SimulatedStd(*spread[:, k].tolist()),
            )
        rows.append(row)
    return Table2Plan(
        name=name,
        words=words,
        shots=shots,
        spot_mm=_SPOT_MM,
        joint_deg=noise.joint_deg,
        low=noise.low,
        high=noise.high,
        p_value=p_value,
        agrees=chi2_p_value >= _ALARM / 2,
        chi2=chi2,
        dof=dof * size,
        chance=None if chi2 is None else chi2_p_value,
        sentence=_sentence(words, noise, p_value, rows, axes),
        axes=axes,
        parameters=tuple(rows),
    )


def _alone(prediction: Prediction, k: int, std: float) -> float:
    """The joint noise, deg, for which the plan predicts that std of one offset; 0 where the spot's noise
    alone predicts more."""

    def lacking(log_joint: float) -> float:
        return -float(np.log(prediction.covariance(float(np.exp(log_joint)))[k, k] / std**2))

    return _noise_where(lacking)


def _axes(covariance: Matrix, joint_deg: float) -> tuple[PrincipalAxis, ...]:
    """The principal axes of the predicted covariance, the best observable first."""
    variance, axes = np.linalg.eigh(covariance)
    dof = len(EXPERIMENTS) - 1
    share = along_axes(covariance, scatter(EXPERIMENTS)) / dof
    return tuple(
        PrincipalAxis(
            combination=dict(zip(OFFSETS, axes[:, k].tolist(), strict=True)),
            predicted_std=float(np.sqrt(variance[k])),
            paper_std=float(np.sqrt(variance[k] * share[k])),
            alone_deg=float(joint_deg * np.sqrt(share[k])),
        )
        for k in range(len(variance))
    )


def _sentence(
    words: str,
    noise: ExplainingNoise,
    p_value: float,
    rows: Sequence[ScatterParameter],
    axes: Sequence[PrincipalAxis],
) -> str:
    needs = [(row, row.alone_deg, row.predicted_std) for row in rows]
    alone = sorted((needed, row.name) for row, needed, _ in needs if needed is not None)
    (least, lowest), (most, highest) = alone[0], alone[-1]
    text = (
        f"{_one_for_all(words, noise, p_value)} Taken alone, {label(lowest)} requires {least:.2g}° and"
        f" {label(highest)} {most:.2g}°; the worst observable combination of offsets of this plan requires"
        f" {axes[-1].alone_deg:.2g}°, the best observable one {axes[0].alone_deg:.2g}°."
    )
    far, needed, predicted = max(needs, key=lambda need: (need[2] or 0.0) / need[0].paper_std)
    if predicted is not None and predicted > far.high:
        text += (
            f" At {noise.joint_deg:.2g}° this plan predicts a standard deviation of {predicted:.2g}° for"
            f" {label(far.name)}, the paper has {far.paper_std:.2g}°: so small a scatter requires postures"
            f" from which {label(far.name)} is better observable, or a noise of {needed:.2g}°."
        )
    return text


def _one_for_all(words: str, noise: ExplainingNoise, p_value: float | None) -> str:
    best = f"{noise.joint_deg:.2g}° ({noise.low:.2g}° to {noise.high:.2g}°)"
    if p_value is not None and p_value >= 1 - _LEVEL:
        verdict = f"one joint noise, of {best}, explains the scatter of all five offsets (p = {p_value:.2g})"
    else:
        verdict = (
            f"no one joint noise explains the scatter of all five offsets (p = {p_value:.2g}); the nearest is"
            f" {best}"
        )
    return f"If the paper's measurements were {words}: {verdict}."


def _on_the_paper() -> list[str]:
    """The printed means and stds against those of the printed experiments, to the last printed digit."""
    sentences = []
    for word, printed, recomputed in (
        ("mean", PRINTED_MEAN, EXPERIMENTS.mean(axis=0)),
        ("standard deviation", PRINTED_STD, EXPERIMENTS.std(axis=0, ddof=1)),
    ):
        off = [
            f"the {word} of {label(name)} is {value:.5f}°, printed as {shown:.4f}°"
            for name, shown, value in zip(OFFSETS, printed, recomputed, strict=True)
            if abs(shown - value) > 0.5001e-4
        ]
        sentences += off or [f"every {word} follows from the three experiments, to the last printed digit"]
    sentences.append("the standard deviations divide by n - 1 = 2; those by n = 3 would be smaller by 0.82")
    return sentences
