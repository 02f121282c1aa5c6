"""sensor_msgs/PointCloud2 as what it holds, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField

from people_fusion.core.organised_clouds import OrganisedCloud, organised_cloud
from people_fusion.ros.conversions import header_to_msg

_POINT = np.dtype([("xyz", "<f4", 3), ("blue", "u1"), ("green", "u1"), ("red", "u1"), ("unused", "u1")])


def cloud_from_msg(message: Any) -> OrganisedCloud:
    """Organised cloud of a sensor_msgs/PointCloud2.

    Raises:
        DataError: it is not organised, has no coordinates, or less data than its size needs.
    """
    fields = {field.name: (field.offset, field.datatype) for field in message.fields}
    shape = message.height, message.width, message.point_step, message.row_step
    return organised_cloud(*shape, bool(message.is_bigendian), fields, message.data)


def cloud_to_msg(points: np.ndarray, colours: np.ndarray, stamp_ns: int, frame_id: str) -> PointCloud2:
    """sensor_msgs/PointCloud2 of points (N, 3), metres, with colours (N, 3) blue, green, red; not organised."""
    packed = np.zeros(len(points), dtype=_POINT)
    packed["xyz"] = points
    packed["blue"], packed["green"], packed["red"] = colours.T
    message = PointCloud2(header=header_to_msg(stamp_ns, frame_id), height=1, width=len(points), is_dense=True)
    message.fields = [PointField(axis, 4 * n, PointField.FLOAT32, 1) for n, axis in enumerate("xyz")]
    message.fields.append(PointField("rgb", 12, PointField.FLOAT32, 1))
    message.point_step = _POINT.itemsize
    message.row_step = _POINT.itemsize * len(points)
    message.data = packed.tobytes()
    return message
