"""The command line. Each command (in `commands`) reads, calls one function and prints.

Exit status: 0 verdict pass; 1 weak or degenerate; 2 bad input or usage; 3 a fault of the rig or of the
program, or a failed fit; 130 stopped, by Ctrl-C or a request to end.
"""

from __future__ import annotations

import gc
import sys
import traceback
import warnings
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from . import __version__
from .commands import carrying_out, exporting, importing, judging, studying
from .commands.console import FAULT, INTERRUPTED, err, out, plain, stoppable
from .model.errors import ZerobeamError


class _Stopped(Exception):
    """The command was interrupted."""


class _Commands(TyperGroup):
    """All commands; an interruption of any of them reaches `main`.

    Typer would end without a word after Ctrl-C, and after Ctrl-C at a question with status 1, a verdict.
    """

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except (KeyboardInterrupt, typer.Abort):
            raise _Stopped from None


app = typer.Typer(
    name="zerobeam",
    cls=_Commands,
    help="Joint offsets of an industrial robot from laser measurements of one point, with their uncertainty.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
for command in (
    judging.demo,
    judging.check,
    judging.analyse,
    judging.report,
    judging.compare,
    judging.plan,
    carrying_out.run,
    carrying_out.controller,
    judging.schema,
):
    app.command()(command)
app.add_typer(importing.imports, name="import")
app.add_typer(studying.studies, name="study")
app.add_typer(exporting.exports, name="export")


def _print_version(asked: bool) -> None:
    if asked:
        out.print(f"zerobeam {__version__}")
        raise typer.Exit


@app.callback()
def _zerobeam(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Joint offsets of an industrial robot from laser measurements of one point, with their uncertainty."""


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    err.print(f"note: {plain(message)}", markup=False, soft_wrap=True)


@stoppable()
def main() -> NoReturn:
    """Entry point of the console script: every error that is the user's is one message, no traceback."""
    warnings.showwarning = _warn
    # Few cycles, many objects: at the usual thresholds collecting takes some 5 % of a report's time.
    gc.set_threshold(50_000, 20, 20)
    try:
        app(standalone_mode=True)
    except ZerobeamError as error:
        err.print(f"error: {plain(error)}", markup=False, soft_wrap=True)
        sys.exit(error.exit_status)
    except (_Stopped, KeyboardInterrupt):
        err.print("stopped")
        sys.exit(INTERRUPTED)
    except Exception:  # noqa: BLE001 - printed in full, and the last thing that happens
        # Python's own status for this is 1, which is a verdict here.
        sys.stderr.write(plain(traceback.format_exc()))
        err.print("error: this is a fault of zerobeam itself, please report it with the lines above")
        sys.exit(FAULT)
    sys.exit(0)
