"""The command line within the test's own process: as a person calls it, with what it printed caught."""

import contextlib
import functools
import io
import json
import os
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import typer.main

from zerobeam import cli
from zerobeam.model.files.plan import Plan, write_plan

WIDTH = 80
# Typer makes all commands anew at each call, and that takes longer than what most tests ask of them.
typer.main.get_command = functools.cache(typer.main.get_command)
# What would make rich or typer take a caught output for a terminal, or another width than WIDTH.
_NOT_ASKED = ("FORCE_COLOR", "PY_COLORS", "NO_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "TERMINAL_WIDTH")


@dataclass(frozen=True)
class Answer:
    """What a command ended with and what it printed."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out, parse_constant=_no_constant)

    def refused(self) -> str:
        """The one message of a command that found bad input, on one line; asserts that it is just that."""
        assert self.status == 2, (self.status, self.err, self.out)
        assert self.out == ""
        assert self.err.startswith("error: "), self.err
        assert self.err.count("error:") == 1, self.err
        assert "Traceback" not in self.err
        return " ".join(self.err.split())


def _no_constant(name: str) -> float:
    raise AssertionError(f"JSON has no {name}")


def zerobeam(*arguments: object) -> Answer:
    """`zerobeam ARGUMENTS…`, through `cli.run`, on no terminal."""
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["zerobeam", *map(str, arguments)]),
        mock.patch.dict(os.environ, {"COLUMNS": str(WIDTH)}),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        warnings.catch_warnings(),
    ):
        for name in _NOT_ASKED:
            os.environ.pop(name, None)
        status = cli.run()
    return Answer(status, out.getvalue(), err.getvalue())


def plan_file(path: Path, plan: Plan) -> Path:
    """A plan made in memory, as a file."""
    write_plan(path, plan.header, np.asarray(plan.postures) * plan.robot.display, plan.targets)
    return path
