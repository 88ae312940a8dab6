"""What a recording holds, found by a process of its own: one that hurts ends that process, not the server."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ....experiments.makers.contents import Contents, contents_of, head_of, layout_of, layout_stated
from ....model.errors import BadInput

PATIENCE_S = 60.0
MOST_MEMORY = 4 * 10**9  # bytes of address space, of which libraries take one tenth
_PROGRAM = "from zerobeam.app.server.answers.contents_process import main; main()"
_COMMAND = [sys.executable, "-P", "-c", _PROGRAM]  # nothing is imported from the folder


async def contents(path: Path, stated: Mapping[str, Any]) -> dict[str, Any]:
    """What `contents_of` finds in a file, as JSON has it; `stated` is how a table is laid out.

    BadInput where it refuses, or where it takes more than `PATIENCE_S` or `MOST_MEMORY`.
    """
    process = await asyncio.create_subprocess_exec(
        *_COMMAND,
        str(path),
        json.dumps(dict(stated)),
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
    told: dict[str, Any] = json.loads(answer)
    if "refused" in told:
        raise BadInput(**told["refused"])
    return told


def main() -> None:
    """Print what the file holds, or why it is refused. Arguments: the file, and the layout that is stated."""
    path, stated = Path(sys.argv[1]), json.loads(sys.argv[2])
    _limit()
    try:
        told = _plain(
            contents_of(path, layout_stated(layout_of(head_of(path)[0]), stated) if stated else None)
        )
    except MemoryError:
        error = _too_much(path, f"more than {MOST_MEMORY // 10**9} GB of memory")
        told = {"refused": _facts(error)}
    except BadInput as error:
        told = {"refused": _facts(error)}
    sys.stdout.write(json.dumps(told, allow_nan=False))


def _limit() -> None:
    """Bound memory and time, which also ends this process where the server was killed; not on Windows."""
    if sys.platform != "win32":
        import resource

        limits = {resource.RLIMIT_AS: MOST_MEMORY, resource.RLIMIT_CPU: int(PATIENCE_S)}
        for kind, limit in limits.items():
            with suppress(ValueError, OSError):  # a lower one is in force, or the system has none
                resource.setrlimit(kind, (limit, limit))


def _too_much(path: Path, found: str) -> BadInput:
    return BadInput(
        "the file is too much to be looked at here",
        found=found,
        allowed=f"{PATIENCE_S:.0f} s and {MOST_MEMORY // 10**9} GB",
        remedy="use zerobeam import on the command line, if it is the right file",
        file=path,
    )


def _facts(error: BadInput) -> dict[str, Any]:
    facts = {name: getattr(error, name) for name in ("what", "found", "allowed", "remedy", "file")}
    texts = {name: None if fact is None else str(fact) for name, fact in facts.items()}
    return {**texts, "line": error.line}


def _plain(found: Contents) -> dict[str, Any]:
    """As JSON has it: points and topics by name."""
    told = dataclasses.asdict(found)
    told["points"] = [{"name": name, "joints": joints} for name, joints in found.points]
    told["topics"] = [topic._asdict() for topic in found.topics]
    return told
