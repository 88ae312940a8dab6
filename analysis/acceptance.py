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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated, Literal

import numpy as np
from scipy import special

from ..model.arrays import Index, Mask, Matrix
from ..model.files.run import UNKNOWNS
from ..model.kinematics.robot import Robot
from ..model.likelihood.parameters import Group
from ..model.likelihood.problem import Problem
from ..model.records import internal, it, key, record
from .observability.predictions import predicted_covariance
from .prediction import (
    PredictedResiduals,
    Predictor,
    Rows,
    length_rows,
    noise_dof,
    of_rows,
    settled,
    weighted_rows,
)
from .solution import Solution

# What the calibration has of new measurements, by whether an instrument read what a place is found from.
_CARRIED: dict[bool, tuple[Group, ...]] = {False: ("tool",), True: ("tool", "target", "frame")}
_SAME_POSTURE = np.radians(5.0)  # a target that was moved turns the wrist by no more


@record
class PostureError:
    """One posture: the `measurement` of the new run, that of the calibration there (None where there is
    none), the residuals before and after, and `noise_mm`, their standard deviation by noise alone; mm."""

    measurement: int
    calibration_measurement: int | None
    target: str
    before_mm: float | None
    after_mm: float
    noise_mm: float


@record
class ErrorSize:
    """Of the residuals of several postures, mm."""

    rms_mm: float
    worst_mm: float


@record
class MeasuredError:
    """Residuals of the controller's model before and after; `before` is None unless the calibration has
    measured every posture."""

    postures: tuple[PostureError, ...]
    before: ErrorSize | None
    after: ErrorSize
    noise_mm: float


def measured_error(solution: Solution, recorded: Problem, entered: Mapping[str, float]) -> MeasuredError:
    """Before and after at new measurements, as the corrected robot reads its joints; `entered` are the values
    that were entered, deg (mm) by offset."""
    old, calibration = solution.problem, Predictor.of(solution)
    names = [recorded.targets[k] for k in recorded.target_index.tolist()]
    rows = _calibrated_rows(solution, recorded.joints, names, entered)
    after, noise = _errors(calibration, recorded)
    before: Matrix | None = None
    if all(row is not None for row in rows):
        before, _ = _errors(calibration, of_rows(old, [row for row in rows if row is not None]))
    postures = tuple(
        PostureError(
            recorded.shot_numbers[i],
            None if (row := rows[i]) is None else old.shot_numbers[row],
            names[i],
            None if before is None else float(before[i]),
            float(after[i]),
            float(noise[i]),
        )
        for i in range(len(names))
    )
    return MeasuredError(
        postures,
        None if before is None else _size(before),
        _size(after),
        float(np.sqrt((noise**2).mean())),
    )


def _size(lengths: Matrix) -> ErrorSize:
    return ErrorSize(float(np.sqrt((lengths**2).mean())), float(lengths.max()))


def _calibrated_rows(
    solution: Solution, joints: Matrix, targets: Sequence[str], entered: Mapping[str, float]
) -> list[int | None]:
    """The measurement of the calibration at each posture: the nearest one of the same target."""
    old = solution.problem
    offsets = old.parameters.items[old.parameters.block("offset")]
    applied = np.array([entered.get(item.name, 0.0) / item.display for item in offsets])
    rotates = np.array([joint.kind == "revolute" for joint in old.robot.joints])
    rows: list[int | None] = []
    for reading, target in zip(joints, targets, strict=True):
        apart = np.abs(old.joints + applied - reading)[:, rotates].max(axis=1, initial=0.0)
        apart[[old.targets[k] != target for k in old.target_index]] = np.inf
        nearest = int(apart.argmin())
        rows.append(nearest if apart[nearest] <= _SAME_POSTURE else None)
    return rows


