"""Jobs of the app's server: begun, followed and waited for."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from command_line import zerobeam
from starlette.testclient import TestClient


def begun(client: TestClient, *command: str) -> str:
    answer = client.post("/api/jobs", json={"command": list(command)})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def ended(client: TestClient, job: str) -> Any:
    """The job once it has ended; its events are what tells."""
    events(client, job)
    return client.get(f"/api/jobs/{job}").json()


def events(client: TestClient, job: str, after: int | None = None) -> list[tuple[int, str, Any]]:
    headers = {} if after is None else {"last-event-id": str(after)}
    answer = client.get(f"/api/jobs/{job}/events", headers=headers)
    assert answer.headers["content-type"].startswith("text/event-stream")
    found = []
    for block in answer.text.strip().split("\n\n"):
        if block.startswith("id: "):
            number, kind, data = (line.partition(": ")[2] for line in block.split("\n"))
            found.append((int(number), kind, json.loads(data)))
    return found


def unfinished_run(root: Path, plan: str, command: Sequence[str]) -> None:
    """A run of a plan (made.jsonl beside it) that has one of its measurements, and in the folder's list of
    started runs the command that is said to have begun it."""
    run = (root / plan).with_name("made.jsonl")
    zerobeam("run", root / plan, "-o", run)
    run.write_bytes(b"".join(run.read_bytes().splitlines(keepends=True)[:2]))
    entry = {"command": list(command), "ended": False}
    runs = {"schema": "zerobeam/app-runs/1", "runs": {run.relative_to(root).as_posix(): entry}}
    (root / ".zerobeam").mkdir(exist_ok=True)
    (root / ".zerobeam" / "runs.json").write_text(json.dumps(runs))
