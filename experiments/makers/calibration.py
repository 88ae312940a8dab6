"""The identifiable offsets of a run, judged as by `analyse`, and the corrected arm: what may be applied.

A robot holds links; a controller's correction holds offsets alone; the deflection under gravity and the
harmonics depend on the posture and are in neither. What a file cannot hold is stated in it, with what that
leaves of the run's residuals.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...analysis.covariance import Covariance
from ...analysis.displacement import Displacement
from ...analysis.estimation.threads import one_blas_thread
from ...analysis.ladder import solve_run
from ...analysis.recordings.steps import RecordingStep
from ...analysis.solution import ParameterResult, ParameterTable, Solution, require_noise_data
from ...analysis.status import Status, known, versions
from ...model.arrays import Matrix
from ...model.errors import BadInput, FitFailed, located
from ...model.files.reading import did_you_mean
from ...model.files.run import Run
from ...model.kinematics.robot import JointKind, Robot
from ...model.likelihood.problem import Problem, rms_length
from ...words.misfit import criterion_sentence, misfit_headline
from ...words.observability import reason
from ...words.wording import listed
from .maker import Holds, one_line

# What a file says of a parameter with an estimate.
STATUS_WORDS: dict[Status, str] = {
    "identified": "identified",
    "weak": "WEAK: weakly observable",
    "unvalidated": "UNVALIDATED: the model does not describe the measurements",
}


@dataclass(frozen=True, kw_only=True)
class Correction:
    """One parameter of an export: its `row` of the answer, without a number where nothing is known.

    `applied` is what the exported file adds to the recorded position or to the nominal value: the estimate,
    or 0 where it is held, not determined by the data, `left_out`, or unvalidated and not exported
    `despite_misfit`.
    """

    row: ParameterResult
    left_out: bool
    despite_misfit: bool

    @property
    def name(self) -> str:
        return self.row.name

    @property
    def status(self) -> Status:
        return self.row.status

    @property
    def exported(self) -> bool:
        validated = self.status != "unvalidated" or self.despite_misfit
        return known(self.status) and validated and not self.left_out

    @property
    def applied(self) -> float:
        return (self.row.estimate or 0.0) if self.exported else 0.0

    @property
    def internal(self) -> float:
        """`applied` in rad or mm."""
        return float(np.radians(self.applied)) if self.row.unit == "deg" else self.applied

    @property
    def reason(self) -> str | None:
        return None if self.row.cause is None else reason(self.row.cause)


class GeometryValue(Correction):
    """One geometry parameter."""

    @property
    def of_link(self) -> bool:
        """Whether it is a link's, which a robot can hold."""
        return self.name.startswith("link")

    @property
    def sentence(self) -> str:
        """The line about it in a file."""
        row = self.row
        if row.estimate is None or row.std is None:
            why = "" if self.reason is None else f": {self.reason}"
            kind = "HELD" if self.status == "held" else "UNIDENTIFIABLE"
            return f"{self.name}: {kind}, nominal{why}"
        words = STATUS_WORDS[self.status]
        words += ", EXCLUDED on request" if self.left_out else "" if self.exported else ", not applied"
        return f"{self.name}: {row.estimate:+.6f} {row.unit}, std {row.std:.2g} {row.unit}, {words}"


def corrected_robot(
    problem: Problem, offsets: Sequence[Correction], geometry: Sequence[GeometryValue]
) -> Robot:
    """The robot with its links as estimated, and the offsets in the transforms before its joints: at recorded
    positions it is where the arm was, but for what depends on the posture."""
    values = np.array([value.internal for value in geometry])
    moved = problem.geometry.applied(problem.robot, values)
    return moved.with_offsets(np.array([offset.internal for offset in offsets]))


def left_out_of(geometry: Sequence[GeometryValue], holds: Holds) -> tuple[GeometryValue, ...]:
    """The parameters that are not in a file of that kind, whether it has no room for them or they are not to
    be exported; held ones have no value to lose."""
    return tuple(
        value
        for value in geometry
        if value.status != "held"
        and holds != "all"
        and (holds == "offsets" or not value.of_link or not value.exported)
    )


def rms_without(solution: Solution, names: Collection[str]) -> float:
    """Root mean square, mm, of the residuals with these parameters at their prior means.

    Each target is where it then fits best (one linear step).
    """
    problem, x = solution.problem, solution.fit.x.copy()
    parameters = problem.parameters
    gone = np.array([name in names for name in parameters.names])
    x[gone] = parameters.prior_mean[gone]
    residual, jacobian = problem.linearise(x)
    by_target = jacobian[:, :, parameters.in_shot("target")]
    return rms_length(_refitted(problem, residual, by_target) if gone.any() else residual)


