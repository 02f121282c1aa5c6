"""Run by the oracles' Python: composes, inverts and applies uncertain poses with GTSAM; JSON in, JSON out.

GTSAM's tangent is (rotation, translation), both in the child's axes; ours is (translation, rotation), both in the
parent's:  R Exp(w) = Exp(R w) R  and  t + R v,  hence  (w, v) = [[0, R'], [R', 0]] (xyz, rot).
"""

import json
import sys

import gtsam
import numpy as np


def ours_from_theirs(pose):
    matrix, R = np.zeros((6, 6)), pose.rotation().matrix()
    matrix[:3, 3:] = matrix[3:, :3] = R
    return matrix


def theirs(covariance, pose):
    M = ours_from_theirs(pose).T  # its inverse
    return M @ covariance @ M.T


def ours(covariance, pose):
    M = ours_from_theirs(pose)
    return (M @ covariance @ M.T).tolist()


def answer(case):
    given = (case["a"], case["b"])
    a, b = (gtsam.Pose3(gtsam.Rot3(np.array(pose["rotation"])), np.array(pose["translation"])) for pose in given)
    C_a, C_b = theirs(np.array(case["a"]["covariance"]), a), theirs(np.array(case["b"]["covariance"]), b)
    H_a, H_b, H_i = (np.zeros((6, 6), order="F") for _ in range(3))
    H_p, H_x = np.zeros((3, 6), order="F"), np.zeros((3, 3), order="F")
    composed, inverted = a.compose(b, H_a, H_b), a.inverse(H_i)
    point = a.transformFrom(np.array(case["point"]), H_p, H_x)
    return {
        "composed": composed.matrix().tolist(),
        "composed_covariance": ours(H_a @ C_a @ H_a.T + H_b @ C_b @ H_b.T, composed),
        "inverted": inverted.matrix().tolist(),
        "inverted_covariance": ours(H_i @ C_a @ H_i.T, inverted),
        "point": point.tolist(),
        "point_covariance": (H_p @ C_a @ H_p.T + H_x @ np.array(case["point_covariance"]) @ H_x.T).tolist(),
    }


json.dump([answer(case) for case in json.load(sys.stdin)], sys.stdout)
