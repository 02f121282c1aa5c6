"""People by their legs: a multi-hypothesis tracker of legs with adaptive occlusion (Arras et al. 2012, 3)."""

from __future__ import annotations

from collections import Counter, OrderedDict
from dataclasses import dataclass
from typing import Dict, Hashable, List, NamedTuple, Optional

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.measurements import Measurement
from people_fusion.core.tracks import NOBODY, Legs, Tracks
from people_fusion.tracking.leg_hypotheses import FREE, NONE, Forest, LegTracks, MhtConfig, MultiHypothesisTracker
from people_fusion.tracking.people_from_legs import People, PeopleConfig, accompany, bodies, recognise
from people_fusion.tracking.plausible import FARTHEST_M
from people_fusion.tracking.tracker import TRACKERS, Tracker

IDENTITIES_REMEMBERED = 4096
LEGS = "legs"  # modality of what it takes


@dataclass(frozen=True)
class LegMhtConfig:
    """The leg tracker and what makes people of legs."""

    mht: MhtConfig = section(MhtConfig, "hypotheses about legs")
    people: PeopleConfig = section(PeopleConfig, "when two legs are a person")
    adaptive: bool = parameter(True, "legs of a person have probabilities of their own (Arras et al. 2012, 3.3.1)")
    leg_std: float = parameter(0.04, "of a leg's measured middle, by axis, metres", low=1e-3)
    told_std: float = parameter(
        0.7, "people whose place is known less well than this on any axis are remembered but not confirmed, m", low=0.0
    )
    head_height: float = parameter(1.5, "of heads, which a laser does not see, metres", low=0.0)
    head_height_std: float = parameter(0.3, "its uncertainty, metres", low=0.0)


class _State(NamedTuple):
    stamp_ns: Optional[int]
    forest: Forest
    people: People
    owners: np.ndarray

    @staticmethod
    def initial() -> _State:
        return _State(None, Forest.seed(), People.nobody(), np.zeros(0, dtype=np.int64))


