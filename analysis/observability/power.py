"""What a run of these measurements could notice: the power of its tests against wrong models, and their risk.

A wrong model moves the whitened residuals by b (`biases`). The noncentrality of the chi-squared of residuals
and tolerances (`LikelihoodFit.against_noise`) is the sum of their squares by it, that of a test for just this
change (`changes`, `displacement`) b'M b; the power is the probability that the better of both is beyond what
chance leaves. The other tests of a misfit notice more: it is a lower bound. The risk is the probability that
a run passes and has an offset that is wrong by more than 4 u, at the size of the wrong model at which it is
largest (the consumer's risk of JCGM 106): what a fit leaves and what it moves are independent. What a
pass can hide is the error, in degrees and at the TCP, by the largest wrong model that is noticed with less
than 95 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
import scipy

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.problem import Problem
from ...model.records import it, key, record
from ..left_over import Biases, revolute, tool_items
from ..status import LACK_OF_FIT, Status, known
from ..tcp_region import default_point, moving_by_nominal, region_postures, tool_point, undetermined_offsets
from .changes import FEWEST, change_limit, repeat_limit, repeated
from .identifiability import Identified

WrongModel = Literal[
    "tool", "beam", "arm", "jump", "drift", "moved", "reading", "typing", "backlash", "noise"
]

NOTICED = 0.95  # power from which on a wrong model counts as noticed: a pass cannot hide it
HARMLESS = 1.0  # error of an offset, in its u, below which a wrong model need not be noticed
LIMIT_U = 4.0  # error of an offset, in its standard uncertainty, that a pass must not have
MOST_RISK = 0.01  # probability of that with which a pass needs no condition
TOOL_MM, BEAM_DEG, ARM_TIMES = 1.0, 0.3, 3.0
JUMP_DEG, DRIFT_DEG, MOVED_MM, READING_MM, TYPING_DEG = 0.2, 0.1, 1.0, 1.0, 1.0
BACKLASH_DEG, NOISE_TIMES = 0.03, 3.0
_SPLITS = 8  # random halves that exchanges begin with
_MORE = 1e-9  # relative: less is no improvement
_DIRECTIONS = 12  # of a displacement in space, on half a sphere, and in a plane

# The largest sizes at which the risk is looked at.
_LARGEST: dict[WrongModel, float] = {
    "tool": 5.0,
    "beam": 2.0,
    "arm": 10.0,
    "jump": 1.0,
    "drift": 0.5,
    "moved": 10.0,
    "reading": 10.0,
    "typing": 5.0,  # what is farther from the plan is questioned
    "backlash": 0.2,
    "noise": 10.0,
}
_MOST_OFF = 14.0  # error of an offset, in u, up to which it is
_LOOKS = np.linspace(0.0, 1.0, 55)[1:]
_HALVINGS = 12  # of the size that is noticed just often enough
_TCP_POSTURES = 64

_LOOKED_AT = 3  # joints, targets and directions of which the risk is worked out

_PowerBy = Callable[[Matrix], Matrix]  # by the size over that of the row (k,)


@record
class DetectionPower:
    """With which probability a run notices a wrong model of this size (mm, deg, or 1: times the stated). Of
    joints, targets and directions that of the largest risk is stated."""

    wrong: Annotated[
        WrongModel,
        it(
            "`tool`: a point of the tool is off by `size`, where the tool has a `sigma`, in the "
            "direction that does most harm of those that are not noticed; `beam`: the direction of a "
            "calibrated laser; `jump`: the zero of `joint`, chosen likewise, jumps halfway; `drift`: "
            "the zero of `joint`, from the first measurement to the last; `backlash`: every joint is "
            "off by that, one way or the other; `noise`: readings scatter so many times as much; "
            "`arm`: the geometry is so many times its tolerance off; `moved`: a target, halfway "
            "through its measurements or steadily; `reading`: one measurement at the spot; `typing`: one"
            " joint of one measurement"
        ),
    ]
    size: Annotated[float, it("of the wrong thing")]
    unit: Annotated[str, it("of `size`")]
    probability: Annotated[float, it("that a run detects it")]
    off_u: Annotated[
        float, it("the largest error by it of an offset that is not merely `assumed`, in the offset's u")
    ]
    joint: Annotated[int | None, it("from 1, else null")] = None
    risk: Annotated[
        float,
        it(
            "the probability that a run passes with an offset wrong by more than 4 u, the largest "
            "over all sizes"
        ),
    ] = 0.0
    worst_size: Annotated[float | None, it("that size")] = None
    hidden_size: Annotated[
        float | None,
        it(
            "the largest size that a run detects with less than 0.95, of those that are looked at: a pass can"
            " hide it"
        ),
    ] = None
    hidden_offset: Annotated[
        float | None,
        it("the largest error by that of an offset, deg, of joints that turn and are not merely `assumed`"),
    ] = None
    hidden_tcp_mm: Annotated[
        float | None,
        it("the error of the TCP by that, the median over the region; null where the TCP is not determined"),
    ] = None

    hidden_joint: Annotated[int | None, it("its joint, from 1, else null")] = None
    again: Annotated[float, it("the share of the postures that are measured again at the end")] = 0.0

    @property
    def noticed(self) -> bool:
        """Whether a run notices it with a probability that is enough."""
        return self.probability >= NOTICED

    @property
    def harmful(self) -> bool:
        """Whether a run may not notice it at this size although an offset is then off by its u or more."""
        return not self.noticed and self.off_u >= HARMLESS

    @property
    @key("whether `risk` is above 0.01")
    def dangerous(self) -> bool:
        """Whether a run may pass with offsets that it makes wrong: a pass is then subject to its absence."""
        return self.risk > MOST_RISK


def powers(problem: Problem, x: Matrix, identified: Identified) -> tuple[DetectionPower, ...]:
    """Of measurements that hit, at x (p,), of which this is `identified`: only offsets that a pass contains
    can make it wrong.

    None where the noise is estimated, or no number is left: nothing is tested then, and nothing noticed.
    """
    every = _Powers.of(problem, x, identified)
    if every is None:
        return ()
    repeats = len(repeated(problem))
    again = repeats / (problem.shots - repeats)
    return tuple(replace(row, again=again) for row in every.rows())


def halves(problem: Problem, x: Matrix) -> tuple[Index, Index]:
    """The measurements in two halves: a jump of a joint's zero between them is noticed most, of the joint of
    which it is noticed least."""
    second = np.arange(problem.shots) >= problem.shots // 2
    joints = revolute(problem)
    if problem.shots < 3 or not joints:
        return np.flatnonzero(~second), np.flatnonzero(second)
    biases = Biases(problem, x, problem.parameters.free)
    jumps = biases.by_joints[:, :, joints]
    u = np.einsum("nda,ndj->jna", biases.roots, jumps)
    form = u @ biases.taken @ u.transpose(0, 2, 1)  # (n, N, N): noncentrality of biases, by measurements
    each = np.arange(problem.shots)
    form[:, each, each] += (jumps**2).sum(axis=1).T
    rng, ends = np.random.default_rng(0), []
    for _ in range(_SPLITS):
        second = rng.permutation(second)
        ends.append(_exchanged(form, second))
    return max(ends, key=lambda end: end[0])[1]


def change_risk(problem: Problem, x: Matrix, identified: Identified) -> float:
    """The risks of what may change during a run, all together: a zero that jumps, one that drifts, a target
    that moves."""
    every = _Powers.of(problem, x, identified)
    return 0.0 if every is None else sum(row.risk for row in every.of_the_run())


def _exchanged(form: Matrix, second: Mask) -> tuple[float, tuple[Index, Index]]:
    """The halves, two measurements exchanged as long as that raises the least of the sums over the second."""
    while True:
        first, chosen = np.flatnonzero(~second), np.flatnonzero(second)
        rows = form[:, :, chosen].sum(axis=2)
        total, alone = rows[:, chosen].sum(axis=1), np.diagonal(form, axis1=1, axis2=2)
        gain = (alone + 2 * rows)[:, first, None] + (alone - 2 * rows)[:, None, chosen]
        after = (total[:, None, None] + gain - 2 * form[:, first[:, None], chosen]).min(axis=0)
        enter, leave = np.unravel_index(int(np.argmax(after)), after.shape)
        if after[enter, leave] <= total.min() * (1 + _MORE):
            return float(total.min()), (first, chosen)
        second = second.copy()
        second[first[enter]], second[chosen[leave]] = True, False


class _Powers:
    """The wrong models of a run."""

    def __init__(self, biases: Biases, dof: int, status: Sequence[Status]) -> None:
        self._biases, self._dof = biases, dof
        self._limit = float(scipy.special.chdtri(dof, LACK_OF_FIT))
        self._by_tcp = _by_tcp(biases, status)

    @classmethod
    def of(cls, problem: Problem, x: Matrix, identified: Identified) -> Self | None:
        """None where nothing is tested."""
        dof = problem.data_size - identified.facts.rank
        if not problem.noise.known or dof <= 0:
            return None
        counted = np.array([known(status) for status in identified.status])
        return cls(Biases(problem, x, counted), dof, identified.status)

    def of_the_run(self) -> Iterator[DetectionPower]:
        """What may change during it."""
        problem = self._biases.problem
        if joints := revolute(problem):
            yield self._of_joints("jump", JUMP_DEG, joints, _second_half(problem.shots))
            yield self._of_joints("drift", DRIFT_DEG, joints, _steady(problem.shots))
        if (problem.shots >= 2 * FEWEST) and (moved := list(self._of_targets())):
            yield _riskiest(moved)

    def rows(self) -> Iterator[DetectionPower]:
        """Each with a joint, a target and a direction, those of the largest risk."""
        biases, problem = self._biases, self._biases.problem
        if shifts := tool_items(problem, "mm"):
            yield self._along("tool", TOOL_MM, "mm", shifts)
        if tilts := tool_items(problem, "deg"):
            yield self._along("beam", BEAM_DEG, "deg", tilts)
        if len(arm := np.flatnonzero(problem.parameters.group("geometry") & problem.parameters.free)):
            yield self._of_arm(arm)
        yield from self.of_the_run()
        off = biases.by_spot @ _directions_of(problem.tool.lengths, biases.by_spot.shape[2])
        yield self._of_one("reading", READING_MM, "mm", off * READING_MM)
        if joints := revolute(problem):
            off = biases.by_joints[:, :, joints] * np.radians(TYPING_DEG)
            yield self._of_one("typing", TYPING_DEG, "deg", off)
            yield self._of_backlash(joints)
        yield self._of_noise()

    def _along(self, wrong: WrongModel, size: float, unit: str, items: list[int]) -> DetectionPower:
        """A displacement of the tool, or of one of several, by these parameters in the worst direction."""
        of = [self._biases.problem.parameters.items[i].of for i in items]
        parts = [[k for k, name in enumerate(of) if name == one] for one in dict.fromkeys(of)]
        columns = self._biases.by_parameters(items) @ _directions_of(parts, len(items))
        columns *= np.radians(size) if unit == "deg" else size
        u = self._biases.free.T @ columns
        return self._worst(wrong, size, unit, (columns**2).sum(axis=0), u)

    def _of_joints(self, wrong: WrongModel, size: float, joints: list[int], course: Matrix) -> DetectionPower:
        """The zeros of joints that change by a course (N,) over the run: their values must hold for the arm
        at its beginning and at its end."""
        biases = self._biases
        square, u = biases.of_shots(biases.by_joints[:, :, joints] * course[:, None, None] * np.radians(size))
        before = biases.errors(u)
        by_end = biases.joints[:, None] == np.array(joints)
        after = before - by_end * (np.radians(size) / biases.std)[:, None]
        limit = min(change_limit(biases.problem), repeat_limit(biases.problem))
        return self._worst(wrong, size, "deg", square, u, (before, after), joints, (limit, 1))

    def _of_targets(self) -> Iterator[DetectionPower]:
        """A target that is moved halfway through its measurements, or drifts from the first to the last; both
        have tests of three degrees of freedom, by Bonferroni's bound."""
        biases, index = self._biases, self._biases.problem.target_index
        targets = [
            rows for k in range(index.max() + 1) if len(rows := np.flatnonzero(index == k)) >= 2 * FEWEST
        ]
        if not targets:
            return
        places = sum(max(0, int(n) - 1) for n in np.bincount(index))
        moved = float(scipy.special.chdtri(3, LACK_OF_FIT / places))
        again = repeat_limit(biases.problem, 3)
        limits = (min(moved, again), min(change_limit(biases.problem, 3), again))
        courses = zip((_second_half, _steady), limits, strict=True)
        for course, limit in courses:
            every = []
            for rows in targets:
                whole = np.zeros(len(index))
                whole[rows] = course(len(rows))
                every.append(
                    biases.of_shots(biases.by_target * whole[:, None, None] @ _directions(3) * MOVED_MM)
                )
            square, u = (np.concatenate(parts, axis=-1) for parts in zip(*every, strict=True))
            yield self._worst("moved", MOVED_MM, "mm", square, u, directed=(limit, 3))

    def _of_one(self, wrong: WrongModel, size: float, unit: str, parts: Matrix) -> DetectionPower:
        """One measurement alone that is off by one of its columns (N, d, k)."""
        roots = self._biases.roots
        u = np.einsum("nda,ndk->ank", roots, parts).reshape(roots.shape[2], -1)
        return self._worst(wrong, size, unit, (parts**2).sum(axis=1).ravel(), u)

    def _worst(
        self,
        wrong: WrongModel,
        size: float,
        unit: str,
        square: Matrix,
        u: Matrix,
        errors: tuple[Matrix, ...] = (),
        joints: Sequence[int] | None = None,
        directed: tuple[float, int] | None = None,
    ) -> DetectionPower:
        """Of biases with the squares (k,) and u (f, k), by a wrong model of this `size`, that of the largest
        risk, with what the worst of them can hide; `errors` (o, k) of the offsets, in their u, where they are
        not those of the fit, `directed` the limit and the rank of a test of its own."""
        biases = self._biases
        squares, left = biases.squares(square, u), biases.left(square, u)
        errors = errors or (biases.errors(u),)
        off = np.abs(errors).max(axis=(0, 1), initial=0.0)
        # The risk grows with the error over the noncentrality, as far as the sizes reach.
        best = np.argsort(-(off**2) / np.maximum(squares, 1e-12))[:_LOOKED_AT]
        cases, most = [], _LARGEST[wrong] / size
        for k in {*best.tolist(), int(np.argmax(off))}:
            tests = [(self._limit, self._dof, float(squares[k]))]
            if directed is not None:
                tests.append((*directed, float(left[k])))
            joint = None if joints is None else joints[k] + 1

            def power(times: Matrix, tests: list[tuple[float, int, float]] = tests) -> Matrix:
                beyond = [1 - scipy.special.chndtr(limit, dof, b * times**2) for limit, dof, b in tests]
                return np.asarray(np.max(beyond, axis=0))

            risk, worst = _risk(power, float(off[k]), most, lambda error: _beyond(error, 1.0))
            times = _hidden(power, most)
            each = [self._harm(part[:, k] * biases.std) for part in errors]
            offset, tcp = max(each, key=lambda harm: (harm[1] or 0.0, harm[0]))
            cases.append(
                DetectionPower(
                    wrong,
                    size,
                    unit,
                    float(power(np.ones(1))[0]),
                    float(off[k]),
                    joint,
                    risk,
                    worst * size,
                    times * size,
                    times * offset,
                    None if tcp is None else times * tcp,
                )
            )
        most_hidden = max(cases, key=harm)
        return replace(
            _riskiest(cases),
            hidden_size=most_hidden.hidden_size,
            hidden_offset=most_hidden.hidden_offset,
            hidden_tcp_mm=most_hidden.hidden_tcp_mm,
            hidden_joint=most_hidden.joint,
        )

    def _harm(self, errors: Matrix) -> tuple[float, float | None]:
        """By errors (o,) of the offsets, rad or mm: the largest in degrees, and the TCP's, mm."""
        largest = float(np.abs(errors * self._biases.degrees).max(initial=0.0))
        if self._by_tcp is None:
            return largest, None
        return largest, float(np.median(np.linalg.norm(self._by_tcp @ errors, axis=1)))

    def _random_harm(self, covariance: Matrix) -> tuple[float, float | None]:
        """The same by random errors of the offsets with this covariance (o, o): their std."""
        stds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        largest = float((stds * self._biases.degrees).max(initial=0.0))
        if self._by_tcp is None:
            return largest, None
        squares = np.einsum("pka,ab,pkb->p", self._by_tcp, covariance, self._by_tcp)
        return largest, float(np.sqrt(np.median(np.maximum(squares, 0.0))))

    def _of_backlash(self, joints: list[int]) -> DetectionPower:
        """One way or the other in each measurement: over all ways the noncentrality has a mean and a
        variance."""
        biases = self._biases
        each = biases.by_joints[:, :, joints] * np.radians(BACKLASH_DEG)
        us = np.einsum("nda,ndj->naj", biases.roots, each)
        apart = np.einsum("ndi,ndj->nij", each, each)
        through = us.transpose(0, 2, 1) @ (biases.taken @ us)
        gram = np.einsum("nai,nbi->ab", us, us)
        spread = biases.taken @ gram
        mean = float(np.trace(apart + through, axis1=1, axis2=2).sum())
        square = float((apart * (apart + 2 * through)).sum() + np.trace(spread @ spread))
        most = _LARGEST["backlash"] / BACKLASH_DEG
        row, sizes = self._random("backlash", BACKLASH_DEG, "deg", mean, square, gram, most)
        return replace(row, worst_size=sizes[0] * BACKLASH_DEG, hidden_size=sizes[1] * BACKLASH_DEG)

    def _of_noise(self) -> DetectionPower:
        """More noise, by its variance over the stated."""
        biases, problem = self._biases, self._biases.problem
        gram = np.einsum("nda,ndb->ab", biases.roots, biases.roots)
        readings, through = float(problem.sizes.sum()), gram @ biases.taken
        # The form of the readings' errors has these sums of its eigenvalues and of their squares.
        first = readings + float(np.trace(through))
        second = readings + float(2 * np.trace(through) + (through * through.T).sum())
        return self._larger("noise", NOISE_TIMES, first, second, gram)

    def _of_arm(self, which: Index) -> DetectionPower:
        """All deviations of an arm larger than their tolerances, or one of them alone."""
        biases = self._biases
        columns = biases.jacobian[:, which]
        u = biases.free.T @ columns
        form = columns.T @ columns + u.T @ biases.taken @ u
        every = self._larger("arm", ARM_TIMES, float(np.trace(form)), float((form**2).sum()), u @ u.T)
        single = self._worst("arm", 1.0, "1", (columns**2).sum(axis=0), u)
        if every.risk >= single.risk:
            return every
        return replace(every, risk=single.risk, worst_size=single.worst_size)

    def _larger(
        self, wrong: WrongModel, times: float, mean: float, square: float, gram: Matrix
    ) -> DetectionPower:
        """What is normal, its std so many `times` the stated: by the first and second moments of its squares
        in the residuals and the covariance (f, f) of u, at once the stated."""
        more = times**2 - 1
        most = float(np.sqrt((_LARGEST[wrong] ** 2 - 1) / more))
        row, sizes = self._random(wrong, times, "1", more * mean, more**2 * square, more * gram, most)
        worst, hidden = (float(np.sqrt(1 + more * size**2)) for size in sizes)
        return replace(row, worst_size=worst, hidden_size=hidden)

    def _random(
        self,
        wrong: WrongModel,
        size: float,
        unit: str,
        mean: float,
        square: float,
        gram: Matrix,
        most: float,
    ) -> tuple[DetectionPower, tuple[float, float]]:
        """A random wrong model: the mean of its squares in the residuals, the sum of the squares of their
        form, the covariance (f, f) of u; and how many times as large its risk is largest, and is hidden."""

        def power(times: Matrix) -> Matrix:
            variance = 2 * self._dof + 4 * mean * times**2 + 2 * square * times**4
            return _of_moments(self._limit, self._dof + mean * times**2, variance)

        errors = self._biases.into @ gram @ self._biases.into.T
        off = float(np.sqrt(np.diag(errors).max(initial=0.0)))
        risk, worst = _risk(power, off, most, lambda error: _beyond(0.0, np.sqrt(1 + error**2)))
        probability, hidden = float(power(np.ones(1))[0]), _hidden(power, most)
        offset, tcp = self._random_harm(errors * np.outer(self._biases.std, self._biases.std))
        row = DetectionPower(wrong, size, unit, probability, off, None, risk)
        row = replace(row, hidden_offset=hidden * offset, hidden_tcp_mm=None if tcp is None else hidden * tcp)
        return row, (worst, hidden)


