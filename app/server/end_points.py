"""All end points, and their description (OpenAPI 3.1) for programs that ask them."""

from __future__ import annotations

from functools import cache
from importlib.metadata import version
from typing import Any

from pydantic import BaseModel

from ...model.files.stated_plan.plan_file import PlanFile
from .answers import history, imports, plans, posteriors, recordings, refits, results, robots
from .job_commands import AskedJob, AskedLine
from .requests import EndPoint

END_POINTS: list[EndPoint] = [
    *imports.END_POINTS,
    *robots.END_POINTS,
    *plans.END_POINTS,
    *recordings.END_POINTS,
    *results.END_POINTS,
    *refits.END_POINTS,
    *posteriors.END_POINTS,
    *history.END_POINTS,
]


_ID = {"name": "id", "in": "path", "required": True, "schema": {"type": "string"}}


def _named(name: str) -> dict[str, Any]:
    return {"name": name, "in": "query", "required": True, "schema": {"type": "string"}}


# Path, method, what it answers, the model of what is sent, parameters.
_Row = tuple[str, str, str, type[BaseModel] | None, list[dict[str, Any]]]
_OTHERS: list[_Row] = [
    ("/api/files", "get", "The files below the folder: path, kind, bytes, modified.", None, []),
    ("/api/file", "get", "A file, as it is.", None, [_named("file")]),
    ("/api/archive", "get", "A zip archive of the report that a result belongs to.", None, [_named("file")]),
    ("/api/file", "put", "Writes a new file: what is sent, as it is.", None, [_named("file")]),
    ("/api/jobs", "get", "The jobs, the newest first, without log and answer.", None, []),
    ("/api/jobs", "post", "Begins a job: its id.", AskedJob, []),
    ("/api/jobs/{id}", "get", "A job: state, share, stage, left_s, log, status, answer.", None, [_ID]),
    ("/api/jobs/{id}", "delete", "Asks a job to end, as Ctrl-C does.", None, [_ID]),
    (
        "/api/jobs/{id}/events",
        "get",
        "Server-sent events of a job: progress, log, run, end; from behind Last-Event-ID.",
        None,
        [_ID],
    ),
    ("/api/jobs/{id}/line", "post", "Answers a job that asks.", AskedLine, [_ID]),
]


@cache
def description() -> dict[str, Any]:
    """The OpenAPI document; what is sent is described by the models that read it."""
    schemas: dict[str, Any] = {}
    rows: list[_Row] = [
        (point.path, point.method.lower(), point.says, point.sent, [_named(name) for name in point.asked])
        for point in END_POINTS
    ]
    rows += _OTHERS
    models: list[type[BaseModel]] = [PlanFile, *(row[3] for row in rows if row[3] is not None)]
    for model in models:
        model_schema = model.model_json_schema(by_alias=True, ref_template="#/components/schemas/{model}")
        schemas |= model_schema.pop("$defs", {})
        plan = model_schema["properties"].get("plan")
        if plan is not None and model is not PlanFile:
            model_schema["properties"]["plan"] = {"$ref": f"#/components/schemas/{PlanFile.__name__}"}
        schemas[model.__name__] = model_schema
    text = {"anyOf": [{"type": "string"}, {"type": "null"}]}
    key = {"anyOf": [{"type": "array", "items": {"type": ["string", "integer"]}}, {"type": "null"}]}
    error = {"type": "object", "properties": {"what": {"type": "string"}, "key": key}}
    error["properties"] |= dict.fromkeys(("found", "allowed", "to_do"), text)  # type: ignore[operator]
    schemas["Error"] = {"type": "object", "required": ["error"], "properties": {"error": error}}
    paths: dict[str, dict[str, Any]] = {}
    for path, method, says, sent, parameters in rows:
        paths.setdefault(path, {})[method] = _operation(path, method, says, sent, parameters)
    return {
        "openapi": "3.1.0",
        "info": {"title": "zerobeam app", "version": version("zerobeam")},
        "paths": paths,
        "components": {"schemas": schemas},
    }


def _operation(
    path: str, method: str, says: str, sent: type[BaseModel] | None, parameters: list[dict[str, Any]]
) -> dict[str, Any]:
    kind = "text/event-stream" if path.endswith("/events") else "application/json"
    refused = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
    operation: dict[str, Any] = {
        "summary": says,
        "parameters": list(parameters),
        "responses": {
            "201" if (path, method) in {("/api/jobs", "post"), ("/api/file", "put")} else "200": {
                "description": says,
                "content": {kind: {}},
            },
            "default": {"description": "A refusal.", "content": refused},
        },
    }
    if method != "get":
        header = {"name": "X-Zerobeam", "in": "header", "required": True, "schema": {"const": "1"}}
        operation["parameters"].append(header)
    if sent is not None:
        content = {"application/json": {"schema": {"$ref": f"#/components/schemas/{sent.__name__}"}}}
        operation["requestBody"] = {"required": True, "content": content}
    return operation
