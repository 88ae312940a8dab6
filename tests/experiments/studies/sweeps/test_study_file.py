"""Study files: what they may say, what becomes of it, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from zerobeam.experiments.studies.sweeps.study_file import (
    OTHER_STUDIES,
    Settings,
    SettingsStudy,
    built_in_studies,
    built_in_study,
    read_study,
    setting_names,
)
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import StatedGeometry

BASE = """\
schema: zerobeam/study-file/1
study: own
title: A study of one's own
base:
  robot: irb1600
  tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
  noise: {joint_deg: 0.01, spot_mm: 0.05}
  target: {xyz_mm: [900, 100, 0]}
  plan: {kind: y}
  runs: 0
axes:
"""
SHOTS = "  - {key: plan.shots, label: shots, values: [5, 7]}\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def read(folder: Path, axes: str, base: str = BASE, runs: int | None = None) -> SettingsStudy:
    return read_study(written(folder, base + axes), runs)


def refused(folder: Path, axes: str, base: str = BASE, runs: int | None = None) -> BadInput:
    with pytest.raises(BadInput) as caught:
        read(folder, axes, base, runs)
    return caught.value


def test_every_combination_is_a_case_and_the_last_axis_changes_fastest(tmp_path: Path) -> None:
    study = read(
        tmp_path, SHOTS + "  - {key: noise.joint_deg, label: noise, unit: deg, values: [0.1, 0.2]}\n"
    )
    assert [case.at for case in study.cases] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert study.cases[1].words == "shots 5, noise 0.2°"
    settings_of_cases = [(case.settings.plan.shots, case.settings.noise.joint_deg) for case in study.cases]
    assert settings_of_cases == [(5, 0.1), (5, 0.2), (7, 0.1), (7, 0.2)]
    # What no axis changes is the base's, in what it states and in what it leaves open.
    assert {
        (c.settings.plan.kind, c.settings.plan.candidates, c.settings.noise.spot_mm) for c in study.cases
    } == {("y", 1000, 0.05)}


def test_coordinates_points_words_and_several_settings_at_once(tmp_path: Path) -> None:
    axes = (
        "  - {key: target.xyz_mm.y, values: [-50]}\n"
        "  - {key: tool.direction, values: [[0, 1, 0]]}\n"
        "  - {key: plan.facing.x, values: [0.5]}\n"
        "  - {key: tool.calibrated, values: [true, false]}\n"
        "  - key: arm\n"
        "    values:\n"
        "      - {name: Panda, set: {robot: panda, plan.kind: optimal, plan.beam_mm: [100, 900]}}\n"
    )
    one, other = read(tmp_path, axes).cases
    assert one.settings.target.xyz_mm == (900, -50, 0)
    assert one.settings.tool.direction == (0, 1, 0)
    assert one.settings.plan.facing == (0.5, 0, 1)
    assert (one.settings.tool.calibrated, other.settings.tool.calibrated) == (True, False)
    plan = one.settings.plan
    assert (one.robot.name, plan.kind, plan.beam_mm) == ("panda", "optimal", (100, 900))
    words = (
        "target.xyz_mm.y \u221250, tool.direction [0, 1, 0], plan.facing.x 0.5, tool.calibrated yes, Panda"
    )
    assert one.words == words
    assert one.header.targets["psd"].guess_mm == (900, -50, 0)
    assert one.header.targets["psd"].sigma_mm == 30


def test_tolerances_of_the_geometry_may_be_stated_and_varied(tmp_path: Path) -> None:
    axis = "  - {key: geometry.tolerance.length_mm, unit: mm, values: [0.1, 0.3]}\n"
    base = BASE.replace("  runs: 0\n", "  runs: 0\n  geometry: {gravity: false, harmonics: false}\n")
    geometries = [case.header.geometry for case in read(tmp_path, axis, base).cases]
    assert [geometry.tolerance.length_mm for geometry in geometries if geometry is not None] == [0.1, 0.3]
    assert [geometry.gravity for geometry in geometries if geometry is not None] == [False, False]
    plain = read(tmp_path, SHOTS).cases[0]
    assert plain.header.geometry is None
    assert plain.header.arm == StatedGeometry()
    # A case without it is what it was before there was such a key, and has the same random numbers.
    assert "geometry" not in plain.settings.as_in_file()


BESIDE = "beside:\n  - {name: optimal, set: {plan.kind: optimal}}\n  - {name: base, set: {}}\n"


def test_cases_beside_the_grid_are_the_base_with_their_own_changes(tmp_path: Path) -> None:
    study = read(tmp_path, SHOTS + BESIDE)
    assert [case.at for case in study.cases] == [(0,), (1,)]
    assert [(case.at, case.words, case.settings.plan.kind) for case in study.beside] == [
        ((), "optimal", "optimal"),
        ((), "base", "y"),
    ]
    assert read(tmp_path, SHOTS).beside == ()


def test_what_cannot_be_beside_is_refused_where_it_stands(tmp_path: Path) -> None:
    error = refused(tmp_path, SHOTS + BESIDE.replace("name: base", "name: optimal"))
    assert "two cases beside the grid have the same name" in str(error)
    assert error.line == 15
    error = refused(tmp_path, SHOTS + BESIDE.replace("set: {}", "set: {plan.shot: 3}"))
    assert "no setting of this name" in error.what
    assert error.line == 15
    error = refused(tmp_path, SHOTS + BESIDE.replace("set: {}", "set: {runs: 3}"), runs=5)
    assert "--runs" in error.what


def test_a_pattern_has_one_width(tmp_path: Path) -> None:
    both = BASE.replace("{kind: y}", "{kind: y, span: 0.4, width_mm: 900}")
    error = refused(tmp_path, SHOTS, both)
    assert "span and width_mm state the same length" in str(error)
    assert error.line == 9


def test_runs_asked_for_take_the_place_of_the_files(tmp_path: Path) -> None:
    assert {case.settings.runs for case in read(tmp_path, SHOTS, runs=3).cases} == {3}
    error = refused(tmp_path, "  - {key: runs, values: [2, 3]}\n", runs=3)
    assert "--runs" in error.what


def test_a_robot_file_is_found_beside_the_study(tmp_path: Path) -> None:
    built_in = Path(__file__).parents[4] / "model" / "robots" / "irb1600.yaml"
    (tmp_path / "mine.yaml").write_text(built_in.read_text(encoding="utf-8"), encoding="utf-8")
    copied = read(tmp_path, SHOTS, BASE.replace("irb1600", "mine.yaml"))
    assert copied.cases[0].robot.name == "irb1600"
    # It is the arm that counts, not how it is named.
    assert copied.cases[0].fingerprint == read(tmp_path, SHOTS).cases[0].fingerprint
    changed = built_in.read_text(encoding="utf-8").replace("a_mm: 700", "a_mm: 701")
    (tmp_path / "mine.yaml").write_text(changed, encoding="utf-8")
    other = read(tmp_path, SHOTS, BASE.replace("irb1600", "mine.yaml"))
    assert other.cases[0].fingerprint != copied.cases[0].fingerprint


def test_the_fingerprint_is_of_every_setting(tmp_path: Path) -> None:
    settings = read(tmp_path, SHOTS).cases[0].settings
    content = settings.model_dump(mode="json", by_alias=True)
    assert set(content) == {name for name in setting_names() if "." not in name}
    one = read(tmp_path, SHOTS).cases
    assert one[0].fingerprint != one[1].fingerprint
    other = read(tmp_path, SHOTS, BASE.replace("spot_mm: 0.05", "spot_mm: 0.06")).cases
    assert one[0].fingerprint != other[0].fingerprint
    renamed = read(tmp_path, SHOTS, BASE.replace("study: own", "study: ours")).cases
    assert one[0].fingerprint == renamed[0].fingerprint


@pytest.mark.parametrize(
    ("axes", "what", "line"),
    [
        ("  - {key: plan.shot, values: [5]}\n", "no setting of this name", 12),
        ("  - {key: plan.shots.x, values: [5]}\n", "is not a point", 12),
        ("  - {key: plan.shots, values: [5, 0]}\n", "plan.shots is out of range", 12),
        ("  - {key: plan.shots, values: [5, 5]}\n", "duplicate value", 12),
        ("  - {key: plan.shots, values: []}\n", "axes[1].values is empty", 12),
        ("  - {key: plan.shots, values: [[1, 2]]}\n", "cannot be a value", 12),
        ("  - {key: noise.scale, values: [estimated]}\n", "the noise of a study is known", 12),
        ("  - {key: geometry.scale, values: [estimated]}\n", "the tolerances of a study are known", 12),
        ("  - {key: geometry.tolerance.length_mm, values: [0]}\n", "tolerance of the geometry cannot", 12),
        ("  - {key: robot, values: [irb1601]}\n", "no robot of this name", 12),
        ("  - {key: held, values: [x]}\n", "held", 12),
        (SHOTS + "  - {key: plan.shots, values: [9]}\n", "two axes have the same key", 13),
        (SHOTS + "  - {key: plan, values: [{name: a, set: {plan.shots: 3}}]}\n", "same setting", 13),
        (SHOTS + "  - {key: noise.spot_mm, values: [0.1], every: 2}\n", "unknown key 'every'", 13),
        ("  - {key: costs, values: [{name: a, set: {costs: [midpoint]}}]}\n", "likelihood", 12),
    ],
)
def test_what_cannot_be_is_refused_where_it_stands(tmp_path: Path, axes: str, what: str, line: int) -> None:
    error = refused(tmp_path, axes)
    assert what in str(error)
    assert (error.file, error.line) == (str(tmp_path / "own.yaml"), line)


def test_what_cannot_be_of_the_base_is_refused_where_it_stands(tmp_path: Path) -> None:
    error = refused(tmp_path, SHOTS, BASE.replace("kind: y", "kind: z"))
    assert error.line == 9
    error = refused(tmp_path, SHOTS, BASE.replace("  runs: 0\n", "  runs: 0\n  held: [delta9]\n"))
    assert "held names a parameter that is not there" in str(error)
    assert error.line == 11
    error = refused(tmp_path, SHOTS, BASE.replace("study-file/1", "cell/1"))
    assert "not a study file" in error.what
    for name in OTHER_STUDIES:
        assert refused(tmp_path, SHOTS, BASE.replace("study: own", f"study: {name}")).line == 2


def test_a_study_of_too_many_cases_is_refused(tmp_path: Path) -> None:
    values = ", ".join(str(i + 1) for i in range(101))
    axes = f"  - {{key: plan.shots, values: [{values}]}}\n  - {{key: plan.candidates, values: [{values}]}}\n"
    assert refused(tmp_path, axes).found == "10201 cases"


@pytest.mark.long
def test_the_built_in_studies_are_such_files(tmp_path: Path) -> None:
    names = built_in_studies()
    assert names == ("cost", "noise", "patterns", "psd-position", "robots", "shots", "tool")
    for name in names:
        study = read_study(built_in_study(name))
        assert study.content.study == name
        # A copy that somebody changes is read from anywhere.
        copy = tmp_path / "copy.yaml"
        copy.write_text(built_in_study(name).read_text(encoding="utf-8"), encoding="utf-8")
        assert [c.fingerprint for c in read_study(copy).cases] == [c.fingerprint for c in study.cases]
    with pytest.raises(BadInput, match="did you mean 'noise'"):
        built_in_study("nois")


def test_the_settings_can_be_written_out_and_read_again(tmp_path: Path) -> None:
    settings = read(tmp_path, SHOTS).content.base
    again = Settings.model_validate(json.loads(json.dumps(settings.model_dump(mode="json", by_alias=True))))
    assert again == settings
    assert np.isfinite(again.plan.margin_deg)
