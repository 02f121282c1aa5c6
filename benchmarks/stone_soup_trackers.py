"""Stone Soup's global nearest neighbour and JPDA on given detections; runs in the oracles' own environment.

Reads from standard input a JSON list of scans, {"time_s": ..., "positions": [[x, y], ...], "std": ...}; writes to
standard output {"tracks": [[[id, x, y], ...] per scan], "seconds": processing time}.
"""

import argparse
import datetime
import json
import sys
import time

import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDA
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.deleter.multi import CompositeDeleter
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

START = datetime.datetime(2020, 1, 1)


def build(method, detector, std):
    """The trackers of Stone Soup's own tutorials, with the noises of people."""
    transition = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.5), ConstantVelocity(0.5)])
    measurement = LinearGaussian(4, (0, 2), np.diag([std**2, std**2]))
    predictor, updater = KalmanPredictor(transition), KalmanUpdater(measurement)
    nearest = GNNWith2DAssignment(DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=3.4))
    deleters = [CovarianceBasedDeleter(1.0, mapping=[0, 2]), UpdateTimeStepsDeleter(10)]
    deleter = CompositeDeleter(deleters, intersect=False)
    initiator = MultiMeasurementInitiator(
        GaussianState([[0], [0], [0], [0]], np.diag([0.0, 1.0, 0.0, 1.0])),
        measurement_model=measurement,
        deleter=deleter,
        data_associator=nearest,
        updater=updater,
        min_points=3,
    )
    if method == "gnn":
        return MultiTargetTracker(initiator, deleter, detector, nearest, updater)
    joint = JPDA(PDAHypothesiser(predictor, updater, clutter_spatial_density=0.005, prob_detect=0.9, prob_gate=0.99))
    return MultiTargetMixtureTracker(initiator, deleter, detector, joint, updater)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("method", choices=("gnn", "jpda"))
    method = parser.parse_args().method
    scans = json.load(sys.stdin)
    std = scans[0]["std"]
    measurement = LinearGaussian(4, (0, 2), np.diag([std**2, std**2]))
    feed = []
    for scan in scans:
        when = START + datetime.timedelta(seconds=scan["time_s"])
        positions = scan["positions"]
        feed.append((when, {Detection(np.array(p)[:, None], when, measurement_model=measurement) for p in positions}))
    identities, output = {}, []
    began = time.process_time()
    for _, tracks in build(method, feed, std):
        rows = []
        for track in tracks:
            number = identities.setdefault(track.id, len(identities) + 1)
            mean = np.asarray(track.state.mean, dtype=float).ravel()
            rows.append([number, mean[0], mean[2]])
        output.append(rows)
    json.dump({"tracks": output, "seconds": time.process_time() - began}, sys.stdout)


if __name__ == "__main__":
    main()
