"""Configuration: defaults stand once, and what is unknown, ill-typed or out of range is refused by its full path."""

from dataclasses import dataclass
from typing import Dict, Optional, Tuple

import pytest

from people_fusion.core.config import component, components, load_yaml, merge, parameter, parse, section
from people_fusion.core.errors import ConfigError
from people_fusion.core.registry import Registry

SHAPES = Registry("shape", "people_fusion.core")


@dataclass(frozen=True)
class CircleConfig:
    radius: float = parameter(1.0, "metres", low=0.0, high=10.0)


@dataclass(frozen=True)
class SquareConfig:
    edge: int = parameter(2, "metres", low=1)


@SHAPES.register("circle", CircleConfig)
class Circle:
    def __init__(self, config):
        self.config = config


@SHAPES.register("square", SquareConfig)
class Square(Circle):
    pass


@dataclass(frozen=True)
class SpanConfig:
    first: float = parameter(0.0, "metres")
    last: float = parameter(1.0, "metres")

    def __post_init__(self):
        if self.last < self.first:
            raise ConfigError("last: less than first")
        if self.first == self.last == 0.0:
            raise ConfigError("nothing is spanned")


@dataclass(frozen=True)
class Config:
    name: str = parameter("a", "a word", choices=("a", "b"))
    on: bool = parameter(False, "a switch")
    maybe: Optional[float] = parameter(None, "a number or nothing", low=0.0)
    far: float = parameter(1.0, "metres", high=float("inf"))
    farther: float = parameter(float("inf"), "metres")
    pair: Tuple[float, float] = parameter((0.0, 0.0), "two numbers")
    many: Tuple[float, ...] = parameter((), "numbers")
    named: Dict[str, float] = parameter({}, "numbers by name", low=0.0)
    inner: CircleConfig = section(CircleConfig, "nested")
    by_name: Dict[str, CircleConfig] = parameter({}, "nested by name")
    spans: Dict[str, SpanConfig] = parameter({}, "values that must go together")
    shape: object = component(SHAPES, CircleConfig, "exchangeable")


def test_nothing_given_gives_the_defaults():
    assert parse(Config, None) == Config() == parse(Config, {})


def test_values_of_every_kind_are_taken():
    config = parse(
        Config,
        {
            "name": "b",
            "on": True,
            "maybe": 3,
            "pair": [1, 2.5],
            "many": [1, 2, 3],
            "named": {"x": 1},
            "inner": {"radius": 2},
            "by_name": {"front": {"radius": 0.5}},
            "shape": {"type": "square", "edge": 4},
        },
    )
    assert config.maybe == 3.0 and isinstance(config.maybe, float)
    assert config.pair == (1.0, 2.5) and config.many == (1.0, 2.0, 3.0)
    assert config.inner == CircleConfig(2.0) and config.by_name["front"].radius == 0.5
    assert isinstance(SHAPES.build(config.shape), Square)


@pytest.mark.parametrize(
    "mapping, path",
    [
        ({"nmae": "a"}, "^nmae: unknown"),
        ({"name": "c"}, "^name: "),
        ({"name": 3}, "^name: expected str"),
        ({"on": 1}, "^on: expected bool"),
        ({"maybe": "x"}, "^maybe: expected float"),
        ({"maybe": True}, "^maybe: expected float"),
        ({"maybe": -1.0}, "^maybe: .*not within"),
        ({"maybe": float("nan")}, "^maybe: .*not within"),
        ({"maybe": float("inf")}, "^maybe: inf is not finite"),
        ({"named": {"x": float("inf")}}, "^named/x: inf is not finite"),
        ({"maybe": 10**400}, "^maybe: "),
        ({"pair": [1.0]}, "^pair: expected 2 values"),
        ({"pair": 1.0}, "^pair: expected a list"),
        ({"many": [1.0, "x"]}, r"^many\[1\]: "),
        ({"named": {"x": -1.0}}, "^named/x: "),
        ({"named": [1.0]}, "^named: expected a mapping"),
        ({"inner": {"radius": 11.0}}, "^inner/radius: "),
        ({"inner": {"diameter": 1.0}}, "^inner/diameter: unknown"),
        ({"inner": 3}, "^inner: expected a mapping"),
        ({"by_name": {"front": {"radius": "x"}}}, "^by_name/front/radius: "),
        ({"shape": {"edge": 4}}, "^shape: expected a mapping with `type`, one of circle, square"),
        ({"shape": {"type": "cube"}}, "^shape/type: no shape 'cube'; there are circle, square"),
        ({"shape": {"type": "square", "radius": 1.0}}, "^shape/radius: unknown"),
        ({"spans": {"x": {"last": -1.0}}}, "^spans/x/last: less than first"),
        ({"spans": {"x": {"last": 0.0}}}, "^spans/x: nothing is spanned"),
        ([], "expected a mapping"),
    ],
)
def test_what_is_wrong_is_refused_by_its_path(mapping, path):
    with pytest.raises(ConfigError, match=path):
        parse(Config, mapping)


def test_path_begins_where_the_mapping_stands():
    with pytest.raises(ConfigError, match=r"^tracker/inner/radius: "):
        parse(Config, {"inner": {"radius": -1.0}}, "tracker")


def test_infinity_is_a_value_only_where_it_means_something():
    assert parse(Config, {"far": float("inf"), "farther": float("inf")}).far == float("inf")


def test_values_that_do_not_go_together_are_refused_by_their_path():
    with pytest.raises(ConfigError, match=r"^last: "):
        parse(SpanConfig, {"last": -1.0})
    with pytest.raises(ConfigError, match=r"^tracker/last: "):
        parse(SpanConfig, {"last": -1.0}, "tracker")


def test_two_parts_of_one_name_are_refused():
    with pytest.raises(ConfigError, match="two shapes are named 'circle'"):
        SHAPES.register("circle", CircleConfig)(type("Other", (), {}))


def test_overrides_are_laid_over_mapping_by_mapping_and_replace_a_part_of_another_type():
    base = {"a": {"b": 1, "c": 2}, "part": {"type": "circle", "radius": 3.0}}
    assert merge(base, {"a": {"b": 5}}) == {"a": {"b": 5, "c": 2}, "part": base["part"]}
    assert merge(base, {"part": {"radius": 1.0}})["part"] == {"type": "circle", "radius": 1.0}
    assert merge(base, {"part": {"type": "square"}})["part"] == {"type": "square"}


def test_missing_and_broken_files_are_named(tmp_path):
    with pytest.raises(ConfigError, match=r"absent\.yaml: No such file"):
        load_yaml(tmp_path / "absent.yaml")
    (tmp_path / "broken.yaml").write_text("a: [1, 2")
    with pytest.raises(ConfigError, match=r"broken\.yaml: not YAML"):
        load_yaml(tmp_path / "broken.yaml")
    (tmp_path / "object.yaml").write_text("!!python/object/apply:os.system ['true']")
    with pytest.raises(ConfigError, match=r"object\.yaml: not YAML"):
        load_yaml(tmp_path / "object.yaml")


@dataclass(frozen=True)
class Many:
    parts: Dict[str, object] = components(SHAPES, "any")


def test_parts_by_names_of_the_users_choice():
    parsed = parse(Many, {"parts": {"mine": {"type": "circle", "radius": 2.0}}})
    assert parsed.parts == {"mine": CircleConfig(2.0)} and parse(Many, {}).parts == {}
    for wrong, message in (({"parts": {"mine": {"type": "cube"}}}, "parts/mine/type"), ({"parts": [1]}, "parts: ")):
        with pytest.raises(ConfigError, match=message):
            parse(Many, wrong)
