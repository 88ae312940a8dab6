"""emcee without the half second of scipy.stats: the function that its KDE move takes comes when called."""

from __future__ import annotations

import builtins
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import ModuleType, SimpleNamespace
from typing import Any

_KDE = "emcee.moves.kde"


def lean_emcee() -> ModuleType:
    """The module `emcee`, whole; scipy.stats is as it was."""
    finder = _KdeFinder()
    sys.meta_path.insert(0, finder)
    try:
        import emcee
    finally:
        sys.meta_path.remove(finder)
    module: ModuleType = emcee
    return module


class _KdeFinder(MetaPathFinder):
    """Finds the module of the KDE move alone."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        spec = PathFinder.find_spec(fullname, path, target) if fullname == _KDE else None
        if spec is None or not isinstance(spec.loader, SourceFileLoader):
            return None
        spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    """Runs a module with an `import` of its own: no other module, in no thread, sees anything of it."""

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["__builtins__"] = {**vars(builtins), "__import__": _imported}
        super().exec_module(module)


def _imported(
    name: str, globals: Any = None, locals: Any = None, fromlist: Sequence[str] | None = (), level: int = 0
) -> Any:
    if name == "scipy.stats" and tuple(fromlist or ()) == ("gaussian_kde",):
        return SimpleNamespace(gaussian_kde=_gaussian_kde)
    return builtins.__import__(name, globals, locals, fromlist or (), level)


def _gaussian_kde(*arguments: Any, **options: Any) -> Any:
    from scipy.stats import gaussian_kde

    return gaussian_kde(*arguments, **options)
