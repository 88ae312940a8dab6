"""What an answer takes as known besides the measurements, stated in the header or assumed, and what each does
to the uncertainties."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Annotated

import numpy as np

from ...model.arrays import Mask, Matrix
from ...model.files.header import Header
from ...model.instruments.kind import Assumption
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..status import Status, has_numbers
from .geometry_result import GeometryResult, Tolerance

_VARIANCE = 1e-12  # of a tolerance: what the data know better is not known by it


@record
class Size:
    """How far something may be from what is taken as known: a standard deviation in its unit."""

    std: Annotated[Tolerance, it("standard deviation; of links a list, one for each")]
    unit: Annotated[str, it("`deg` or `mm`")]


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
    problem: Problem, covariance: Matrix, status: Sequence[Status], header: Header, geometry: GeometryResult
) -> tuple[Basis, ...]:
    """Of the tool and the instruments, then of the arm; `covariance` (f, f) is that of the scaled free
    parameters, not finite without an answer."""
    rows = [(basis, _marked(problem, basis)) for basis in _of_instruments(problem.tool.taken_as_known)]
    rows.append((_of_arm(header, geometry), problem.parameters.group("geometry")))
    return tuple(_with_effect(problem, covariance, status, basis, places) for basis, places in rows)


def _of_instruments(every: Sequence[Assumption]) -> Iterator[Basis]:
    def of(one: Assumption) -> tuple[str, str, str, bool]:
        return one.label, one.kind, one.part, one.stated

    for (label, kind, part, by_header), some in groupby(sorted(every, key=of), of):
        group = list(some)
        sizes = tuple(Size(one.std, one.unit) for one in group if one.std is not None)
        yield Basis(label, kind, part, by_header, tuple(dict.fromkeys(one.key for one in group)), sizes)


def _of_arm(header: Header, geometry: GeometryResult) -> Basis:
    of = geometry.tolerance
    sizes = () if of is None else (Size(of.length_mm, "mm"), Size(of.angle_deg, "deg"))
    return Basis("arm", "arm", "links", header.geometry is not None, ("geometry",), sizes)


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
    return Basis(
        basis.of,
        basis.kind,
        basis.part,
        basis.stated,
        basis.keys,
        basis.sizes,
        offset=item.name,
        unit=item.unit,
        u=u,
        u_if_exact=exact,
    )