def _by_tcp(biases: Biases, status: Sequence[Status]) -> Matrix | None:
    """(P, 3, o) of the TCP over the region by the offsets that count; None where it is not determined."""
    problem = biases.problem
    block = problem.parameters.block("offset")
    point, _ = default_point(problem, status)
    joints = region_postures(problem, _TCP_POSTURES)
    if (moving_by_nominal(problem, point, joints) & undetermined_offsets(problem, status)).any():
        return None
    _, by_arm = tool_point(problem, problem.parameters.prior_mean, point, joints)
    return np.asarray(by_arm[:, :, block.start + biases.joints])


def harm(power: DetectionPower) -> float:
    """By which what a pass can hide is ranked: at the TCP, mm, else of an offset, deg."""
    return power.hidden_tcp_mm or power.hidden_offset or 0.0


def _hidden(power: _PowerBy, most: float) -> float:
    """How many times the row's size, up to `most`, is just not noticed."""
    low, high = 0.0, most
    if power(np.array([high]))[0] < NOTICED:
        return high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if power(np.array([middle]))[0] >= NOTICED else (middle, high)
    return low


def _risk(power: _PowerBy, off: float, most: float, wrong: Callable[[Matrix], Matrix]) -> tuple[float, float]:
    """The largest probability that a run passes and is wrong, over sizes up to `most` times the row's, and
    that size over the row's; `off` is the error of an offset at the row's size, `wrong` the probability that
    it is beyond the limit."""
    if off <= 0:
        return 0.0, 1.0
    times = _LOOKS * min(most, _MOST_OFF / off)
    risks = (1 - power(times)) * wrong(times * off)
    worst = int(np.argmax(risks))
    return float(risks[worst]), float(times[worst])


