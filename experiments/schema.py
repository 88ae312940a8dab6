"""The published JSON Schemas of the files, made from the very models that read them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from ..analysis.answer.document import CheckDocument, ResultDocument
from ..model.errors import BadInput
from ..model.files.header import RUN_SCHEMA, Header
from ..model.files.plan_file import Obstacles, PlanFile
from ..model.files.reading import did_you_mean
from ..model.files.robot_file import RobotFile
from ..model.files.shot import Shot
from .rigs.simulated.cell_file import CellFile
from .sensors.sensors_file import PsdCalibration, SensorsFile
from .studies.sweeps.study_file import StudyFile

_MODELS: dict[str, type[BaseModel]] = {
    "run-header": Header,
    "run-shot": Shot,
    "plan": PlanFile,
    "header": Header,
    "robot": RobotFile,
    "obstacles": Obstacles,
    "cell": CellFile,
    "sensors": SensorsFile,
    "psd-calibration": PsdCalibration,
    "study-file": StudyFile,
    "result": ResultDocument,
    "check": CheckDocument,
}
SCHEMA_NAMES = tuple(_MODELS)


def json_schema(name: str) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a kind of file, or of a line of a run; units are in the descriptions.

    It states what one value may be. What several mean together (limits of the robot, a laser's
    direction, unique measurement numbers) is checked on reading only.
    """
    if name not in _MODELS:
        raise BadInput(
            "there is no schema of this name",
            found=name,
            allowed=", ".join(SCHEMA_NAMES),
            remedy=did_you_mean(name, SCHEMA_NAMES),
        )
    schema = _MODELS[name].model_json_schema(by_alias=True)
    if name == "run-header":
        schema["properties"]["schema"] = {
            "const": RUN_SCHEMA,
            "type": "string",
            "description": "kind and version of the file",
        }
        schema["required"] = ["schema", *schema["required"]]
    title = name.replace("-", " ")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": f"zerobeam {title}"}
