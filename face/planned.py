"""Before the measurements: check a plan, find the best one, or simulate a run of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..analysis.covariance import parameter_among
from ..analysis.observability.aim import aim_plan
from ..analysis.observability.check import Check, CheckedParameter, PlanVerdict
from ..experiments.measuring_options import PlanOptions, Portion
from ..experiments.plans.constraints import prospects, violations
from ..experiments.plans.make import MadePlan, PlanRequest, make_plan
from ..experiments.simulate import Truth, simulated_shots
from ..model.arrays import ByValue
from ..model.errors import BadInput
from ..model.files.from_arrays import checked, plain
from ..model.files.header import RUN_SCHEMA, Header
from ..model.files.measurements import completed, read_header
from ..model.files.plan import Plan
from ..model.files.robot_file import built_in_robots
from ..model.files.run import Run
from ..model.options import USUAL_REPEATS, checked_options, require_number
from ..reports.plan.check_page import check_front, predicted_table
from ..reports.plan.plan_page import plan_turnable, postures_of
from ..reports.style.blocks import Page, Verdict
from ..words import numbers
from ..words.geometry_words import check_lines
from ..words.message import message
from ..words.provenance import SIMULATED
from ..words.sentences import to_json
from ..words.wording import clipped, counted
from .checked_arguments import require_mapping, require_plan, vector
from .notebook import AppView, app_of, write_plan_beside
from .pictures import SceneView, scene_view
from .tables import ShownPage, ShownPredictions

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class CheckedPlan(ShownPage, Check):
    """The answer of `zerobeam.check` to a plan; it is a `Check`.

    `check["delta2"]` is a row with `.u`, the predicted standard uncertainty (None where the plan cannot
    determine the parameter), `.status` and `.unit`.

    Attributes
    ----------
    verdict : str
        "pass", "weak" or "degenerate", over all offsets; "violated" where a posture breaks a constraint of
        the plan.
    parameters, offsets : CheckedTable
        A row for each parameter, in their order; those of the joint offsets alone. `.to_frame()` makes a
        pandas DataFrame.
    worst : float or None
        The largest predicted u of an offset, degrees (mm).
    plot : PlanPlots
        `plot.scene()`, the postures in 3D.
    aimed : AimedPlan
        The plan with the wrist turned onto the target, as it was judged.

    Examples
    --------
    >>> import zerobeam as zb
    >>> header = {
    ...     "robot": "irb1600",
    ...     "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ... }
    >>> found = zb.optimal_plan(header, (900, 0, 0), candidates=300).check
    >>> found["delta2"].status, found["delta2"].u < 0.02
    ('identified', True)
    """

    @property
    def offsets(self) -> ShownPredictions:
        """The rows of the joint offsets."""
        rows = [row for row in self.parameters if row.group == "offset"]
        return ShownPredictions(rows).with_table(predicted_table(self, rows))

    def __getitem__(self, name: str) -> CheckedParameter:
        return self.parameters.named(name)

    def __contains__(self, name: object) -> bool:
        return name in self.parameters.names

    def __iter__(self) -> Iterator[CheckedParameter]:
        return iter(self.parameters)

    def to_frame(self) -> pd.DataFrame:
        """A pandas DataFrame of all parameters. BadInput without pandas."""
        return self.parameters.to_frame()

    @property
    def plot(self) -> PlanPlots:
        """Figures of this plan."""
        return PlanPlots(self)

    def app(self) -> AppView:
        """The app's page on this plan, in the notebook: its joints and target can be moved, and u follows.

        It is served by this process to this machine alone, until the process ends; the plan is written into
        a temporary folder.

        Raises
        ------
        BadInput
            The extra `app` is not installed.
        """
        return app_of(self.aimed.plan, "plan", partial(write_plan_beside, self.aimed.plan))

    def to_json(self) -> dict[str, Any]:
        """The answer of `zerobeam check --json` (docs/files-cell.md): plain dicts, lists, numbers, text."""
        answer: dict[str, Any] = to_json(self)
        return answer

    def _page(self) -> Page:
        content = message(self)
        return Page(
            f"Check of {clipped(self.inputs.plan, 60)}",
            f"{counted(len(self.postures), 'posture')}, {clipped(self.inputs.robot)}",
            Verdict(content.grade or "held", "", ""),
            check_lines(self),
            [],
            message=content,
            front=check_front(self),
        )


@dataclass(frozen=True)
class PlanPlots:
    """The figures of a check."""

    _check: CheckedPlan

    def __repr__(self) -> str:
        return "<PlanPlots: scene>"

    def scene(self) -> SceneView:
        """The arm in its postures and the targets, in 3D."""
        aimed = self._check.aimed
        return scene_view(aimed.plan.path.name, plan_turnable(aimed, postures_of(aimed)))


@dataclass(frozen=True, eq=False, repr=False)
class OptimalPlan(ByValue):
    """The best plan that was found. `best["J2"]` is a row of its check.

    Attributes
    ----------
    plan : Plan
        Its postures, in an order that shortens the travel.
    check : CheckedPlan
        What it will determine.
    made : MadePlan
        How it was found: `.proposal` has criterion, certified efficiency and travel time, `.removed` what
        removed candidate postures.

    Examples
    --------
    >>> import zerobeam as zb
    >>> header = {
    ...     "robot": "irb1600",
    ...     "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ... }
    >>> best = zb.optimal_plan(header, (900, 0, 0), candidates=300)
    >>> best.made.proposal.criterion, 0 < best.made.proposal.efficiency <= 1
    ('A', True)
    """

    plan: Plan
    check: CheckedPlan
    made: MadePlan = field(compare=False)

    @property
    def verdict(self) -> PlanVerdict:
        """That of `check`."""
        return self.check.verdict

    def __getitem__(self, name: str) -> CheckedParameter:
        return self.check[name]

    def __contains__(self, name: object) -> bool:
        return name in self.check

    def __iter__(self) -> Iterator[CheckedParameter]:
        return iter(self.check)

    def app(self) -> AppView:
        """The app's page on this plan, in the notebook, as `check.app()` shows it."""
        return self.check.app()

    def __repr__(self) -> str:
        return repr(self.check)

    def _repr_html_(self) -> str:
        return self.check._repr_html_()


def check(plan: Plan) -> CheckedPlan:
    """Judge a plan before any measurement, with the wrist turned onto the target as a servo will turn it.

    Parameters
    ----------
    plan
        From `read_plan`, `Plan.from_arrays` or `optimal_plan(…).plan`.

    Returns
    -------
    CheckedPlan
        Verdict, what each parameter will be known to, what is unidentifiable and what would help.

    Raises
    ------
    BadInput
        From none of the postures the target can be met.

    Examples
    --------
    >>> import zerobeam as zb
    >>> plan = zb.Plan.from_arrays(
    ...     robot="irb1600",
    ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     postures=[[0, 10 * k, 20 - 5 * k, 0, 50 - 5 * k, 0] for k in range(5)],
    ...     unit="deg",
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ...     target_priors={"psd": {"guess_mm": (900, 0, 0)}},
    ... )
    >>> zb.check(plan)["delta2"].status
    'unidentifiable'
    """
    require_plan(plan)
    aimed = aim_plan(plan)
    return CheckedPlan.of(aimed, violations(aimed), prospects=prospects(aimed))


def optimal_plan(
    header: Header | Mapping[str, Any] | Path | str,
    target: Sequence[float] | None = None,
    *,
    shots: int | None = None,
    repeat: int = USUAL_REPEATS,
    measure: Mapping[str, int] | None = None,
    candidates: int = 10_000,
    criterion: Literal["A", "D", "E"] = "A",
    tolerance: float | None = None,
    max_shots: int = 30,
    facing: Sequence[float] | None = (0.0, 0.0, 1.0),
    acceptance_deg: float = 60.0,
    beam_mm: Sequence[float] = (200.0, 2000.0),
    margin_deg: float = 5.0,
    obstacles: Path | str | None = None,
    seed: int = 0,
) -> OptimalPlan:
    """The best of many candidate postures, in an order that shortens the travel.

    Parameters
    ----------
    header
        What all measurements have in common: a mapping with the keys of a header file (`robot`, `tool`,
        `noise`, …; the last two as `Laser`, `Probe` and `Noise` if you like), or the path of such a file.
    target
        (3,) where the target is, base frame, mm; None: where the header says, or there is none.
    shots
        Number of measurements; None: 20, or 7 where the geometry is exact.
    repeat
        How many of them are made again at the end, in the same postures.
    measure
        The number of measurements by each of several instruments, by its name in the header.
    candidates
        Number of random postures to choose from.
    criterion
        What is minimised: "A" the mean, "D" the generalised, "E" the largest variance of the offsets.
    tolerance
        The fewest measurements, up to `max_shots`, whose predicted standard uncertainties are all within this
        (degrees; mm for prismatic joints), and that detect what some plan detects; `shots` is not read then.
    max_shots
        With `tolerance`: the largest number of measurements.
    facing
        (3,) outward normal of the target's face, base frame; None for a target that is hit from anywhere.
    acceptance_deg
        Largest angle between beam and that normal, degrees.
    beam_mm
        (2,) shortest and longest beam, mm.
    margin_deg
        Distance that is kept to every joint limit, degrees.
    obstacles
        An obstacles file (.yaml).
    seed
        Of all random numbers.

    Returns
    -------
    OptimalPlan
        `.plan` and `.check`.

    Raises
    ------
    BadInput
        Names the argument that cannot be used, or the constraint that leaves too few postures, or the
        tolerance that no number of measurements reaches.

    Examples
    --------
    >>> import zerobeam as zb
    >>> header = {
    ...     "robot": "irb1600",
    ...     "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ... }
    >>> best = zb.optimal_plan(header, (900, 0, 0), candidates=300)
    >>> best.plan
    <Plan optimal: 22 postures at psd, irb1600>
    >>> best.check.verdict
    'pass'
    """
    if tolerance is not None:
        require_number(tolerance, 0, "tolerance")
    options = checked_options(
        PlanOptions,
        target=None if target is None else vector(target, 3, "target"),
        shots=shots,
        repeat=repeat,
        measure={label: Portion(count) for label, count in (measure or {}).items()},
        candidates=candidates,
        criterion=criterion,
        tolerance=tolerance,
        max_shots=max_shots,
        facing=None if facing is None else vector(facing, 3, "facing"),
        acceptance_deg=acceptance_deg,
        beam_mm=vector(beam_mm, 2, "beam_mm"),
        margin_deg=margin_deg,
        obstacles=None if obstacles is None else Path(obstacles),
        seed=seed,
    )
    made = make_plan(PlanRequest.of("optimal", *_header(header), options), None, lambda stage, share: None)
    if made.plan is None:
        assert made.fewest is not None  # without a tolerance there is a plan
        most, worst = made.fewest.curve[-1].shots, made.fewest.curve[-1].worst_std
        raise BadInput(
            f"no plan of up to {max_shots} measurements reaches the tolerance",
            found=f"{numbers.spread(worst)} with {most} measurements; the limit is {made.fewest.limit}",
            remedy="allow more measurements or a larger tolerance, or lower the noise",
            argument="tolerance",
        )
    return OptimalPlan(made.plan, check(made.plan), made)


def _header(header: Header | Mapping[str, Any] | Path | str) -> tuple[Header, Path]:
    """The header, and the folder that its paths are relative to."""
    if isinstance(header, str) and header in built_in_robots():
        raise BadInput(
            "this is the name of a robot, and a plan requires a whole header",
            found=repr(header),
            allowed="a mapping with the keys of a header, or the path of a header file",
            remedy=f'{{"robot": "{header}", "tool": zerobeam.Laser(…), "noise": zerobeam.Noise(…)}}',
            argument="header",
        )
    if isinstance(header, Path | str):
        return read_header(Path(header)), Path(header).parent
    if isinstance(header, Header):
        return header, Path(".")
    if not isinstance(header, Mapping):
        raise BadInput(
            "this cannot be used",
            found=type(header).__name__,
            allowed="a mapping with the keys of a header, or the path of a header file",
            argument="header",
        )
    names = {str(key): f"header[{key!r}]" for key in (*Header.model_fields, *header)}
    return completed(checked(Header, plain(header), names), Path("."), line=lambda _: None), Path(".")


def simulate(
    plan: Plan, offsets: Mapping[str, float] | None = None, *, seed: int = 0, name: str = "simulated"
) -> Run:
    """Measurements of a plan as a simulated arm gives them, servoed onto the target and read with the noise
    that the plan states.

    Parameters
    ----------
    plan
        What is measured.
    offsets
        True values by name, such as {"J2": 0.3}, in degrees (mm for prismatic joints); other parameters, such
        as "tool.x", in their units. What is not named is nominal. None: random offsets of about 1 degree
        (1 mm), and random errors of an uncalibrated tool.
    seed
        Of the random numbers.
    name
        What reports call the run.

    Returns
    -------
    Run
        Its header's `provenance` states the true values.

    Raises
    ------
    BadInput
        There is no parameter of a name in `offsets`, or its value is not a finite number.
    RigFault
        From a posture the target cannot be met.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> good = zb.read_run(demo_runs()[0].path)
    >>> plan = zb.Plan.from_arrays(
    ...     robot="irb1600",
    ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     postures=good.joints,
    ...     unit="rad",
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ...     target_priors={"psd": {"guess_mm": (900, 0, 0)}},
    ... )
    >>> zb.simulate(plan, offsets={"delta2": 0.3}, seed=1)
    <Run simulated: 9 measurements of psd, irb1600>
    """
    require_plan(plan)
    require_number(seed, 0, "seed", whole=True)
    rng = np.random.default_rng(seed)
    if offsets is None:
        truth = Truth.drawn(plan, rng)
    else:
        require_mapping(offsets, "offsets", '{"J2": 0.3}: values in degrees (mm) by name')
        names, values = Truth.with_values(plan, {}).problem.parameters.names, {}
        for parameter, value in offsets.items():
            name_of_it = parameter_among(names, parameter, "offsets")
            require_number(value, -np.inf, f"offsets[{parameter!r}]")
            values[name_of_it] = value
        truth = Truth.with_values(plan, values)
    provenance = {**plan.header.provenance, "origin": SIMULATED, **truth.provenance()}
    header = plan.header.model_copy(update={"schema_": RUN_SCHEMA, "provenance": provenance})
    return Run.of_shots(header, plan.robot, list(simulated_shots(truth, rng)), name)
