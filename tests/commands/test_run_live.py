"""`zerobeam run PLAN --rig SCHEME://HOST`: the joints are read where an empty line confirms them."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from live_controllers import LiveArm, UrStandIn

from zerobeam.model.files.run import read_run

AT = [20.0, -80.0, 70.0, -40.0, 60.0, 10.0]


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    path = tmp_path / "plan.yaml"
    path.write_text(
        "schema: zerobeam/plan/1\nrobot: ur5e\ngeometry: exact\n"
        "tool: {kind: probe, point_mm: [0, 0, 120]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\ntargets: {socket: {guess_mm: [500, 0, 0], sigma_mm: 900}}\n"
        f"postures_deg:\n  - {AT}\n  - {[value + 20 for value in AT]}\n",
        encoding="utf-8",
    )
    return path


def test_joints_are_read_and_what_is_typed_is_not(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = plan.parent / "run.jsonl"
    typed = " ".join(map(str, AT))
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{typed}\ncomment bright\n\n\npause\n"))
    with UrStandIn(LiveArm([value + 1.5 for value in AT])) as server:
        address = f"{server.url}?arm={server.serial}&dashboard={server.dashboard.port}"
        answer = zerobeam("run", plan, "--rig", address, "-o", file)
    assert answer.status == 1, answer.err  # a measurement is missing
    assert "press Enter when the arm is at rest" in answer.err
    assert "the joints are read from the controller" in answer.err
    assert "those of measurement 0: has the arm moved?" in answer.err
    run = read_run(file)
    (shot,) = run.shots
    assert shot.joints_deg == pytest.approx([value + 1.5 for value in AT], abs=1e-9)
    assert shot.comment == "bright"
    assert run.header.provenance["origin"] == "joints read from the controller"
    assert run.header.provenance["controller"] == "ur 20215500123"


def test_a_controller_that_is_lost_is_said_and_the_run_goes_on_later(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = plan.parent / "run.jsonl"

    def answered(server: UrStandIn, *more: str) -> list[dict[str, object]]:
        monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
        answer = zerobeam("run", plan, "--rig", server.url, "-o", file, "--json-lines", *more)
        return [json.loads(line) for line in answer.out.splitlines()]

    with UrStandIn(LiveArm(AT)) as server:
        server.arm.share, server.arm.faults = 1.0, ("drop",)
        events = answered(server)
        assert [event["kind"] for event in events if event["event"] == "doubt"] == ["connection"]
        server.arm.share = 0.0
        assert [event["event"] for event in answered(server, "--resume")][-1] == "end"
    np.testing.assert_allclose(read_run(file).shots[0].joints_deg, AT, atol=1e-9)


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("urx://host", "scheme of this address"),
        ("ur://host?port=3", "not an option of ur://"),
        ("ur://127.0.0.1:1", "no connection"),
    ],
)
def test_what_cannot_be_read_is_refused_before_there_is_a_run(plan: Path, address: str, words: str) -> None:
    answer = zerobeam("run", plan, "--rig", address, "-o", plan.parent / "run.jsonl")
    assert words in answer.err
    assert answer.status in (2, 3)
    assert not (plan.parent / "run.jsonl").exists()


def test_options_of_the_other_rigs_are_refused(plan: Path) -> None:
    for option in (("--watch", "x"), ("--cell", "x"), ("--recorded", "x")):
        with UrStandIn(LiveArm(AT)) as server:
            answer = zerobeam("run", plan, "--rig", server.url, "-o", plan.parent / "run.jsonl", *option)
        assert option[0] in answer.refused()
