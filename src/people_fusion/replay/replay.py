"""From a recording and a preset to tracks and scores."""

from __future__ import annotations

import dataclasses
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, Mapping, Optional, Sequence, Tuple, Union

from people_fusion.core.errors import RecordingError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import to_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.evaluation.clear_mot import THRESHOLD_M
from people_fusion.evaluation.evaluate import Evaluation, evaluate
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.replay.discovery import Sources, discover
from people_fusion.replay.ground_truth import Instant, read_ground_truth
from people_fusion.replay.image_plane import View, read_view, score_in_image
from people_fusion.replay.recording import Recording
from people_fusion.replay.sampling import Sampler, together
from people_fusion.replay.session import Session, Update
from people_fusion.replay.track_bag import TrackWriter
from people_fusion.tracking.fusion import FusionConfig


@dataclass(frozen=True)
class Selection:
    """Which part of a recording is replayed, and how it is scored.

    Attributes:
        scans: topics; empty: found by type.
        world_frame: frame of the tracks; None: found in tf.
        ground_truth: topic; None: found by name and type.
        odometry: topic in the place of a transform that tf lacks; None: found by type, "": none.
        start_s: seconds after the recording's start.
        duration_s: seconds, None to the end.
        only_annotated: not everybody is annotated: false positives are not counted.
        threshold_m: largest distance of a person and his track.
        image: topic of a camera's images in which people are scored too; None: on the floor alone.
    """

    scans: Tuple[str, ...] = ()
    world_frame: Optional[str] = None
    ground_truth: Optional[str] = None
    odometry: Optional[str] = None
    start_s: float = 0.0
    duration_s: Optional[float] = None
    only_annotated: bool = False
    threshold_m: float = THRESHOLD_M
    image: Optional[str] = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a replay.

    Attributes:
        sources: what was taken of the recording.
        recorded_s: from the first scan's stamp to the last one's.
        scans, processed: scans that arrived and that went through.
        counters: events by name.
        truth, estimates: annotated and reported people, or None without ground truth.
        evaluation: scores, or None without ground truth.
        grid: map of the recording, or None.
        in_image: scores in the selection's image, or None.
    """

    sources: Sources
    recorded_s: float
    scans: int
    processed: int
    counters: Dict[str, int]
    truth: Optional[Truth]
    estimates: Optional[Estimates]
    evaluation: Optional[Evaluation]
    grid: Optional[OccupancyGrid]
    in_image: Optional[Evaluation] = None


def sources_of(recording: Recording, config: FusionConfig, selection: Selection) -> Sources:
    """What a preset takes of a recording.

    Raises:
        RecordingError: see discover.
    """
    return discover(
        recording,
        config.frames,
        selection.scans,
        selection.world_frame,
        selection.ground_truth,
        selection.odometry,
        images=bool(config.head_cues),
        depths=bool(config.rgbd_cues),
        described=frozenset(config.panoramas),
    )


def replay(
    path: Union[str, Path],
    config: FusionConfig,
    selection: Selection,
    out: Optional[Path] = None,
    found: Optional[Callable[[Sources], None]] = None,
    progress: Optional[Callable[[float], None]] = None,
    watch: Optional[Callable[[Session, Update], None]] = None,
    processing_s: Optional[Mapping[str, float]] = None,
) -> Outcome:
    """Run a preset over a recording.

    Args:
        path: ROS 1 bag.
        config: preset; its frames are preferences.
        selection: which part, and how it is scored.
        out: bag for detections and tracks.
        found: called once with what is taken.
        progress: called after each scan with its arrival in seconds after the recording's start.
        watch: called after each measurement that the tracker has processed.
        processing_s: see Session.

    Raises:
        ConfigError: `processing_s` names no cue of a scan.
        RecordingError: the recording is damaged, lacks what was asked for, or no scan of it could be used; or the
            selection lies outside it.
    """
    with ExitStack() as stack:
        recording = stack.enter_context(Recording(path))
        check_window(recording, selection)
        view: Optional[View] = None
        if selection.image is not None:
            view = read_view(path, selection.image, config.panoramas)
        sources = sources_of(recording, config, selection)
        if found is not None:
            found(sources)
        instants: Sequence[Instant] = ()
        if sources.ground_truth is not None:
            instants = read_ground_truth(
                recording, sources.ground_truth, sources.scans, selection.start_s, selection.duration_s
            )
        writer = stack.enter_context(TrackWriter(out)) if out is not None else None
        sampler = Sampler(instants)

        def before(stamp_ns: int) -> None:
            sampler.until(stamp_ns, session.fusion, session.transforms)

        def measured(measurement: Measurement, arrival_ns: int) -> None:
            if writer is not None:
                writer.write_measurement(measurement, arrival_ns)
            if progress is not None:
                progress(to_seconds(arrival_ns - recording.start_ns))

        def after(update: Update) -> None:
            if writer is not None:
                writer.write_tracks(session.fusion.tracks(), update.arrival_ns)
            if watch is not None:
                watch(session, update)

        framed = dataclasses.replace(config, frames=sources.frames)
        session = Session(framed, sources, measured, before, after, processing_s=processing_s)
        session.run(recording, selection.start_s, selection.duration_s)
        counters = session.counters()
        if not session.processed:
            reasons = ", ".join(f"{name}: {count}" for name, count in counters.items() if count) or "there are none"
            raise RecordingError(f"{path}: no scan could be used ({reasons})")
    if sampler.skipped:
        counters["annotated instants without transform"] = sampler.skipped
        if not sampler.samples:
            raise RecordingError(
                f"{path}: no transform connects {instants[0].frame_id} of {sources.ground_truth.name} "  # type: ignore[union-attr]
                f"with {sources.frames.world}"
            )
    truth, estimates, evaluation = score(sampler.samples, selection) if sampler.samples else (None, None, None)
    in_image = None
    if view is not None:
        in_image, missing = score_in_image(sampler.samples, view, selection.only_annotated)
        if missing:
            counters["annotated instants without the camera's place"] = missing
    return Outcome(
        sources,
        session.recorded_s,
        session.scans,
        session.processed,
        counters,
        truth,
        estimates,
        evaluation,
        session.grid,
        in_image,
    )


def check_window(recording: Recording, selection: Selection) -> None:
    """Refuse a selection that lies outside the recording.

    Raises:
        RecordingError: it does.
    """
    start_s, duration_s = selection.start_s, selection.duration_s
    whole_s = to_seconds(recording.end_ns - recording.start_ns)
    window = f"the recording goes from 0 to {whole_s:.1f} s"
    if not 0.0 <= start_s < whole_s:
        raise RecordingError(f"{recording.path}: nothing starts at {start_s:g} s; {window}")
    if duration_s is not None and not duration_s > 0.0:
        raise RecordingError(f"{recording.path}: nothing lasts {duration_s:g} s; {window}")


def score(
    samples: Sequence[Tuple[Instant, Tracks]], selection: Selection
) -> Tuple[Truth, Estimates, Evaluation]:
    """Evaluation of tracks and annotated people at the same instants."""
    truth, estimates = together(samples)
    return truth, estimates, evaluate(truth, estimates, selection.threshold_m, selection.only_annotated)