def _errors(calibration: Predictor, recorded: Problem) -> tuple[Matrix, Matrix]:
    """(N,) the lengths of the residuals of nominal geometry without offsets, with targets and frames where
    they fit best, and their standard deviations by the noise; mm."""
    new = Anew.of(calibration, recorded)
    problem = new.problem
    groups = [problem.parameters.group(name) for name in _CARRIED[problem.recorded]]
    x = np.where(np.any(groups, axis=0), calibration.at_mode(problem), problem.nominal())
    whitened = problem.whiten(new.settled(x, length_rows(problem)))
    noise = np.sqrt(problem.length_squares((whitened.factor**2).sum(axis=2)) / calibration.weight)
    return problem.length_mm(whitened.residual_mm), noise


FALSE_ALARM = 0.01
POWER = 0.8  # against an error of the tolerance in each offset that was entered
AIM = 0.9  # of a plan: a run that is a little different from it still passes

Acceptance = Literal["pass", "fail", "inconclusive"]
FEWEST = 3
MOST = 20
_FARTHEST = 8  # times a plan's measurements: what these do not reach, no number does
_MOST_CANDIDATES = 60  # spread over the run: more are as good


@record
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


@record
class Mistake:
    """A mistake in entering that would explain the new measurements: `offsets` not entered, with the wrong
    sign, or twice (also as a corrected program besides); at joint 3 with the value of joint 2 added, or
    subtracted, as from a wrong coupling."""

    kind: MistakeKind
    offsets: tuple[str, ...]
    p_value: float


@record
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
class Anew:
    """New measurements of a calibration: their `problem`, and what of it is `placed` (p,) anew: targets and
    free frames, which may have been moved since, and parts of instruments that the calibration never read."""

    problem: Problem
    placed: Mask

    @classmethod
    def of(cls, calibration: Predictor, recorded: Problem) -> Anew:
        """Of measurements of the same robot, with instruments of the calibration."""
        problem = calibration.carried(replace(recorded, ties=()))
        parameters = problem.parameters
        frames = parameters.group("frame") & ~parameters.tolerated
        return cls(
            problem,
            parameters.group("target") | ((frames | calibration.missing(problem)) & parameters.free),
        )

    def settled(self, x: Matrix, rows: Rows) -> Matrix:
        """x (p,) with the places where the rows are best met, from where they may be: as the measurements
        alone have them, and where an instrument has read, at x as well."""
        problem, starts = self.problem, [x.copy()]
        if problem.recorded:
            starts.append(np.where(self.placed, problem.started(x[None])[0], x))
        else:
            starts[0][problem.parameters.group("target")] = problem.nearest_targets(x[None])[0]
        tried = [settled(problem, start, self.placed, rows, prior=False) for start in starts]
        return min(tried, key=lambda there: float((rows(there)[0] ** 2).sum()))


class AcceptancePrediction:
    """New measurements as the calibration predicts them, with values entered.

    `recorded` are the new measurements as the corrected robot reads its joints (of `planned` ones nothing was
    read yet), `entered` the values, deg (mm), by name of the offset.
    """

    def __init__(
        self,
        calibration: Predictor,
        recorded: Problem,
        entered: Mapping[str, float],
        *,
        planned: bool = False,
    ) -> None:
        self.entered = dict(entered)
        new = Anew.of(calibration, recorded)
        carried = ~new.placed | planned | new.problem.recorded
        x = np.where(carried, calibration.at_mode(new.problem), new.problem.nominal())
        x = self._with(new.problem, x, {name: -value for name, value in entered.items()})
        if planned:
            new = replace(new, problem=new.problem.at_predicted(x))
        self.calibration, self.problem = calibration, new.problem
        self._new, self._x = new, x

    def _with(self, problem: Problem, x: Matrix, more: Mapping[str, float]) -> Matrix:
        """x (p,) with some offsets so much larger, deg (mm)."""
        x, parameters = x.copy(), problem.parameters
        for name, value in more.items():
            i = parameters.index(name)
            x[i] += value / parameters.items[i].display
        return x

    def shifted(self, more: Mapping[str, float]) -> PredictedResiduals:
        """The prediction with some offsets of the corrected arm by so much `more`, deg (mm); targets and
        frames where they fit."""
        problem, weight = self.problem, self.calibration.weight
        x = self._new.settled(self._with(problem, self._x, more), weighted_rows(problem, weight))
        return self.calibration.predict_at(problem, x, self._new.placed)

    def powers(
        self, predicted: PredictedResiduals, sizes: Mapping[str, Sequence[float]]
    ) -> dict[str, list[float]]:
        """By offset the probabilities that the test notices errors of these `sizes`, deg (mm)."""
        parameters = self.problem.parameters
        places = [parameters.index(name) for name in sizes]
        squares = (predicted.left(predicted.jacobian[:, places]) ** 2).sum(axis=0)
        per_unit = squares / [(parameters.prior_std[i] * parameters.items[i].display) ** 2 for i in places]
        return {
            name: [power(predicted, float(square) * size**2) for size in of_one]
            for square, (name, of_one) in zip(per_unit, sizes.items(), strict=True)
        }


