"""Modules that come when something of them is used, not when they are imported."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from threading import RLock
from types import ModuleType
from typing import Any


class _Late(ModuleType):
    """Stands in for a module, and passes on what is asked of it once it is `made`."""

    def __getattr__(self, name: str) -> Any:
        if "made" not in self.__dict__:
            raise AttributeError(name)
        return getattr(_late.real(self), name)


class _LateModules(MetaPathFinder, Loader):
    def __init__(self) -> None:
        self.names: set[str] = set()
        self._one_at_a_time = RLock()

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in self.names else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Late(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["made"] = True

    def real(self, late: _Late) -> ModuleType:
        """The module that `late` stands in for."""
        with self._one_at_a_time:
            self.names.discard(late.__name__)
            if sys.modules.get(late.__name__) is late:
                del sys.modules[late.__name__]
            return import_module(late.__name__)


_late = _LateModules()


def when_used(*names: str) -> None:
    """From now on these modules come when they are used."""
    _late.names.update(names)
    if _late not in sys.meta_path:
        sys.meta_path.insert(0, _late)
