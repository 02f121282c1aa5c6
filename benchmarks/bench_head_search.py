#!/usr/bin/env python3
"""What it saves to look for people only where they can be, and what it costs.

Real people, cut out of stills, stand at known places in a real room, seen by a camera of 640x480 and by a panorama of
1406x240. Each detector looks everywhere in its range of sizes, then where people who sit or stand on the floor may be
seen (ground), then where those who stand may (standing), then around the people's tracks (tracks). Times are those of
the process on one core, end to end in the cue; ratios are of the same run. A find is right if it is where the
detector's part of somebody is, in that size.

The stills are those of `rgbd_stills`, the networks those of `models` in the directory of recordings.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from people_fusion.core.camera_models import Panorama, PanoramaConfig, Pinhole
from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.heads.detector import DETECTORS
from people_fusion.cues.heads.heads import HeadCue, HeadCueConfig

PEOPLE = ("alberto1", "alvaro1", "juggling1")  # who stand upright and whole
TALL, HEAD_BELOW = 1.75, 0.12  # metres; of the middle of the head below the top
DISTANCES = (1.5, 6.0)
TRACK_STD = 0.15  # metres
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
DETECTORS_COMPARED = ("haar_face", "haar_profile", "haar_upper_body", "hog_body", "fhog_head", "dnn_face", "dnn_body")
MODELS = {"dnn_face": "yunet_n_320_320.onnx", "dnn_body": "yolo-fastest-1.1_body.weights"}
FINEST = {"panorama": {"hog_body": {"enlarge": 2.0}}}  # where people are small
WAYS = {
    "everywhere": {"by_ground": False},
    "ground": {},
    "standing": {"head_heights": [1.4, 2.0]},
    "tracks": {"full_every": 10**6},
}


class Scene(NamedTuple):
    pixels: np.ndarray
    heads: np.ndarray  # (P, 3), in the level frame under the camera, metres


class Mast(TransformSource):
    """A robot that stands, with the camera above its middle."""

    def __init__(self, rotation, height):
        self.pose = Pose(rotation, np.array([0.0, 0.0, height]))

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return self.pose


class Setting(NamedTuple):
    camera: object
    mast: Mast
    bearings: float  # people stand to both sides of the front by so much at most, radians
    people: int


def settings():
    pinhole = Pinhole(640, 480, np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]]))
    return {
        "640x480": Setting(pinhole, Mast(OPTICAL, 1.3), 0.45, 2),
        "panorama": Setting(Panorama(PanoramaConfig()), Mast(np.eye(3), 1.67), math.pi, 4),
    }


def cut_outs(folder):
    """People of BGR and opacity, without margins."""
    people = []
    for name in PEOPLE:
        pixels, mask = (cv2.imread(str(folder / f"{name}_{part}.png")) for part in ("rgb", "user_mask"))
        mask = (mask.max(axis=2) > 0).astype(np.uint8)
        mask = cv2.resize(mask, pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
        body = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
        left, top, width, height = stats[body, :4]
        piece = np.s_[top : top + height, left : left + width]
        opacity = cv2.GaussianBlur((labels == body).astype(np.float32), (5, 5), 0)
        people.append((pixels[piece].astype(np.float32), opacity[piece]))
    return people


def backdrop(folder, camera, rng):
    room = cv2.imread(str(folder / "empty_lab_rgb.png"))
    count = max(round(camera.width / camera.height / (room.shape[1] / room.shape[0])), 1)
    tiles = [room[:, ::-1] if (tile + rng.integers(2)) % 2 else room for tile in range(count)]
    return cv2.resize(np.hstack(tiles), (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def make_scene(setting, people, folder, rng):
    """People in the room, the farthest first; nobody before somebody else's face."""
    camera, mast = setting.camera, setting.mast
    canvas = backdrop(folder, camera, rng).astype(np.float32)
    edges = np.linspace(-setting.bearings, setting.bearings, setting.people + 1)
    bearings = rng.uniform(edges[:-1] + 0.1, edges[1:] - 0.1)
    distances = np.exp(rng.uniform(*np.log(DISTANCES), setting.people))
    heights = rng.normal(TALL, 0.07, setting.people)
    for person in np.argsort(-distances):
        foot = distances[person] * np.array([math.cos(bearings[person]), math.sin(bearings[person]), 0.0])
        ends = np.array([foot, foot + [0.0, 0.0, heights[person]]])
        bottom, top = camera.project((ends - mast.pose.translation) @ mast.pose.rotation)
        pixels, opacity = people[rng.integers(len(people))]
        factor = (bottom[1] - top[1]) / len(opacity)
        size = max(round(opacity.shape[1] * factor), 1), max(round(len(opacity) * factor), 1)
        way = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
        pixels, opacity = cv2.resize(pixels, size, interpolation=way), cv2.resize(opacity, size, interpolation=way)
        if rng.integers(2):
            pixels, opacity = pixels[:, ::-1], opacity[:, ::-1]
        paste(canvas, pixels * rng.uniform(0.7, 1.1), opacity, round(top[0] - size[0] / 2), round(top[1]), camera.wraps)
    canvas += rng.normal(0.0, 3.0, canvas.shape)
    across = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    heads = np.column_stack([distances[:, None] * across, heights - HEAD_BELOW])
    return Scene(canvas.clip(0, 255).astype(np.uint8), heads)


