"""Runs from recordings that people have: units, order and targets are stated or in the file."""

from .csv_file import CsvLayout, LogKind, TimeUnit, import_csv, import_log
from .dwells import Stillness
from .imported import J3, Imported
from .ros import import_ros
from .taught import import_fanuc, import_kuka

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
