"""`posterior.nc`: the draws of the posterior as netCDF, in the layout that ArviZ and xarray read.

Group `posterior`, dimensions (chain, draw), one variable a parameter in the units that people read; `source`
says whether the data or only the prior determine its draws. The root names the same variables once more
(hard links, no copy), for readers that know of no groups.

A chain is a walker: chain = ensemble * walkers + walker; `ensemble` and `walker` are coordinates of `chain`.
Walkers of one ensemble are proposed from each other and are not independent, so an R-hat over all chains is
not the one that zerobeam judges by. That one takes ensembles as superchains (nested R-hat, Margossian et al.,
Bayesian Analysis, 2024). Walkers laid end to end, an ensemble a chain, would be worse: autocorrelations would
be between different walkers, and the effective sample size far too large.

Written by h5netcdf itself: xarray would cost each report a second to import.
"""

from __future__ import annotations

import re
from importlib.metadata import version
from io import BytesIO
from pathlib import Path

import h5netcdf
import h5py
import numpy as np

from ...analysis.answer.result import Result
from ...analysis.posterior.posterior import Draws
from ...words.wording import clipped, shown

# Longest name that netCDF allows is 256 bytes; names beyond this are clipped, `long_name` has them whole.
_NAME_WIDTH = 60
_CHAINS = (
    "chain = ensemble * walkers + walker. The walkers of one ensemble are not independent, the ensembles are:"
    " take them as superchains (nested R-hat). rhat_max is that of zerobeam; an R-hat over chains is not it"
)


def write_posterior(path: Path | str, result: Result, draws: Draws) -> None:
    """Write the draws with what a reader needs to judge them: converged or not, hash, seed, versions.

    Draws are stored in 32 bits (7 digits, far below their Monte Carlo error).
    """
    ensembles, walkers, steps, _ = draws.values.shape
    size = (ensembles * walkers, steps)
    chains = draws.values.reshape(*size, -1)
    # Of what the data do not determine only the prior is known: draws independent of all others.
    rng = np.random.default_rng(result.inputs.seed)
    labels = zip(draws.names, draws.units, strict=True)
    known = [(name, unit, "data", chains[:, :, i]) for i, (name, unit) in enumerate(labels)]
    prior = [
        (parameter.name, parameter.unit, "prior", parameter.draws(rng, size))
        for parameter in draws.prior_only
    ]
    coordinates = {
        "chain": ("chain", np.arange(ensembles * walkers)),
        "draw": ("draw", np.arange(steps)),
        "ensemble": ("chain", np.repeat(np.arange(ensembles), walkers)),
        "walker": ("chain", np.tile(np.arange(walkers), ensembles)),
    }
    content = BytesIO()  # HDF5 itself would end the process by a signal where the disk is full
    with h5netcdf.File(content, "w") as file:
        group = file.create_group("posterior")
        attributes = about(result, draws)
        file.attrs.update(attributes)
        group.attrs.update(attributes)
        group.dimensions = {"chain": ensembles * walkers, "draw": steps}
        for name, (along, values) in coordinates.items():
            group.create_variable(name, (along,), data=values)
        for name, unit, source, values in (*known, *prior):
            variable = group.create_variable(
                variable_name(name, set(group.variables)), ("chain", "draw"), data=values.astype(np.float32)
            )
            variable.attrs["units"] = "degree" if unit == "deg" else unit
            variable.attrs["long_name"] = shown(name)
            variable.attrs["coordinates"] = "ensemble walker"
            variable.attrs["source"] = source
            if source == "prior":
                variable.attrs["comment"] = "Unidentifiable: draws of the prior, independent of all others."
    with h5py.File(content, "r+") as file:
        for name, variable in file["posterior"].items():
            file[name] = variable
    Path(path).write_bytes(content.getbuffer())


def about(result: Result, draws: Draws) -> dict[str, str | int | float]:
    """The attributes: what the draws are of, by what they were made, and whether they may be used."""
    inputs, summary = result.inputs, result.posterior
    attributes: dict[str, str | int | float | None] = {
        "title": "Posterior draws of a zerobeam run",
        "converged": "yes" if draws.converged else "no: do not use these draws as a posterior",
        "verdict": result.verdict,
        "run": shown(inputs.run),
        "sha256": inputs.sha256,
        "robot": shown(inputs.robot),
        "seed": str(inputs.seed),
        "versions": ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs.versions.items()),
        "ensembles": draws.values.shape[0],
        "walkers": draws.values.shape[1],
        "chain_order": _CHAINS,
        "rhat_max": summary.rhat_max,
        "ess_min": summary.ess_min,
        "creation_library": "zerobeam",
        "creation_library_version": version("zerobeam"),
        "creation_library_language": "Python",
        "inference_library": "emcee",
        "inference_library_version": shown(inputs.versions.get("emcee", "")),
        "sampling_time": summary.seconds,
    }
    return {key: value for key, value in attributes.items() if value is not None}


def variable_name(name: str, taken: set[str]) -> str:
    """A name that netCDF allows and that is not `taken`: letters, digits, `_`, `.`, `-`."""
    plain = re.sub(r"[^\w.\-]", "_", clipped(name, _NAME_WIDTH), flags=re.ASCII)
    if not re.match(r"[A-Za-z_]", plain):
        plain = f"_{plain}"
    unique, count = plain, 1
    while unique in taken:
        count += 1
        unique = f"{plain}_{count}"
    return unique
