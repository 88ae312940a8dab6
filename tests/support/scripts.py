"""Scripts that belong to no package, of the benchmarks and the docs: loaded by their path."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS, DOCS = ROOT / "benchmarks", ROOT / "docs"


def load_script(folder: Path, name: str) -> ModuleType:
    """The script `name` as a module; what stands under `if __name__` is not run."""
    spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where a dataclass looks up its annotations
    spec.loader.exec_module(module)
    return module
