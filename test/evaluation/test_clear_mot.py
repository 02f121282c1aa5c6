import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_scene, scene

from people_fusion.evaluation.clear_mot import ClearMot, Event, match


def score(frames, only_annotated=False):
    truth, estimates = scene(frames)
    return ClearMot.of(match(truth, estimates, 0.5, only_annotated), truth.frame_count, only_annotated)


def assigned(frames):
    """Track by person, frame by frame."""
    truth, estimates = scene(frames)
    events = match(truth, estimates)
    found = [{} for _ in frames]
    for row in np.flatnonzero(events.matched):
        person, track = truth.ids[events.truth_rows[row]], estimates.ids[events.estimate_rows[row]]
        found[events.frames[row]][int(person)] = int(track)
    return found


def test_hand_worked_example_of_all_errors():
    # Four frames, seven annotations: person 1 at 0 0, person 2 at 5 0.
    counts = score(
        [
            ({1: (0, 0), 2: (5, 0)}, {11: (0.3, 0), 12: (5, 0.1)}),  # two matches, 0.3 m and 0.1 m
            ({1: (0, 0), 2: (5, 0)}, {11: (0, 0.6)}),  # two misses, one false positive
            ({1: (0, 0), 2: (5, 0)}, {11: (0, 0.2), 13: (5, 0)}),  # 0.2 m; person 2 is found again by 13: mismatch
            ({2: (5, 0)}, {11: (0, 0), 13: (5, 0.4)}),  # person 1 has gone: false positive; 0.4 m
        ]
    )
    assert (counts.frames, counts.ground_truth_count, counts.matches) == (4, 7, 5)
    assert (counts.misses, counts.false_positives, counts.mismatches) == (2, 2, 1)
    assert counts.mota == pytest.approx(1 - 5 / 7)  # eq. 7.8
    assert counts.motp_m == pytest.approx((0.3 + 0.1 + 0.2 + 0.0 + 0.4) / 5)  # eq. 7.9
    assert counts.miss_rate == pytest.approx(2 / 7)
    assert counts.false_positive_rate == pytest.approx(2 / 7)
    assert counts.mismatch_rate == pytest.approx(1 / 7)
    assert counts.recall == pytest.approx(5 / 7)
    assert counts.precision == pytest.approx(5 / 7)


def test_match_within_threshold_is_kept_although_another_track_is_nearer():
    frames = [({1: (0, 0)}, {11: (0.1, 0)}), ({1: (0, 0)}, {11: (0.45, 0), 12: (0, 0)})]
    assert assigned(frames) == [{1: 11}, {1: 11}]
    assert score(frames).false_positives == 1


def test_match_is_kept_over_frames_in_which_nobody_was_seen():
    frames = [({1: (0, 0)}, {11: (0.1, 0)}), ({1: (0, 0)}, {}), ({}, {}), ({1: (0, 0)}, {11: (0.4, 0), 12: (0, 0)})]
    assert assigned(frames)[-1] == {1: 11}
    assert score(frames).mismatches == 0


def test_match_beyond_threshold_goes_to_the_nearer_track_as_mismatch():
    frames = [({1: (0, 0)}, {11: (0.1, 0)}), ({1: (0, 0)}, {11: (0.51, 0), 12: (0.2, 0)})]
    assert assigned(frames)[-1] == {1: 12}
    assert score(frames).mismatches == 1


def test_pair_at_the_threshold_matches_and_beyond_it_does_not():
    assert score([({1: (0, 0)}, {11: (0.5, 0)})]).matches == 1
    beyond = score([({1: (0, 0)}, {11: (0.5 + 1e-9, 0)})])
    assert (beyond.matches, beyond.misses, beyond.false_positives) == (0, 1, 1)


def test_assignment_prefers_more_matches_to_nearer_ones():
    # 1-11 is nearest of all, but leaves 2 without a track.
    assert assigned([({1: (0.0, 0), 2: (0.5, 0)}, {11: (0.1, 0), 12: (-0.4, 0)})]) == [{1: 12, 2: 11}]


def test_assignment_is_global_not_greedy():
    # Greedy takes 1-11 (0.1) and then 2-12 (0.45); the other way round is 0.2 + 0.15.
    assert assigned([({1: (0.0, 0), 2: (0.3, 0)}, {11: (0.1, 0), 12: (-0.15, 0)})]) == [{1: 12, 2: 11}]


