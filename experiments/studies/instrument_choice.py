"""Which instrument, and how many measurements? Plans of every setup, predicted.

A setup is what a header states of instruments and targets, with the minutes that a measurement takes and a
class of cost (`instruments.yaml`, or a file like it). For each number of measurements the best plan is
chosen; what it leaves unknown of the offsets, and of the TCP, follows from its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, JsonValue

from ...analysis.observability.identifiability import identify
from ...analysis.observability.predictions import predicted_covariance
from ...analysis.tcp_region import (
    arm_covariance,
    moving_offsets,
    region_postures,
    tool_point,
    undetermined_offsets,
)
from ...model.arrays import Matrix
from ...model.errors import located
from ...model.files.header import Header
from ...model.files.robot_file import load_robot
from ...model.instruments.kind import Measurement
from ...model.kernel import one_blas_thread
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem
from ...model.parsing.validation import FileModel, Name, Positive, Vector, read_model, validate
from ...model.records import it
from ...words import numbers
from ..measuring_options import Portion
from ..plans.make import PlanRequest, candidate_pools, portions
from ..plans.optimal import Planner, Proposal
from .answer import StudyAnswer
from .cases import Engine

BUILT_IN = Path(__file__).with_name("instruments.yaml")
_CANDIDATES = 600
_TCP_POSTURES = 512

Count = Annotated[int, Field(ge=1, le=1000)]


class StatedPart(FileModel):
    """What an instrument does in a setup."""

    share: Count = Field(default=1, description="its measurements for one of another with the share 1")
    minutes: Positive | None = Field(
        default=None, description="what a measurement takes, minutes (default: as its kind does a person)"
    )


class StatedSetup(FileModel):
    """Instruments and targets that are bought and used together."""

    name: Name = Field(description="what the study calls it")
    cost: Annotated[int, Field(ge=1, le=4)] = Field(description="class of its cost, 1 the cheapest")
    measure: Annotated[dict[Name, StatedPart], Field(min_length=1)] = Field(
        description="each instrument by its name in the header (`tool` for that of the key tool)"
    )
    header: dict[Name, JsonValue] = Field(description="keys of a header besides robot and noise.joint_deg")


class SetupsFile(FileModel):
    """Setups that are compared on one robot."""

    schema_: Literal["zerobeam/setups/1"] = Field(alias="schema", description="kind and version of the file")
    robot: str = Field(description="as in a header")
    joint_deg: Positive = Field(description="noise of the joints, degrees")
    tcp_mm: Vector = Field(description="the TCP in the flange frame, millimetres")
    measurements: Annotated[list[Count], Field(min_length=1)] = Field(description="numbers of measurements")
    setups: Annotated[list[StatedSetup], Field(min_length=1)] = Field(description="what is compared")


@dataclass(frozen=True)
class SetupPlan:
    """The best plan of so many `measurements`, by instrument: it takes `minutes`, travel included.

    `worst_u` is the largest standard uncertainty of an offset that is not held, deg (mm), `worst` its name;
    `tcp_mm` the expected error of the TCP over the region where the whole estimate is used, rms. There is
    neither where an offset that it depends on is not determined: `undetermined` names those.
    """

    measurements: int
    by_instrument: dict[str, int]
    minutes: float
    worst_u: float | None
    worst: str | None
    tcp_mm: float | None
    undetermined: tuple[str, ...]
    efficiency: float


@dataclass(frozen=True)
class SetupCase:
    """A setup with its plans, and the class of its cost."""

    name: str
    cost: int
    plans: tuple[SetupPlan, ...]


@dataclass(frozen=True)
class InstrumentsSettings:
    """How the study was carried out."""

    robot: Annotated[str, it("robot")]
    joint_deg: Annotated[float, it("noise of the joints", unit="deg")]
    tcp_mm: Annotated[tuple[float, float, float], it("TCP in the flange frame", unit="mm")]
    measurements: Annotated[tuple[int, ...], it("numbers of measurements")]
    candidates: Annotated[int, it("candidate postures of each setup")]
    seed: Annotated[int, it("seed")]


@dataclass(frozen=True, kw_only=True)
class InstrumentsStudy(StudyAnswer):
    """The whole answer."""

    settings: InstrumentsSettings
    setups: tuple[SetupCase, ...]


def instruments_study(setups: Path | None, engine: Engine) -> InstrumentsStudy:
    """Carry the study out, of the built-in setups or of those of a file."""
    path = BUILT_IN if setups is None else setups
    content = read_model(SetupsFile, path)
    for setup in content.setups:
        with located(path):
            _header(content, setup)
    pieces = [(path, index, engine.seed) for index in range(len(content.setups))]
    names = [setup.name for setup in content.setups]
    cases = tuple(engine.each("instruments", SetupCase, _case, pieces, setups=names))
    settings = InstrumentsSettings(
        content.robot,
        content.joint_deg,
        content.tcp_mm,
        tuple(content.measurements),
        _CANDIDATES,
        engine.seed,
    )
    return InstrumentsStudy(
        study="instruments",
        title="Which instrument, and how many measurements?",
        headline=_headline(cases),
        agrees=True,
        notes=(
            "Predicted for a typical arm, by the best plan of each number of measurements; nothing is"
            " simulated.",
            "The error of the TCP is that which the uncertainty of the estimates makes, in the base frame of"
            " joint 1, with offsets and geometry in the controller.",
        ),
        settings=settings,
        setups=cases,
    )


def _header(content: SetupsFile, setup: StatedSetup) -> Header:
    noise = setup.header.get("noise", {})
    assert isinstance(noise, dict)
    keys = {**setup.header, "robot": content.robot, "noise": {**noise, "joint_deg": content.joint_deg}}
    return validate(Header, keys, file=None, line=lambda _: None)


def _case(piece: tuple[Path, int, int]) -> SetupCase:
    """A setup of a file, by its index, planned with a seed."""
    file, index, seed = piece
    content = read_model(SetupsFile, file)
    setup = content.setups[index]
    header, parts = _header(content, setup), setup.measure
    robot, whole = load_robot(header.robot, file.parent), sum(part.share for part in parts.values())
    request = PlanRequest(
        header=header,
        header_folder=file.parent,
        measure={label: Portion(part.share) for label, part in parts.items()},
        candidates=_CANDIDATES,
        max_shots=2,
        seed=seed,
    )
    pools = candidate_pools(request, header, robot, portions(request), lambda share: None)
    planner, plans = Planner(header, robot, {}, pools), []
    for count in content.measurements:
        counts = {label: max(round(count * part.share / whole), 1) for label, part in parts.items()}
        proposal = planner.optimal(counts, seed=seed, starts=4)
        each = {label: part.minutes or header.kinds[label].minutes for label, part in parts.items()}
        minutes = sum(counts[label] * each[label] for label in parts) + (proposal.travel_s or 0.0) / 60
        plans.append(_predicted(header, robot, proposal, counts, minutes, np.array(content.tcp_mm)))
    return SetupCase(setup.name, setup.cost, tuple(plans))


def _predicted(
    header: Header, robot: Robot, proposal: Proposal, counts: dict[str, int], minutes: float, tcp: Matrix
) -> SetupPlan:
    measured = [[Measurement(*each, {})] for each in proposal.planned]
    planned = Problem.of_measured(header, robot, proposal.postures, measured, planned=True)
    x = planned.nominal()
    problem = planned.at_predicted(x)
    with one_blas_thread():
        covariance, status = predicted_covariance(problem, x), identify(problem, x).status
    offsets = [item for item in problem.parameters.items if item.group == "offset"]
    pairs = zip(offsets, status, strict=False)
    undetermined = tuple(item.name for item, each in pairs if each == "unidentifiable")
    _, jacobian = tool_point(problem, x, tcp, region_postures(problem, _TCP_POSTURES))
    tcp_mm = None
    if not (moving_offsets(problem, jacobian) & undetermined_offsets(problem, status)).any():
        spread = arm_covariance(problem, covariance)
        tcp_mm = float(np.sqrt(np.einsum("pka,ab,pkb->p", jacobian, spread, jacobian).mean()))
    return SetupPlan(
        measurements=sum(counts.values()),
        by_instrument=counts,
        minutes=minutes,
        worst_u=None if undetermined else proposal.worst,
        worst=None if undetermined else max(proposal.std, key=proposal.std.__getitem__),
        tcp_mm=tcp_mm,
        undetermined=undetermined,
        efficiency=proposal.efficiency,
    )


def _headline(cases: tuple[SetupCase, ...]) -> str:
    """The setup with the least uncertain offsets at the largest number of measurements, and the quickest."""
    last = [(case, case.plans[-1]) for case in cases if case.plans[-1].worst_u is not None]
    if not last:
        return "No setup determines all offsets."
    best, plan = min(last, key=lambda each: each[1].worst_u or np.inf)
    cheap, other = min(last, key=lambda each: (each[0].cost, each[1].worst_u or np.inf))
    least, less = (numbers.spread(one.worst_u or 0.0, "deg") for one in (plan, other))
    sentence = (
        f"With {plan.measurements} measurements {best.name} leaves the smallest uncertainty of the offsets:"
        f" u = {least}."
    )
    more = f" Of the cheapest that determine all offsets {cheap.name} leaves {less}."
    return sentence if cheap is best else sentence + more
