#!/usr/bin/env python3
"""Processor time of the whole head cue on a panorama of 1406x240 that comes 9 times a second, as a share of one core.

Compressed images as they come from a camera driver: decoded, searched where people on the floor may be seen, finds made
heads in space. The images are rendered, of the museum (docs/cameras.md); the robot stands. OpenCV's HOG people detector
looks at the same images, decoded, with its default stride and Volkhardt's pyramid step of 1.1: a base to compare
machines by. Times are of the process, the mean over images, the least over rounds. Exits with 1 where fhog_head needs
more than its bound.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import sys
import time

import cv2

from people_fusion.core.config import parse
from people_fusion.core.images import Image
from people_fusion.core.pixels import compressed_pixels
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.heads.heads import HeadCue, HeadCueConfig
from people_fusion.cues.heads.native import is_native
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import Simulation

RATE, BOUND = 9.0, 0.6  # images a second; share of one core
EVERY_S = 2.0
CUES = {
    "fhog_head": ("fhog_head",),
    "haar_face": ("haar_face",),
    "haar_upper_body": ("haar_upper_body",),
    "haar_face + haar_upper_body": ("haar_face", "haar_upper_body"),
}


class Mast(TransformSource):
    """The robot stands at the origin."""

    def __init__(self, pose):
        self.pose = pose

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return self.pose


def messages(count, seed):
    """Compressed images of the museum, and the simulated camera."""
    scenario = dataclasses.replace(load_scenario("museum_cameras"), duration_s=EVERY_S * (count + 1))
    simulation = Simulation(scenario, seed)
    (camera,) = simulation.cameras
    pictures = (camera.picture(simulation.history, EVERY_S * (number + 1), 0) for number in range(count))
    quality = [cv2.IMWRITE_JPEG_QUALITY, scenario.cameras[0].quality]
    return [cv2.imencode(".jpg", picture.pixels, quality)[1].tobytes() for picture in pictures], camera


def milliseconds(rounds, images, look):
    """Least mean time."""
    means = []
    for _ in range(rounds):
        began = time.process_time()
        for number, image in enumerate(images):
            look(number, image)
        means.append(1e3 * (time.process_time() - began) / len(images))
    return min(means)


def main():
    """Entry."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=20)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    looked_at, simulated = messages(options.images, options.seed)
    config = simulated.config
    mast = Mast(config.base_from_camera)
    hog = cv2.HOGDescriptor()
    hog.setSVMDetector(cv2.HOGDescriptor.getDefaultPeopleDetector())

    def bodies(_, grey):
        hog.detectMultiScale(grey, winStride=(8, 8), scale=1.1)

    greys = [cv2.cvtColor(compressed_pixels(each), cv2.COLOR_BGR2GRAY) for each in looked_at]
    base_ms = milliseconds(1, greys, bodies)
    decoding_ms = milliseconds(options.rounds, looked_at, lambda _, each: compressed_pixels(each))
    width, height = simulated.camera.width, simulated.camera.height
    print(f"{options.images} images of {width}x{height}, {RATE:.0f} a second; "
          f"kernel {'in C' if is_native() else 'missing: NumPy'}; images decoded in {decoding_ms:.1f} ms")
    print("                                  ms an image   of one core   times as fast as OpenCV's HOG")
    shares = {}
    for name, detectors in CUES.items():
        cues = [
            HeadCue(parse(HeadCueConfig, {"detector": {"type": each}}), name=each, frames=FramesConfig(odom="odom"))
            for each in detectors
        ]

        def look(number, message, cues=cues):
            stamp_ns = round(number / RATE * NANOSECONDS)
            image = Image(stamp_ns, config.frame, compressed_pixels(message), simulated.camera)
            for cue in cues:
                cue.measure(image, mast)

        spent_ms = milliseconds(options.rounds, looked_at, look)
        shares[name] = 1e-3 * RATE * spent_ms
        print(f"{name:30s} {spent_ms:14.1f} {shares[name]:12.0%} {base_ms / spent_ms:18.1f}")
    print(f"{'(HOG itself)':30s} {base_ms:14.1f} {1e-3 * RATE * base_ms:12.0%}")
    held = shares["fhog_head"] < BOUND
    print(f"fhog_head within {BOUND:.0%} of one core: {'held' if held else 'NOT HELD'}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
