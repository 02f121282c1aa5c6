"""Pictures of one evaluated run, as matplotlib figures without pyplot: nothing is shown, no global state is touched.

A track has the same colour in every picture of a run. Red crosses are misses, violet plus signs false positives, orange
diamonds mismatches, grey is truth.
"""

from __future__ import annotations

import io
from typing import Any, Dict, Mapping, NamedTuple, Optional, Tuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator
from matplotlib.transforms import Affine2D

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.evaluation.clear_mot import Event
from people_fusion.evaluation.consistency import chi_square_band
from people_fusion.evaluation.evaluate import Evaluation
from people_fusion.evaluation.truth import Estimates, Truth

_DOTS_PER_INCH = 110
_TRUTH = "#8c8c8c"
_MISS = "#d62728"
_FALSE = "#7b3fb5"
_MISMATCH = "#ff8c00"
_BAND = "#cfe8cf"
_CONFIRMED = "#1f77b4"
_TRACKS = (
    *("#1f77b4", "#2ca02c", "#8c564b", "#17becf", "#e377c2", "#556b2f", "#003f8a", "#b8860b"),
    *("#008080", "#5f9ea0", "#a0522d", "#6b8e23", "#4169e1", "#c71585", "#2f4f4f", "#9acd32"),
)  # fmt: skip
_LEAST_NEES = 0.01  # what is less is drawn there
_AROUND_M = 2.0  # what is shown about a missed person at least
_LONG_GAP = 3.0  # median periods; nothing is drawn across what is longer
# Unknown, free, occupied.
_MAP_COLOURS = ListedColormap(["#eef0f2", "#ffffff", "#4d4d4d"])


