"""Runs that the page begins: by hand, gone on with, and never out of the folder."""

import os
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
from app_jobs import begun, ended, events, unfinished_run
from cells import good_plan
from child import ZEROBEAM, child
from command_line import plan_file, zerobeam
from starlette.testclient import TestClient

from zerobeam.interruption import ATTENDED, INTERRUPTED
from zerobeam.model.files.run import read_run


def line(client: TestClient, job: str, text: str) -> Any:
    return client.post(f"/api/jobs/{job}/line", json={"text": text})


def _in(folder: Path, words: list[str]) -> list[str]:
    """A command of the folder as it is typed elsewhere."""
    return [word.replace("=made", f"={folder}/made").replace("=cell", f"={folder}/cell") for word in words]


def asking(client: TestClient, job: str) -> None:
    """Until the job reads lines."""
    while (now := client.get(f"/api/jobs/{job}").json())["asks"] is None:
        assert now["state"] in ("waiting", "running"), now
        time.sleep(0.02)


@pytest.mark.long
def test_a_run_by_hand_is_led_paused_and_gone_on_with(client: TestClient, root: Path) -> None:
    plan = good_plan(3)
    plan_file(root / "short.yaml", plan)
    rows = [", ".join(map(repr, row)) for row in (plan.postures * plan.robot.display).tolist()]
    job = begun(client, "run", "short.yaml", "-o", "hand.jsonl", "--rig=manual")
    asking(client, job)
    assert line(client, job, f"nonsense\n{rows[0]}\npause").status_code == 200
    paused = ended(client, job)
    told = [data for _, kind, data in events(client, job) if kind == "run"]
    assert [event["kind"] for event in told if event["event"] == "doubt"] == ["unreadable"]
    assert [event["shot"] for event in told if event["event"] == "arm"] == [0, 1]
    assert (paused["state"], paused["asks"]) == ("done", None)
    assert line(client, job, rows[1]).status_code == 400
    (open_run,) = client.get("/api/unfinished").json()
    assert open_run["file"] == "hand.jsonl"
    state = client.get("/api/run", params={"file": "hand.jsonl"}).json()
    assert (state["recorded"], state["postures"], state["ended"]) == ([0], 3, False)
    assert state["resume"] == open_run["resume"]
    job = begun(client, *open_run["resume"])
    asking(client, job)
    line(client, job, "\n".join(rows[1:]))
    assert ended(client, job)["state"] == "done"
    assert [shot.shot for shot in read_run(root / "hand.jsonl").shots] == [0, 1, 2]
    assert client.get("/api/unfinished").json() == []


def test_a_job_that_asks_nothing_hears_nothing(client: TestClient) -> None:
    job = begun(client, "analyse", "nowhere.jsonl")
    assert line(client, job, "yes").status_code == 400
    assert client.post("/api/jobs/7/line", json={"text": "yes"}).status_code == 404


def test_what_a_run_has_and_how_to_go_on_with_it(client: TestClient, root: Path) -> None:
    """Of a run that the app has not begun, too: plan and cell are found by their hashes."""
    plan_file(root / "short.yaml", good_plan(3))
    (root / "cell.yaml").write_text("schema: zerobeam/cell/1\ncamera: null\n")
    options = ["--cell", root / "cell.yaml", "--seed", "4"]
    zerobeam("run", root / "short.yaml", "-o", root / "made.jsonl", *options)
    whole = (root / "made.jsonl").read_bytes()
    ask = {"file": "made.jsonl"}
    assert client.get("/api/run", params=ask).json()["ended"] is True
    lines = whole.splitlines(keepends=True)
    (root / "made.jsonl").write_bytes(lines[0])
    state = client.get("/api/run", params=ask).json()
    assert (state["recorded"], state["std"], state["headline"]) == ([], {}, None)
    (root / "made.jsonl").write_bytes(b"".join(lines[:3]) + lines[3][:9])
    state = client.get("/api/run", params=ask).json()
    assert (state["recorded"], state["ended"], state["torn"]) == ([0, 1], None, True)
    assert state["std"]["delta2"] is None  # two measurements do not determine it
    assert state["expanded"]["delta2"] is None
    known = [name for name, std in state["std"].items() if std is not None]
    assert all(state["expanded"][name] >= 1.9 * state["std"][name] for name in known)
    assert state["tolerance"] == dict.fromkeys(state["std"], pytest.approx(0.1))
    assert [row["recorded"] for row in state["course"]] == [1, 2]
    zerobeam(*[root / word if word == "short.yaml" else word for word in _in(root, state["resume"])])
    assert (root / "made.jsonl").read_bytes() == whole
    (root / "short.yaml").unlink()
    state = client.get("/api/run", params=ask).json()
    assert state["resume"] is None
    assert "plan" in state["why_not"]


@pytest.mark.long
def test_an_attended_command_ends_with_who_began_it(root: Path) -> None:
    """The control: with the other end open it would wait for lines for ever."""
    command = [*ZEROBEAM, "run", str(root / "plan.yaml"), "-o", str(root / "n.jsonl"), "--rig=manual"]
    own = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "env": os.environ | {ATTENDED: "1"}}
    with child([*command, "--json-lines"], **own) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert '"begin"' in process.stdout.readline()
        process.stdin.write("help\n")
        process.stdin.flush()
        while '"help"' not in process.stdout.readline():
            pass
        assert process.poll() is None
        process.stdin.close()
        assert process.wait(timeout=60) == INTERRUPTED


STRANGER = "stranger.example"


@pytest.mark.parametrize(
    ("rig", "controller", "kept"),
    [
        (["--rig=abb", f"--host={STRANGER}", "--speed=0.5"], "abb", ["--rig=abb", "--speed=0.5"]),
        (["--rig", "abb", "--host", STRANGER], "abb", ["--rig=abb"]),
        ([f"--rig=ur://{STRANGER}"], "ur", []),
        (["--rig", f"ur://{STRANGER}"], "ur", []),
        (["--rig=manual"], None, ["--rig=manual"]),
    ],
)
def test_a_run_of_a_folder_is_resumed_without_the_address_that_the_folder_has(
    client: TestClient, root: Path, rig: list[str], controller: str | None, kept: list[str]
) -> None:
    """The folder may come from anybody: no password, and no arm, of a person who did not state where."""
    plan_file(root / "short.yaml", good_plan(2))
    unfinished_run(root, "short.yaml", ["run", *rig, "--out=made.jsonl", "short.yaml"])
    (state,) = client.get("/api/unfinished").json()
    assert state["controller"] == controller
    assert state["resume"] == ["run", "--resume", *kept, "--out=made.jsonl", "short.yaml"]
    assert STRANGER not in str(state)


def test_a_command_of_a_folder_that_the_app_would_not_carry_out_is_not_offered(
    client: TestClient, root: Path
) -> None:
    command = ["run", "--rig=abb", f"--host={STRANGER}", "--yes", "--out=made.jsonl", "short.yaml"]
    plan_file(root / "short.yaml", good_plan(2))
    unfinished_run(root, "short.yaml", command)
    (state,) = client.get("/api/unfinished").json()
    assert STRANGER not in str(state)
    assert "--rig=abb" not in state["resume"]  # the run file says that it was simulated