def _refitted(problem: Problem, residual: Matrix, by_target: Matrix) -> Matrix:
    """Residuals (N, d) once each target has moved to suit its own."""
    result = residual.copy()
    for k in range(len(problem.targets)):
        rows = np.flatnonzero(problem.target_index == k)
        columns = by_target[rows].reshape(-1, 3)
        step = np.linalg.lstsq(columns, residual[rows].ravel(), rcond=1e-9)[0]
        result[rows] -= (columns @ step).reshape(residual[rows].shape)
    return result


SEED = 0  # of the fit's starts, as of `analyse` unless asked for otherwise
MEANING = "true position = recorded position + offset"


class NotValidated(BadInput):
    """The model does not describe the run (verdict misfit): it is not written for a controller unasked."""

    exit_status = 1


@dataclass(frozen=True, kw_only=True)
class JointOffset(Correction):
    """One joint's offset. `joint` is the joint's name in its robot file, which may hold any character."""

    joint: str
    kind: JointKind

    @property
    def sentence(self) -> str:
        """The line about it in a file, in ASCII."""
        row = self.row
        if self.status == "held":
            words = f"HELD at 0, not estimated: {self.reason}"
        elif row.estimate is None:
            words = f"UNIDENTIFIABLE, excluded: {self.reason}"
        else:
            words = f"{row.estimate:+.6f} {row.unit}, std {row.std:.2g} {row.unit}, "
            words += STATUS_WORDS[self.status]
            words += "" if self.exported or self.left_out else ", not applied"
            words += ", EXCLUDED on request" if self.left_out else ""
        return one_line(f"{self.name} ({self.joint}): {words}")


@dataclass(frozen=True)
class RobotCalibration:
    """All offsets of a robot in the order of its joints, and what they were made from.

    `geometry` has the geometry parameters, none where the header states none; `corrected` is the robot with
    all that a robot can hold of these, `left_out` those that the file does not hold, with the residuals'
    `rms_mm` (root mean square) as estimated and as the file has it. `parameters` and `covariance` are the
    whole answer.
    """

    offsets: tuple[JointOffset, ...]
    geometry: tuple[GeometryValue, ...]
    corrected: Robot
    holds: Holds
    left_out: tuple[GeometryValue, ...]
    rms_mm: tuple[float, float]
    parameters: ParameterTable
    covariance: Covariance
    run: str
    sha256: str
    robot: str
    shots: int
    versions: dict[str, str]
    misfit: bool
    warnings: tuple[str, ...]

    @property
    def head(self) -> list[str]:
        """Short lines of ASCII that say what a file holds and where that is from."""
        lines = [
            one_line(f"zerobeam {self.versions['zerobeam']}: joint offsets of {self.robot}"),
            one_line(f"from the run {self.run}, {self.shots} measurements"),
            f"sha256 of the run: {self.sha256}",
            "applied by, on: ______________________",
            f"{MEANING}. An offset that is held or excluded counts as 0.",
            *(offset.sentence for offset in self.offsets),
            *map(one_line, self._on_geometry),
            *(one_line(f"note: {sentence}") for sentence in self.warnings),
        ]
        return [row for line in lines for row in textwrap.wrap(line, 100, subsequent_indent="    ")]

    @property
    def _on_geometry(self) -> Iterator[str]:
        if self.holds != "offsets":
            yield from (value.sentence for value in self.geometry if self.holds == "all" or value.of_link)
        if not self.left_out:
            return
        names = ", ".join(value.name for value in self.left_out)
        yield f"NOT IN THIS FILE, as nominal: {names}"
        whole, held = self.rms_mm
        yield (
            f"rms residual of the run: {whole:.3g} mm with all that was estimated, {held:.3g} mm with what"
            " this file holds (targets placed anew)"
        )


def calibration(
    run: Run,
    *,
    allow_weak: bool = False,
    allow_displaced: bool = False,
    unvalidated: bool = False,
    as_data: bool = False,
    without: Sequence[str] = (),
    holds: Holds = "offsets",
) -> RobotCalibration:
    """The offsets of a run, ready to be applied; `without` are names of offsets and geometry parameters to
    leave out, `holds` says what the kind of file has room for.

    BadInput where an offset is unidentifiable, or weak and not allowed to be, and not excluded; where other
    offsets fit nearly as well; where nothing is left to apply. That a target seems to have moved may be
    allowed: then the warnings say so. NotValidated where the model does not describe the run, unless that is
    asked for (`unvalidated`) or the file states the statuses (`as_data`), in which nothing is then applied.
    FitFailed where the fit did not converge.
    """
    # One thread, as in `analyse`: the last bits depend on it.
    with one_blas_thread(), located(run.path, run.header_line):
        solution = converged_solution(run, "nothing can be exported")
        if not (unvalidated or as_data):
            require_validated(solution, allow_displaced)
        _require_one_basin(solution)
        despite = unvalidated or (allow_displaced and not as_data)
        rows = [row for row in solution.parameters if row.group in ("offset", "geometry")]
        _check_without(without, rows)
        offsets = [
            JointOffset(
                row=row,
                left_out=row.name in without,
                despite_misfit=despite,
                joint=joint.name,
                kind=joint.kind,
            )
            for row, joint in zip(solution.offsets, run.robot.joints, strict=True)
        ]
        _require_known(offsets, allow_weak, nothing_applied=as_data and solution.misfit is not None)
        geometry = tuple(
            GeometryValue(row=row, left_out=row.name in without, despite_misfit=despite)
            for row in rows
            if row.group == "geometry"
        )
        left_out = left_out_of(geometry, holds)
        gone = {value.name for value in left_out} | {offset.name for offset in offsets if offset.left_out}
        return RobotCalibration(
            tuple(offsets),
            geometry,
            corrected_robot(solution.problem, offsets, geometry),
            holds,
            left_out,
            (rms_without(solution, ()), rms_without(solution, gone)),
            solution.parameters,
            solution.covariance,
            run.path.name,
            run.sha256,
            run.robot.name,
            solution.problem.shots,
            versions(),
            solution.misfit is not None,
            (*map(criterion_sentence, solution.contradictions), *run.warnings),
        )


