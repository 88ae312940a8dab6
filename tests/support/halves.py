"""Half against half: the placements of a run in two parts, each solved alone, and their offsets compared.

What an offset differs by, over the standard uncertainty of the difference, says whether the intervals hold:
if they do, its root mean square is 1. Both halves are of one arm with the same tolerances and priors, so part
of the uncertainty is common to both and not in the difference.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from zerobeam.analysis.diagnostics.hold_out import fit_without
from zerobeam.analysis.prediction import Predictor, known_factors
from zerobeam.analysis.recordings.recordings import Placement, placements
from zerobeam.analysis.solution import Solution
from zerobeam.analysis.status import known
from zerobeam.model.arrays import Index
from zerobeam.model.errors import BadInput

_SETTLED = 1e-4  # size of the gradient, in posterior stds: the difference is known far better than each half
_DETERMINED = 0.5  # of the prior's variance: the std without the own prior is then the prior's


@dataclass(frozen=True)
class HalfAgainstHalf:
    """The offsets `names` that the whole and both halves determine; `z` of each, its difference over the std
    of that.

    `difference` and `u` are in rad (mm for prismatic joints). `halves` are the names of the placements of
    either; `converged` False where a half has no answer, and then there are no offsets.
    """

    halves: tuple[tuple[str, ...], tuple[str, ...]]
    names: tuple[str, ...]
    difference: tuple[float, ...]
    u: tuple[float, ...]
    converged: bool

    @property
    def z(self) -> tuple[float, ...]:
        return tuple(d / u for d, u in zip(self.difference, self.u, strict=True))


def half_against_half(solution: Solution, first: Collection[str]) -> HalfAgainstHalf:
    """The placements of the names `first` against all others of a converged solution.

    BadInput where one half is empty or a name is none of a placement.
    """
    problem, x = known_factors(solution.problem, solution.fit.x)
    every = placements(problem)
    names = [placement.name for placement in every]
    if not set(first) < set(names) or not first:
        raise BadInput(
            "these placements are no part of the run that leaves another part",
            found=", ".join(sorted(first)) or "none",
            allowed=f"some of {', '.join(names)}, not all",
        )
    halves = [
        fit_without(problem, x, _joined([own for own in every if (own.name in first) != inside]), _SETTLED)
        for inside in (True, False)
    ]
    ours = tuple(name for name in names if name in first)
    theirs = tuple(name for name in names if name not in first)
    if not all(half.converged for half in halves):
        return HalfAgainstHalf((ours, theirs), (), (), (), converged=False)
    return _compared(solution, (ours, theirs), *(half.calibration for half in halves))


def _joined(group: list[Placement]) -> Placement:
    rows = np.concatenate([placement.rows for placement in group])
    targets = tuple(name for placement in group for name in placement.targets)
    return Placement(", ".join(placement.name for placement in group), targets, np.sort(rows))


def _compared(
    solution: Solution,
    halves: tuple[tuple[str, ...], tuple[str, ...]],
    one: Predictor,
    other: Predictor,
) -> HalfAgainstHalf:
    """With C_h the covariance of what both halves have (all but targets), Lambda the precision of its priors
    and F_h = C_h^-1 - Lambda the information of half h, the difference has the covariance
    (C_1 - C_2) Lambda (C_1 - C_2) + C_1 F_1 C_1 + C_2 F_2 C_2. In prior stds Lambda is I, and that is
    C_1 + C_2 - C_1 C_2 - C_2 C_1."""
    parameters, status = solution.problem.parameters, solution.identified.status
    shared = [
        name
        for name, item in zip(parameters.names, parameters.items, strict=True)
        if not item.held and item.group not in ("target", "noise")
    ]
    first, second = (own.covariance[np.ix_(at, at)] for own in (one, other) for at in [_free(own, shared)])
    variance = np.diag(first + second - first @ second - second @ first)
    names, difference, u = [], [], []
    for i, name in enumerate(shared):
        place = parameters.index(name)
        determined = known(status[place]) and max(first[i, i], second[i, i]) < _DETERMINED
        if parameters.items[place].group == "offset" and determined:
            names.append(name)
            difference.append(one.value(name) - other.value(name))
            u.append(float(np.sqrt(variance[i]) * parameters.prior_std[place]))
    return HalfAgainstHalf(halves, tuple(names), tuple(difference), tuple(u), converged=True)


def _free(own: Predictor, names: list[str]) -> Index:
    parameters = own.problem.parameters
    return np.asarray(parameters.among_free[[parameters.index(name) for name in names]])


def splits(names: Collection[str], count: int, seed: int = 0) -> list[tuple[str, ...]]:
    """At most `count` different first halves of the names, at random; with an even number of names no half
    comes with its other half too."""
    ordered, random = list(names), np.random.default_rng(seed)
    size, found = len(ordered) // 2, dict[tuple[str, ...], None]()
    for _ in range(50 * count):
        own = set(random.choice(len(ordered), size, replace=False).tolist())
        if 2 * size == len(ordered) and 0 not in own:
            own = set(range(len(ordered))) - own
        found[tuple(name for i, name in enumerate(ordered) if i in own)] = None
        if len(found) == count:
            break
    return list(found)


def rms(every: Collection[HalfAgainstHalf]) -> float:
    """Root mean square of all z."""
    return float(np.sqrt(np.mean(np.square([z for own in every for z in own.z]))))
