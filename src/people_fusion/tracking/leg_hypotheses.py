"""The multi-hypothesis tracker of legs (Arras et al. 2012, 3.1 to 3.3.2).

A hypothesis labels every track as detected, occluded or deleted and every measurement as of a track, new or a false
alarm. Tracks stand in a table of their own: a track that many hypotheses share is predicted and updated once. All
probabilities are logarithms.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from heapq import merge
from itertools import islice
from typing import Dict, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.association.k_best import announced_assignments, ranked_subsets, with_choices
from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError
from people_fusion.filtering.kalman import predict, update

OBSERVATION = np.eye(2, 4)
NONE = -1  # no measurement: the track is occluded
FREE, APPROVED, BESIDE = range(3)  # no leg of a person; one; free, but within reach of one (beyond the paper)


@dataclass(frozen=True)
class MhtConfig:
    """Table 10 and the pruning of 3.3.2."""

    p_detected: float = parameter(0.3, "that a free track is detected", 1e-9, 1.0)
    p_occluded: float = parameter(0.63, "that a free track is occluded", 1e-9, 1.0)
    p_deleted: float = parameter(0.07, "that a free track is gone", 1e-9, 1.0)
    approved_p_detected: float = parameter(0.2, "that a leg of a person is detected", 1e-9, 1.0)
    approved_p_occluded: float = parameter(0.79, "that a leg of a person is occluded", 1e-9, 1.0)
    approved_p_deleted: float = parameter(0.01, "that a leg of a person is gone", 1e-9, 1.0)
    new_rate: float = parameter(0.001, "new tracks a square metre and scan", 1e-12)
    false_rate: float = parameter(0.003, "false alarms a square metre and scan", 1e-12)
    gate: float = parameter(9.21, "largest squared Mahalanobis distance of a pair; chi-square, 2 dof, 1 %", low=0.0)
    acceleration_std: float = parameter(15.0, "of a leg, which swings and stops at each step, m/s^2", low=0.0)
    initial_speed_std: float = parameter(1.0, "of a new track, m/s", low=0.0)
    max_hypotheses: int = parameter(50, "best children that are kept of all parents together", low=1)
    max_legs: int = parameter(100, "of one scan that are looked at, those that fit a track best", low=1)
    min_ratio: float = parameter(1e-4, "less probable hypotheses than this share of the best are dropped", 0.0, 1.0)
    scan_back: int = parameter(8, "scans after which one branch is decided for", low=1)

    def __post_init__(self) -> None:
        for kind in ("", "approved_"):
            total = sum(getattr(self, f"{kind}p_{label}") for label in ("detected", "occluded", "deleted"))
            if abs(total - 1.0) > 1e-6:
                raise ConfigError(f"{kind}p_detected, {kind}p_occluded, {kind}p_deleted: sum to {total:g}, not 1")


class LegTracks(NamedTuple):
    """Leaves of the track trees, one row each; never altered in place.

    Attributes:
        ids: (T,) a track keeps its identity in all hypotheses.
        means: (T, 4) x y vx vy, metres, m/s.
        covariances: (T, 4, 4).
        born_ns: (T,).
        seen_ns: (T,) last detection.
        rows: (T,) row of the newest scan's leg that it was found to be, or NONE.
    """

    ids: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    born_ns: np.ndarray
    seen_ns: np.ndarray
    rows: np.ndarray

    @staticmethod
    def empty() -> LegTracks:
        """No tracks."""
        none = np.zeros(0, dtype=np.int64)
        return LegTracks(none, np.zeros((0, 4)), np.zeros((0, 4, 4)), none, none, none)

    def take(self, rows: np.ndarray) -> LegTracks:
        """Some of the tracks."""
        return LegTracks(*(column[rows] for column in self))


class Hypothesis(NamedTuple):
    """One leaf of the hypothesis tree.

    Attributes:
        log_p: logarithm of its probability.
        tracks: rows of its tracks.
        ancestors: its forefathers, the oldest first; at most `scan_back` of them, then itself.
    """

    log_p: float
    tracks: Tuple[int, ...]
    ancestors: Tuple[int, ...]


class Forest(NamedTuple):
    """The state of the tracker.

    Attributes:
        tracks: leaves of all hypotheses.
        hypotheses: the best first; probabilities sum to one.
        next_hypothesis: number that the next one gets.
    """

    tracks: LegTracks
    hypotheses: Tuple[Hypothesis, ...]
    next_hypothesis: int

    @staticmethod
    def seed() -> Forest:
        """Nothing is there, for sure."""
        return Forest(LegTracks.empty(), (Hypothesis(0.0, (), ()),), 0)

    def marginals(self) -> np.ndarray:
        """(T,) probability that each track is there."""
        total = np.zeros(len(self.tracks.ids))
        for hypothesis in self.hypotheses:
            total[list(hypothesis.tracks)] += np.exp(hypothesis.log_p)
        return total


class _Costs(NamedTuple):
    """Negative logarithms of the factors of eq. 15 for one scan.

    Attributes:
        missed: (T,) a track is occluded or deleted, whichever is likelier.
        alone: a measurement is new or false, whichever is likelier.
        pairs: (T, M) a measurement is of a track, more than `missed` and `alone`; infinite outside of the gate.
        flips: (T + M,) the other of both labels, more than the likelier one.
        deleted: (T,) whether deleted is the likelier.
    """

    missed: np.ndarray
    alone: float
    pairs: np.ndarray
    flips: List[float]
    deleted: np.ndarray


class _Child(NamedTuple):
    """What becomes of one hypothesis.

    Attributes:
        cost: negative logarithm of the probability, but for a constant.
        parent: place of the hypothesis that it comes from.
        matched: (M,) track of each measurement, or NONE.
        flips: what does not have its likelier label: tracks, and measurements as T and more.
    """

    cost: float
    parent: int
    matched: np.ndarray
    flips: Tuple[int, ...]


def constant_velocity(duration_s: float, acceleration_std: float) -> Tuple[np.ndarray, np.ndarray]:
    """Transition and noise, both (4, 4), of x y vx vy under an acceleration that is constant over the time."""
    transition = np.eye(4)
    transition[0, 2] = transition[1, 3] = duration_s
    spread = np.vstack([0.5 * duration_s**2 * np.eye(2), duration_s * np.eye(2)])
    return transition, acceleration_std**2 * spread @ spread.T


class MultiHypothesisTracker:
    """Grows and prunes a Forest; holds nothing that changes but counters.

    Args:
        config: see MhtConfig.
    """

    def __init__(self, config: MhtConfig) -> None:
        self.config = config
        self.counts: Counter = Counter()
        free = [config.p_detected, config.p_occluded, config.p_deleted]
        approved = [config.approved_p_detected, config.approved_p_occluded, config.approved_p_deleted]
        beside = [config.approved_p_detected, 1.0 - config.approved_p_detected - config.p_deleted, config.p_deleted]
        self._log = np.log(np.maximum([free, approved, beside], 1e-9))
        self._log_new, self._log_false = float(np.log(config.new_rate)), float(np.log(config.false_rate))
        self._span = -float(np.log(config.min_ratio)) if config.min_ratio else np.inf

    def predict(self, forest: Forest, duration_s: float) -> Forest:
        """All tracks by constant velocity (3.1)."""
        tracks = forest.tracks
        if duration_s <= 0.0 or not len(tracks.ids):
            return forest
        transition, noise = constant_velocity(duration_s, self.config.acceleration_std)
        means, covariances = predict(tracks.means, tracks.covariances, transition, noise)
        return forest._replace(tracks=tracks._replace(means=means, covariances=covariances))

    def grow(
        self,
        forest: Forest,
        stamp_ns: int,
        positions: np.ndarray,
        covariances: np.ndarray,
        identities: np.ndarray,
        kinds: np.ndarray,
    ) -> Forest:
        """The best children of all hypotheses by eq. 15, pruned.

        Args:
            forest: predicted to the stamp.
            stamp_ns: of the scan.
            positions: (M, 2) legs, and their (M, 2, 2) covariances.
            covariances: see positions.
            identities: (M,) that tracks which begin with these measurements get.
            kinds: (T,) FREE, APPROVED or BESIDE.
        """
        tracks = forest.tracks
        labels = self._log[kinds]  # detected, occluded, deleted
        innovations = positions[None] - tracks.means[:, None, :2]
        spreads = tracks.covariances[:, None, :2, :2] + covariances[None]
        log_pair = _log_densities(innovations, spreads, self.config.gate) + labels[:, :1]
        taken = self._taken(log_pair)
        costs = self._costs(log_pair[:, taken], labels)
        children = self._children(forest, costs)
        keys, members = self._members(forest, children, costs)
        leaves = self._tracks(tracks, keys, stamp_ns, positions[taken], covariances[taken], identities[taken])
        leaves = leaves._replace(rows=np.append(taken, NONE)[leaves.rows])
        number = forest.next_hypothesis
        hypotheses = []
        for child, rows in zip(children, members):
            ancestors = (*forest.hypotheses[child.parent].ancestors, number)[-self.config.scan_back - 1 :]
            hypotheses.append(Hypothesis(-child.cost, tuple(rows.tolist()), ancestors))
            number += 1
        return self._pruned(Forest(leaves, tuple(hypotheses), number))

    def _taken(self, log_pair: np.ndarray) -> np.ndarray:
        """Which measurements are looked at: where there are too many, those that fit a track best."""
        count = log_pair.shape[1]
        if count <= self.config.max_legs:
            return np.arange(count)
        self.counts["legs shed: too many"] += count - self.config.max_legs
        fit = log_pair.max(axis=0, initial=-np.inf)
        return np.sort(np.argsort(-fit, kind="stable")[: self.config.max_legs])

    def _costs(self, log_pair: np.ndarray, labels: np.ndarray) -> _Costs:
        missed, alone = -labels[:, 1:].max(axis=1), -max(self._log_new, self._log_false)
        flips = np.abs(labels[:, 1] - labels[:, 2]).tolist()
        flips += [abs(self._log_new - self._log_false)] * log_pair.shape[1]
        return _Costs(missed, alone, -log_pair - missed[:, None] - alone, flips, labels[:, 2] > labels[:, 1])

    def _children(self, forest: Forest, costs: _Costs) -> List[_Child]:
        """The best over all parents, the best first; those that are too improbable beside it are never made (3.3.2)."""
        families = [self._family(place, parent, costs) for place, parent in enumerate(forest.hypotheses)]
        best: List[_Child] = []
        for cost, _, child in merge(*families):
            if best and cost > best[0].cost + self._span:
                break
            if child is None:
                continue
            if len(best) == self.config.max_hypotheses:
                self.counts["hypotheses shed: too many"] += 1
                break
            best.append(child)
        return best

    def _family(
        self, place: int, parent: Hypothesis, costs: _Costs
    ) -> Iterator[Tuple[float, Tuple[int, int], Optional[_Child]]]:
        """Children of one hypothesis in order of cost; None announces that nothing cheaper follows.

        Which measurement is of which track is an assignment. What is left to choose is independent of it: an
        unassigned track is occluded or deleted, an unassigned measurement new or false. The likelier of both is part
        of every assignment's cost, the other a flip.
        """
        rows = np.array(parent.tracks, dtype=int)
        pairs = costs.pairs[rows]
        count = pairs.shape[1]
        base = float(costs.missed[rows].sum()) + count * costs.alone - parent.log_p
        # Each measurement by itself: most parents need not be solved.
        yield base + float(pairs.min(axis=0, initial=0.0).sum()), (place, -1), None
        gated = np.isfinite(pairs)
        near, inside = gated.any(axis=1).nonzero()[0], gated.any(axis=0).nonzero()[0]
        track_of = np.full(len(near) + len(inside), NONE)
        track_of[: len(near)] = rows[near]
        matrix = np.full((len(inside), len(track_of)), np.inf)
        matrix[:, : len(near)] = pairs[near[:, None], inside].T
        matrix[np.arange(len(inside)), len(near) + np.arange(len(inside))] = 0.0

        def matches() -> Iterator[Tuple[float, Optional[np.ndarray]]]:
            for cost, columns in announced_assignments(matrix):
                matched = None
                if columns is not None:
                    matched = np.full(count, NONE)
                    matched[inside] = track_of[columns]
                yield base + cost, matched

        def choices(matched: np.ndarray) -> Iterator[Tuple[float, Tuple[int, ...]]]:
            yield 0.0, ()
            taken = set(matched.tolist())
            left = [track for track in parent.tracks if track not in taken]
            left += [len(costs.pairs) + row for row, track in enumerate(matched.tolist()) if track == NONE]
            for extra, chosen in islice(ranked_subsets([costs.flips[item] for item in left]), 1, None):
                yield extra, tuple(left[place] for place in chosen)

        ordered = with_choices(matches(), choices)
        for turn, (cost, matched, flips) in enumerate(ordered):
            child = None if matched is None or flips is None else _Child(cost, place, matched, flips)
            yield cost, (place, turn), child

    def _members(
        self, forest: Forest, children: List[_Child], costs: _Costs
    ) -> Tuple[np.ndarray, List[np.ndarray]]:
        """Each (track or NONE, measurement or NONE) that a child consists of, once; and the rows of each child's."""
        count, measurements = costs.pairs.shape
        there = np.zeros((len(children), count + measurements), dtype=bool)  # tracks, then those that begin
        for row, child in zip(there, children):
            row[list(forest.hypotheses[child.parent].tracks)] = True
        there[:, :count] &= ~costs.deleted
        there[:, count:] = self._log_new > self._log_false
        flipped = [(place, item) for place, child in enumerate(children) for item in child.flips]
        place, item = np.array(flipped, dtype=int).reshape(-1, 2).T
        there[place, item] ^= True
        matched = np.stack([child.matched for child in children])
        place, measurement = np.nonzero(matched != NONE)
        track = matched[place, measurement]
        there[place, track], there[place, count + measurement] = True, False
        seen = np.full(there.shape, NONE)
        seen[:, count:] = np.arange(measurements)
        seen[place, track] = measurement
        place, column = np.nonzero(there)
        codes, rows = np.unique(column * (measurements + 1) + seen[there] - NONE, return_inverse=True)
        column, measurement = np.divmod(codes, measurements + 1)
        keys = np.column_stack([np.where(column < count, column, NONE), measurement + NONE])
        return keys, np.split(rows, np.cumsum(there.sum(axis=1))[:-1])

    def _tracks(
        self,
        old: LegTracks,
        keys: np.ndarray,
        stamp_ns: int,
        positions: np.ndarray,
        covariances: np.ndarray,
        identities: np.ndarray,
    ) -> LegTracks:
        """A row for each (track, measurement): updated, left as it is, or new."""
        track, measurement = keys.T
        is_new, is_seen = track == NONE, measurement != NONE
        count = len(keys)
        means, spreads = np.zeros((count, 4)), np.zeros((count, 4, 4))
        ids, born, seen = (np.zeros(count, dtype=np.int64) for _ in range(3))
        kept = ~is_new
        ids[kept], born[kept], seen[kept] = old.ids[track[kept]], old.born_ns[track[kept]], old.seen_ns[track[kept]]
        means[kept], spreads[kept] = old.means[track[kept]], old.covariances[track[kept]]
        matched = kept & is_seen
        if matched.any():
            noise = covariances[measurement[matched]]
            innovation = positions[measurement[matched]] - means[matched, :2]
            means[matched], spreads[matched] = update(
                means[matched], spreads[matched], innovation, OBSERVATION, spreads[matched, :2, :2] + noise
            )
        if is_new.any():
            ids[is_new], born[is_new] = identities[measurement[is_new]], stamp_ns
            means[is_new, :2] = positions[measurement[is_new]]
            spreads[is_new, :2, :2] = covariances[measurement[is_new]]
            spreads[is_new, 2, 2] = spreads[is_new, 3, 3] = self.config.initial_speed_std**2
        seen[is_seen] = stamp_ns
        return LegTracks(ids, means, spreads, born, seen, measurement)

    def _pruned(self, forest: Forest) -> Forest:
        """All but one old branch is dropped, then what no hypothesis holds (3.3.2)."""
        kept, best = list(forest.hypotheses), forest.hypotheses[0].log_p
        if len(kept[0].ancestors) > self.config.scan_back:
            masses: Dict[int, float] = {}
            for entry in kept:
                masses[entry.ancestors[0]] = masses.get(entry.ancestors[0], 0.0) + float(np.exp(entry.log_p - best))
            root = max(masses, key=lambda name: (masses[name], -name))
            kept = [entry for entry in kept if entry.ancestors[0] == root]
        total = np.logaddexp.reduce([entry.log_p for entry in kept])
        used = sorted({row for entry in kept for row in entry.tracks})
        place = {row: index for index, row in enumerate(used)}
        kept = [
            Hypothesis(float(entry.log_p - total), tuple(place[row] for row in entry.tracks), entry.ancestors)
            for entry in kept
        ]
        return Forest(forest.tracks.take(np.array(used, dtype=int)), tuple(kept), forest.next_hypothesis)


def _log_densities(innovations: np.ndarray, covariances: np.ndarray, gate: float) -> np.ndarray:
    """(T, M) log N(z; z', S), minus infinity outside of the gate."""
    a, b, c = covariances[..., 0, 0], covariances[..., 0, 1], covariances[..., 1, 1]
    determinants = a * c - b * b
    x, y = innovations[..., 0], innovations[..., 1]
    distances = (c * x * x - 2.0 * b * x * y + a * y * y) / determinants
    found: np.ndarray = -0.5 * (distances + np.log((2.0 * np.pi) ** 2 * determinants))
    return np.where(distances <= gate, found, -np.inf)
