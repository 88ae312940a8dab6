"""The folder of a conversion: its table, the converted files, and the audit that puts the old ones back."""

from __future__ import annotations

from pathlib import Path

from ...experiments.positions.conversion import POSITIONS_SCHEMA, Conversion
from ...experiments.positions.program_backup import AUDIT
from ...model.errors import BadInput
from ...words.sentences import to_json
from ..output.whole_folder import FolderContents, Kind, Written, names_in, write_answer
from .positions_page import positions_page


def write_conversion(folder: Path, answer: Conversion) -> Written:
    """Write a conversion to a folder that is empty or does not exist: whole, or not at all."""
    if folder.is_dir() and names_in(folder):
        raise BadInput(
            "the folder is not empty", file=folder, remedy="name another one: no conversion is overwritten"
        )
    tops = {name.partition("/")[0] for name in answer.content}
    kind = Kind.of_answer("conversion", AUDIT, POSITIONS_SCHEMA, *tops, pages="positions")

    def files(new: Path) -> None:
        for name, content in answer.content.items():
            (new / name).parent.mkdir(parents=True, exist_ok=True)
            (new / name).write_bytes(content)

    return write_answer(folder, kind, FolderContents(to_json(answer), positions_page(answer), others=files))
