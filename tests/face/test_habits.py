"""What a user of lmfit, iminuit or ArviZ tries first."""

import copy
import io
import pickle
import sys

import matplotlib
import numpy as np
import pytest
import xarray as xr
from arviz_stats.base import array_stats
from exact_runs import demo_runs
from matplotlib.figure import Figure as PlainFigure

import zerobeam as zb
from zerobeam.face.notebook import shown_progress
from zerobeam.face.tables import data_frame
from zerobeam.model.arrays import normal_half_width

EXACT = {
    "robot": "irb1600",
    "tool": zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    "noise": zb.Noise(joint_deg=0.01, spot_mm=0.05),
    "geometry": "exact",
}
BALL = {"a": {"guess_mm": [0, 0, 100], "sigma_mm": 1.0}}
IDENTIFIED = [f"delta{i}" for i in range(2, 7)]


@pytest.fixture(scope="module")
def good() -> zb.Analysed:
    joints = zb.read_run(demo_runs()[0].path).joints
    return zb.analyse(zb.Run.from_arrays(**EXACT, joints=joints, unit="rad", limits="warn"), ess=400)


@pytest.fixture(scope="module")
def x_pattern() -> zb.Analysed:
    joints = zb.read_run(demo_runs()[1].path).joints
    return zb.analyse(zb.Run.from_arrays(**EXACT, joints=joints, unit="rad"), ess=100)