def png(figure: Figure) -> bytes:
    """The picture as a file; the same figure gives the same bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": "people_fusion"})
    return buffer.getvalue()


def plot_tracks(
    truth: Truth, estimates: Estimates, evaluation: Evaluation, grid: Optional[OccupancyGrid] = None
) -> Figure:
    """Where people walked, where the tracker saw them, and where it erred, over the map if there is one."""
    seen = np.concatenate([truth.points, estimates.points, np.zeros((0 if len(truth.ids) else 1, 2))])
    low, high = seen.min(axis=0) - 1.0, seen.max(axis=0) + 1.0
    figure, axes = _ground(low, high, grid)
    places = _places(truth)
    for person in np.unique(truth.ids):
        rows = truth.ids == person
        path = _broken(places[truth.frames[rows]], *truth.points[rows].T)
        axes.plot(*path, color=_TRUTH, linewidth=0.8, zorder=2)
    _draw_paths(axes, places, estimates)
    events = evaluation.events
    for kind, style in _EVENT_STYLES.items():
        chosen = events.kinds == kind
        points = (
            estimates.points[events.estimate_rows[chosen]]
            if kind == Event.FALSE_POSITIVE
            else truth.points[events.truth_rows[chosen]]
        )
        axes.plot(*points.T, linestyle="none", **style)
    _legend(
        axes, [Line2D([], [], color=_TRUTH, linewidth=0.8, label="truth"), _TRACK_HANDLE, *_event_handles(evaluation)]
    )
    return figure


def plot_paths(
    frames: Truth, estimates: Estimates, hits: np.ndarray, grid: Optional[OccupancyGrid] = None
) -> Figure:
    """Where the tracker saw people where nobody is annotated, over the map and what the scanners hit.

    Args:
        frames: without people; its stamps are those of the estimates.
        estimates: the tracker's output.
        hits: (N, 2) metres, in the tracks' frame.
        grid: map in that frame, or None.
    """
    seen = np.concatenate([estimates.points, hits, np.zeros((0 if len(hits) else 1, 2))])
    figure, axes = _ground(seen.min(axis=0) - 1.0, seen.max(axis=0) + 1.0, grid)
    axes.plot(*hits.T, linestyle="none", marker=",", color=_TRUTH, zorder=1)
    _draw_paths(axes, _places(frames), estimates)
    scan = Line2D([], [], linestyle="none", marker=".", color=_TRUTH, label="hits of the scanners")
    _legend(axes, [scan, _TRACK_HANDLE])
    return figure


def plot_reported(frames: Truth, estimates: Estimates) -> Figure:
    """Number of people that the tracker reports over time; `frames` as in `plot_paths`."""
    figure, axes = _figure(11.0, 2.4)
    numbers = np.diff(estimates.bounds(frames.frame_count))
    axes.plot(*_steps(frames, numbers), color="#1f77b4", linewidth=1.2, drawstyle="steps-post")
    axes.set_ylim(0.0, 1.5 + float(numbers.max(initial=0)))
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("reported people")
    _time_axis(axes, _seconds(frames))
    return figure


def plot_identities(truth: Truth, estimates: Estimates, evaluation: Evaluation) -> Figure:
    """Which track each person had when: a bar for each person, in the colour of his track; red where he was missed."""
    people = np.unique(truth.ids)
    figure, axes = _figure(11.0, 1.6 + 0.34 * max(3, len(people)))
    seconds, colours, events = _seconds(truth), _colours(estimates), evaluation.events
    places, ends = _places(truth), _frame_ends(seconds)
    for line, person in enumerate(people):
        chosen = np.flatnonzero((events.truth_rows >= 0) & (truth.ids[events.truth_rows] == person))
        frames, matched = events.frames[chosen], events.matched[chosen]
        tracks = np.where(matched, _ids_of(estimates, events.estimate_rows[chosen]), -1)
        for first, last in _runs(places[frames], tracks, matched):
            start, end = seconds[frames[first]], ends[frames[last]]
            if not matched[first]:
                axes.barh(line, end - start, 0.24, start, color=_MISS, alpha=0.75, linewidth=0)
                continue
            axes.barh(line, end - start, 0.72, start, color=colours[tracks[first]], linewidth=0)
            if end - start > 0.018 * (len(str(tracks[first])) + 1) / 2 * (ends[-1] - seconds[0]):
                middle = (start + end) / 2
                axes.text(middle, line, str(tracks[first]), color="white", ha="center", va="center", fontsize=7)
        switched = frames[events.kinds[chosen] == Event.MISMATCH]
        axes.plot(seconds[switched], np.full(len(switched), line), linestyle="none", **_EVENT_STYLES[Event.MISMATCH])
    axes.set_yticks(range(len(people)))
    axes.set_yticklabels([f"person {person}" for person in people])
    axes.set_ylim(len(people) - 0.4, -0.6)
    _time_axis(axes, seconds)
    missed = Line2D([], [], color=_MISS, alpha=0.75, linewidth=3, label="missed")
    had = Line2D([], [], color=_TRACKS[0], linewidth=7, label="matched, number of the track")
    _legend(axes, [had, missed, _event_handles(evaluation)[1]])
    return figure


def plot_errors(truth: Truth, estimates: Estimates, evaluation: Evaluation) -> Figure:
    """Distance between person and track over time, with misses and mismatches at the upper edge."""
    figure, axes = _figure(11.0, 3.2)
    seconds, events = _seconds(truth), evaluation.events
    matched = np.flatnonzero(events.matched)
    distances, frames = events.distances[matched], events.frames[matched]
    colours = _colours(estimates)
    tracks = _ids_of(estimates, events.estimate_rows[matched])
    axes.scatter(seconds[frames], 100.0 * distances, s=9, c=[colours[t] for t in tracks], linewidths=0, alpha=0.8)
    averages = _frame_averages(distances, frames, truth.frame_count)
    axes.plot(*_broken(_places(truth), seconds, 100.0 * averages), color="black", linewidth=1.1)
    limit = 100.0 * evaluation.threshold_m
    axes.axhline(limit, color="black", linewidth=0.8, linestyle="--")
    for kind, height in ((Event.MISS, 1.05), (Event.MISMATCH, 1.13)):
        at = seconds[np.unique(events.frames[events.kinds == kind])]
        axes.plot(at, np.full(len(at), height * limit), linestyle="none", **_EVENT_STYLES[kind])
    axes.set_ylim(0.0, 1.2 * limit)
    axes.set_ylabel("error [cm]")
    _time_axis(axes, seconds)
    lines = [
        Line2D([], [], linestyle="none", marker=".", color=_TRACKS[0], label="person, colour of the track"),
        Line2D([], [], color="black", linewidth=1.1, label="mean"),
        Line2D([], [], color="black", linewidth=0.8, linestyle="--", label="largest distance of a match"),
    ]
    _legend(axes, [*lines, *_event_handles(evaluation)[:2]])
    return figure


def plot_existence(truth: Truth, estimates: Estimates, evaluation: Evaluation) -> Figure:
    """Existence of each reported track over time, false positives marked."""
    figure, axes = _figure(11.0, 2.8)
    seconds, places, events = _seconds(truth), _places(truth), evaluation.events
    existence = np.full(len(estimates.ids), np.nan) if estimates.existence is None else estimates.existence
    for track, colour in _colours(estimates).items():
        rows = estimates.ids == track
        path = _broken(places[estimates.frames[rows]], seconds[estimates.frames[rows]], existence[rows])
        axes.plot(*path, color=colour, linewidth=1.2, marker=".", markersize=2.5)
    false = events.estimate_rows[events.kinds == Event.FALSE_POSITIVE]
    axes.plot(
        seconds[estimates.frames[false]], existence[false], linestyle="none", **_EVENT_STYLES[Event.FALSE_POSITIVE]
    )
    axes.set_ylim(-0.03, 1.06)
    axes.set_ylabel("existence")
    _time_axis(axes, seconds)
    _legend(axes, [_TRACK_HANDLE, _event_handles(evaluation)[2]])
    return figure


def plot_counts(truth: Truth, evaluation: Evaluation) -> Figure:
    """People, misses (upwards), false positives (downwards) and mismatches in each frame."""
    figure, axes = _figure(11.0, 2.8)
    seconds, events = _seconds(truth), evaluation.events
    people = np.diff(truth.bounds())
    misses = events.per_frame(Event.MISS, truth.frame_count)
    false = events.per_frame(Event.FALSE_POSITIVE, truth.frame_count)
    axes.plot(*_steps(truth, people), color=_TRUTH, linewidth=1.0, drawstyle="steps-post")
    axes.fill_between(*_steps(truth, misses), step="post", color=_MISS, alpha=0.8, linewidth=0)
    axes.fill_between(*_steps(truth, -false), step="post", color=_FALSE, alpha=0.8, linewidth=0)
    switched = seconds[events.frames[events.kinds == Event.MISMATCH]]
    axes.plot(switched, np.zeros(len(switched)), linestyle="none", **_EVENT_STYLES[Event.MISMATCH])
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{abs(value):.0f}"))
    axes.set_ylabel("number")
    _time_axis(axes, seconds)
    lines = [
        Line2D([], [], color=_TRUTH, linewidth=1.0, label="annotated people"),
        Line2D([], [], color=_MISS, linewidth=6, alpha=0.8, label=f"misses ({misses.sum()})"),
        Line2D([], [], color=_FALSE, linewidth=6, alpha=0.8, label=f"false positives, downwards ({false.sum()})"),
    ]
    _legend(axes, [*lines, _event_handles(evaluation)[1]])
    return figure


def plot_nees(truth: Truth, evaluation: Evaluation) -> Figure:
    """NEES of matched positions over time, with the band that 95 % of single pairs keep if covariances are honest."""
    figure, axes = _figure(11.0, 3.2)
    seconds, events = _seconds(truth), evaluation.events
    known = np.isfinite(evaluation.nees)
    nees, frames = evaluation.nees[known], events.frames[known]
    axes.scatter(seconds[frames], np.maximum(nees, _LEAST_NEES), s=8, color=_TRUTH, linewidths=0, alpha=0.7)
    averages = _frame_averages(nees, frames, truth.frame_count)
    axes.plot(*_broken(_places(truth), seconds, averages), color="#1f77b4", linewidth=1.2)
    average = evaluation.scores.position_consistency.average
    handles = [
        Line2D([], [], linestyle="none", marker=".", color=_TRUTH, label="matched person"),
        Line2D([], [], color="#1f77b4", linewidth=1.2, label="mean of the frame"),
    ]
    if average is not None:
        axes.axhline(average, color="black", linewidth=1.0)
        handles.append(Line2D([], [], color="black", linewidth=1.0, label=f"mean of all: {average:.2f}"))
    handles.extend(_draw_band(axes, 2, 1))
    axes.set_ylim(_LEAST_NEES, max(20.0, 2.0 * float(nees.max(initial=0.0))))
    axes.set_ylabel("NEES")
    _time_axis(axes, seconds)
    _legend(axes, handles)
    return figure


class Scene(NamedTuple):
    """What was there at one instant, positions in metres in the tracks' frame.

    Attributes:
        hits: (H, 2) where the scanners' beams ended.
        scanners: (C, 2) where they stood.
        detections: (D, 2) of all cues, with `confidences` (D,).
        tracks: (T, 2), with `existence` (T,), `confirmed` (T,) and `covariances` (T, 2, 2).
    """

    hits: np.ndarray
    scanners: np.ndarray
    detections: np.ndarray
    confidences: np.ndarray
    tracks: np.ndarray
    existence: np.ndarray
    confirmed: np.ndarray
    covariances: np.ndarray


def plot_miss(
    scene: Scene, people: np.ndarray, missed: int, title: str, threshold_m: float, grid: Optional[OccupancyGrid] = None
) -> Figure:
    """One person who was missed, with all that was seen about him.

    Args:
        scene: at that instant.
        people: (P, 2) annotated.
        missed: which of these it is about.
        title: of the picture.
        threshold_m: largest distance of a match, drawn about the person.
        grid: map in the tracks' frame, or None.
    """
    place = people[missed]
    seen = np.vstack([place - _AROUND_M, place + _AROUND_M, scene.scanners])
    figure, axes = _ground(seen.min(axis=0) - 0.3, seen.max(axis=0) + 0.3, grid)
    axes.plot(*scene.hits.T, linestyle="none", marker=".", markersize=2.5, color="#555555", zorder=1)
    axes.plot(*scene.scanners.T, linestyle="none", marker="^", markersize=9, color="black", zorder=2)
    axes.plot(*people.T, linestyle="none", marker="o", markersize=9, markerfacecolor="none", color=_TRUTH, zorder=4)
    axes.plot(*place, linestyle="none", **{**_EVENT_STYLES[Event.MISS], "markersize": 9})
    axes.add_patch(Circle(tuple(place), threshold_m, fill=False, linestyle="--", color=_MISS, linewidth=0.9))
    axes.plot(*scene.detections.T, linestyle="none", marker="+", markersize=8, color=_MISMATCH, zorder=3)
    for point, confidence in zip(scene.detections, scene.confidences):
        _note(axes, point, f"{confidence:.2f}", _MISMATCH, (4, -9))
    for point, existence, covariance, confirmed in zip(
        scene.tracks, scene.existence, scene.covariances, scene.confirmed
    ):
        colour = _CONFIRMED if confirmed else _FALSE
        variances, axes_of = np.linalg.eigh(covariance)
        width, height = 2.0 * np.sqrt(np.maximum(variances, 0.0))
        angle = float(np.degrees(np.arctan2(axes_of[1, 0], axes_of[0, 0])))
        axes.add_patch(Ellipse(tuple(point), width, height, angle=angle, fill=False, color=colour, linewidth=1.2))
        axes.plot(*point, linestyle="none", marker=".", markersize=5, color=colour, zorder=4)
        _note(axes, point, f"{existence:.2f}", colour, (4, 5))
    figure.suptitle(title, fontsize=9)
    styles = (
        ("hits", ".", "#555555"),
        ("scanner", "^", "black"),
        ("annotated", "o", _TRUTH),
        ("missed", "x", _MISS),
        ("detection, confidence", "+", _MISMATCH),
        ("reported track, existence", ".", _CONFIRMED),
        ("other track", ".", _FALSE),
    )
    _legend(axes, [Line2D([], [], linestyle="none", marker=m, color=c, label=name) for name, m, c in styles])
    return figure


def plot_average_nees(seconds: np.ndarray, averages: Mapping[str, np.ndarray], dimension: int, runs: int) -> Figure:
    """NEES over time, averaged over independent runs, of several treatments.

    Args:
        seconds: (K,) instants.
        averages: (K,) by name of the treatment, see `consistency.average_nees`; NaN where unknown.
        dimension: of the errors, their honest mean.
        runs: how many runs were averaged.
    """
    figure, axes = _figure(11.0, 3.6)
    handles = []
    for colour, (name, average) in zip(_TRACKS * (1 + len(averages) // len(_TRACKS)), averages.items()):
        handles.extend(axes.plot(seconds, average, color=colour, linewidth=1.4, label=name))
    handles.extend(_draw_band(axes, dimension, runs))
    axes.set_ylabel(f"NEES, mean of {runs} runs")
    _time_axis(axes, np.asarray(seconds))
    _legend(axes, handles)
    return figure


_EVENT_STYLES: Dict[Event, Dict[str, Any]] = {
    Event.MISS: {"marker": "x", "color": _MISS, "markersize": 4, "markeredgewidth": 1.1, "zorder": 4},
    Event.MISMATCH: {
        "clip_on": False,
        "marker": "D",
        "color": _MISMATCH,
        "markersize": 6,
        "markeredgecolor": "black",
        "markeredgewidth": 0.8,
        "zorder": 6,
    },
    Event.FALSE_POSITIVE: {"marker": "+", "color": _FALSE, "markersize": 7, "markeredgewidth": 1.4, "zorder": 5},
}
_TRACK_HANDLE = Line2D([], [], color=_TRACKS[0], linewidth=1.4, label="track, one colour each")
_EVENT_NAMES = {Event.MISS: "miss", Event.MISMATCH: "mismatch", Event.FALSE_POSITIVE: "false positive"}


def _figure(width: float, height: float) -> Tuple[Figure, Any]:
    """Figure of some inches with one pair of axes."""
    figure = Figure(figsize=(width, height), constrained_layout=True)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.spines["top"].set_visible(False)
    axes.spines["right"].set_visible(False)
    return figure, axes


def _ground(low: np.ndarray, high: np.ndarray, grid: Optional[OccupancyGrid]) -> Tuple[Figure, Any]:
    """Figure of the ground plane between two corners, with the map if there is one."""
    width, height = high - low
    figure, axes = _figure(10.0, 1.0 + 9.0 * float(np.clip(height / width, 0.3, 0.75)))
    if grid is not None:
        _draw_map(axes, grid)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    return figure, axes


def _draw_paths(axes: Any, places: np.ndarray, estimates: Estimates) -> None:
    """Each track's way in its colour."""
    for track, colour in _colours(estimates).items():
        rows = estimates.ids == track
        path = _broken(places[estimates.frames[rows]], *estimates.points[rows].T)
        axes.plot(*path, color=colour, linewidth=1.4, marker=".", markersize=2.5, zorder=3)


