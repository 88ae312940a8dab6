"""zerobeam: joint offsets of industrial robots from laser measurements of one point, with their uncertainty.

The public names are imported when they are first asked for, so that the command line starts at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.analyse import analyse
    from .analysis.observability.check import Check, check
    from .analysis.posterior.posterior import Draws
    from .analysis.result import Result
    from .model.errors import BadInput, FitFailed, RigFault, ZerobeamError
    from .model.files.arrays import Laser, Noise, Probe
    from .model.files.plan import Plan, read_plan
    from .model.files.robot_file import load_robot
    from .model.files.run import Run, read_run
    from .model.robot import Robot
    from .reports.run.report_folder import write_report

__version__ = "0.1.0"

__all__ = [
    "BadInput",
    "Check",
    "Draws",
    "FitFailed",
    "Laser",
    "Noise",
    "Plan",
    "Probe",
    "Result",
    "RigFault",
    "Robot",
    "Run",
    "ZerobeamError",
    "__version__",
    "analyse",
    "check",
    "load_robot",
    "read_plan",
    "read_run",
    "write_report",
]

_HOME = {
    "BadInput": "model.errors",
    "Check": "analysis.observability.check",
    "Draws": "analysis.posterior.posterior",
    "FitFailed": "model.errors",
    "Laser": "model.files.arrays",
    "Noise": "model.files.arrays",
    "Plan": "model.files.plan",
    "Probe": "model.files.arrays",
    "Result": "analysis.result",
    "RigFault": "model.errors",
    "Robot": "model.robot",
    "Run": "model.files.run",
    "ZerobeamError": "model.errors",
    "analyse": "analysis.analyse",
    "check": "analysis.observability.check",
    "load_robot": "model.files.robot_file",
    "read_plan": "model.files.plan",
    "read_run": "model.files.run",
    "write_report": "reports.run.report_folder",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)
