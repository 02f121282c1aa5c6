import numpy as np
import pytest
from scenes import scene

from people_fusion.evaluation.hota import ALPHAS, Hota, hota_scores
from people_fusion.evaluation.identity import Identity, identity_scores


def test_identity_of_a_person_who_gets_a_new_track_is_the_longer_of_both():
    here = {1: (0, 0)}
    counts = identity_scores(*scene([(here, {11: (0, 0)})] * 3 + [(here, {12: (0, 0)})] * 5))
    assert counts == Identity(true_positives=5, false_negatives=3, false_positives=3)
    assert counts.idf1 == counts.idp == counts.idr == pytest.approx(5 / 8)


def test_identity_of_swapped_tracks_is_the_better_whole_assignment():
    people = {1: (0, 0), 2: (3, 0)}
    before, after = {11: (0, 0), 12: (3, 0)}, {12: (0, 0), 11: (3, 0)}
    counts = identity_scores(*scene([(people, before)] * 7 + [(people, after)] * 3))
    assert counts == Identity(14, 6, 6)


def test_identity_is_not_given_beyond_the_threshold():
    assert identity_scores(*scene([({1: (0, 0)}, {11: (0.5, 0)})])) == Identity(1, 0, 0)
    assert identity_scores(*scene([({1: (0, 0)}, {11: (0.51, 0)})])) == Identity(0, 1, 1)


def test_identity_without_anybody_is_undefined():
    assert identity_scores(*scene([])).idf1 is None
    assert identity_scores(*scene([({1: (0, 0)}, {})])).idp is None
    assert identity_scores(*scene([({}, {11: (0, 0)})])).idr is None
    assert Identity(1, 0, 0) + Identity(0, 1, 2) == Identity(1, 1, 2)


def test_hota_of_one_track_at_a_constant_distance():
    # 0.3 m of 1 m: similarity 0.7 makes a match at the 14 alphas up to 0.70.
    scores = hota_scores(*scene([({1: (0, 0)}, {11: (0.3, 0)})] * 4))
    assert scores.true_positives.tolist() == [4] * 14 + [0] * 5
    assert scores.hota == scores.detection_accuracy == scores.association_accuracy == pytest.approx(14 / 19)
    assert scores.localisation_accuracy == pytest.approx((14 * 0.7 + 5 * 1.0) / 19)


def test_hota_of_a_person_with_a_new_track_at_half_time():
    # Every detection is right, and each track shares half of the person's frames.
    here = {1: (0, 0)}
    scores = hota_scores(*scene([(here, {11: (0, 0)})] * 5 + [(here, {12: (0, 0)})] * 5))
    assert scores.detection_accuracy == pytest.approx(1.0)
    assert scores.association_accuracy == pytest.approx(0.5)
    assert scores.hota == pytest.approx(np.sqrt(0.5))


def test_hota_of_a_track_that_covers_half_of_the_frames():
    here = {1: (0, 0)}
    scores = hota_scores(*scene([(here, {11: (0, 0)})] * 5 + [(here, {})] * 5))
    assert (scores.detection_accuracy, scores.association_accuracy, scores.hota) == pytest.approx((0.5, 0.5, 0.5))


def test_hota_prefers_the_track_that_fits_over_the_whole_recording():
    # In the last frame a stranger is nearer, but the lasting track is still near enough.
    here = {1: (0, 0)}
    scores = hota_scores(*scene([(here, {11: (0, 0)})] * 9 + [(here, {11: (0.2, 0), 99: (0.1, 0)})]))
    # Above alpha 0.80 nine of eleven frames are common: ten of each, nine together.
    assert scores.association_accuracy == pytest.approx((16 * 1.0 + 3 * 9 / 11) / 19)


def test_hota_without_anybody_is_undefined():
    assert hota_scores(*scene([])).hota is None
    assert Hota().hota is None
    for frames in ([({1: (0, 0)}, {})], [({}, {11: (0, 0)})], [({1: (0, 0)}, {11: (9, 9)})]):
        scores = hota_scores(*scene(frames))
        assert (scores.hota, scores.detection_accuracy, scores.association_accuracy) == (0.0, 0.0, 0.0)
        assert scores.localisation_accuracy == 1.0  # as TrackEval has it


def test_hota_of_runs_averages_association_over_all_true_positives():
    here = {1: (0, 0)}
    perfect = hota_scores(*scene([(here, {11: (0, 0)})] * 30))
    halved = hota_scores(*scene([(here, {11: (0, 0)})] * 5 + [(here, {12: (0, 0)})] * 5))
    assert (perfect + halved).association_accuracy == pytest.approx((30 * 1.0 + 10 * 0.5) / 40)
    assert len(ALPHAS) == 19
