"""Exchangeable parts by name: the name in a YAML file's `type`, the class and its frozen config dataclass."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any, Callable, Dict, Generic, Tuple, Type, TypeVar

from people_fusion.core.errors import ConfigError

T = TypeVar("T")
C = TypeVar("C", bound=type)


class Registry(Generic[T]):
    """Parts of one kind. A part registers itself with a decorator when its module is imported.

    Args:
        kind: what the parts are, for messages, e.g. ``"motion model"``.
        package: package whose modules, those of its sub-packages included, are imported before the first look-up, so
            that a new file is found by itself.
    """

    def __init__(self, kind: str, package: str) -> None:
        self.kind = kind
        self._package = package
        self._parts: Dict[str, Tuple[type, type]] = {}
        self._loaded = False

    def register(self, name: str, config: type) -> Callable[[C], C]:
        """Class decorator; the class is built as ``cls(config_instance, **dependencies)``."""

        def keep(cls: C) -> C:
            if name in self._parts and self._parts[name][0].__qualname__ != cls.__qualname__:
                raise ConfigError(f"two {self.kind}s are named {name!r}")
            self._parts[name] = (cls, config)
            return cls

        return keep

    def names(self) -> Tuple[str, ...]:
        """All registered names, sorted."""
        self._load()
        return tuple(sorted(self._parts))

    def config_of(self, name: str, path: str) -> Type[Any]:
        """Config dataclass of a part.

        Raises:
            ConfigError: if no part has this name; the message names `path` and the names there are.
        """
        self._load()
        if name not in self._parts:
            raise ConfigError(f"{path}: no {self.kind} {name!r}; there are {', '.join(self.names())}")
        return self._parts[name][1]

    def class_of(self, name: str) -> Type[T]:
        """Class of a part that there is."""
        self._load()
        return self._parts[name][0]

    def name_of(self, config: Any) -> str:
        """Registered name of a config instance's part."""
        self._load()
        for name, (_, config_class) in self._parts.items():
            if type(config) is config_class:
                return name
        raise ConfigError(f"no {self.kind} is configured by {type(config).__name__}")

    def build(self, config: Any, **dependencies: Any) -> T:
        """The part that `config` configures."""
        part: T = self._parts[self.name_of(config)][0](config, **dependencies)
        return part

    def _load(self) -> None:
        if self._loaded:
            return
        self._loaded = True
        package = importlib.import_module(self._package)
        for module in pkgutil.walk_packages(package.__path__, self._package + "."):
            importlib.import_module(module.name)
