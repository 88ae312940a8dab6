"""The lowest versions of what zerobeam needs at run time, as constraints for pip."""

import sys
import tomllib
from pathlib import Path

stated = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
sys.stdout.writelines(f"{own.replace('>=', '==')}\n" for own in stated["project"]["dependencies"])
