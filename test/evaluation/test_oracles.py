"""Our scores beside those of motmetrics and TrackEval, which live in an environment of their own."""

import json
import os
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from scenes import random_scene, scene

from people_fusion.evaluation.clear_mot import ClearMot
from people_fusion.evaluation.distances import in_the_image, on_the_floor
from people_fusion.evaluation.evaluate import Scores, evaluate, evaluate_in_image
from people_fusion.evaluation.hota import Hota, hota_scores
from people_fusion.evaluation.truth import Estimates, Truth

REPOSITORY = Path(__file__).resolve().parents[2]
TOLERANCE = 1e-6


def separated_scene(rng, frames=60, people=5):
    """People too far apart to be confused: whatever is matched, every definition of a mismatch is the same."""
    homes = np.arange(people)[:, None] * [4.0, 0.0]
    tracks = list(range(100, 100 + people))
    scenes = []
    for _ in range(frames):
        if rng.random() < 0.2:
            rng.shuffle(tracks)
        if rng.random() < 0.2:
            tracks[rng.integers(people)] = 100 + max(tracks)
        shown = {k: tuple(homes[k] + rng.uniform(-0.1, 0.1, 2)) for k in range(people) if rng.random() < 0.9}
        reported = {t: tuple(homes[k] + rng.uniform(-0.3, 0.3, 2)) for k, t in enumerate(tracks) if rng.random() < 0.9}
        scenes.append((shown, reported))
    return scene(scenes)


def linked(detections, reach):
    """Tracks from detections a frame: each takes the identity of the nearest of the frame before within reach."""
    ids, next_id, before = [], 0, (np.zeros(0, dtype=int), np.zeros((0, 2)))
    for points in detections:
        row_ids = []
        for point in points:
            distances = np.hypot(*(before[1] - point).T) if len(before[1]) else np.zeros(0)
            nearest = [i for i in np.argsort(distances) if distances[i] < reach and before[0][i] not in row_ids]
            row_ids.append(int(before[0][nearest[0]]) if nearest else next_id)
            next_id += not nearest
        before = (np.array(row_ids, dtype=int), points)
        ids.append(row_ids)
    return Estimates.from_frames(ids, detections)


def mot15_scene(folder):
    """Feet in the image in hundreds of pixels, as if they were metres on the ground; detections linked by nearness."""
    truth_rows = np.loadtxt(folder / "gt.txt", delimiter=",")
    detection_rows = np.loadtxt(folder / "det_sort_frcnn.txt", delimiter=",")
    frames = np.unique(truth_rows[:, 0])

    def feet(rows):
        return np.stack([rows[:, 2] + rows[:, 4] / 2, rows[:, 3] + rows[:, 5]], axis=1) / 100.0

    people = [truth_rows[truth_rows[:, 0] == frame] for frame in frames]
    detections = [feet(detection_rows[detection_rows[:, 0] == frame]) for frame in frames]
    truth = Truth.from_frames((frames * 40_000_000).astype(int), [p[:, 1] for p in people], [feet(p) for p in people])
    return truth, linked(detections, reach=0.3)


def boxes_scene(rng, frames=40, people=6):
    """Boxes of people who cross in an image that does not wrap: truth, estimates, and the distance of their boxes."""
    truth, estimates = random_scene(rng, frames, people, room_m=3.0)

    def boxes(points):
        sizes = rng.uniform([0.6, 1.2], [1.0, 2.0], (len(points), 2))
        return np.concatenate([points - 0.5 * sizes, points + 0.5 * sizes], axis=1)

    return truth, estimates, in_the_image(boxes(truth.points), boxes(estimates.points))


def mot15_boxes(folder):
    """Labelled boxes and detections linked by their feet."""
    truth, estimates = mot15_scene(folder)
    people = np.loadtxt(folder / "gt.txt", delimiter=",")
    detections = np.loadtxt(folder / "det_sort_frcnn.txt", delimiter=",")
    detections = detections[np.isin(detections[:, 0], people[:, 0])]
    people, detections = (rows[np.argsort(rows[:, 0], kind="stable"), 2:6] for rows in (people, detections))
    corners = [np.concatenate([rows[:, :2], rows[:, :2] + rows[:, 2:]], axis=1) for rows in (people, detections)]
    return truth, estimates, in_the_image(*corners)


