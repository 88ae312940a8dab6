"""posterior.nc: read back by xarray as a tree and flat, marked where the draws are the prior's."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import xarray
from example_results import draws, good, hostile, unconverged, x_pattern

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.posterior.posterior import Draws
from zerobeam.reports.output.posterior_file import write_posterior


def written(tmp_path: Path, result: Result, of: Draws | None = None) -> xarray.Dataset:
    """The group `posterior`; the root must say the same, as it did before there were groups."""
    path = tmp_path / "posterior.nc"
    write_posterior(path, result, of or draws(result))
    with xarray.open_datatree(path, engine="h5netcdf") as tree:
        group = tree["posterior"].to_dataset().load()
    with xarray.open_dataset(path, engine="h5netcdf") as root:
        xarray.testing.assert_identical(root.load(), group)
    return group


def test_draws_come_back_once_chain_by_chain_with_their_units_and_where_they_come_from(
    tmp_path: Path,
) -> None:
    of, dataset = draws(good()), written(tmp_path, good())
    ensembles, walkers, steps, _ = of.values.shape
    assert dict(dataset.sizes) == {"chain": ensembles * walkers, "draw": steps}
    assert list(dataset.data_vars) == list(of.names)
    chain = 2 * walkers + 7  # ensemble 2, walker 7
    column = of.names.index("psd.x")
    np.testing.assert_allclose(dataset["psd.x"].values[chain], of.values[2, 7, :, column], rtol=1e-6)
    assert dataset["psd.x"].attrs["units"] == "mm"
    assert dataset["delta2"].attrs["units"] == "degree"
    assert (tmp_path / "posterior.nc").stat().st_size < 1.5 * of.values.size * 4
    assert set(dataset.coords) == {"chain", "draw", "ensemble", "walker"}
    ensemble, walker = (dataset.coords[name].values for name in ("ensemble", "walker"))
    np.testing.assert_array_equal(ensemble * walkers + walker, dataset.coords["chain"].values)
    np.testing.assert_array_equal(np.unique(ensemble, return_counts=True), [range(4), [walkers] * 4])
    stated = dataset.attrs
    assert (stated["ensembles"], stated["walkers"]) == (ensembles, walkers)
    assert "not independent" in stated["chain_order"]
    assert (stated["converged"], stated["rhat_max"]) == ("yes", good().posterior.rhat_max)
    assert (stated["sha256"], stated["seed"]) == (good().inputs.sha256, "20140803")
    assert f"numpy {good().inputs.versions['numpy']}" in stated["versions"]


def test_what_the_data_do_not_determine_is_marked_and_has_the_priors_own_draws(tmp_path: Path) -> None:
    """Not the sampler's: those are narrow where the priors of others make them so."""
    dataset = written(tmp_path, x_pattern())
    sources = {name: variable.attrs["source"] for name, variable in dataset.data_vars.items()}
    assert {name for name, source in sources.items() if source == "prior"} == {
        *("delta2", "psd.x", "psd.y", "psd.z")
    }
    assert "draws of the prior" in dataset["delta2"].attrs["comment"]
    assert "comment" not in dataset["delta3"].attrs
    (prior,) = [own for own in draws(x_pattern()).prior_only if own.name == "delta2"]
    values = dataset["delta2"].values
    assert (prior.mean, prior.std) == (0.0, pytest.approx(5.0))
    assert abs(values.mean()) < 5 * 5 / np.sqrt(values.size)
    assert values.std() == pytest.approx(5.0, rel=5 / np.sqrt(2 * values.size))
    assert abs(np.corrcoef(values.ravel(), dataset["delta3"].values.ravel())[0, 1]) < 5 / np.sqrt(values.size)


def test_an_unconverged_posterior_says_so(tmp_path: Path) -> None:
    assert written(tmp_path, unconverged()).attrs["converged"].startswith("no")


@pytest.mark.long
def test_hostile_names_become_names_that_netcdf_allows(tmp_path: Path) -> None:
    result = hostile()
    dataset = written(tmp_path, result)
    free = [row.name for row in result.parameters if not row.held]
    assert len(dataset.data_vars) == len(free)
    assert all("/" not in name and len(name) <= 80 and name.isascii() for name in dataset.data_vars)
    assert "long" * 75 + ".x" in {variable.attrs["long_name"] for variable in dataset.data_vars.values()}


@pytest.mark.parametrize("count", [2, 3])
def test_names_that_become_alike_stay_apart(tmp_path: Path, count: int) -> None:
    of = draws(good())
    names = tuple(f"a{'/?*'[i]}b" for i in range(count))
    few = dataclasses.replace(
        of, names=names, units=of.units[:count], status=of.status[:count], values=of.values[..., :count]
    )
    assert len(written(tmp_path, good(), few).data_vars) == count
