"""Drift rates of the offsets of a robot model, by all of its arms: shrinkage between arms.

The logarithm of the drift rate of an offset is normal between the arms of a model,

    log rate ~ N(mu, tau^2),   tau^2 = rho SPREAD^2,   mu ~ N(log MEDIAN, (1 - rho) SPREAD^2),

each offset with a mu and a rho of its own (a hierarchical model: Gelman et al. 2013, Bayesian Data Analysis,
ch. 5). rho, the share of the prior's variance that lies between the arms of a model, is uniform from `LEAST`
to 1. So the rate of a single arm has the prior of `drift` whatever rho is, and one arm alone has the same
answer as without a fleet. The likelihood of an arm couples the rates of its offsets, so all mu and rho are
integrated over together.

The likelihood of an arm, given mu and rho, is a weighted sum over rates about the product of N(mu, tau^2) and
of the arm's likelihood, taken as normal. These rates are others for each mu and rho, but the same points of
a lattice: the sum is a smooth function of mu and rho. (Rates that are sampled once and for all agree with few
mu and rho, and of many arms the sum is highest where the rates were sampled.) mu and rho are standard normal
coordinates by their prior, and are integrated over about the mode of the posterior, found by Newton's steps
with the slope of Fisher's identity and the curvature of Louis (1982). A rho that the data say nothing of, or
push to its bound, has the curvature of its prior there.

An offset whose drift rate no arm determines (`Drift.determines_rate`) is not modelled: nothing is known of it
but the prior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ...model.arrays import Index, Matrix
from .drift import MEDIAN, SPREAD, Drift, median_interval
from .importance import effective, normalised, sampled, standard_points
from .smoother import SeveralSeries

LEAST = 0.04  # of rho: rates of two arms of a model are never taken as equal (tau at least 0.3)
_TOGETHER, _FEWEST, _MOST = 4096, 16, 128  # rates given mu and rho: of all arms, and of one; powers of two
_AT_MODE, _LATTICES = 64, 256  # rates of an arm where the mode is looked for; how many arms have others
_WIDER, _SHARPEST = 1.2, 1e3  # of these rates; the precision of an arm's likelihood at most
_FAR, _STEPS, _FLAT = 0.5, 60, 0.5  # of Newton; a curvature is at least half of the prior's
_SHARES, _CLOSE = (1.0, 0.3, 0.1, 0.03), 1e-3  # of a step that are tried; by how much one has to lead upwards
_NODES, _PASSES, _NEAR = 64, 2, 1.2  # of mu and rho; the pass about the mode is so much wider
_AT_ONCE = 32  # of mu and rho: what fast memory holds
_SOME = 128  # of mu and rho that an arm's rates are of
_CENTRE = math.log(MEDIAN)


@dataclass(frozen=True, eq=False)
class ArmRates:
    """The rates of an arm among those of its model: `rates` (K, m), `weights` (K,); `effective` is their
    effective number."""

    names: tuple[str, ...]
    rates: Matrix
    weights: Matrix
    effective: float

    def rate(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Median and 95 % interval of an offset's drift rate, per root year."""
        return median_interval(self.rates[:, self.names.index(offset)], self.weights)


