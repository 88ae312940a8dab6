"""The study of wrong models: its simulator against the model, and a small sample of the whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zerobeam.analysis.diagnostics.diagnosis import diagnose
from zerobeam.experiments.studies import wrong_models
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.wrong_arms import recorded, scenarios, typical
from zerobeam.experiments.studies.wrong_models import header_of, plan_of, wrong_models_study
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.studies.study_pages import WRONG_MODELS, markdown, study_page


@pytest.fixture(scope="module", autouse=True)
def few_candidates():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wrong_models, "_CANDIDATES", 60)
        yield


@pytest.mark.long
def test_an_arm_without_noise_and_backlash_is_what_the_model_has() -> None:
    """At the true parameters nothing is left of the residuals."""
    header, robot = header_of("irb1600"), load_robot("irb1600", Path())
    postures = plan_of("irb1600", 7, 0)
    problem = Problem.build(header, robot, postures, ["psd"] * 7)
    target = np.array([950.0, 150.0, 100.0])
    rng = np.random.default_rng(1)
    course = typical(robot, problem.geometry, problem.tool, target, 7, rng)
    course = replace(course, backlash=0 * course.backlash, noise=0.0)
    joints, spots = recorded(course, postures, problem.noise.joint, 0.05, problem.tool, rng)
    problem, names = problem.moved(joints, spots), problem.parameters.names
    x = problem.parameters.prior_mean.copy()
    x[:6] = course.offsets[0]
    x[problem.parameters.block("target")] = course.target[0]
    links = [item for item in problem.geometry.names if item[0].startswith("link")]
    for (of, axis), value in zip(links, course.links[0], strict=True):
        x[names.index(f"{of}.{axis}")] = value
    for of, axis in problem.geometry.names[len(links) :]:
        i = int(of.removeprefix("joint")) - 1
        value = course.gravity[0, i] if axis == "gravity" else course.harmonics[0, i, int(axis == "sin")]
        x[names.index(f"{of}.{axis}")] = value
    along = course.direction[0]  # the beam is nominally along x
    on_plane = course.point[0] - along * (course.point[0] - problem.tool.point)[0] / along[0]
    x[names.index("tool.tilt1")], x[names.index("tool.tilt2")] = np.arctan(along[1:] / along[0])
    x[names.index("tool.shift1")], x[names.index("tool.shift2")] = (on_plane - problem.tool.point)[1:]
    np.testing.assert_allclose(problem.linearise(x)[0], 0.0, atol=1e-9)
    x[names.index("link2.a")] += 0.1
    assert np.abs(problem.linearise(x)[0]).max() > 0.01


@pytest.mark.parametrize("name", ["zero of J3 -30° off", "zero of J2 90° off"])
@pytest.mark.long
def test_a_zero_beyond_its_prior_is_named_though_others_take_up_more_of_the_links(name: str) -> None:
    (scenario,) = (one for one in scenarios() if one.name == name)
    for _, solution in wrong_models._solved(scenario, plan_of("irb1600", 12, 0), 3, 0):
        first = diagnose(solution)[0]
        assert scenario.is_named_by(first.cause, first.joints)


def test_there_are_at_least_forty_wrong_models_each_with_a_name() -> None:
    names = [one.name for one in scenarios()]
    assert len(names) == len(set(names)) > 40


@pytest.mark.long
def test_a_small_study_is_carried_out_and_shown() -> None:
    names = [one.name for one in scenarios()]
    chosen = [names[0], "sign of J3 reversed", "zero of J5 jumps by 0.5°"]
    answer = wrong_models_study(2, Engine(0, processes=1), names=chosen, measurements=(12,))
    control, sign, jump = answer.models
    assert (control.passes, control.misfits, control.beyond) == (2, 0, 0)
    assert (sign.misfits, sign.named, sign.decided_right) == (2, 2, 2)
    assert (jump.passes, jump.beyond) == (0, 0)
    assert answer.agrees
    assert study_page(answer).verdict.key == "pass"
    assert len(list(WRONG_MODELS.tables["models.csv"](answer))) == 3
    assert markdown(answer).count("\n") == 5


@pytest.mark.long
def test_a_pass_with_wrong_intervals_does_not_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wrong_models, "LIMIT_U", 1e-3)
    (control,) = (one for one in scenarios() if one.name.startswith("control"))
    answer = wrong_models_study(2, Engine(0, processes=1), names=[control.name], measurements=(7,))
    assert not answer.agrees
    assert control.name in answer.headline
