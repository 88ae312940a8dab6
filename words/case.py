"""A run's answer as the catalogue asks about it: of a result, or of a solution while the run is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import get_args

from ..analysis.answer.findings import off_placements, on_the_model
from ..analysis.answer.result import Result
from ..analysis.diagnostics.diagnosis import Explanation
from ..analysis.diagnostics.values_to_enter import Conformity, conforms, judged
from ..analysis.misfit import Criterion, Misfit
from ..analysis.observability.causes import Held, NullDirection, TooFewMeasurements
from ..analysis.observability.power import DetectionPower
from ..analysis.solution import ParameterResult, Solution
from ..analysis.status import Verdict
from ..model.files.header import StatedRequirement
from ..model.instruments.registry import KINDS
from .provenance import is_simulated
from .run_argument import run_argument
from .wording import Namer, person

_NEAR_MM = 50.0  # U of a target to which a plan can be aimed


@dataclass(frozen=True, eq=False, kw_only=True)
class RunCase:
    """`stopped` says why the fit did not converge; `findings` are the criteria of a misfit, what else speaks
    against model and values, and the placements that are off. `result` is None while a run is being measured:
    no cause of a misfit was looked for then. `name` writes the names of parameters."""

    verdict: Verdict
    stopped: str | None
    parameters: Sequence[ParameterResult]
    null_space: Sequence[NullDirection]
    power: Sequence[DetectionPower]
    misfit: Misfit | None
    k: float
    findings: Sequence[object]
    run: str
    header: Mapping[str, object]
    result: Result | None = None
    vendor: str | None = None
    judged: Conformity | None = None
    name: Namer = person

    @classmethod
    def of_result(cls, result: Result, name: Namer = person) -> RunCase:
        """Of a whole answer."""
        criteria = () if result.misfit is None else result.misfit.criteria
        others = (one for one in result.findings or () if not isinstance(one, get_args(Criterion)))
        return cls(
            verdict=result.verdict,
            stopped=None if result.likelihood.converged else result.likelihood.reason,
            parameters=result.parameters,
            null_space=result.identifiability.null_space,
            power=result.power,
            misfit=result.misfit,
            k=result.coverage_factor,
            findings=(*criteria, *others, *off_placements(result.placements.leave_one_out)),
            run=result.inputs.run,
            header=result.inputs.header,
            result=result,
            vendor=result.inputs.vendor,
            judged=result.conformity,
            name=name,
        )

    @classmethod
    def so_far(
        cls, solution: Solution, run: str, header: Mapping[str, object], name: Namer = person
    ) -> RunCase:
        """Of a fit alone, to the measurements that a `run` of that name has."""
        required = header.get("required")
        return cls(
            verdict=solution.verdict,
            vendor=solution.problem.robot.vendor,
            judged=None if required is None else judged(solution, StatedRequirement.model_validate(required)),
            stopped=None if solution.converged else solution.fit.reason,
            parameters=solution.parameters,
            null_space=solution.null_space,
            power=solution.power,
            misfit=solution.misfit,
            k=solution.coverage_factor,
            findings=tuple(on_the_model(solution)),
            run=run,
            header=header,
            name=name,
        )

    @property
    def sound(self) -> bool:
        """Whether there is an answer, by a model that describes the measurements."""
        return self.stopped is None and self.misfit is None

    @property
    def too_few(self) -> TooFewMeasurements | None:
        """What too few measurements lack."""
        causes = (direction.cause for direction in self.null_space)
        return next((cause for cause in causes if isinstance(cause, TooFewMeasurements)), None)

    @property
    def offsets(self) -> list[ParameterResult]:
        """The offsets that are estimated."""
        return [row for row in self.parameters if row.group == "offset" and not row.held]

    @property
    def held(self) -> list[str]:
        """The offsets that the header holds, and not the method: others have to take up a wrong one. Not the
        last one of a free tool, which the tool takes up."""
        offsets = [row for row in self.parameters if row.group == "offset"]
        tool = self.header.get("tool")
        if isinstance(tool, Mapping) and tool.get("calibrated") is False:
            offsets = offsets[:-1]
        return [row.name for row in offsets if row.cause == Held("header")]

    @property
    def diagnosis(self) -> Sequence[Explanation] | None:
        """What could be wrong; None where that was not looked for."""
        return None if self.result is None else self.result.diagnosis

    @property
    def conformity(self) -> Conformity | None:
        """Of a pass: whether the robot meets what it must."""
        return self.judged if self.verdict == "pass" else None

    @property
    def falls_short(self) -> bool:
        """Of a pass: whether the robot does not meet what it must, or may not."""
        if self.verdict != "pass" or self.conformity is not None:
            return not conforms(self.conformity)
        return self.header.get("required") is not None

    @property
    def provenance(self) -> Mapping[str, object]:
        provenance = self.header.get("provenance")
        return provenance if isinstance(provenance, Mapping) else {}

    @property
    def simulated(self) -> bool:
        """Whether no robot was measured."""
        return is_simulated(self.provenance)

    @property
    def argument(self) -> str:
        """The run for a command."""
        return run_argument(self.run)

    @property
    def again(self) -> str:
        """The command that analyses the run again."""
        return f"zerobeam analyse {self.argument}"

    @property
    def plan(self) -> str | None:
        """The command that plans measurements, None where there is none."""
        return None if self.planned is None else f"{self.planned} -o plan.yaml"

    @property
    def planned(self) -> str | None:
        """The same without options and file: by the run's instrument, None where it has several, or a tool
        that has several targets."""
        targets, stations = self.header.get("targets") or {}, self.header.get("instruments") or {}
        if not self.run or not isinstance(targets, dict) or not isinstance(stations, dict):
            return None
        command = f"zerobeam plan optimal --header {self.argument}"
        if stations:
            planned = len(stations) == 1 and self.header.get("tool") is None
            known = all(isinstance(row, dict) and row.get("guess_mm") for row in targets.values())
            return command if planned and known else None
        names = {*targets, *(row.name[:-2] for row in self.parameters if row.group == "target")}
        if len(names) != 1:
            return None
        (target,) = names
        row = targets.get(target)
        at_mm = self._coordinates(target, row if isinstance(row, dict) else {})
        if target not in {kind.target for kind in KINDS.values()} or at_mm is None:
            return None
        coordinates = ",".join(f"{float(value):g}" for value in at_mm)
        return f"{command} --target={coordinates}"

    def _coordinates(self, target: str, row: Mapping[str, object]) -> Sequence[float] | None:
        """About where a target is, mm: as its `row` in the header states, or as the measurements have it,
        near enough to be aimed at. None where neither says so."""
        guess = row.get("guess_mm")
        if isinstance(guess, list | tuple):
            return guess
        rows = [each for each in self.parameters if each.group == "target" and each.name[:-2] == target]
        near = self.sound and all(each.std is not None and self.k * each.std <= _NEAR_MM for each in rows)
        return [round(each.estimate or 0.0) for each in rows] if rows and near else None