def mot15_folders():
    data = Path(os.environ.get("PEOPLE_FUSION_DATA", REPOSITORY.parent / "shared" / "data"))
    folders = sorted(folder for folder in (data / "mot15_tud").glob("*") if (folder / "gt.txt").exists())
    if not folders:
        message = f"MOT15 not evaluated: no {data}/mot15_tud"
        warnings.warn(message, stacklevel=1)
        pytest.skip(message)
    return folders


def as_json(truth, estimates, evaluation, distance=None):
    """A sequence for the oracles.

    If two people last had the same track, motmetrics lets the one in the upper row keep it; so the rows are sorted by
    how late a person was matched, and both rules are the same.
    """
    frames, last_match = [], {}
    truth_bounds, estimate_bounds = truth.bounds(), estimates.bounds(truth.frame_count)
    events = evaluation.events
    zero_distance = 1.0 if distance else 2.0 * evaluation.threshold_m
    distance = distance or on_the_floor(truth, estimates)
    for frame in range(truth.frame_count):
        people = np.arange(truth_bounds[frame], truth_bounds[frame + 1])
        people = np.array(sorted(people, key=lambda row: -last_match.get(truth.ids[row], -1)), dtype=int)
        tracks = np.arange(estimate_bounds[frame], estimate_bounds[frame + 1])
        frames.append(
            {
                "people": truth.ids[people].tolist(),
                "tracks": estimates.ids[tracks].tolist(),
                "distances": distance(people[:, None], tracks).tolist(),
            }
        )
        for row in events.truth_rows[events.matched & (events.frames == frame)]:
            last_match[truth.ids[row]] = frame
    return {"threshold": evaluation.threshold_m, "zero_distance": zero_distance, "frames": frames}


def ask_oracles(sequences):
    python = Path(os.environ.get("PEOPLE_FUSION_ORACLES", REPOSITORY / ".workspace" / "oracles" / "bin" / "python"))
    if not python.exists():
        message = f"motmetrics and TrackEval not compared: no {python}; tools/setup makes it"
        warnings.warn(message, stacklevel=1)
        pytest.skip(message)
    script = Path(__file__).with_name("oracle_scores.py")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [str(python), str(script)], input=json.dumps(sequences), capture_output=True, text=True, env=environment
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def assert_equal_to_motmetrics(ours, theirs):
    clear, scores = ours.scores.clear_mot, ours.to_dict()
    assert clear.ground_truth_count == theirs["num_objects"]
    assert clear.matches == theirs["num_detections"]
    assert clear.misses == theirs["num_misses"]
    assert clear.false_positives == theirs["num_false_positives"]
    assert clear.mismatches == theirs["num_switches"]
    assert clear.transfers == theirs["num_transfer"]
    precision = "motp_image" if clear.in_image else "motp_m"
    pairs = {"mota": "mota", precision: "motp", "recall": "recall", "precision": "precision"}
    pairs.update({"idf1": "idf1", "idp": "idp", "idr": "idr"})
    assert_close({name: scores[name] for name in pairs}, {name: theirs[pairs[name]] for name in pairs})


def assert_equal_to_trackeval(ours, theirs):
    scores = ours.to_dict()
    mine = {name: scores[name] for name in ("hota", "deta", "assa", "loca", "idf1", "idp", "idr")}
    pairs = {"hota": "HOTA", "deta": "DetA", "assa": "AssA", "loca": "LocA", "idf1": "IDF1", "idp": "IDP", "idr": "IDR"}
    assert_close(mine, {name: float(np.mean(theirs[pairs[name]])) for name in mine})


def assert_close(ours, theirs):
    for name, value in ours.items():
        assert value == pytest.approx(theirs[name], abs=TOLERANCE, rel=0), (name, ours, theirs)