def power(predicted: PredictedResiduals, noncentrality: float) -> float:
    """Probability that an error with this noncentrality is noticed."""
    k, dof = predicted.dof, predicted.noise_dof
    if k == 0:
        return 0.0
    if dof is None:
        return float(1 - special.chndtr(_critical(k, dof) * k, k, noncentrality))
    return float(1 - special.ncfdtr(k, dof, noncentrality, _critical(k, dof)))


@cache
def _critical(k: int, noise_dof: int | None) -> float:
    """The limit of chi-squared over k: exceeded with the probability `FALSE_ALARM` without an error."""
    if noise_dof is None:
        return float(special.chdtri(k, FALSE_ALARM) / k)
    return float(special.fdtri(k, noise_dof, 1 - FALSE_ALARM))


def accept(
    prediction: AcceptancePrediction, solution: Solution, tolerance: Mapping[str, float]
) -> AcceptanceResult:
    """The answer for new measurements; `tolerance` by unit: deg, mm."""
    predicted = prediction.shifted({})
    p_value = predicted.p_value
    offsets = entered_offsets(prediction, predicted, solution, tolerance)
    mistakes: tuple[Mistake, ...] = ()
    verdict: Acceptance = "inconclusive"
    if p_value is not None and p_value < FALSE_ALARM:
        verdict, mistakes = "fail", _mistakes(prediction)
    elif p_value is not None and offsets and all(row.power >= POWER for row in offsets):
        verdict = "pass"
    return AcceptanceResult(
        verdict,
        prediction.problem.shots,
        predicted.dof,
        predicted.chi2 / predicted.dof if predicted.dof else None,
        p_value,
        FALSE_ALARM,
        predicted.rms_mm,
        predicted.expected_mm,
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
    limits = {name: tolerance[solution[name].unit] for name in prediction.entered}
    powers = prediction.powers(
        predicted, {name: (limits[name], value) for name, value in prediction.entered.items()}
    )
    rows = []
    for name, value in prediction.entered.items():
        row = solution[name]
        assert row.estimate is not None
        assert row.std is not None
        rows.append(EnteredOffset(name, row.unit, row.estimate, value, row.std, limits[name], *powers[name]))
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
        p = prediction.shifted(more).p_value
        if p is not None and p >= FALSE_ALARM:
            mistakes.append(Mistake(kind, names, p))
    return tuple(sorted(dict.fromkeys(mistakes), key=lambda mistake: -mistake.p_value))


def _couples(robot: Robot) -> bool:
    """Whether the pendant or an encoder counts joint 3 together with joint 2."""
    return "ground" in (robot.conventions.joint3, robot.conventions.encoder3)


@record(eq=False)
class AcceptancePlan:
    """The chosen measurements of the run by their index (`rows`), the `joints` (N, n) rad or mm that the
    corrected robot reads there, and the power of the test, offset by offset."""

    rows: Annotated[tuple[int, ...], it("the measurements of the run", name="shots")]
    joints: Annotated[Matrix, internal]
    targets: Annotated[tuple[str, ...], internal]
    offsets: Annotated[tuple[EnteredOffset, ...], it("what the test would notice")]

    @property
    @key("whether the power is enough for a pass")
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
) -> AcceptancePlan:
    """As few postures as give the test the power that a plan aims at, else those that give it most; or
    `shots` of them. They are taken one after the other, each the one that raises the weakest offset most.
    `usable` (N,): only these."""
    problem, calibration = solution.problem, Predictor.of(solution)
    rows_of = np.arange(problem.shots) if usable is None else np.flatnonzero(usable)
    spaced = np.linspace(0, len(rows_of) - 1, _MOST_CANDIDATES).round().astype(int)
    candidates = rows_of[np.unique(spaced)].tolist()
    offsets_of_joints = problem.parameters.items[problem.parameters.block("offset")]
    applied = np.array([entered.get(item.name, 0.0) / item.display for item in offsets_of_joints])

    def planned(rows: list[int]) -> tuple[Matrix, tuple[str, ...], tuple[EnteredOffset, ...]]:
        some = of_rows(problem, rows)
        joints = some.joints + applied
        targets = tuple(problem.targets[problem.target_index[row]] for row in rows)
        prediction = AcceptancePrediction(calibration, some.moved(joints), entered, planned=True)
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
    return AcceptancePlan(tuple(sorted(rows)), joints, targets, offsets)


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


