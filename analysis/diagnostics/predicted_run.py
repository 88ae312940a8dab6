"""Another run as a run predicts it: what calibration gains, and whether the stated uncertainty holds there.

Everything is estimated from the run that was fitted. Of the other run only the positions of targets that it
alone has are estimated from its measurements, and what they take up is no prediction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.errors import BadInput, located
from ...model.files.header import Header, StatedGeometry, require_one_arm
from ...model.files.run import Run
from ...model.kinematics.robot import Difference, arm_difference
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..estimation.fit import fit_likelihood
from ..prediction import PredictedAgainstMeasured, PredictedResiduals, Predictor
from ..solution import Solution

UNKNOWN = 10.0  # times the noise of a measurement: a prediction with a larger u is none
_TAKEN_UP = 1e-6  # of the noise: what is left of it at a target that its measurements only just determine
# What may differ: which targets there are, what is made of the answer, and who measured.
_FREE_TO_DIFFER = frozenset(
    {"schema", "robot", "prior", "targets", "distances", "angles"}
    | {"limits", "tolerance", "required", "provenance"}
)


@dataclass(frozen=True, kw_only=True)
class PredictedMeasurement:
    """A measurement of the other run. Lengths of residuals in mm: `error_mm` with the parameters of the fit,
    `before_mm` with nominal ones, `expected_mm` as noise and the fit's uncertainty let expect; `u_mm` is the
    standard uncertainty of the prediction, without the noise.

    `error_mm` is None where there is no prediction: `u_mm` is too large, or the target takes up all of it.
    """

    shot: int
    target: str
    error_mm: float | None = None
    before_mm: float | None = None
    expected_mm: float | None = None
    u_mm: float


@record(kw_only=True)
class PredictedRun(PredictedAgainstMeasured):
    """Another run as the fit predicts it; measurements `unknown` or `taken_up` are in no other number."""

    run: Annotated[str, it("name of the other run")]
    sha256: Annotated[str, it("of the other run")]
    targets_placed: Annotated[
        tuple[str, ...],
        it(
            "targets that only the other run has: their positions are estimated from it, and the "
            "components of the residuals that this takes up do not count"
        ),
    ]
    unknown: Annotated[
        tuple[int, ...],
        it(
            "numbers of the measurements whose prediction the data do not determine: its u is more "
            "than 10 times their noise. They are in no other number"
        ),
    ] = ()
    taken_up: Annotated[
        tuple[int, ...],
        it(
            "numbers of the measurements of a target that has no more numbers than coordinates: there"
            " is no prediction"
        ),
    ] = ()
    median_mm: Annotated[float | None, it("of the same errors as `rms_mm`, millimetres")] = None
    max_mm: Annotated[float | None, it("of the same errors, millimetres")] = None
    median_before_mm: Annotated[float | None, it("of the same errors as `rms_before_mm`, millimetres")] = None
    max_before_mm: Annotated[float | None, it("likewise, millimetres")] = None
    u_mm: Annotated[
        float | None,
        it(
            "root mean square of the standard uncertainties of the predictions, without the noise, "
            "millimetres"
        ),
    ] = None
    measurements: Annotated[
        tuple[PredictedMeasurement, ...],
        it(
            "of the other run: `shot`, `target`, `error_mm`, `before_mm`, `expected_mm` (null where "
            "there is no prediction) and `u_mm`"
        ),
    ] = ()


def require_predictable(run: Run, other: Run) -> None:
    """BadInput where `other` is the run itself, has no measurement, or is of another arm or instrument."""
    if not other.shots:
        raise BadInput(
            "the held-out run has no measurements",
            found="0 measurements",
            allowed="1 or more",
            remedy="record some",
            file=other.path,
        )
    if run.sha256 == other.sha256:
        raise BadInput(
            "the held-out run is the run itself: it would predict what it was fitted to",
            found=f"{run.path.name} and {other.path.name} (SHA-256 {run.sha256[:12]}…)",
            allowed="another run of the same header",
            remedy="hold out other measurements, or a placement of this run by its name",
            file=other.path,
        )
    with located(other.path):
        require_one_arm(*((one.path.name, one.header.provenance) for one in (run, other)))
    differing = _headers_differ(run.header, other.header)
    if run.robot.conventions != other.robot.conventions:
        differing.insert(0, ("convention of the robot", run.robot.conventions, other.robot.conventions))
    if (difference := arm_difference(run.robot, other.robot)) is not None:
        differing.insert(0, difference)
    if differing:
        key, mine, theirs = differing[0]
        raise BadInput(
            f"the held-out run has another {key}: what was estimated does not apply to it",
            found=f"{mine} in {run.path.name}, {theirs} in {other.path.name}",
            allowed="the same robot, tool, noise, geometry and held parameters in both",
            remedy=f"state the same {key} in both headers, if it was the same",
            file=other.path,
        )


def _headers_differ(one: Header, other: Header) -> list[Difference]:
    mine, theirs = (
        header.model_dump(mode="json", by_alias=True, exclude=set(_FREE_TO_DIFFER)) for header in (one, other)
    )
    return [_innermost(key, mine.get(key), theirs.get(key)) for key in mine if mine[key] != theirs.get(key)]


def _innermost(key: str, mine: object, theirs: object) -> Difference:
    """The first key below `key` at which two values differ, with both."""
    if isinstance(mine, dict) and isinstance(theirs, dict):
        for below in dict.fromkeys([*mine, *theirs]):
            if mine.get(below) != theirs.get(below):
                return _innermost(f"{key}.{below}", mine.get(below), theirs.get(below))
    return (key, "nothing" if mine is None else mine, "nothing" if theirs is None else theirs)


def predict_run(solution: Solution, other: Run) -> PredictedRun:
    """The measurements of the run `other` as the solution of another run predicts them."""
    return predict_problem(solution, recorded_problem(other), other.path.name, other.sha256)


def recorded_problem(run: Run) -> Problem:
    """The measurements of a run that is not fitted: they may be fewer than its header's unknowns."""
    header, names = run.header, {f"delta{k + 1}" for k in range(run.robot.n)}
    update: dict[str, object] = {}
    if isinstance(header.arm, StatedGeometry):  # of how few measurements there are nothing is to be refused
        update["geometry"] = header.arm.model_copy(update={"gravity": False, "harmonics": False})
    if header.held is not None:  # of other parameters it is the fit that has those that are held
        update["held"] = tuple(name for name in header.held if name in names)
    bare = replace(run, header=header.model_copy(update=update))
    return Problem.from_run(bare)


