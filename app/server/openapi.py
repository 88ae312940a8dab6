"""The description of the end points (OpenAPI 3.1), for programs that ask them."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version
from typing import Any

from pydantic import BaseModel

from ...model.files.plan import PlanFile
from .asked import AskedCheck, AskedJob, AskedPlan, AskedRobot

_MODELS: dict[str, type[BaseModel]] = {
    "Robot": AskedRobot,
    "Check": AskedCheck,
    "WritePlan": AskedPlan,
    "Job": AskedJob,
    "Plan": PlanFile,
}
_ID = {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}}
_FILE = {"name": "file", "in": "query", "required": True, "schema": {"type": "string"}}
# Path, method, what it answers, the model of what is sent, parameters.
_END_POINTS: list[tuple[str, str, str, str | None, list[dict[str, Any]]]] = [
    ("/api/robots", "get", "The built-in robots: name, vendor, model.", None, []),
    ("/api/robot", "post", "A robot (zerobeam/arm/1), its skeleton and axes.", "Robot", []),
    ("/api/files", "get", "The files below the folder: path, kind, bytes, modified.", None, []),
    ("/api/plan", "get", "A plan: its content, targets, robot and notes.", None, [_FILE]),
    ("/api/plan", "put", "Writes a plan: a new file, or in place of a plan.", "WritePlan", []),
    ("/api/check", "post", "A check (zerobeam/check/1); with `scene` also scene, null_motion.", "Check", []),
    ("/api/jobs", "get", "The jobs, the newest first, without log and answer.", None, []),
    ("/api/jobs", "post", "Begins a job: its id.", "Job", []),
    ("/api/jobs/{id}", "get", "A job: state, share, stage, left_s, log, status, answer.", None, [_ID]),
    ("/api/jobs/{id}", "delete", "Asks a job to end, as Ctrl-C does.", None, [_ID]),
    (
        "/api/jobs/{id}/events",
        "get",
        "Server-sent events of a job: progress, log, run, end; from behind Last-Event-ID.",
        None,
        [_ID],
    ),
]


@cache
def description() -> dict[str, Any]:
    """The OpenAPI document; what is sent is described by the models that read it."""
    schemas: dict[str, Any] = {}
    for name, model in _MODELS.items():
        own = model.model_json_schema(by_alias=True, ref_template="#/components/schemas/{model}")
        schemas |= own.pop("$defs", {})
        schemas[name] = own
    for name in ("Check", "WritePlan"):
        schemas[name]["properties"]["plan"] = {"$ref": "#/components/schemas/Plan"}
    text = {"anyOf": [{"type": "string"}, {"type": "null"}]}
    key = {"anyOf": [{"type": "array", "items": {"type": ["string", "integer"]}}, {"type": "null"}]}
    error = {"type": "object", "properties": {"what": {"type": "string"}, "key": key}}
    error["properties"] |= dict.fromkeys(("found", "allowed", "to_do"), text)  # type: ignore[operator]
    schemas["Error"] = {"type": "object", "required": ["error"], "properties": {"error": error}}
    paths: dict[str, dict[str, Any]] = {}
    for path, method, said, sent, parameters in _END_POINTS:
        paths.setdefault(path, {})[method] = _operation(path, method, said, sent, parameters)
    return {
        "openapi": "3.1.0",
        "info": {"title": "zerobeam app", "version": version("zerobeam")},
        "paths": paths,
        "components": {"schemas": schemas},
    }


def _operation(
    path: str, method: str, said: str, sent: str | None, parameters: list[dict[str, Any]]
) -> dict[str, Any]:
    kind = "text/event-stream" if path.endswith("/events") else "application/json"
    refused = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
    own: dict[str, Any] = {
        "summary": said,
        "parameters": list(parameters),
        "responses": {
            "201" if (path, method) == ("/api/jobs", "post") else "200": {
                "description": said,
                "content": {kind: {}},
            },
            "default": {"description": "A refusal.", "content": refused},
        },
    }
    if method != "get":
        header = {"name": "X-Zerobeam", "in": "header", "required": True, "schema": {"const": "1"}}
        own["parameters"].append(header)
    if sent is not None:
        content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{sent}"}}}
        own["requestBody"] = {"required": True, "content": content}
    return own
