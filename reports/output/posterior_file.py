"""`posterior.nc`: the posterior's draws as netCDF, for people who go on from them (xarray, arviz).

Written by h5netcdf itself: xarray reads it, but would cost each report a second to import.

Dimensions (chain, draw): chain = ensemble * walkers + walker. One variable a parameter, in the
units that people read; `source` says whether the data or only the prior stand behind its draws.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ...analysis.result import Draws
from ..words.wording import clipped, shown

# Longest name that netCDF allows is 256 bytes; names beyond this are clipped, `long_name` has them whole.
_NAME_WIDTH = 60


def write_posterior(path: Path, result: dict[str, Any], draws: Draws) -> None:
    """Write the draws with what a reader needs to judge them: converged or not, hash, seed, versions.

    Draws are stored in 32 bits (7 digits, far below their Monte Carlo error).
    """
    import h5netcdf
    import numpy as np

    ensembles, walkers, steps, _ = draws.values.shape
    chains = draws.values.reshape(ensembles * walkers, steps, -1).astype(np.float32)
    untold = {row["name"] for row in result["parameters"] if row["status"] == "unidentifiable"}
    inputs = result["inputs"]
    with h5netcdf.File(path, "w") as file:
        file.attrs.update(
            {
                "title": "Posterior draws of a zerobeam run",
                "converged": "yes" if draws.converged else "no: do not use these draws as a posterior",
                "verdict": result["verdict"],
                "run": shown(inputs["run"]),
                "sha256": inputs["sha256"],
                "robot": shown(inputs["robot"]),
                "seed": str(inputs["seed"]),
                "versions": ", ".join(
                    f"{shown(name)} {shown(at)}" for name, at in inputs["versions"].items()
                ),
                "ensembles": ensembles,
                "walkers": walkers,
                "chain_order": "chain = ensemble * walkers + walker",
            }
        )
        file.dimensions = {"chain": ensembles * walkers, "draw": steps}
        for i, name in enumerate(draws.names):
            prior = draws.from_prior[i] or name in untold
            variable = file.create_variable(
                _variable(name, set(file.variables)), ("chain", "draw"), data=chains[:, :, i]
            )
            variable.attrs["units"] = "degree" if draws.units[i] == "deg" else draws.units[i]
            variable.attrs["long_name"] = shown(name)
            variable.attrs["source"] = "prior" if prior else "data"
            if prior:
                variable.attrs["comment"] = (
                    "The data do not tell it: what these draws say comes from the priors."
                )


def _variable(name: str, taken: set[str]) -> str:
    """A name that netCDF allows and that is not `taken`: letters, digits, `_`, `.`, `-`."""
    plain = re.sub(r"[^\w.\-]", "_", clipped(name, _NAME_WIDTH), flags=re.ASCII)
    if not re.match(r"[A-Za-z_]", plain):
        plain = f"_{plain}"
    unique, count = plain, 1
    while unique in taken:
        count += 1
        unique = f"{plain}_{count}"
    return unique
