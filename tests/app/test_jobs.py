"""Commands that the page has carried out: in the folder, with their progress, and ended at any time."""

import time
from pathlib import Path
from typing import Any

import pytest
from app_jobs import begun, ended, events
from cells import good_plan
from command_line import plan_file, zerobeam
from starlette.testclient import TestClient

from zerobeam.app.server.index import Folder
from zerobeam.app.server.job_commands import job_command
from zerobeam.model.errors import BadInput


def test_a_run_is_carried_out_followed_and_followed_again(client: TestClient, root: Path) -> None:
    plan_file(root / "short.yaml", good_plan(2))
    command = ("run", "short.yaml", "-o", "sub/new.jsonl", "--rig", "simulated", "--seed", "3")
    job = begun(client, *command)
    told = events(client, job)
    numbers = [number for number, _, _ in told]
    assert numbers == sorted(set(numbers))
    again = events(client, job)
    seen = [data["event"] for _, kind, data in again if kind == "run"]
    assert seen.count("picture") == 1  # the last alone: pictures are large
    assert {"begin", "arm", "spot", "recorded", "end"} <= set(seen)
    assert again == [event for event in told if event in again]
    assert all(data["event"] == "picture" for _, _, data in told if data not in [own for *_, own in again])
    assert {kind for _, kind, _ in told} >= {"run", "end"}
    done = client.get(f"/api/jobs/{job}").json()
    assert (done["state"], done["share"], done["left_s"]) == ("done", 1.0, None)
    assert told[-1][1:] == ("end", done)
    last = [data for _, kind, data in told if kind == "run"][-1]
    assert last == done["answer"] | {"action": last["action"]}
    assert events(client, job, after=numbers[2]) == [event for event in again if event[0] > numbers[2]]
    assert events(client, job, after=10**6) == []
    assert client.get("/api/jobs").json()[0] == {
        k: v for k, v in done.items() if k not in ("log", "answer", "front")
    }
    same = zerobeam(command[0], root / "short.yaml", "-o", root / "same.jsonl", *command[4:])
    assert same.status == done["status"]
    measured = [(root / name).read_text().splitlines()[1:] for name in ("sub/new.jsonl", "same.jsonl")]
    assert len(measured[0]) == len(measured[1]) > 0


@pytest.mark.long
def test_an_analysis_tells_its_progress_and_can_be_ended(client: TestClient) -> None:
    job = begun(client, "analyse", "run.jsonl", "--ess", "100000")
    other = begun(client, "analyse", "nowhere.jsonl")
    while (now := client.get(f"/api/jobs/{job}").json())["share"] == 0:
        assert now["state"] in ("waiting", "running")
        time.sleep(0.05)
    assert now["stage"] in ("fit", "identifiability", "posterior")
    assert client.delete(f"/api/jobs/{job}").status_code == 200
    stopped = ended(client, job)
    assert (stopped["state"], stopped["status"], stopped["answer"]) == ("stopped", 130, None)
    assert stopped["log"][-1] == "stopped"
    refused = ended(client, other)
    assert (refused["state"], refused["status"]) == ("failed", 2)
    assert refused["log"][0] == "error: nowhere.jsonl: there is no such file"


def test_a_job_that_is_not_there_is_not_found(client: TestClient) -> None:
    for path in ("/api/jobs/7", "/api/jobs/x", "/api/jobs/7/events"):
        assert client.get(path).status_code == 404
    assert client.delete("/api/jobs/7").status_code == 404