def _beyond(error: Matrix | float, spread: Matrix | float) -> Matrix:
    """The probability that a normal error of this mean and std, in u, is beyond the limit."""
    low, high = (error - LIMIT_U) / spread, (-error - LIMIT_U) / spread
    return np.asarray(scipy.special.ndtr(low) + scipy.special.ndtr(high))


def _riskiest(cases: Sequence[DetectionPower]) -> DetectionPower:
    """The case of the largest risk, of those the one that does most harm."""
    return max(cases, key=lambda case: (round(case.risk, 3), case.off_u))


def _second_half(shots: int) -> Matrix:
    return np.asarray((np.arange(shots) >= shots // 2) * 1.0)


def _steady(shots: int) -> Matrix:
    return np.linspace(0.0, 1.0, shots)


def _directions(size: int) -> Matrix:
    """(size, k) directions of a plane or of space, their opposites left out."""
    if size < 3:
        angles = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS
        return np.stack([np.cos(angles), np.sin(angles)])[:size]
    k = np.arange(4 * _DIRECTIONS) + 0.5
    height, turn = k / len(k), np.pi * (1 + np.sqrt(5)) * k  # Fibonacci's half sphere
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height])


def _directions_of(parts: Sequence[Sequence[int]], size: int) -> Matrix:
    """(size, k) directions within each of the parts of a vector, which has 0 elsewhere."""
    every = []
    for part in parts:
        inside = _directions(len(part))
        whole = np.zeros((size, inside.shape[1]))
        whole[list(part)] = inside
        every.append(whole)
    return np.hstack(every)


def _of_moments(limit: float, mean: Matrix, variance: Matrix) -> Matrix:
    """The probability that a sum of squares of this mean and variance is beyond a limit, as a scaled
    chi-squared (Satterthwaite 1946)."""
    scale = variance / (2 * mean)
    return np.asarray(scipy.special.chdtrc(mean / scale, limit / scale))
