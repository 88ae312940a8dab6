"""What `make test-lowest` installs: the lowest versions of what users install, and the tools of the tests."""

import sys
import tomllib
from pathlib import Path

NEWER = ("import-linter",)  # tools that need newer versions, and that `make lint` alone runs

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
used = [
    requirement for name, extra in extras.items() if name not in ("docs", "test") for requirement in extra
]
lowest = {requirement.replace(">=", "==") for requirement in (*project["dependencies"], *used)}
tools = [requirement for requirement in extras["test"] if not requirement.startswith(NEWER)]
sys.stdout.writelines(f"{requirement}\n" for requirement in (*sorted(lowest), *tools))
