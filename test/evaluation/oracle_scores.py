"""Scores of motmetrics and TrackEval; run by their own Python, JSON from standard input to standard output.

In: a list of sequences, each {"threshold": metres, "zero_distance": metres, "frames": [{"people": [id...],
"tracks": [id...], "distances": [[metres...]...]}...]}. Out: one mapping of scores for each sequence.
"""

import contextlib
import json
import os
import sys

import numpy as np

with contextlib.redirect_stdout(sys.stderr):
    import motmetrics
    import trackeval

MOTMETRICS = (
    *("num_objects", "num_detections", "num_misses", "num_false_positives", "num_switches", "num_transfer"),
    *("mota", "motp", "recall", "precision", "idf1", "idp", "idr"),
)


def table(frame):
    return np.array(frame["distances"], dtype=float).reshape(len(frame["people"]), len(frame["tracks"]))


def motmetrics_scores(sequence):
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for frame in sequence["frames"]:
        distances = table(frame)
        distances[distances > sequence["threshold"]] = np.nan
        accumulator.update(frame["people"], frame["tracks"], distances)
    scores = motmetrics.metrics.create().compute(accumulator, metrics=MOTMETRICS, return_dataframe=False)
    return {name: float(scores[name]) for name in MOTMETRICS}


def numbered(ids):
    return {identity: number for number, identity in enumerate(sorted(set(ids)))}


def trackeval_data(sequence, zero_distance):
    frames = sequence["frames"]
    people = numbered([i for frame in frames for i in frame["people"]])
    tracks = numbered([i for frame in frames for i in frame["tracks"]])
    return {
        "num_timesteps": len(frames),
        "num_gt_ids": len(people),
        "num_tracker_ids": len(tracks),
        "num_gt_dets": sum(len(frame["people"]) for frame in frames),
        "num_tracker_dets": sum(len(frame["tracks"]) for frame in frames),
        "gt_ids": [np.array([people[i] for i in frame["people"]], dtype=int) for frame in frames],
        "tracker_ids": [np.array([tracks[i] for i in frame["tracks"]], dtype=int) for frame in frames],
        "similarity_scores": [np.maximum(0.0, 1.0 - table(frame) / zero_distance) for frame in frames],
    }


def trackeval_scores(sequence):
    data = trackeval_data(sequence, sequence["zero_distance"])
    # In CLEAR and Identity a similarity of one half is a match.
    matching = trackeval_data(sequence, 2.0 * sequence["threshold"])
    quiet = {"PRINT_CONFIG": False}
    hota = trackeval.metrics.HOTA().eval_sequence(data)
    clear = trackeval.metrics.CLEAR(quiet).eval_sequence(matching)
    identity = trackeval.metrics.Identity(quiet).eval_sequence(matching)
    scores = {name: np.asarray(hota[name]).tolist() for name in ("HOTA", "DetA", "AssA", "LocA")}
    scores.update({name: float(clear[name]) for name in ("MOTA", "CLR_TP", "CLR_FN", "CLR_FP", "IDSW")})
    scores.update({name: float(identity[name]) for name in ("IDF1", "IDP", "IDR")})
    return scores


def trackeval_combined_hota(sequences):
    metric = trackeval.metrics.HOTA()
    results = {str(k): metric.eval_sequence(trackeval_data(s, s["zero_distance"])) for k, s in enumerate(sequences)}
    combined = metric.combine_sequences(results)
    return {name: float(np.mean(combined[name])) for name in ("HOTA", "DetA", "AssA", "LocA")}


def main():
    with contextlib.redirect_stdout(sys.stderr):
        sequences = json.load(sys.stdin)
        scores = [{"motmetrics": motmetrics_scores(s), "trackeval": trackeval_scores(s)} for s in sequences]
        combined = trackeval_combined_hota(sequences)
    json.dump({"sequences": scores, "combined_hota": combined}, os.fdopen(1, "w"))


main()