def _note(axes: Any, point: np.ndarray, text: str, colour: str, offset: Tuple[int, int]) -> None:
    """A number beside a point, if that is in the picture."""
    axes.annotate(
        text, tuple(point), xytext=offset, textcoords="offset points", color=colour, fontsize=7, annotation_clip=True
    ).set_in_layout(False)


def _legend(axes: Any, handles: Any) -> None:
    """Above the picture, where it hides nothing."""
    axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncol=len(handles),
        frameon=False,
        fontsize=8,
        borderaxespad=0.2,
        columnspacing=1.4,
    )


def _event_handles(evaluation: Evaluation) -> list:
    """Legend of misses, mismatches and false positives, with their numbers."""
    return [
        Line2D([], [], linestyle="none", label=f"{_EVENT_NAMES[kind]} ({evaluation.events.count(kind)})", **style)
        for kind, style in _EVENT_STYLES.items()
    ]


def _draw_map(axes: Any, grid: OccupancyGrid) -> None:
    height, width = grid.occupancy.shape
    kinds = np.where(grid.occupancy < 0, 0, np.where(grid.occupancy < 50, 1, 2))
    x, y = (float(value) for value in grid.origin.translation[:2])
    frame_from_cells = Affine2D().scale(grid.resolution).rotate(float(grid.origin.yaw)).translate(x, y)
    image = axes.imshow(
        kinds, cmap=_MAP_COLOURS, vmin=0, vmax=2, origin="lower", extent=(0, width, 0, height), zorder=0,
        interpolation="nearest",
    )  # fmt: skip
    image.set_transform(frame_from_cells + axes.transData)


