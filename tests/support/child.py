"""A program in a process of its own, ended with the test whatever comes of it."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ZEROBEAM = [sys.executable, "-c", "from zerobeam.cli import main; main()"]
# The simulated ABB IRC5 on free ports.
ABB_CONTROLLER = [sys.executable, str(Path(__file__).with_name("start_abb_controller.py"))]
ABB_CONTROLLER += [part for name in ("--port", "--egm-port", "--sensor-port") for part in (name, "0")]
# In front of a command: it is started by one who ignores requests to end, as a shell lets background jobs.
DEAF = ["sh", "-c", 'trap "" INT TERM; exec "$@"', "sh"]


@contextmanager
def child(command: Sequence[str], **asked: Any) -> Iterator[subprocess.Popen[str]]:
    """A process whose output is text; a test that fails, or runs out of time, does not wait for it."""
    with subprocess.Popen(command, text=True, **{"stdout": subprocess.PIPE, **asked}) as process:
        try:
            yield process
        finally:
            process.kill()
