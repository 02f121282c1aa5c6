"""CLEAR-MOT in the ground plane (Bernardin and Stiefelhagen 2008; Poschmann 2018, 7.5.2), or in an image (Volkhardt et
al. 2013, IV, eq. 8).

A mismatch is Bernardin's: a person is matched with another track than at his last match, however long ago. It happens
in two ways. The track had another person before (two people swap tracks: two mismatches), or the person was lost and
found again with a new track. A track that moves on to a person who never had one violates no match of that person; it
is counted as a transfer beside MOTA, and the person who lost it is a miss, and a mismatch once he is found again.
py-motmetrics counts the same (`num_switches`, `num_transfer`). TrackEval counts mismatches alike, but keeps a match
over one frame only, so that it may pick another pair after a gap.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Dict, List, Optional, Tuple, Union

import numpy as np
from scipy.optimize import linear_sum_assignment

from people_fusion.evaluation.distances import Distance, on_the_floor
from people_fusion.evaluation.truth import Estimates, Truth

THRESHOLD_M = 0.5  # Poschmann 7.5.2


class Event(enum.IntEnum):
    """What became of a person or a track in a frame."""

    MATCH = 0
    MISMATCH = 1  # matched too, but not with the person's last track
    MISS = 2
    FALSE_POSITIVE = 3
    IGNORED = 4  # an unmatched track where not everybody is annotated


@dataclass(frozen=True, eq=False)
class Events:
    """Everything that happened, in order of frames; each person and each track of a frame stands in one row.

    Attributes:
        frames: (E,) frame.
        kinds: (E,) `Event`.
        truth_rows: (E,) row in `Truth`, -1 if no person is involved.
        estimate_rows: (E,) row in `Estimates`, -1 if no track is involved.
        distances: (E,) between person and track, metres or one minus overlap, NaN if either is missing.
        transferred: (E,) bool, the match is new and the track's last new match was with another person.
    """

    frames: np.ndarray
    kinds: np.ndarray
    truth_rows: np.ndarray
    estimate_rows: np.ndarray
    distances: np.ndarray
    transferred: np.ndarray

    def __len__(self) -> int:
        return len(self.kinds)

    @property
    def matched(self) -> np.ndarray:
        """(E,) bool: matches, with and without mismatch."""
        return self.kinds <= Event.MISMATCH

    def count(self, kind: Event) -> int:
        """How many events are of a kind."""
        return int(np.sum(self.kinds == kind))

    def per_frame(self, kind: Event, frame_count: int) -> np.ndarray:
        """(F,) events of a kind in each frame."""
        return np.bincount(self.frames[self.kinds == kind], minlength=frame_count)


@dataclass(frozen=True)
class ClearMot:
    """Counts of one run, or of several added; a rate is None where its denominator is zero.

    Attributes:
        frames: annotated frames.
        ground_truth_count: annotations.
        matches: matched annotations, those with a mismatch included.
        misses: annotations without a track.
        false_positives: tracks without an annotation, summed over frames.
        mismatches: matches with another track than the person had before.
        takeovers: those mismatches whose track had another person before; the rest are people found again.
        transfers: new matches of a track that had another person before, mismatch or not.
        distance_sum: over all matches, metres; in an image of one minus overlap.
        only_annotated: False positives were not counted, because people are about who are not annotated.
        in_image: matched by the overlap of boxes.
    """

    frames: int = 0
    ground_truth_count: int = 0
    matches: int = 0
    misses: int = 0
    false_positives: int = 0
    mismatches: int = 0
    takeovers: int = 0
    transfers: int = 0
    distance_sum: float = 0.0
    only_annotated: bool = False
    in_image: bool = False

    @staticmethod
    def of(
        events: Events, frame_count: int, only_annotated: bool = False, in_image: bool = False
    ) -> ClearMot:
        """Counts of one run's events."""
        matched = events.matched
        mismatched = events.kinds == Event.MISMATCH
        misses = events.count(Event.MISS)
        return ClearMot(
            frames=frame_count,
            ground_truth_count=int(matched.sum()) + misses,
            matches=int(matched.sum()),
            misses=misses,
            false_positives=events.count(Event.FALSE_POSITIVE),
            mismatches=int(mismatched.sum()),
            takeovers=int(np.sum(mismatched & events.transferred)),
            transfers=int(events.transferred.sum()),
            distance_sum=float(events.distances[matched].sum()),
            only_annotated=only_annotated,
            in_image=in_image,
        )

    def __add__(self, other: ClearMot) -> ClearMot:
        """Counts of both, as Poschmann adds five runs."""
        return ClearMot(
            self.frames + other.frames,
            self.ground_truth_count + other.ground_truth_count,
            self.matches + other.matches,
            self.misses + other.misses,
            self.false_positives + other.false_positives,
            self.mismatches + other.mismatches,
            self.takeovers + other.takeovers,
            self.transfers + other.transfers,
            self.distance_sum + other.distance_sum,
            self.only_annotated or other.only_annotated,
            self.in_image or other.in_image,
        )

    @property
    def mota(self) -> Optional[float]:
        """Multiple object tracking accuracy, Poschmann eq. 7.8; 1 is perfect, may be negative."""
        errors = ratio(self.misses + self.false_positives + self.mismatches, self.ground_truth_count)
        return None if errors is None else 1.0 - errors

    @property
    def motp_m(self) -> Optional[float]:
        """Multiple object tracking precision, Poschmann eq. 7.9: mean distance of matches, metres; None in an image."""
        return None if self.in_image else ratio(self.distance_sum, self.matches)

    @property
    def motp_image(self) -> Optional[float]:
        """The same in an image (Volkhardt et al. 2013, IV): 0 is perfect, 1 is no overlap; None on the floor."""
        return ratio(self.distance_sum, self.matches) if self.in_image else None

    @property
    def miss_rate(self) -> Optional[float]:
        return ratio(self.misses, self.ground_truth_count)

    @property
    def false_positive_rate(self) -> Optional[float]:
        """False positives over annotations; 0 where they are not counted (`only_annotated`)."""
        return ratio(self.false_positives, self.ground_truth_count)

    @property
    def mismatch_rate(self) -> Optional[float]:
        return ratio(self.mismatches, self.ground_truth_count)

    @property
    def recall(self) -> Optional[float]:
        """Matches over annotations."""
        return ratio(self.matches, self.ground_truth_count)

    @property
    def precision(self) -> Optional[float]:
        """Matches over reported people; None where false positives are not counted (`only_annotated`)."""
        return None if self.only_annotated else ratio(self.matches, self.matches + self.false_positives)