def _draw_band(axes: Any, dimension: int, count: int) -> list:
    """NEES's band on a logarithmic axis, and its legend."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if count > 1 else (1.0,)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    low, high = chi_square_band(dimension, count)
    axes.axhspan(low, high, color=_BAND, zorder=0, linewidth=0)
    axes.axhline(dimension, color="#3a7d3a", linewidth=1.0, linestyle="--", zorder=1)
    return [
        Line2D([], [], color=_BAND, linewidth=7, label="95 % band of honest covariance"),
        Line2D([], [], color="#3a7d3a", linewidth=1.0, linestyle="--", label=f"honest mean: {dimension}"),
    ]


def _time_axis(axes: Any, seconds: np.ndarray) -> None:
    if len(seconds):
        axes.set_xlim(seconds[0], _frame_ends(seconds)[-1])
    axes.set_xlabel("time [s]")
    axes.grid(axis="x", color="#e5e5e5", linewidth=0.6)
    axes.set_axisbelow(True)


def _seconds(truth: Truth) -> np.ndarray:
    """(F,) seconds since the first frame."""
    return (truth.stamps_ns - truth.stamps_ns[:1]) / NANOSECONDS


def _period(seconds: np.ndarray) -> float:
    """Median time between frames."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0


def _frame_ends(seconds: np.ndarray) -> np.ndarray:
    """(F,) when the next frame begins; the last, and one before a long gap, lasts as long as most do."""
    usual = _period(seconds)
    ends = np.append(seconds[1:], seconds[-1:] + usual)
    return np.where(ends - seconds > _LONG_GAP * usual, seconds + usual, ends)


