"""New measurements, and another run, as a calibration predicts them: what is carried over by name, what is
placed anew, what is left, and what noise and calibration let one expect of it.

All that a calibration has is carried over, with its covariance. What it lacks (targets that it has not
measured), and what may have been moved since, is placed: estimated from the new measurements themselves.
Hold-outs of placements and of runs, and the acceptance test, are such predictions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy

from ..model.arrays import Index, Mask, Matrix
from ..model.errors import BadInput, located
from ..model.files.header import Header, StatedGeometry, require_one_arm
from ..model.files.run import Run
from ..model.kinematics.robot import Difference, arm_difference
from ..model.likelihood.parameters import Parameters
from ..model.likelihood.problem import Problem
from ..model.records import internal, it, key, record, worded
from .estimation.fit import fit_likelihood
from .solution import Solution

_ROUNDS = 20

# Residuals (M,) and their Jacobian (M, p) by scaled parameters, at x (p,).
Rows = Callable[[Matrix], tuple[Matrix, Matrix]]


@dataclass(frozen=True, eq=False)
class Predictor:
    """A calibration that predicts: the mode `x` (p,) of a `problem`, the `covariance` (f, f) of its scaled
    free parameters, `weight` 1 / noise scale^2, and the degrees of freedom of an estimated scale (None where
    it is known)."""

    problem: Problem
    x: Matrix
    covariance: Matrix
    weight: float = 1.0
    noise_dof: int | None = None

    @classmethod
    def of(cls, solution: Solution) -> Predictor:
        """Of a solution, separate noise factors taken as known."""
        problem, x = known_factors(solution.problem, solution.fit.x)
        parameters = solution.problem.parameters
        kept = ~parameters.group("noise")[parameters.free]
        covariance = solution.fit.covariance[np.ix_(kept, kept)]
        return cls(problem, x, covariance, solution.fit.weight, noise_dof(problem))

    def value(self, name: str) -> float:
        """Of a parameter, rad or mm."""
        return float(self.x[self.problem.parameters.index(name)])

    def carried(self, recorded: Problem) -> Problem:
        """New measurements, each counted once, with the noise, priors and functions of the calibration; of
        their ties those to targets that it has not: others are in it already."""
        known, new = self.problem, set(recorded.targets) - set(self.problem.targets)
        stds = {
            (each.label, each.name): std
            for each, std in zip(known.tool.noises, known.noise.readings, strict=True)
        }
        others = zip(recorded.tool.noises, recorded.noise.readings, strict=True)
        readings = np.array([stds.get((each.label, each.name), std) for each, std in others])
        problem = replace(
            recorded,
            noise=replace(known.noise, readings=readings),
            parameters=recorded.parameters.without("noise"),
        ).with_geometry(known.geometry)
        ours = dict(zip(known.parameters.names, known.parameters.items, strict=True))
        items = tuple(ours.get(item.name, item) for item in problem.parameters.items)
        ends = [{recorded.targets[tie.first], recorded.targets[tie.second]} for tie in recorded.ties]
        ties = tuple(tie for tie, targets in zip(recorded.ties, ends, strict=True) if targets & new)
        return replace(problem, parameters=Parameters(items), ties=ties, weights=np.ones(problem.shots))

    def missing(self, problem: Problem) -> Mask:
        """(p,) of a problem what the calibration has not."""
        carried = set(self.problem.parameters.names)
        return np.array([name not in carried for name in problem.parameters.names], dtype=bool)

    def at_mode(self, problem: Problem) -> Matrix:
        """(p,) of a problem: the values of the calibration by name, the nominal ones of all that it lacks."""
        parameters, known, x = problem.parameters, self.problem.parameters, problem.nominal()
        common = [name for name in known.names if name in set(parameters.names)]
        x[[parameters.index(name) for name in common]] = self.x[[known.index(name) for name in common]]
        return x

    def placed(self, problem: Problem) -> Matrix:
        """(p,) the same, with what is missing where the measurements of the problem fit best."""
        moved = self.missing(problem) & problem.parameters.free
        return settled(problem, self.at_mode(problem), moved, weighted_rows(problem, self.weight))

    def predict(self, problem: Problem) -> PredictedResiduals:
        """The measurements of a problem whose parameters of one name have one prior in both."""
        placed = self.missing(problem) & problem.parameters.free
        return self.predict_at(problem, self.placed(problem), placed)

    def predict_at(self, problem: Problem, x: Matrix, placed: Mask) -> PredictedResiduals:
        """The same at x (p,), where what is `placed` (p,) fits best, and all else is carried over.

        Generalised least squares with the covariance S = I / weight + B C B' of what is left at the best
        places, B the Jacobian by all that is carried over and C its covariance (Seber & Lee, Linear
        Regression Analysis, 2003, section 3.10), solved as an ordinary one by the rows of C's root.
        """
        parameters, known = problem.parameters, self.problem.parameters
        lacking = self.missing(problem)
        free = [
            i
            for i, item in enumerate(parameters.items)
            if not (placed[i] or lacking[i]) and not known.items[known.index(item.name)].held
        ]
        among = known.among_free[[known.index(parameters.names[i]) for i in free]]
        values, vectors = np.linalg.eigh(self.covariance[np.ix_(among, among)])
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        whitened = problem.whiten(x)
        scale = row_scale(problem, self.weight)
        residual, jacobian = whitened.residual * scale, whitened.jacobian * scale[:, None]
        by_place, by_rest = jacobian[:, placed], jacobian[:, free] @ root
        rank = int(np.linalg.matrix_rank(by_place)) if by_place.size else 0
        basis = np.linalg.svd(by_place, full_matrices=False)[0][:, :rank]
        d, rows = problem.tool.residual_size, problem.shots * problem.tool.residual_size
        noise = whitened.factor / np.sqrt(self.weight)
        taken = (noise @ basis[:rows].reshape(problem.shots, d, -1)) ** 2
        rest = (by_rest - basis @ (basis.T @ by_rest))[:rows] / scale[:rows, None]
        rest = (whitened.factor @ rest.reshape(problem.shots, d, -1)) / np.sqrt(problem.weights)[
            :, None, None
        ]
        return PredictedResiduals(
            problem=problem,
            residual_mm=whitened.residual_mm,
            components=tuple((part**2).sum(axis=2) for part in (noise, rest)),
            taken=taken.sum(axis=2),
            residual=residual,
            jacobian=jacobian,
            columns=np.hstack([by_place, by_rest]),
            places=by_place.shape[1],
            dof=max(problem.measured_size - rank, 0),
            noise_dof=self.noise_dof,
        )


@dataclass(frozen=True, eq=False)
class PredictedResiduals:
    """N measurements of a `problem` as predicted: their residuals (N, d) once all is placed, and by their
    components (N, d) the variances to expect: by the noise and by what was carried over (`components`), less
    what the places take of the noise (`taken`).

    `residual` (M,) and `jacobian` (M, p) are in stds of the noise; `columns` (M, c) by the `places`, which
    are free, and by what was carried over, of unit variance. `dof` numbers are left over by the places.
    """

    problem: Problem
    residual_mm: Matrix
    components: tuple[Matrix, ...]
    taken: Matrix
    residual: Matrix
    jacobian: Matrix
    columns: Matrix
    places: int
    dof: int
    noise_dof: int | None

    @property
    def noise(self) -> Matrix:
        """(N,) mm^2 the squared lengths by the noise with nothing placed, as `length_squares` takes them."""
        return self.problem.length_squares(self.components[0])

    @property
    def by_noise(self) -> Matrix:
        """(N,) mm^2 the same once all is placed."""
        return np.maximum(self.noise - self.problem.length_squares(self.taken), 0.0)

    @property
    def by_fit(self) -> Matrix:
        """(N,) mm^2 by the uncertainty of what was carried over."""
        return self.problem.length_squares(self.components[1])

    @property
    def expected(self) -> Matrix:
        """(N,) mm^2 the expected squared lengths of the residuals."""
        return self.by_noise + self.by_fit

    @property
    def rms_mm(self) -> float:
        """Root mean square of the residuals' lengths."""
        return self.problem.rms_mm(self.residual_mm)

    @property
    def expected_mm(self) -> float:
        """The same as expected."""
        return float(np.sqrt(self.expected.mean()))

    @property
    def rms_deg(self) -> float | None:
        """Root mean square of the angles that are read; None where none is."""
        return self.problem.rms_deg(self.residual_mm)

    @property
    def expected_deg(self) -> float | None:
        """The same as expected."""
        noise, rest = self.components
        return self.problem.angle_deg(np.maximum(noise - self.taken, 0.0) + rest)

    def left(self, whitened: Matrix) -> Matrix:
        """(M + c, k) what of whitened columns (M, k) neither the places nor what was carried over explain:
        its squares are those by the inverse of S."""
        c = self.columns.shape[1]
        # Only what is carried over has a prior here: the places are free.
        every = np.vstack([self.columns, np.eye(c)[self.places :]])
        whole = np.vstack([whitened, np.zeros((c - self.places, whitened.shape[1]))])
        return np.asarray(whole - every @ np.linalg.lstsq(every, whole, rcond=None)[0])

    @cached_property
    def chi2(self) -> float:
        """Of the residuals against noise and calibration together."""
        return float((self.left(self.residual[:, None]) ** 2).sum())

    @property
    def p_value(self) -> float | None:
        """Of chi-squared, by F where the noise scale is estimated; None without degrees of freedom."""
        if self.dof == 0:
            return None
        if self.noise_dof is None:
            return float(scipy.special.chdtrc(self.dof, self.chi2))
        return float(scipy.special.fdtrc(self.dof, self.noise_dof, self.chi2 / self.dof))


