"""What the data determine, and what not: statuses, null-space directions and their causes (design, section
2).

Everything follows from A, the Jacobian of the whitened residuals by the scaled parameters, taken at
measurements that hit. There is no pseudo-inverse here: where the data say nothing, the answer is None.

What has a tolerance (geometry, a calibrated tool) is known up to that, so it is noise that the measurements
share: it is eliminated from A, and directions are of what the measurements alone must determine. So the
reasons of a nominal arm are those of an uncertain one.

The cause of a direction is tested, not guessed. A mechanism is a set of parameters that can move together
without changing the residuals. It explains a null-space direction if a direction within that set alone is
null (or as nearly null) too, with all other parameters known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.instruments.kind import Assumption
from ...model.likelihood.parameters import Group, Parameter, Parameters
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..status import Status, known
from .causes import (
    MOST,
    BaseFrame,
    Cause,
    CommonMotion,
    Equivalent,
    JointsBefore,
    NamedTolerance,
    NoiseSplit,
    NullDirection,
    OnAxis,
    OnePosition,
    ParallelAxes,
    TargetUnseen,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    Unexplained,
    WithinTolerances,
    cause_for,
)
from .gauges import PART, ROUNDING, Gauge, Marginal, complement, gauge_at, gauge_of, information_roots

_NEARLY_CONSTANT_DEG = 10.0
_NEARLY_CONSTANT_MM = 50.0
_NEARLY_PARALLEL_DEG = 3.0
_NO_SUPPORT = np.zeros(0, dtype=bool)
_NO_INFORMATION = 1e-8  # on a parameter with a tolerance, over that of its tolerance
_AS_KNOWN = 1 - 1e-6  # singular value of a direction of which the data say no more than a unit prior
_NEW = 1e-4  # a null direction is not named yet if this part of it is outside those named
_AS_NEARLY_NULL = 3.0  # a mechanism explains a direction if it is null to within this factor
_MOST = 0.5  # of the std of a weak offset is a mechanism's that explains it alone
_NEGLIGIBLE = 1e-3  # terms of a combination whose effect is below this share are left out
_RESTS = 2.0  # times the std without what is known of tool and frames: then three quarters are known by it
_ALONE = 10.0  # times that std: then all but a hundredth is
_PART_OF_IT = 0.1  # of the largest term of a direction: an offset that has as much is named
_SHIFTED: tuple[Group, ...] = ("target", "frame", "tool")
_LARGEST_TERMS = 8  # of a direction without a known mechanism, which may have a little of everything
_LARGEST_TOLERANCES = 3  # of those that set a variance are named


@dataclass(frozen=True, eq=False)
class Mechanism:
    """`support` (p,) marks the parameters that move together."""

    support: Mask
    cause: Cause


def mechanisms(problem: Problem) -> Iterator[Mechanism]:
    """The known mechanisms for these measurements, the most special first."""
    n, parameters, free = problem.robot.n, problem.parameters, problem.parameters.free
    targets, tool = parameters.group("target") | parameters.group("frame"), parameters.group("tool")

    def offset(i: int) -> Mask:
        return np.equal(np.arange(len(parameters)), i)

    for which, name in enumerate(problem.targets):
        only = np.zeros(len(parameters), dtype=bool)
        only[parameters.block("target", which)] = True
        yield Mechanism(only, TargetUnseen(name, int((problem.target_index == which).sum())))
    # Without its own offset among the unknowns a mechanism would explain what others do.
    if free[0]:
        yield Mechanism(offset(0) | targets, BaseFrame(prismatic=parameters.items[0].unit == "mm"))
    if problem.noise.separate:
        yield Mechanism(parameters.group("noise"), NoiseSplit())
    for each in problem.tool.each:
        yield Mechanism(offset(n - 1), OnAxis(each.name, n))
        if (carried := parameters.carried(each)).any() and free[n - 1]:
            # A free tool, or one within a stated sigma.
            rotation = ToolRotation(each.name, n, each.known_to if each.calibrated else None)
            yield Mechanism(offset(n - 1) | carried, rotation)
    for k in range(1, n):
        if free[k]:
            yield Mechanism(offset(k) | targets, _common_motion(problem, k))
    # Of too few measurements almost any pair of axes looks inseparable: that is no property of the axes.
    enough = too_few_measurements(problem) is None
    angles = _angles_of_axes(problem)
    for i, j in combinations(np.flatnonzero(free[:n]), 2):
        if enough and angles[i, j] <= _NEARLY_PARALLEL_DEG and not _always_parallel(problem, int(i), int(j)):
            cause = ParallelAxes(int(i) + 1, int(j) + 1, float(angles[i, j]))
            yield Mechanism(offset(int(i)) | offset(int(j)) | targets, cause)
    if tool.any() and not problem.tool.calibrated:
        yield Mechanism(tool | targets, ToolAgainstTarget())


def _common_motion(problem: Problem, k: int) -> CommonMotion:
    """The motion of everything after joint k (1 … k do not change, or hardly)."""
    before = _before(problem, k)
    revolute = (*before.revolute, problem.robot.joints[k].kind == "revolute")
    frame = all(map(problem.is_station, problem.targets))
    return CommonMotion(k + 1, frame, revolute=revolute, ranges=before.ranges, little=before.little)


def _before(problem: Problem, k: int) -> JointsBefore:
    """The first k joints over the measurements."""
    revolute = tuple(joint.kind == "revolute" for joint in problem.robot.joints[:k])
    ranges = tuple((np.ptp(problem.joints, axis=0) * problem.robot.display)[:k].tolist())
    most = (_NEARLY_CONSTANT_DEG if each else _NEARLY_CONSTANT_MM for each in revolute)
    little = tuple(size <= limit for size, limit in zip(ranges, most, strict=True))
    return JointsBefore(revolute=revolute, ranges=ranges, little=little)


def _always_parallel(problem: Problem, i: int, j: int) -> bool:
    """Whether the axes of two joints are nearly parallel whatever the posture, as those of joints 2 and 3 of
    most arms are: postures cannot mend that."""
    anywhere = np.random.default_rng(0).uniform(-1.0, 1.0, (8, problem.robot.n))
    return bool(_angles_of_axes(problem, anywhere)[i, j] <= _NEARLY_PARALLEL_DEG)


def _angles_of_axes(problem: Problem, joints: Matrix | None = None) -> Matrix:
    """(n, n) the largest angle, deg, between two joint axes of nominal geometry over the measurements, or
    over `joints` (N, n)."""
    (axes,) = problem.functions.kernel("axes")(
        problem.joints if joints is None else joints, problem.split(problem.parameters.prior_mean).arm
    )
    axes = axes.reshape(-1, 3, problem.robot.n)  # the kernel gives one column without its axis
    cosine = np.abs(axes.transpose(0, 2, 1) @ axes).min(axis=0)
    return np.asarray(np.degrees(np.arccos(np.minimum(cosine, 1.0))))


def unexplained(problem: Problem, direction: Matrix | None = None) -> Mechanism:
    """What explains a direction (m,) of the untolerated parameters that no single mechanism explains."""
    few = too_few_measurements(problem)
    if few is not None:
        return few
    one_position = not problem.tool.beam and not problem.stations and len(problem.targets) == 1
    if one_position or direction is None:
        return Mechanism(_NO_SUPPORT, OnePosition() if one_position else Unexplained())
    return Mechanism(_NO_SUPPORT, _by_its_terms(problem, direction))


def _by_its_terms(problem: Problem, direction: Matrix) -> Cause:
    """What a direction (m,) says by itself: which offsets together have the effect of what."""
    parameters = problem.parameters
    terms = np.zeros(len(parameters))
    terms[parameters.untolerated] = np.abs(direction) / np.abs(direction).max()
    joints = np.flatnonzero(terms[parameters.block("offset")] >= _PART_OF_IT)
    if not len(joints):
        joints = np.flatnonzero(terms[parameters.block("offset")] >= _NEGLIGIBLE)
    shifted = tuple(group for group in _SHIFTED if (terms[parameters.group(group)] >= _NEGLIGIBLE).any())
    if not len(joints) and not shifted:
        return Unexplained()
    if len(joints) == 1 and joints[0] > 0 and shifted == ("target",):
        return _common_motion(problem, int(joints[0]))
    before = _before(problem, int(joints[-1]) if len(joints) else problem.robot.n)
    return Equivalent(tuple((joints + 1).tolist()), shifted, **vars(before))


def too_few_measurements(problem: Problem) -> Mechanism | None:
    """The mechanism of having fewer numbers than unknowns, or None where there are enough. What has a
    tolerance needs no measurement."""
    parameters, measured = problem.parameters, problem.measured_size
    count = int(parameters.untolerated.sum())
    if measured >= count:
        return None
    by_group: dict[Group, int] = {}
    for item in (parameters.items[i] for i in np.flatnonzero(parameters.untolerated)):
        by_group[item.group] = by_group.get(item.group, 0) + 1
    distances, angles = len(problem.distances), len(problem.angles)
    needed = -(-(count - distances - angles) // round(float(problem.sizes.max())))
    cause = TooFewMeasurements(problem.shots, distances, measured, by_group, needed, angles)
    return Mechanism(np.ones(len(parameters), dtype=bool), cause)


@record
class Identifiability:
    """Rank facts of the whitened, prior-scaled Jacobian (section 2 of the design).

    `rank` counts the unknowns that are determined, those with a tolerance among them. `condition` is None
    where the matrix is singular; the observability indices are 0 there.
    """

    rank: Annotated[
        int,
        it(
            "number of directions in which the data say more than the prior, and of parameters with a"
            " tolerance (geometry, a calibrated tool)"
        ),
    ]
    size: Annotated[int, it("number of free parameters")]
    condition: Annotated[
        float | None,
        it(
            "largest over smallest singular value, the parameters with a tolerance eliminated; null "
            "if singular"
        ),
    ]
    observability: Annotated[
        dict[str, float | None], it("`O1` … `O5` of the same singular values; 0 for a singular matrix")
    ]
    null_space: Annotated[tuple[NullDirection, ...], it("the undetermined directions")]


@dataclass(frozen=True, eq=False)
class Identified:
    """Per parameter (p,): `status`, and `data_std` in internal units (inf for a gauge, nan if held);
    `rests_on` what an offset, by its name, is known by besides the measurements; `weak_on` what is assumed by
    which alone an offset is no worse than weak; `still_weak` are those that would be weak were what is
    assumed of tool and frames known exactly."""

    status: tuple[Status, ...]
    data_std: Matrix
    facts: Identifiability
    rests_on: Mapping[str, tuple[Assumption, ...]] = field(default_factory=dict)
    weak_on: Mapping[str, tuple[Assumption, ...]] = field(default_factory=dict)
    still_weak: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        return (
            f"<Identified: rank {self.facts.rank}, before the model is tested; solution.status is the answer>"
        )

    def cause(self, item: Parameter, status: Status, tolerance_share: float | None) -> Cause | None:
        """Why a parameter of that `status` has no number, or a poor one: `cause_for`."""
        facts = self.facts.null_space
        return cause_for(facts, item, status, tolerance_share, self.rests_on, self.still_weak)


def identify(problem: Problem, x: Matrix, weight: float = 1.0) -> Identified:
    """Judge the shots of `problem` at the parameters x (p,).

    Measurements that do not hit are first turned onto their targets by the joints that vary;
    `weight` is 1 / noise scale^2, of measurements only.
    """
    parameters = problem.parameters
    judged, data_std = _judged(problem, x, weight)
    tolerated = parameters.tolerated[parameters.free]
    singular = judged.spectrum.of_all
    facts = Identifiability(
        rank=int(tolerated.sum()) + int((singular >= _AS_KNOWN).sum()),
        size=len(tolerated),
        condition=None if judged.gauge.basis.shape[1] else float(singular.max() / singular.min()),
        observability=observability(singular, problem.shots),
        null_space=(*_exact_directions(judged), *_noise_directions(judged)),
    )
    rests_on, weak_on = _taken_as_known(problem, x, weight, judged.status, data_std)
    status = tuple(
        "assumed" if any(not one.stated for one in rests_on.get(item.name, ())) else each
        for item, each in zip(parameters.items, judged.status, strict=True)
    )
    return Identified(status, data_std, facts, rests_on, weak_on, _still_weak(judged, status))


def _still_weak(judged: _Judged, status: Sequence[Status]) -> frozenset[str]:
    """The assumed offsets that no better knowledge of what is assumed makes identified."""
    items = judged.problem.parameters.items
    if "assumed" not in status:
        return frozenset()
    free = [item for item in items if not item.held]
    known = np.array([item.assumed and item.tolerated for item in free], dtype=bool)
    tolerated = np.array([item.tolerated for item in free], dtype=bool)
    _, _, std = _determined(judged.gauge.jacobian[:, ~known], judged.gauge.basis, tolerated[~known])
    names = (item.name for item, gone in zip(free, known, strict=True) if not gone)
    by_name = dict(zip(names, std, strict=True))
    return frozenset(
        item.name
        for item, each in zip(items, status, strict=True)
        if each == "assumed" and by_name[item.name] * item.prior_std > item.tolerance
    )


def _judged(problem: Problem, x: Matrix, weight: float) -> tuple[_Judged, Matrix]:
    """The statuses by what the problem takes as known, and `data_std` (p,) of `Identified`."""
    gauge = gauge_of(problem, x, weight)
    tolerated = problem.parameters.tolerated[problem.parameters.free]
    marginal, spectrum, scaled_std = _determined(gauge.jacobian, gauge.basis, tolerated)
    for jacobian, basis in gauge.near_by:
        # The true values are near by, not where directions happen to be null that are not null there.
        scaled_std = np.maximum(scaled_std, _determined(jacobian, basis, tolerated)[-1])
    scaled_std[~tolerated] = _of_gauge(scaled_std[~tolerated], gauge, spectrum.floor)
    scaled_std[tolerated] = _without_own_tolerance(scaled_std[tolerated], gauge.spanned)
    status, data_std = _statuses(problem.parameters, scaled_std)
    return _Judged(problem, x, weight, gauge, marginal, spectrum, status), data_std


def _taken_as_known(
    problem: Problem, x: Matrix, weight: float, status: Sequence[Status], data_std: Matrix
) -> tuple[dict[str, tuple[Assumption, ...]], dict[str, tuple[Assumption, ...]]]:
    """By the name of each offset that would be unidentifiable were nothing known of tool and frames: what it
    rests on. What is assumed, where that alone makes it identifiable; else what the header states. `data_std`
    (p,) is with all that is known.

    A weak one rests on it only where no number of measurements would do without: else it is weak by the plan,
    and stays weak. Those are the second ones, with what is assumed. The last offset and the tool turn
    together: an arm that deviates breaks that a little, which is no knowledge of the offset.
    """
    items = problem.parameters.items
    offsets = [i for i, item in enumerate(items) if item.group == "offset" and known(status[i])]
    every = problem.tool.taken_as_known
    if not offsets or not every:
        return {}, {}
    by_header, assumed = ([one for one in every if one.stated == is_stated] for is_stated in (True, False))
    resting = _lost(problem, x, weight, offsets, data_std, keep_stated=False)
    without = resting if not by_header else {}
    if resting and by_header and assumed:
        without = _lost(problem, x, weight, list(resting), data_std, keep_stated=True)
    last = problem.parameters.block("offset").stop - 1

    def weak_of(lost: Mapping[int, float]) -> set[int]:
        return {
            i
            for i, std in lost.items()
            if status[i] == "weak" and np.isfinite(std) and (i != last or std <= _ALONE * data_std[i])
        }

    by_plan, weak_on = weak_of(resting), weak_of(without)
    rests_on = {
        items[i].name: _of_unit(problem, assumed if i in without and i not in weak_on else by_header)
        for i in resting
        if i not in by_plan
    }
    return rests_on, {items[i].name: _of_unit(problem, assumed) for i in weak_on}


def _lost(
    problem: Problem, x: Matrix, weight: float, offsets: Sequence[int], data_std: Matrix, *, keep_stated: bool
) -> dict[int, float]:
    """The places among `offsets` of those that are unidentifiable at x where tool and frames may be anything,
    but for what the header states if that is kept, and that this is the reason of; with their std then."""
    freed, there = problem.freed(x, keep_stated=keep_stated)
    tolerated = freed.parameters.tolerated[freed.parameters.free]
    gauge = gauge_at(freed, there, weight)
    _, spectrum, scaled_std = _determined(gauge.jacobian, gauge.basis, tolerated)
    scaled_std[~tolerated] = _of_gauge(scaled_std[~tolerated], gauge, spectrum.floor)
    status, std = _statuses(freed.parameters, scaled_std)
    return {
        i: float(std[i]) for i in offsets if status[i] == "unidentifiable" and std[i] > _RESTS * data_std[i]
    }


def _of_unit(problem: Problem, some: Sequence[Assumption]) -> tuple[Assumption, ...]:
    """Of each instrument what a rotation of the last joint is equivalent to, if there is such; all of what a
    frame is."""
    unit = {each.label: each.words.unit for each in problem.tool.each}
    of_unit = [one for one in some if one.part == "frame" or one.unit == unit[one.label]]
    return tuple(of_unit or some)


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """Of what has no tolerance: `directions` (m, k) outside the gauge and their singular values (k,), none
    below the `floor` of rounding; `of_all` (m,) has the zeros of the gauge too."""

    directions: Matrix
    singular: Matrix
    floor: float
    of_all: Matrix

    @classmethod
    def of(cls, root: Matrix, gauge: Matrix) -> _Spectrum:
        """Of A (M, m) and its null space (m, g)."""
        keep = complement(gauge)
        missing = np.zeros((max(keep.shape[1] - len(root), 0), len(gauge)))
        _, singular, right = np.linalg.svd(np.vstack([root, missing]) @ keep, full_matrices=False)
        floor = ROUNDING * max(float(singular.max(initial=0.0)), 1.0)
        singular = np.maximum(singular, floor)
        return cls(keep @ right.T, singular, floor, np.append(singular, np.zeros(gauge.shape[1])))

    def std_of(self, rows: Matrix) -> Matrix:
        """(r,) the std of linear functions of the parameters, `rows` (r, m)."""
        return np.asarray(np.sqrt(((rows @ self.directions / self.singular) ** 2).sum(axis=1)))


def _determined(jacobian: Matrix, gauge: Matrix, tolerated: Mask) -> tuple[Marginal, _Spectrum, Matrix]:
    """Of A (M, f) and the null space (m, g) of what has no tolerance; with (f,) the std of each scaled free
    parameter outside that null space, its own tolerance among what is known."""
    marginal = Marginal.of(jacobian, tolerated)
    spectrum = _Spectrum.of(marginal.root, gauge)
    std = np.empty(len(tolerated))
    std[~tolerated] = spectrum.std_of(np.eye(marginal.root.shape[1]))
    std[tolerated] = np.hypot(marginal.std, spectrum.std_of(marginal.response))
    return marginal, spectrum, std


def _of_gauge(std: Matrix, gauge: Gauge, floor: float) -> Matrix:
    """(m,) stds with those that have a part in the null space, and without a bound in an exact gauge."""
    std = np.where(gauge.part, np.maximum(std, 1 / floor), std)
    return np.where(gauge.exact_part, np.inf, std)


@dataclass(frozen=True, eq=False)
class _Judged:
    """Measurements at x (p,) with the `weight` of `identify`, whose null-space directions are named."""

    problem: Problem
    x: Matrix
    weight: float
    gauge: Gauge
    marginal: Marginal
    spectrum: _Spectrum
    status: tuple[Status, ...]

    @property
    def untolerated(self) -> list[Parameter]:
        """The m parameters that the measurements must determine."""
        parameters = self.problem.parameters
        return [parameters.items[i] for i in np.flatnonzero(parameters.untolerated)]

    @cached_property
    def nominal(self) -> Matrix:
        """A (M, f) of arm and tool without deviation: an estimate of its tilt, be it the noise's alone, turns
        a beam off the axis that it lies on by its nominal place."""
        nominal = self.gauge.nominal
        if nominal is None or np.array_equal(nominal, self.x):
            return self.gauge.jacobian
        ((_, jacobian, _),) = information_roots(self.problem, nominal[None], self.weight)
        return jacobian


def no_better_than(problem: Problem, identified: Identified, std: Matrix) -> Identified:
    """The same with `weak` for what counts as identified although its std (p,) is beyond the tolerance.

    Where a direction is nearly null the residuals are far from linear, and the std found at the mode can be
    larger than the one that the Jacobian promises.
    """
    status: list[Status] = [
        "weak" if status_of == "identified" and spread > item.tolerance else status_of
        for status_of, item, spread in zip(identified.status, problem.parameters.items, std, strict=True)
    ]
    return replace(identified, status=tuple(status))


def observability(singular: Matrix, shots: int) -> dict[str, float | None]:
    """O1…O5 of the singular values: Borm & Menq 1991, Driels & Pathre 1990, Nahvi et al. 1994,
    Nahvi & Hollerbach 1996, Sun & Hollerbach 2008. All are 0 for a singular matrix."""
    largest, smallest = float(singular.max()), float(singular.min())
    if smallest <= 0:
        return {f"O{i}": 0.0 for i in range(1, 6)}
    return {
        "O1": float(np.exp(np.log(singular).mean()) / np.sqrt(shots)),
        "O2": smallest / largest,
        "O3": smallest,
        "O4": smallest**2 / largest,
        "O5": float(1 / (1 / singular).sum()),
    }


def _without_own_tolerance(scaled_std: Matrix, unbounded: Mask) -> Matrix:
    """(g,) std of geometry parameters, in tolerances, without the tolerance of each its own (that of the
    others stays): what the data add, nothing for those that are `unbounded` (g,)."""
    added = np.where(unbounded, 0.0, 1 / scaled_std**2 - 1)
    return np.where(added > _NO_INFORMATION, 1 / np.sqrt(np.maximum(added, _NO_INFORMATION)), np.inf)


def _statuses(parameters: Parameters, scaled_std: Matrix) -> tuple[tuple[Status, ...], Matrix]:
    """Status and data_std (internal units) of every parameter from those of the free ones (f,)."""
    data_std = parameters.unscaled(scaled_std)
    status: list[Status] = []
    for item, std in zip(parameters.items, data_std, strict=True):
        if item.held:
            status.append("held")
        elif std >= item.prior_std:
            status.append("unidentifiable")
        else:
            status.append("weak" if std > item.tolerance else "identified")
    return tuple(status), data_std


def _exact_directions(judged: _Judged) -> list[NullDirection]:
    """Name the null space direction by direction: known mechanisms first, then what is left."""
    problem, gauge = judged.problem, judged.gauge.basis
    named: list[tuple[Matrix, Mechanism]] = []
    left = gauge  # what of the gauge is orthogonal to the directions found
    for mechanism in mechanisms(problem):
        if left.shape[1] == 0:
            break
        if (mechanism.support & problem.parameters.tolerated).any():
            continue  # no gauge has a part of what has a tolerance
        support = mechanism.support[problem.parameters.untolerated]
        if not support.any():
            continue
        # All null directions within the support: two of them may share a part, such as the target's.
        _, singular, right = np.linalg.svd(gauge[~support], full_matrices=True)
        singular = np.append(singular, np.zeros(gauge.shape[1] - len(singular)))
        within = gauge @ right[singular <= PART].T
        fresh, amount, _ = np.linalg.svd(within.T @ left, full_matrices=False)
        for direction in (within @ fresh[:, amount > _NEW]).T:
            named.append((direction, mechanism))
        if named:
            taken = np.array([direction for direction, _ in named]).T
            left = gauge @ complement(np.linalg.qr(gauge.T @ taken)[0])
    named += [(column, unexplained(problem, column)) for column in left.T]
    directions = [
        _named(judged, direction, "exact" if i < judged.gauge.dimension else "noise", mechanism)
        for i, (direction, mechanism) in enumerate(named)
    ]
    return _with_slight(judged, directions, [direction for direction, _ in named])


def _with_slight(
    judged: _Judged, directions: list[NullDirection], vectors: list[Matrix]
) -> list[NullDirection]:
    """The directions of the null space, their `vectors` (m,) given, with what of it is in no combination."""
    slight: dict[int, list[str]] = {}
    for row in np.flatnonzero(judged.gauge.part | judged.gauge.exact_part):
        name = judged.untolerated[row].name
        if directions and not any(name in direction.combination for direction in directions):
            most = int(np.argmax([abs(vector[row]) for vector in vectors]))
            slight.setdefault(most, []).append(name)
    return [replace(each, slight=tuple(slight.get(k, ()))) for k, each in enumerate(directions)]


def _noise_directions(judged: _Judged) -> list[NullDirection]:
    """Directions that the noise hides: worse than the prior, or the main cause of a poor offset."""
    spectrum, gauge, items = judged.spectrum, judged.gauge, judged.untolerated
    status = [judged.status[i] for i in np.flatnonzero(judged.problem.parameters.untolerated)]
    # (m, k) the variance that each direction gives each parameter.
    share = (spectrum.directions / spectrum.singular) ** 2
    chosen: dict[int, list[int]] = {int(k): [] for k in np.flatnonzero(spectrum.singular < _AS_KNOWN)}
    for row, (item, state) in enumerate(zip(items, status, strict=True)):
        poor = state in ("weak", "unidentifiable") and not (gauge.part[row] or gauge.exact_part[row])
        if item.group == "offset" and poor:
            chosen.setdefault(int(np.argmax(share[row])), []).append(row)
    std = np.sqrt(share.sum(axis=1))
    alone = list(_alone(judged)) if chosen else []
    null_directions: list[NullDirection] = []
    explained: list[Matrix] = []
    for k in sorted(chosen, key=lambda k: spectrum.singular[k]):
        direction, value = spectrum.directions[:, k], float(spectrum.singular[k])
        mechanism = None
        for candidate, vector, by_itself in alone:
            if any(abs(vector @ known) > 0.9 for known in explained):
                continue
            # It must be this direction, not another that happens to be as weak; or be enough alone.
            same = by_itself <= _AS_NEARLY_NULL * value and abs(vector @ direction) >= 0.5
            if same or any(
                abs(vector[row]) / by_itself >= _enough(items[row], status[row], std[row])
                for row in chosen[k]
            ):
                direction, mechanism = vector, candidate
                break
        mechanism = mechanism or _by_tolerances(judged, direction) or unexplained(judged.problem, direction)
        explained.append(direction)
        null_directions.append(_named(judged, direction, "noise", mechanism))
    return null_directions


def _alone(judged: _Judged) -> Iterator[tuple[Mechanism, Matrix, float]]:
    """Each mechanism with (m,) the direction that it hides best, were all other parameters known, and the
    singular value of that. The tolerances of what is part of it count."""
    parameters = judged.problem.parameters
    for mechanism in mechanisms(judged.problem):
        support = mechanism.support & parameters.untolerated
        if not support.any():
            continue
        columns = judged.nominal[:, mechanism.support[parameters.free]]
        root = Marginal.of(columns, parameters.tolerated[mechanism.support & parameters.free]).root
        _, values, right = np.linalg.svd(root, full_matrices=False)
        if len(values) < support.sum():
            continue
        vector = np.zeros(len(parameters))
        vector[support] = right[-1]
        yield mechanism, vector[parameters.untolerated], float(max(values[-1], ROUNDING))


def _by_tolerances(judged: _Judged, direction: Matrix) -> Mechanism | None:
    """The mechanism of tolerances that set most of a direction's variance, or None where they do not."""
    shares = judged.marginal.shares(direction)
    if too_few_measurements(judged.problem) or shares.sum() < MOST:
        return None
    items = [judged.problem.parameters.items[i] for i in judged.problem.tolerated]
    largest = [int(i) for i in np.argsort(-shares)[:_LARGEST_TOLERANCES]]
    named = [items[i] for i in largest if shares[i] >= shares[largest[0]] / 2]
    cause = WithinTolerances(
        float(min(shares.sum(), 1.0)),
        tuple(NamedTolerance(item.name, item.prior_std * item.display, item.unit) for item in named),
    )
    return Mechanism(_NO_SUPPORT, cause)


