"""The folder that is not left: by which names, through which links, and by what files name."""

import os
from pathlib import Path

import pytest
from beside import CAMERA, psd, sensors
from cells import good_plan

from zerobeam.experiments.history import database
from zerobeam.experiments.sensors.attached import read_sensors
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN, load_robot
from zerobeam.model.files.whole_file import write_whole
from zerobeam.model.parsing.confinement import WITHIN, confined, require_within, resolved
from zerobeam.model.parsing.reading import read_bytes
from zerobeam.reports.output.whole_folder import Kind, check_target

ALWAYS = [
    "",
    ".",
    "..",
    "sub/..",
    "../out.yaml",
    "/etc/passwd",
    "a\0b",
    "a\\b",
    "C:x",
    "a/" + "x" * 256,
    "x" * 1001,
]
LINKED = ["link.yaml", "way/out.yaml", "way/dir/in.yaml/../../out.yaml", "loop/../../out.yaml"]
HIDDEN = [".ssh/key", "sub/.x", "sub/../.ssh/key", "to-hidden"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "dir"
    (made / "sub").mkdir(parents=True)
    (made / ".ssh").mkdir()
    (made / ".ssh" / "key").write_text("secret")
    (made / "in.yaml").write_text("inside")
    (tmp_path / "out.yaml").write_text((BUILT_IN / "irb1600.yaml").read_text())
    (tmp_path / "dirty").mkdir()  # begins as the folder does
    (made / "link.yaml").symlink_to(tmp_path / "out.yaml")
    (made / "way").symlink_to(tmp_path)
    (made / "to-hidden").symlink_to(made / ".ssh" / "key")
    (made / "loop").symlink_to(made / "loop")
    return Path(os.path.realpath(made))


@pytest.mark.parametrize("name", [*ALWAYS, *LINKED, *HIDDEN, "../dirty/x"])
def test_no_name_leads_out(folder: Path, name: str) -> None:
    with pytest.raises(BadInput):
        resolved(folder, name)
    if "\0" not in name and "C:" not in name and "\\" not in name and len(name) < 200:
        with confined(folder), pytest.raises(BadInput):
            require_within(folder / name)


@pytest.mark.parametrize("name", ["in.yaml", "sub/../in.yaml", "new", "sub/x..y", "way/dir/in.yaml"])
def test_the_control(folder: Path, name: str) -> None:
    assert resolved(folder, name).is_relative_to(folder)
    with confined(folder):
        require_within(folder / name)
        require_within(BUILT_IN / "irb1600.yaml")
    assert resolved(folder, "../in.yaml", folder / "sub") == folder / "in.yaml"
    assert resolved(folder, ".x", hidden=True) == folder / ".x"


def test_what_opens_files_is_confined_and_nothing_else(folder: Path, tmp_path: Path) -> None:
    outside = tmp_path / "out.yaml"
    kind = Kind("report", frozenset({"a"}), "a", "b")

    def used() -> list[tuple[str, str]]:
        refused = []
        for name, use in {
            "read": lambda: read_bytes(outside),
            "robot": lambda: load_robot("../out.yaml", folder),
            "write": lambda: write_whole(tmp_path / "new", "text"),
            "folder": lambda: check_target(tmp_path / "report", kind),
        }.items():
            try:
                use()
            except BadInput as error:
                refused.append((name, error.what))
        return refused

    assert used() == []
    (tmp_path / "new").unlink()
    with confined(folder):
        message = "this path is not below the app's folder"
        assert used() == [(name, message) for name in ("read", "robot", "write", "folder")]
        assert read_bytes(folder / "in.yaml") == b"inside"
        write_whole(folder / "made", "text")
        load_robot("ur5e", folder)
    assert not (tmp_path / "new").exists()
    assert used() == []


def test_a_process_is_confined_by_its_environment(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WITHIN, str(folder))
    with pytest.raises(BadInput, match="not below"):
        read_bytes(folder.parent / "out.yaml")


def test_what_names_a_file_is_said(folder: Path) -> None:
    with confined(folder), pytest.raises(BadInput) as caught:
        load_robot("../out.yaml", folder, file=folder / "plan.yaml", line=3)
    assert (caught.value.file, caught.value.line) == (str(folder / "plan.yaml"), 3)
    assert caught.value.remedy is not None
    with confined(folder), pytest.raises(BadInput) as there:
        load_robot("../nothing.yaml", folder)
    assert there.value.what == caught.value.what  # nobody learns what is there


def test_a_history_is_within(folder: Path) -> None:
    with confined(folder), pytest.raises(BadInput, match="not below"):
        database.open_history(str(folder.parent / "h.sqlite"), create=True)
    assert not (folder.parent / "h.sqlite").exists()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"psds": {"psd": psd("/dev/ttyNONE", calibration="../out.yaml")}}, "not below"),
        ({"psds": {"psd": psd("in.yaml")}}, "no serial port"),
        ({"psds": {"psd": psd("/dev/../etc/passwd")}}, "no serial port"),
        ({"camera": {**CAMERA, "folder": "../dirty"}}, "not below"),
        ({"camera": {**CAMERA, "folder": "/etc"}}, "not below"),
        ({"camera": {**CAMERA, "folder": ".ssh"}}, "hidden"),
        ({"camera": {**CAMERA, "video": "way/film.mp4"}}, "not below"),
        ({"camera": {**CAMERA, "video": "file:///etc/passwd"}}, "no stream"),
        ({"camera": {**CAMERA, "video": "concat://in.yaml|/etc/passwd"}}, "no stream"),
    ],
)
def test_sensors_are_within(
    folder: Path, changed: dict[str, object], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("serial")
    pytest.importorskip("cv2")
    file = sensors(folder, **changed)
    if "camera" in changed:  # the amplifier answers
        monkeypatch.setattr("zerobeam.experiments.sensors.attached.Amplifier", _Amplifier)
    with confined(folder), pytest.raises(BadInput, match=words):
        read_sensors(file, good_plan(3))


class _Amplifier:
    name = "PSD-A 0017"

    def __init__(self, *_: object) -> None:
        """At any port."""

    def close(self) -> None:
        """Nothing is open."""
