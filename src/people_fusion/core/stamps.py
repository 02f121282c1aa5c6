"""Time as integer nanoseconds since the epoch of the recording's clock.

Integers compare exactly, which ordering and byte-identical replay rest on; floats are for durations alone.
"""

from __future__ import annotations

NANOSECONDS = 1_000_000_000


def to_seconds(duration_ns: int) -> float:
    """Duration in seconds; use on differences of stamps, where a double is exact enough."""
    return duration_ns / NANOSECONDS


def from_seconds(duration_s: float) -> int:
    """Duration in nanoseconds, rounded to the nearest."""
    return round(duration_s * NANOSECONDS)


def join(secs: int, nsecs: int) -> int:
    """Stamp of ROS's two fields."""
    return secs * NANOSECONDS + nsecs


def split(stamp_ns: int) -> tuple[int, int]:
    """ROS's two fields (secs, nsecs) of a stamp."""
    return divmod(stamp_ns, NANOSECONDS)
