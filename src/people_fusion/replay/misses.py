"""Pictures of annotated people whom the tracker did not report: why?"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Dict, List, NamedTuple

import numpy as np

from people_fusion.core.errors import RecordingError, TransformUnavailable
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.evaluation.clear_mot import Event
from people_fusion.evaluation.plots import Scene, plot_miss, png
from people_fusion.replay.replay import Outcome
from people_fusion.replay.sampling import hits_of
from people_fusion.replay.session import Session, Update

MOST_PICTURES = 12
OLD_NS = from_seconds(0.3)  # what a cue saw longer ago is not shown
NOTHING = Scene(
    *(np.zeros((0, 2)),) * 3, np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=bool), np.zeros((0, 2, 2))
)


class _Look(NamedTuple):
    """What one cue saw, and the tracks after it."""

    cue: str
    stamp_ns: int
    scene: Scene


class Scenes:
    """All that was seen and believed during a replay."""

    def __init__(self) -> None:
        self._looks: List[_Look] = []

    def watch(self, session: Session, update: Update) -> None:
        """The tracker has processed a measurement."""
        tracks, measurement = session.fusion.tracks(), update.measurement
        if tracks.frame_id != session.fusion.config.frames.world:
            return
        with suppress(TransformUnavailable):
            pose = session.transforms.lookup(tracks.frame_id, measurement.frame_id, measurement.stamp_ns)
            hits, scanners = np.zeros((0, 3)), np.zeros((0, 3))
            if measurement.sight is not None:
                hits, scanners = hits_of(measurement.sight), np.append(measurement.sight.position, 0.0)[None]
            scene = Scene(
                hits=pose.apply(hits)[:, :2],
                scanners=pose.apply(scanners)[:, :2],
                detections=pose.apply(measurement.positions)[:, :2],
                confidences=measurement.confidences,
                tracks=tracks.means[:, :2],
                existence=tracks.existence,
                confirmed=tracks.confirmed,
                covariances=tracks.covariances[:, :2, :2],
            )
            self._looks.append(_Look(measurement.cue, measurement.stamp_ns, scene))

    def at(self, stamp_ns: int) -> Scene:
        """What each cue saw last until then, and the tracks after that."""
        newest: Dict[str, _Look] = {}
        for look in self._looks:
            if stamp_ns - OLD_NS < look.stamp_ns <= stamp_ns:
                newest[look.cue] = max(look, newest.get(look.cue, look), key=lambda entry: entry.stamp_ns)
        scenes = [look.scene for look in sorted(newest.values(), key=lambda entry: entry.stamp_ns)]
        if not scenes:
            return NOTHING
        return scenes[-1]._replace(
            hits=np.concatenate([scene.hits for scene in scenes]),
            scanners=np.concatenate([scene.scanners for scene in scenes]),
            detections=np.concatenate([scene.detections for scene in scenes]),
            confidences=np.concatenate([scene.confidences for scene in scenes]),
        )


def save_misses(directory: Path, outcome: Outcome, scenes: Scenes) -> List[str]:
    """Draw up to `MOST_PICTURES` misses, evenly chosen.

    Returns:
        Lines that say what was near all of those who were missed, and where the pictures are.

    Raises:
        RecordingError: nothing is annotated, or a picture cannot be written.
    """
    truth, evaluation = outcome.truth, outcome.evaluation
    if truth is None or evaluation is None:
        raise RecordingError(f"{directory}: nothing is annotated, so nobody was missed")
    rows = evaluation.events.truth_rows[evaluation.events.kinds == Event.MISS]
    picked = np.linspace(0, len(rows) - 1, min(len(rows), MOST_PICTURES)).astype(int)
    chosen = set(rows[picked].tolist())
    threshold_m, detected, suspected = evaluation.threshold_m, 0, 0
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for row in rows.tolist():
            frame, place = truth.frames[row], truth.points[row]
            scene = scenes.at(int(truth.stamps_ns[frame]))
            nearest = {name: _nearest(place, getattr(scene, name)) for name in ("scanners", "detections", "tracks")}
            detected += nearest["detections"] <= threshold_m
            suspected += nearest["tracks"] <= threshold_m
            if row not in chosen:
                continue
            seconds = to_seconds(int(truth.stamps_ns[frame] - truth.stamps_ns[0]))
            people = np.flatnonzero(truth.frames == frame)
            told = ", ".join(f"{name[:-1]} at {distance:.2f} m" for name, distance in nearest.items())
            title = f"person {truth.ids[row]}, {seconds:.2f} s after the first label; nearest {told}"
            missed = int(np.flatnonzero(people == row)[0])
            figure = plot_miss(scene, truth.points[people], missed, title, threshold_m, outcome.grid)
            (directory / f"{seconds:07.2f}s_person_{truth.ids[row]}.png").write_bytes(png(figure))
    except OSError as error:
        raise RecordingError(f"{directory}: {error.strerror}") from error
    within = f"within {threshold_m:g} m"
    return [
        f"of {len(rows)} misses {detected} have a detection {within}, {suspected} a track {within} that another person "
        "has or that is not reported",
        f"{directory}: {len(chosen)} pictures",
    ]


def _nearest(place: np.ndarray, points: np.ndarray) -> float:
    """Distance of the nearest point, infinite without any."""
    return float(np.min(np.hypot(*(points - place).T), initial=np.inf))