@dataclass(frozen=True, eq=False)
class ModelRates:
    """The drift rates of the offsets `names` of a model: `mu` (H, n) and `tau` (H, n) with the `weights`
    (H,), of the natural logarithm per root year; `effective` is their effective number. `arms` in the order
    given."""

    names: tuple[str, ...]
    mu: Matrix
    tau: Matrix
    weights: Matrix
    effective: float
    arms: tuple[ArmRates, ...]

    def median(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Of the median rate of the model's arms: median and 95 % interval, per root year."""
        return median_interval(np.exp(self.mu[:, self.names.index(offset)]), self.weights)

    def between(self, offset: str) -> tuple[float, tuple[float, float]]:
        """Of the standard deviation of log rates between arms: median and 95 % interval."""
        return median_interval(self.tau[:, self.names.index(offset)], self.weights)

    def beyond(self, offset: str, rate: float) -> float:
        """Posterior probability that the median rate of the model's arms is above this one. mu is smoothed by
        a normal kernel (Silverman 1986), which makes the tails a little longer: few samples never say 1."""
        mu = self.mu[:, self.names.index(offset)]
        std = math.sqrt(self.weights @ (mu - self.weights @ mu) ** 2)
        width = max(std, 1e-6) * self.effective ** (-1 / 5)
        return min(1.0, float(self.weights @ special.ndtr((mu - math.log(rate)) / width)))


@dataclass(frozen=True, eq=False)
class _Arms:
    """A arms, by their numbers `of`, with the same m offsets, in the `columns` (m,) of the model's, -1 where
    one is not modelled. The likelihood of their log rates (from the prior's median), taken as normal:
    `precision` (A, m, m) and its product with the centre, `vector` (A, m)."""

    of: Sequence[int]
    several: SeveralSeries
    columns: Index
    precision: Matrix
    vector: Matrix

    @staticmethod
    def grouped(drifts: Sequence[Drift], names: Sequence[str]) -> Iterator[_Arms]:
        of_each = [tuple(drift.series.names) for drift in drifts]
        for offsets in dict.fromkeys(of_each):
            of = [k for k, of_arm in enumerate(of_each) if of_arm == offsets]
            columns = np.array([names.index(name) if name in names else -1 for name in offsets])
            normal = [_as_normal(drifts[k]) for k in of]
            several = SeveralSeries.of([(drifts[k].series, drifts[k].allowed) for k in of])
            yield _Arms(of, several, columns, *(np.array(part) for part in zip(*normal, strict=True)))

    def weighted(self, mu: Matrix, tau: Matrix, number: int) -> tuple[Matrix, Matrix]:
        """For `mu`, `tau` (H, n): K = `number` log rates from the prior's median (A, H, K, m), and the
        logarithm of the weight of each (A, H, K)."""
        modelled = self.columns >= 0
        prior, centre = (np.zeros((len(mu), len(self.columns))) for _ in range(2))
        prior[:] = SPREAD**-2.0
        prior[:, modelled] = tau[:, self.columns[modelled]] ** -2
        centre[:, modelled] = mu[:, self.columns[modelled]] - _CENTRE
        precision = self.precision[:, None] + prior[:, :, None] * np.eye(len(self.columns))
        root = np.linalg.cholesky(precision)
        inverse = np.linalg.inv(root)
        vector = self.vector[:, None] + prior * centre
        middle = (inverse.swapaxes(-1, -2) @ (inverse @ vector[..., None]))[..., 0]
        # Of each arm others, so that the deviations of their sums are independent.
        z = np.array([standard_points(len(self.columns), number, k % _LATTICES) for k in self.of])[:, None]
        x = middle[:, :, None] + _WIDER * z @ inverse
        log_weights = self.several.log_likelihood(_CENTRE + x.reshape(len(x), -1, x.shape[-1]))
        log_weights = log_weights.reshape(x.shape[:3]) + (z**2).sum(axis=-1) / 2
        log_weights -= (prior[:, None] * (x - centre[:, None]) ** 2).sum(axis=-1) / 2
        factor = np.log(prior).sum(axis=1) / 2 - np.log(np.diagonal(root, axis1=2, axis2=3)).sum(axis=-1)
        return x, log_weights + (factor - math.log(number))[:, :, None]


def _as_normal(drift: Drift) -> tuple[Matrix, Matrix]:
    """Precision (m, m) of the likelihood of an arm's log rates, and its product with the centre (m,), by the
    moments of their posterior."""
    x = np.log(drift.rates) - _CENTRE
    mean = drift.weights @ x
    variance, axes = np.linalg.eigh((drift.weights[:, None] * (x - mean)).T @ (x - mean))
    sharp = np.minimum(1 / variance, _SHARPEST)
    known = np.maximum(sharp - SPREAD**-2, 0.0)
    return (axes * known) @ axes.T, axes @ np.where(known > 0, sharp * (axes.T @ mean), 0.0)


@dataclass(frozen=True, eq=False)
class _Model:
    """All arms of a model, by groups; `size` offsets are modelled, by so many rates of each arm."""

    groups: tuple[_Arms, ...]
    size: int
    number: int

    def log_likelihood(self, points: Matrix) -> Matrix:
        """(H,) of all arms together for standard normal coordinates (H, 2 n), up to a constant."""
        total = np.zeros(len(points))
        for part in np.split(np.arange(len(points)), range(_AT_ONCE, len(points), _AT_ONCE)):
            for group in self.groups:
                total[part] += _of_all(group.weighted(*_model(points[part]), self.number)[1])
        return total

    def density(self, at: Matrix) -> tuple[float, Matrix, Matrix]:
        """The log-posterior of the coordinates `at` (2 n,) up to a constant, its gradient and its second
        derivatives (2 n, 2 n)."""
        n = self.size
        mu, tau = _model(at[None])
        squared, mean, count = np.zeros(n), np.zeros(n), np.zeros(n)
        covariance, value = np.zeros((2 * n, 2 * n)), -float(at @ at) / 2
        for group in self.groups:
            x, log_weights = group.weighted(mu, tau, _AT_MODE)
            value += float(_of_all(log_weights)[0])
            weights, modelled = normalised(log_weights[:, 0].T).T, group.columns >= 0
            x = x[:, 0][:, :, modelled]
            features, to = np.concatenate([x**2, x], axis=2), group.columns[modelled]
            weighted = weights[:, :, None] * features
            means, both = weighted.sum(axis=1), np.concatenate([to, to + n])
            covariance[np.ix_(both, both)] += (
                np.tensordot(features, weighted, ((0, 1), (0, 1))) - means.T @ means
            )
            squared[to] += means[:, : len(to)].sum(axis=0)
            mean[to] += means[:, len(to) :].sum(axis=0)
            count[to] += len(x)
        # By the precision p of log rates and their centre c, which are of z and of u = 1 - rho, ...
        z, share = at[:n], at[n:]
        u, p, c = (1 - LEAST) * special.ndtr(-share), 1 / tau[0] ** 2, mu[0] - _CENTRE
        by_p, by_c = (c * (2 * mean - count * c) - squared + count / p) / 2, p * (mean - count * c)
        p_u, c_z, c_u = p / (1 - u), SPREAD * np.sqrt(u), SPREAD * z / (2 * np.sqrt(u))
        u_s = (LEAST - 1) * np.exp(-0.5 * share**2) / math.sqrt(2 * math.pi)
        by_u = by_p * p_u + by_c * c_u
        p_c, c_c = mean - count * c, -count * p
        z_u = (p_c * p_u + c_c * c_u) * c_z + by_c * SPREAD / (2 * np.sqrt(u))
        u_u = -count / (2 * p**2) * p_u**2 + (2 * p_c * p_u + c_c * c_u) * c_u
        u_u += by_p * 2 * p_u / (1 - u) - by_c * c_u / (2 * u)
        s_s = u_u * u_s**2 - by_u * share * u_s
        # ... and by what multiplies squares and values of the rates, whose covariance curves it.
        along = _blocks(0 * z, p * c_z, -p_u / 2 * u_s, (p_u * c + p * c_u) * u_s)
        curved = along @ covariance @ along.T + _blocks(c_c * c_z**2, z_u * u_s, z_u * u_s, s_s)
        return value, np.concatenate([by_c * c_z, by_u * u_s]) - at, curved - np.eye(2 * n)

    def mode(self) -> tuple[Matrix, Matrix]:
        """Where the posterior is highest (2 n,), and a root (2 n, 2 n) of the covariance about it: each step
        is shortened until it leads upwards, and none is left that does."""
        at = np.zeros(2 * self.size)
        value, slope, curved = self.density(at)
        for _ in range(_STEPS):
            values, axes = np.linalg.eigh(-curved)
            values = np.maximum(np.abs(values), _FLAT)
            step = axes @ ((axes.T @ slope) / values)
            step *= min(1.0, _FAR / max(np.abs(step).max(initial=0.0), _FAR))
            for share in _SHARES:
                new = self.density(at + share * step)
                if new[0] > value + _CLOSE:
                    break
            else:
                break
            at, (value, slope, curved) = at + share * step, new
        return at, np.asarray(_NEAR * axes / np.sqrt(values))

    def arms(self, mu: Matrix, tau: Matrix) -> list[ArmRates]:
        """The rates of each arm, in the order given, for all `mu` and `tau` (H, n) alike."""
        by_arm: dict[int, ArmRates] = {}
        for group in self.groups:
            x, log_weights = group.weighted(mu, tau, self.number)
            weights = normalised(np.moveaxis(log_weights, -1, 0)).transpose(1, 2, 0) / len(mu)
            for k, rates, of_arm in zip(group.of, np.exp(_CENTRE + x), weights, strict=True):
                flat = of_arm.ravel()
                by_arm[k] = ArmRates(group.several.names, rates.reshape(len(flat), -1), flat, effective(flat))
        return [by_arm[k] for k in range(len(by_arm))]


def model_rates(drifts: Sequence[Drift], seed: int = 0) -> ModelRates:
    """The drift rates of the arms of one model, by the drift of each."""
    with_rate = {name for arm in drifts for name in arm.series.names if arm.determines_rate(name)}
    names = tuple(sorted(with_rate, key=lambda name: (len(name), name)))
    number = 2 ** int(math.log2(np.clip(_TOGETHER / max(len(drifts), 1), _FEWEST, _MOST)))
    model = _Model(tuple(_Arms.grouped(drifts, names)), len(names), number)
    mode, root = model.mode()
    inverse = np.asarray(np.linalg.inv(root), float)  # with it the posterior is about standard normal
    passes = [(-inverse @ mode, inverse), (np.zeros(len(mode)), np.eye(len(mode)))]
    nodes, log_likelihoods = sampled(
        lambda points: model.log_likelihood(mode + points @ root.T), passes, _PASSES, _NODES, seed
    )
    weights = normalised(log_likelihoods + nodes.over)
    mu, tau = _model(mode + nodes.points @ root.T)
    some = np.searchsorted(np.cumsum(weights), (np.arange(_SOME) + 0.5) / _SOME)
    arms = tuple(model.arms(mu[some], tau[some]))
    return ModelRates(names, mu, tau, weights, effective(weights), arms)


def _of_all(log_weights: Matrix) -> Matrix:
    """(H,) the sum over A arms of the logarithm of the sum of K weights (A, H, K)."""
    most = log_weights.max(axis=-1)
    return np.asarray((most + np.log(np.exp(log_weights - most[..., None]).sum(axis=-1))).sum(axis=0))


def _blocks(*parts: Matrix) -> Matrix:
    """(2 n, 2 n) of four diagonals (n,)."""
    a, b, c, d = map(np.diag, parts)
    return np.block([[a, b], [c, d]])


def _model(points: Matrix) -> tuple[Matrix, Matrix]:
    """mu and tau (H, n) of standard normal coordinates (H, 2 n)."""
    size = points.shape[1] // 2
    z, share = points[:, :size], points[:, size:]
    within = (1 - LEAST) * special.ndtr(-share)  # 1 - rho
    return _CENTRE + SPREAD * np.sqrt(within) * z, SPREAD * np.sqrt(1 - within)
