"""What a recording holds, found by a process of its own: one that hurts ends that process, not the server."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ....experiments.makers.contents import Contents, contents_of, head_of
from ....model.errors import BadInput
from ....model.files.text_tables import layout_of
from ....model.records import read, to_json

PATIENCE_S = 60.0
MOST_MEMORY = 4 * 10**9  # bytes of address space, of which libraries take one tenth
_PROGRAM = "from zerobeam.app.server.answers.contents_process import main; main()"
_COMMAND = [sys.executable, "-P", "-c", _PROGRAM]  # nothing is imported from the folder


async def contents(path: Path, layout: Mapping[str, object]) -> Contents:
    """What `contents_of` finds in a file; `layout` is what is stated of a table's.

    BadInput where it refuses, or where it takes more than `PATIENCE_S` or `MOST_MEMORY`.
    """
    process = await asyncio.create_subprocess_exec(
        *_COMMAND,
        str(path),
        json.dumps(dict(layout)),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            answer, fault = await process.communicate()
    except TimeoutError:
        raise _too_much(path, f"no answer in {PATIENCE_S:.0f} s") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        if process.returncode < 0:
            raise _too_much(path, f"the process was ended by signal {-process.returncode}")
        raise RuntimeError(fault.decode("utf-8", "replace"))
    printed = json.loads(answer)
    if "what" in printed:
        raise BadInput(**printed)
    return read(Contents, printed)


def main() -> None:
    """Print what the file holds, or why it is refused. Arguments: the file, and the layout that is stated."""
    path, layout = Path(sys.argv[1]), json.loads(sys.argv[2])
    _limit()
    try:
        holdings = contents_of(path, layout_of(head_of(path)[0], **layout) if layout else None)
        answer = to_json(holdings)
    except MemoryError:
        error = _too_much(path, f"more than {MOST_MEMORY // 10**9} GB of memory")
        answer = _facts(error)
    except BadInput as error:
        answer = _facts(error)
    sys.stdout.write(json.dumps(answer, allow_nan=False))


def _facts(error: BadInput) -> dict[str, object]:
    """The arguments of a BadInput."""
    facts = {name: getattr(error, name) for name in ("found", "allowed", "remedy", "file")}
    texts = {name: None if fact is None else str(fact) for name, fact in facts.items()}
    return {"what": error.what, "line": error.line, **texts}


def _limit() -> None:
    """Bound memory and time, which also ends this process where the server was killed; not on Windows."""
    if sys.platform != "win32":
        import resource

        limits = {resource.RLIMIT_AS: MOST_MEMORY, resource.RLIMIT_CPU: int(PATIENCE_S)}
        for kind, limit in limits.items():
            with suppress(ValueError, OSError):  # a lower one is in force, or the system has none
                resource.setrlimit(kind, (limit, limit))


def _too_much(path: Path, how_much: str) -> BadInput:
    return BadInput(
        "the file is too much to be looked at here",
        found=how_much,
        allowed=f"{PATIENCE_S:.0f} s and {MOST_MEMORY // 10**9} GB",
        remedy="use zerobeam import on the command line, if it is the right file",
        file=path,
    )