@pytest.mark.long
def test_tables_show_themselves(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    lines = repr(good.offsets).splitlines()
    assert lines[0].startswith("Joint offsets")
    assert [line.split()[0] for line in lines[2:]] == [f"J{i}" for i in range(1, 7)]
    assert len(repr(good.parameters).splitlines()) == len(good.parameters) + 2
    html = x_pattern.offsets._repr_html_()
    assert "<table" in html
    assert "not determined by these data" in html
    assert "<script" not in html
    (row,) = (line for line in repr(x_pattern.offsets).splitlines() if "J2" in line)
    assert "unidentifiable" in row


def test_a_row_by_the_name_of_its_joint(good: zb.Analysed) -> None:
    assert good["J2"] is good["delta2"] is good.offsets.named("J2")
    assert good.covariance["J2", "J3"] == good.covariance["delta2", "delta3"]
    assert good.covariance.select(["J3", "J2"]).names == ("delta3", "delta2")
    with pytest.raises(zb.BadInput, match="no parameter has this name"):
        good["J7"]


def test_in_agrees_with_a_row_by_name(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    for solution in (good, x_pattern):
        for name in ("J2", "delta2", "psd.x", "J7", "delta", 2):
            for thing, element in (
                (solution, lambda solution, name: solution[name]),
                (solution.covariance, lambda solution, name: solution.covariance[name, name]),
                (solution.covariance.names, lambda solution, name: solution.covariance.select([name])),
            ):
                try:
                    element(solution, name)
                except zb.BadInput:
                    assert name not in thing
                else:
                    assert name in thing
    assert "J2" in good.covariance
    assert "J2" not in x_pattern.covariance
    assert good["J2"] in good


def test_an_interval_of_any_level(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    row = good["J2"]
    np.testing.assert_allclose(row.interval(), row.interval95, rtol=1e-12)
    low, high = row.interval(0.68)
    np.testing.assert_allclose([row.estimate - low, high - row.estimate], normal_half_width(0.68) * row.u)
    assert x_pattern["J2"].interval(0.68) is None
    for level in (0, 1, 68, float("nan")):
        with pytest.raises(zb.BadInput, match="between 0 and 1"):
            row.interval(level)


def test_intervals_of_an_estimated_noise_are_students() -> None:
    joints = zb.read_run(demo_runs()[0].path).joints
    noise = zb.Noise(joint_deg=0.01, spot_mm=0.05, scale="estimated")
    run = zb.Run.from_arrays(**EXACT | {"noise": noise}, joints=joints, unit="rad")
    for row in zb.analyse(run, ess=100).offsets:
        if not row.held:
            np.testing.assert_allclose(row.interval(0.95), row.interval95, rtol=1e-12)
            low, high = row.interval(0.68)
            assert high - low > 2.02 * normal_half_width(0.68) * row.u


def test_correlations_are_labelled(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    correlation = good.covariance.correlation
    assert list(correlation.index) == list(correlation.columns) == list(good.covariance.names)
    np.testing.assert_allclose(np.diag(correlation), 1.0)
    scale = good["J2"].u * good["J3"].u
    assert correlation.loc["delta2", "delta3"] == pytest.approx(good.covariance["J2", "J3"] / scale)
    assert "delta2" not in x_pattern.covariance.correlation.index


def test_data_and_residuals_are_data_frames(good: zb.Analysed) -> None:
    data, residuals = good.data, good.residuals
    assert list(data.index) == list(residuals.index) == list(range(7))
    np.testing.assert_allclose(data[[f"J{i}_deg" for i in range(1, 7)]], np.degrees(good.run.joints))
    components = residuals[["residual_mm_1", "residual_mm_2"]]
    np.testing.assert_allclose(np.linalg.norm(components, axis=1), residuals["length_mm"])
    assert (residuals["target"] == "psd").all()
    normalised = good.fit.whitened.residual.reshape(7, 2)
    np.testing.assert_allclose(residuals["normalised"], np.linalg.norm(normalised, axis=1), rtol=1e-6)


def test_readings_have_columns_of_their_own() -> None:
    run = zb.Run.from_arrays(
        **EXACT,
        instruments={
            "leica": {"kind": "tracker", "frame": "free", "sigma_mm": 0.05, "reflectors": {"a": {}}}
        },
        joints=[[0, 0, 0, 0, 40, 0], [10, 0, 0, 0, 40, 0]],
        unit="deg",
        targets=["psd", None],
        measured={
            "instrument": ["tool", "leica"],
            "reflector": [None, "a"],
            "measured_mm": [None, [1.0, 2.0, 3.0]],
        },
    )
    frame = data_frame(run)
    assert frame.loc[1, ["measured_mm_1", "measured_mm_3"]].tolist() == [1.0, 3.0]
    assert frame.loc[0, "instrument"] == "tool"


def test_a_refit_is_the_analysis_of_what_is_left(good: zb.Analysed) -> None:
    again = good.refit(hold={"J6": 0}, drop=[3], ess=400)
    assert (again["delta6"].status, again["delta6"].estimate, again["delta6"].u) == ("held", 0.0, None)
    assert (again["delta1"].status, again["delta1"].cause) == ("held", good["delta1"].cause)
    assert list(again.data.index) == [0, 1, 2, 4, 5, 6]
    kept = np.delete(good.run.joints, 3, axis=0)
    fresh = zb.Run.from_arrays(**EXACT, joints=kept, unit="rad", held=["delta1", "delta6"])
    expected = zb.analyse(fresh, ess=400)
    for name in IDENTIFIED[:-1]:
        assert again[name].estimate == pytest.approx(expected[name].estimate, abs=1e-6)
        assert again[name].u == pytest.approx(expected[name].u, rel=1e-6)
    assert again.run.header.provenance["refit without measurements"] == "3"
    assert good.run.sha256 in again.run.header.provenance["refit of"]
    assert good["delta6"].status == "assumed"


@pytest.mark.parametrize(
    ("changes", "argument", "words"),
    [
        ({"drop": [99]}, "drop", "no measurement has this number"),
        ({"hold": {"delta6": 0.5}}, "hold", "at its nominal value only"),
        ({"hold": {"J9": 0}}, "hold", "no parameter has this name"),
    ],
)
def test_a_refit_that_makes_no_sense_is_refused(good: zb.Analysed, changes, argument, words) -> None:
    with pytest.raises(zb.BadInput, match=words) as caught:
        good.refit(**changes)
    assert caught.value.argument == argument


def test_profiles_and_contours_show_themselves(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    profile, contour = good.profile("J2", size=7), good.contour("J2", "J3", size=8)
    assert profile.deviation < 0.05
    assert contour.deviation < 0.05
    for one, kind in ((profile, "Profile"), (contour, "Contour")):
        assert repr(one).startswith(f"<{kind} of delta2")
        assert "<img" in one._repr_html_()
        axes = PlainFigure().subplots()
        assert one.plot(ax=axes) is axes
        assert len(axes.lines) >= 2
    for ask in (lambda: x_pattern.profile("J2"), lambda: x_pattern.contour("J3", "J2")):
        with pytest.raises(zb.BadInput, match="do not determine"):
            ask()


@pytest.mark.parametrize("name", ["offsets", "residuals"])
def test_a_figure_is_drawn_on_axes_of_the_reader(good: zb.Analysed, name: str, tmp_path) -> None:
    before = dict(matplotlib.rcParams)
    figure = PlainFigure()
    axes = figure.subplots()
    assert getattr(good.plot, name)(ax=axes) is axes
    figure.savefig(tmp_path / "figure.svg")
    assert b"</svg>" in (tmp_path / "figure.svg").read_bytes()
    assert axes.lines
    assert dict(matplotlib.rcParams) == before


@pytest.mark.long
def test_the_posterior_is_drawn_on_axes_of_the_reader(good: zb.Analysed) -> None:
    axes = PlainFigure().subplots(5, 5)
    assert good.plot.posterior(ax=axes) is axes
    assert not axes[0, 1].get_visible()
    assert len(axes[4, 0].collections) > 0
    with pytest.raises(zb.BadInput, match=r"\(5, 5\)"):
        good.plot.posterior(ax=PlainFigure().subplots(2, 2))


def test_a_prediction_is_the_arm_with_its_offsets(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    postures = np.array([[10, -20, 30, 5, 40, 0], [-15, 25, -5, 0, 35, 20.0]])
    delta = np.radians([row.estimate for row in good.offsets])
    predicted = good.predict(postures, "deg")
    point = np.array([0, 0, 65, 1.0])
    poses = good.run.robot.with_offsets(delta).fk(postures, "deg") @ point
    np.testing.assert_allclose(predicted[["x_mm", "y_mm", "z_mm"]], poses[:, :3], atol=1e-6)
    # The uncertainty by differences of forward kinematics.
    step, columns = 1e-5, []
    for i in range(1, 6):
        moved = delta + step * np.eye(6)[i]
        columns.append(
            ((good.run.robot.with_offsets(moved).fk(postures, "deg") @ point - poses) / step)[:, :3]
        )
    jacobian = np.stack(columns, axis=2)
    covariance = np.radians(np.radians(good.covariance.select(IDENTIFIED).matrix))
    variance = np.einsum("pia,ab,pib->pi", jacobian, covariance, jacobian)
    np.testing.assert_allclose(predicted[["u_x_mm", "u_y_mm", "u_z_mm"]], np.sqrt(variance), rtol=1e-3)
    assert x_pattern.predict(postures, "deg").isna().all(axis=None)
    with pytest.raises(zb.BadInput, match="the unit of the joints is not stated"):
        good.predict(postures)


@pytest.mark.long
def test_a_point_of_the_last_axis_does_not_depend_on_its_offset_although_links_deviate() -> None:
    typical = {key: value for key, value in EXACT.items() if key != "geometry"}
    joints = zb.read_run(demo_runs()[0].path).joints
    solution = zb.analyse(zb.Run.from_arrays(**typical, joints=joints, unit="rad", limits="warn"), ess=100)
    assert solution["J6"].status == "assumed"
    posture = [10, -20, 30, 5, 40, 0]
    assert solution.predict(posture, "deg").notna().all(axis=None)
    assert solution.predict(posture, "deg", point_mm=(50, 0, 65)).isna().all(axis=None)


def test_chains_are_ensembles_with_as_many_draws_as_they_are_worth(
    good: zb.Analysed, x_pattern: zb.Analysed
) -> None:
    """So that ArviZ's own R-hat and effective sample size over them are right."""
    posterior = good.posterior
    assert good.draws is not None
    assert posterior.sizes["chain"] == good.draws.values.shape[0]
    total = posterior.sizes["chain"] * posterior.sizes["draw"]
    assert 200 < total <= good.result.posterior.ess_min
    for name in IDENTIFIED:
        chains = posterior[name].to_numpy()
        assert chains.mean() == pytest.approx(good[name].estimate, abs=0.2 * good[name].u)
        assert float(array_stats.rhat(chains, method="rank")) < 1.03
        assert 0.5 * total < float(array_stats.ess(chains, method="bulk")) < 1.4 * total
    assert "delta2" not in x_pattern.posterior


def test_the_posterior_has_names_and_units(good: zb.Analysed) -> None:
    posterior = good.posterior
    assert isinstance(posterior, xr.Dataset)
    assert posterior["delta2"].attrs == {"units": "degree", "long_name": "delta2"}
    assert posterior["psd.x"].attrs["units"] == "mm"
    assert posterior.attrs["run"] == "arrays"


def test_a_solution_is_pickled_copied_and_compared(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    again = pickle.loads(pickle.dumps(good))
    assert again == good == copy.copy(good) == copy.deepcopy(good)
    assert hash(again) == hash(good)
    assert good != x_pattern
    assert good != "good"
    assert again.predict([0, 0, 0, 0, 40, 0], "deg").equals(good.predict([0, 0, 0, 0, 40, 0], "deg"))
    assert repr(pickle.loads(pickle.dumps(good.offsets))) == repr(good.offsets)
    assert zb.analyse(good.run, ess=400, seed=1) != good


@pytest.mark.long
def test_a_mix_up_of_radians_is_in_the_repr(good: zb.Analysed) -> None:
    run = zb.Run.from_arrays(**EXACT, joints=good.run.joints, unit="deg", limits="warn")
    solution = zb.analyse(run, ess=100)
    assert solution.verdict == "misfit"
    said = " ".join(repr(solution).split())
    assert "Most likely: unit of the angles. With the joint angles read as radians" in said
    assert "right --units" in said
    assert "repeat earlier ones" not in said  # as degrees the postures are nearly one
    with pytest.raises(zb.BadInput, match="misfit"):
        solution.predict([0, 0, 0, 0, 40, 0], "deg")


def test_progress_is_shown_on_request(good: zb.Analysed, monkeypatch) -> None:
    """A line for each stage where there is no tqdm; nothing outside a notebook unless it is asked for."""
    written = io.StringIO()
    monkeypatch.setattr(sys, "stderr", written)
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    zb.analyse(good.run, ess=100, progress=True)
    assert written.getvalue() == "fit …\nidentifiability …\nposterior …\ndiagnostics …\n"
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    for progress in (None, False):
        with shown_progress(progress) as report:
            assert report is None
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    with shown_progress(None) as report:
        assert report is not None
    with shown_progress(print) as report:
        assert report is print