def ratio(numerator: float, denominator: float) -> Optional[float]:
    """Quotient, or None if the denominator is zero."""
    return numerator / denominator if denominator else None


def match(
    truth: Truth,
    estimates: Estimates,
    threshold: float = THRESHOLD_M,
    only_annotated: bool = False,
    distance: Optional[Distance] = None,
) -> Events:
    """Assign people and tracks frame by frame, one to one.

    A person keeps the track of his last match while both are within the threshold, even if another track is nearer. If
    two people last had the same track, the one who had it later keeps it. The others are assigned by the global
    nearest neighbour: as many pairs within the threshold as possible, of these the least sum of distances.

    Args:
        truth: annotated people.
        estimates: tracker output at the same frames.
        threshold: a pair farther apart is never matched.
        only_annotated: not everybody is annotated, so that an unmatched track is ignored instead of false.
        distance: of rows of truth and estimates; None: metres on the floor.

    Raises:
        DataError: if an estimate belongs to no frame of the truth.
    """
    truth_bounds, estimate_bounds = truth.bounds().tolist(), estimates.bounds(truth.frame_count).tolist()
    person_ids, track_ids = truth.ids.tolist(), estimates.ids.tolist()
    distance = distance or on_the_floor(truth, estimates)
    last_match: Dict[int, Tuple[int, int]] = {}  # person: (frame, track), M_t of Bernardin and Stiefelhagen
    last_person: Dict[int, int] = {}  # by track, at its last new match
    unmatched = Event.IGNORED if only_annotated else Event.FALSE_POSITIVE
    rows: List[Tuple[int, int, int, int, float, bool]] = []
    for frame in range(truth.frame_count):
        people = range(truth_bounds[frame], truth_bounds[frame + 1])
        tracks = range(estimate_bounds[frame], estimate_bounds[frame + 1])
        distances = distance(np.array(people, dtype=int)[:, None], np.array(tracks, dtype=int))
        persons = [person_ids[row] for row in people]
        columns = {track_ids[row]: column for column, row in enumerate(tracks)}
        kept = _kept(persons, columns, distances, last_match, threshold)
        pairs = {**kept, **_nearest(distances, kept, threshold)}
        for i, person in enumerate(persons):
            if i not in pairs:
                rows.append((frame, Event.MISS, people[i], -1, np.nan, False))
                continue
            row = tracks[pairs[i]]
            track = track_ids[row]
            mismatch = person in last_match and last_match[person][1] != track
            transferred = i not in kept and last_person.get(track, person) != person
            kind = Event.MISMATCH if mismatch else Event.MATCH
            rows.append((frame, kind, people[i], row, float(distances[i, pairs[i]]), transferred))
            last_match[person] = (frame, track)
            if i not in kept:
                last_person[track] = person
        taken = set(pairs.values())
        rows.extend((frame, unmatched, -1, row, np.nan, False) for j, row in enumerate(tracks) if j not in taken)
    return _events(rows)


def _kept(
    persons: List[int],
    columns: Dict[int, int],
    distances: np.ndarray,
    last_match: Dict[int, Tuple[int, int]],
    threshold: float,
) -> Dict[int, int]:
    """Track's column by person's row, for matches that are still valid; the latest holder of a track first."""
    valid = []
    for i, person in enumerate(persons):
        frame, track = last_match.get(person, (-1, None))
        column = columns.get(track) if track is not None else None
        if column is not None and distances[i, column] <= threshold:
            valid.append((frame, i, column))
    holders = {column: i for _, i, column in sorted(valid)}
    return {i: column for column, i in holders.items()}


def _nearest(distances: np.ndarray, pairs: Dict[int, int], threshold: float) -> Dict[int, int]:
    """Global nearest neighbour over the rows and columns that are not paired yet."""
    open_rows = [i for i in range(distances.shape[0]) if i not in pairs]
    taken = set(pairs.values())
    open_columns = [j for j in range(distances.shape[1]) if j not in taken]
    if not open_rows or not open_columns:
        return {}
    costs = distances[np.ix_(open_rows, open_columns)]
    within = costs <= threshold
    if not within.any():
        return {}
    # One forbidden pair costs more than all allowed ones together: first the number of matches, then the distance.
    forbidden = 2.0 * threshold * (min(costs.shape) + 1)
    chosen = zip(*linear_sum_assignment(np.where(within, costs, forbidden)))
    return {open_rows[i]: open_columns[j] for i, j in chosen if within[i, j]}


def _events(rows: List[Tuple[int, int, int, int, float, bool]]) -> Events:
    columns: List[Union[Tuple[int, ...], Tuple[float, ...], Tuple[bool, ...]]] = list(zip(*rows)) or [()] * 6
    kinds = (np.int64, np.int64, np.int64, np.int64, np.float64, np.bool_)
    return Events(*(np.array(column, dtype=kind) for column, kind in zip(columns, kinds)))
