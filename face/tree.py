"""The posterior's draws as an xarray.DataTree, the same as `posterior.nc`."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from ..analysis.answer.result import Result
from ..analysis.posterior.posterior import Draws
from ..model.errors import BadInput, missing_extra
from ..reports.output.posterior_file import write_posterior
from ..words.findings import likelihood_message, posterior_message

if TYPE_CHECKING:
    import xarray as xr


class UnconvergedPosterior(UserWarning):
    """The sampler did not converge: its draws are no posterior."""


def posterior_tree(result: Result, draws: Draws | None) -> xr.DataTree:
    """Group `posterior` with dimensions (chain, draw), a variable a parameter, in degrees and mm.

    BadInput without draws, or without xarray; UnconvergedPosterior is warned of where the draws may not be
    used.
    """
    try:
        import xarray as xr
    except ImportError:
        raise missing_extra("a posterior as a DataTree", "notebook", needed="xarray") from None
    if draws is None:
        raise BadInput(
            "there are no draws of the posterior",
            found=likelihood_message(result.likelihood) or posterior_message(result.posterior),
            allowed="a fit that converged, with a parameter that is identifiable",
        )
    if not draws.converged:
        warnings.warn(posterior_message(result.posterior), UnconvergedPosterior, stacklevel=3)
    with tempfile.TemporaryDirectory(prefix="zerobeam-") as folder:
        file = Path(folder) / "posterior.nc"
        write_posterior(file, result, draws)
        group = xr.load_dataset(file, group="posterior", engine="h5netcdf")
    tree = xr.DataTree(children={"posterior": xr.DataTree(group)})
    tree.attrs.update(group.attrs)
    return tree
