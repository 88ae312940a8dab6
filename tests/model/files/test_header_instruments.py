"""Instruments of a header other than `tool`: their entries, their targets, and what they need."""

import json
import sys

import pytest
from stub_kinds import stub_kinds

from zerobeam.model.files.header import Header, header_content
from zerobeam.model.files.measurements import read_header
from zerobeam.model.instruments import registry
from zerobeam.model.parsing.validation import validate

LASER = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
NOISE = {"joint_deg": 0.01}


@pytest.fixture(autouse=True)
def _stubs():
    with stub_kinds():
        yield


def made(**content):
    content = {"robot": "irb1600", "noise": NOISE, **content}
    return validate(Header, content, file=None, line=lambda _: None)


def test_entries_are_read_by_the_model_of_their_kind():
    header = made(
        instruments={
            "left": {"kind": "beacon", "sigma_mm": 0.5, "reflectors": {"r1": 1.0}},
            "eye": {"kind": "camera"},
        }
    )
    assert header.instruments["left"].reflectors == {"r1": 1.0}
    assert [kind.name for kind in header.kinds.values()] == ["beacon", "camera"]
    assert list(header.instruments_stated()) == ["left", "eye"]
    assert header.noise.spot_mm == 0
    assert not header.only_tools


def test_tool_is_one_of_them_and_keeps_its_name():
    header = made(tool=LASER, instruments={"eye": {"kind": "camera"}}, noise={**NOISE, "spot_mm": 0.1})
    assert list(header.instruments_stated()) == ["tool", "eye"]
    assert header.instruments_stated()["tool"] is header.tool


def test_a_laser_under_instruments_is_the_same_tool(refused):
    header = made(instruments={"beam": LASER}, noise={**NOISE, "spot_mm": 0.1})
    assert header.stated_tool == made(tool=LASER, noise={**NOISE, "spot_mm": 0.1}).tool
    assert header.tool_kind.beam
    assert header.only_tools
    error = refused(made, instruments={"beam": {**LASER, "directoin": 1}}, noise={**NOISE, "spot_mm": 0.1})
    assert error.remedy == "did you mean 'direction'?"


def test_what_is_written_is_read_again_as_the_same():
    instruments = {"left": {"kind": "beacon", "reflectors": {"r1": 1.0}}, "beam": LASER}
    targets = {"top": {"kind": "plane", "normal": [0, 0, 1]}, "psd": {}}
    header = made(
        instruments={**instruments, "edge": {"kind": "edge"}},
        targets=targets,
        noise={**NOISE, "spot_mm": 0.1},
    )
    content = json.loads(json.dumps(header_content(header, "zerobeam/run/1")))
    assert content["instruments"]["left"] == {"kind": "beacon", "reflectors": {"r1": 1.0}}
    assert content["targets"] == targets
    again = validate(Header, content, file=None, line=lambda _: None)
    assert again.model_copy(update={"schema_": None}) == header


@pytest.mark.parametrize(
    ("instruments", "line", "words"),
    [
        ("  a: {kind: cameras}", 4, "did you mean 'camera'?"),
        ("  a: {kind: cameras}", 4, "laser, probe"),
        ("  a:\n    kind: camera\n    sigma: 1", 6, "did you mean 'sigma_mm'?"),
        ("  a:\n    kind: beacon\n    reflectors: {r: -1}", 6, "> 0"),
        ("  a: {}", 4, "the kind of an instrument is missing"),
        ("  a: camera", 4, "has keys of its own"),
        ("  tool: {kind: camera}", 4, "cannot be called 'tool'"),
        ("  a: {kind: gone}", 4, "No module named 'no_such_package'"),
        ("  a: {kind: nameless}", 4, "is called 'other'"),
        ("  a: {kind: number}", 4, "no subclass"),
    ],
)
def test_a_bad_entry_is_refused_with_its_line(refused, tmp_path, instruments, line, words):
    path = tmp_path / "header.yaml"
    path.write_text(f"robot: irb1600\nnoise: {{joint_deg: 0.01}}\ninstruments:\n{instruments}\n")
    error = refused(read_header, path)
    assert (error.file, error.line) == (str(path), line)
    assert words in str(error)


