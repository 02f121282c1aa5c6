"""Frozen dataclasses from YAML or rosparam mappings; whatever is unknown, ill-typed or out of range is refused.

Defaults and documentation of a parameter stand once, in its dataclass:

    @dataclass(frozen=True)
    class GateConfig:
        probability: float = parameter(0.99, "share of true pairs that the gate lets pass", low=0.0, high=1.0)

Field types may be bool, int, float, str, Optional, Tuple[X, ...], Dict[str, X], another config dataclass, or a part
of a registry (`component`). Python 3.8 evaluates these annotations, so they are written with `typing`'s names.
"""

from __future__ import annotations

import dataclasses
import math
import typing
from pathlib import Path
from typing import Any, Callable, Mapping, Optional, Tuple, Type, TypeVar, Union

import yaml

from people_fusion.core.errors import ConfigError
from people_fusion.core.registry import Registry

C = TypeVar("C")


def parameter(
    default: Any,
    doc: str,
    low: float = -math.inf,
    high: Optional[float] = None,
    choices: Optional[Tuple[str, ...]] = None,
) -> Any:
    """Field of a config dataclass with its documentation, range (both ends included) or allowed words.

    Infinity is a value only where it is the default or given as `high`.
    """
    finite, high = high is None and default != math.inf, math.inf if high is None else high
    metadata = {"doc": doc, "low": low, "high": high, "finite": finite, "choices": choices}
    if isinstance(default, (dict, list)):
        return dataclasses.field(default_factory=lambda: type(default)(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def component(registry: Registry[Any], default: Callable[[], Any], doc: str) -> Any:
    """Field that holds the config of one exchangeable part; YAML names the part by `type`."""
    return dataclasses.field(default_factory=default, metadata={"doc": doc, "registry": registry})


def components(registry: Registry[Any], doc: str) -> Any:
    """Field that holds the configs of any number of exchangeable parts, by names of the user's choice."""
    return dataclasses.field(default_factory=dict, metadata={"doc": doc, "registry": registry, "many": True})


def section(default: Callable[[], Any], doc: str) -> Any:
    """Field that holds a nested config dataclass."""
    return dataclasses.field(default_factory=default, metadata={"doc": doc})


def parse(config: Type[C], mapping: Any, path: str = "") -> C:
    """Config dataclass from a mapping.

    Args:
        config: dataclass with fields made by `parameter`, `component` and `section`.
        mapping: keys and values as YAML or the parameter server give them; None is an empty mapping.
        path: where the mapping stands, for messages.

    Raises:
        ConfigError: names the full path of the key that is unknown, of a wrong type or out of range.
    """
    mapping = {} if mapping is None else mapping
    if not isinstance(mapping, Mapping):
        raise ConfigError(f"{path or 'configuration'}: expected a mapping, got {mapping!r}")
    fields = {field.name: field for field in dataclasses.fields(config)}  # type: ignore[arg-type]
    hints = typing.get_type_hints(config)
    values = {}
    for key, value in mapping.items():
        key_path = f"{path}/{key}" if path else str(key)
        if key not in fields:
            raise ConfigError(f"{key_path}: unknown parameter; there are {', '.join(fields) or 'none'}")
        values[key] = _convert(hints[key], value, key_path, fields[key].metadata)
    try:
        return config(**values)
    except ConfigError as error:  # values that do not go together; `error` may begin with the one of them
        if not path:
            raise
        raise ConfigError(f"{path}{'/' if str(error).split(':')[0] in fields else ': '}{error}") from error


def load_yaml(path: Union[str, Path]) -> Any:
    """Contents of a YAML file.

    Raises:
        ConfigError: if the file is missing or is not YAML; the message names it.
    """
    try:
        with Path(path).open(encoding="utf-8") as stream:
            return yaml.safe_load(stream)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not YAML: {' '.join(str(error).split())}") from error


def merge(base: Any, override: Any) -> Any:
    """`override` laid over `base`, mapping by mapping; where `type` differs the whole part is replaced."""
    if not (isinstance(base, Mapping) and isinstance(override, Mapping)):
        return override
    if "type" in override and override["type"] != base.get("type", override["type"]):
        return dict(override)
    merged = dict(base)
    for key, value in override.items():
        merged[key] = merge(base[key], value) if key in base else value
    return merged


def _convert(hint: Any, value: Any, path: str, metadata: Mapping[str, Any]) -> Any:
    registry = metadata.get("registry")
    if metadata.get("many"):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{path}: expected a mapping, got {value!r}")
        one = {"registry": registry}
        return {str(key): _convert(hint, entry, f"{path}/{key}", one) for key, entry in value.items()}
    if registry is not None:
        if not isinstance(value, Mapping) or not isinstance(value.get("type"), str):
            raise ConfigError(f"{path}: expected a mapping with `type`, one of {', '.join(registry.names())}")
        rest = {key: entry for key, entry in value.items() if key != "type"}
        return parse(registry.config_of(value["type"], f"{path}/type"), rest, path)
    if dataclasses.is_dataclass(hint):
        return parse(hint, value, path)  # type: ignore[arg-type]
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Union and type(None) in arguments:
        inner = next(argument for argument in arguments if argument is not type(None))
        return None if value is None else _convert(inner, value, path, metadata)
    if origin is tuple:
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{path}: expected a list, got {value!r}")
        if arguments[-1] is not Ellipsis and len(value) != len(arguments):
            raise ConfigError(f"{path}: expected {len(arguments)} values, got {len(value)}")
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else arguments
        pairs = enumerate(zip(kinds, value))
        return tuple(_convert(kind, entry, f"{path}[{i}]", metadata) for i, (kind, entry) in pairs)
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{path}: expected a mapping, got {value!r}")
        return {str(key): _convert(arguments[1], entry, f"{path}/{key}", metadata) for key, entry in value.items()}
    return _scalar(hint, value, path, metadata)


def _scalar(hint: Any, value: Any, path: str, metadata: Mapping[str, Any]) -> Any:
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value) if abs(value) < 1e300 else math.inf  # YAML knows integers of any length
    if type(value) is not hint:
        raise ConfigError(f"{path}: expected {hint.__name__}, got {value!r}")
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        low, high = metadata.get("low", -math.inf), metadata.get("high", math.inf)
        if not low <= value <= high:  # also refuses NaN
            raise ConfigError(f"{path}: {value!r} is not within [{low}, {high}]")
        if math.isinf(value) and metadata.get("finite", True):
            raise ConfigError(f"{path}: {value!r} is not finite")
    choices = metadata.get("choices")
    if choices is not None and value not in choices:
        raise ConfigError(f"{path}: {value!r} is not one of {', '.join(choices)}")
    return value
