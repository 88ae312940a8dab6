"""Are the stated tolerances large enough? Each kind of them against its estimates.

At the mode the scaled parameters z have the covariance C. Over arms within the tolerances, and noise as
stated, z of a linear model has the covariance W = I - C. Of a group of parameters z' V^-1 z, with its block V
of W, is chi-squared, along the directions that the data determine. Were the tolerances of a group s times as
large, z would have W + (s^2 - 1) W_g W_g' with its columns W_g: the likeliest s is what the tolerances would
have to be. What one group needs moves the estimates of others: the group that explains most goes first, and
the others are judged with it as it would have to be.
"""

from __future__ import annotations

from dataclasses import field
from typing import Literal

import numpy as np
import scipy

from ..model.arrays import Index, Matrix
from ..model.likelihood.geometry import ANGLES, BENDING
from ..model.likelihood.parameters import Parameter
from ..model.records import key, record
from .estimation.fit import LikelihoodFit
from .left_over import Contradiction
from .status import LACK_OF_FIT

_DETERMINED = 0.1  # of a prior variance: directions of which the data say less are not tested
_HALVINGS = 60
_LARGEST = 1e4  # times the stated tolerance


@record
class TightPrior(Contradiction):
    """A group of estimates against their tolerances: chi-squared `chi2` with `dof` degrees of freedom, the
    p-value by Bonferroni's bound over the groups that are tested.

    `of` is a kind of the geometry (length, angle, gravity, harmonics), or what has the tolerance: the tool, a
    reflector. The tolerances would have to be `times` as large: `needed` in place of `stated` (deg or mm),
    None where they differ. `largest` is the parameter that is furthest off, at `estimate`.
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
        )


def _group_of(item: Parameter) -> str:
    if item.group != "geometry":
        return item.of
    for name, axes in BENDING.items():
        if item.axis in axes:
            return name
    return "angle" if item.axis in ANGLES else "length"


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