def _enough(item: Parameter, status: Status, std: float) -> float:
    """The std, in prior stds, that a mechanism alone must give an offset to be its reason: what makes it
    unidentifiable; of one that is weak most of its `std`."""
    return 1.0 if status == "unidentifiable" else max(item.tolerance / item.prior_std, _MOST * std)


def _named(
    judged: _Judged, direction: Matrix, kind: Literal["exact", "noise"], mechanism: Mechanism
) -> NullDirection:
    """The direction as a combination of named parameters, the large terms first, the largest +1."""
    root = judged.marginal.root
    effect = np.abs(direction) * np.linalg.norm(root, axis=0)
    large = (effect >= _NEGLIGIBLE * effect.max()) | (np.abs(direction) >= 0.01 * np.abs(direction).max())
    large &= np.abs(direction) > PART * np.abs(direction).max()
    order = [int(i) for i in np.argsort(-np.abs(direction)) if large[i]]
    if not mechanism.support.any():
        order = order[:_LARGEST_TERMS]
    effect_size = max(float(np.linalg.norm(root @ direction)), ROUNDING)
    weights = direction / direction[order[0]]
    combination = {judged.untolerated[i].name: float(weights[i]) for i in order}
    cause, std = mechanism.cause, None if kind == "exact" else 1 / effect_size
    if isinstance(cause, CommonMotion | Equivalent):
        lost = judged.status[judged.problem.parameters.index(next(iter(combination)))] == "unidentifiable"
        cause = replace(cause, hidden=lost or std is None or std >= 1)
    return NullDirection(combination, kind, cause, std)