@pytest.mark.parametrize(
    "command",
    [
        ["demo"],
        ["app"],
        ["import", "csv", "run.jsonl"],
        ["run", "plan.yaml", "-o", "new.jsonl", "--rig", "abb", "--yes"],
        ["run", "plan.yaml", "-o", "new.jsonl", "--rig", "abb", "--password", "x"],
        ["run", "plan.yaml", "-o", "new.jsonl", "--rig=simulated", "--rig=replay"],
        ["run", "plan.yaml", "-o", "new.jsonl", "--rig=replay", "--recorded=run.jsonl"],
        ["run", "plan.yaml"],
        ["run", "-o", "new.jsonl"],
        ["run", "plan.yaml", "plan.yaml", "-o", "new.jsonl"],
        ["run", "plan.yaml", "--force", "-o", "new.jsonl"],
        ["run", "plan.yaml", "-o"],
        ["run", "plan.yaml", "--resume=yes", "-o", "new.jsonl"],
        ["analyse", "--", "run.jsonl"],
    ],
)
def test_what_the_page_may_not_ask_for_is_refused(client: TestClient, root: Path, command: list[str]) -> None:
    before = sorted(root.rglob("*"))
    answer = client.post("/api/jobs", json={"command": command})
    assert answer.status_code == 400
    assert answer.json()["error"]["what"]
    assert client.get("/api/jobs").json() == []
    assert sorted(root.rglob("*")) == before


def test_options_cannot_be_taken_for_files(root: Path) -> None:
    folder = Folder(root)
    made = job_command(folder, ["plan", "x", "--header=h.yaml", "--target", "-1,2,3", "-o", "n.yaml"])
    assert made == ["plan", "x", "--header=h.yaml", "--target=-1,2,3", "--out=n.yaml", "--json"]
    made = job_command(folder, ["analyse", "./sub/../run.jsonl", "--seed", "7"])
    assert made == ["analyse", "--seed=7", "--json", "--", "run.jsonl"]
    with pytest.raises(BadInput, match="--seed cannot be used"):
        job_command(folder, ["analyse", "run.jsonl", "--seed", "--json"])
    with pytest.raises(BadInput, match="no such option"):
        job_command(folder, ["analyse", "-h", "run.jsonl"])


def test_a_history_is_one_of_the_folder_and_a_serial_number_no_file(root: Path) -> None:
    folder = Folder(root)
    made = job_command(folder, ["history", "report", "../7", "--db", "plant.sqlite", "-o", "pages"])
    assert made == ["history", "report", "--db=plant.sqlite", "--out=pages", "--json", "--", "../7"]
    made = job_command(folder, ["history", "report", "--db=h", "-o", "pages", "--", "-h"])
    assert made[-2:] == ["--", "-h"]
    made = job_command(folder, ["history", "add", "a/result.json", "b/result.json", "--db", "h", "--replace"])
    assert made == ["history", "add", "--db=h", "--replace", "--json", "--", "a/result.json", "b/result.json"]
    for words in (
        ["history", "report", "-o", "pages"],  # the user's own history
        ["history", "add", "a/result.json"],
        ["history", "report", "--db", "postgresql://plant@host/history", "-o", "pages"],
        ["history", "report", "--db", "../history.sqlite", "-o", "pages"],
        ["history", "report", "a", "b", "--db", "h", "-o", "pages"],
        ["history", "add", "--db", "h"],
        ["history", "restore", "backup.sqlite", "--db", "h"],
    ):
        with pytest.raises(BadInput):
            job_command(folder, words)


def test_the_description_has_every_end_point(client: TestClient) -> None:
    described = client.get("/openapi.json").json()
    told = {(path, method.upper()) for path, own in described["paths"].items() for method in own}
    served = {
        (route.path, method)
        for route in client.app.routes  # type: ignore[attr-defined]
        for method in route.methods - {"HEAD"}
        if route.path.startswith("/api/")
    }
    assert told == served
    schemas = described["components"]["schemas"]
    references = set()

    def walk(value: Any) -> None:
        if isinstance(value, dict):
            if "$ref" in value:
                references.add(value["$ref"].rpartition("/")[2])
            value = list(value.values())
        for inner in value if isinstance(value, list) else ():
            walk(inner)

    walk(described)
    assert references <= set(schemas)
    assert "postures_deg" in schemas["PlanFile"]["properties"]
