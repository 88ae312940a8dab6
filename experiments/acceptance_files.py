"""The acceptance test of a corrected robot as files: its plan from a run, its answer from a new run."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np

from ..analysis.acceptance import (
    POWER,
    AcceptancePlan,
    AcceptancePrediction,
    AcceptanceResult,
    MeasuredError,
    accept,
    choose,
    measured_error,
)
from ..analysis.diagnostics.values_to_enter import Conformity, judged, values_to_enter
from ..analysis.prediction import Predictor, recorded_problem
from ..analysis.solution import Solution
from ..model.arrays import Mask
from ..model.errors import BadInput, located
from ..model.files.header import Header, StatedTarget
from ..model.files.plan import Means, write_plan
from ..model.files.robot_file import rebased, robot_path
from ..model.files.run import Run, read_run
from ..model.files.whole_file import refuse_existing
from ..model.instruments.kind import POINT, Instrument
from ..model.kernel import one_blas_thread
from ..model.kinematics.robot import arm_difference
from ..model.likelihood.problem import Problem, by_posture
from ..model.records import internal, it, record
from ..words.provenance import VERIFIES
from ..words.wording import listed
from .makers.maker import vendor_of
from .plans.constraints import clear_postures
from .validated_solution import converged_solution, require_validated

_SHA, _ENTERED = f"{VERIFIES} sha256", "entered"
ACCEPTANCE_SCHEMA: Final = "zerobeam/acceptance/1"
_DECIMALS = 6  # of degrees and mm in the plan


@record(eq=False, kw_only=True)
class PlannedAcceptance(AcceptancePlan):
    """A written plan, the run that it verifies, and the vendor of the robot."""

    schema: Annotated[Literal["zerobeam/verification-plan/1"], it("kind and version of the document")] = (
        "zerobeam/verification-plan/1"
    )
    run: str
    sha256: str
    vendor: Annotated[str | None, internal]


def write_acceptance_plan(
    path: Path, file: Path, shots: int | None, tolerance: float | None, *, force: bool = False
) -> PlannedAcceptance:
    """Choose postures of the run that test its offsets once they are entered, and write them as a plan.

    BadInput where an offset is not identified, NotValidated for a misfit: then nothing is to be entered.
    """
    refuse_existing(file, force=force, keep=[path])
    run = read_run(path)
    refuse_existing(file, force=force, keep=[robot_path(run.header.robot, path.parent)])
    if shots is not None and shots > len(run.shots):
        raise BadInput(
            "the run has fewer postures than are asked for",
            found=f"--shots {shots}, {len(run.shots)} measurements",
            allowed="postures of the run: they are known to be reachable",
        )
    with one_blas_thread():
        solution, entered = _determined(run)
        usable = _usable(run, solution, shots)
        plan = choose(solution, entered, _tolerances(run.header, tolerance), shots, usable)
    _write(run, solution, plan, entered, file, force)
    return PlannedAcceptance(**vars(plan), run=path.name, sha256=run.sha256, vendor=vendor_of(run.robot))


@record
class RunOfTest:
    """A run of an acceptance test: of the calibration, or of the corrected robot."""

    file: str
    sha256: str
    provenance: dict[str, object]
    recorded: Annotated[Run, internal]

    @classmethod
    def of(cls, run: Run) -> RunOfTest:
        provenance: dict[str, object] = {
            key: value for key, value in run.header.provenance.items() if not key.startswith("true ")
        }
        return cls(run.path.name, run.sha256, provenance, run)


@record(kw_only=True)
class Verified(AcceptanceResult):
    """The answer of the acceptance test of a calibration by a new run, and the error measured before and
    after: verification.json."""

    schema: Annotated[Literal["zerobeam/acceptance/1"], it("kind and version of the document")] = (
        ACCEPTANCE_SCHEMA
    )
    power_required: float = POWER
    measured: MeasuredError
    calibration: RunOfTest
    run: RunOfTest
    conformity: Annotated[Conformity | None, internal] = None


def accepted(path: Path, new: Path, tolerance: float | None) -> Verified:
    """The answer of the acceptance test: the calibration run at `path`, the corrected robot's run `new`."""
    run, verified = read_run(path), read_run(new)
    with located(verified.path, verified.header_line):
        _require_of(run, verified)
    verified.require_analysable()
    with one_blas_thread():
        solution, entered = _determined(run)
        recorded = _recorded(run, verified)
        prediction = AcceptancePrediction(Predictor.of(solution), recorded, entered)
        answer = accept(prediction, solution, _tolerances(run.header, tolerance))
        measured = measured_error(solution, recorded, entered)
        required = run.header.required
        conformity = None if required is None else judged(solution, required)
    return Verified(
        **vars(answer),
        measured=measured,
        calibration=RunOfTest.of(run),
        run=RunOfTest.of(verified),
        conformity=conformity,
    )


def _recorded(run: Run, verified: Run) -> Problem:
    """The new measurements by the header of the calibration, with the targets of both."""
    measured = {item.target for item in verified.measurements}
    declared = {**run.header.targets, **verified.header.targets}
    targets = {name: target for name, target in declared.items() if name in measured}
    header = run.header.model_copy(update={"distances": (), "angles": (), "targets": targets})
    return recorded_problem(replace(verified, header=header))


