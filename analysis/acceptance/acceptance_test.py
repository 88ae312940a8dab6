"""Does a corrected robot do what its calibration predicts?

The values c have been entered (`values_to_enter`), so the corrected robot reads c more at the same place: the
new residuals should be those of an arm with the offsets delta - c, and links, gravity and harmonics as they
were. Residuals are the noise of the new readings and what the calibration left uncertain: normal with
covariance C = N + J S J',
where S is the posterior covariance of offsets, tool and geometry, and J the Jacobian of the new
measurements. Places of targets and free frames are free, since they may have been moved. Where the
calibration is right, r' C^-1 r less what the places take up has the chi-squared (divided by its degrees of
freedom: the F, where the noise was estimated) of k degrees of freedom.

A test that cannot fail proves nothing: the power is stated against an error of the tolerance in each
offset, and without it there is no pass. What the calibration leaves undetermined has the variance of its
prior in S, so it hides errors and lowers the power, as it should.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal, Protocol

import numpy as np
from scipy import stats
from scipy.linalg import block_diag, solve_triangular

from ...model.arrays import Index, Mask, Matrix
from ...model.files.run import UNKNOWNS
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem, Whitened
from ..solution import Solution
from .new_measurements import NewMeasurements, of_rows

FALSE_ALARM = 0.01
POWER = 0.8  # against an error of the tolerance in each offset that was entered
AIM = 0.9  # of a plan: a run that is a little different from it still passes

Acceptance = Literal["pass", "fail", "inconclusive"]
FEWEST = 3
MOST = 20
_MOST_CANDIDATES = 60  # spread over the run: more are as good


@dataclass(frozen=True)
class EnteredOffset:
    """One offset that was entered: its `estimate`, the value `entered`, u and the tolerance (deg, mm), and
    the probability that the test notices an error of that tolerance, and that it was not entered at all."""

    name: str
    unit: str
    estimate: float
    entered: float
    std: float
    tolerance: float
    power: float
    power_not_entered: float


MistakeKind = Literal["not entered", "wrong sign", "entered twice", "joint 2 added", "joint 2 subtracted"]
# By how many times its value an offset of the arm is then too large.
_TIMES: Mapping[MistakeKind, float] = {"not entered": 1.0, "wrong sign": 2.0, "entered twice": -1.0}
_COUPLED: Mapping[MistakeKind, float] = {"joint 2 added": -1.0, "joint 2 subtracted": 1.0}


@dataclass(frozen=True)
class Mistake:
    """A mistake in entering that would explain the new measurements: `offsets` not entered, with the wrong
    sign, or twice (also as a corrected program besides); at joint 3 with the value of joint 2 added, or
    subtracted, as from a wrong coupling."""

    kind: MistakeKind
    offsets: tuple[str, ...]
    p_value: float


@dataclass(frozen=True)
class AcceptanceResult:
    """The answer: `statistic` is chi-squared over k, `rms_mm` of the new residuals, `expected_mm` what was
    predicted; `mistakes`, the likeliest first, where it fails."""

    verdict: Acceptance
    measurements: int
    dof: int
    statistic: float | None
    p_value: float | None
    false_alarm: float
    rms_mm: float
    expected_mm: float
    offsets: tuple[EnteredOffset, ...]
    mistakes: tuple[Mistake, ...]

    @property
    def unnoticed(self) -> tuple[EnteredOffset, ...]:
        """Offsets of which an error of the tolerance would likely go unnoticed."""
        return tuple(row for row in self.offsets if row.power < POWER)


@dataclass(frozen=True, eq=False)
class PredictedResiduals:
    """The new measurements at the calibration's mode, in the roots of their predicted covariance: `residual`
    (k,) and the `shift` (k, p) by scaled parameters, free of the places; `rms` and `expected` mm."""

    residual: Matrix
    shift: Matrix
    rms: float
    expected: float

    @property
    def dof(self) -> int:
        return len(self.residual)


class Mode(Protocol):
    """The mode of a calibration: `x` (p,), `covariance` (f, f) of the free parameters by their priors, and
    `weight`, 1 / noise scale^2."""

    @property
    def x(self) -> Matrix: ...
    @property
    def covariance(self) -> Matrix: ...
    @property
    def weight(self) -> float: ...


class Calibrated(Protocol):
    """What the test takes of a calibration, solved or predicted."""

    @property
    def problem(self) -> Problem: ...
    @property
    def fit(self) -> Mode: ...
    @property
    def dof(self) -> int: ...


class AcceptancePrediction:
    """New measurements as the calibration predicts them, with values entered.

    `solution` is the calibration, `recorded` are the new measurements as the corrected robot reads its joints
    (of `planned` ones nothing was read yet), `entered` the values, deg (mm), by name of the offset.
    """

    def __init__(
        self, solution: Calibrated, recorded: Problem, entered: Mapping[str, float], *, planned: bool = False
    ) -> None:
        old = solution.problem
        self.entered = dict(entered)
        new = NewMeasurements.of(old, solution.fit.x, recorded)
        parameters = new.problem.parameters
        x = new.problem.nominal()
        for i, name in enumerate(parameters.names):
            if name in old.parameters.names and (planned or new.problem.recorded or not new.placed[i]):
                x[i] = solution.fit.x[old.parameters.index(name)]
        self._scale = np.sqrt(solution.fit.weight)
        self.noise_dof = solution.dof if old.noise.estimated else None
        for name, value in self.entered.items():
            i = parameters.index(name)
            x[i] -= value / parameters.items[i].display
        if planned:
            new = replace(new, problem=new.problem.at_predicted(x))
        self._new, self.problem, self._x = new, new.problem, x
        names = [
            item.name
            for item, placed in zip(parameters.items, new.placed, strict=True)
            if not (placed or item.held)
        ]
        at = [old.parameters.among_free[old.parameters.index(name)] for name in names]
        self._uncertain = [parameters.index(name) for name in names]
        self._covariance = solution.fit.covariance[np.ix_(at, at)]
        self._read = np.flatnonzero(self.problem.active)

    def shifted(self, more: Mapping[str, float]) -> PredictedResiduals:
        """The prediction with some offsets of the corrected arm by so much `more`, deg (mm); targets and
        frames where they fit."""
        x, parameters = self._x.copy(), self.problem.parameters
        for name, value in more.items():
            i = parameters.index(name)
            x[i] += value / parameters.items[i].display
        x = self._new.with_places(x, lambda at: self._whitened(at)[:2])
        residual, jacobian, whitened, covariance = self._whitened(x)
        free = _left_of(jacobian[:, self._new.placed])
        in_mm = block_diag(*whitened.factor)[:, self._read] / self._scale
        squares = ((in_mm @ covariance) * in_mm).sum(axis=1).reshape(self.problem.shots, -1)
        predicted = float(np.sqrt(self.problem.length_squares(squares).mean()))
        rms = self.problem.rms_mm(whitened.residual_mm)
        return PredictedResiduals(free.T @ residual, free.T @ jacobian, rms, predicted)

    def _whitened(self, x: Matrix) -> tuple[Matrix, Matrix, Whitened, Matrix]:
        """Residual (M,) of what was read and scaled Jacobian (M, p) in the roots of C; and C (M, M) in stds
        of the noise."""
        whitened = self.problem.whiten(x)
        residual, jacobian = (
            part[self._read] * self._scale for part in (whitened.residual, whitened.jacobian)
        )
        by = jacobian[:, self._uncertain]
        covariance = np.eye(len(residual)) + by @ self._covariance @ by.T
        root = np.linalg.cholesky(covariance)
        solved = solve_triangular(root, np.column_stack([residual, jacobian]), lower=True)
        return solved[:, 0], solved[:, 1:], whitened, covariance

    def power(self, shift: Matrix) -> float:
        """Probability that a shift (k,) of the whitened residuals is noticed."""
        k, away = len(shift), float(shift @ shift)
        if k == 0 or self.noise_dof == 0:
            return 0.0
        if self.noise_dof is None:
            return float(stats.ncx2.sf(self.critical(k) * k, k, away))
        return float(stats.ncf.sf(self.critical(k), k, self.noise_dof, away))

    def power_against(self, predicted: PredictedResiduals, name: str, size: float) -> float:
        """Probability that an offset which is off by `size`, deg (mm), is noticed."""
        parameters = self.problem.parameters
        i = parameters.index(name)
        per_unit = predicted.shift[:, i] / (parameters.prior_std[i] * parameters.items[i].display)
        return self.power(per_unit * size)

    def critical(self, k: int) -> float:
        """The limit of chi-squared over k: exceeded with the probability `FALSE_ALARM` without an error."""
        return _critical(k, self.noise_dof)

    def p_value(self, predicted: PredictedResiduals) -> float | None:
        k = predicted.dof
        if k == 0:
            return None
        statistic = float(predicted.residual @ predicted.residual)
        if self.noise_dof is None:
            return float(stats.chi2.sf(statistic, k))
        return float(stats.f.sf(statistic / k, k, self.noise_dof))


@cache
def _critical(k: int, noise_dof: int | None) -> float:
    if noise_dof is None:
        return float(stats.chi2.isf(FALSE_ALARM, k) / k)
    return float(stats.f.isf(FALSE_ALARM, k, noise_dof))


def accept(
    prediction: AcceptancePrediction, solution: Solution, tolerance: Mapping[str, float]
) -> AcceptanceResult:
    """The answer for new measurements; `tolerance` by unit: deg, mm."""
    predicted = prediction.shifted({})
    p_value = prediction.p_value(predicted)
    offsets = entered_offsets(prediction, predicted, solution, tolerance)
    mistakes: tuple[Mistake, ...] = ()
    verdict: Acceptance = "inconclusive"
    if p_value is not None and p_value < FALSE_ALARM:
        verdict, mistakes = "fail", _mistakes(prediction)
    elif p_value is not None and offsets and all(row.power >= POWER for row in offsets):
        verdict = "pass"
    statistic = float(predicted.residual @ predicted.residual) / predicted.dof if predicted.dof else None
    return AcceptanceResult(
        verdict,
        prediction.problem.shots,
        predicted.dof,
        statistic,
        p_value,
        FALSE_ALARM,
        predicted.rms,
        predicted.expected,
        offsets,
        mistakes,
    )


def entered_offsets(
    prediction: AcceptancePrediction,
    predicted: PredictedResiduals,
    solution: Solution,
    tolerance: Mapping[str, float],
) -> tuple[EnteredOffset, ...]:
    """Each entered offset with the power of the test against an error of it; `tolerance` by unit: deg, mm."""
    rows = []
    for name, value in prediction.entered.items():
        row = solution[name]
        assert row.estimate is not None
        assert row.std is not None
        limit = tolerance[row.unit]
        powers = [prediction.power_against(predicted, name, size) for size in (limit, value)]
        rows.append(EnteredOffset(name, row.unit, row.estimate, value, row.std, limit, *powers))
    return tuple(rows)


def _mistakes(prediction: AcceptancePrediction) -> tuple[Mistake, ...]:
    """Mistakes in entering one offset, or all, that the measurements do not contradict, likeliest first."""
    entered, mistakes = prediction.entered, []
    tried: list[tuple[MistakeKind, tuple[str, ...], dict[str, float]]] = [
        (kind, names, {name: times * entered[name] for name in names})
        for kind, times in _TIMES.items()
        for names in [*((name,) for name in entered), tuple(entered)]
    ]
    if _couples(prediction.problem.robot) and {"delta2", "delta3"} <= entered.keys():
        tried += [
            (kind, ("delta3",), {"delta3": times * entered["delta2"]}) for kind, times in _COUPLED.items()
        ]
    for kind, names, more in tried:
        p = prediction.p_value(prediction.shifted(more))
        if p is not None and p >= FALSE_ALARM:
            mistakes.append(Mistake(kind, names, p))
    return tuple(sorted(dict.fromkeys(mistakes), key=lambda mistake: -mistake.p_value))


def _couples(robot: Robot) -> bool:
    """Whether the pendant or an encoder counts joint 3 together with joint 2."""
    return "ground" in (robot.conventions.joint3, robot.conventions.encoder3)


def _left_of(columns: Matrix) -> Matrix:
    """(M, k) an orthonormal basis of what the columns (M, c) do not reach."""
    u, size, _ = np.linalg.svd(columns, full_matrices=True)
    rank = int((size > 1e-10 * max(size.max(initial=0.0), 1e-300)).sum())
    return np.asarray(u[:, rank:])


@dataclass(frozen=True, eq=False)
class VerificationPlan:
    """The chosen measurements of the run by their index (`rows`), the `joints` (N, n) rad or mm that the
    corrected robot reads there, and the power of the test, offset by offset."""

    rows: tuple[int, ...]
    joints: Matrix
    targets: tuple[str, ...]
    offsets: tuple[EnteredOffset, ...]

    @property
    def enough(self) -> bool:
        return all(row.power >= POWER for row in self.offsets)

    @property
    def narrow(self) -> bool:
        """Whether the power is enough, and less than a plan aims at."""
        return self.enough and any(row.power < AIM for row in self.offsets)


def choose(
    solution: Solution,
    entered: Mapping[str, float],
    tolerance: Mapping[str, float],
    shots: int | None = None,
    usable: Mask | None = None,
) -> VerificationPlan:
    """As few postures as give the test the power that a plan aims at, else those that give it most; or
    `shots` of them. They are taken one after the other, each the one that raises the weakest offset most.
    `usable` (N,): only these."""
    problem = solution.problem
    rows_of = np.arange(problem.shots) if usable is None else np.flatnonzero(usable)
    spaced = np.linspace(0, len(rows_of) - 1, _MOST_CANDIDATES).round().astype(int)
    candidates = rows_of[np.unique(spaced)].tolist()
    offsets_of_joints = problem.parameters.items[problem.parameters.block("offset")]
    applied = np.array([entered.get(item.name, 0.0) / item.display for item in offsets_of_joints])

    def planned(rows: list[int]) -> tuple[Matrix, tuple[str, ...], tuple[EnteredOffset, ...]]:
        some = of_rows(problem, rows)
        joints = some.joints + applied
        targets = tuple(problem.targets[problem.target_index[row]] for row in rows)
        prediction = AcceptancePrediction(solution, some.moved(joints), entered, planned=True)
        predicted = prediction.shifted({})
        return joints, targets, entered_offsets(prediction, predicted, solution, tolerance)

    def score(rows: list[int]) -> tuple[float, float]:
        powers = [row.power for row in planned(rows)[2]]
        return min(powers), sum(powers)

    most = min(shots or MOST, len(rows_of))
    rows = list(_farthest(problem.joints[candidates], candidates, min(FEWEST, most)))
    tried = [list(rows)]
    while len(rows) < most:
        if shots is None and score(rows)[0] >= AIM:
            break
        rest = [row for row in candidates if row not in rows]
        if not rest:
            break
        rows.append(max(rest, key=lambda row: score([*rows, row])))
        tried.append(list(rows))
    if shots is None and score(rows)[0] < AIM:  # one more posture may also hide what a few show
        rows = max(tried, key=score)
    rows = _placing(problem, rows, rows_of)
    joints, targets, offsets = planned(sorted(rows))
    return VerificationPlan(tuple(sorted(rows)), joints, targets, offsets)


def _placing(problem: Problem, rows: list[int], usable: Index) -> list[int]:
    """The measurements, each target with more numbers than its place takes up: with further `usable` ones, or
    without those of a target of which there are no more."""
    of_row = problem.target_index
    result = []
    for target in dict.fromkeys(of_row[rows]):
        chosen = [row for row in rows if of_row[row] == target]
        if not problem.is_station(problem.targets[target]):
            further = [row for row in usable[of_row[usable] == target].tolist() if row not in chosen]
            while problem.sizes[chosen].sum() <= UNKNOWNS and further:
                chosen.append(further.pop(0))
            if problem.sizes[chosen].sum() <= UNKNOWNS:
                continue
        result += chosen
    return result or rows


def _farthest(joints: Matrix, rows: list[int], count: int) -> list[int]:
    """Postures far from one another: the first two apart most, then always the one farthest from all."""
    apart = np.linalg.norm(joints[:, None] - joints[None], axis=2)
    first = divmod(int(apart.argmax()), len(rows))
    chosen = list(first) if len(rows) > 1 else [0]
    while len(chosen) < count:
        chosen.append(int(apart[:, chosen].min(axis=1).argmax()))
    return [rows[i] for i in dict.fromkeys(chosen)]
