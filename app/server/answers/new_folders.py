"""New folders for calibrations: one that is imported has an empty one at first."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ....model.errors import BadInput, NotWritten
from ....model.records import it, record
from ..folder import Folder
from ..requests import end_point, refused


@record(kw_only=True)
class MadeFolder:
    """A folder that was made."""

    name: str


def new_path(folder: Folder, name: str) -> Path:
    """Where a folder of this name is to be made; Refused, with the key, where it is taken or cannot be."""
    try:
        if "/" in name or "\\" in name or name != name.strip():
            raise BadInput(
                "this is no name of one folder",
                found=name[:100],
                allowed="a name without / and \\, and without spaces at its ends",
            )
        path = folder.new(name)
        if os.path.lexists(folder.root / name):  # a link to nowhere
            raise BadInput("there is something of this name already", found=name, allowed="a free name")
        return path
    except BadInput as error:
        raise refused(error, ("name",)) from error


@end_point("POST /api/folders", "Makes an empty folder for a calibration.")
def new_folder(
    folder: Folder,
    name: Annotated[str, it("a name without /, below the app's folder"), Field(max_length=100)],
) -> MadeFolder:
    """Make an empty folder."""
    path = new_path(folder, name.strip())
    try:
        path.mkdir()
    except OSError as error:
        raise NotWritten(f"the folder cannot be made: {error.strerror}", file=path) from None
    return MadeFolder(name=folder.called(path))
