"""Values to enter: what a controller takes is not what the arm is.

A controller with nominal geometry takes offsets alone. Those that serve it best also make up for links that
deviate and joints that bend, as far as offsets can: they minimise the expected squared error over the
workspace under the posterior of the whole model,

    E |T(q; theta) - N(q; c)|^2 = |T(q; E theta) - N(q; c)|^2 + tr(J C J'),

with T the arm, N the nominal one with the offsets c entered, and J C J' the covariance of T, to first order
(JCGM 102). The last term does not depend on c: what is entered is the least-squares fit of N to the mean arm.

The region is that of the header (`tcp_region`). The points, of equal weight, are the flange's origin, the TCP
(the tool's stated point) and four points 100 mm beside the TCP: without these the wrist would be turned to
make up for lengths, and a longer tool would be worse off. Of a region that is a box or a file's postures the
central ranges take part with a tenth of its weight: what few postures do not settle would be anything
elsewhere, and the robot passes there. The error that is stated is that of the TCP, over the region.

What offsets cannot make up for is the floor: were the values known exactly, those of each arm of the
posterior would be entered, c(theta) = c(E theta) + A (theta - E theta), and T(q; theta) - N(q; c(theta))
left.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import StatedRequirement
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..solution import Solution
from ..status import Status, known
from ..tcp_region import (
    FITTED,
    arm_covariance,
    arms_at_random,
    default_point,
    fitted_points,
    judged_axis,
    moving_by_nominal,
    normal_inverse,
    region_postures,
    tool_point,
    undetermined_offsets,
    unmeasured_link,
)

_POSTURES = 256  # of the region
_STEPS = 2  # Gauss-Newton from the estimates: what is left is below a micrometre
MOST_WORSE = 0.05  # probability of a less accurate robot with which values are entered without a word
_CONFORMS = 0.95  # JCGM 106, 8.3.3: the guard band of a 5 % risk

TakenGeometry = Literal["nominal", "geometry"]


@dataclass(frozen=True)
class TcpError:
    """The error of the TCP over the region, mm: the median and the length that 95 % stay below, over postures
    and the posterior together; `median_band_mm` holds the median of this arm with 95 %."""

    median_mm: float
    p95_mm: float
    median_band_mm: tuple[float, float]


@record
class Entered:
    """What to enter into a controller, by name. One with nominal geometry takes the offsets; one that takes
    the geometry the whole estimated arm, but for what depends on the posture. Errors of the TCP are None
    where it depends on an offset that the data do not determine."""

    of: Annotated[
        TakenGeometry,
        it(
            "the geometry that takes the values: that of a controller, or that of a file with links",
            name="for",
        ),
    ]
    values: Annotated[
        dict[str, float],
        it(
            "by offset, degrees or millimetres: the least expected squared error of flange and TCP over"
            " the region; the estimates for `geometry`, and of an arm that is taken as exact"
        ),
    ]
    u: Annotated[
        dict[str, float],
        it(
            "the standard uncertainty of each: how far it may be from the value that would serve this"
            " arm best"
        ),
    ]
    tcp_before: Annotated[
        TcpError | None,
        it(
            "`median_mm` and `p95_mm` of the TCP's error over postures and posterior with nothing "
            "entered, and `median_band_mm`, 95 % of this arm's median; null where the TCP depends on "
            "an offset that is not determined"
        ),
    ]
    tcp_after: Annotated[TcpError | None, it("the same with the values entered")]
    tcp_best: Annotated[
        TcpError | None,
        it(
            "the same if the values that serve this arm best were known exactly: offsets alone cannot do"
            " better; null for `geometry`, and of an arm that is taken as exact"
        ),
    ] = None
    worse: Annotated[
        float | None,
        it(
            "the probability that the TCP's error, root mean square, is larger with them than with "
            "nothing entered; above 0.05 it is a caution"
        ),
    ] = None
    status: Annotated[
        dict[str, Status],
        it(
            "of each value, by the rule of the offsets: `weak` where `u` exceeds the tolerance, though the"
            " offset itself may be identified; empty in results of earlier versions"
        ),
    ] = field(default_factory=dict)

    @property
    def as_offsets(self) -> bool:
        """Whether they are the offsets themselves, so that one U is of both."""
        return self.tcp_best is None

    @property
    def doubtful(self) -> bool:
        """Whether entering them may well make the robot less accurate than it is."""
        return self.worse is not None and self.worse > MOST_WORSE


class ValueToEnter(NamedTuple):
    """A value to enter, deg (mm), its own standard uncertainty `u`, and its status by that."""

    value: float
    u: float
    status: Status


@dataclass(frozen=True)
class Conformity:
    """Does the robot meet what it must (JCGM 106)? `tcp_95_mm` is the error that 95 % of the region stays
    below once the values are entered, the middle of its posterior; `probability` that it is within
    `required_mm`. It conforms from 95 % on, and does not below 5 %: between, measurements do not decide."""

    required_mm: float
    tcp_95_mm: float
    probability: float
    decision: Literal["conforms", "does not conform", "undecided"]
    rule: str = "conforms where the probability is 95 % or more, does not where it is 5 % or less (JCGM 106)"


def values_to_enter(solution: Solution, left_out: Collection[str] = ()) -> dict[str, float]:
    """The values of `offsets_to_enter`."""
    return {name: each.value for name, each in offsets_to_enter(solution, left_out).items()}


def offsets_to_enter(
    solution: Solution, left_out: Collection[str] = (), *, assumed: bool = False
) -> dict[str, ValueToEnter]:
    """What to enter into a controller with nominal geometry, deg (mm) by name: of each offset that is
    determined, but for those `left_out`, which neither the arm nor the controller then has. What is as good
    as what is assumed is among them only if that is asked for. Export, next steps, report and verification
    use these; of an exact arm they are the estimates."""
    fitted = _Fitted(solution, left_out, assumed=assumed)
    values, u = fitted.shown(fitted.offsets), fitted.shown(fitted.std)
    status = _statuses(solution, u)
    return {name: ValueToEnter(value, u[name], status[name]) for name, value in values.items()}


def entered(
    solution: Solution, required: StatedRequirement | None = None
) -> tuple[Entered | None, Entered | None, Conformity | None]:
    """The values for nominal geometry and for a controller that takes the geometry (None of an exact arm),
    and whether the robot with the first meets what is required.

    All None where an offset is not determined, or the model does not describe the measurements: nothing can
    be promised then. The last of them, too, where the errors are not of the TCP (`judged_axis`).
    """
    if solution.verdict in ("misfit", "degenerate"):
        return None, None, None
    fitted = _Fitted(solution)
    if not fitted.names:
        return None, None, None
    values, u = fitted.shown(fitted.offsets), fitted.shown(fitted.std)
    whole = _whole_values(solution)
    spread = TcpSpread(solution)
    if spread.undetermined:
        nominal = Entered("nominal", values, u, None, None, status=_statuses(solution, u))
        return nominal, whole and Entered("geometry", *whole, None, None), None
    problem = solution.problem
    as_it_is = spread.errors(np.zeros(problem.parameters.arm.stop))
    before = _tcp_error(as_it_is)
    after = spread.errors(controller_arm(problem, values))
    with_links = None
    if whole is not None:
        errors = spread.errors(held_by_a_robot(problem, solution.fit.x))
        worse = _share_worse(errors, as_it_is)
        with_links = Entered("geometry", *whole, before, _tcp_error(errors), worse=worse)
    best = None if fitted.by_mean is None else _tcp_error(spread.errors_at_best(fitted))
    worse, status = _share_worse(after, as_it_is), _statuses(solution, u)
    nominal = Entered("nominal", values, u, before, _tcp_error(after), best, worse, status)
    if required is None or judged_axis(problem, solution.status) is not None:
        return nominal, with_links, None
    return nominal, with_links, _conformity(after, required.tcp_mm)


def _statuses(solution: Solution, u: Mapping[str, float]) -> dict[str, Status]:
    """Of values to enter with these u, deg (mm): each is as well known as its own u says."""
    tolerance = solution.offset_tolerance
    return {name: "identified" if u[name] <= tolerance[name] else "weak" for name in u}


def conforms(conformity: Conformity | None) -> bool:
    """Whether what is required is met; of a robot of which nothing is required, too."""
    return conformity is None or conformity.decision == "conforms"


def judged(solution: Solution, required: StatedRequirement) -> Conformity | None:
    """Whether the robot with the values meets what is required; None where nothing can be promised."""
    return entered(solution, required)[2]


def controller_arm(problem: Problem, values: Mapping[str, float]) -> Matrix:
    """(a,) rad or mm: nominal geometry with these offsets, deg (mm) by name."""
    arm = np.zeros(problem.parameters.arm.stop)
    for name, value in values.items():
        i = problem.parameters.index(name)
        arm[i] = value / problem.parameters.items[i].display
    return arm


def held_by_a_robot(problem: Problem, x: Matrix) -> Matrix:
    """(a,) offsets and geometry of x (p,), rad or mm, but for what depends on the posture (gravity,
    harmonics): what a robot file can hold."""
    items = problem.parameters.items[problem.parameters.arm]
    held = [item.group == "offset" or item.name.startswith("link") for item in items]
    return np.where(held, x[problem.parameters.arm], 0.0)


class _Fitted:
    """The least-squares fit of nominal geometry to the mean arm, over the region: `names` of the offsets,
    `offsets` (k,) rad or mm, their `std` (k,); `arm` (a,) with them entered, and `by_mean` (a, a) by how much
    it changes with the arm's parameters, None of an exact arm."""

    by_mean: Matrix | None = None

    def __init__(self, solution: Solution, left_out: Collection[str] = (), *, assumed: bool = False) -> None:
        problem = self.problem = solution.problem
        parameters = problem.parameters
        block = parameters.block("offset")
        places = [
            i
            for i in range(block.start, block.stop)
            if (known(solution.status[i]) or (assumed and solution.status[i] == "assumed"))
            and parameters.names[i] not in left_out
        ]
        self.names = [parameters.names[i] for i in places]
        x = solution.fit.x.copy()
        out = [i for i in range(block.start, block.stop) if i not in places]
        x[out] = parameters.prior_mean[out]
        std = np.sqrt(np.diag(arm_covariance(problem, solution.fit.covariance)))
        self.offsets, self.std = x[places], std[places]
        # That of joint 1 is a choice of frame: it moves nothing.
        fitted = [k for k, i in enumerate(places) if i > block.start]
        if problem.geometry and fitted:
            self._fit(solution, x, [places[k] for k in fitted], fitted, out)

    def _fit(self, solution: Solution, x: Matrix, places: list[int], at: list[int], out: list[int]) -> None:
        problem = self.problem
        tcp, _ = default_point(problem, solution.status)
        points, joints, roots = fitted_points(problem, tcp, FITTED)
        position, by_arm = tool_point(problem, x, points, joints)
        arm = np.zeros(problem.parameters.arm.stop)
        arm[places] = x[places]
        inverse: Matrix = np.zeros((0, 0))
        columns: Matrix = np.zeros((0, 0))
        for _ in range(_STEPS):
            entered_at, jacobian = problem.functions.kernel("placed")(joints, arm, points)
            columns = (jacobian[:, :, places] * roots[:, None, None]).reshape(-1, len(places))
            inverse = normal_inverse(columns)
            left = (position - entered_at) * roots[:, None]
            arm[places] += inverse @ (columns.T @ left.reshape(-1))
        self.arm, self.offsets[at] = arm, arm[places]
        by_arm = (by_arm * roots[:, None, None]).reshape(-1, len(arm))
        # A shift of the flange that was not measured is none to make up for by a joint.
        by_arm[:, [*out, *np.flatnonzero(unmeasured_link(problem))]] = 0.0
        by_mean = inverse @ (columns.T @ by_arm)
        # What moves no point stays as estimated, and as uncertain.
        by_mean[:, places] += np.eye(len(places)) - inverse @ (columns.T @ columns)
        covariance = arm_covariance(problem, solution.fit.covariance)
        self.std[at] = np.sqrt(np.einsum("ka,ab,kb->k", by_mean, covariance, by_mean))
        self.by_mean = np.zeros((len(arm), len(arm)))
        self.by_mean[places] = by_mean

    def shown(self, values: Matrix) -> dict[str, float]:
        """deg (mm) by name."""
        items = self.problem.parameters.items
        index = self.problem.parameters.index
        return {
            name: float(value) * items[index(name)].display
            for name, value in zip(self.names, values, strict=True)
        }


