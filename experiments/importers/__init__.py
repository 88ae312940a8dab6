"""Runs from recordings that people have: units, order and targets are stated or in the file."""

from .csv_file import CsvLayout, TimeUnit, import_csv
from .dwells import Stillness
from .fanuc import import_fanuc
from .imported import Imported
from .joint3 import J3
from .known_logs import LogKind, import_log
from .kuka import import_kuka
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
    "import_kuka",
    "import_log",
    "import_ros",
]