def test_a_broken_package_is_named(refused, tmp_path, monkeypatch):
    info = tmp_path / "rulers-1.5.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rulers\nVersion: 1.5\n")
    (info / "entry_points.txt").write_text("[zerobeam.instruments]\nruler = rulers:Ruler\n")
    (tmp_path / "rulers.py").write_text("import nothing_of_this_name\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        from importlib.metadata import entry_points

        patch.setattr(
            registry, "_entry_points", lambda: {p.name: p for p in entry_points(group=registry.GROUP)}
        )
        error = refused(made, instruments={"a": {"kind": "ruler"}})
    assert "package rulers 1.5 cannot be loaded" in error.what
    assert "nothing_of_this_name" in error.found
    assert "rulers" not in sys.modules


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({}, "the key 'tool' is missing"),
        ({"instruments": {}}, "no instrument is stated"),
        ({"tool": LASER}, "the key 'spot_mm' is missing in noise"),
        ({"instruments": {"beam": LASER}}, "the key 'spot_mm' is missing in noise"),
        ({"instruments": {"a": {"kind": "camera"}}, "targets": {"a": {}}}, "both called 'a'"),
    ],
)
def test_what_a_header_lacks(refused, content, words):
    assert words in str(refused(made, **content))


EDGE, GLOBE, CAMERA = ({"kind": kind} for kind in ("edge", "globe", "camera"))
TOP, SIDE = {"kind": "plane", "normal": [0, 0, 1]}, {"kind": "plane", "normal": [2, 0, 0]}
RIGHT = {"between": ["top", "side"], "deg": 90, "sigma_deg": 0.01}


def test_targets_of_every_kind_and_the_angles_between_planes():
    header = made(
        instruments={"edge": EDGE, "globe": GLOBE, "eye": CAMERA},
        targets={"top": TOP, "side": SIDE, "ball": {"kind": "sphere", "diameter_mm": 38.1}, "mark": {}},
        angles=[RIGHT],
    )
    assert (header.targets["top"].sigma_deg, header.targets["side"].normal) == (30, (2, 0, 0))
    assert header.targets["ball"].diameter_mm == 38.1
    assert (header.angles[0].between, header.angles[0].deg) == (("top", "side"), 90)


@pytest.mark.parametrize(
    ("instrument", "targets", "words"),
    [
        (EDGE, {"top": {"kind": "plane"}}, "add normal"),
        (EDGE, {"top": {**TOP, "normal": [0, 0, 0]}}, "has no length"),
        (EDGE, {"top": {}}, "no instrument measures a target that is a point"),
        (GLOBE, {"ball": {"kind": "sphere"}}, "add diameter_mm"),
        (GLOBE, {"ball": {"kind": "ball", "diameter_mm": 3}}, "'point', 'plane' or 'sphere'"),
        (CAMERA, {"mark": {"diameter_mm": 3}}, "remove it, or state kind: sphere"),
        (CAMERA, {"mark": {"sigma_deg": 3}}, "remove it, or state kind: plane"),
        (CAMERA, {"top": TOP}, "no instrument measures a target that is a plane"),
        ({"kind": "beacon"}, {"mark": {}}, "no target"),
    ],
)
def test_a_target_that_is_not_as_it_is_measured(refused, instrument, targets, words):
    assert words in str(refused(made, instruments={"a": instrument}, targets=targets))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"angles": [{**RIGHT, "between": ["top", "top"]}]}, "a plane and itself"),
        ({"angles": [{**RIGHT, "between": ["top", "sid"]}]}, "did you mean 'side'?"),
        ({"angles": [{**RIGHT, "between": ["top", "mark"]}]}, "an angle is to a target that is a point"),
        ({"angles": [{**RIGHT, "deg": 180}]}, "180"),
        ({"distances": [{"between": ["top", "mark"], "mm": 5, "sigma_mm": 1}]}, "a distance is to a target"),
    ],
)
def test_an_angle_is_between_planes_and_a_distance_is_not(refused, content, words):
    targets = {"top": TOP, "side": SIDE, "mark": {}}
    error = refused(made, instruments={"edge": EDGE, "eye": CAMERA}, targets=targets, **content)
    assert words in str(error)


def test_what_only_a_tool_can_do_refuses_others(refused):
    header = made(instruments={"eye": CAMERA})
    assert header.instrument.name == "camera"
    for ask in ("stated_tool", "tool_kind"):
        error = refused(getattr, header, ask)
        assert (error.found, error.allowed) == ("kind: camera", "laser or probe")
    both = made(instruments={"eye": CAMERA, "edge": EDGE})
    assert "a single instrument" in refused(getattr, both, "instrument").what
