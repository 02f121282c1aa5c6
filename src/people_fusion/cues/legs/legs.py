"""People by their legs in a laser scan (Poschmann 2018, 3.1.1; the cue called L1 there)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np
from scipy.special import expit, logit

from people_fusion.core.angles import bearings
from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, TransformUnavailable
from people_fusion.core.grids import OCCUPIED_THRESHOLD, ROUND_OFF, OccupancyGrid
from people_fusion.core.measurements import PERSON_DEPTH_M, XY_OBSERVED, Measurement, Sight
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.cues.legs import beams, clusters, map_fit, shapes
from people_fusion.cues.legs.classifier import LegModel, load_leg_model
from people_fusion.cues.legs.features import MIN_POINTS
from people_fusion.cues.legs.segments import Segments, segment
from people_fusion.cues.periods import Periods

UNKNOWN_PERIOD_S = 0.1
LEG_WIDTH = 0.1  # metres, for the distance at which beams are too far apart to tell a leg
DISCERNIBLE_POINTS = 6  # in fewer, two legs may have no dent between
LEAST_BELIEF = 0.02  # and most: no rule is so sure that the look of a leg could not change its mind
TINY = 1e-6  # metres, against a division by zero
ARC_DEPTH = math.pi / 4.0  # mean depth of a half circle seen from afar, in radii


@dataclass(frozen=True)
class LegCueConfig:
    """The leg cue; the defaults are the paper's, what goes beyond it is off."""

    deskew: bool = parameter(True, "project each beam with the pose of its own instant where `time_increment` is given")
    deskew_lag_s: float = parameter(
        0.04, "motion during the sweep is that of so long before, so that no scan waits for odometry, seconds", 0.0, 1.0
    )
    map_fit: bool = parameter(False, "correct the pose by what is seen of the map before telling what the map explains")
    map_dilation: float = parameter(0.2, "what is this close to an obstacle of the map is background, metres", 0.0, 2.0)
    map_doubt: float = parameter(0.0, "legs this close to an obstacle of the map may be part of it, metres", 0.0, 2.0)
    map_doubt_per_metre: float = parameter(
        0.0, "so much more for each metre from the scanner, where an error of the robot's heading weighs", 0.0, 1.0
    )
    map_doubt_stds: float = parameter(
        0.0, "so many standard deviations of the pose more, as far as the localisation tells its covariance", 0.0, 10.0
    )
    doubtful_confidence: float = parameter(0.0, "that legs that may be part of the map are a person", 0.0, 1.0)
    map_occupied: int = parameter(OCCUPIED_THRESHOLD, "occupancy from which a cell of the map is an obstacle", 1, 100)
    segment_gap: float = parameter(0.05, "points this close belong to one segment, metres", 0.001, 1.0)
    segment_gap_beams: float = parameter(
        0.0, "successive points also belong to one segment if this many beam spacings apart; 0: off", 0.0, 10.0
    )
    min_segment_points: int = parameter(2, "segments with fewer points are noise", 1, 100)
    max_segment_width: float = parameter(
        math.inf, "wider segments are walls and furniture, metres; needed where no map explains them; .inf: off", 0.1
    )
    min_segment_step: float = parameter(
        0.0, "a segment whose neighbours are not this much farther or nearer is of a wall, metres; 0: off", 0.0, 2.0
    )
    group_gap: float = parameter(0.6, "points this close belong to one group of people, metres", 0.05, 5.0)
    leg_diameter: float = parameter(0.25, "largest extent of one leg, metres", 0.02, 1.0)
    min_leg_points: int = parameter(1, "legs with fewer points are left out", 1, 100)
    min_leg_width: float = parameter(
        0.0, "what is certainly thinner, as the beams beside it passed, is a chair's leg, metres; 0: off", 0.0, 0.2
    )
    max_leg_width: float = parameter(
        math.inf,
        "a segment wider than this without a dent between two legs is one piece: a bin, a coat; metres; .inf: off",
        0.05,
    )
    leg_dent: float = parameter(0.04, "depth of such a dent, metres", 0.0, 0.2)
    one_piece_confidence: float = parameter(0.3, "that one wide piece is a person", 0.0, 1.0)
    pair_distance: float = parameter(0.7, "legs at most this far apart may be one person's, metres", 0.0, 2.0)
    leg_radius: float = parameter(
        0.0, "the scanner sees the near side of a leg: legs are moved away from it by pi/4 of this, metres", 0.0, 0.2
    )
    max_range: float = parameter(100.0, "what is farther away is ignored, metres", 0.1, 1000.0)
    pair_std: float = parameter(0.08, "std of a person's position from two legs, by axis, metres", 0.001, 2.0)
    single_along_std: float = parameter(
        0.15, "std from a single leg along the beam, where the other leg may hide, metres", 0.001, 2.0
    )
    single_across_std: float = parameter(0.12, "std from a single leg across the beam, metres", 0.001, 2.0)
    crowd_factor: float = parameter(
        2.0, "on the stds where a group holds several people, as the pairs may be wrong", 1.0, 10.0
    )
    pair_confidence: float = parameter(1.0, "that two legs are a person", 0.0, 1.0)
    single_confidence: float = parameter(1.0, "that a single leg is a person; the paper makes no difference", 0.0, 1.0)
    model: str = parameter("", "what legs look like: a model in config/models, or a JSON file; empty: no vote on that")
    mapped_belief: float = parameter(0.9, "most that is believed before that vote where the map is silent", 0.0, 1.0)
    unmapped_belief: float = parameter(0.7, "... and where there is no map that could", 0.0, 1.0)
    classified_above: float = parameter(
        0.0,
        "the model alone finds legs: segments that it gives this probability or more; 0: the rules do, the model votes",
        0.0,
        1.0,
    )

    def __post_init__(self) -> None:
        if self.leg_diameter > self.group_gap:
            raise ConfigError(
                f"leg_diameter: {self.leg_diameter} is larger than group_gap, {self.group_gap}: a leg would span groups"
            )
        if self.classified_above and not self.model:
            raise ConfigError("classified_above: needs a model that classifies")


