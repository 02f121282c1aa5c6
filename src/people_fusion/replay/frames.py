"""Pictures in their order: of a folder, of a video, of a topic of a bag; and annotated ones written likewise."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Iterator, List, Optional

import numpy as np

from people_fusion.core.errors import ConfigError, DataError, RecordingError
from people_fusion.core.image_topics import without_transport
from people_fusion.core.pixels import compressed_pixels, raw_pixels
from people_fusion.replay.recording import Recording, Topic

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".tif", ".tiff")
VIDEOS = {".avi": "MJPG", ".mp4": "mp4v", ".mkv": "MJPG"}  # codec by what a file is called


class Frames:
    """Pictures (H, W) or (H, W, 3) blue, green, red, uint8; to be gone through once.

    Args:
        path: folder, bag or video.
        topic: of a bag, if it has several cameras.

    Attributes:
        count: of pictures, None where the file does not tell.
        fps: pictures a second, as recorded; 25 where that is not known.

    Raises:
        RecordingError: there is nothing to read, or the topic is missing or open to choice.
    """

    def __init__(self, path: Path, topic: Optional[str] = None) -> None:
        self.path, self.fps = path, 25.0
        self.count: Optional[int] = None
        if topic is not None and path.suffix != ".bag":
            raise ConfigError(f"--image: {path} is no bag")
        if path.is_dir():
            self._pictures = self._of_folder()
        elif path.suffix == ".bag":
            self._pictures = self._of_bag(topic)
        elif path.is_file():
            self._pictures = self._of_video()
        else:
            raise RecordingError(f"{path}: no such file or folder")

    def __iter__(self) -> Iterator[np.ndarray]:
        return self._pictures

    def _of_folder(self) -> Iterator[np.ndarray]:
        import cv2  # 100 MB: not for those who see no images

        names = sorted(each for each in self.path.iterdir() if each.suffix.lower() in PICTURES)
        if not names:
            raise RecordingError(f"{self.path}: no pictures ({', '.join(PICTURES)}) in this folder")
        self.count = len(names)

        def pictures() -> Iterator[np.ndarray]:
            for name in names:
                pixels = cv2.imread(str(name), cv2.IMREAD_COLOR)
                if pixels is None:
                    raise RecordingError(f"{name}: not a readable picture")
                yield np.asarray(pixels)

        return pictures()

    def _of_video(self) -> Iterator[np.ndarray]:
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        good, first = capture.read()
        if not good:
            raise RecordingError(f"{self.path}: not a video that OpenCV reads, nor a bag (*.bag)")
        count, fps = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
        self.count = int(count) if count > 0 else None
        self.fps = float(fps) if 0.1 < fps < 1000.0 else self.fps

        def pictures() -> Iterator[np.ndarray]:
            pixels, more = first, True
            while more:
                yield np.asarray(pixels)
                more, pixels = capture.read()

        return pictures()

    def _of_bag(self, wanted: Optional[str]) -> Iterator[np.ndarray]:
        with Recording(self.path) as recording:
            topic = _camera(recording, wanted)
            times = recording.end_ns - recording.start_ns
        self.count, self.fps = topic.count, min(max(topic.count / (1e-9 * times), 1.0), 1000.0)

        def pictures() -> Iterator[np.ndarray]:
            with Recording(self.path) as opened:
                for message in opened.messages([topic]):
                    try:
                        yield _pixels(message.read())
                    except DataError as error:
                        raise RecordingError(f"{self.path}: {topic.name}: {error}") from error

        return pictures()


class Writer:
    """Annotated pictures into a video, by the name's ending, or as PNG into a folder; a context manager.

    Raises:
        RecordingError: it cannot be written.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self.path, self._fps, self._count = path, fps, 0
        self._video: Any = None
        try:
            (path.parent if path.suffix in VIDEOS else path).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from error

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._video is not None:
            self._video.release()

    def write(self, pixels: np.ndarray) -> None:
        """Append a picture (H, W, 3); those of a video are all of the first one's size."""
        import cv2

        self._count += 1
        if self.path.suffix not in VIDEOS:
            name = self.path / f"{self._count:06d}.png"
            if not cv2.imwrite(str(name), pixels):
                raise RecordingError(f"{name}: cannot be written")
            return
        if self._video is None:
            codec = cv2.VideoWriter.fourcc(*VIDEOS[self.path.suffix])
            self._size = pixels.shape[1::-1]
            self._video = cv2.VideoWriter(str(self.path), codec, self._fps, self._size)
            if not self._video.isOpened():
                raise RecordingError(f"{self.path}: OpenCV cannot write this video")
        self._video.write(pixels if pixels.shape[1::-1] == self._size else cv2.resize(pixels, self._size))


def _camera(recording: Recording, wanted: Optional[str]) -> Topic:
    there: List[Topic] = [
        topic for topic in recording.of_kind("Image", "CompressedImage") if not topic.name.endswith("/compressedDepth")
    ]
    names = ", ".join(topic.name for topic in there) or "none"
    if wanted is not None:
        there = [each for each in there if wanted.strip("/") in (each.name[1:], without_transport(each.name)[1:])]
    if not there:
        missing = "no images" if wanted is None else f"no images {wanted}"
        raise RecordingError(f"{recording.path}: {missing} in this bag; there are {names}")
    if len({without_transport(topic.name) for topic in there}) > 1:
        raise RecordingError(f"{recording.path}: which images? --image takes one of {names}")
    return there[0]


def _pixels(message: Any) -> np.ndarray:
    if not hasattr(message, "encoding"):
        return compressed_pixels(message.data)
    shape = message.height, message.width, message.step
    return raw_pixels(*shape, message.encoding, bool(message.is_bigendian), message.data)
