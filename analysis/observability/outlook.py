"""What would make an answer better: remedies, each with the uncertainties and the TCP error that it is
predicted to give.

All is predicted by the information of the measurements, without a fit: of a plan for arms within the stated
tolerances, of a run for the arm as its measurements have it. A new run stands for itself: the measurements of
the first are not counted with it.

Positions of a point of the flange, by a laser tracker or another instrument in the cell that reads three
coordinates, are measured in postures that are measured anyway. Nobody knows where the instrument stands, nor
where on the flange its reflector is: nine unknowns without a prior, so that of the twelve numbers of four
positions three say something of the arm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from math import comb
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.files.header import Header
from ...model.files.plan import USUAL, StatedConstraints
from ...model.instruments.kind import ON_FLANGE, Assumption
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ...model.options import USUAL_REPEATS
from ...model.records import it, key, record
from ..status import Status, known
from ..tcp_region import TcpRegion, beside_first_axis, judged_axis, region_of
from .better_postures import PostureSearch
from .changes import repeated
from .predictions import ArmBelief, EstimatesOfArms, TcpForecast, roots_with_ties
from .remedies import Allowed

POINTS = 4
SIGMA_MM = 0.03  # of a coordinate, as of a laser tracker at 3 m
_UNKNOWN = 9  # place (3) and rotation (3) of the instrument, place of the reflector on the flange (3)
_SETS = 3000  # of postures that are tried


class FlangePoints(NamedTuple):
    """`rows` (k,) of the shots in whose postures the positions are measured; `roots` (r, f) of their
    information on the scaled free parameters."""

    rows: Index
    roots: Matrix


def best_points(
    problem: Problem, x: Matrix, covariance: Matrix, counted: Index, among: Index, weight: float
) -> FlangePoints | None:
    """Four of the postures `among` (M,) those of the problem at x (p,), by which the variances of the
    parameters `counted`, scaled by their priors, become smallest beside measurements with this `covariance`
    (f, f); `weight` is 1 / noise scale². None of fewer postures."""
    if len(among) < POINTS:
        return None
    by_arm, by_rest = _whitened(problem, x, problem.joints[among], weight)
    sets = _sets(len(among))
    # What is left of the rows where the unknowns are eliminated.
    whole, _ = np.linalg.qr(by_rest[sets].reshape(len(sets), 3 * POINTS, _UNKNOWN), mode="complete")
    roots = whole[:, :, _UNKNOWN:].transpose(0, 2, 1) @ by_arm[sets].reshape(len(sets), 3 * POINTS, -1)
    gained = roots @ covariance
    inner = gained @ roots.transpose(0, 2, 1) + np.eye(roots.shape[1])
    less = gained[:, :, counted]
    gain = np.trace(np.linalg.solve(inner, less @ less.transpose(0, 2, 1)), axis1=1, axis2=2)
    best = int(np.argmax(gain))
    return FlangePoints(among[sets[best]], roots[best])


def _sets(count: int) -> Index:
    """(S, 4) sets of so many postures: all of them, or some at random."""
    if comb(count, POINTS) <= _SETS:
        return np.array(list(combinations(range(count), POINTS)))
    drawn = np.random.default_rng(0).random((_SETS, count))
    return np.asarray(np.sort(np.argsort(drawn, axis=1)[:, :POINTS], axis=1))


def _whitened(problem: Problem, x: Matrix, joints: Matrix, weight: float) -> tuple[Matrix, Matrix]:
    """(P, 3, f) positions at recorded `joints` (P, n) by the scaled free parameters, and (P, 3, 9) by the
    unknowns of instrument and reflector (metres and radians, about the middle), over the noise."""
    parameters = problem.parameters
    arm, free = parameters.arm, parameters.free[parameters.arm]
    position, jacobian = problem.functions.kernel("placed")(joints, x[arm], np.array(ON_FLANGE))
    by_joints = jacobian[:, :, parameters.block("offset")]  # an offset counts as the joint does
    noise = (by_joints * problem.noise.joint**2 / weight) @ by_joints.transpose(0, 2, 1)
    whitening = np.linalg.inv(np.linalg.cholesky(noise + SIGMA_MM**2 * np.eye(3)))
    by_arm = np.zeros((len(joints), 3, int(parameters.free.sum())))
    scaled = jacobian[:, :, : arm.stop] * parameters.prior_std[arm]
    by_arm[:, :, : int(free.sum())] = scaled[:, :, free]
    from_middle = (position - position.mean(axis=0)) / 1000
    turned = np.stack([np.cross(axis, from_middle) for axis in np.eye(3)], axis=2)
    shifted = np.broadcast_to(np.eye(3), turned.shape)
    by_rest = np.concatenate([shifted, turned, jacobian[:, :, arm.stop :]], axis=2)
    return whitening @ by_arm, whitening @ by_rest


COVERAGE = 2.0  # k of every U here
NUMBERS = (12, 20)  # of measurements that are proposed
_MOST = 40  # measurements: with more, other postures change little
_DETERMINED = 0.5  # of its prior: an offset of which the measurements alone leave more is not determined
_NOTHING = 1e-6  # of a prior's information
_NEXT = 3  # postures that are proposed one by one
_CLOSER = 5.0  # times: what is measured of a mounting next to what is assumed
WORTH = 0.1  # a relative gain from which a remedy is worth a row
MOUNTING_MIN = 15.0  # minutes to measure the mounting of an instrument
_LAST: dict[str, int] = {"mounting": 1, "points": 2}  # what takes more than the instruments that are there
POINTS_MIN = 20.0  # minutes to set up a laser tracker, and to measure some positions

Remedy = Literal["none", "postures", "more", "repeat", "points", "mounting", "links"]


@record
class OutlookRow:
    """One remedy, or the answer as it is ("none")."""

    remedy: Annotated[
        Remedy,
        it(
            "`none`: the answer as it is; `postures`: better ones, as many; `more`: more measurements, in the"
            " best postures; `repeat`: the first postures again at the end; `points`: a point of the flange"
            " measured in four of the postures too, as by a laser tracker; `mounting`: that of the instrument"
            " is measured; `links`: the links are entered as well, where the controller takes them"
        ),
    ]
    shots: Annotated[
        int, it("how many different measurements there are then; a new plan has its first two again besides")
    ]
    U: Annotated[
        dict[str, float | None],
        it(
            "by offset that measurements can improve (of `mounting` also those that rest on it), the expanded"
            " uncertainty, k = 2, degrees or millimetres; null where it is not determined"
        ),
    ]
    tcp_median_mm: Annotated[
        float | None,
        it(
            "error of the TCP with the values entered, over `region`; null where it depends on"
            " an offset that is not determined"
        ),
    ]
    tcp_95_mm: Annotated[float | None, it("the same, which 95 % of region and arms stay below")]
    links_median_mm: Annotated[
        float | None, it("`tcp_median_mm` where the links are entered as well; null of an exact arm")
    ]
    links_95_mm: Annotated[float | None, it("`tcp_95_mm` likewise")]
    minutes: Annotated[float, it("of measuring")]
    gain: Annotated[
        float,
        it(
            "by which share the largest U or `tcp_95_mm` becomes smaller, whichever more; of `mounting` the"
            " largest U of those that rest on it"
        ),
    ]
    options: Annotated[
        tuple[str, ...], it("of the `zerobeam plan optimal` that makes the plan; empty where there is none")
    ] = ()
    state: Annotated[
        dict[str, float], it("keys of the header to be measured and stated, with the uncertainty to reach")
    ] = field(default_factory=dict)
    postures: Annotated[
        tuple[int, ...], it("of `points`: numbers of the measurements in whose postures they are")
    ] = ()


@record
class NextPosture:
    """A posture by which one more measurement gains most, beside those before it."""

    target: Annotated[str, it("what is measured")]
    joints: Annotated[tuple[float, ...], it("degrees, or millimetres of a prismatic joint, aimed")]
    tcp_mm: Annotated[tuple[float, float, float], it("where the TCP is there, base frame, millimetres")]
    beside_axis_mm: Annotated[
        tuple[float, float], it("its distance from axis 1 and its height along it, as in `maps`, millimetres")
    ]
    u_mm: Annotated[float, it("the standard uncertainty of the TCP then, root mean square over `region`")]


@record
class Outlook:
    """Remedies by their predicted gain."""

    now: Annotated[OutlookRow, it("the answer as it is")]
    remedies: Annotated[
        tuple[OutlookRow, ...],
        it("the largest gain first; last the mounting, then what takes another instrument"),
    ]
    region: Annotated[TcpRegion, it("over which the error of the TCP is predicted, as in a result")]
    minutes_each: Annotated[float, it("of a measurement")]
    measured: Annotated[
        bool,
        it("whether the run says so; else it is assumed, as of a person with this kind of instrument"),
    ]
    required_mm: Annotated[float | None, it("`required.tcp_mm` of the header")] = None

    enough: Annotated[
        dict[str, float], it("by offset, the U up to which it counts as identified, degrees or millimetres")
    ] = field(default_factory=dict)

    u_mm: Annotated[
        float | None,
        it(
            "the standard uncertainty of the TCP now, root mean square over `region`; null without a TCP"
            " error"
        ),
    ] = None
    next_postures: Annotated[
        tuple[NextPosture, ...], it("of a run: where one more measurement helps the TCP most, in this order")
    ] = ()

    @property
    @key(
        "whether a remedy, or the answer as it is, meets what is required; null where nothing is, or no"
        " TCP error is predicted, or that of a point of the last axis"
    )
    def reachable(self) -> bool | None:
        """By the error that 95 % stay below, with the links entered or without."""
        errors = [each for row in (self.now, *self.remedies) for each in (row.tcp_95_mm, row.links_95_mm)]
        known_errors = [error for error in errors if error is not None]
        if self.required_mm is None or self.region.on_axis is not None or not known_errors:
            return None
        return min(known_errors) <= self.required_mm

    @property
    def falls_short(self) -> bool:
        """Whether the answer as it is does not meet what is required, as predicted, or that cannot be said
        of the TCP."""
        now = self.now.tcp_95_mm
        if self.required_mm is None or now is None:
            return False
        return self.region.on_axis is not None or now > self.required_mm

    @property
    def by_postures(self) -> tuple[OutlookRow, ...]:
        """The remedies that are other postures, the fewest measurements first."""
        rows = (row for row in self.remedies if row.remedy in ("postures", "more"))
        return tuple(sorted(rows, key=lambda row: row.shots))

    @property
    def worth(self) -> tuple[OutlookRow, ...]:
        """The remedies that gain something."""
        return tuple(row for row in self.remedies if row.gain >= WORTH)


MedianAnd95 = tuple[float, float]


class Prospects(NamedTuple):
    """What new postures are: they keep the `constraints`, and are `allowed`."""

    constraints: StatedConstraints
    allowed: Allowed


@dataclass(eq=False, kw_only=True)
class Prospect:
    """What remedies are looked for: the aimed measurements of a `problem` at x (p,), parameters of this
    `status` (p,) with the `covariance` (f, f) of the scaled free ones; `rests_on` by the name of an offset
    what it rests on besides the measurements.

    `estimated`: x are the estimates of a run. New postures are such as the `prospects` say. `weight` is
    1 / noise scale², `dof` the degrees of freedom by which that is estimated. `tcp` and `tcp_with_links` are
    the errors of the TCP, mm, that a run's answer states with its values entered: the answer as it is has
    them too. Predicted in one thread of linear algebra (`one_blas_thread`), which callers see to.
    """

    header: Header
    problem: Problem
    x: Matrix
    status: Sequence[Status]
    rests_on: Mapping[str, tuple[Assumption, ...]]
    covariance: Matrix
    estimated: bool
    prospects: Prospects
    weight: float = 1.0
    dof: float | None = None
    minutes_each: float | None = None
    tcp: MedianAnd95 | None = None
    tcp_with_links: MedianAnd95 | None = None

    def __post_init__(self) -> None:
        items = [item for item in self.problem.parameters.items if not item.held]
        self.items: list[Parameter] = items  # the f free parameters
        self.shown = np.array([item.prior_std * item.display for item in items])
        self.offsets = np.flatnonzero([item.group == "offset" for item in items])
        rests_on = [self.rests_on.get(item.name, ()) for item in items]
        self.resting = np.flatnonzero([bool(some) for some in rests_on])
        # What is exact has no parameters to be judged without: what rests on it does so in any postures.
        self.never = np.flatnonzero([any(one.std is None for one in some) for some in rests_on])
        known_now = np.array([known(status) for status in self.status], dtype=np.bool_)
        self.known_now: Mask = known_now[self.problem.parameters.free]
        by_hand = float(np.mean([kind.minutes for kind in self.header.kinds.values()]))
        self.count = self.problem.shots - len(repeated(self.problem))
        self.each = by_hand if self.minutes_each is None else self.minutes_each
        self.forecast = TcpForecast(self.problem, self.x, self.status)
        mean, covariance = np.zeros(len(items)), np.eye(len(items))
        if self.estimated:
            parameters = self.problem.parameters
            mean = ((self.x - parameters.prior_mean) / parameters.prior_std)[parameters.free]
            covariance = self.covariance
        self.belief = ArmBelief(self.problem, mean, covariance, self.dof if self.estimated else None)

    @cached_property
    def roots(self) -> Matrix:
        """(N, d, f) of the measurements as they are."""
        whitened = self.problem.whiten(self.x)
        return np.asarray(np.sqrt(self.weight) * roots_with_ties(self.problem, whitened))

    def outlook(self) -> Outlook | None:
        """The remedies; None where no offset is estimated."""
        if not len(self.offsets):
            return None
        now = self.now
        rows = [*self.by_postures(), *self.by_repeating(), *self.by_points()]
        rows += [*self.by_mounting(), *self.by_links()]
        rows = [row for row in rows if row.gain > 0]
        rows.sort(key=lambda row: (_LAST.get(row.remedy, 0), -round(row.gain, 2), row.minutes))
        required = self.header.required
        u_mm = None
        if now.tcp_95_mm is not None:
            square = np.trace(self.covariance @ self.forecast.mean_square)
            u_mm = float(np.sqrt(square + self.forecast.unmeasured_square))
        return Outlook(
            now=now,
            remedies=tuple(rows),
            region=region_of(self.problem.workspace, judged_axis(self.problem, self.status)),
            minutes_each=self.each,
            measured=self.minutes_each is not None,
            required_mm=None if required is None else required.tcp_mm,
            enough={
                item.name: COVERAGE * item.tolerance * item.display
                for item in self.items
                if item.group == "offset"
            },
            u_mm=u_mm,
            next_postures=tuple(self.next_postures()),
        )

    def next_postures(self) -> Iterator[NextPosture]:
        """Of a run whose TCP error is known."""
        search = self.search
        if search is None or not self.estimated or self.now.tcp_95_mm is None:
            return
        pool, display = search.pool, self.problem.robot.display
        for which, square in search.next_best(self.covariance, self.forecast.mean_square, _NEXT):
            joints = pool.joints[which]
            at_posture = self.forecast.places(joints[None])
            (at,) = at_posture.round(1).tolist()
            ((away, up),) = beside_first_axis(self.problem.robot, at_posture).round(1).tolist()
            yield NextPosture(
                target=self.problem.targets[self.problem.target_index[pool.like[which]]],
                joints=tuple((joints * display).round(3).tolist()),
                tcp_mm=(at[0], at[1], at[2]),
                beside_axis_mm=(away, up),
                u_mm=float(np.sqrt(square + self.forecast.unmeasured_square)),
            )

    @cached_property
    def search(self) -> PostureSearch | None:
        """Of new postures; None of several instruments, whose numbers are for people to divide, and of many
        measurements."""
        if len(self.header.labels) > 1 or self.count > _MOST:
            return None
        return PostureSearch(self.problem, self.x, self.header.targets, self.prospects.allowed, self.weight)

    @cached_property
    def better(self) -> dict[int, Matrix]:
        """By number of measurements the roots (N, d, f) of the best postures."""
        search, count = self.search, self.count
        if search is None:
            return {}
        counts = [max(count, 2), *(each for each in NUMBERS if each > count)]
        best = search.best(counts)
        return {shots: _with_repeats(chosen.roots) for shots, chosen in best.items()}

    @cached_property
    def improvable(self) -> Index:
        """The offsets that do not rest on tool and frames, at least in other postures; nor would there, where
        these measurements do not determine them."""
        rest = set(self.resting.tolist())
        for roots in self.better.values():
            rest |= set(np.flatnonzero(self._determined(roots, assumed=True) & ~self.known_now).tolist())
        for roots in self.better.values():
            rest -= set(np.flatnonzero(self._determined(roots)).tolist())
        return np.array([k for k in self.offsets.tolist() if k not in rest], dtype=np.int64)

    @cached_property
    def now(self) -> OutlookRow:
        covariance = self.covariance
        if self.estimated:
            estimates = EstimatesOfArms.made(self.belief)
        else:
            estimates = EstimatesOfArms.of_new_run(self.belief, covariance, self.roots)
        row = self._row("none", self.count, covariance, estimates, self.known_now, 0.0)
        if row.tcp_95_mm is not None and self.tcp is not None:
            row = replace(row, tcp_median_mm=self.tcp[0], tcp_95_mm=self.tcp[1])
        if row.links_95_mm is not None and self.tcp_with_links is not None:
            row = replace(row, links_median_mm=self.tcp_with_links[0], links_95_mm=self.tcp_with_links[1])
        return row

    def by_postures(self) -> Iterator[OutlookRow]:
        """As many measurements, and more, in the best postures."""
        for shots, roots in self.better.items():
            remedy: Remedy = "postures" if shots == self.count else "more"
            options = ("--shots", str(shots), *constraint_options(self.prospects.constraints))
            yield self._of_new_run(remedy, shots, roots, options)

    def by_repeating(self) -> Iterator[OutlookRow]:
        """The first postures again at the end. What they do not determine, they do not determine again."""
        if self.count == self.problem.shots <= _MOST:
            again = _with_repeats(self.roots)
            yield self._of_new_run("repeat", self.count, again, (), may_be=self.known_now)

    def by_points(self) -> Iterator[OutlookRow]:
        """A point of the flange is measured in some of the postures as well; they are driven to once more."""
        again = repeated(self.problem)
        if not self.header.only_tools or self.count > _MOST:
            return
        among = np.setdiff1d(np.arange(self.problem.shots), list(again))
        points = best_points(self.problem, self.x, self.covariance, self.improvable, among, self.weight)
        if points is None:
            return
        information = np.linalg.inv(self.covariance) + points.roots.T @ points.roots
        covariance: Matrix = np.asarray(np.linalg.inv(information), dtype=float)
        every = np.concatenate([self.roots.reshape(-1, len(covariance)), points.roots])
        estimates = EstimatesOfArms.of_more(
            self.belief, covariance, points.roots if self.estimated else every
        )
        determined = self.known_now | self._determined(every[:, None])
        row = self._row("points", self.count, covariance, estimates, determined, POINTS_MIN)
        yield replace(row, postures=tuple(self.problem.shot_numbers[k] for k in points.rows.tolist()))

    def by_mounting(self) -> Iterator[OutlookRow]:
        """What is assumed of the instruments is measured and stated."""
        assumed = {one for some in self.rests_on.values() for one in some if not one.stated and one.std}
        if not assumed:
            return
        parts = {(one.of, one.unit) for one in assumed}
        at = [k for k, item in enumerate(self.items) if item.assumed and (item.of, item.unit) in parts]
        added = np.zeros(len(self.items))
        added[at] = _CLOSER**2 - 1
        covariance = np.linalg.inv(np.linalg.inv(self.covariance) + np.diag(added))
        now, resting = self.now, np.isin(np.arange(len(added)), self.resting)
        largest, before = (self._largest(each, self.resting) for each in (covariance, self.covariance))
        yield replace(
            now,
            remedy="mounting",
            U=self._expanded(covariance, self.known_now | resting, [*self.improvable, *self.resting]),
            minutes=MOUNTING_MIN,
            gain=self._gain(largest, before),
            state={one.key: float(f"{(one.std or 0.0) / _CLOSER:.2g}") for one in sorted(assumed)},
        )

    def by_links(self) -> Iterator[OutlookRow]:
        """The whole arm is entered where the controller takes it."""
        now = self.now
        if now.tcp_95_mm is None or now.links_95_mm is None:
            return
        yield replace(
            now,
            remedy="links",
            tcp_median_mm=now.links_median_mm,
            tcp_95_mm=now.links_95_mm,
            gain=self._gain(now.links_95_mm, now.tcp_95_mm),
        )

    def _of_new_run(
        self,
        remedy: Remedy,
        shots: int,
        roots: Matrix,
        options: tuple[str, ...],
        may_be: Mask | None = None,
    ) -> OutlookRow:
        """Measurements with these roots (N, d, f), by themselves."""
        covariance = _inverse(roots, np.ones(roots.shape[-1]))
        determined = self._determined(roots)
        determined = determined if may_be is None else determined & may_be
        estimates = EstimatesOfArms.of_new_run(self.belief, covariance, roots)
        return self._row(remedy, shots, covariance, estimates, determined, self.each * len(roots), options)

    def _determined(self, roots: Matrix, *, assumed: bool = False) -> Mask:
        """(f,) what measurements with these roots (N, d, f) determine with nothing known but the tolerances,
        those that are `assumed` of tool and frames not among them unless that is asked for."""
        known_to = np.array([item.tolerated and (assumed or not item.assumed) for item in self.items])
        covariance = _inverse(roots, np.where(known_to, 1.0, _NOTHING))
        determined = np.sqrt(np.diag(covariance)) <= _DETERMINED
        determined[self.never] = False
        return np.asarray(determined)

    def _row(
        self,
        remedy: Remedy,
        shots: int,
        covariance: Matrix,
        estimates: EstimatesOfArms,
        determined: Mask,
        minutes: float,
        options: tuple[str, ...] = (),
    ) -> OutlookRow:
        tcp, links = self.forecast.errors(estimates, determined)
        largest = self._largest(covariance, self.improvable)
        gain = 0.0
        if remedy != "none":
            gain = self._gain(largest, self._largest(self.covariance, self.improvable))
            before = self.now.tcp_95_mm
            if tcp is not None and before is not None:
                gain = max(gain, self._gain(tcp[1], before))
        return OutlookRow(
            remedy=remedy,
            shots=shots,
            U=self._expanded(covariance, determined, self.improvable.tolist()),
            tcp_median_mm=None if tcp is None else tcp[0],
            tcp_95_mm=None if tcp is None else tcp[1],
            links_median_mm=None if links is None else links[0],
            links_95_mm=None if links is None else links[1],
            minutes=minutes,
            gain=gain,
            options=options,
        )

    def _expanded(
        self, covariance: Matrix, determined: Mask, which: Sequence[int]
    ) -> dict[str, float | None]:
        u = COVERAGE * np.sqrt(np.diag(covariance)) * self.shown
        return {self.items[k].name: float(u[k]) if determined[k] else None for k in sorted(which)}

    def _largest(self, covariance: Matrix, which: Index) -> float:
        """The largest std of some offsets, in tolerances; of what is not determined that of the prior."""
        tolerance = np.array([item.tolerance / item.prior_std for item in self.items])
        return float((np.sqrt(np.diag(covariance)) / tolerance)[which].max(initial=0.0))

    @staticmethod
    def _gain(after: float, before: float) -> float:
        return 1 - after / before if before > 0 else 0.0


def _with_repeats(roots: Matrix) -> Matrix:
    """Measurements with these roots (N, d, f), the first of them again at the end, as plans have it."""
    return np.concatenate([roots, roots[:USUAL_REPEATS]])


def _inverse(roots: Matrix, prior: Matrix) -> Matrix:
    """(f, f) the covariance of measurements with these roots (N, d, f) and a `prior` information (f,)."""
    rows = np.vstack([roots.reshape(-1, roots.shape[-1]), np.diag(np.sqrt(prior))])
    inverse: Matrix = np.asarray(np.linalg.inv(np.linalg.qr(rows, mode="r")), dtype=float)
    return inverse @ inverse.T


def constraint_options(constraints: StatedConstraints) -> tuple[str, ...]:
    """The options of `plan optimal` by which it keeps the constraints that are not its usual ones."""

    def numbers(values: Sequence[float]) -> str:
        return ",".join(f"{value:g}" for value in values)

    options: list[str] = []
    if constraints.beam_mm is not None:  # of a beam
        if constraints.facing is None:
            options.append("--facing=any")
        elif constraints.facing != USUAL.facing:
            options.append(f"--facing={numbers(constraints.facing)}")
        if constraints.facing is not None and constraints.acceptance != USUAL.acceptance:
            options.append(f"--acceptance={constraints.acceptance:g}")
        if constraints.beam_mm != USUAL.beam_mm:
            options.append(f"--beam={numbers(constraints.beam_mm)}")
    if constraints.margin_deg is not None and constraints.margin_deg != USUAL.margin_deg:
        options.append(f"--margin={constraints.margin_deg:g}")
    return tuple(options)
