"""Camera models: where in the image a point of the world is seen, and along which ray a pixel looks.

Pixels are (u, v), u to the right and v down; the middle of the upper left pixel is (0, 0), as in CameraInfo.
"""

from __future__ import annotations

import abc

import numpy as np

from people_fusion.core.errors import DataError


class Camera(abc.ABC):
    """A calibrated camera.

    Attributes:
        width, height: of the image, pixels.
        wraps: whether the right edge of the image is the left one's neighbour (a full panorama).
    """

    width: int
    height: int
    wraps: bool = False

    @abc.abstractmethod
    def project(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) pixels of points (N, 3) of the camera's frame, metres; NaN where the model does not reach (behind a
        pinhole). Pixels may lie outside the image."""

    @abc.abstractmethod
    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) unit vectors of the camera's frame along which pixels (N, 2) look; NaN where the model is not to be
        inverted."""

    @abc.abstractmethod
    def ray_jacobians(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3, 2) derivative of `rays` by the pixel, radians per pixel."""

    def resized(self, width: int, height: int) -> Camera:
        """This camera with images of another resolution of the same shape, binned or scaled.

        Raises:
            DataError: the shape is another.
        """
        if (width, height) == (self.width, self.height):
            return self
        # A row or column that did not go into the bins may be missing.
        if min(width, height) < 1 or abs(width * self.height - height * self.width) >= max(self.width, self.height):
            raise DataError(
                "image of another shape than its camera's", f"{width} x {height}, camera {self.width} x {self.height}"
            )
        return self._scaled(width, height)

    def _scaled(self, width: int, height: int) -> Camera:
        raise DataError("image of another size than its camera's", f"{width} x {height}")
