"""Drift rates of the offsets of a robot model, by all of its arms: shrinkage between arms.

The logarithm of the drift rate of an offset is normal between the arms of a model,

    log rate ~ N(mu, tau^2),   tau^2 = rho SPREAD^2,   mu ~ N(log MEDIAN, (1 - rho) SPREAD^2),

each offset with a mu and a rho of its own (a hierarchical model: Gelman et al. 2013, Bayesian Data Analysis,
ch. 5). rho, the share of the prior's variance that lies between the arms of a model, is uniform from `LEAST`
to 1. So the rate of a single arm has the prior of `drift` whatever rho is, and one arm alone has the same
answer as without a fleet. The likelihood of an arm couples the rates of its offsets, so all mu and rho are
integrated over together: the likelihood of an arm, given mu and rho, is a weighted sum over the rates that
its drift was integrated over. Where too few of these agree with mu and rho, more are sampled about a normal
approximation. mu and rho are integrated over about the mode, as standard normal coordinates.

An offset whose drift rate no arm determines (`Drift.determines_rate`) is not modelled: nothing is known of it
but the prior.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from ...model.arrays import Matrix
from .drift import MEDIAN, SPREAD, Drift, median_interval
from .importance import Pass, against_passes, effective, from_pass, normalised, over_passes, sampled
from .smoother import Series, smooth

LEAST = 0.04  # of rho: rates of two arms of a model are never taken as equal (tau at least 0.3)
ENOUGH = 100  # rates of an arm that agree with mu and rho: with fewer, more are sampled
_MORE, _ROUNDS, _WIDER = 256, 3, 1.3
_NODES, _PASSES, _NEAR = 512, 2, 1.2  # of mu and rho; the pass about the mode is so much wider
_AT_ONCE = 64  # of mu and rho: what fast memory holds
_SOME = 128  # of mu and rho that an arm's rates are of
_EXCLUDED = 20.0  # less than the highest log-likelihood
_STEP = 1e-3
_CENTRE = math.log(MEDIAN)


@dataclass(frozen=True, eq=False)
class ArmRates:
    """The rates of an arm among those of its model: `rates` (K, m), `weights` (K,); `effective` is how many
    of them agree with the model's, on average."""

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