def converged_solution(run: Run, so: str) -> Solution:
    """The solution of a run as `analyse` finds it; FitFailed, which says what follows (`so`), where the fit
    did not converge."""
    run.require_analysable()
    problem = Problem.from_run(run)
    require_noise_data(problem)
    solution = solve_run(problem, run.header, seed=SEED)
    if not solution.converged:
        raise FitFailed(
            f"{run.path}: the fit did not converge ({solution.fit.reason}): {so}\n"
            "  to do:   look at the run with zerobeam analyse; record more measurements, in varied postures"
        )
    return solution


def require_validated(solution: Solution, allow_displaced: bool = False) -> None:
    """NotValidated where the model does not describe the measurements: then no status means anything.

    Nothing but a target that seems to have moved may be allowed: an arm that deviates from its geometry can
    look like that too, and no new run would mend it.
    """
    against = solution.contradictions
    moved = [criterion_sentence(one) for one in against if isinstance(one, Displacement | RecordingStep)]
    displaced = len(moved) == len(against)
    if solution.misfit is None or (allow_displaced and displaced):
        return
    if displaced:
        raise NotValidated(
            "the measurements contradict the model, so no offset can be relied on (misfit)",
            found="; ".join(moved),
            remedy="give the target another name in the measurements after it was moved, or record again; or"
            " --allow-displaced, if it was not moved: the file then says so",
        )
    raise NotValidated(
        "the model does not describe the measurements, so no offset can be relied on (misfit)",
        found=" ".join([misfit_headline(solution.misfit), *(f"{sentence}." for sentence in moved)]),
        allowed="a run without a misfit; as data (json, csv) the offsets are written, marked unvalidated",
        remedy="look for the cause with zerobeam report (joint columns, signs, zeros, units, a target or"
        " placement, geometry); or --unvalidated, if you want the numbers all the same: the file says so",
    )


def _require_one_basin(solution: Solution) -> None:
    """BadInput where several sets of offsets fit nearly as well."""
    if solution.fit.other_basins:
        raise BadInput(
            "the measurements do not determine which of several sets of offsets is the true one",
            found=f"{solution.fit.other_basins} more that fit nearly as well",
            remedy="record more measurements, in varied postures",
        )


def _check_without(without: Sequence[str], items: Sequence[ParameterResult]) -> None:
    free = [item.name for item in items if not item.held]
    for name in without:
        if name not in free:
            raise BadInput(
                "--without names a parameter that is not estimated",
                found=name,
                allowed=", ".join(free) or "none: all are held",
                remedy=did_you_mean(name, free),
            )


def _require_known(offsets: Sequence[JointOffset], allow_weak: bool, nothing_applied: bool) -> None:
    def named(status: Status) -> list[JointOffset]:
        return [offset for offset in offsets if offset.status == status and not offset.left_out]

    unknown, weak = named("unidentifiable"), named("weak")
    if unknown:
        raise BadInput(
            f"{listed([offset.name for offset in unknown])} cannot be exported: the data do not determine it",
            found="; ".join(f"{offset.name}: {offset.reason}" for offset in unknown),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"record measurements that determine it, or exclude by name: {_leaving_out(unknown)}",
        )
    if weak and not allow_weak:
        raise BadInput(
            f"{listed([offset.name for offset in weak])} cannot be exported as known: weakly observable",
            found="; ".join(
                f"{offset.name}: std {offset.row.std:.2g} {offset.row.unit} ({offset.reason})"
                for offset in weak
            ),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"record more measurements; or --allow-weak; or exclude by name: {_leaving_out(weak)}",
        )
    if not (nothing_applied or any(offset.exported for offset in offsets)):
        raise BadInput(
            "there is nothing to export: every offset is held or excluded",
            found="; ".join(offset.sentence for offset in offsets),
        )


def _leaving_out(offsets: Sequence[JointOffset]) -> str:
    return " ".join(f"--without {offset.name}" for offset in offsets)
