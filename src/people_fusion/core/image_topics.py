"""What the names of a camera's topics tell, as image_transport and image_proc give them."""

from __future__ import annotations

COMPRESSED, COMPRESSED_DEPTH = "/compressed", "/compressedDepth"


def without_transport(topic: str) -> str:
    """Base topic of an image transport's."""
    for transport in (COMPRESSED, COMPRESSED_DEPTH):
        if topic.endswith(transport):
            return topic[: -len(transport)]
    return topic


def camera_info_of(topic: str) -> str:
    """Topic of the CameraInfo beside an image's."""
    base = without_transport(topic)
    return f"{base.rsplit('/', 1)[0]}/camera_info" if "/" in base else "camera_info"


def is_rectified(topic: str) -> bool:
    """Whether the distortion has been taken out: image_rect_color of image_proc, image_color_rect of a Kinect 2."""
    return "rect" in without_transport(topic).rsplit("/", 1)[-1].split("_")