def _places(truth: Truth) -> np.ndarray:
    """(F,) numbers of the frames; where the next frame comes after a long gap, a number is left out."""
    seconds = _seconds(truth)
    gaps = np.diff(seconds) > _LONG_GAP * _period(seconds)
    return np.arange(len(seconds)) + np.concatenate([np.zeros(min(1, len(seconds)), dtype=int), np.cumsum(gaps)])


def _steps(truth: Truth, values: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Times and values of a line in steps, each as long as its frame; NaN in long gaps."""
    seconds, places = _seconds(truth), _places(truth)
    ends = np.append(np.flatnonzero(np.diff(places) > 1), np.arange(len(seconds))[-1:]).astype(int)
    stops = np.column_stack([_frame_ends(seconds)[ends], np.full(len(ends), np.nan)])
    levels = np.column_stack([values[ends], np.full(len(ends), np.nan)])
    at = np.repeat(ends + 1, 2)
    return np.insert(seconds, at, stops.ravel()), np.insert(values.astype(float), at, levels.ravel())


def _colours(estimates: Estimates) -> Dict[int, str]:
    """Colour by track, in order of first appearance."""
    tracks, first = np.unique(estimates.ids, return_index=True)
    ordered = tracks[np.argsort(first)]
    return {int(track): _TRACKS[place % len(_TRACKS)] for place, track in enumerate(ordered)}


def _ids_of(estimates: Estimates, rows: np.ndarray) -> np.ndarray:
    """Tracks of rows; whatever for row -1."""
    return np.append(estimates.ids, -1)[rows]


def _broken(places: np.ndarray, *columns: np.ndarray) -> Tuple[np.ndarray, ...]:
    """Columns with a NaN wherever a frame was left out or a long gap is, so that no line is drawn across it."""
    gaps = np.flatnonzero(np.diff(places) > 1) + 1
    return tuple(np.insert(column.astype(float), gaps, np.nan) for column in columns)


def _runs(places: np.ndarray, tracks: np.ndarray, matched: np.ndarray) -> Tuple[Tuple[int, int], ...]:
    """First and last row of each stretch of consecutive frames with one track, or without any."""
    if not len(places):
        return ()
    cuts = np.flatnonzero((np.diff(places) > 1) | (np.diff(tracks) != 0) | (np.diff(matched.astype(int)) != 0))
    return tuple(zip(np.append(0, cuts + 1).tolist(), np.append(cuts, len(places) - 1).tolist()))


def _frame_averages(values: np.ndarray, frames: np.ndarray, frame_count: int) -> np.ndarray:
    """(F,) mean of the values of each frame, NaN where there are none."""
    counts = np.bincount(frames, minlength=frame_count)
    sums = np.bincount(frames, values, minlength=frame_count)
    return np.divide(sums, counts, out=np.full(frame_count, np.nan), where=counts > 0)
