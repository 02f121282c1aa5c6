#!/usr/bin/env python3
"""The RGB-D cue on real frames: who is found, how near to the masks' heads, and what stands in empty rooms.

`rgbd_person`: a person from the hips up before a wall; no floor is seen and no transform recorded: the camera is taken
to be level and CAMERA_HEIGHT over the floor. `rgbd_stills`: depth = (value - beta) / alpha metres; the floor is fitted
by RANSAC over all planes beneath the camera that are within 30 degrees of level, and taken for the transform.

A head is where its mask is topmost: the middle of the mask's first ROWS rows, at their median depth. Pictures go to
--out; they show people and are not to be committed.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.rgbd.rgbd import RgbdCue, RgbdCueConfig
from people_fusion.cues.rgbd.upper_bodies import HEAD_DROP

KINECT = Pinhole(640, 480, np.array([[525.0, 0.0, 320.0], [0.0, 525.0, 240.0], [0.0, 0.0, 1.0]]))
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # level_from_camera that looks along x
CAMERA_HEIGHT = 1.4
ROWS = 12  # of a mask that are the top of the head
TRIALS, INLIER = 400, 0.03
BOUND = 0.1  # metres from the mask's top


class Stand(TransformSource):
    """The camera stands."""

    def __init__(self, pose):
        self.pose = pose

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return self.pose


def points_of(depths):
    """(H, W, 3) of the camera's frame."""
    rows, columns = np.mgrid[0 : depths.shape[0], 0 : depths.shape[1]]
    rays = KINECT.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    return (rays / rays[:, 2:]).reshape(*depths.shape, 3) * depths[..., None]


