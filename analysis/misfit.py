"""Does the model describe the measurements at all? Nine criteria, each with its figures; one is enough.

An interval follows from the noise and from the model. Where the model is not the arm, no status can be relied
on, however small the standard uncertainties. So a misfit is decided beside the statuses, by what the
statuses do not see:

    chi-squared          residuals (with priors, where no number is left over) against the stated noise
    noise factor         an estimated noise that is beyond what the header calls plausible
    nominal geometry     links within typical tolerances that explain what the nominal ones leave
    prior                an estimate that contradicts what is known of it beforehand
    tight prior          estimates that are together larger than their tolerances allow (`tight_priors`)
    placements           offsets that differ from placement to placement by more than each scatters
    moved target         a target that was displaced between two measurements
    steps                measurements of one recording that are off together, as if the target had slipped
    change               a zero that jumped or drifted during the run, or a target that drifted; where no
                         other criterion says that something is wrong, or only that a target moved
    repeats      where another criterion says that something is wrong: most of it is that what was measured
                 again differs from the first time, which no model of the arm explains

Nominal geometry, placements and steps need no stated noise: their yardstick is the scatter that is left with
links, and within the placements and recordings. So a misfit cannot vanish into a noise that is estimated from
the very residuals that it causes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import scipy

from ..model.arrays import Index, Matrix
from ..model.errors import UnsoundResult
from ..model.likelihood.geometry import kind_of_axis
from ..model.likelihood.noise import COMMON
from ..model.likelihood.parameters import Parameter
from ..model.likelihood.problem import Problem
from ..model.records import key, record
from .estimation.fit import CONTRADICTED, LikelihoodFit, noise_dof
from .left_over import Contradiction, LeftOver
from .observability.changes import (
    Displacement,
    RepeatsApart,
    RunChange,
    repeats_apart,
    run_change,
    run_change_with_links,
)
from .observability.geometry_result import TYPICAL_DEG, TYPICAL_MM, link_columns
from .observability.identifiability import Identified
from .recordings.recordings import placements
from .recordings.steps import RecordingStep, resting_columns
from .status import LACK_OF_FIT, has_numbers

_DETERMINED = 0.1  # of a prior variance: directions of which the data say less are not tested
_HALVINGS = 60
_LARGEST = 1e4  # times the stated tolerance


@record
class TightPrior(Contradiction):
    """A group of estimates against their tolerances: chi-squared `chi2` with `dof` degrees of freedom, the
    p-value by Bonferroni's bound over the groups that are tested.

    `of` is a kind of the geometry (length, angle, gravity, harmonics), or what has the tolerance: the tool, a
    reflector. The tolerances would have to be `times` as large: `needed` in place of `stated` (deg or mm),
    None where they differ. `assumed`: nobody has stated that tolerance. `largest` is the parameter that is
    furthest off, at `estimate`.
    """

    kind: Literal["tight_prior"] = field(default="tight_prior", kw_only=True)

    of: str
    unit: str
    times: float
    stated: float | None
    largest: str
    estimate: float
    chi2: float
    dof: int
    p_value: float
    assumed: bool = False

    @property
    @key("needed")
    def needed(self) -> float | None:
        return None if self.stated is None else self.times * self.stated


def tight_priors(fit: LikelihoodFit) -> list[TightPrior]:
    """The groups of tolerances that are contradicted at a converged fit, the one that explains most first."""
    tolerances = Tolerances(fit)
    names: list[tuple[str, str]] = []
    contradicted: list[TightPrior] = []
    while True:
        judged = {
            name: p_value
            for name in tolerances.groups
            if name not in names and (p_value := tolerances.judged(name)[2]) < LACK_OF_FIT
        }
        if not judged:
            return contradicted
        name = max(judged, key=lambda one: tolerances.likeliest(one)[1])
        names.append(name)
        contradicted.append(tolerances.row(name))
        tolerances.widen(name)


class Tolerances:
    """The tolerated parameters of a fit that are estimated: places `groups` of each kind among them, z and
    its covariance over arms within the tolerances, of which some are widened."""

    def __init__(self, fit: LikelihoodFit) -> None:
        parameters = fit.problem.parameters
        self._fit = fit
        free = np.flatnonzero(parameters.free)
        among = [k for k, i in enumerate(free.tolist()) if parameters.items[i].tolerated]
        self._parameters = free[among]
        items = [parameters.items[i] for i in self._parameters]
        groups: dict[tuple[str, str], list[int]] = {}
        for k, item in enumerate(items):
            groups.setdefault((_group_of(item), item.unit), []).append(k)
        self._z = fit.z[among]
        left = np.eye(len(among)) - fit.covariance[np.ix_(among, among)]
        self._left: Matrix = (left + left.T) / 2
        self._covariance = self._left.copy()
        shares, directions = np.linalg.eigh(self._left)
        self._along = directions[:, shares > _DETERMINED]
        every = {name: np.array(places) for name, places in groups.items()}
        self.groups = {name: places for name, places in every.items() if self._directions(places).size}

    def _directions(self, places: Index) -> Matrix:
        """(g, k) of a group those that the data determine."""
        shares, directions = np.linalg.eigh(self._left[np.ix_(places, places)])
        return np.asarray(directions[:, shares > _DETERMINED])

    def judged(self, name: tuple[str, str]) -> tuple[float, int, float]:
        """Chi-squared of a group, degrees of freedom, and the p-value after all groups that are tested."""
        places = self.groups[name]
        along = self._directions(places)
        z = along.T @ self._z[places]
        covariance = along.T @ self._covariance[np.ix_(places, places)] @ along
        chi2 = float(z @ np.linalg.solve(covariance, z))
        return chi2, len(z), min(1.0, len(self.groups) * float(scipy.special.chdtrc(len(z), chi2)))

    def likeliest(self, name: tuple[str, str]) -> tuple[float, float]:
        """The factor of the tolerances of a group, and the log-likelihood that it gains."""
        root = np.linalg.cholesky(self._along.T @ self._covariance @ self._along)
        columns = np.linalg.solve(root, self._along.T @ self._left[:, self.groups[name]])
        directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        squares = (directions.T @ np.linalg.solve(root, self._along.T @ self._z)) ** 2
        more = _likeliest(squares, sizes**2)
        grown = 1 + more * sizes**2
        gain = float((squares - squares / grown - np.log(grown)).sum()) / 2
        return float(np.sqrt(1 + more)), gain

    def widen(self, name: tuple[str, str]) -> None:
        """The tolerances of a group as large as they would have to be."""
        factor, _ = self.likeliest(name)
        columns = self._left[:, self.groups[name]]
        self._covariance += (factor**2 - 1) * columns @ columns.T

    def row(self, name: tuple[str, str]) -> TightPrior:
        places, parameters = self.groups[name], self._fit.problem.parameters
        chi2, dof, p_value = self.judged(name)
        most = self._parameters[places[int(np.argmax(np.abs(self._z[places])))]]
        item, stds = parameters.items[most], parameters.prior_std[self._parameters[places]]
        return TightPrior(
            of=name[0],
            unit=name[1],
            times=self.likeliest(name)[0],
            stated=float(stds[0]) * item.display if np.allclose(stds, stds[0]) else None,
            largest=item.name,
            estimate=item.shown(float(self._fit.x[most])),
            chi2=chi2,
            dof=dof,
            p_value=p_value,
            assumed=self._assumed(item),
        )

    def _assumed(self, item: Parameter) -> bool:
        if item.group != "geometry":
            return item.assumed
        return kind_of_axis(item.axis) not in self._fit.problem.geometry.stated


def _group_of(item: Parameter) -> str:
    if item.group != "geometry":
        return item.of
    return kind_of_axis(item.axis)


def _likeliest(squares: Matrix, sizes: Matrix) -> float:
    """The m from 0 on at which `squares` (k,) of normals with the variances 1 + m `sizes` are likeliest."""

    def slope(more: float) -> float:
        variance = 1 + more * sizes
        return float(((squares / variance - 1) * sizes / variance).sum())

    low, high = 0.0, _LARGEST**2
    for _ in range(_HALVINGS):
        middle = float(np.sqrt((1 + low) * (1 + high))) - 1
        low, high = (middle, high) if slope(middle) > 0 else (low, middle)
    return low


BEYOND_PRIOR = 4.0  # prior stds: one in 16,000 estimates of a normal is further off
# Between placements over within, as a ratio of stds. Neighbouring measurements are correlated: on real arms
# their effective number is up to 2.5 times smaller, which alone makes a factor of 1.6. By nominal geometry
# four real arms have 2.1 to 6.7, and three placements of one of them 1.8.
DISAGREES = 1.6
DOUBTED, AGREES = 0.01, 0.05  # p-values of an exact arm, and with links: `exact` is the first suspect
REDUCED = 0.75  # of the residuals: what leaves no more of them is the cause

Geometry = Literal["nominal", "estimated"]
NoiseOf = Literal["all", "joint", "spot"]
_OF_FACTOR: dict[str, NoiseOf] = {"joint": "joint", COMMON: "all"}


@record
class LackOfFit(Contradiction):
    """The residuals are `factor` times what the stated noise explains; `rms_mm` None where that is not at
    hand. `with_priors`: together with the scaled parameters, as no number is left over to test alone."""

    kind: Literal["chi2"] = field(default="chi2", kw_only=True)

    chi2: float
    dof: int
    p_value: float
    rms_mm: float | None = None
    with_priors: bool = False
    geometry: Geometry = "nominal"

    @property
    @key("factor")
    def factor(self) -> float:
        """Root of chi-squared over its degrees of freedom."""
        return float(np.sqrt(self.chi2 / self.dof))


@record
class ImplausibleNoise(Contradiction):
    """An estimated noise `factor` whose 99.8 % `interval` lies beyond `plausible` times the stated noise, or
    below 1 over it: that of all readings, of the joints, or of the spot."""

    kind: Literal["noise_factor"] = field(default="noise_factor", kw_only=True)

    of: NoiseOf
    factor: float
    interval: tuple[float, float]
    plausible: float


@dataclass(frozen=True)
class RatioTest:
    """`factor` is the root of the mean square that some columns explain (`rank` degrees of freedom) over the
    mean square that is left (`dof`)."""

    factor: float
    rank: int
    dof: int
    p_value: float


@dataclass(frozen=True)
class FTest(RatioTest):
    """The residuals are `before` and `after` times the stated noise (root mean squares)."""

    before: float
    after: float

    @property
    def significant(self) -> bool:
        return self.p_value < LACK_OF_FIT and self.factor > DISAGREES


@record
class NominalContradicted(Contradiction, FTest):
    """Links within typical tolerances explain what nominal geometry leaves."""

    kind: Literal["nominal_geometry"] = field(default="nominal_geometry", kw_only=True)


@dataclass(frozen=True)
class ExactDoubted:
    """An arm that is taken as exact: the residuals have the p-value `p_value`, below `DOUBTED`, and `typical`
    with links within typical tolerances (`length_mm`, `angle_deg`), which no arm is without."""

    p_value: float
    typical: float
    length_mm: float
    angle_deg: float


@dataclass(frozen=True)
class OffPrior:
    """An estimate `stds` prior stds from its prior mean; None where the data do not determine it, but the fit
    takes it as far."""

    name: str
    stds: float | None


@record
class BeyondPrior(Contradiction):
    """Parameters whose estimates are beyond `limit` prior stds."""

    kind: Literal["prior"] = field(default="prior", kw_only=True)

    parameters: tuple[OffPrior, ...]
    limit: float = BEYOND_PRIOR


@record
class PlacementsDisagree(Contradiction, RatioTest):
    """Offsets of their own for each placement would fit so much better: they are the columns, and the rest is
    left within the placements; `most` is the placement whose own offsets explain most."""

    kind: Literal["placements"] = field(default="placements", kw_only=True)

    placements: tuple[str, ...]
    most: str
    geometry: Geometry = "nominal"


Criterion = (
    LackOfFit
    | ImplausibleNoise
    | NominalContradicted
    | BeyondPrior
    | TightPrior
    | PlacementsDisagree
    | Displacement
    | RecordingStep
    | RunChange
    | RepeatsApart
)

_CONFUSED_WITH_LINKS = (BeyondPrior, Displacement, RecordingStep)  # links of an exact arm may pass for them


@record
class Misfit:
    """The model does not describe the measurements, by one criterion or several."""

    criteria: tuple[Criterion, ...]

    def __post_init__(self) -> None:
        if not self.criteria:
            raise UnsoundResult("a misfit by no criterion")


def misfit_of(
    fit: LikelihoodFit,
    identified: Identified,
    moved: Displacement | None = None,
    steps: Sequence[RecordingStep] = (),
) -> Misfit | None:
    """What speaks against the model at a converged fit; None where nothing does. `moved` is a significant
    displacement of a target, `steps` are the significant steps of the recordings."""
    criteria: tuple[Criterion, ...] = (
        *_lack_of_fit(fit, identified.facts.rank),
        *_implausible_noise(fit, identified),
        *_beyond_prior(fit, identified),
        *_disagreement(fit),
        *(() if moved is None else (moved,)),
        *steps,
    )
    if all(isinstance(criterion, BeyondPrior) for criterion in criteria):
        criteria += (*_contradicted_links(fit), *tight_priors(fit))
    elif all(isinstance(criterion, _CONFUSED_WITH_LINKS) for criterion in criteria):
        criteria = (*(one for one in _contradicted_links(fit) if one.after < REDUCED * one.before), *criteria)
    if all(isinstance(criterion, Displacement) for criterion in criteria):  # or it was a zero that changed
        criteria += tuple(_changed(fit))
    if criteria and (apart := repeats_apart(fit.problem, fit.whitened)) is not None:
        criteria = (apart, *criteria)
    return Misfit(criteria) if criteria else None


def _changed(fit: LikelihoodFit) -> Iterator[Criterion]:
    """What changed during the run. Of an exact arm links within typical tolerances are the first suspect."""
    changed = run_change(fit.problem, fit.x, resting_columns(fit))
    if changed is None or fit.problem.geometry:
        yield from () if changed is None else (changed,)
        return
    changed = run_change_with_links(fit.problem, fit.x)
    yield from _links_test(fit) if changed is None else (changed,)


def _lack_of_fit(fit: LikelihoodFit, rank: int) -> Iterator[LackOfFit]:
    chi2, dof, p_value = fit.against_noise(rank)
    if p_value is not None and p_value < LACK_OF_FIT:
        yield LackOfFit(
            chi2, dof, p_value, fit.problem.rms_mm(fit.whitened.residual_mm), geometry=_geometry(fit.problem)
        )
    elif fit.p_value is not None and fit.p_value < CONTRADICTED:
        residual, rms_mm = fit.whitened.residual, fit.problem.rms_mm(fit.whitened.residual_mm)
        whole = float(residual @ residual + fit.z @ fit.z)
        yield LackOfFit(whole, len(residual), fit.p_value, rms_mm, with_priors=True)


def _implausible_noise(fit: LikelihoodFit, identified: Identified) -> Iterator[ImplausibleNoise]:
    """Of factors by n degrees of freedom: n times the estimate's square over the true one's is chi-squared.

    A factor of its own for joints or spot has as many as make its std: 1 / (2 n) is the variance of the
    logarithm (that of the data alone).
    """
    problem = fit.problem
    if problem.noise.estimated:
        yield from _beyond("all", float(1 / np.sqrt(fit.weight)), noise_dof(fit), problem.noise.plausible)
    elif problem.noise.separate:
        block = problem.parameters.block("noise")
        for i in range(block.start, block.stop):
            item = problem.parameters.items[i]
            if has_numbers(identified.status[i]):
                of = _OF_FACTOR.get(item.axis, "spot")
                dof = float(1 / (2 * identified.data_std[i] ** 2))
                yield from _beyond(of, float(np.exp(fit.x[i])), dof, problem.noise.plausible)


def _beyond(of: NoiseOf, factor: float, dof: float, plausible: float) -> Iterator[ImplausibleNoise]:
    low = factor * float(np.sqrt(dof / scipy.special.chdtri(dof, LACK_OF_FIT)))
    high = factor * float(np.sqrt(dof / max(scipy.special.chdtri(dof, 1 - LACK_OF_FIT), 1e-300)))
    if low > plausible or high < 1 / plausible:
        yield ImplausibleNoise(of, factor, (low, high), plausible)


def _beyond_prior(fit: LikelihoodFit, identified: Identified) -> Iterator[BeyondPrior]:
    parameters, free = fit.problem.parameters, np.flatnonzero(fit.problem.parameters.free)
    off = [
        OffPrior(parameters.names[i], float(z) if has_numbers(identified.status[i]) else None)
        for i, z in zip(free, fit.z, strict=True)
        if abs(z) > BEYOND_PRIOR and parameters.items[i].group != "noise"
    ]
    if off:
        yield BeyondPrior(tuple(off))


def _left_over(fit: LikelihoodFit) -> tuple[LeftOver, Matrix]:
    """What no parameter of a fit can explain, whatever its prior, and the scale (M, 1) of its rows.

    Measurements count by their effective number only where the geometry is estimated: what nominal geometry
    leaves is correlated by itself, and the effective number must not excuse it."""
    problem, whitened, d = fit.problem, fit.whitened, fit.problem.tool.residual_size
    once, numbers = np.ones(len(whitened.residual)), float(problem.measured_size)
    if not problem.geometry:
        once[: problem.shots * d] = np.repeat(1 / np.sqrt(problem.weights), d)
        numbers += float(problem.sizes @ (1 - problem.weights))
    left = LeftOver.without_priors(
        whitened.residual * once,
        whitened.jacobian[:, problem.parameters.free] * once[:, None],
        (problem.shots, d),
        round(numbers),
        known=False,
    )
    return left, once[:, None]


def _f_test(left: LeftOver, columns: Matrix) -> FTest | None:
    """Of whitened columns (M, k) of the left-over; None without degrees of freedom."""
    explained = left.explained(left.reached(columns), 0.5)
    rank = int(explained.rank[0])
    if rank == 0:
        return None
    rest, dof = left.rest(explained, 0)
    within = rest / dof
    return FTest(
        factor=float(np.sqrt(explained.drop[0] / rank / within)),
        rank=rank,
        dof=dof,
        p_value=left.p_value(explained, 0),
        before=float(np.sqrt(left.chi2 / (dof + rank))),
        after=float(np.sqrt(within)),
    )


def exact_doubted(fit: LikelihoodFit) -> ExactDoubted | None:
    """Whether residuals that noise hardly explains are as expected once links deviate as those of a typical
    arm, at the linearised fit; None where nothing speaks against an exact arm, or the noise is not known."""
    if not fit.problem.noise.known or (links := link_columns(fit.problem, fit.x)) is None:
        return None
    left, once = _left_over(fit)
    if left.numbers <= 0:
        return None
    taken = float(left.of(links * once).drop(1.0)[0])
    p_value, typical = (
        float(scipy.special.chdtrc(left.numbers, chi2)) for chi2 in (left.chi2, left.chi2 - taken)
    )
    if p_value >= DOUBTED or typical < AGREES:
        return None
    return ExactDoubted(p_value, typical, TYPICAL_MM, TYPICAL_DEG)


def _contradicted_links(fit: LikelihoodFit) -> Iterator[NominalContradicted]:
    """What all links of an exact arm significantly explain."""
    return (test for test in _links_test(fit) if test.significant)


def _links_test(fit: LikelihoodFit) -> Iterator[NominalContradicted]:
    """The F-test of all links against nominal geometry, at the linearised fit."""
    links = link_columns(fit.problem, fit.x)
    if links is None:
        return
    left, once = _left_over(fit)
    explained = _f_test(left, links * once)
    if explained is not None:
        yield NominalContradicted(**vars(explained))


def _disagreement(fit: LikelihoodFit) -> Iterator[PlacementsDisagree]:
    """The F-test of offsets of their own for every placement, at the linearised fit."""
    problem, groups = fit.problem, placements(fit.problem)
    if len(groups) < 2:
        return
    (left, once), d = _left_over(fit), problem.tool.residual_size
    by_offsets = fit.whitened.jacobian[:, problem.parameters.free & problem.parameters.group("offset")] * once
    by_group = []
    for group in groups:
        rows = (group.rows[:, None] * d + np.arange(d)).ravel()
        columns = np.zeros_like(by_offsets)
        columns[rows] = by_offsets[rows]
        by_group.append(columns)
    explained = _f_test(left, np.hstack(by_group))
    if explained is not None and explained.significant:
        by_one = [left.explained(left.reached(columns), 0.5).drop[0] for columns in by_group]
        most = groups[int(np.argmax(by_one))].name
        names = tuple(group.name for group in groups)
        figures = (explained.factor, explained.rank, explained.dof, explained.p_value)
        yield PlacementsDisagree(*figures, names, most, _geometry(problem))


def _geometry(problem: Problem) -> Geometry:
    return "estimated" if problem.geometry else "nominal"
