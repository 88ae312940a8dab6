"""In a notebook: how far an analysis is, as a bar, and the app in a cell."""

from __future__ import annotations

import html
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote
from weakref import WeakKeyDictionary

from ..model.arrays import Progress
from ..model.errors import BadInput, missing_extra
from ..model.files.header import UrdfRef
from ..model.files.plan import Plan
from ..model.files.robot_file import built_in_robots
from ..model.files.run import Run, header_text, shot_text

_WHOLE = 100  # per cent


class StageLines:
    """A line on stderr as each stage begins."""

    def __init__(self) -> None:
        self._stage = ""

    def __call__(self, stage: str, share: float) -> None:
        if stage != self._stage:
            self._stage = stage
            sys.stderr.write(f"{stage} …\n")

    def close(self) -> None:
        """Nothing is left open."""


class StageBar:
    """A bar of tqdm, which a notebook draws as a widget where it can."""

    def __init__(self, tqdm: Any) -> None:
        self._bar = tqdm(total=_WHOLE, leave=False, bar_format="{desc} {percentage:3.0f} %|{bar}| {elapsed}")

    def __call__(self, stage: str, share: float) -> None:
        self._bar.set_description_str(stage, refresh=False)
        self._bar.n = round(_WHOLE * share)
        self._bar.refresh()

    def close(self) -> None:
        """Take it away."""
        self._bar.close()


@contextmanager
def shown_progress(progress: Progress | bool | None) -> Iterator[Progress | None]:
    """Where progress is reported to: `progress` itself, or a bar or lines of ours.

    True shows it, False does not; None shows it in the kernel of a notebook alone. The bar is one of tqdm if
    tqdm is installed.
    """
    if progress is None:
        progress = "ipykernel" in sys.modules
    if not isinstance(progress, bool):
        yield progress
        return
    if not progress:
        yield None
        return
    shown = _bar()
    try:
        yield shown
    finally:
        shown.close()


def _bar() -> StageBar | StageLines:
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return StageLines()
    return StageBar(tqdm)


_HEIGHT = 820  # pixels


@dataclass(frozen=True, repr=False)
class AppView:
    """The app's page on one object: shows itself in a notebook of this machine.

    Attributes
    ----------
    address : str
        Of the page, for a browser of this machine, while the process runs.
    """

    address: str

    def __repr__(self) -> str:
        return f"<AppView at {self.address}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.address, quote=True)
        size = f'width="100%" height="{_HEIGHT}" style="border:0"'
        return f'<iframe title="zerobeam" src="{address}" {size}></iframe>'


_written: WeakKeyDictionary[Any, str] = WeakKeyDictionary()


def app_of(thing: object, page: str, write: Callable[[Path], str]) -> AppView:
    """The app at the step `page` ("plan", "result"), opened on the file of `thing`.

    `write` writes the files of `thing` into a folder that is there and empty, and returns the name of the
    one to open. It is called once for each object; all objects of a process share a server and a folder,
    which end with the process.

    Raises
    ------
    BadInput
        The extra `app` is not installed.
    """
    if any(find_spec(needed) is None for needed in ("starlette", "uvicorn")):
        raise missing_extra("the app", "app")
    folder, address = _served(os.getpid())
    if thing not in _written or not (Path(folder.name) / _written[thing]).exists():
        content = Path(tempfile.mkdtemp(prefix=f"{type(thing).__name__.lower()}-", dir=folder.name))
        _written[thing] = f"{content.name}/{write(content)}"
    file = _written[thing]
    return AppView(f"{address}#/job/{quote(file.partition('/')[0])}/{page}/{quote(file)}")


@cache
def _served(process: int) -> tuple[tempfile.TemporaryDirectory[str], str]:
    """The folder and address of the server of a process: one that was forked off has none yet."""
    from ..app.server.serve import serve_beside

    folder = tempfile.TemporaryDirectory(prefix="zerobeam-app-", ignore_cleanup_errors=True)
    return folder, serve_beside(Path(folder.name))


def write_run_beside(run: Run, folder: Path) -> None:
    """The run as a file of `folder`, byte by byte as it was read or would be written, with its robot's file.

    Not where its robot is in no file, or in none that can be named from `folder`: the run cannot be fitted
    again then.
    """
    ref = run.header.robot
    name = ref.urdf if isinstance(ref, UrdfRef) else ref
    if name not in built_in_robots():
        path = PurePath(name)
        if path.is_absolute() or ".." in path.parts or not (run.path.parent / name).is_file():
            return
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(run.path.parent / name, folder / name)
    file = folder / f"{run.path.stem or 'run'}.jsonl"
    with suppress(BadInput, OSError):
        file.write_bytes(_content(run))


def write_plan_beside(plan: Plan, folder: Path) -> str:
    """The plan as a file of `folder`, with its robot's file; its name."""
    header, ref = plan.header, plan.header.robot
    name = ref.urdf if isinstance(ref, UrdfRef) else ref
    if name not in built_in_robots():
        source = plan.path.parent / name
        shutil.copyfile(source, folder / source.name)
        robot = ref.model_copy(update={"urdf": source.name}) if isinstance(ref, UrdfRef) else source.name
        header = header.model_copy(update={"robot": robot})
    return replace(plan, header=header).write(folder / "plan.yaml").name


def _content(run: Run) -> bytes:
    if run.header_line is not None and run.path.is_file():
        return run.path.read_bytes()
    return (header_text(run.header) + "".join(map(shot_text, run.shots))).encode()
