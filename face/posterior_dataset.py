"""The draws as an xarray.Dataset, which ArviZ takes: chains are ensembles, draws are about independent.

The walkers of one ensemble are proposed from each other, so that a walker is no chain. A chain here is an
ensemble, its draws in the order of the steps. Steps are left out until about as many draws remain as the
effective sample size: an R-hat and an effective sample size over these chains are then right.

What the data do not determine is not in it: a table of ArviZ would show its prior as a result.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..analysis.answer.result import Result
from ..analysis.posterior.posterior import Draws
from ..model.arrays import Matrix
from ..model.errors import missing_extra
from ..reports.output.posterior_file import about, variable_name
from ..words.wording import shown

if TYPE_CHECKING:
    import xarray as xr

_CHAINS = "a chain is an ensemble, independent of the others; steps are left out until draws are independent"


def posterior_dataset(result: Result, draws: Draws) -> xr.Dataset:
    """The parameters that the data determine, with dimensions (chain, draw); BadInput without xarray."""
    try:
        import xarray as xr
    except ImportError:
        raise missing_extra("a posterior as a Dataset", "notebook", needed="xarray") from None
    values = chains_of(draws, result.posterior.ess_min)
    coordinates = {"chain": np.arange(values.shape[0]), "draw": np.arange(values.shape[1])}
    dataset = xr.Dataset(coords=coordinates, attrs={**about(result, draws), "chain_order": _CHAINS})
    for i, (name, unit) in enumerate(zip(draws.names, draws.units, strict=True)):
        unique = variable_name(name, {str(variable) for variable in dataset.variables})
        attributes = {"units": "degree" if unit == "deg" else unit, "long_name": shown(name)}
        dataset[unique] = (("chain", "draw"), values[:, :, i], attributes)
    return dataset


def chains_of(draws: Draws, worth: float | None) -> Matrix:
    """(ensembles, draws, m), thinned to at most `worth` draws in all, or one step."""
    ensembles, walkers, steps, m = draws.values.shape
    every = min(steps, math.ceil(ensembles * walkers * steps / worth)) if worth else 1
    thinned = draws.values[:, :, ::every]
    return thinned.transpose(0, 2, 1, 3).reshape(ensembles, -1, m)
