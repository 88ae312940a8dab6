"""The server is killed in the middle of a run: nothing goes on unattended, and the run is resumed to the same
bytes."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from app_page import app
from cells import good_plan
from command_line import plan_file, zerobeam

from zerobeam.model.errors import BadInput
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.run import read_run

MEASUREMENTS = 12
OPTIONS: dict[str, list[str]] = {
    "in turn": ["--seed=3"],
    "adaptive": ["--adaptive", "--tolerance=0.02", "--no-camera"],
    "closing": ["--closing", "--seed=5"],
}


def recording_ended(file: Path, seconds: float = 10.0) -> bool:
    """Whether nobody records to a run file any more: its lock goes with the process."""
    header, end = read_run(file).header, time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            RunJournal.resumed(file, header).close()
        except BadInput:
            time.sleep(0.05)
        else:
            return True
    return False


@pytest.mark.long
@pytest.mark.parametrize("order", OPTIONS)
def test_a_killed_server_and_a_resumed_run(tmp_path: Path, order: str) -> None:
    """The server is killed again and again, at another moment each time, until the run is through."""
    plan_file(tmp_path / "plan.yaml", good_plan(MEASUREMENTS))
    zerobeam("run", tmp_path / "plan.yaml", "-o", tmp_path / "unbroken.jsonl", *OPTIONS[order])
    command = ["run", "plan.yaml", "--out=run.jsonl", *OPTIONS[order]]
    rng, kills = np.random.default_rng(1), 0
    file = tmp_path / "run.jsonl"
    while True:
        with app(tmp_path) as server:
            if file.exists():
                unfinished = server.ask("unfinished")
                if not unfinished:  # it had reached its end as the server was killed
                    break
                (own,) = unfinished
                assert server.ask("run?file=run.jsonl")["resume"] == own["resume"]
                command = own["resume"]
            job = server.ask("jobs", {"command": command})["id"]
            before = server.ask(f"jobs/{job}")["share"]
            now = server.until(job, max(before, kills / 6) + 0.01)
            if now["state"] == "done":
                break
            time.sleep(float(rng.uniform(0, 0.3)))
            server.process.kill()
            server.process.wait()
        kills += 1
        assert recording_ended(file)
        recorded = file.read_bytes()
        time.sleep(1.0)  # the control: a run that went on would record more in this time
        assert file.read_bytes() == recorded
    assert kills >= 2
    assert file.read_bytes() == (tmp_path / "unbroken.jsonl").read_bytes()


@pytest.mark.long
@pytest.mark.parametrize("kill", [True, False], ids=["killed", "stopped"])
def test_a_robot_stops_with_the_server(tmp_path: Path, kill: bool) -> None:
    """In the middle of a far move, as by Ctrl-C: RAPID stopped, the laser off, the arm at rest on its way."""
    controllers: Any = pytest.importorskip("controllers")
    own = good_plan(2)
    plan_file(tmp_path / "plan.yaml", own)
    cell = {"camera": None, "psd": {"placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}}}
    with (
        controllers.SimulatedController(own, controllers.CellFile.model_validate(cell), 3) as there,
        app(tmp_path) as server,
    ):
        ports = [f"--port={there.port}", f"--egm-port={there.egm_port}", f"--sensor-port={there.sensor_port}"]
        command = ["run", "plan.yaml", "-o=run.jsonl", "--rig=abb", "--host=127.0.0.1", *ports]
        job = server.ask("jobs", {"command": command, "password": "robotics"})["id"]
        while server.ask(f"jobs/{job}")["asks"] != "confirm":
            time.sleep(0.02)
        began = there.irc5.joints_deg()
        server.ask(f"jobs/{job}/line", {"text": "yes"})
        controllers.Client.until(lambda: np.abs(there.irc5.joints_deg() - began).max() > 2, 30.0)
        assert there.irc5.running
        (server.process.kill if kill else server.process.terminate)()
        controllers.Client.until(lambda: not there.irc5.running and there.irc5.standing, 3.0)
        assert there.irc5.signals.get("zb_laser", 0) == 0
        left = np.abs(there.irc5.data.joints_deg("zb_target") - there.irc5.joints_deg()).max()
        assert left > 1
