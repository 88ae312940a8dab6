"""Arms with walks, instruments and biases that are known, for the tests of a fleet's drift."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from zerobeam.analysis.drift.smoother import Observation, Series, series_of
from zerobeam.model.arrays import Matrix

NAMES = ("delta2", "delta3")
COVARIANCE = np.array([[4.0, 3.0], [3.0, 4.0]]) * 1e-4  # deg^2: u of 0.02 degrees, correlated by 0.75
YEARS = 0.25  # between two results


def walked(random: np.random.Generator, rates: Sequence[float] | Matrix, results: int) -> Series:
    """Quarterly results of an arm whose offsets walk at these rates."""
    steps = random.normal(size=(results - 1, len(NAMES))) * np.asarray(rates) * np.sqrt(YEARS)
    true = np.cumsum(np.vstack([random.normal(size=len(NAMES)), steps]), axis=0)
    found = []
    for t, state in enumerate(true):
        own = COVARIANCE * random.uniform(0.5, 2.0) ** 2
        found.append(
            Observation(t * YEARS, NAMES, random.multivariate_normal(state, own), own, np.zeros_like(own))
        )
    return series_of(found, dict.fromkeys(NAMES, "deg"))


def seen_by(series: Series, instruments: Sequence[str], biases: Mapping[str, Sequence[float]]) -> Series:
    """The same results by instruments that add their biases."""
    observations = tuple(
        replace(own, values=own.values + np.asarray(biases.get(name, (0.0, 0.0))))
        for own, name in zip(series.observations, instruments, strict=True)
    )
    return replace(series, observations=observations)


def without(series: Series, offset: str, results: Sequence[int]) -> Series:
    """The same where these results do not determine an offset."""
    kept = [i for i, name in enumerate(NAMES) if name != offset]
    observations = tuple(
        replace(
            own,
            names=tuple(NAMES[i] for i in kept),
            values=own.values[kept],
            covariance=own.covariance[np.ix_(kept, kept)],
            shared=own.shared[np.ix_(kept, kept)],
        )
        if t in results
        else own
        for t, own in enumerate(series.observations)
    )
    return series_of(observations, dict.fromkeys(NAMES, "deg"), series.reset)
