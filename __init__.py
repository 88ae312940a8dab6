"""zerobeam: joint offsets of industrial robots from a laser and one fixed point, with uncertainty.

The public names are imported when they are first asked for, so that the command line starts at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .analysis.answer.result import Result
    from .analysis.covariance import Covariance
    from .analysis.observability.check import Check
    from .analysis.posterior.posterior import Draws
    from .analysis.solution import Solution
    from .face.analysed import Analysed, analyse
    from .face.compared import ComparedRuns, compare
    from .face.pictures import Figure, SceneView
    from .face.planned import CheckedPlan, OptimalPlan, check, optimal_plan, simulate
    from .face.shown_posterior import Contour, Profile
    from .model.errors import BadInput, FitFailed, RigFault, ZerobeamError
    from .model.files.from_arrays import Laser, Noise, Probe
    from .model.files.plan import Plan, read_plan
    from .model.files.robot_file import load_robot
    from .model.files.run import Run, read_run
    from .model.kinematics.robot import Robot
    from .reports.run.report import write_report

__version__ = "0.2.0"

__all__ = [
    "Analysed",
    "BadInput",
    "Check",
    "CheckedPlan",
    "ComparedRuns",
    "Contour",
    "Covariance",
    "Draws",
    "Figure",
    "FitFailed",
    "Laser",
    "Noise",
    "OptimalPlan",
    "Plan",
    "Probe",
    "Profile",
    "Result",
    "RigFault",
    "Robot",
    "Run",
    "SceneView",
    "Solution",
    "ZerobeamError",
    "__version__",
    "analyse",
    "check",
    "compare",
    "load_robot",
    "optimal_plan",
    "read_plan",
    "read_run",
    "simulate",
    "write_report",
]

_HOME = {
    "Analysed": "face.analysed",
    "BadInput": "model.errors",
    "Check": "analysis.observability.check",
    "CheckedPlan": "face.planned",
    "ComparedRuns": "face.compared",
    "Contour": "face.shown_posterior",
    "Covariance": "analysis.covariance",
    "Draws": "analysis.posterior.posterior",
    "Figure": "face.pictures",
    "FitFailed": "model.errors",
    "Laser": "model.files.from_arrays",
    "Noise": "model.files.from_arrays",
    "OptimalPlan": "face.planned",
    "Plan": "model.files.plan",
    "Probe": "model.files.from_arrays",
    "Profile": "face.shown_posterior",
    "Result": "analysis.answer.result",
    "RigFault": "model.errors",
    "Robot": "model.kinematics.robot",
    "Run": "model.files.run",
    "SceneView": "face.pictures",
    "Solution": "analysis.solution",
    "ZerobeamError": "model.errors",
    "analyse": "face.analysed",
    "check": "face.planned",
    "compare": "face.compared",
    "load_robot": "model.files.robot_file",
    "optimal_plan": "face.planned",
    "read_plan": "model.files.plan",
    "read_run": "model.files.run",
    "simulate": "face.planned",
    "write_report": "reports.run.report",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOME[name]}", __name__), name)


def __dir__() -> list[str]:
    """The public names, imported or not, and what every module has."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