def _determined(run: Run) -> tuple[Solution, dict[str, float]]:
    """The solution of a run, and the values to enter, deg (mm) by offset: of all that are not held, each
    identified, but for those that are as good as what is assumed, which are not entered."""
    solution = converged_solution(run, "nothing was to be entered")
    free = [row for row in solution.offsets if not row.held]
    with located(run.path, run.header_line):
        require_validated(solution)
        open_ = [row for row in free if row.status not in ("identified", "assumed")]
        if open_ or not any(row.status == "identified" for row in free):
            raise BadInput(
                "there is no acceptance test of a run that does not determine all its offsets: nothing is to"
                " be entered",
                found=", ".join(f"{row.name}: {row.status}" for row in open_ or free) or "all held",
                allowed="a run with the verdict pass",
                remedy="record more measurements: zerobeam check PLAN says which postures help",
            )
    return solution, values_to_enter(solution)


def offsets_to_enter(run: Run) -> dict[str, float]:
    """Values to enter after a run, deg (mm) by offset; BadInput as `write_acceptance_plan`."""
    with one_blas_thread():
        return _determined(run)[1]


def _usable(run: Run, solution: Solution, shots: int | None) -> Mask:
    """(N,) the postures in which the arm does not block the beam: no robot is moved by a plan of others.
    BadInput where too few are left."""
    usable = clear_postures(solution.problem, solution.fit.x, run)
    if usable.sum() < (shots or 1):
        blocked = listed([str(i) for i in np.asarray(solution.problem.shot_numbers)[~usable].tolist()])
        raise BadInput(
            "the run has fewer postures than are asked for in which the arm is not in the way of the beam",
            found=f"{usable.sum()} of {len(usable)}; the arm is in the way in measurements {blocked}",
            allowed="postures of the run with a free beam",
            remedy="where the links are thinner than 5 % of the arm, state `bodies` in the robot file",
            file=run.path,
        )
    return usable


def _tolerances(header: Header, tolerance: float | None) -> dict[str, float]:
    tolerances = header.tolerance
    return {
        "deg": tolerances.offset_deg if tolerance is None else tolerance,
        "mm": tolerances.length_mm if tolerance is None else tolerance,
    }


def _require_of(run: Run, verified: Run) -> None:
    """BadInput unless the new run is one of the plan that was made for this calibration."""
    sha256 = verified.header.provenance.get(_SHA)
    if sha256 != run.sha256:
        raise BadInput(
            "this run was not recorded with the plan that verifies that calibration",
            found="no provenance of a verification" if sha256 is None else f"{_SHA}: {sha256}",
            allowed=f"{_SHA}: {run.sha256}",
            remedy="make the plan with zerobeam plan verify RUN -o PLAN and record it; for measurements that"
            " are imported its head is the header",
        )
    kinds = (run.header.kinds, verified.header.kinds)
    others = {label for label, kind in kinds[1].items() if kinds[0].get(label) is not kind}
    if others:
        raise BadInput(
            "the verification has an instrument that the calibration has not",
            found=_called({label: kinds[1][label] for label in sorted(others)}),
            allowed=_called(kinds[0]),
            remedy="record the plan with the instruments of the calibration: its head is the header",
        )
    if arm_difference(run.robot, verified.robot) is not None:
        raise BadInput(
            "the two runs are of different robots, or one with a corrected robot file",
            found=verified.robot.name,
            allowed=f"{run.robot.name}, as in the calibration: the controller has the offsets, not the file",
        )


def _called(kinds: Mapping[str, type[Instrument]]) -> str:
    return ", ".join(f"{label}: {kind.name}" for label, kind in kinds.items())


def _write(
    run: Run, solution: Solution, plan: AcceptancePlan, entered: Collection[str], file: Path, force: bool
) -> None:
    problem = solution.problem
    about: dict[str, str | bool | int | float] = {
        VERIFIES: run.path.name,
        _SHA: run.sha256,
        _ENTERED: ", ".join(entered),
    }
    kept = {k: v for k, v in run.header.provenance.items() if not k.startswith("true ") and k != "origin"}
    header = run.header.model_copy(
        update={
            "robot": rebased(run.header.robot, run.path.parent, file.parent),
            "targets": _targets(run.header, solution, plan),
            "distances": (),
            "angles": (),
            "provenance": {**kept, **about},
        }
    )
    rows = np.round(plan.joints * problem.robot.display, _DECIMALS)
    _, measured = by_posture(run.measurements)
    planned = [(i, item) for i, row in enumerate(plan.rows) for item in measured[row]]
    several = len(planned) > len(rows)
    means = [
        Means(
            item.instrument if len(header.kinds) > 1 else None,
            item.variant or None,
            i if several else None,
        )
        for i, item in planned
    ]
    targets = [item.target for _, item in planned]
    write_plan(file, header, rows[[i for i, _ in planned]], targets, means=means, force=force)


def _targets(header: Header, solution: Solution, plan: AcceptancePlan) -> dict[str, StatedTarget]:
    """Where the targets of the plan are by the calibration; of what is no point, as its header states it."""
    problem = solution.problem
    points, targets = problem.split(solution.fit.x).targets, {}
    for name, point in zip(problem.targets, points.tolist(), strict=True):
        if name not in plan.targets or problem.is_station(name):
            continue
        entry = header.targets.get(name)
        if entry is not None and entry.kind != POINT:
            targets[name] = entry
            continue
        x, y, z = (round(value, 3) for value in point)
        targets[name] = StatedTarget(guess_mm=(x, y, z))
    return targets