def floor_pose(depths, rng):
    """level_from_camera, by the plane with most points beneath the camera."""
    points = points_of(depths)[depths.shape[0] // 2 :: 3, ::3].reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])] @ OPTICAL.T
    best, most = None, 0
    for _ in range(TRIALS):
        three = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        normal /= max(np.linalg.norm(normal), 1e-12) * (1.0 if normal[2] > 0 else -1.0)
        height = -normal @ three[0]
        if normal[2] < np.cos(np.radians(30.0)) or height < 0.4:
            continue
        heights = points @ normal + height
        count = (np.abs(heights) < INLIER).sum()
        if (heights < -3.0 * INLIER).mean() < 0.02 and count > most:  # nothing is beneath a floor
            best, most = (normal, height), count
    if best is None:
        return Pose(OPTICAL, np.array([0.0, 0.0, CAMERA_HEIGHT]))
    normal, height = best
    ahead = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
    ahead /= np.linalg.norm(ahead)
    level = np.stack([ahead, np.cross(normal, ahead), normal])
    return Pose(level @ OPTICAL, np.array([0.0, 0.0, height]))


def person_frames(folder):
    """Name, picture, depths, masks, pose."""
    pose = Pose(OPTICAL, np.array([0.0, 0.0, CAMERA_HEIGHT]))
    for path in sorted(folder.glob("*_depth.png")):
        name = path.name[: -len("_depth.png")]
        raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        depths = np.where(raw > 0, raw / np.float32(1000.0), np.nan).astype(np.float32)
        mask = cv2.imread(str(folder / f"{name}_mask.jpg"), cv2.IMREAD_GRAYSCALE) > 128
        yield name, cv2.imread(str(folder / f"{name}.jpg")), depths, [mask], pose


def stills(folder, rng):
    """The same of the stills."""
    for path in sorted(folder.glob("*_depth.png")):
        name = path.name[: -len("_depth.png")]
        raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        raw = raw if raw.ndim == 2 else raw[:, :, 0]
        storage = cv2.FileStorage(str(folder / f"{name}_depth_params.yaml"), cv2.FILE_STORAGE_READ)
        alpha, beta = storage.getNode("alpha").real(), storage.getNode("beta").real()
        depths = np.where(raw > 0, (raw - beta) / alpha, np.nan).astype(np.float32)
        users = cv2.imread(str(folder / f"{name}_user_mask.png"), cv2.IMREAD_GRAYSCALE)
        masks = [users == user for user in np.unique(users) if user]
        yield name, cv2.imread(str(folder / f"{name}_rgb.png")), depths, masks, floor_pose(depths, rng)


def head_of(mask, depths):
    """(3,) top of the head in the camera's frame: of the largest piece, as masks have crumbs."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    mask = labels == 1 + stats[1:, cv2.CC_STAT_AREA].argmax()
    first = np.flatnonzero(mask.any(axis=1))[0]
    rows, columns = np.nonzero(mask[first : first + ROWS] & np.isfinite(depths[first : first + ROWS]))
    depth = np.median(depths[rows + first, columns])
    column = np.median(np.flatnonzero(mask[first : first + ROWS].any(axis=0)))
    ray = KINECT.rays(np.array([[column, first]], dtype=float))[0]
    return ray / ray[2] * depth


def judge(cue, picture, depths, masks, pose):
    """Distances (masks,) of the head found nearest, metres, and the number of others."""
    found = cue.measure(DepthImage(0, "depth", depths, KINECT, picture), Stand(pose))
    up = pose.rotation[2]  # in the camera's frame
    tops = found.positions + HEAD_DROP * up
    distances, own = np.full(len(masks), np.nan), np.zeros(len(tops), dtype=bool)
    pixels = KINECT.project(found.positions).round().astype(int)
    for number, mask in enumerate(masks):
        mask = cv2.dilate(mask.astype(np.uint8), np.ones((31, 31), np.uint8)) > 0  # dark hair gives no returns
        inside = np.array([mask[min(v, 479), u] if 0 <= u < 640 and 0 <= v < 480 else False for u, v in pixels], bool)
        own |= inside
        if inside.any():
            ray = head_of(masks[number], depths)
            away = tops[inside] - ray
            ray = ray / np.linalg.norm(ray)
            across = away - (away @ ray)[:, None] * ray  # the mask's top is on the surface, not in the middle
            distances[number] = np.linalg.norm(across, axis=1).min()
    return found, distances, int((~own).sum()) + max(int(own.sum()) - int(np.isfinite(distances).sum()), 0)


def draw(picture, found, masks, look, pose):
    """The picture with masks' outlines, finds, and candidates that were none."""
    for mask in masks:
        outline = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        cv2.drawContours(picture, outline, -1, (255, 200, 0), 1)
    local = (look.candidates.middles - look.level_from_camera.translation) @ look.level_from_camera.rotation
    for u, v in KINECT.project(local):
        if np.isfinite(u + v):
            cv2.circle(picture, (int(u), int(v)), 4, (0, 0, 255), 1)
    for position, confidence in zip(found.positions, found.confidences):
        u, v = KINECT.project(position[None])[0]
        cv2.circle(picture, (int(u), int(v)), int(525 * 0.11 / position[2]), (0, 255, 0), 2)
        label = f"{confidence:.2f} {(pose.apply(position)[2] + HEAD_DROP):.2f} m"
        cv2.putText(picture, label, (int(u) + 12, int(v)), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 255, 0), 1)
    return picture


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("PEOPLE_FUSION_DATA", "../shared/data")))
    parser.add_argument("--out", type=Path, help="folder for pictures")
    parser.add_argument("--colour", action="store_true", help="look for heads in the colour image, too")
    parser.add_argument("--verbose", action="store_true", help="print what was found of each candidate near a find")
    options = parser.parse_args()
    if not (options.data / "rgbd_person").is_dir():
        sys.exit(f"{options.data}: no recordings; PEOPLE_FUSION_DATA names the folder")
    rng = np.random.default_rng(0)
    console, bad = Console(width=120), 0
    person, other = [], Table("still", "floor: height m, tilt deg", "people", "found", "head off m", "false")
    for kind, frames in (
        ("person", person_frames(options.data / "rgbd_person")),
        ("still", stills(options.data / "rgbd_stills", rng)),
    ):
        for name, picture, depths, masks, pose in frames:
            cue = RgbdCue(RgbdCueConfig(colour=options.colour), "kinect", FramesConfig())
            found, distances, false = judge(cue, picture, depths, masks, pose)
            hits = int(np.isfinite(distances).sum())
            bad += false > 0 or hits < len(masks) or bool((distances > BOUND).any())
            if kind == "person":
                person.append((name, hits, false, *distances))
            else:
                tilt = np.degrees(np.arccos(pose.rotation[2] @ OPTICAL[2]))
                off = ", ".join(f"{each:.2f}" for each in distances)
                placed = f"{pose.translation[2]:.2f}, {tilt:.1f}"
                other.add_row(name, placed, str(len(masks)), str(hits), off, str(false))
            if options.verbose:
                np.set_printoptions(precision=2, suppress=True, linewidth=160)
                look = cue.look
                for row in np.argsort(-look.confidences)[:8]:
                    each = look.candidates
                    console.print(name, each.middles[row], each.scores[row], each.widths[row], look.confidences[row])
            if options.out is not None:
                options.out.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(options.out / f"{kind}_{name}.jpg"), draw(picture, found, masks, cue.look, pose))
    offs = np.array([each[3] for each in person])
    hits, false = sum(each[1] for each in person), sum(each[2] for each in person)
    within = int((offs <= BOUND).sum())
    quantiles = np.nanquantile(offs, [0.5, 0.95, 1.0]).round(3).tolist()
    console.print(f"rgbd_person: found in {hits} of {len(person)} frames, {false} false or double; head within")
    console.print(f"{BOUND} m of the mask's top in {within}; distance median, 95 %, largest: {quantiles} m")
    console.print(other)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
