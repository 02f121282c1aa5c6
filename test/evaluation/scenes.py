"""Small scenes for the tests of evaluation."""

from __future__ import annotations

from typing import Dict, List, Sequence, Tuple

import numpy as np

from people_fusion.evaluation.truth import Estimates, Truth

Frame = Dict[int, Tuple[float, float]]


def scene(frames: Sequence[Tuple[Frame, Frame]]) -> Tuple[Truth, Estimates]:
    """Truth and estimates from one pair a frame: positions by person and by track."""
    people = [frame[0] for frame in frames]
    tracks = [frame[1] for frame in frames]
    truth = Truth.from_frames(
        [10**9 * k for k in range(len(frames))], [list(p) for p in people], [list(p.values()) for p in people]
    )
    return truth, Estimates.from_frames([list(t) for t in tracks], [list(t.values()) for t in tracks])


def random_scene(rng: np.random.Generator, frames: int, people: int, room_m: float = 3.0) -> Tuple[Truth, Estimates]:
    """A small room with people who come, go and cross; tracks get lost, renewed and swapped, and some are false."""
    walks = rng.uniform(0.0, room_m, (people, 2)) + np.cumsum(rng.normal(0.0, 0.15, (frames, people, 2)), axis=0)
    track_of = list(range(100, 100 + people))
    next_track = 100 + people
    scenes: List[Tuple[Frame, Frame]] = []
    for positions in walks:
        if people > 1 and rng.random() < 0.1:
            first, second = rng.choice(people, 2, replace=False)
            track_of[first], track_of[second] = track_of[second], track_of[first]
        shown, tracked = {}, {}
        for person, (x, y) in enumerate(positions):
            if rng.random() < 0.9:
                shown[person] = (float(x), float(y))
            if rng.random() < 0.05:
                track_of[person], next_track = next_track, next_track + 1
            if rng.random() < 0.85:
                tracked[track_of[person]] = (float(x + rng.normal(0.0, 0.2)), float(y + rng.normal(0.0, 0.2)))
        if rng.random() < 0.3:
            tracked[int(rng.integers(997, 1000))] = tuple(rng.uniform(0.0, room_m, 2).tolist())
        scenes.append((shown, tracked))
    return scene(scenes)
