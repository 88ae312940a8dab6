"""What `make test-lowest` installs: the lowest versions of what users install, and the tools of the tests."""

import sys
import tomllib
from pathlib import Path

NEWER = ("import-linter",)  # tools that need newer versions, and that `make lint` alone runs

stated = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
lowest = [own.replace(">=", "==") for own in stated["dependencies"]]
tools = [own for own in stated["optional-dependencies"]["test"] if not own.startswith(NEWER)]
sys.stdout.writelines(f"{own}\n" for own in (*lowest, *tools))
