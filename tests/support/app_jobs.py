"""Jobs of the app's server: begun, followed and waited for."""

from __future__ import annotations

import json
from typing import Any

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
