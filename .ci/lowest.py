"""What `make test-lowest` installs: the lowest versions of what users install, and the tools of the tests."""

import sys
import tomllib
from pathlib import Path

NEWER = ("import-linter",)  # tools that need newer versions, and that `make lint` alone runs

stated = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = stated["optional-dependencies"]
used = [own for name, extra in extras.items() if name not in ("docs", "test") for own in extra]
lowest = {own.replace(">=", "==") for own in (*stated["dependencies"], *used)}
tools = [own for own in extras["test"] if not own.startswith(NEWER)]
sys.stdout.writelines(f"{own}\n" for own in (*sorted(lowest), *tools))