def paste(canvas, pixels, opacity, left, top, wraps):
    rows = top + np.arange(len(opacity))
    columns = left + np.arange(opacity.shape[1])
    inside = (rows >= 0) & (rows < len(canvas)), (columns >= 0) & (columns < canvas.shape[1]) | wraps
    place = np.ix_(rows[inside[0]], columns[inside[1]] % canvas.shape[1])
    part = np.ix_(*inside)
    share = opacity[part][..., None]
    canvas[place] = (1.0 - share) * canvas[place] + share * pixels[part]


def parts(heads, setting, box):
    """(P, 4) boxes in which the detector's part of people is; NaN in what isn't wholly in the image."""
    camera, pose = setting.camera, setting.mast.pose
    middles = heads - pose.translation - [0.0, 0.0, box.head_above]
    up = [0.0, 0.0, 0.5 * box.height]
    top, bottom = (camera.project(ends @ pose.rotation) + 0.5 for ends in (middles + up, middles - up))
    column, half = top[:, 0], 0.5 * (bottom[:, 1] - top[:, 1])
    corners = np.column_stack([column - half, top[:, 1], column + half, bottom[:, 1]])
    corners[(top[:, 1] < 0.0) | (bottom[:, 1] > camera.height)] = np.nan
    return corners


def right(found, wanted, camera):
    """(P,) whether somebody's part is found, and the number of finds that are nobody's."""
    middles = [0.5 * (boxes[:, :2] + boxes[:, 2:]) for boxes in (found, wanted)]
    away = np.abs(middles[0][:, None] - middles[1][None])
    if camera.wraps:
        away[..., 0] = np.minimum(away[..., 0], camera.width - away[..., 0])
    heights = [boxes[:, 3] - boxes[:, 1] for boxes in (found, wanted)]
    with np.errstate(invalid="ignore"):
        fits = (away < 0.5 * heights[1][None, :, None]).all(axis=2)
        fits &= np.abs(np.log(heights[0][:, None] / heights[1][None])) < math.log(1.5)
    return fits.any(axis=0), int((~fits.any(axis=1)).sum())


def believed(heads, stamp_ns, rng):
    count = len(heads)
    means = np.column_stack([heads + rng.normal(0.0, TRACK_STD, heads.shape), np.zeros((count, 2))])
    covariances = np.tile(np.diag([TRACK_STD**2] * 3 + [0.04] * 2), (count, 1, 1))
    flags, ones = np.ones(count, dtype=bool), np.ones(count)
    return Tracks(stamp_ns, "odom", np.arange(count), means, covariances, ones, flags, flags, ~flags, ones)


def run(name, setting, scenes, parameters, seed):
    """Of each way: milliseconds per image, people found, those that could be, and false finds."""
    box = DETECTORS.build(parse(DETECTORS.config_of(name, name), parameters)).box
    rows = {}
    for way, limits in WAYS.items():
        mapping = {"detector": {"type": name, **parameters}, **limits}
        cue = HeadCue(parse(HeadCueConfig, mapping), name=name, frames=FramesConfig(odom="odom"))
        rng, times, found, there, false = np.random.default_rng(seed), [], 0, 0, 0
        for index, scene in enumerate(scenes):
            image = Image(index * NANOSECONDS, "camera", scene.pixels, setting.camera)
            if way == "tracks":
                cue.set_tracks(believed(scene.heads, image.stamp_ns, rng))
            began = time.process_time()
            cue.measure(image, setting.mast)
            times.append(1e3 * (time.process_time() - began))
            wanted = parts(scene.heads, setting, box)
            hits, others = right(cue.look.boxes.corners[cue.look.kept], wanted, setting.camera)
            found, there, false = found + int(hits.sum()), there + int(np.isfinite(wanted[:, 0]).sum()), false + others
        rows[way] = {"ms": float(np.median(times)), "found": found, "there": there, "false": false}
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("PEOPLE_FUSION_DATA", Path(__file__).resolve().parents[2] / "shared/data"))
    parser.add_argument("--data", type=Path, default=default, help="directory of the recordings")
    parser.add_argument("--images", type=int, default=40, help="per camera (default: 40)")
    parser.add_argument("--detectors", nargs="+", default=DETECTORS_COMPARED, metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write the first image of each camera")
    arguments = parser.parse_args()
    folder = arguments.data / "rgbd_stills"
    if not folder.is_dir():
        parser.error(f"{folder} is not there")
    cv2.setNumThreads(1)

    people, numbers = cut_outs(folder), {}
    print("                             ms/image  times faster    found of there   false/image")
    for camera, setting in settings().items():
        rng = np.random.default_rng(arguments.seed)
        scenes = [make_scene(setting, people, folder, rng) for _ in range(arguments.images)]
        if arguments.picture:
            cv2.imwrite(str(arguments.picture.with_name(f"{camera}_{arguments.picture.name}")), scenes[0].pixels)
        for name in arguments.detectors:
            if name not in DETECTORS.names():
                continue
            parameters = dict(FINEST.get(camera, {}).get(name, {}))
            if name in MODELS:
                parameters["model"] = str(arguments.data / "models" / MODELS[name])
            try:
                rows = run(name, setting, scenes, parameters, arguments.seed)
            except ConfigError as error:
                print(f"{camera:9s} {name:16s} left out: {error}")
                continue
            numbers[f"{camera} {name}"] = rows
            for way, row in rows.items():
                print(
                    f"{camera:9s} {name:16s} {way:10s} {row['ms']:7.1f} {rows['everywhere']['ms'] / row['ms']:12.1f} "
                    f"{row['found']:8d} {row['there']:8d} {row['false'] / len(scenes):13.2f}"
                )
    if arguments.json:
        arguments.json.write_text(json.dumps({"images": arguments.images, "rows": numbers}, indent=2) + "\n")


if __name__ == "__main__":
    main()