# Before any measurement: whether a calibration by a plan leaves an acceptance test


@dataclass(frozen=True)
class LackingTest:
    """An acceptance test that cannot pass: with `power` at most it would notice that the offset `name` is off
    by the `tolerance` (`unit`). With `needed` measurements it could; None where no number is enough."""

    measurements: int
    name: str
    power: float
    tolerance: float
    unit: str
    needed: int | None


def lacking_test(problem: Problem, x: Matrix, tolerance: Mapping[str, float]) -> LackingTest | None:
    """What the test of a calibration by these aimed measurements lacks, at x (p,); None where it can pass.
    `tolerance` by unit: deg, mm."""
    powers = _planned_powers(problem, x, problem.shots, tolerance)
    name = min(powers, key=powers.__getitem__)
    if powers[name] >= POWER:
        return None
    item = problem.parameters.items[problem.parameters.index(name)]
    needed = _needed(problem, x, tolerance)
    return LackingTest(problem.shots, name, powers[name], tolerance[item.unit], item.unit, needed)


def _needed(problem: Problem, x: Matrix, tolerance: Mapping[str, float]) -> int | None:
    """The fewest measurements with which the test has the power that a plan aims at."""

    def enough(count: int) -> bool:
        return min(_planned_powers(problem, x, count, tolerance).values()) >= AIM

    low, high = problem.shots + 1, _FARTHEST * problem.shots
    if not enough(high):
        return None
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return high


def _planned_powers(
    problem: Problem, x: Matrix, count: int, tolerance: Mapping[str, float]
) -> dict[str, float]:
    """The power against an error of the tolerance, by offset that is estimated, after `count` measurements:
    the plan's, again and again, of which the test repeats as many as it has at most. Another plan of so many
    is at least about as good."""
    measured = problem.select(np.arange(count) % problem.shots)
    offsets = [item for item in measured.parameters.items if item.group == "offset" and not item.held]
    if not measured.noise_estimable:  # such a run has no answer at all
        return dict.fromkeys((item.name for item in offsets), 0.0)
    covariance = predicted_covariance(measured, x)
    calibration = Predictor(measured, x, covariance, noise_dof=noise_dof(measured))
    rows = np.unique(np.linspace(0, count - 1, MOST).round().astype(int))
    entered = {item.name: 0.0 for item in offsets}
    prediction = AcceptancePrediction(calibration, of_rows(measured, rows), entered, planned=True)
    powers = prediction.powers(
        prediction.shifted({}), {item.name: (tolerance[item.unit],) for item in offsets}
    )
    return {name: one for name, (one,) in powers.items()}
