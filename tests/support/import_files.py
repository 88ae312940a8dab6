"""Importers as tests call them: with files, targets, what else is needed, header or plan, and run file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from zerobeam.experiments.makers import joint_text, known_logs
from zerobeam.experiments.makers.abb import rapid_points
from zerobeam.experiments.makers.fanuc import tp_points
from zerobeam.experiments.makers.generic import csv_file, ros
from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.kuka import krl_points
from zerobeam.experiments.makers.maker import makers

LAYOUTS = {log.name: log.layout for maker in makers() for log in maker.logs}


def of_files(read: Callable[..., Imported]) -> Callable[..., Imported]:
    def call(files: Any, names: Any, *arguments: Any, **options: Any) -> Imported:
        *before, stated, out = arguments
        return read(ImportJob.begin(files, stated, out, names), *before, **options)

    return call


import_csv = of_files(csv_file.import_csv)
import_fanuc = of_files(tp_points.import_fanuc)
import_joint_states = of_files(ros.import_joint_states)
import_kuka = of_files(krl_points.import_kuka)
import_program_log = of_files(joint_text.import_program_log)
import_rapid = of_files(rapid_points.import_rapid)
import_ros = of_files(ros.import_ros)


def import_log(kind: str, *arguments: Any, **options: Any) -> Imported:
    return of_files(lambda job, **rest: known_logs.read_log(job, LAYOUTS[kind], **rest))(
        *arguments, **options
    )
