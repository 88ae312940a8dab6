"""`zerobeam positions`: taught positions of a backup shown, converted, put back."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..experiments.command_options import BackupOptions, ReachOptions, ZeroOptions
from ..model.options import Option, argument
from ..words.controllers import POSITIONS
from .console import out as console
from .console import say, show_answer
from .shared_options import Group, Json

if TYPE_CHECKING:
    from ..experiments.positions.conversion import Conversion

positions = Group(
    help="Taught positions of programs: keep their places when zeros were entered.", no_args_is_help=True
)
BackupPath = Annotated[
    Path,
    argument(
        "Backup of the controller: a folder, a zip, or one file"
        f" ({'; '.join(f'{vendor}: {endings}' for vendor, endings in POSITIONS.items())})."
    ),
]
NewFolder = Annotated[Path, Option("Folder for the converted files, empty or new.", "-o --out")]


@positions.of_options("show")
def show(backup: BackupPath, *, as_json: Json = False) -> None:
    """What is found in a backup: positions, tools, frames, computed targets. Nothing is converted."""
    from ..experiments.converted_programs import shown_programs
    from ..reports.positions_page import positions_page

    answer = shown_programs(backup)
    typed = replace(answer, backup=backup.as_posix())  # so that the printed command works in this folder
    show_answer(as_json, answer, lambda: positions_page(typed).brief)


@positions.of_options("keep")
def keep(
    backup: BackupPath,
    folder: NewFolder,
    *,
    zeros: ZeroOptions,
    choices: BackupOptions,
    as_json: Json = False,
) -> None:
    """Zeros were entered at the controller: positions are rewritten so that the arm comes to the same places.

    Nothing is written unless all positions can be converted. Statements stay as they are.
    """
    from ..experiments.converted_programs import kept_programs

    _write(kept_programs(backup, zeros, choices, folder), folder, as_json)


@positions.of_options("reach")
def reach(
    backup: BackupPath,
    folder: NewFolder,
    run: Annotated[Path, Option("Run with the calibration of the arm.", metavar="RUN")],
    *,
    choices: BackupOptions,
    options: ReachOptions,
    as_json: Json = False,
) -> None:
    """Nothing is entered at the controller: calculated poses are rewritten so that the arm reaches them.

    For poses that were calculated, by CAM or offline programming. Those that were taught on this arm hold
    its errors already: leave their files out. Positions in joints stay.
    """
    from ..experiments.converted_programs import reached_programs

    _write(reached_programs(backup, run, choices, options, folder), folder, as_json)


@positions.of_options("restore")
def restore(
    folder: Annotated[Path, argument("Folder of a conversion, with its audit.json.")], out: NewFolder
) -> None:
    """The old files of a conversion, byte by byte, into another folder."""
    from ..experiments.converted_programs import restored
    from ..model.errors import BadInput
    from ..model.files.whole_file import refuse_existing, write_whole

    content = restored(folder)
    if out.is_dir() and any(out.iterdir()):
        raise BadInput("the folder is not empty", file=out, remedy="name another one")
    if not out.is_dir():
        refuse_existing(out)
    for name, old in content.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        write_whole(out / name, old)
        say(f"Restored to {out / name}")


def _show(answer: "Conversion", as_json: bool) -> None:
    from ..reports.positions_page import positions_page

    show_answer(as_json, answer, lambda: positions_page(answer).brief)


def _write(answer: "Conversion", folder: Path, as_json: bool) -> None:
    """Show the answer, and write it where all of it is converted; exit status 1 where not."""
    from ..reports.positions_page import write_conversion
    from ..words.wording import counted

    if not answer.converted:
        _show(answer, as_json)
        raise typer.Exit(1)
    written = write_conversion(folder, answer)
    _show(answer, as_json)
    if not as_json:
        count = counted(len(answer.files), "file")
        beside = ", ".join(path.name for path in (written.html, written.pdf, written.result))
        say(f"Written to {written.folder}: {count}, {beside}", to=console)
