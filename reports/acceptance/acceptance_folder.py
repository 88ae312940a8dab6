"""The folder of an acceptance test: verification.html, .pdf, .json (`zerobeam/acceptance/1`), errors.csv and
the figure; and what a certificate takes from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from ...experiments.acceptance_files import ACCEPTANCE_SCHEMA, Verified
from ...model.errors import BadInput
from ...model.parsing.reading import LARGEST_RECORDING, read_text
from ...model.records import dumps, read, to_json
from ..output import whole_folder
from ..output.whole_folder import Kind, write_folder, write_page
from .acceptance_page import acceptance_page, errors_picture

JSON, _TABLE = "verification.json", "errors.csv"
_KIND = Kind(
    "verification",
    frozenset({"verification.html", "verification.pdf", JSON, _TABLE, "figures"}),
    JSON,
    ACCEPTANCE_SCHEMA,
)


def check_target(folder: Path | str) -> None:
    """Raise BadInput unless a verification may be written to `folder`."""
    whole_folder.check_target(folder, _KIND)


def write_acceptance_report(folder: Path | str, verified: Verified) -> None:
    """Write the report of an acceptance test to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    write_folder(folder, _KIND, lambda new_folder: _write_files(new_folder, verified))


def read_acceptance(folder: Path, sha256: str) -> Verified:
    """The answer in the folder of a verification of the calibration by the run of this hash.

    BadInput for a folder without one, and for that of another calibration.
    """
    file = folder / JSON
    try:
        answer = read(Verified, read_text(file, LARGEST_RECORDING)[0])
    except ValueError as error:
        raise BadInput(
            "this is not the report of a verification",
            found=str(error),
            allowed="a folder that zerobeam verify RUN NEW -o DIR wrote",
            file=file,
        ) from None
    if (of := answer.calibration.sha256) != sha256:
        raise BadInput(
            "this verification is of another calibration",
            found=f"SHA-256 {of}",
            allowed=f"{sha256}, the run of the result that is certified",
            file=file,
        )
    return answer


def _write_files(folder: Path, verified: Verified) -> None:
    picture = errors_picture(verified.measured)
    write_page(
        folder,
        "verification",
        acceptance_page(verified),
        {picture.name: picture},
        "study",
        answer=(JSON, dumps(to_json(verified))),
        tables={_TABLE: _rows(verified)},
    )


def _rows(verified: Verified) -> Iterator[dict[str, object]]:
    yield from (asdict(posture) for posture in verified.measured.postures)