class _Legs(NamedTuple):
    """Points (P, 2) that are of legs with their leg (P,); the legs (L,), whether an obstacle of the map may be what was
    seen of them and whether they are one wide piece; the points' beams (P,)."""

    points: np.ndarray
    labels: np.ndarray
    centres: np.ndarray
    groups: np.ndarray
    doubtful: np.ndarray
    one_piece: np.ndarray
    beams: np.ndarray


def _looks(model: LegModel, scan: Scan, ranges: np.ndarray) -> Tuple[Segments, np.ndarray]:
    """The model's segments S of a scan, and its evidence (S,) that each is a leg."""
    valid = np.where(beams.hits(ranges, scan.range_min, scan.range_max), ranges, np.nan)
    segments = segment(scan, valid, model.jump, model.jump_beams)
    return segments, model.evidence(segments)


@CUES.register("legs", LegCueConfig)
class LegCue(Cue):
    """Background subtraction, segments, groups, legs, pairs of legs, people."""

    takes: type = Scan
    modality = "legs"

    def __init__(self, config: LegCueConfig, name: str, frames: FramesConfig) -> None:
        self.config, self.name, self.frames = config, name, frames
        self._grid: Optional[OccupancyGrid] = None
        self._localisation = np.zeros((6, 6))
        self._directions = beams.Directions()
        self._model = load_leg_model(config.model) if config.model else None
        self._sequence = 0
        self._periods = Periods()

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        self._grid = grid
        if grid is not None:
            grid.distances(self.config.map_occupied)  # now, not in the first scan

    def set_localisation(self, covariance: np.ndarray) -> None:
        self._localisation = covariance

    def reset(self) -> None:
        self._periods.reset()

    def transforms_needed(self, data: Scan) -> Tuple[TransformRequest, ...]:
        beams.check(data)
        needed = []
        if self._grid is not None:
            needed.append(TransformRequest(self._grid.frame_id, data.frame_id, data.stamp_ns))
        newest = self._newest_motion(data)
        return (*needed, newest) if newest else tuple(needed)

    def measure(self, data: Scan, transforms: Optional[TransformSource]) -> Measurement:
        ranges = beams.check(data)
        points, hits, background, doubtful = self._points(data, ranges, transforms)
        if self._model is not None and self.config.classified_above:
            legs = self._classified(self._model, points, hits, doubtful, data, ranges)
        else:
            legs = self._legs(points, hits, doubtful, data, ranges)
        owners = self._owners(legs)
        positions, covariances, paired = self._people(legs, owners, abs(data.angle_increment))
        period_s = self._period_s(data)
        self._sequence += 1
        return Measurement(
            stamp_ns=data.stamp_ns,
            cue=self.name,
            modality=self.modality,
            frame_id=data.frame_id,
            positions=positions,
            covariances=covariances,
            confidences=self._vote(self._confidences(legs, owners, paired), legs, owners, data, ranges),
            observed=XY_OBSERVED,
            period_s=period_s,
            sequence=self._sequence,
            sight=self._sight(data, ranges, background),
            points=legs.points,
            point_labels=legs.labels,
            legs=legs.centres,
            leg_owners=owners,
        )

    def _newest_motion(self, scan: Scan) -> Optional[TransformRequest]:
        """The newest pose that tells how the scanner moves during the sweep; None where that counts for nothing."""
        duration_ns = beams.duration_ns(scan)
        if not (self.config.deskew and duration_ns):
            return None
        newest_ns = scan.stamp_ns + max(duration_ns - from_seconds(self.config.deskew_lag_s), 0)
        return TransformRequest(self.frames.odom or self.frames.world, scan.frame_id, newest_ns)

    def _straightened(
        self, points: np.ndarray, fractions: np.ndarray, scan: Scan, transforms: TransformSource
    ) -> np.ndarray:
        """Points (N, 2) where they would have been seen at the scan's stamp; fractions (N,) of the sweep."""
        newest = self._newest_motion(scan)
        if newest is None:
            return points
        last = transforms.lookup(*newest)
        try:
            first = transforms.lookup(*newest._replace(stamp_ns=newest.stamp_ns - beams.duration_ns(scan)))
        except TransformUnavailable as unavailable:
            if unavailable.may_arrive:
                raise
            return points  # nothing is known of the motion before a recording's first transform
        return beams.straighten(points, fractions, first, last)

    def _points(
        self, scan: Scan, ranges: np.ndarray, transforms: Optional[TransformSource]
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points (N, 2) of the scanner's frame that no map explains, the indices (N,) of their beams, those of the
        beams that the map explains, and which points (N,) an obstacle of the map might be."""
        hits = np.flatnonzero(beams.hits(ranges, scan.range_min, min(scan.range_max, self.config.max_range)))
        points = ranges[hits, None] * self._directions.of(scan)[hits]
        background = np.zeros(0, dtype=int)
        doubtful = np.zeros(len(points), dtype=bool)
        if transforms is None:
            return points, hits, background, doubtful
        points = self._straightened(points, hits / max(len(ranges) - 1, 1), scan, transforms)
        if self._grid is not None:
            map_from_sensor = transforms.lookup(self._grid.frame_id, scan.frame_id, scan.stamp_ns)
            points_map = map_from_sensor.apply(np.column_stack([points, np.zeros(len(points))]))[:, :2]
            origin, covariance = map_from_sensor.translation[:2], map_fit.planar(self._localisation)
            if self.config.map_fit:
                points_map, covariance = map_fit.corrected(
                    points_map, origin, self._localisation, self._grid, self.config.map_occupied
                )
            clearances = self._grid.clearances(points_map, self.config.map_occupied)
            doubtful = clearances <= self._doubt(points_map - origin, covariance)
            explained = clearances <= self.config.map_dilation + ROUND_OFF
            background = hits[explained]
            points, hits, doubtful = points[~explained], hits[~explained], doubtful[~explained]
        return points, hits, background, doubtful

    def _legs(
        self, points: np.ndarray, hits: np.ndarray, doubtful: np.ndarray, scan: Scan, ranges: np.ndarray
    ) -> _Legs:
        config = self.config
        seam = 0
        if beams.is_ring(scan) and len(points):
            # Begin where nothing lies across the seam.
            seam = beams.largest_jump(np.where(beams.hits(ranges, scan.range_min, scan.range_max), ranges, np.inf))
            hits, ranges = (hits - seam) % len(ranges), np.roll(ranges, -seam)
            order = np.argsort(hits)
            points, hits, doubtful = points[order], hits[order], doubtful[order]
        kept, whole = self._segments(points, hits, scan, ranges)
        points, hits, doubtful, whole = points[kept], hits[kept], doubtful[kept], whole[kept]
        groups = clusters.single_linkage(points, config.group_gap)
        legs = clusters.complete_linkage(points, config.leg_diameter)
        one_piece = whole >= 0
        if one_piece.any():
            legs = clusters.relabel(np.where(one_piece, legs.max() + 1 + whole, legs))
        good = np.bincount(legs) >= config.min_leg_points
        if config.min_leg_width:
            found = np.where(beams.hits(ranges, scan.range_min, scan.range_max), ranges, np.nan)
            depths = beams.with_neighbours(found, beams.is_ring(scan), np.nan)
            widest = shapes.widest(legs, hits, depths, scan.angle_increment, config.segment_gap)
            good &= widest >= config.min_leg_width
        if not good.all():
            kept = good[legs]
            points, groups, legs = points[kept], groups[kept], clusters.relabel(legs[kept])
            doubtful, one_piece, hits = doubtful[kept], one_piece[kept], hits[kept]
        hits = (hits + seam) % len(ranges)
        return self._placed(points, legs, groups, doubtful, one_piece, hits)

    def _classified(
        self,
        model: LegModel,
        points: np.ndarray,
        hits: np.ndarray,
        doubtful: np.ndarray,
        scan: Scan,
        ranges: np.ndarray,
    ) -> _Legs:
        """Each segment that the model takes for a leg, but what the map explains of it (Volkhardt 2013, III-A 4)."""
        segments, evidence = _looks(model, scan, ranges)
        is_leg = expit(logit(model.prior) + evidence) >= self.config.classified_above
        is_leg &= segments.counts >= MIN_POINTS
        of_beam = np.full(len(ranges), -1)
        of_beam[segments.beams] = np.where(is_leg, np.arange(len(segments)), -1)[segments.labels]
        kept = of_beam[hits] >= 0
        points, hits, doubtful = points[kept], hits[kept], doubtful[kept]
        legs, groups = clusters.relabel(of_beam[hits]), clusters.single_linkage(points, self.config.group_gap)
        first = np.unique(legs, return_index=True)[1]
        groups = groups[first][legs]  # a leg that lost its middle to the map is still one
        return self._placed(points, legs, groups, doubtful, np.zeros(len(points), dtype=bool), hits)

    def _placed(
        self,
        points: np.ndarray,
        legs: np.ndarray,
        groups: np.ndarray,
        doubtful: np.ndarray,
        one_piece: np.ndarray,
        hits: np.ndarray,
    ) -> _Legs:
        """Legs of points that know their leg and their group."""
        if not len(legs):
            nothing = np.zeros(0)
            return _Legs(points, legs, np.zeros((0, 2)), np.zeros(0, dtype=int), nothing, nothing.astype(bool), hits)
        centres = clusters.means(points, legs)
        if self.config.leg_radius:
            distances = np.maximum(np.hypot(centres[:, 0], centres[:, 1]), TINY)
            centres *= 1.0 + ARC_DEPTH * self.config.leg_radius / distances[:, None]
        first = np.unique(legs, return_index=True)[1]
        one_piece = one_piece[first] & (np.bincount(legs) >= DISCERNIBLE_POINTS)
        return _Legs(points, legs, centres, groups[first], np.bincount(legs, doubtful) > 0, one_piece, hits)

    def _segments(
        self, points: np.ndarray, hits: np.ndarray, scan: Scan, ranges: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """(N,) bool, the points in segments that are neither noise nor, if so configured, walls; and (N,) the segment
        of those in one wide piece, -1 for all others."""
        config = self.config
        if not len(points):
            return np.zeros(0, dtype=bool), np.zeros(0, dtype=int)
        neighbours = clusters.NO_PAIRS
        if config.segment_gap_beams:
            spacings = np.minimum(ranges[hits[:-1]], ranges[hits[1:]]) * abs(scan.angle_increment)
            steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
            near = np.flatnonzero(steps <= config.segment_gap_beams * spacings)
            neighbours = np.stack([near, near + 1], axis=1)
        segments = clusters.single_linkage(points, config.segment_gap, neighbours)
        good = np.bincount(segments) >= config.min_segment_points
        if math.isfinite(config.max_segment_width):
            distances = np.sqrt(((points - clusters.means(points, segments)[segments]) ** 2).sum(axis=1))
            members, starts = clusters.by_label(segments)
            good &= 2.0 * np.maximum.reduceat(distances[members], starts) <= config.max_segment_width
        if config.min_segment_step:
            good &= self._stands_out(segments, hits, scan, ranges)
        one_piece = np.zeros(len(good), dtype=bool)
        if math.isfinite(config.max_leg_width):
            one_piece = shapes.one_piece(points, segments, config.max_leg_width, config.leg_dent)
        return good[segments], np.where(one_piece[segments], segments, -1)

    def _stands_out(self, segments: np.ndarray, hits: np.ndarray, scan: Scan, ranges: np.ndarray) -> np.ndarray:
        """(S,) bool, segments whose neighbouring beams on both sides end at another depth, on one side farther away.

        A wall that is seen at a low angle, or from so far that its points are more than the gap apart, falls apart
        into segments as small as legs; theirs continue at nearly the same depth. A neighbour without a distance
        counts as farther away, as does the end of the scan.
        """
        members, starts = clusters.by_label(segments)
        ends = np.append(starts[1:], len(members)) - 1
        first, last = hits[members[starts]], hits[members[ends]]  # members of a segment are in the order of beams
        valid = beams.hits(ranges, scan.range_min, scan.range_max)
        depths = beams.with_neighbours(np.where(valid, ranges, np.inf), beams.is_ring(scan), np.inf)
        before, after = depths[first] - ranges[first], depths[last + 2] - ranges[last]
        step = self.config.min_segment_step
        return (np.minimum(abs(before), abs(after)) >= step) & (np.maximum(before, after) >= step)

    def _owners(self, legs: _Legs) -> np.ndarray:
        """(L,) index of the person of each leg: nearest legs of a group first, greedily; who is left is alone."""
        count = len(legs.centres)
        if count < 2:
            return np.arange(count)
        pairs, distances = clusters.pairs_within(legs.centres, self.config.pair_distance)
        pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0], distances))]
        pairs = pairs[legs.groups[pairs[:, 0]] == legs.groups[pairs[:, 1]]]
        partner = list(range(count))
        for a, b in pairs.tolist():
            if partner[a] == a and partner[b] == b:
                partner[a], partner[b] = b, a
        return clusters.relabel(np.minimum(partner, np.arange(count)).astype(int))

    def _people(
        self, legs: _Legs, owners: np.ndarray, angle_increment: float
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (N, 3), covariances (N, 3, 3), and whether both legs were seen (N,)."""
        config = self.config
        if not len(owners):
            return np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, dtype=bool)
        middles = clusters.means(legs.centres, owners)
        paired = np.bincount(owners) == 2
        groups = legs.groups[np.unique(owners, return_index=True)[1]]
        crowded = np.bincount(groups)[groups] > 1
        distances = np.hypot(middles[:, 0], middles[:, 1])
        factor = np.where(crowded, config.crowd_factor, 1.0)
        along = factor * np.where(paired, config.pair_std, config.single_along_std)
        across = factor * np.where(paired, config.pair_std, config.single_across_std)
        # Where a leg begins and ends between two beams is uniform over their distance.
        spacing_variances = (distances * angle_increment) ** 2 / 12.0
        along_variances, across_variances = along**2, across**2 + spacing_variances
        beam = bearings(middles)
        cos, sin = np.cos(beam), np.sin(beam)
        covariances = np.zeros((len(middles), 3, 3))
        covariances[:, 0, 0] = cos**2 * along_variances + sin**2 * across_variances
        covariances[:, 1, 1] = sin**2 * along_variances + cos**2 * across_variances
        covariances[:, 0, 1] = covariances[:, 1, 0] = cos * sin * (along_variances - across_variances)
        return np.column_stack([middles, np.zeros(len(middles))]), covariances, paired

    def _sight(self, scan: Scan, ranges: np.ndarray, background: np.ndarray) -> Optional[Sight]:
        """What the scanner could see, or None of a scan whose only beam has no width.

        The legs of who stands within the dilation of the map are taken for background: to see nobody says nothing.
        """
        if scan.angle_increment == 0.0:
            return None
        # Beyond this the beams are too far apart for two points of a leg to be one segment.
        config = self.config
        resolved = LEG_WIDTH / config.min_segment_points if config.segment_gap_beams else config.segment_gap
        reach = min(scan.range_max, config.max_range, resolved / abs(scan.angle_increment))
        seen = beams.seen_through(ranges, scan.range_min, scan.range_max)
        seen[background] -= self.config.map_dilation + PERSON_DEPTH_M
        return Sight(np.zeros(2), 0.0, scan.angle_min, scan.angle_increment, np.minimum(seen, reach), reach)

    def _confidences(self, legs: _Legs, owners: np.ndarray, paired: np.ndarray) -> np.ndarray:
        """(N,) by whether both legs were seen, and whether an obstacle of the map could be what was seen."""
        config = self.config
        confidences = np.where(paired, config.pair_confidence, config.single_confidence)
        one_piece = np.bincount(owners, legs.one_piece, len(confidences)) > 0
        confidences = np.where(one_piece, np.minimum(confidences, config.one_piece_confidence), confidences)
        doubtful = np.bincount(owners, legs.doubtful, len(confidences)) > 0
        return np.where(doubtful, np.minimum(confidences, config.doubtful_confidence), confidences)

    def _vote(
        self, confidences: np.ndarray, legs: _Legs, owners: np.ndarray, scan: Scan, ranges: np.ndarray
    ) -> np.ndarray:
        """(N,) confidences with what the shape of each leg says, by Bayes' rule; as they are without a model."""
        if self._model is None or not len(owners):
            return confidences
        segments, of_segments = _looks(self._model, scan, ranges)
        evidence = np.zeros(len(ranges))
        evidence[segments.beams] = of_segments[segments.labels]
        of_legs = np.bincount(legs.labels, evidence[legs.beams]) / np.bincount(legs.labels)
        if self.config.classified_above:  # no rule has anything to say
            return expit(logit(self._model.prior) + np.bincount(owners, of_legs))
        belief = self.config.unmapped_belief if self._grid is None else self.config.mapped_belief
        prior = np.clip(np.minimum(confidences, belief), LEAST_BELIEF, 1.0 - LEAST_BELIEF)
        return expit(logit(prior) + np.bincount(owners, of_legs))

    def _doubt(self, arms: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(N,) metres from an obstacle of the map within which it may be what was seen `arms` (N, 2) from the scanner,
        whose pose has the covariance (3, 3)."""
        config = self.config
        doubt = config.map_doubt + config.map_doubt_per_metre * np.hypot(arms[:, 0], arms[:, 1])
        return doubt + config.map_doubt_stds * np.sqrt(map_fit.variances(arms, covariance))

    def _period_s(self, scan: Scan) -> float:
        period_s = self._periods.note(scan.stamp_ns)
        if period_s is not None:
            return period_s
        return scan.scan_time if math.isfinite(scan.scan_time) and scan.scan_time > 0.0 else UNKNOWN_PERIOD_S
