"""Message types for recordings: ROS 1's standard ones and this package's own."""

from __future__ import annotations

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from people_fusion.core.resources import PACKAGE, directory


def typestore() -> Typestore:
    """A fresh store with ROS 1 Noetic's types and ``people_fusion/msg/*``.

    Raises:
        ConfigError: if the package's message definitions cannot be found.
    """
    store = get_typestore(Stores.ROS1_NOETIC)
    types = {}
    for definition in sorted(directory("msg").glob("*.msg")):
        types.update(get_types_from_msg(definition.read_text(encoding="utf-8"), f"{PACKAGE}/msg/{definition.stem}"))
    store.register(types)
    return store
