"""A folder for a calibration that is imported."""

from __future__ import annotations

from pydantic import Field

from ....model.errors import BadInput, NotWritten
from ....model.files.json_document import JsonDocument
from ....model.parsing.validation import FileModel
from ..folder import Folder
from ..requests import EndPoint, refused


class AskedFolder(FileModel):
    """A folder to make."""

    name: str = Field(max_length=100, description="a name without /, below the app's folder")


class MadeFolder(JsonDocument):
    """A folder that was made."""

    name: str


def new_folder(folder: Folder, request: AskedFolder) -> MadeFolder:
    """Make an empty folder; Refused, with the key, where the name is taken or cannot be one."""
    name = request.name.strip()
    try:
        if "/" in name or "\\" in name:
            raise BadInput("this is no name of one folder", found=name, allowed="a name without / and \\")
        path = folder.new(name)
    except BadInput as error:
        raise refused(error, ("name",)) from error
    try:
        path.mkdir()
    except OSError as error:
        raise NotWritten(f"the folder cannot be made: {error.strerror}", file=path) from None
    return MadeFolder(name=folder.called(path))


END_POINTS = [
    EndPoint("/api/folders", "POST", "Makes an empty folder for a calibration.", new_folder, AskedFolder)
]
