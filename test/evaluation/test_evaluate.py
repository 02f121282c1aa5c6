import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_scene, scene

from people_fusion.evaluation.evaluate import Scores, evaluate
from people_fusion.evaluation.truth import Estimates, Truth

KEYS = {
    *("mota", "motp_m", "miss_rate", "false_positive_rate", "mismatch_rate", "recall", "precision", "idf1", "hota"),
    *("nees", "identity_switches", "ground_truth_count", "frames"),
}


def strict_json(scores):
    return json.loads(json.dumps(scores.to_dict(), allow_nan=False))


def shuffled(rng, truth, estimates):
    """The same scene with the rows of each frame in another order."""

    def order(frames):
        return np.lexsort((rng.random(len(frames)), frames))

    people, tracks = order(truth.frames), order(estimates.frames)
    return (
        Truth(truth.stamps_ns, truth.frames[people], truth.ids[people], truth.positions[people]),
        Estimates(estimates.frames[tracks], estimates.ids[tracks], estimates.means[tracks]),
    )


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 6), st.integers(0, 15))
def test_order_of_rows_within_frames_changes_nothing(seed, people, frames):
    rng = np.random.default_rng(seed)
    truth, estimates = random_scene(rng, frames, people, room_m=1.5)
    ours = evaluate(truth, estimates).to_dict()
    assert evaluate(*shuffled(rng, truth, estimates)).to_dict() == pytest.approx(ours, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 15))
def test_names_of_people_and_tracks_change_nothing(seed, people, frames):
    rng = np.random.default_rng(seed)
    truth, estimates = random_scene(rng, frames, people, room_m=1.5)
    persons, tracks = rng.permutation(10), rng.permutation(1000)
    renamed = Truth(truth.stamps_ns, truth.frames, persons[truth.ids], truth.positions)
    ours = evaluate(truth, estimates).to_dict()
    others = evaluate(renamed, Estimates(estimates.frames, tracks[estimates.ids], estimates.means)).to_dict()
    assert others == pytest.approx(ours, abs=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 15))
def test_a_perfect_tracker_scores_one(seed, people, frames):
    truth, _ = random_scene(np.random.default_rng(seed), frames, people)
    if not len(truth.ids):
        return
    scores = evaluate(truth, Estimates(truth.frames, truth.ids + 1000, truth.positions)).to_dict()
    assert all(
        scores[name] == 1.0
        for name in ["mota", "recall", "precision", "idf1", "idp", "idr", "hota", "deta", "assa", "loca"]
    )
    assert all(scores[name] == 0 for name in ["motp_m", "misses", "false_positives", "identity_switches", "transfers"])


@pytest.mark.parametrize(
    "frames, mota, idf1, hota",
    [
        ([], None, None, None),
        ([({}, {})], None, None, None),
        ([({}, {11: (0, 0)})], None, 0.0, 0.0),
        ([({1: (0, 0)}, {})], 0.0, 0.0, 0.0),
    ],
    ids=["no frames", "nobody", "no truth", "no tracks"],
)
def test_scores_of_nothing_are_defined_and_fit_json(frames, mota, idf1, hota):
    scores = strict_json(evaluate(*scene(frames)))
    assert (scores["mota"], scores["idf1"], scores["hota"], scores["nees"]) == (mota, idf1, hota, None)
    assert set(scores) >= KEYS
    assert scores["frames"] == len(frames)


def test_scores_of_runs_add_up_from_nothing():
    run = evaluate(*random_scene(np.random.default_rng(0), 20, 4)).scores
    once, thrice = run.to_dict(), sum([run] * 3, Scores()).to_dict()
    assert thrice["mota"] == pytest.approx(once["mota"])
    assert thrice["hota"] == pytest.approx(once["hota"])
    assert thrice["misses"] == 3 * once["misses"]
    assert Scores().to_dict()["mota"] is None


def test_strangers_who_are_not_annotated_lower_no_score():
    here = {1: (0.0, 0.0)}
    frames = [(here, {11: (0.0, 0.0), 12: (3.0, 0.0), 13: (0.2, 0.0)})] * 4
    scores = evaluate(*scene(frames), only_annotated=True).to_dict()
    assert [scores[name] for name in ("mota", "idf1", "hota", "false_positive_rate")] == [1.0, 1.0, 1.0, 0.0]
    assert scores["precision"] is None
    assert scores["only_annotated"] is True
    assert evaluate(*scene(frames)).to_dict()["mota"] == -1.0


def test_threshold_reaches_all_scores():
    frames = [({1: (0, 0)}, {11: (0.8, 0)})]
    near, far = evaluate(*scene(frames)).to_dict(), evaluate(*scene(frames), threshold_m=1.0).to_dict()
    assert [near[name] for name in ("recall", "idf1")] == [0.0, 0.0]
    assert [far[name] for name in ("recall", "idf1")] == [1.0, 1.0]
    assert near["hota"] == pytest.approx(4 / 19)  # similarity 0.2
    assert far["hota"] == pytest.approx(12 / 19)  # similarity 0.6