@record(kw_only=True)
class PredictedAgainstMeasured:
    """Measurements that a fit of `shots_fitted` others has not seen, `shots` at `targets`.

    `rms_deg` and `expected_deg` are of the angles that are read. Numbers are None where there is none:
    without degrees of freedom, or where the fit did not converge: `failure` is the optimiser's reason.
    """

    targets: Annotated[tuple[str, ...], it("names of the targets that were held out, or of another run's")]
    shots: Annotated[int, it("number of these measurements")]
    shots_fitted: Annotated[int, it("number of the measurements that were fitted")]
    rms_mm: Annotated[
        float | None,
        it(
            "of the residuals there, with the offsets of the measurements that were fitted and targets "
            "placed that these lack, millimetres"
        ),
    ] = None
    rms_before_mm: Annotated[
        float | None,
        it(
            "the same without any offset; of another run with nominal joints and links, targets and free "
            "tool fitted to the analysed run; millimetres; null where that fit did not converge"
        ),
    ] = None
    expected_mm: Annotated[
        float | None, it("`rms_mm` as expected from the noise and the uncertainty of the fit, millimetres")
    ] = None
    chi2: Annotated[
        float | None, it("of these residuals against the noise and the uncertainty of the fit")
    ] = None
    dof: Annotated[int | None, it("degrees of freedom")] = None
    p_value: Annotated[float | None, it("of χ²")] = None
    failure: Annotated[str | None, internal] = None
    rms_deg: Annotated[float | None, internal] = None
    expected_deg: Annotated[float | None, internal] = None
    message: Annotated[str | None, worded("why there is no test, or null")] = None

    @property
    @key("the root of chi-squared over its degrees of freedom")
    def factor(self) -> float | None:
        """Root of chi-squared over its degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof)) if self.chi2 is not None and self.dof else None


def known_factors(problem: Problem, x: Matrix) -> tuple[Problem, Matrix]:
    """A problem and its mode `x` (p,), separate noise factors taken as known."""
    return problem.with_noise_of(x) if problem.noise.separate else (problem, x)


def noise_dof(fitted: Problem) -> int | None:
    """Degrees of freedom of a noise scale that was estimated from the measurements fitted; None of a known
    one."""
    free = fitted.data_size - int(fitted.parameters.free.sum())
    return free if fitted.noise.estimated and free > 0 else None


def settled(problem: Problem, x: Matrix, moved: Mask, rows: Rows, *, prior: bool = True) -> Matrix:
    """x (p,) with what is `moved` (p,) where the rows, and its `prior`, are best met: Gauss and Newton's
    steps."""
    parameters, x = problem.parameters, x.copy()
    if not moved.any():
        return x
    stds, unit = parameters.prior_std[moved], np.eye(int(moved.sum())) * prior
    for _ in range(_ROUNDS):
        residual, jacobian = rows(x)
        z = (x - parameters.prior_mean)[moved] / stds * prior
        columns = np.vstack([jacobian[:, moved], unit])
        step = -np.linalg.lstsq(columns, np.append(residual, z), rcond=None)[0]
        x[moved] += step * stds
        if np.abs(step).max(initial=0.0) < 1e-12:
            break
    return x


def weighted_rows(problem: Problem, weight: float) -> Rows:
    """Whitened rows, in stds of the noise by its `weight`."""
    scale = row_scale(problem, weight)

    def rows(x: Matrix) -> tuple[Matrix, Matrix]:
        whitened = problem.whiten(x)
        return whitened.residual * scale, whitened.jacobian * scale[:, None]

    return rows


def length_rows(problem: Problem) -> Rows:
    """The residuals that are lengths, mm, each measurement counted once."""
    problem = replace(problem, weights=np.ones(problem.shots), ties=())

    def rows(x: Matrix) -> tuple[Matrix, Matrix]:
        whitened = problem.whiten(x)
        jacobian = whitened.factor @ whitened.jacobian.reshape(*whitened.residual_mm.shape, -1)
        read = problem.length_components
        return whitened.residual_mm[read], jacobian[read]

    return rows


def row_scale(problem: Problem, weight: float) -> Matrix:
    """(M,) what multiplies whitened rows: the noise scale is that of measurements, not of distances."""
    rows = problem.shots * problem.tool.residual_size
    return np.append(np.full(rows, np.sqrt(weight)), np.ones(len(problem.ties)))


def of_rows(problem: Problem, rows: Index | list[int]) -> Problem:
    """Some of the measurements, with the targets that these have; one at least, where there are any."""
    some = problem.select(np.asarray(rows, dtype=np.int64))
    kept = {some.targets[k] for k in some.target_index.tolist()}
    if not any(name in kept for name in some.targets[: len(some.targets) - some.stations]):
        kept |= set(some.targets[:1])
    return replace(some, ties=()).without_targets(set(some.targets) - kept)


# Another run as a run predicts it: what calibration gains, and whether the stated uncertainty holds there.
#
# Everything is estimated from the run that was fitted. Of the other run only the positions of targets that
# it alone has are estimated from its measurements, and what they take up is no prediction.

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
        require_one_arm((one.path.name, one.header.provenance) for one in (run, other))
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
