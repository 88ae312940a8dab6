"""Importers as tests call them: with files, targets, what else is needed, header or plan, and run file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from zerobeam.experiments.makers import joint_text, known_logs
from zerobeam.experiments.makers.generic import joint_logs, ros
from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.maker import TaughtPoint, makers

READERS = {reader.name: reader for maker in makers() for reader in maker.read}
LAYOUTS = {log.name: log.layout for maker in makers() for log in maker.logs}


def of_files(read: Callable[..., Imported]) -> Callable[..., Imported]:
    def call(files: Any, names: Any, *arguments: Any, **options: Any) -> Imported:
        *before, stated, out = arguments
        return read(ImportJob.begin(files, stated, out, names), *before, **options)

    return call


import_csv = of_files(joint_logs.import_csv)
import_fanuc = of_files(READERS["fanuc"].read)
import_joint_states = of_files(ros.import_joint_states)
import_kuka = of_files(READERS["krl"].read)
import_program_log = of_files(joint_text.import_program_log)
import_rapid = of_files(READERS["rapid"].read)
import_ros = of_files(ros.import_ros)


def positions_of(kind: str, text: str, path: Path) -> list[TaughtPoint]:
    """The positions of a text, without those that are left out."""
    return [point for point in READERS[kind].marks[0].points(text, path) if not point.left_out]


def import_log(kind: str, *arguments: Any, **options: Any) -> Imported:
    return of_files(lambda job, **rest: known_logs.read_log(job, LAYOUTS[kind], **rest))(
        *arguments, **options
    )
