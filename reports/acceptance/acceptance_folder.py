"""The folder of an acceptance test: verification.html, .pdf, .json (`zerobeam/acceptance/1`), errors.csv and
the figure; and what a certificate takes from it."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from ...experiments.acceptance_files import ACCEPTANCE_SCHEMA, Verified
from ...model.errors import BadInput
from ...model.parsing.reading import LARGEST_RECORDING, read_text
from ...model.records import read, to_json
from ..output.whole_folder import FolderContents, Kind, write_answer
from .acceptance_page import acceptance_page, errors_picture

_TABLE = "errors.csv"
ACCEPTANCE = Kind.of_answer("verification", "verification.json", ACCEPTANCE_SCHEMA, _TABLE)


def write_acceptance_report(folder: Path | str, verified: Verified) -> None:
    """Write the report of an acceptance test to `folder`. Raises as `write_answer`."""
    tables = {_TABLE: [asdict(posture) for posture in verified.measured.postures]}
    picture = errors_picture(verified.measured)
    contents = FolderContents(to_json(verified), acceptance_page(verified), [picture], tables)
    write_answer(folder, ACCEPTANCE, contents)


def read_acceptance(folder: Path, sha256: str) -> Verified:
    """The answer in the folder of a verification of the calibration by the run of this hash.

    BadInput for a folder without one, and for that of another calibration.
    """
    file = folder / ACCEPTANCE.mark
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