@TRACKERS.register("leg_mht", LegMhtConfig)
class LegMht(Tracker):
    """Takes legs and nothing else: it is as old as the newest scan. A late scan counts as of now, its age as noise."""

    def __init__(self, config: LegMhtConfig) -> None:
        self.config = config
        self._mht = MultiHypothesisTracker(config.mht)
        self._identities: OrderedDict[Hashable, int] = OrderedDict()
        self._next_id = 1
        self._counts: Counter = Counter()
        self._state = _State.initial()

    @property
    def stamp_ns(self) -> Optional[int]:
        """See Tracker."""
        return self._state.stamp_ns

    @property
    def leg_tracks(self) -> LegTracks:
        """Those of the best hypothesis."""
        forest = self._state.forest
        return forest.tracks.take(np.array(forest.hypotheses[0].tracks, dtype=int))

    @property
    def hypotheses(self) -> int:
        """How many are kept."""
        return len(self._state.forest.hypotheses)

    @property
    def owners(self) -> np.ndarray:
        """(L,) person to whom each leg of the newest scan was found to belong, or NOBODY; by the best hypothesis."""
        return self._state.owners

    def process(self, measurement: Measurement) -> None:
        """See Tracker."""
        if measurement.modality != LEGS:  # who sees no legs does not say that there are none
            return
        before = self._state.stamp_ns
        elapsed_s = 0.0 if before is None else (measurement.stamp_ns - before) / 1e9
        age_s = max(-elapsed_s, 0.0)
        if age_s:
            self._counts["measurements predicted forward"] += 1
        stamp_ns = measurement.stamp_ns if before is None else max(before, measurement.stamp_ns)
        forest = self._predicted(elapsed_s)
        with np.errstate(invalid="ignore"):
            placed = np.flatnonzero((np.abs(measurement.legs) < FARTHEST_M).all(axis=1))
        positions = measurement.legs[placed]
        variance = self.config.leg_std**2 + (age_s * self.config.mht.initial_speed_std) ** 2
        people = self._state.people
        kinds = np.full(len(forest.tracks.ids), FREE)
        if self.config.adaptive:
            kinds = people.kinds(forest.tracks, stamp_ns, self.config.people)
        forest = self._mht.grow(
            forest,
            stamp_ns,
            positions,
            np.tile(variance * np.eye(2), (len(positions), 1, 1)),
            np.array([self._identity((*measurement.order, row)) for row in range(len(positions))], dtype=np.int64),
            kinds,
        )
        legs = forest.tracks.take(np.array(forest.hypotheses[0].tracks, dtype=int))
        people = recognise(people, legs, stamp_ns, self.config.people, self._identity)
        persons = {leg: person.id for person in people.persons for leg in person.legs}
        owners = np.full(len(measurement.legs), NOBODY, dtype=np.int64)
        for leg, row in zip(legs.ids.tolist(), legs.rows.tolist()):
            if row != NONE:
                owners[placed[row]] = persons.get(leg, NOBODY)
        self._state = _State(stamp_ns, forest, people, owners)

    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """See Tracker."""
        now = self._state.stamp_ns
        if now is None:
            now = stamp_ns or 0
        forest, people = self._predicted(max((stamp_ns or now) - now, 0) / 1e9), self._state.people
        legs = forest.tracks.take(np.array(forest.hypotheses[0].tracks, dtype=int))
        planar, spreads = bodies(people, legs, self.config.people)
        count = len(people.persons)
        means, covariances = np.zeros((count, 5)), np.zeros((count, 5, 5))
        planes = np.array([0, 1, 3, 4])
        means[:, planes], means[:, 2] = planar, self.config.head_height
        covariances[:, planes[:, None], planes] = spreads
        covariances[:, 2, 2] = self.config.head_height_std**2
        marginals = dict(zip(forest.tracks.ids.tolist(), self._marginals(forest)))
        seen = {leg: stamp == self._state.stamp_ns for leg, stamp in zip(legs.ids.tolist(), legs.seen_ns.tolist())}
        matched = np.array([any(seen[leg] for leg in person.legs) for person in people.persons], dtype=bool)
        return Tracks(
            stamp_ns=max(now, stamp_ns or now),
            frame_id="",
            ids=np.array([person.id for person in people.persons], dtype=np.int64),
            means=means,
            covariances=covariances,
            existence=np.array([max(marginals[leg] for leg in person.legs) for person in people.persons]),
            confirmed=np.linalg.eigvalsh(spreads[:, :2, :2]).max(axis=1, initial=0.0) < self.config.told_std**2,
            matched=matched,
            occluded=~matched,
            ages_s=np.array([(now - person.born_ns) / 1e9 for person in people.persons]),
        )

    def legs(self) -> Legs:
        """See Tracker; those of the best hypothesis."""
        tracks, now = self.leg_tracks, self._state.stamp_ns
        owners = {leg: person.id for person in self._state.people.persons for leg in person.legs}
        return Legs(
            stamp_ns=now or 0,
            frame_id="",
            ids=tracks.ids.copy(),
            positions=tracks.means[:, :2].copy(),
            covariances=tracks.covariances[:, :2, :2].copy(),
            owners=np.array([owners.get(leg, NOBODY) for leg in tracks.ids.tolist()], dtype=np.int64),
            seen=tracks.seen_ns == now,
        )

    def snapshot(self) -> object:
        """See Tracker."""
        return self._state

    def restore(self, snapshot: object) -> None:
        """See Tracker."""
        assert isinstance(snapshot, _State)
        self._state = snapshot

    def reset(self) -> None:
        """See Tracker."""
        self._state = _State.initial()
        self._identities.clear()

    def counters(self) -> Dict[str, int]:
        """See Tracker."""
        return {**self._counts, **self._mht.counts}

    def _predicted(self, duration_s: float) -> Forest:
        """All tracks, legs of people with their person."""
        stamp_ns, forest, people = self._state[:3]
        ahead = self._mht.predict(forest, duration_s)
        if stamp_ns is None or duration_s <= 0.0 or not self.config.adaptive:
            return ahead
        tracks = accompany(
            forest.tracks, ahead.tracks, forest.hypotheses[0].tracks, people, stamp_ns, duration_s, self.config.people
        )
        return ahead._replace(tracks=tracks)

    def _marginals(self, forest: Forest) -> List[float]:
        """Probability that the leg of each track is there, summed over the tracks of one leg."""
        total: Dict[int, float] = {}
        for leg, share in zip(forest.tracks.ids.tolist(), forest.marginals().tolist()):
            total[leg] = total.get(leg, 0.0) + share
        return [min(total[leg], 1.0) for leg in forest.tracks.ids.tolist()]

    def _identity(self, key: Hashable) -> int:
        """The same beginning gets the same identity, however often it is reprocessed."""
        if key not in self._identities:
            self._identities[key] = self._next_id
            self._next_id += 1
            if len(self._identities) > IDENTITIES_REMEMBERED:
                self._identities.popitem(last=False)
        return self._identities[key]
