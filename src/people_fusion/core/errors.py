"""Every exception that people_fusion raises on purpose."""

from __future__ import annotations


class PeopleFusionError(Exception):
    """Root of all errors of this package; a command line shows it as one line and exits with 1."""


class ConfigError(PeopleFusionError):
    """A parameter is unknown, of the wrong type or out of range; the message names its full path."""


class DataError(PeopleFusionError):
    """One item of a stream is unusable; the caller counts it under `reason` and goes on.

    Args:
        reason: a short constant phrase that diagnostics count by, e.g. ``"scan without beams"``.
        detail: what was wrong with this item.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason


class TransformUnavailable(PeopleFusionError):
    """A transform cannot be given; `may_arrive` tells whether waiting can help."""

    def __init__(self, message: str, may_arrive: bool) -> None:
        super().__init__(message)
        self.may_arrive = may_arrive


class NotLooked(PeopleFusionError):
    """A cue cannot see anybody in one item of a stream, and says nothing of it; no fault, and nobody is missed."""


class RecordingError(PeopleFusionError):
    """A recording is missing, unreadable, truncated or lacks what was asked of it."""
