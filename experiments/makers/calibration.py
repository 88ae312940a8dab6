"""The identifiable offsets of a run, judged as by `analyse`, and the corrected arm: what may be applied.

A controller with nominal geometry gets the values of `values_to_enter`. A robot file holds links: it gets
the whole estimated arm, but for the deflection under gravity and the harmonics, which depend on the posture.
A program that is corrected posture by posture gets these too. What a file cannot hold is stated in it, with
what that leaves of the run's residuals.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np

from ...analysis.answer.findings import OtherBasins, without_a_result
from ...analysis.answer.result import RunInputs
from ...analysis.covariance import Covariance
from ...analysis.diagnostics.accuracy import place_uncertainty
from ...analysis.diagnostics.values_to_enter import ValueToEnter, offsets_to_enter
from ...analysis.prediction import PredictedRun, length_rows, predict_run, require_predictable, settled
from ...analysis.solution import ParameterResult, ParameterTable, Solution
from ...analysis.status import NOT_DESCRIBED, Status, known, versions
from ...model.arrays import Matrix
from ...model.errors import BadInput, located
from ...model.files.header import UrdfRef
from ...model.files.robot_file import robot_path
from ...model.files.run import Run
from ...model.instruments.kind import Assumption
from ...model.kernel import one_blas_thread
from ...model.kinematics.robot import JointKind, Robot
from ...model.likelihood.problem import Problem
from ...model.parsing.reading import did_you_mean, read_bytes
from ...model.records import inline, internal, it, key, record
from ...words.case import RunCase
from ...words.catalogue import against, nominal_arm, open_rows
from ...words.message import message_of_run
from ...words.misfit_words import criterion_sentence
from ...words.observability import part_of, reason_of, size_of, stating
from ...words.wording import listed, person
from ..validated_solution import SEED, converged_solution, require_validated
from .maker import Holds, one_line

# What a file says of a parameter with an estimate.
STATUS_WORDS: dict[Status, str] = {
    "identified": "identified",
    "assumed": "ASSUMED",
    "weak": "WEAK: weakly observable",
    "unvalidated": f"UNVALIDATED: {NOT_DESCRIBED}",
}


@record(kw_only=True)
class Correction:
    """One parameter of an export: its `row` of the answer, without a number where nothing is known.

    `applied` is what the exported file adds to the recorded position or to the nominal value: the estimate
    (of an offset that goes into nominal geometry the value to enter), or 0 where it is held, not determined
    by the data, `left_out`, as good as what is assumed and not exported `although_assumed`, unvalidated
    and not exported `despite_misfit`, or `of_nominal_arm`: of a controller that computes with another arm.
    `applied_u` is the standard uncertainty of that very value. `to_enter` is what a controller with nominal
    geometry takes of an offset, None where the file holds the links too.
    """

    row: Annotated[
        ParameterResult,
        inline("name", "unit", "status", "estimate", "std", "interval95"),
    ]
    left_out: Annotated[bool, it("true if `--without` names it")]
    despite_misfit: Annotated[bool, internal]
    although_assumed: Annotated[bool, internal] = False
    of_nominal_arm: Annotated[bool, internal] = False
    to_enter: Annotated[ValueToEnter | None, internal] = None

    @property
    def name(self) -> str:
        return self.row.name

    @property
    def status(self) -> Status:
        return self.row.status

    @property
    @key("whether it is to be applied")
    def exported(self) -> bool:
        validated = self.status != "unvalidated" or self.despite_misfit
        determined = known(self.status) or (self.status == "assumed" and self.although_assumed)
        return determined and validated and not (self.left_out or self.of_nominal_arm)

    @property
    @key(
        "what is to be added to the recorded position (0 if not): the value for nominal geometry, the"
        " estimate in `export robot`, `urdf` and `ur-calibration` with `--json`"
    )
    def applied(self) -> float:
        if not self.exported:
            return 0.0
        return (self.row.estimate or 0.0) if self.to_enter is None else self.to_enter.value

    @property
    @key("standard uncertainty of that value, null where nothing is applied")
    def applied_u(self) -> float | None:
        if not self.exported:
            return None
        return self.row.std if self.to_enter is None else self.to_enter.u

    @property
    @key("status of that value by its own u, null where nothing is applied")
    def applied_status(self) -> Status | None:
        if not self.exported:
            return None
        identified = self.status == "identified"
        return self.to_enter.status if self.to_enter is not None and identified else self.status

    @property
    def applied_rad(self) -> float:
        """`applied` in rad or mm."""
        return self._in_rad(self.applied)

    @property
    def of_arm(self) -> float:
        """The estimate where it is exported, rad or mm."""
        return self._in_rad((self.row.estimate or 0.0) if self.exported else 0.0)

    def _in_rad(self, value: float) -> float:
        return float(np.radians(value)) if self.row.unit == "deg" else value

    @property
    @key("as in `result.json`")
    def reason(self) -> str | None:
        return reason_of(self.row)


@record(kw_only=True)
class GeometryValue(Correction):
    """One geometry parameter; `mean` is its value in the estimate of all parameters together, rad or mm,
    `no_place`: the file cannot hold it."""

    mean: float
    no_place: bool = False

    @property
    def applied_rad(self) -> float:
        """What a file of the whole geometry holds, rad or mm. A parameter that the data do not determine by
        itself is part of the estimate of all together: at nominal it would spoil the others."""
        return 0.0 if self.gone or self.status == "held" else self.mean

    @property
    def gone(self) -> bool:
        """Whether it is not to be exported, and stays nominal."""
        out = self.left_out or self.no_place or self.of_nominal_arm
        return out or (self.status == "unvalidated" and not self.despite_misfit)

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
            words = "UNIDENTIFIABLE by itself, as in the estimate of all together"
            if self.status == "held" or self.left_out:
                words = f"{'HELD' if self.status == 'held' else 'EXCLUDED on request'}, nominal"
            elif self.no_place:
                return f"{self.name}: no place in this file, nominal"
            return f"{self.name}: {words}{why}"
        words = STATUS_WORDS[self.status]
        words += ", EXCLUDED on request" if self.left_out else "" if self.exported else ", not applied"
        words += ", no place in this file" if self.no_place and not self.left_out else ""
        return f"{self.name}: {row.estimate:+.6f} {row.unit}, u {row.std:.2g} {row.unit}, {words}"


def corrected_robot(
    problem: Problem, offsets: Sequence[Correction], geometry: Sequence[GeometryValue]
) -> Robot:
    """The robot with its links as estimated, and the estimated offsets in the transforms before its joints:
    at recorded positions it is where the arm was, but for what depends on the posture."""
    values = np.array([value.applied_rad for value in geometry])
    moved = problem.geometry.applied(problem.robot, values)
    return moved.with_offsets(np.array([offset.of_arm for offset in offsets]))


def posture_offsets(problem: Problem, geometry: Sequence[GeometryValue], joints: Matrix) -> Matrix:
    """(n,) what gravity and harmonics add to the offsets at recorded `joints` (n,), rad."""
    return problem.geometry.added(problem.robot, np.array([value.applied_rad for value in geometry]), joints)


def left_out_of(geometry: Sequence[GeometryValue], holds: Holds) -> tuple[GeometryValue, ...]:
    """The parameters that are not in a file of that kind, whether it has no room for them or they are not to
    be exported; held ones have no value to lose."""
    if holds == "all":
        return ()
    return tuple(
        value
        for value in geometry
        if value.status != "held"
        and (holds == "offsets" or (holds == "links" and not value.of_link) or value.gone)
    )


def rms_without(solution: Solution, names: Collection[str], offsets: Sequence[Correction] = ()) -> float:
    """Root mean square, mm, of the residuals with these parameters at their prior means and `offsets` as they
    are applied.

    Targets and free frames are where they then fit best.
    """
    problem, x = solution.problem, solution.fit.x.copy()
    parameters = problem.parameters
    gone = np.array([name in names for name in parameters.names])
    x[gone] = parameters.prior_mean[gone]
    for offset in offsets:
        if offset.exported:
            x[parameters.index(offset.name)] = offset.applied_rad
            gone[parameters.index(offset.name)] = True
    placed = (parameters.group("target") | parameters.group("frame")) & parameters.free & gone.any()
    return problem.rms_mm(
        problem.linearise(settled(problem, x, placed, length_rows(problem), prior=False))[0]
    )


OFFSETS_SCHEMA: Final = "zerobeam/offsets/1"
NO_ROBOT = "SIMULATED: no robot was measured, so that nothing here may be applied to one"
MEANING = "true position = recorded position + offset"
ONCE = (
    "Do ONE of these, never both: enter the values at the controller, or use corrected programs and robot"
    " models. Both together correct twice."
)
ENTERED = (
    "To enter: what serves a controller with nominal geometry best. It makes up for links and bending too, as"
    " far as offsets can, and is no offset of the arm."
)
_SHA_LINE = "sha256 of the run: "  # in the head of every file of a corrected robot
_ROUNDED = 5e-7  # deg, mm: six decimals are written


@record(kw_only=True)
class JointOffset(Correction):
    """One joint's offset. `joint` is the joint's name in its robot file, which may hold any character."""

    joint: Annotated[str, it("its name in the robot file")]
    kind: Annotated[JointKind, it("what it does")]

    @property
    def only_value_weak(self) -> bool:
        """Whether the offset is identified, and the value to enter is not known within the tolerance."""
        return self.status == "identified" and self.applied_status == "weak"

    @property
    def sentence(self) -> str:
        """The line about it in a file, in ASCII."""
        row = self.row
        if self.status == "held":
            words = f"HELD at 0, not estimated: {self.reason}"
        elif row.estimate is None:
            words = f"UNIDENTIFIABLE, excluded: {self.reason}"
        else:
            words = f"{row.estimate:+.6f} {row.unit}, u {row.std:.2g} {row.unit}, "
            words += STATUS_WORDS[self.status]
            words += f" ({self.reason})" if self.status == "assumed" else ""
            words += "" if self.exported or self.left_out else ", not applied"
            words += ", EXCLUDED on request" if self.left_out else ""
            if self.exported and abs(self.applied - row.estimate) > _ROUNDED:
                words += f"; to enter: {self.applied:+.6f} {row.unit}, u {self.applied_u:.2g} {row.unit}"
                words += f", {STATUS_WORDS['weak']}" if self.only_value_weak else ""
        return one_line(f"{self.name} ({self.joint}): {words}")


@record
class ExportedParameter:
    """A parameter of the answer, and whether the file is to apply it."""

    row: Annotated[
        ParameterResult,
        inline("name", "unit", "group", "status", "estimate", "std", "interval95", "tolerance_share"),
    ]
    exported: Annotated[bool, it("whether it is to be applied")]

    @property
    @key("as in `result.json`")
    def reason(self) -> str | None:
        return reason_of(self.row)


@record
class RobotCalibration:
    """All offsets of a robot in the order of its joints, and what they were made from.

    `geometry` has the geometry parameters, none of an exact arm; `corrected` is the robot with all that a
    robot can hold of these, `posture_offsets` what gravity and harmonics add at recorded joints (n,), rad;
    `place_uncertainty` U of points (P, 3) of the flange at joints (P, n) with all of this made up for;
    `left_out` those that the file does not hold, with the residuals'
    `rms_mm` (root mean square) as estimated and as the file has it. `rows` and `covariance` are the whole
    answer; `remarks` are of a file, beside the warnings of the calibration itself.
    """

    schema: Annotated[Literal["zerobeam/offsets/1"], it("kind and version of the document")] = field(
        default=OFFSETS_SCHEMA, kw_only=True
    )
    meaning: Annotated[str, it("the sign, in words")] = field(default=MEANING, kw_only=True)
    offsets: Annotated[tuple[JointOffset, ...], it("joint 1 first")]
    geometry: Annotated[tuple[GeometryValue, ...], internal]
    corrected: Annotated[Robot, internal]
    posture_offsets: Annotated[Callable[[Matrix], Matrix], internal]
    place_uncertainty: Annotated[Callable[[Matrix, Matrix], Matrix], internal]
    holds: Annotated[Holds, internal]
    left_out: Annotated[tuple[GeometryValue, ...], internal]
    rms_mm: Annotated[tuple[float, float], internal]
    rows: Annotated[ParameterTable, internal]
    covariance: Annotated[
        Covariance,
        it(
            "`names`, `units`, `status` and `matrix` (rows) of the parameters that the data determine, in the"
            " products of their units"
        ),
    ]
    inputs: Annotated[
        RunInputs, it("what it was made from: `run`, `sha256`, `robot`, `shots`, `seed`, `versions`")
    ]
    misfit: Annotated[bool, internal]
    warnings: Annotated[tuple[str, ...], internal]
    remarks: Annotated[tuple[str, ...], internal] = ()

    @property
    @key("all parameters of the answer: offsets, geometry, targets, tool, noise")
    def parameters(self) -> tuple[ExportedParameter, ...]:
        exported = {one.name for one in (*self.offsets, *self.geometry) if one.exported}
        return tuple(ExportedParameter(row, row.name in exported) for row in self.rows)

    @property
    @key("sentences to be read with it")
    def notes(self) -> tuple[str, ...]:
        return (ONCE, *self.warnings, *self.remarks)

    @property
    def head(self) -> list[str]:
        """Short lines of ASCII that say what a file holds and where that is from."""
        made = self.inputs
        lines = [
            *(sentence for sentence in self.warnings if sentence == NO_ROBOT),
            one_line(f"zerobeam {made.versions['zerobeam']}: joint offsets of {made.robot}"),
            one_line(f"from the run {made.run}, {made.shots} measurements"),
            f"{_SHA_LINE}{made.sha256}",
            "applied by, on: ______________________",
            ONCE,
            f"{MEANING}. An offset that is held or excluded counts as 0.",
            *([ENTERED] if self.enters else []),
            *(offset.sentence for offset in self.offsets),
            *map(one_line, self._on_geometry),
            *(one_line(f"note: {sentence}") for sentence in self.warnings if sentence != NO_ROBOT),
        ]
        return [row for line in lines for row in textwrap.wrap(line, 100, subsequent_indent="    ")]

    @property
    def enters(self) -> bool:
        """Whether what is applied makes up for the geometry."""
        return any(offset.exported and offset.to_enter is not None for offset in self.offsets) and bool(
            self.geometry
        )

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
    allow_assumed: bool = False,
    unvalidated: bool = False,
    as_data: bool = False,
    without: Sequence[str] = (),
    held_out: Run | None = None,
    holds: Holds = "offsets",
    no_place: Collection[str] = (),
) -> RobotCalibration:
    """The offsets of a run, ready to be applied; `without` are names of offsets and geometry parameters to
    leave out, `held_out` is a run that they must predict, `holds` says what the kind of file has room for,
    but for the parameters `no_place`, by name.

    BadInput where an offset is unidentifiable, or weak and not allowed to be, and not excluded; where a weak
    one would be unidentifiable but for what is assumed, unless that is allowed; where the message of the run
    would say to enter nothing; where nothing is left to apply. An offset that is as good as what is assumed
    is left out, unless that is allowed. That a target seems to have moved may be allowed:
    then the warnings say so. NotValidated where the model does not describe the run, unless that is asked for
    (`unvalidated`) or the file states the statuses (`as_data`), in which nothing is then applied, nor of a
    nominal arm whose controller computes with its factory calibration. FitFailed where the fit did not
    converge.
    """
    # One thread, as in `analyse`: the last bits depend on it.
    with one_blas_thread(), located(run.path, run.header_line):
        corrected_before = _corrected_arm(run.header.robot, run.path.parent)
        if holds == "postures":
            require_nominal_arm(run.header.robot, run.path.parent)
        if held_out is not None:
            require_predictable(run, held_out)
        solution = converged_solution(run, "nothing can be exported")
        if not (unvalidated or as_data):
            require_validated(solution, allow_displaced)
        case = RunCase.so_far(solution, run.path.name, run.header.model_dump(mode="json"), str)
        predicted = None if held_out is None else predict_run(solution, held_out)
        _require_nothing_against(solution, case, predicted)
        despite = unvalidated or (allow_displaced and not as_data)
        rows = [row for row in solution.parameters if row.group in ("offset", "geometry")]
        _check_without(without, rows)
        of_nominal_arm = as_data and nominal_arm(case)
        takes_nominal = holds in ("offsets", "all") and (solution.misfit is None or despite)
        takes_nominal &= not of_nominal_arm
        to_enter = offsets_to_enter(solution, without, assumed=allow_assumed) if takes_nominal else {}
        offsets = [
            JointOffset(
                row=row,
                left_out=row.name in without,
                despite_misfit=despite,
                although_assumed=allow_assumed,
                of_nominal_arm=of_nominal_arm,
                joint=joint.name,
                kind=joint.kind,
                to_enter=to_enter.get(row.name),
            )
            for row, joint in zip(solution.offsets, run.robot.joints, strict=True)
        ]
        nothing_applied = of_nominal_arm or (as_data and solution.misfit is not None)
        _require_known(offsets, case, allow_weak, nothing_applied)
        if not allow_assumed:
            _require_weak_by_plan(offsets, solution.identified.weak_on)
        geometry = tuple(
            GeometryValue(
                row=row,
                left_out=row.name in without,
                despite_misfit=despite,
                of_nominal_arm=of_nominal_arm,
                mean=float(solution.fit.x[solution.problem.parameters.index(row.name)]),
                no_place=row.name in no_place,
            )
            for row in rows
            if row.group == "geometry"
        )
        left_out = left_out_of(geometry, holds)
        # What is as good as what is assumed stays: the tool's mounting would be off in its place.
        gone = {value.name for value in left_out} | {offset.name for offset in offsets if offset.left_out}
        return RobotCalibration(
            tuple(offsets),
            geometry,
            corrected_robot(solution.problem, offsets, geometry),
            partial(posture_offsets, solution.problem, geometry),
            partial(place_uncertainty, solution, _made_up_for(offsets, geometry)),
            holds,
            left_out,
            (rms_without(solution, ()), rms_without(solution, gone, offsets)),
            solution.parameters,
            solution.covariance,
            RunInputs(run.path.name, run.sha256, run.robot.name, solution.problem.shots, SEED, versions()),
            solution.misfit is not None,
            (
                *_not_to_enter(case, holds, of_nominal_arm=of_nominal_arm),
                *_relative(corrected_before, holds),
                *_weak_values(offsets),
                *map(criterion_sentence, solution.contradictions),
                *run.warnings,
            ),
        )


def _made_up_for(offsets: Sequence[JointOffset], geometry: Sequence[GeometryValue]) -> tuple[str, ...]:
    """The offsets that are corrected; none where a link is left out, whose error nothing states."""
    out = any(value.left_out for value in geometry)
    return () if out else tuple(one.name for one in offsets if one.exported)


def _not_to_enter(case: RunCase, holds: Holds, *, of_nominal_arm: bool) -> tuple[str, ...]:
    """That nothing is to be entered, where the run's message says so; of programs that are corrected posture
    by posture nothing is entered anyway."""
    if case.simulated:
        return (NO_ROBOT,)
    content = message_of_run(replace(case, name=person))
    if content.may.enter or holds == "postures":
        return ()
    done = "nothing is to be applied, as" if of_nominal_arm else "exported although"
    return (f"{done} the message of the run says: {content.action.text}",)


def _weak_values(offsets: Sequence[JointOffset]) -> tuple[str, ...]:
    """Values are entered together: without one of them the others would not lower the error of the TCP."""
    names = [offset.name for offset in offsets if offset.only_value_weak]
    if not names:
        return ()
    return (
        f"the value to enter of {listed(names)} is only weakly observable, though the offset is identified:"
        " it makes up for links that the measurements do not determine. Enter all values together, or none",
    )


def require_nominal_arm(ref: str | UrdfRef, folder: Path) -> None:
    """BadInput where a robot, as named from `folder`, is an export: programs are of a controller that
    computes with the nominal arm."""
    name = _corrected_arm(ref, folder)
    if name is not None:
        raise BadInput(
            "this robot file is a corrected arm already, and the controller of a program computes with the"
            " nominal one",
            found=f"robot: {name}, which zerobeam export wrote",
            allowed="the nominal arm, or a run with it",
            remedy="name the nominal arm (of a run: robot: … in the head of a copy), or take the first run,"
            " whose offsets are in that file",
        )


def _corrected_arm(ref: str | UrdfRef, folder: Path) -> str | None:
    """The name of a robot file that is an export: the arm with the offsets of a run."""
    path = robot_path(ref, folder)
    if path is None or not path.is_file() or _SHA_LINE.encode() not in read_bytes(path):
        return None
    return path.name


def _relative(corrected_before: str | None, holds: Holds) -> tuple[str, ...]:
    if corrected_before is None or holds != "offsets":
        return ()
    return (
        f"the robot file of the run ({corrected_before}) is a corrected arm already: these values are the"
        " remaining offsets of that arm, not those for a controller that computes with the nominal one",
    )


def _require_nothing_against(solution: Solution, case: RunCase, held_out: PredictedRun | None) -> None:
    """BadInput where something speaks against the values, as the run's message would say."""
    row = against(without_a_result(solution, held_out))
    if row is None:
        return
    if isinstance(row.finding, OtherBasins):
        raise BadInput(
            "the measurements do not determine which of several sets of offsets is the true one",
            found=f"{solution.fit.other_basins} more that fit nearly as well",
            remedy="record more measurements, in varied postures",
        )
    action = row.action(case)
    raise BadInput(
        "the measurements speak against the values of this run, so nothing is exported",
        found=row.sentence(case),
        remedy=None if action is None else action.text,
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


def _require_known(
    offsets: Sequence[JointOffset], case: RunCase, allow_weak: bool, nothing_applied: bool
) -> None:
    def named(status: Status) -> list[JointOffset]:
        return [offset for offset in offsets if offset.status == status and not offset.left_out]

    unknown, weak = named("unidentifiable"), named("weak")
    if unknown:
        raise BadInput(
            f"{listed([offset.name for offset in unknown])} cannot be exported: the data do not determine it",
            found="; ".join(f"{offset.name}: {offset.reason}" for offset in unknown),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"{_to_determine(unknown, case)}; or exclude by name: {_leaving_out(unknown)}",
        )
    if weak and not allow_weak:
        raise BadInput(
            f"{listed([offset.name for offset in weak])} cannot be exported as known: weakly observable",
            found="; ".join(
                f"{offset.name}: u {offset.row.std:.2g} {offset.row.unit} ({offset.reason})"
                for offset in weak
            ),
            allowed="identified offsets, and weak ones with --allow-weak",
            remedy=f"{_to_determine(weak, case)}; or --allow-weak; or exclude by name: {_leaving_out(weak)}",
        )
    if not (nothing_applied or any(offset.exported for offset in offsets)):
        raise BadInput(
            "there is nothing to export: every offset is held, excluded or as good as what is assumed",
            found="; ".join(offset.sentence for offset in offsets),
            remedy="state how well tool and instruments are known; or --allow-assumed"
            if named("assumed")
            else None,
        )


def _to_determine(offsets: Sequence[JointOffset], case: RunCase) -> str:
    """What the run's message says of offsets that the measurements leave open."""
    rows = open_rows(replace(case, parameters=[offset.row for offset in offsets]))
    action = rows[0].action(case) if rows else None
    return "record other measurements" if action is None else action.text.removesuffix(".")


def _require_weak_by_plan(
    offsets: Sequence[JointOffset], weak_on: Mapping[str, tuple[Assumption, ...]]
) -> None:
    """BadInput where a weak offset is to be exported that would be unidentifiable but for what is assumed."""
    resting = [offset for offset in offsets if offset.exported and offset.name in weak_on]
    if resting:
        on = list(dict.fromkeys(one for offset in resting for one in weak_on[offset.name]))
        raise BadInput(
            f"{listed([offset.name for offset in resting])} cannot be exported as weakly observable:"
            " unidentifiable without what is assumed",
            found=f"assumed: {listed(list(dict.fromkeys(f'{part_of(one)}, {size_of(one)}' for one in on)))}",
            allowed="weakly observable offsets that are not unidentifiable without it; others with"
            " --allow-assumed too",
            remedy=f"{stating(on)}; or --allow-assumed; or exclude by name: {_leaving_out(resting)}",
        )


def _leaving_out(offsets: Sequence[JointOffset]) -> str:
    return " ".join(f"--without {offset.name}" for offset in offsets)
