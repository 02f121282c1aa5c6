"""Measurements made by hand."""

import numpy as np
import pytest

from people_fusion.core.measurements import XY_OBSERVED, Measurement


@pytest.fixture(scope="session")
def detect():
    """Builds a laser measurement at a time in seconds from (x, y) positions, each of two legs 20 cm apart."""

    def build(time_s, *positions, std=0.05, cue="scan", sequence=0, **extra):
        positions = np.array(positions, dtype=float).reshape(-1, 2)
        count = len(positions)
        covariances = np.zeros((count, 3, 3))
        covariances[:, 0, 0] = covariances[:, 1, 1] = std**2
        legs = (positions[:, None] + np.array([[0.0, 0.1], [0.0, -0.1]])).reshape(-1, 2)
        return Measurement(
            stamp_ns=round(time_s * 1e9),
            cue=cue,
            modality="legs",
            frame_id="odom",
            positions=np.column_stack([positions, np.full(count, 0.4)]),
            covariances=covariances,
            confidences=np.full(count, 0.7),
            observed=XY_OBSERVED,
            period_s=0.1,
            sequence=sequence,
            legs=legs,
            leg_owners=np.repeat(np.arange(count), 2),
            **extra,
        )

    return build
