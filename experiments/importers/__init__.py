"""Runs from recordings that people have: units, order and targets are stated or in the file."""

from ...model.kinematics.robot import J3
from .csv_file import CsvLayout, LogKind, TimeUnit, import_csv, import_log
from .dwells import Stillness
from .fanuc import import_fanuc
from .imported import Imported, matching
from .joint_states import import_joint_states
from .kuka import import_kuka
from .program_log import import_program_log, is_program_log
from .rapid import import_rapid
from .ros import import_ros

__all__ = [
    "J3",
    "CsvLayout",
    "Imported",
    "LogKind",
    "Stillness",
    "TimeUnit",
    "import_csv",
    "import_fanuc",
    "import_joint_states",
    "import_kuka",
    "import_log",
    "import_program_log",
    "import_rapid",
    "import_ros",
    "is_program_log",
    "matching",
]