def predict_problem(solution: Solution, recorded: Problem, name: str, sha256: str) -> PredictedRun:
    """The measurements of `recorded`, a problem of the same robot and instrument, as the solution predicts
    them."""
    fitted = solution.problem
    facts = PredictedRun(
        run=name,
        sha256=sha256,
        targets=recorded.targets,
        targets_placed=tuple(target for target in recorded.targets if target not in fitted.targets),
        shots=recorded.shots,
        shots_fitted=fitted.shots,
    )
    if not solution.converged:
        return replace(facts, failure=solution.fit.reason)
    calibration = Predictor.of(solution)
    problem = calibration.carried(recorded)
    problem = problem.weighted(np.full(problem.shots, float(fitted.weights.mean())))
    every = calibration.predict(problem)
    u = np.sqrt(every.by_fit)
    determined = every.by_fit <= UNKNOWN**2 * every.noise
    kept = np.flatnonzero(determined)
    rows: dict[int, dict[str, float | None]] = {}
    left = np.zeros(0, dtype=bool)
    if len(kept):
        rest = problem.select(kept)
        after, before = calibration.predict(rest), _before(calibration, rest)
        left = after.expected > _TAKEN_UP**2 * after.noise
        errors = rest.length_mm(after.residual_mm)
        for i in np.flatnonzero(left):
            rows[int(kept[i])] = {
                "error_mm": float(errors[i]),
                "before_mm": None if before is None else float(before[i]),
                "expected_mm": float(np.sqrt(after.expected[i])),
            }
        facts = _with_statistics(facts, errors, before, after, left)
        facts = replace(facts, rms_deg=after.rms_deg, expected_deg=after.expected_deg)
        if after.dof > 0:
            facts = replace(facts, chi2=after.chi2, dof=after.dof, p_value=after.p_value)
    numbers = problem.shot_numbers
    return replace(
        facts,
        unknown=tuple(numbers[i] for i in np.flatnonzero(~determined)),
        taken_up=tuple(numbers[i] for i in kept[~left]),
        measurements=tuple(
            PredictedMeasurement(
                shot=numbers[i],
                target=problem.targets[problem.target_index[i]],
                u_mm=float(u[i]),
                **rows.get(i, {}),
            )
            for i in range(problem.shots)
        ),
    )


def _with_statistics(
    facts: PredictedRun, errors: Matrix, before: Matrix | None, after: PredictedResiduals, left: Mask
) -> PredictedRun:
    """With root mean square, median and largest of the errors (N,) mm of the measurements `left` (N,)."""
    if not left.any():
        return facts

    def rms(squares: Matrix) -> float:
        return float(np.sqrt(squares[left].mean()))

    if before is not None:
        facts = replace(
            facts,
            rms_before_mm=rms(before**2),
            median_before_mm=float(np.median(before[left])),
            max_before_mm=float(before[left].max()),
        )
    return replace(
        facts,
        rms_mm=rms(errors**2),
        median_mm=float(np.median(errors[left])),
        max_mm=float(errors[left].max()),
        expected_mm=rms(after.expected),
        u_mm=rms(after.by_fit),
    )


def _before(calibration: Predictor, problem: Problem) -> Matrix | None:
    """(N,) mm the lengths of the residuals with nominal joints and links: what the calibration placed is as
    its measurements then ask for, and so is what is free of the tool. None where that does not converge."""
    known = calibration.problem
    arm = np.zeros(len(known.parameters), dtype=bool)
    arm[known.parameters.arm] = True
    held = replace(known, parameters=known.parameters.holding(arm | ~known.parameters.free))
    x = held.parameters.prior_mean
    if held.parameters.free.any():
        fit = fit_likelihood(held, starts=0)
        if not fit.converged:
            return None
        x = fit.x
    nominal = replace(calibration, problem=held, x=x)
    return problem.length_mm(problem.linearise(nominal.placed(problem))[0])