class TcpSpread:
    """The TCP of the arm as the posterior has it, over the region: `position` (P, 3) mm at the mean, and
    `jacobian` (P, 3, a) by the arm's parameters, at `joints` (P, n)."""

    def __init__(self, solution: Solution) -> None:
        self.solution, self.problem = solution, solution.problem
        self.joints = region_postures(self.problem, _POSTURES)
        self.point, _ = default_point(self.problem, solution.status)
        self.position, self.jacobian = tool_point(self.problem, solution.fit.x, self.point, self.joints)

    @property
    def undetermined(self) -> bool:
        """Whether an offset that the measurements do not determine moves the TCP."""
        moving = moving_by_nominal(self.problem, self.point, self.joints)
        return bool((moving & undetermined_offsets(self.problem, self.solution.status)).any())

    def placed(self, arm: Matrix) -> Matrix:
        """(P, 3) mm where a controller with `arm` (a,) in its model has the TCP."""
        arm = arm.copy()
        arm[0] = 0.0
        (position,) = self.problem.functions.kernel("place")(self.joints, arm, self.point)
        return np.asarray(position)

    @cached_property
    def drawn(self) -> Matrix:
        """(draws, a) by which arms at random from the posterior are off the mean arm, rad or mm."""
        problem, solution = self.problem, self.solution
        dof = solution.dof if problem.noise.estimated and solution.dof else None
        return arms_at_random(arm_covariance(problem, solution.fit.covariance), dof)

    @cached_property
    def spread(self) -> Matrix:
        """(3, draws, P) mm by which the TCPs of those arms are off that of the mean arm."""
        return self._moved(self.jacobian)

    def errors(self, arm: Matrix, spread: Matrix | None = None) -> Matrix:
        """(draws, P) mm: of those arms, with a controller that has `arm` (a,) in its model; `spread` (3,
        draws, P) takes the place of theirs."""
        apart = self.position - self.placed(arm)
        # Axis by axis: a norm over the first of three axes takes several times as long.
        squares = np.zeros((len(self.drawn), len(apart)))
        for spread_along, off in zip(self.spread if spread is None else spread, apart.T, strict=True):
            along = spread_along + off
            squares += along * along
        return np.asarray(np.sqrt(squares))

    def errors_at_best(self, fitted: _Fitted) -> Matrix:
        """(draws, P) mm: of those arms, each with the values entered that serve it best."""
        assert fitted.by_mean is not None
        _, by_entered = self.problem.functions.kernel("placed")(self.joints, fitted.arm, self.point)
        by_arm = self.jacobian - by_entered[:, :, : len(fitted.arm)] @ fitted.by_mean
        return self.errors(fitted.arm, self._moved(by_arm))

    def _moved(self, jacobian: Matrix) -> Matrix:
        return np.array([self.drawn @ jacobian[:, k].T for k in range(3)])


