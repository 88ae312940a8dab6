"""The answer of `zerobeam.analyse` as programs and notebooks hold it."""

import base64
import json
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from analysed_once import analysed_once
from exact_runs import demo_runs
from pages import Page

import zerobeam as zb
from zerobeam.face.pictures import Figure
from zerobeam.words.sentences import to_json

OFFSETS = [f"delta{i}" for i in range(1, 7)]
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def x_pattern() -> zb.Analysed:
    return analysed_once(zb.read_run(demo_runs()[1].path), ess=100)


@pytest.fixture(scope="module")
def unconverged(good: zb.Analysed) -> zb.Analysed:
    """A run that no offsets explain: noise far too small for joints that are not the arm's."""
    joints = good.run.joints * np.where(np.arange(6) % 2, -1.0, 0.5)
    run = zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=joints,
        unit="rad",
        noise=zb.Noise(joint_deg=1e-11, spot_mm=1e-11),
        limits="warn",
    )
    return zb.analyse(run, ess=100)


@pytest.mark.long
def test_values_to_enter_are_those_of_the_first_page(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    assert good.enter == good.to_json()["enter"]["values"]
    assert x_pattern.enter == {}


def test_it_is_a_solution_with_rows_by_name(good: zb.Analysed) -> None:
    assert isinstance(good, zb.Solution)
    row = good["delta2"]
    assert row is good.result.parameters.named("delta2")
    assert row.u == row.std
    low, high = row.interval95
    assert low < row.estimate < high
    with pytest.raises(zb.BadInput, match="did you mean 'delta2'"):
        good["delta22"]


def test_the_offsets_are_a_data_frame(x_pattern: zb.Analysed) -> None:
    frame = x_pattern.offsets.to_frame()
    assert list(frame.index) == OFFSETS
    assert frame.loc["delta2"].isna().sum() == 4
    assert frame.loc["delta3", "u"] == x_pattern["delta3"].u
    assert frame.loc["delta1", "status"] == "held"


def test_what_is_unidentifiable_has_no_row_in_the_covariance(x_pattern: zb.Analysed) -> None:
    covariance = x_pattern.covariance
    known = [row.name for row in x_pattern.parameters if row.status in ("identified", "weak", "assumed")]
    assert list(covariance.names) == known
    assert "delta2" not in known
    frame = covariance.to_frame()
    assert list(frame.index) == list(frame.columns) == known
    np.testing.assert_allclose(
        np.sqrt(np.diag(covariance.matrix)), [x_pattern[name].u for name in known], rtol=1e-12
    )
    with pytest.raises(zb.BadInput, match="do not determine it"):
        covariance["delta2", "delta3"]


@pytest.mark.parametrize("missing", ["pandas", "xarray"])
def test_an_optional_library_that_is_missing_is_said_so(good, missing, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(zb.BadInput, match=f"{missing}(.|\n)*zerobeam\\[notebook\\]"):
        good.offsets.to_frame() if missing == "pandas" else good.posterior


def test_it_says_in_short_what_it_is(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    assert repr(good).startswith("Solution of good.jsonl")
    for sol in (good, x_pattern):
        lines = repr(sol).splitlines()
        assert len(lines) < 25
        assert max(map(len, lines)) < 110
    (row,) = (line for line in repr(x_pattern).splitlines() if line.startswith("  J2 "))
    assert " ".join(row.split()[1:]) == "not determined by these data ✕ no: unidentifiable"
    (row,) = (line for line in repr(good).splitlines() if line.startswith("  J2 "))
    assert re.search(r"−1\.\d\d\d?°  +0\.\d+°  +● yes", row)


def test_its_card_is_whole_and_has_no_script(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    for sol in (good, x_pattern):
        assert {tag for tag, _ in Page(sol._repr_html_()).tags}.isdisjoint(
            {"script", "link", "img", "iframe"}
        )
        assert "://" not in re.sub(r'xmlns="[^"]+"', "", sol._repr_html_())
    assert "not determined by these data" in x_pattern._repr_html_()


def test_hostile_names_stay_names(good: zb.Analysed) -> None:
    run = zb.Run.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
        joints=good.run.joints,
        unit="rad",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        targets=HOSTILE,
        name=HOSTILE,
    )
    sol = zb.analyse(run, ess=100)
    for shown in (sol._repr_html_(), sol.plot.residuals()._repr_html_(), sol.plot.scene()._repr_html_()):
        assert HOSTILE not in shown
    assert {tag for tag, _ in Page(sol._repr_html_()).tags}.isdisjoint({"script"})


@pytest.mark.parametrize("name", ["offsets", "residuals", "posterior"])
@pytest.mark.one_in(3)
def test_a_figure_shows_and_saves_itself(good: zb.Analysed, name: str, tmp_path: Path) -> None:
    figure = getattr(good.plot, name)()
    assert isinstance(figure, Figure)
    assert ElementTree.fromstring(figure._repr_svg_()).tag.endswith("svg")
    ((_, attributes),) = (one for one in Page(figure._repr_html_()).tags if one[0] == "img")
    assert attributes["alt"] == figure.alt
    kind, data = attributes["src"].split(",")
    assert kind == "data:image/svg+xml;base64"
    inside = base64.b64decode(data).decode()
    assert ElementTree.fromstring(inside).tag.endswith("svg")
    assert "@font-face" in inside
    for ending, start in ((".svg", b"<svg"), (".pdf", b"%PDF"), (".png", b"\x89PNG")):
        assert figure.savefig(tmp_path / f"{name}{ending}").read_bytes().startswith(start)
    assert figure.savefig(tmp_path / f"{name}.svg").read_bytes().startswith(b"<svg")
    with pytest.raises(zb.BadInput, match=r"argument path(.|\n)*\.svg, \.pdf, \.png"):
        figure.savefig(tmp_path / f"{name}.jpg")


def test_the_scene_is_a_page_in_a_frame(good: zb.Analysed, tmp_path: Path) -> None:
    scene = good.plot.scene()
    ((tag, attributes),) = Page(scene._repr_html_()).tags
    assert (tag, attributes["sandbox"]) == ("iframe", "allow-scripts")
    assert attributes["srcdoc"] == scene.page
    assert [tag for tag, _ in Page(scene.page).tags].count("canvas") == 1
    assert "default-src 'none'" in scene.page
    assert scene.save(tmp_path / "scene.html").read_text(encoding="utf-8") == scene.page


def test_the_posterior_is_of_what_the_data_determine(good: zb.Analysed, x_pattern: zb.Analysed) -> None:
    posterior = good.posterior
    assert abs(float(posterior["delta2"].mean()) - good["delta2"].estimate) < good["delta2"].u
    assert set(posterior.data_vars) == set(good.draws.names)
    assert "delta2" not in x_pattern.posterior
    assert "delta3" in x_pattern.posterior


def test_without_a_fit_there_is_nothing_to_show(unconverged: zb.Analysed) -> None:
    assert unconverged.draws is None
    assert unconverged.verdict == "degenerate"
    assert unconverged.covariance.matrix.shape == (0, 0)
    assert "no estimate" in repr(unconverged)
    for ask in (
        lambda: unconverged.posterior,
        lambda: unconverged.plot.posterior(),
        lambda: unconverged.plot.scene(),
    ):
        with pytest.raises(zb.BadInput, match=r"no (draws|posterior|scene)"):
            ask()


def test_its_json_is_that_of_the_report(good: zb.Analysed, tmp_path: Path) -> None:
    paths = good.report(tmp_path / "out")
    assert good.to_json() == to_json(good.result) == json.loads(paths.result.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("arguments", "argument"),
    [
        ({"run": "run.jsonl"}, "run"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"ess": 10}, "ess"),
        ({"ess": float("nan")}, "ess"),
        ({"robust": "cauchy"}, "robust"),
    ],
)
def test_a_bad_argument_is_named(good: zb.Analysed, arguments, argument) -> None:
    with pytest.raises(zb.BadInput) as caught:
        zb.analyse(**{"run": good.run, **arguments})
    assert caught.value.argument == argument


def test_researchers_have_jacobian_rank_and_condition() -> None:
    """The Jacobian against differences of the whitened residuals; of an X-Pattern it is singular."""
    import numpy as np

    run = zb.read_run(demo_runs()[1].path)
    solution = analysed_once(run, ess=100)
    problem, x, exact = solution.problem, solution.fit.x, solution.jacobian
    assert exact.shape == (problem.whiten(x).residual.size, problem.parameters.free.sum())
    for name in ("delta2", "delta4", "psd.x"):
        k = [item.name for item in problem.parameters.items].index(name)
        factor, step = problem.factors(x, problem.linearise(x)[1]), 1e-4 * problem.parameters.prior_std[k]
        ends = []
        for sign in (1, -1):
            moved = x.copy()
            moved[k] += sign * step
            ends.append(problem.whiten(moved, factor).residual)
        by_differences = (ends[0] - ends[1]) / 2e-4
        assert np.allclose(exact[name], by_differences, rtol=1e-4, atol=1e-4 * np.abs(exact[name]).max())
    assert solution.condition is None
    assert solution.rank == solution.result.identifiability.rank < exact.shape[1]
    tree = solution.to_arviz()
    assert "delta2" not in tree["posterior"].data_vars
    assert "delta4" in tree["posterior"].data_vars
