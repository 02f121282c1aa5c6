"""HeadScores to messages and back. Features travel as bytes: a step is the 255th part of what a layer's span."""

from __future__ import annotations

import dataclasses
from typing import Any, Mapping, Optional

import numpy as np
from sensor_msgs.msg import CameraInfo

from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError
from people_fusion.core.head_scores import HeadScores, ScoreLayer, ScoreWindow
from people_fusion.core.measurements import Measurement
from people_fusion.msg import HeadScoreLayer
from people_fusion.msg import HeadScores as HeadScoresMsg
from people_fusion.ros.conversions import measurement_from_msg, measurement_to_msg
from people_fusion.ros.images import camera_from_msg

LEVELS = 255
LARGEST = 1 << 14  # rows, columns or dimensions of anything
MATRICES = "D", "K", "R", "P"


def scores_to_msg(measurement: Measurement, camera_info: Optional[Any], rectified: bool) -> Any:
    """people_fusion/HeadScores of a measurement with scores, for publishers of rospy's numpy_msg.

    Args:
        measurement: in its camera's frame.
        camera_info: sensor_msgs/CameraInfo of the camera; None of a panorama.
        rectified: whether its images are.
    """
    scores = measurement.scores
    assert scores is not None
    detections = measurement_to_msg(measurement)
    detections.scored = True
    for person in detections.detections:
        person.pose.covariance = np.array(person.pose.covariance)
    detections.sight_ranges = np.array(detections.sight_ranges, dtype=np.float32)
    detections.leg_owners = np.array(detections.leg_owners, dtype=np.uint32)
    info = camera_info if camera_info is not None else CameraInfo()
    for name in MATRICES:
        setattr(info, name, np.array(getattr(info, name), dtype=float))
    window = scores.window
    return HeadScoresMsg(
        detections=detections,
        camera_info=info,
        rectified=rectified,
        width=scores.camera.width,
        height=scores.camera.height,
        window_rows=window.rows,
        window_cols=window.cols,
        window_cell=window.cell,
        window_box=np.array(window.box),
        platt_slope=scores.platt_slope,
        head_height=scores.height,
        head_above=scores.head_above,
        beyond=scores.beyond,
        corners=scores.corners.ravel(),
        box_scores=scores.box_scores.astype(float),
        layers=[_layer_to_msg(layer) for layer in scores.layers],
    )


def scored_from_msg(message: Any, panoramas: Mapping[str, Camera]) -> Measurement:
    """Measurement, with its scores, of a people_fusion/HeadScores, in the camera's frame.

    Args:
        message: what a head cue tells.
        panoramas: cameras by frame that no CameraInfo can describe.

    Raises:
        DataError: names the first thing that is wrong; no part of the message is taken then.
    """
    measurement = measurement_from_msg(message.detections)
    window = ScoreWindow(message.window_rows, message.window_cols, message.window_cell, tuple(message.window_box))
    corners, box_scores = np.array(message.corners, dtype=float), np.array(message.box_scores, dtype=float)
    numbers = [message.platt_slope, message.head_height, message.head_above, *window.box, *corners, *box_scores]
    if not np.isfinite(numbers).all():
        raise DataError("scores of heads are not finite")
    if not (min(window[:3]) > 0 and max(window[:3]) <= LARGEST and window.head_height > 0.0):
        raise DataError("scores of an impossible window", f"{window}")
    if not message.head_height > 0.0 or message.platt_slope >= 0.0:
        raise DataError("scores of impossible heads", f"{message.head_height} m, slope {message.platt_slope}")
    if len(corners) != 4 * len(measurement) or len(box_scores) != len(measurement):
        raise DataError("scores do not fit the detections", f"{len(corners)} corners, {len(measurement)} detections")
    scores = HeadScores(
        camera=_camera(message, panoramas),
        window=window,
        platt_slope=message.platt_slope,
        height=message.head_height,
        head_above=message.head_above,
        beyond=message.beyond,
        layers=tuple(_layer_from_msg(layer, window) for layer in message.layers),
        corners=corners.reshape(-1, 4),
        box_scores=box_scores,
    )
    return dataclasses.replace(measurement, scores=scores)


def _camera(message: Any, panoramas: Mapping[str, Camera]) -> Camera:
    frame_id = message.detections.header.frame_id.lstrip("/")
    if message.camera_info.width:
        camera = camera_from_msg(message.camera_info, message.rectified)
    elif frame_id in panoramas:
        camera = panoramas[frame_id]
    else:
        raise DataError("scores of a panorama that the preset does not describe", frame_id)
    return camera.resized(message.width, message.height)


def _layer_to_msg(layer: ScoreLayer) -> Any:
    features = layer.features
    lowest, step, levels = 0.0, 0.0, b""
    if features.size:
        lowest = float(features.min())
        step = max((float(features.max()) - lowest) / LEVELS, 1e-9)
        levels = np.rint((features - np.float32(lowest)) * np.float32(1.0 / step)).astype(np.uint8).tobytes()
    return HeadScoreLayer(
        scale_x=float(layer.scale[0]),
        scale_y=float(layer.scale[1]),
        row=layer.row,
        col=layer.col,
        rows=layer.scores.shape[0],
        cols=layer.scores.shape[1],
        scores=np.ascontiguousarray(layer.scores, dtype=np.float32).ravel(),
        dimensions=features.shape[2] if features.size else 0,
        lowest=lowest,
        step=step,
        features=levels,
    )


def _layer_from_msg(message: Any, window: ScoreWindow) -> ScoreLayer:
    rows, cols, dimensions = message.rows, message.cols, message.dimensions
    scale = np.array([message.scale_x, message.scale_y])
    scores = _array(message.scores, np.float32)
    cells = (rows + window.rows - 1, cols + window.cols - 1, dimensions)
    if not (np.isfinite(scale).all() and (scale > 0.0).all() and np.isfinite([message.lowest, message.step]).all()):
        raise DataError("scores of an impossible layer", f"scale {scale}")
    if max(*cells, rows, cols) > LARGEST or len(scores) != rows * cols or not np.isfinite(scores).all():
        raise DataError("scores of an impossible layer", f"{len(scores)} scores of {rows} x {cols} windows")
    features = np.zeros((0, 0, dimensions), dtype=np.float32)
    if dimensions:
        levels = _array(message.features, np.uint8)
        if len(levels) != cells[0] * cells[1] * cells[2]:
            raise DataError("scores of an impossible layer", f"{len(levels)} features of {cells} cells")
        features = (levels.astype(np.float32) * np.float32(message.step) + np.float32(message.lowest)).reshape(cells)
    return ScoreLayer(scale, message.row, message.col, scores.reshape(rows, cols), features)


def _array(values: Any, kind: Any) -> np.ndarray:
    """Of what rospy gives: an array, bytes or a list."""
    return np.frombuffer(values, kind) if isinstance(values, (bytes, bytearray)) else np.asarray(values, dtype=kind)