def _whole_values(solution: Solution) -> tuple[dict[str, float], dict[str, float]] | None:
    """Estimates and standard uncertainties of what is determined and a robot can hold; None of an exact
    arm."""
    if not solution.problem.geometry:
        return None
    rows = [
        row
        for row in solution.parameters
        if known(row.status) and (row.group == "offset" or row.name.startswith("link"))
    ]
    return {row.name: row.estimate or 0.0 for row in rows}, {row.name: row.std or 0.0 for row in rows}


def _tcp_error(errors: Matrix) -> TcpError:
    low, high = np.quantile(np.median(errors, axis=1), [0.025, 0.975])
    median, p95 = np.quantile(errors, [0.5, 0.95])
    return TcpError(float(median), float(p95), (float(low), float(high)))


def _share_worse(after: Matrix, before: Matrix) -> float:
    """The share of the drawn arms whose errors (draws, P), root mean square, are larger after than before."""
    return float(((after**2).mean(axis=1) > (before**2).mean(axis=1)).mean())


def _conformity(errors: Matrix, required_mm: float) -> Conformity:
    """By the error that 95 % of the region stays below, of each drawn arm."""
    p95 = np.quantile(errors, 0.95, axis=1)
    probability = float((p95 <= required_mm).mean())
    decision: Literal["conforms", "does not conform", "undecided"] = "undecided"
    if probability >= _CONFORMS:
        decision = "conforms"
    elif probability <= 1 - _CONFORMS:
        decision = "does not conform"
    return Conformity(required_mm, float(np.median(p95)), probability, decision)