@dataclass(eq=False)
class _Cloud:
    """Logarithms of rates of an arm (K, m), their log-likelihood, and the passes they are points of; the
    `columns` of its offsets among those of the model, -1 where that is not modelled."""

    series: Series
    jumps: Matrix
    points: Matrix
    log_likelihood: Matrix
    passes: list[Pass]
    columns: Matrix

    def __post_init__(self) -> None:
        self._prepare()

    def _prepare(self) -> None:
        """What `log_weights` needs of the points. Those that the results all but exclude are left out."""
        base = self.log_likelihood + against_passes(self.points, self.passes)
        base = base - 0.5 * ((self.points[:, self.columns < 0] - _CENTRE) ** 2).sum(axis=1) / SPREAD**2
        kept = self.log_likelihood > self.log_likelihood.max() - _EXCLUDED
        self.kept = kept
        self._base = base[kept] - base[kept].max()
        x = self.points[np.ix_(kept, self.columns >= 0)] - _CENTRE
        self.features = np.concatenate([x**2, x], axis=1).T
        self._single = self.features.astype(np.float32), self._base.astype(np.float32)

    def log_weights(self, mu: Matrix, tau: Matrix) -> Matrix:
        """(H, kept) for `mu`, `tau` (H, n), up to a constant of the arm. Of many H in single precision, which
        takes a fourth of the time and is far finer than the number of rates is."""
        at = self.columns[self.columns >= 0]
        precision, centre = 1 / tau[:, at] ** 2, mu[:, at] - _CENTRE
        constant = (0.5 * precision * centre**2 + np.log(tau[:, at])).sum(axis=1)
        features, base = (self.features, self._base) if len(mu) == 1 else self._single
        log_weights = (
            np.concatenate([-0.5 * precision, precision * centre], axis=1).astype(base.dtype) @ features
        )
        log_weights += base
        log_weights -= constant[:, None].astype(base.dtype)
        return np.asarray(log_weights)

    def extend(self, mu: Matrix, tau: Matrix, seed: int) -> None:
        """More rates about the product of the arm's likelihood, taken as normal, and of N(mu, tau^2)."""
        weights = normalised(self.log_likelihood + over_passes(self.points, self.passes))
        x = (self.points - _CENTRE) / SPREAD  # standard normal by the prior
        mean = weights @ x
        spread, axes = np.linalg.eigh((weights[:, None] * (x - mean)).T @ (x - mean))
        sharper = np.maximum(1 / np.maximum(spread, 1e-6) - 1, 0.0)
        pulled = np.where(sharper > 0, (axes.T @ mean) / np.maximum(spread, 1e-6), 0.0)
        modelled = self.columns >= 0
        at = self.columns[modelled]
        precision, centre = np.ones(len(mean)), np.zeros(len(mean))
        precision[modelled] = (SPREAD / tau[at]) ** 2
        centre[modelled] = (mu[at] - _CENTRE) / SPREAD
        covariance = np.linalg.inv((axes * sharper) @ axes.T + np.diag(precision))
        middle = covariance @ (axes @ pulled + precision * centre)
        root = _WIDER * SPREAD * np.linalg.cholesky(covariance)
        self.passes.append((_CENTRE + SPREAD * middle, root))
        near = from_pass(self.passes[-1], _MORE, seed)
        log_likelihood = smooth(self.series, np.exp(near), self.jumps).log_likelihood
        self.points = np.concatenate([self.points, near])
        self.log_likelihood = np.concatenate([self.log_likelihood, log_likelihood])
        self._prepare()


def model_rates(drifts: Sequence[Drift], seed: int = 0) -> ModelRates:
    """The drift rates of the arms of one model, by the drift of each."""
    with_rate = {name for arm in drifts for name in arm.series.names if arm.determines_rate(name)}
    names = tuple(sorted(with_rate, key=lambda name: (len(name), name)))
    clouds = [_cloud(arm, names) for arm in drifts]
    for number in range(_ROUNDS):
        mode = _mode(clouds, len(names))
        (mu,), (tau,) = _model(mode[None])
        few = [cloud for cloud in clouds if _agreeing(cloud, mu, tau) < ENOUGH]
        for k, cloud in enumerate(few):
            cloud.extend(mu, tau, seed + 1000 * (number + 1) + k)
        if not few:
            break
    mode = _mode(clouds, len(names))
    passes = [(np.zeros(len(mode)), np.eye(len(mode))), (mode, _about_mode(clouds, mode))]

    def log_likelihood(points: Matrix) -> Matrix:
        total = np.zeros(len(points))
        for part in range(0, len(points), _AT_ONCE):
            mu, tau = _model(points[part : part + _AT_ONCE])
            for cloud in clouds:
                total[part : part + _AT_ONCE] += _log_sum(cloud.log_weights(mu, tau))
        return total

    points, log_likelihoods = sampled(log_likelihood, passes, _PASSES, _NODES, seed)
    weights = normalised(log_likelihoods + over_passes(points, passes))
    mu, tau = _model(points)
    some = np.searchsorted(np.cumsum(weights), (np.arange(_SOME) + 0.5) / _SOME)
    arms = tuple(
        _arm(cloud, arm_drift, mu[some], tau[some]) for cloud, arm_drift in zip(clouds, drifts, strict=True)
    )
    return ModelRates(names, mu, tau, weights, effective(weights), arms)


def _cloud(drift: Drift, names: tuple[str, ...]) -> _Cloud:
    columns = [names.index(name) if name in names else -1 for name in drift.series.names]
    return _Cloud(
        drift.series,
        drift.allowed,
        np.log(drift.rates),
        drift.smoothed.log_likelihood,
        list(drift.passes),
        np.array(columns),
    )


