"""Events of a run between the values that the program passes on and the JSON that people see."""

import json
from typing import Any

from zerobeam.analysis.answer.answer_message import Action, Message, WorstOffset
from zerobeam.analysis.solution import ParameterResult
from zerobeam.experiments.procedure import events
from zerobeam.experiments.procedure.events import RunEvent, event_json
from zerobeam.experiments.procedure.rig import RefusalReason, RefusedPosture
from zerobeam.model.records import read

Json = dict[str, Any]
_KINDS: dict[str, Any] = {kind.event: kind for kind in RunEvent.__subclasses__()}


def as_json(event: RunEvent) -> Json:
    """As it is printed."""
    return dict(json.loads(json.dumps(event_json(event), allow_nan=False)))


def event_of(content: Json) -> RunEvent:
    """The event that is printed so."""
    stated = {key: value for key, value in content.items() if key not in ("event", "schema")}
    if "reason" in stated:
        stated["reason"] = RefusalReason(stated["reason"])
    if content["event"] == events.Ended.event:
        said = stated.get("message") or {"verdict": stated["headline"]}
        stated["message"] = message_of(**said)
        stated["parameters"] = tuple(read(ParameterResult, _whole(row)) for row in stated["parameters"])
        stated["refused"] = tuple(
            RefusedPosture(**{**row, "reason": RefusalReason(row["reason"])}) for row in stated["refused"]
        )
    return _KINDS[content["event"]](**{key: _frozen(value) for key, value in stated.items()})  # type: ignore[no-any-return]


def _whole(row: Json) -> Json:
    """The row of an offset with the interval and the reason that a result has beside what the tests state."""
    value, std = row["estimate"], row["std"]
    ends = None if std is None or value is None else [value - 2 * std, value + 2 * std]
    return {"group": "offset", "interval95": ends, "reason": "as the header says", **row}


def message_of(verdict: str, **parts: Any) -> Message:
    """The message that is printed so; what is not there is nothing."""
    worst, action = (
        parts.get("worst"),
        parts.get("action") or {"text": "Look at the result.", "command": None},
    )
    return Message(
        verdict=verdict,
        worst=None if worst is None else WorstOffset(**worst),
        cause=parts.get("cause"),
        action=Action(**action),
        cautions=tuple(parts.get("cautions", ())),
    )


def _frozen(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
