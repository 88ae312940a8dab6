"""The published JSON Schemas of files and answers, made from the very models that read and write them."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from ..analysis.answer.result import Result
from ..analysis.observability.check import Check
from ..analysis.repeatability.compare import Comparison
from ..model import records
from ..model.errors import BadInput
from ..model.files.header import RUN_SCHEMA, Header
from ..model.files.measurements import PlantTolerances
from ..model.files.plan import Obstacles, PlanFile
from ..model.files.robot_file import RobotFile
from ..model.files.shot import Shot
from ..model.parsing.reading import did_you_mean
from .arm_shown import ShownArm
from .batch import Batch
from .history.arm_history import ArmHistory, HistoryList
from .history.fleet_drift import DriftOfArms, Fleet
from .makers.calibration import RobotCalibration
from .plans.make import MadePlan
from .positions.conversion import Conversion
from .rigs.simulated.cell_file import CellFile
from .sensors.sensors_file import PsdCalibration, SensorsFile
from .studies.sweeps.study_file import StudyFile

# What people write, or importers.
FILE_SCHEMAS: dict[str, type[BaseModel]] = {
    "run-header": Header,
    "run-shot": Shot,
    "plan": PlanFile,
    "header": Header,
    "tolerances": PlantTolerances,
    "robot": RobotFile,
    "obstacles": Obstacles,
    "cell": CellFile,
    "sensors": SensorsFile,
    "psd-calibration": PsdCalibration,
    "study-file": StudyFile,
}
# What zerobeam writes.
_ANSWERS: dict[str, type] = {
    "result": Result,
    "check": Check,
    "compare": Comparison,
    "batch": Batch,
    "history": HistoryList,
    "history-arm": ArmHistory,
    "history-fleet": Fleet,
    "drift": DriftOfArms,
    "arm": ShownArm,
    "proposal": MadePlan,
    "offsets": RobotCalibration,
    "positions": Conversion,
}
SCHEMA_NAMES = (*FILE_SCHEMAS, *_ANSWERS)


def json_schema(name: str) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a kind of file, or of a line of a run; units are in the descriptions.

    It states what one value may be. What several mean together (limits of the robot, a laser's
    direction, unique measurement numbers) is checked on reading only.
    """
    model = FILE_SCHEMAS.get(name) or _ANSWERS.get(name)
    if model is None:
        raise BadInput(
            "there is no schema of this name",
            found=name,
            allowed=", ".join(SCHEMA_NAMES),
            remedy=did_you_mean(name, SCHEMA_NAMES),
        )
    schema = records.schema(model)
    identity = schema["properties"].get("schema", {})
    if name == "run-header":
        identity = {"const": RUN_SCHEMA}
    if name == "run-header" or name in _ANSWERS:  # it is always there, also where the model has a default
        about = {"type": "string", "description": "kind and version of the file"}
        schema["properties"]["schema"] = {"const": identity["const"], **about}
        schema["required"] = ["schema", *(key for key in schema["required"] if key != "schema")]
    title = name.replace("-", " ")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": f"zerobeam {title}"}
