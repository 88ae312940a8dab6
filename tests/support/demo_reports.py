"""The reports of `zerobeam demo`, for all tests that look at a report: made once, by the first that asks."""

import contextlib
import functools
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

from command_line import Answer, zerobeam
from made_once import made_once

from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.posterior.posterior import Draws
from zerobeam.reports.run import report


class MadeOf(NamedTuple):
    """What a report is written of."""

    result: Result
    draws: Draws | None


class DemoReports(NamedTuple):
    """What was told; the folder with a report for each run, not to be written into; what they are made of."""

    told: Answer
    folder: Path
    made_of: dict[str, MadeOf]


@functools.cache
def demo_reports() -> DemoReports:
    return made_once("demo reports", _made)


def _made() -> DemoReports:
    folder = Path(tempfile.mkdtemp(dir=os.environ["ZEROBEAM_TESTS_MADE"])) / "reports"
    with reports_written() as made_of:
        told = zerobeam("demo", "-o", folder)
    return DemoReports(told, folder, made_of)


@contextlib.contextmanager
def reports_written() -> Iterator[dict[str, MadeOf]]:
    """What each report is made of that is written within, by the name of its folder."""
    made_of: dict[str, MadeOf] = {}
    write = report.write_report

    def seen(folder: Path, result: Result, draws: Draws | None) -> report.ReportPaths:
        made_of[folder.name] = MadeOf(result, draws)
        return write(folder, result, draws)

    with patch.object(report, "write_report", seen):
        yield made_of