def test_swapped_tracks_are_two_mismatches_and_takeovers():
    counts = score(
        [({1: (0, 0), 2: (3, 0)}, {11: (0, 0), 12: (3, 0)}), ({1: (0, 0), 2: (3, 0)}, {12: (0, 0), 11: (3, 0)})]
    )
    assert (counts.mismatches, counts.takeovers, counts.transfers) == (2, 2, 2)


def test_new_track_after_loss_is_a_mismatch_but_no_takeover():
    counts = score([({1: (0, 0)}, {11: (0, 0)}), ({1: (0, 0)}, {}), ({1: (0, 0)}, {12: (0, 0)})])
    assert (counts.misses, counts.mismatches, counts.takeovers) == (1, 1, 0)


def test_track_that_moves_to_a_new_person_is_a_transfer_and_its_first_person_a_mismatch_once_found_again():
    frames = [
        ({1: (0, 0), 2: (3, 0)}, {11: (0, 0)}),
        ({1: (0, 0), 2: (3, 0)}, {11: (3, 0)}),
        ({1: (0, 0), 2: (3, 0)}, {11: (3, 0), 12: (0, 0)}),
    ]
    assert (score(frames[:2]).mismatches, score(frames[:2]).transfers) == (0, 1)
    assert (score(frames).mismatches, score(frames).takeovers, score(frames).transfers) == (1, 0, 1)


def test_mismatch_is_counted_once():
    frame = {1: (0, 0)}
    assert score([(frame, {11: (0, 0)}), (frame, {12: (0, 0)}), (frame, {12: (0, 0)})]).mismatches == 1


@pytest.mark.parametrize("first, second", [(1, 2), (2, 1)])
def test_of_two_former_holders_the_later_keeps_the_track(first, second):
    frames = [
        ({first: (0, 0)}, {11: (0, 0)}),
        ({second: (0, 0.1)}, {11: (0, 0)}),
        ({1: (0, 0.2), 2: (0, 0.2)}, {11: (0, 0)}),
    ]
    assert assigned(frames)[-1] == {second: 11}


def test_only_annotated_counts_no_false_positives_and_has_no_precision():
    frames = [({1: (0, 0)}, {11: (0, 0), 12: (0.3, 0), 13: (9, 9)}), ({}, {12: (9, 9)}), ({1: (0, 0)}, {})]
    counts = score(frames, only_annotated=True)
    assert (counts.matches, counts.misses, counts.false_positives) == (1, 1, 0)
    assert (counts.mota, counts.false_positive_rate, counts.precision) == (0.5, 0.0, None)
    assert score(frames).false_positives == 3


def test_scores_without_denominator_are_undefined():
    nothing = score([])
    assert nothing == ClearMot()
    assert (nothing.mota, nothing.motp_m, nothing.miss_rate, nothing.recall, nothing.precision) == (None,) * 5
    blind = score([({1: (0, 0)}, {})])
    assert (blind.mota, blind.motp_m, blind.miss_rate, blind.recall, blind.precision) == (0.0, None, 1.0, 0.0, None)
    ghosts = score([({}, {11: (0, 0)})])
    assert (ghosts.mota, ghosts.motp_m, ghosts.false_positives, ghosts.precision) == (None, None, 1, 0.0)


def test_counts_of_runs_are_added_not_their_rates():
    good = score([({1: (0, 0)}, {11: (0.1, 0)})] * 9)
    bad = score([({1: (0, 0)}, {})])
    both = sum([good, bad], ClearMot())
    assert both.mota == pytest.approx(0.9)
    assert both.motp_m == pytest.approx(0.1)
    assert both.frames == 10


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 12))
def test_each_person_and_each_track_has_exactly_one_event(seed, people, frames):
    truth, estimates = random_scene(np.random.default_rng(seed), frames, people, room_m=1.5)
    events = match(truth, estimates)
    assert sorted(events.truth_rows[events.truth_rows >= 0]) == list(range(len(truth.ids)))
    assert sorted(events.estimate_rows[events.estimate_rows >= 0]) == list(range(len(estimates.ids)))
    assert np.all(np.diff(events.frames) >= 0)
    assert np.all(events.distances[events.matched] <= 0.5)
    total = sum(events.per_frame(kind, truth.frame_count).sum() for kind in Event)
    assert total == len(events)