def assert_equal_to_both(scenes):
    evaluations = [evaluate_in_image(*entry) if len(entry) == 3 else evaluate(*entry) for entry in scenes]
    pairs = zip(scenes, evaluations)
    answers = ask_oracles([as_json(*entry[:2], evaluation, *entry[2:]) for entry, evaluation in pairs])
    for evaluation, answer in zip(evaluations, answers["sequences"]):
        assert_equal_to_motmetrics(evaluation, answer["motmetrics"])
        assert_equal_to_trackeval(evaluation, answer["trackeval"])
    summed = sum((evaluation.scores for evaluation in evaluations), Scores()).to_dict()
    assert_close({name: summed[name.lower()] for name in ("HOTA", "DetA", "AssA", "LocA")}, answers["combined_hota"])
    return evaluations, answers


def test_random_scenes_score_as_in_motmetrics_and_trackeval():
    rng = np.random.default_rng(12)
    sizes = [(people, room_m) for people in (1, 3, 8) for room_m in (1.0, 2.5, 8.0)]
    scenes = [random_scene(rng, 40, people, room_m) for people, room_m in sizes]
    evaluations, _ = assert_equal_to_both(scenes)
    # The scenes hold what they are meant to hold.
    total = sum((evaluation.scores.clear_mot for evaluation in evaluations), ClearMot())
    assert min(total.misses, total.false_positives, total.mismatches, total.takeovers, total.transfers) > 20
    assert total.mismatches > total.takeovers


def test_mismatches_of_people_who_are_far_apart_are_the_same_in_all_three():
    rng = np.random.default_rng(3)
    evaluations, answers = assert_equal_to_both([separated_scene(rng) for _ in range(3)])
    for evaluation, answer in zip(evaluations, answers["sequences"]):
        clear, theirs = evaluation.scores.clear_mot, answer["trackeval"]
        assert clear.mismatches == theirs["IDSW"] > 20
        counts = (clear.matches, clear.misses, clear.false_positives)
        assert counts == (theirs["CLR_TP"], theirs["CLR_FN"], theirs["CLR_FP"])
        assert clear.mota == pytest.approx(theirs["MOTA"], abs=TOLERANCE)


def test_lost_and_found_person_is_a_switch_in_all_three():
    still = {1: (0.0, 0.0)}
    frames = [(still, {11: (0.1, 0.0)}), (still, {}), (still, {12: (0.1, 0.0)}), (still, {12: (0.1, 0.0)})]
    evaluations, answers = assert_equal_to_both([scene(frames)])
    assert evaluations[0].scores.clear_mot.mismatches == 1
    assert answers["sequences"][0]["trackeval"]["IDSW"] == 1


def test_real_detections_score_as_in_motmetrics_and_trackeval():
    evaluations, _ = assert_equal_to_both([mot15_scene(folder) for folder in mot15_folders()])
    assert all(evaluation.scores.clear_mot.recall > 0.5 for evaluation in evaluations)


def test_boxes_score_as_in_motmetrics_and_trackeval():
    rng = np.random.default_rng(8)
    evaluations, _ = assert_equal_to_both([boxes_scene(rng) for _ in range(4)])
    total = sum((evaluation.scores.clear_mot for evaluation in evaluations), ClearMot())
    assert min(total.misses, total.false_positives, total.mismatches) > 20


def test_real_boxes_score_as_in_motmetrics_and_trackeval():
    evaluations, _ = assert_equal_to_both([mot15_boxes(folder) for folder in mot15_folders()])
    assert all(evaluation.scores.clear_mot.recall > 0.5 for evaluation in evaluations)


def test_similarity_reaches_zero_at_trackevals_distance_if_asked_to():
    truth, estimates = random_scene(np.random.default_rng(5), frames=30, people=4)
    evaluation = evaluate(truth, estimates)
    sequence = {**as_json(truth, estimates, evaluation), "zero_distance": 2.0}
    theirs = ask_oracles([sequence])["sequences"][0]["trackeval"]
    ours: Hota = hota_scores(truth, estimates, zero_distance=2.0)
    assert ours.hota == pytest.approx(np.mean(theirs["HOTA"]), abs=TOLERANCE)
    assert ours.localisation_accuracy == pytest.approx(np.mean(theirs["LocA"]), abs=TOLERANCE)
