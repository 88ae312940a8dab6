"""Running a C compiler that may hang, and keeping what it made where nobody else can change it."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import tempfile
import warnings
from collections.abc import Sequence
from functools import cache
from pathlib import Path

LONGEST_S = 300.0  # the largest kernels take a few seconds, on a busy machine a minute and more

_stuck: set[str] = set()  # compilers that did not end: nobody waits for them twice


class KernelWarning(UserWarning):
    """Kernels are not compiled, or not kept: it takes longer, the numbers are the same."""


def ran(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """What the compiler ended with. After `LONGEST_S` it is killed with its children: TimeoutExpired, and at
    once for the same compiler from then on."""
    if command[0] in _stuck:
        raise subprocess.TimeoutExpired(command[0], LONGEST_S)
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=0,
    ) as process:
        try:
            out, errors = process.communicate(timeout=LONGEST_S)
        except BaseException as error:
            _kill(process)
            if isinstance(error, subprocess.TimeoutExpired):
                _stuck.add(command[0])
                raise subprocess.TimeoutExpired(command[0], LONGEST_S) from None
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, errors)


def _kill(process: subprocess.Popen[str]) -> None:
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()


def private_folder(folder: Path) -> Path:
    """`folder`, made if it is missing, where nobody else may write to it; else one of this process alone."""
    _make_private(folder)
    return folder if private(folder) else _own_folder(folder)


def private(path: Path) -> bool:
    """Whether a file or folder is this user's and nobody else may write to it. What is loaded is obeyed."""
    if os.name != "posix":
        return True  # the folders of a user are their own there
    status = path.stat()
    return status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _make_private(folder: Path) -> None:
    """Make a folder, and those above it, for this user alone, whatever the umask allows others."""
    if not folder.exists():
        _make_private(folder.parent)
        folder.mkdir(mode=0o700, exist_ok=True)


@cache
def _own_folder(instead_of: Path) -> Path:
    warnings.warn(
        f"compiled kernels are not kept: other users may write to {instead_of}, or own it. They are compiled"
        f" anew each time. To do: chmod 700 {instead_of}, or name a folder of your own in ZEROBEAM_CACHE",
        KernelWarning,
        stacklevel=5,
    )
    _kept.append(tempfile.TemporaryDirectory(prefix="zerobeam-kernels-"))
    return Path(_kept[-1].name)


_kept: list[tempfile.TemporaryDirectory[str]] = []  # removed at the end of the process
