"""The one folder that the app reads and writes: names from outside never lead out of it."""

from __future__ import annotations

import os
from pathlib import Path

from ...model.errors import BadInput
from ...model.files.whole_file import refuse_existing
from ...model.parsing.confinement import resolved


class Folder:
    """A folder, and paths that are relative to it.

    Attributes
    ----------
    root : Path
        The folder, symbolic links resolved.
    """

    def __init__(self, root: Path) -> None:
        if not root.is_dir():
            raise BadInput(
                "the folder of the app does not exist", found=root, remedy="name a folder that does: --dir"
            )
        self.root = Path(os.path.realpath(root))

    def inside(self, name: str, start: Path | None = None) -> Path:
        """The resolved path of a name that is relative to `start` (the folder itself); it need not exist.

        BadInput where it is hidden, or not below the folder, once symbolic links are followed.
        """
        return resolved(self.root, name, start)

    def private(self, name: str) -> Path:
        """The path of a file of the app itself, in `.zerobeam`; BadInput where a link leads elsewhere."""
        return resolved(self.root, f".zerobeam/{name}", hidden=True)

    def file(self, name: str) -> Path:
        """The path of a regular file below the folder that is not hidden; BadInput where there is none."""
        path = self.inside(name)
        if not path.is_file():
            raise BadInput("there is no such file in the app's folder", found=name[:100])
        return path

    def new(self, name: str) -> Path:
        """The path of a file that is to be made: in a folder that is there, not hidden, no other's name."""
        path = self.inside(name)
        refuse_existing(path)
        return path

    def called(self, path: Path) -> str:
        """A path below the folder as the page calls it."""
        return path.relative_to(self.root).as_posix()

    def without(self, text: str) -> str:
        """A message in which the folder's own place is left out."""
        return text.replace(f"{self.root}{os.sep}", "").replace(str(self.root), ".")
