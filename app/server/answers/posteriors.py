"""Posterior draws for a figure, and what choosing some of them does to the residuals."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field

from ....analysis.estimation.fit import LikelihoodFit
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.likelihood.problem import Problem
from ....model.parsing.validation import as_tuple
from ....model.records import it, record
from ....words.wording import shown
from ..index import Folder
from ..requests import end_point
from ..versions import kept
from .refits import fitted

MOST_DRAWS = 2000  # shown
MOST_RESIDUALS = 600_000  # draws times measurements, computed for them
MOST_STORED = 10**7  # draws of one parameter in a file
MOST_VARIABLES = 5000
_OFFSET = re.compile(r"delta\d{1,2}")


@dataclass(frozen=True)
class StoredDraws:
    """(draws, m) thinned draws of the m parameters that the data determine, as people read them; `prior`
    names the others. Of a posterior that did not converge there are none."""

    converged: bool
    sha256: str
    total: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Matrix
    prior: tuple[str, ...]


@kept(4)
def _drawn(path: Path) -> StoredDraws:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            group = _member(file, "posterior")
            converged = str(group.attrs["converged"]) == "yes"
            chains, steps = len(_member(group, "chain")), len(_member(group, "draw"))
            if chains * steps > MOST_STORED or len(group) > MOST_VARIABLES:
                raise ValueError(f"{chains * steps} draws of {len(group)} parameters")
            columns, names, units, prior = [], [], [], []
            # Walkers wander slowly: every k-th step of all of them, or of every k-th where they are many.
            walkers = max(1, -(-chains // MOST_DRAWS))
            every = max(1, -(-steps // max(1, MOST_DRAWS // -(-chains // walkers))))
            for variable in (_member(group, name) for name in group):
                if variable.shape != (chains, steps) or "source" not in variable.attrs:
                    continue
                name = str(variable.attrs["long_name"])
                unit = {"degree": "deg"}.get(str(variable.attrs["units"]), str(variable.attrs["units"]))
                if variable.attrs["source"] == "data":
                    columns.append(variable[::walkers, ::every].astype(np.float32).reshape(-1))
                    names.append(name)
                    units.append(unit)
                elif variable.attrs["source"] == "prior":
                    prior.append(name)
            values = np.array(columns, dtype=float).T if columns else np.zeros((0, 0))
            if not np.isfinite(values).all():
                raise ValueError("a draw is no number")
            sha256 = str(group.attrs["sha256"])
    except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError) as error:
        raise BadInput(
            "this is not a whole posterior of zerobeam",
            found=str(error)[:200],
            allowed="a posterior.nc of a report",
            remedy="make it again with zerobeam report",
            file=path,
        ) from None
    return StoredDraws(converged, sha256, chains * steps, tuple(names), tuple(units), values, tuple(prior))


def _member(group: Any, name: str) -> Any:
    """A member of an HDF5 group that is in this very file; ValueError where the file leads to another one."""
    import h5py

    if not isinstance(group.get(name, getlink=True), h5py.HardLink):
        raise ValueError(f"{name[:50]} is a link")
    member = group[name]
    if isinstance(member, h5py.Dataset) and (member.external or member.is_virtual):
        raise ValueError(f"{name[:50]} is stored in another file")
    return member


@record(kw_only=True)
class PosteriorDraws:
    """Thinned draws of the offsets that the data determine: `draws` has a list for each of the `names`."""

    file: str
    converged: bool
    total: Annotated[int, it("draws in the file")]
    names: list[str]
    units: list[str]
    draws: list[list[float]]
    prior_only: Annotated[list[str], it("offsets that the data do not determine")]


@record(kw_only=True)
class BrushedShot:
    """A measurement: mean length of its normalised residual over all draws, and over the chosen ones."""

    shot: int
    all: float
    chosen: float


@record(kw_only=True)
class Brushed:
    """What choosing some draws does to the residuals."""

    draws: int
    chosen: int
    shots: list[BrushedShot]
    reason: Annotated[str | None, it("why there is none")]


@end_point("GET /api/posterior", "Thinned posterior draws of the offsets.")
def posterior(folder: Folder, file: str) -> PosteriorDraws:
    """Thinned draws of the offsets that the data determine, and the names of those that they do not."""
    draws = _drawn(folder.file(file))
    offsets = [i for i, name in enumerate(draws.names) if _OFFSET.fullmatch(name)] if draws.converged else []
    offsets.sort(key=lambda i: int(draws.names[i][5:]))
    return PosteriorDraws(
        file=file,
        converged=draws.converged,
        total=draws.total,
        names=[draws.names[i] for i in offsets],
        units=[draws.units[i] for i in offsets],
        draws=[np.round(draws.values[:, i], 7).tolist() for i in offsets],
        prior_only=[name for name in draws.prior if _OFFSET.fullmatch(name)],
    )


@end_point("POST /api/brush", "Normalised residuals of some draws, and of all.")
def brush(
    folder: Folder,
    posterior: Annotated[str, it("a posterior.nc below the folder")],
    run: Annotated[str, it("the run file that it was made of")],
    ranges: Annotated[
        dict[str, Annotated[tuple[float, float], BeforeValidator(as_tuple)]],
        it("by parameter: least and largest value of the draws that are chosen"),
        Field(max_length=12),
    ],
) -> Brushed:
    """Per measurement the mean length of its normalised residual over all draws, and over the chosen ones.

    `reason` says why there is none: a parameter that the data do not determine has draws of its prior alone,
    which say nothing of the residuals.
    """
    path = folder.file(posterior)
    draws = _drawn(path)
    for name in ranges:
        if name not in draws.names:
            raise BadInput("there are no draws of this parameter", found=name, allowed=", ".join(draws.names))
    chosen = np.ones(len(draws.values), dtype=bool)
    for name, (low, high) in ranges.items():
        column = draws.values[:, draws.names.index(name)]
        chosen &= (column >= low) & (column <= high)

    def without_residuals(reason: str) -> Brushed:
        return Brushed(draws=len(chosen), chosen=int(chosen.sum()), shots=[], reason=reason)

    run_file = folder.file(run)
    fit = fitted(run_file)
    if fit.run.sha256 != draws.sha256:
        raise BadInput("these draws are not of this run", found=f"SHA-256 {draws.sha256[:12]}…")
    tolerated = {row.name for row in fit.solution.parameters if row.tolerated}
    prior = [name for name in draws.prior if name not in tolerated]
    if prior:
        few = ", ".join(prior[:6]) + (" …" if len(prior) > 6 else "")
        return without_residuals(
            f"{few}: unidentifiable; their draws are of the prior alone and say nothing of the residuals"
        )
    lengths, every = _lengths(path, run_file)
    among = chosen[::every]
    if not among.any():
        return without_residuals("no draw is in this region")
    whole, part = lengths.mean(axis=0), lengths[among].mean(axis=0)
    rows = zip(fit.problem.shot_numbers, whole, part, strict=True)
    shots = [BrushedShot(shot=shot, all=float(one), chosen=float(other)) for shot, one, other in rows]
    return Brushed(draws=len(chosen), chosen=int(chosen.sum()), shots=shots, reason=None)


@kept(4)
def _lengths(posterior_file: Path, run_file: Path) -> tuple[Matrix, int]:
    """(draws, N) lengths of the normalised residuals of every k-th draw, and k. The draws are of this run.

    What is known by its tolerance only has no draws beside the others: it is drawn given theirs, by the
    curvature at the mode.
    """
    draws, fit = _drawn(posterior_file), fitted(run_file).solution.fit
    problem: Problem = fit.problem
    every = max(1, -(-len(draws.values) * problem.shots // MOST_RESIDUALS))
    rows = np.tile(fit.x, (len(draws.values[::every]), 1))
    by_name = {shown(name): i for i, name in enumerate(problem.parameters.names)}
    for k, name in enumerate(draws.names):
        if name not in by_name:
            raise BadInput(
                "these draws are of another model than the run's fit",
                found=f"a parameter {name}",
                remedy="make the report again",
            )
        item = problem.parameters.items[by_name[name]]
        values = draws.values[::every, k]
        rows[:, by_name[name]] = np.log(values) if item.group == "noise" else values / item.display
    rows = _with_tolerated(fit, rows, {by_name[name] for name in draws.names})
    factor = fit.whitened.factor
    lengths = np.empty((len(rows), problem.shots))
    scale = np.sqrt(fit.weight)
    for k, x in enumerate(rows):
        residual, _ = problem.linearise(x)
        lengths[k] = np.linalg.norm(np.linalg.solve(factor, residual[:, :, None])[:, :, 0], axis=1) * scale
    return lengths, every


def _with_tolerated(fit: LikelihoodFit, rows: Matrix, drawn: set[int]) -> Matrix:
    """Parameter vectors `rows` (W, p) of which only the places `drawn` are draws: the other free ones are
    drawn given these, from the normal distribution at the mode."""
    parameters = fit.problem.parameters
    at = np.array([i for i in np.flatnonzero(parameters.free) if i in drawn], dtype=int)
    others = np.array([i for i in np.flatnonzero(parameters.free) if i not in drawn], dtype=int)
    if not len(others):
        return rows
    known, unknown = parameters.among_free[at], parameters.among_free[others]
    across = fit.covariance[np.ix_(unknown, known)]
    gain = np.linalg.solve(fit.covariance[np.ix_(known, known)], across.T).T
    left = fit.covariance[np.ix_(unknown, unknown)] - gain @ across.T
    variance, axes = np.linalg.eigh(left)
    noise = np.random.default_rng(0).standard_normal((len(rows), len(others)))
    shift = ((rows[:, at] - fit.x[at]) / parameters.prior_std[at]) @ gain.T
    shift += noise @ (axes * np.sqrt(np.maximum(variance, 0.0))).T
    result = rows.copy()
    result[:, others] = fit.x[others] + shift * parameters.prior_std[others]
    return result