def _arm(cloud: _Cloud, drift: Drift, mu: Matrix, tau: Matrix) -> ArmRates:
    of_each = normalised(cloud.log_weights(mu, tau).T.astype(float))  # (K, H)
    agreeing = float((1 / (of_each**2).sum(axis=0)).mean())
    return ArmRates(drift.series.names, np.exp(cloud.points[cloud.kept]), of_each.mean(axis=1), agreeing)


def _agreeing(cloud: _Cloud, mu: Matrix, tau: Matrix) -> float:
    return effective(normalised(cloud.log_weights(mu[None], tau[None])[0]))


def _log_sum(log_weights: Matrix) -> Matrix:
    """(H,) of (H, K), which is overwritten."""
    most = log_weights.max(axis=1)
    log_weights -= most[:, None]
    np.exp(log_weights, out=log_weights)
    return np.asarray(most.astype(float) + np.log(log_weights.sum(axis=1, dtype=float)))


def _model(points: Matrix) -> tuple[Matrix, Matrix]:
    """mu and tau (H, n) of standard normal coordinates (H, 2 n)."""
    size = points.shape[1] // 2
    z, share = points[:, :size], points[:, size:]
    within = (1 - LEAST) * special.ndtr(-share)  # 1 - rho
    return _CENTRE + SPREAD * np.sqrt(within) * z, SPREAD * np.sqrt(1 - within)


def _mode(clouds: Sequence[_Cloud], size: int) -> Matrix:
    """(2 n,) where the density of mu and rho is highest."""
    if not size:
        return np.zeros(0)
    result = optimize.minimize(
        lambda at: tuple(-part for part in _density(clouds, at)),
        np.zeros(2 * size),
        jac=True,
        method="L-BFGS-B",
        bounds=[(-6, 6)] * (2 * size),
        options={"gtol": 1e-3, "ftol": 1e-8},
    )
    return np.asarray(result.x)


def _density(clouds: Sequence[_Cloud], at: Matrix) -> tuple[float, Matrix]:
    """The logarithm of the density of the coordinates `at` (2 n,) up to a constant, and its gradient."""
    size = len(at) // 2
    (mu,), (tau,) = _model(at[None])
    value, by_mu, by_log_tau = -0.5 * float(at @ at), np.zeros(size), np.zeros(size)
    for cloud in clouds:
        log_weights = cloud.log_weights(mu[None], tau[None])[0]
        weights = np.exp(log_weights - log_weights.max())
        total = float(weights.sum())
        value += float(log_weights.max()) + math.log(total)
        columns = cloud.columns[cloud.columns >= 0]
        squared, mean = np.split(cloud.features @ weights / total, 2)
        centre, variance = mu[columns] - _CENTRE, tau[columns] ** 2
        by_mu[columns] += (mean - centre) / variance
        by_log_tau[columns] += (squared - 2 * centre * mean + centre**2) / variance - 1
    within = (1 - LEAST) * special.ndtr(-at[size:])
    slope = (1 - LEAST) * np.exp(-0.5 * at[size:] ** 2) / math.sqrt(2 * math.pi)  # of rho
    by_rho = by_log_tau / (2 * (1 - within)) - by_mu * (SPREAD * at[:size]) / (2 * np.sqrt(within))
    return value, np.concatenate([by_mu * SPREAD * np.sqrt(within), by_rho * slope]) - at


def _about_mode(clouds: Sequence[_Cloud], mode: Matrix) -> Matrix:
    """A root (2 n, 2 n) of the covariance about the mode, by differences of the gradient."""
    steps = _STEP * np.eye(len(mode))
    curved = [(_density(clouds, mode - d)[1] - _density(clouds, mode + d)[1]) / (2 * _STEP) for d in steps]
    precision = np.reshape(curved, (len(mode), len(mode)))
    values, axes = np.linalg.eigh((precision + precision.T) / 2)
    return np.asarray(_NEAR * axes / np.sqrt(np.maximum(values, 0.5)))
