"""What an answer says of the arm's geometry: tolerances, the model ladder, and consider analysis: the worth
of a calibration with nominal geometry if the arm has tolerances.

The estimate that takes the geometry as nominal is not changed; its uncertainty gets what the deviations of
the links do to it (Schmidt 1966; Bierman 1977, chapter 8):

    P_c = P + G C_g G',  G = -P H' R^-1 H_g

with P its stated covariance, H and H_g the Jacobians by what is estimated and by the geometry, and C_g the
tolerances. It costs one Jacobian, and needs no measurement: a plan's is known before.

And what an answer takes as known besides the measurements, stated in the header or assumed, with what each
does to the uncertainties (`bases`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.files.header import TOLERANCE_KEYS, GeometryKind, Header
from ...model.instruments.kind import Assumption
from ...model.likelihood.geometry import Geometry, kind_of_axis
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..estimation.tolerance_factors import Factors
from ..status import Status, has_numbers

TYPICAL_MM, TYPICAL_DEG = 0.3, 0.1  # of the links of industrial arms, as measured on ten of them


def with_links(problem: Problem, x: Matrix) -> tuple[Problem, Matrix]:
    """The problem with the geometry that it states, or with typical tolerances of the links where it states
    none; and x (p,) there."""
    if problem.geometry:
        return problem, x
    whole = problem.with_geometry(Geometry.of_links(problem.robot, TYPICAL_MM, TYPICAL_DEG))
    return whole, whole.parameters.with_values(whole.parameters.prior_mean, problem.parameters, x)


def link_columns(problem: Problem, x: Matrix) -> Matrix | None:
    """(M, g) what links of typical tolerances do to the whitened residuals at x (p,), each by one std; None
    where the geometry is estimated: there it is no rival of other explanations."""
    if problem.geometry:
        return None
    whole, jacobian = _with_links_whitened(problem, x.tobytes())
    return jacobian[:, whole.tolerated]


@lru_cache(maxsize=1)  # one run calls it several times
def _with_links_whitened(problem: Problem, x: bytes) -> tuple[Problem, Matrix]:
    """The problem of `with_links`, and (M, p) its whitened Jacobian."""
    whole, at = with_links(problem, np.frombuffer(x))
    jacobian = whole.whiten(at).jacobian
    jacobian.flags.writeable = False
    return whole, jacobian


def considered(problem: Problem, x: Matrix, weight: float = 1.0) -> Matrix:
    """(p,) std at x (p,), internal units, of the estimates that take the geometry as nominal, if the arm has
    the tolerances of `with_links`; nan of what is held, of noise factors and of the geometry itself. `weight`
    is 1 / noise scale^2."""
    parameters = problem.parameters
    whole, jacobian = _with_links_whitened(problem, x.tobytes())
    parameters_with_links, jacobian = whole.parameters, jacobian.copy()
    jacobian[: problem.shots * problem.tool.residual_size] *= np.sqrt(weight)
    estimated = (
        parameters_with_links.free & ~parameters_with_links.tolerated & ~parameters_with_links.group("noise")
    )
    by_own, by_geometry = jacobian[:, estimated], jacobian[:, whole.tolerated]
    covariance = np.linalg.inv(by_own.T @ by_own + np.eye(by_own.shape[1]))
    moved = covariance @ (by_own.T @ by_geometry)
    std = np.sqrt(np.diag(covariance) + (moved**2).sum(axis=1)) * parameters_with_links.prior_std[estimated]
    result = np.full(len(parameters), np.nan)
    result[parameters.free & ~parameters.tolerated & ~parameters.group("noise")] = std
    return result


LARGEST_SHARE = 1 - 1e-9  # of a variance: what is determined owes something to the measurements


def tolerance_share(problem: Problem, covariance: Matrix) -> Matrix:
    """(f,) the share of each variance of the scaled free parameters, covariance (f, f), that the tolerances
    of the geometry set: C L C over C, with their part L of the prior information. Below 1: where noise or
    factors of the tolerances are estimated, C is not the inverse of information and prior to the last digit.
    """
    at = problem.parameters.among_free[problem.tolerated]
    return np.asarray(np.minimum((covariance[:, at] ** 2).sum(axis=1) / np.diag(covariance), LARGEST_SHARE))


def with_tolerances(problem: Problem, covariance: Matrix, factor: float) -> Matrix:
    """(f,) the stds of the scaled free parameters, were all tolerances `factor` times as large.

    All nan where there is no such answer: at the mode of a model that does not describe the data the
    curvature may be less than that of the prior alone.
    """
    information = np.linalg.inv(covariance)
    at = problem.parameters.among_free[problem.tolerated]
    information[at, at] += 1 / factor**2 - 1
    try:
        root = np.linalg.inv(np.linalg.cholesky((information + information.T) / 2))
    except np.linalg.LinAlgError:
        return np.full(len(information), np.nan)
    return np.asarray(np.sqrt((root**2).sum(axis=0)))


Tolerance = float | tuple[float, ...]
RungName = Literal["offsets", "geometry", "gravity", "harmonics"]


@dataclass(frozen=True)
class Rung:
    """One model of the ladder: how many parameters it frees, the root mean square of the residuals at
    placements that it has not seen (None with a single placement), its log evidence, and whether the answer
    keeps it."""

    rung: RungName
    parameters: int
    held_out_rms_mm: float | None
    log_evidence: float
    kept: bool


@dataclass(frozen=True)
class Confounded:
    """The posterior `correlation` of an offset with a geometry or tool parameter that is estimated with it.
    The data need not determine that parameter: it may be the reason why the offset is known no better."""

    offset: str
    parameter: str
    correlation: float


@record
class LinkTolerances:
    """Tolerances of the links."""

    length_mm: Annotated[Tolerance, it("of each length, millimetres: a number or a list")]
    angle_deg: Annotated[Tolerance, it("of each angle, degrees: a number or a list")]


@record
class GeometryResult:
    """The geometry of an answer; offsets that the data do not determine have no numbers here."""

    tolerance: Annotated[
        LinkTolerances | None,
        it("as the header states it; null without the key `geometry`: the geometry is then nominal"),
    ]
    considered_tolerance: Annotated[
        LinkTolerances, it("the same, or 0.3 mm and 0.1° of all links where the header states none")
    ]
    factors: Annotated[
        Factors | None,
        it(
            "with `scale: estimated` by what the data multiply the tolerances: `length`, `angle`, `gravity`,"
            " `harmonics` (null where nothing of the kind is estimated), and `log_u`, the standard"
            " uncertainty of the logarithm of each; else null"
        ),
    ]
    ladder: Annotated[
        tuple[Rung, ...],
        it(
            "the models that were tried, empty for nominal geometry: `rung` (`offsets`: nominal "
            "geometry; `geometry`; `gravity`; `harmonics`), `parameters` (how many are free), "
            "`held_out_rms_mm` (of the residuals at placements that the model has not seen; null with"
            " one placement), `log_evidence`, `kept`"
        ),
    ]
    consider: Annotated[
        dict[str, float],
        it(
            "by offset name, the standard uncertainty if the offset is estimated with nominal "
            "geometry and the arm has the considered tolerances (consider analysis); null where the "
            "offset is unidentifiable"
        ),
    ]
    at_half: Annotated[
        dict[str, float | None],
        it(
            "by offset name, what `std` would be at half the tolerances; empty for nominal geometry and "
            "with `factors`; null where the model does not describe the data"
        ),
    ]
    at_twice: Annotated[dict[str, float | None], it("the same at twice the tolerances")]
    confounded: Annotated[
        tuple[Confounded, ...],
        it(
            "of each `offset` the geometry parameter, and the `parameter` of a free tool, with which "
            "it has the largest `correlation`; empty for nominal geometry. The parameter itself may "
            "be unidentifiable"
        ),
    ] = ()


def geometry_result(
    header: Header,
    problem: Problem,
    x: Matrix,
    covariance: Matrix,
    status: tuple[Status, ...],
    *,
    weight: float = 1.0,
    ladder: tuple[Rung, ...] = (),
    factors: Factors | None = None,
) -> GeometryResult:
    """Of a problem at x (p,) with the covariance (f, f) of its scaled free parameters."""
    parameters = problem.parameters

    def of_offsets(std: Matrix) -> dict[str, float]:
        return {
            item.name: float(std[i]) * item.display
            for i, item in enumerate(parameters.items)
            if item.group == "offset" and has_numbers(status[i])
        }

    def at(factor: float) -> dict[str, float | None]:
        if factors is not None or not len(problem.tolerated):
            return {}
        stds = of_offsets(parameters.unscaled(with_tolerances(problem, covariance, factor)))
        return {name: std if np.isfinite(std) else None for name, std in stds.items()}

    geometry = header.arm
    considered_tolerance = LinkTolerances(TYPICAL_MM, TYPICAL_DEG)
    if geometry is not None:
        links = geometry.tolerance
        considered_tolerance = LinkTolerances(links.length_mm, links.angle_deg)
    return GeometryResult(
        tolerance=None if geometry is None else considered_tolerance,
        considered_tolerance=considered_tolerance,
        factors=factors,
        ladder=ladder,
        consider=of_offsets(considered(problem, x, weight)),
        at_half=at(0.5),
        at_twice=at(2.0),
        confounded=tuple(_confounded(problem, covariance, status)),
    )


def _confounded(problem: Problem, covariance: Matrix, status: tuple[Status, ...]) -> Iterator[Confounded]:
    """Of each offset that is determined, among free geometry: the largest correlation, by group."""
    if not len(problem.tolerated):
        return
    parameters = problem.parameters
    std = np.sqrt(np.diag(covariance))
    for i, item in enumerate(parameters.items):
        if item.group != "offset" or item.held or not has_numbers(status[i]):
            continue
        row = int(parameters.among_free[i])
        correlation = covariance[row] / (std * std[row])
        for group in ("geometry", "tool"):
            rivals = np.flatnonzero(parameters.free & parameters.group(group))
            if len(rivals):
                by_rival = correlation[parameters.among_free[rivals]]
                k = int(np.argmax(np.abs(by_rival)))
                yield Confounded(item.name, parameters.names[rivals[k]], float(by_rival[k]))


_VARIANCE = 1e-12  # of a tolerance: what the data know better is not known by it


@record
class Size:
    """How far something may be from what is taken as known: a standard deviation in its unit."""

    std: Annotated[Tolerance, it("standard deviation; of links a list, one for each")]
    unit: Annotated[str, it("`deg` or `mm`")]
    of: Annotated[
        GeometryKind | None, it("of the arm: `length`, `angle`, `gravity` or `harmonics`; else null")
    ] = None


@record
class Basis:
    """One thing that is taken as known: a part of an instrument, or of the arm."""

    of: Annotated[str, it("label of the instrument, `tool`, or `arm`")]
    kind: Annotated[str, it("of the instrument, or `arm`")]
    part: Annotated[str, it("`mounting`, `tip`, `frame`, `mount`, `links`, or the name of a reflector")]
    stated: Annotated[bool, it("whether the header says how well it is known; else that is assumed")]
    keys: Annotated[tuple[str, ...], it("the keys of the header that say so")]
    sizes: Annotated[
        tuple[Size, ...], it("how well it is known, a list of `std` and `unit`; empty: it is taken as exact")
    ]
    offset: Annotated[str | None, it("the offset to which it does most, else null")] = None
    unit: Annotated[str | None, it("of `u`")] = None
    u: Annotated[float | None, it("standard uncertainty of that offset")] = None
    u_if_exact: Annotated[float | None, it("the same, were it known exactly")] = None


def bases(
    problem: Problem, covariance: Matrix, status: Sequence[Status], header: Header
) -> tuple[Basis, ...]:
    """Of the tool and the instruments, then of the arm; `covariance` (f, f) is that of the scaled free
    parameters, not finite without an answer."""
    rows = [(basis, _marked(problem, basis)) for basis in _of_instruments(problem.tool.taken_as_known)]
    rows += [(basis, _of_sizes(problem, basis)) for basis in _of_arm(problem.geometry, header)]
    return tuple(_with_effect(problem, covariance, status, basis, places) for basis, places in rows)


def _of_instruments(every: Sequence[Assumption]) -> Iterator[Basis]:
    def of(one: Assumption) -> tuple[str, str, str, bool]:
        return one.label, one.kind, one.part, one.stated

    for (label, kind, part, by_header), some in groupby(sorted(every, key=of), of):
        group = list(some)
        sizes = tuple(Size(one.std, one.unit) for one in group if one.std is not None)
        yield Basis(label, kind, part, by_header, tuple(dict.fromkeys(one.key for one in group)), sizes)


def _of_arm(geometry: Geometry, header: Header) -> Iterator[Basis]:
    """What the header states of the links and of how joints bend, and what is assumed of them."""
    arm = header.arm
    if arm is None:
        yield Basis("arm", "arm", "links", True, ("geometry",), ())
        return
    sizes = [
        Size(arm.tolerance.length_mm, "mm", "length"),
        Size(arm.tolerance.angle_deg, "deg", "angle"),
        *([Size(arm.gravity_deg, "deg", "gravity")] if geometry.gravity else []),
        *([Size(arm.harmonics_deg, "deg", "harmonics")] if geometry.harmonics else []),
    ]
    for by_header in (True, False):
        some = tuple(one for one in sizes if (one.of in geometry.stated) == by_header)
        keys = tuple(f"geometry.{TOLERANCE_KEYS[one.of]}" for one in some if one.of is not None)
        if some:
            yield Basis("arm", "arm", "links", by_header, keys, some)


def _of_sizes(problem: Problem, basis: Basis) -> Mask:
    """(p,) the parameters of the arm whose tolerances it is."""
    kinds = {one.of for one in basis.sizes}
    items = problem.parameters.items
    return np.array(
        [item.group == "geometry" and kind_of_axis(item.axis) in kinds for item in items], dtype=bool
    )


def _marked(problem: Problem, basis: Basis) -> Mask:
    """(p,) the parameters whose tolerances it is."""
    named = {
        (one.of, one.unit)
        for one in problem.tool.taken_as_known
        if (one.label, one.part, one.stated) == (basis.of, basis.part, basis.stated)
    }
    return np.array([(item.of, item.unit) in named for item in problem.parameters.items], dtype=bool)


def _with_effect(
    problem: Problem, covariance: Matrix, status: Sequence[Status], basis: Basis, places: Mask
) -> Basis:
    """With the offset whose variance would fall by the largest share."""
    parameters = problem.parameters
    known = np.flatnonzero(places & parameters.tolerated)
    offsets = [
        i
        for i, item in enumerate(parameters.items)
        if item.group == "offset" and not item.held and has_numbers(status[i])
    ]
    if not len(known) or not offsets or not np.isfinite(covariance).all():
        return basis
    of, among = parameters.among_free[offsets], parameters.among_free[known]
    values, vectors = np.linalg.eigh(covariance[np.ix_(among, among)])
    kept = values > _VARIANCE
    by_known = covariance[np.ix_(of, among)] @ vectors[:, kept]
    before = np.diag(covariance)[of]
    after = np.maximum(before - (by_known**2 / values[kept]).sum(axis=1), 0.0)
    most = int(np.argmin(after / before))
    item = parameters.items[offsets[most]]
    u, exact = (item.prior_std * item.display * float(np.sqrt(each[most])) for each in (before, after))
    return replace(basis, offset=item.name, unit=item.unit, u=u, u_if_exact=exact)
