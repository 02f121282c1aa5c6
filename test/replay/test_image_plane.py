"""People and tracks as boxes in a camera's image (Volkhardt et al. 2013, IV), from recordings."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest
from bags import PERIOD_S, START_NS, BagBuilder

from people_fusion.core.camera_models import Panorama, PanoramaConfig, Pinhole
from people_fusion.core.errors import RecordingError
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import from_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.core.transform_tree import TransformTree
from people_fusion.replay import evaluate_tracks, replay_bag
from people_fusion.replay.ground_truth import Instant
from people_fusion.replay.image_plane import STANDING_M, View, read_view, score_in_image
from people_fusion.replay.track_bag import TrackWriter

IMAGE, PANORAMA = "/camera/image_raw", "/panorama/image_raw"
AT = (0.0, 0.0, 1.2)  # of both cameras, in map
OPTICAL = (-0.5, 0.5, -0.5, 0.5)  # x y z w of a camera that looks along x
FOCAL, WIDTH, HEIGHT = 400.0, 640, 480
K = [FOCAL, 0.0, 319.5, 0.0, FOCAL, 239.5, 0.0, 0.0, 1.0]
PANORAMAS = {"panorama": PanoramaConfig()}
STEPS = 5
Place = Tuple[float, ...]


def info(bag: BagBuilder, topic: str = "/camera/camera_info", k: Sequence[float] = K) -> None:
    region = bag.make("sensor_msgs/RegionOfInterest", 0, 0, 0, 0, False)
    projection = np.array([*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0])
    fields = (HEIGHT, WIDTH, "plumb_bob", np.zeros(0), np.array(k), np.eye(3).ravel(), projection, 0, 0, region)
    bag.add(topic, "sensor_msgs/CameraInfo", 0.0, bag.header(0.0, "camera"), *fields)


def image(bag: BagBuilder, topic: str, frame: str, compressed: bool = False) -> None:
    if compressed:
        name, kind, fields = f"{topic}/compressed", "sensor_msgs/CompressedImage", ("jpeg", np.zeros(1, np.uint8))
        bag.add(name, kind, 0.0, bag.header(0.0, frame), *fields)
    else:
        pixels = np.zeros(3, np.uint8)
        bag.add(topic, "sensor_msgs/Image", 0.0, bag.header(0.0, frame), 1, 1, "bgr8", 0, 3, pixels)


def mount(bag: BagBuilder, seconds: float, child: str, rotation: Place) -> None:
    turn = bag.make("geometry_msgs/Quaternion", *rotation)
    transform = bag.make("geometry_msgs/Transform", bag.make("geometry_msgs/Vector3", *AT), turn)
    link = bag.make("geometry_msgs/TransformStamped", bag.header(seconds, "map"), child, transform)
    bag.add("/tf", "tf2_msgs/TFMessage", seconds, [link])


def people(bag: BagBuilder, seconds: float, places: Sequence[Place]) -> None:
    persons = [bag.make("leg_tracker/Person", bag.pose(*place), i) for i, place in enumerate(places)]
    bag.add("/ground_truth", "leg_tracker/PersonArray", seconds, bag.header(seconds, "map"), persons)


def recorded(
    path: Path,
    places: Sequence[Place] = ((4.0, 0.0, 1.7),),
    more: Optional[Callable[[BagBuilder], None]] = None,
    mounted_until_s: float = 10.0,
) -> Path:
    """A camera and a panorama in the middle of a room, and people who stand about them."""
    with BagBuilder(path) as bag:
        image(bag, IMAGE, "camera")
        image(bag, PANORAMA, "panorama", compressed=True)
        info(bag)
        for step in range(STEPS):
            seconds = step * PERIOD_S
            if seconds <= mounted_until_s:
                mount(bag, seconds, "camera", OPTICAL)
                mount(bag, seconds, "panorama", (0.0, 0.0, 0.0, 1.0))
            people(bag, seconds, places)
        if more is not None:
            more(bag)
    return path


def tracks_at(seconds: float, places: Sequence[Place], first_id: int = 10) -> Tracks:
    count = len(places)
    yes = np.ones(count, dtype=bool)
    means = np.column_stack([np.array(places, dtype=float).reshape(-1, 3), np.zeros((count, 2))])
    ids, covariances = first_id + np.arange(count), np.tile(0.01 * np.eye(5), (count, 1, 1))
    existence, ages_s = np.ones(count), np.full(count, 1.0)
    stamp_ns = START_NS + from_seconds(seconds)
    return Tracks(stamp_ns, "map", ids, means, covariances, existence, yes, yes, ~yes, ages_s)


def tracked(path: Path, places: Sequence[Place]) -> Path:
    with TrackWriter(path) as writer:
        for step in range(STEPS):
            tracks = tracks_at(step * PERIOD_S, places)
            writer.write_tracks(tracks, tracks.stamp_ns)
    return path


def evaluated(tmp_path: Path, truth: Path, places: Sequence[Place], topic: str, *more: str) -> Dict[str, Any]:
    tracked(tmp_path / "tracks.bag", places)
    arguments = [str(tmp_path / "tracks.bag"), "--truth", str(truth), "--image", topic, *more]
    assert evaluate_tracks.main([*arguments, "--json", str(tmp_path / "out.json")]) == 0
    result: Dict[str, Any] = json.loads((tmp_path / "out.json").read_text())
    return result


def before(
    camera: Any, truth: Sequence[Place], tracks: Sequence[Place], count: int = STEPS, stray: Sequence[int] = ()
) -> Tuple[Any, int]:
    """Scores before a camera at the origin of map, whose axes are those of map; at `stray` steps it has no place."""
    transforms = TransformTree(1e9)
    samples: List[Tuple[Instant, Tracks]] = []
    for step in range(count):
        shown = tracks_at(step * PERIOD_S, tracks)
        positions = np.array(truth, dtype=float).reshape(-1, 3)
        unknown = np.full_like(positions, np.nan)
        frame = "nowhere" if step in stray else "map"
        samples.append((Instant(shown.stamp_ns, frame, np.arange(len(truth)), positions, unknown), shown))
    return score_in_image(samples, View("image", "map", camera, transforms))


@pytest.fixture
def panorama() -> Panorama:
    return Panorama(PanoramaConfig())


@pytest.mark.parametrize("topic", [IMAGE, PANORAMA, f"{PANORAMA}/compressed", "camera/image_raw"])
def test_a_perfect_tracker_has_no_errors(tmp_path: Path, topic: str) -> None:
    places = [(4.0, 0.5, 1.7), (3.0, -1.0, 1.6)]
    scores = evaluated(tmp_path, recorded(tmp_path / "a.bag", places), places, topic)["image"]
    assert scores["topic"] == topic and scores["ground_truth_count"] == 2 * STEPS
    assert scores["mota"] == 1.0 and scores["motp_image"] == pytest.approx(0.0, abs=1e-9)
    assert scores["mismatch_rate"] == 0.0 and scores["frames"] == STEPS


def test_who_is_behind_the_camera_counts_on_the_floor_and_on_the_panorama_alone(tmp_path: Path) -> None:
    places = [(4.0, 0.0, 1.7), (-4.0, 0.5, 1.7)]
    bag = recorded(tmp_path / "a.bag", places)
    result = evaluated(tmp_path, bag, places[:1], IMAGE)
    assert result["misses"] == STEPS and result["image"]["misses"] == 0
    assert result["image"]["ground_truth_count"] == STEPS and result["image"]["mota"] == 1.0
    assert evaluated(tmp_path, bag, places[:1], PANORAMA)["image"]["misses"] == STEPS


def test_a_track_behind_the_camera_is_no_false_positive(tmp_path: Path) -> None:
    places = [(4.0, 0.0, 1.7), (-4.0, 0.5, 1.7)]
    bag = recorded(tmp_path / "a.bag", places[:1])
    result = evaluated(tmp_path, bag, places, IMAGE)
    assert result["false_positives"] == STEPS and result["image"]["false_positives"] == 0


def test_a_track_in_the_image_without_anybody_is_a_false_positive(tmp_path: Path) -> None:
    bag = recorded(tmp_path / "a.bag")
    beside = [(4.0, 0.0, 1.7), (4.0, 2.0, 1.7)]
    assert evaluated(tmp_path, bag, beside, IMAGE)["image"]["false_positives"] == STEPS
    assert evaluated(tmp_path, bag, beside, IMAGE, "--only-annotated")["image"]["false_positives"] == 0


def test_what_is_wrong_along_the_ray_counts_less_in_the_image(tmp_path: Path) -> None:
    # 0.6 m farther is no match on the floor, but one in the image.
    result = evaluated(tmp_path, recorded(tmp_path / "a.bag"), [(4.6, 0.0, 1.7)], IMAGE)
    assert result["matches"] == 0 and result["image"]["matches"] == STEPS
    assert 0.1 < result["image"]["motp_image"] < 0.4


@pytest.mark.parametrize("share", [0.45, 0.7])
def test_a_track_to_the_side_overlaps_by_what_is_left(share: float) -> None:
    # The camera at the floor's height sees who stands around it at one distance in boxes of one size.
    distance, height = 4.0, 1.0
    half = math.asin(0.25 * height / distance)
    turn = 2.0 * half * (1.0 - share)
    away = [(distance * math.cos(turn), distance * math.sin(turn), height)]
    evaluation, _ = before(Panorama(PanoramaConfig(height=2000)), [(distance, 0.0, height)], away)
    assert evaluation.scores.clear_mot.motp_image == pytest.approx(1.0 - share / (2.0 - share), abs=0.02)


def test_a_track_of_half_the_height_fills_a_quarter() -> None:
    # Seen from the height of the floor: half as high and half as wide.
    camera = Panorama(PanoramaConfig(height=2000))
    evaluation, _ = before(camera, [(6.0, 0.0, 1.7)], [(6.0, 0.0, 0.9)])
    assert evaluation.scores.clear_mot.motp_image == pytest.approx(1.0 - (0.9 / 1.7) ** 2, abs=0.02)


@pytest.mark.parametrize("degrees", [0, 90, 179, 180, 181, 270])
def test_whoever_stands_at_the_seam_scores_as_anywhere_else(panorama: Panorama, degrees: int) -> None:
    def around(angle: float) -> List[Place]:
        return [(4.0 * math.cos(angle), 4.0 * math.sin(angle), 1.7)]

    def motp(turn: float) -> float:
        evaluation, _ = before(panorama, around(turn - 0.02), around(turn + 0.02))
        assert evaluation.scores.clear_mot.matches == STEPS
        return evaluation.scores.clear_mot.motp_image

    assert motp(math.radians(degrees)) == pytest.approx(motp(1.0), abs=0.02)


def test_who_is_annotated_by_the_feet_stands(tmp_path: Path) -> None:
    bag = recorded(tmp_path / "a.bag", [(4.0, 0.0, 0.0)])
    scores = evaluated(tmp_path, bag, [(4.0, 0.0, STANDING_M)], IMAGE)["image"]
    assert scores["motp_image"] == pytest.approx(0.0, abs=1e-9)


def test_boxes_end_where_the_image_does() -> None:
    # From 1 m heads and feet are outside; what is left is as high for both, and as wide as the cylinders.
    camera = Pinhole(WIDTH, HEIGHT, np.reshape(K, (3, 3)))
    turned = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    transforms = TransformTree(1e9)
    transforms.add("map", "camera", 0, Pose(turned.T, np.array(AT)), static=True)
    shown = tracks_at(0.0, [(1.0, 0.0, 2.2)])
    known = np.array([[1.0, 0.0, 2.0]])
    sample = (Instant(shown.stamp_ns, "map", np.zeros(1, np.int64), known, known), shown)
    evaluation, missing = score_in_image([sample], View("image", "camera", camera, transforms))
    assert evaluation is not None and missing == 0
    narrow, wide = math.tan(math.asin(0.25 * 2.0)), math.tan(math.asin(0.25 * 2.2))
    assert evaluation.scores.clear_mot.motp_image == pytest.approx(1.0 - narrow / wide, abs=0.02)


def test_nobody_in_the_image_is_scored_without_figures(tmp_path: Path) -> None:
    places = [(-4.0, 0.0, 1.7)]
    scores = evaluated(tmp_path, recorded(tmp_path / "a.bag", places), places, IMAGE)["image"]
    assert scores["ground_truth_count"] == 0 and scores["mota"] is None and scores["motp_image"] is None


def test_nobody_reported_is_missed_in_the_image_too(tmp_path: Path) -> None:
    scores = evaluated(tmp_path, recorded(tmp_path / "a.bag"), [], IMAGE)["image"]
    assert scores["misses"] == STEPS and scores["mota"] == 0.0


def test_instants_without_the_cameras_place_are_counted_and_left_out(
    tmp_path: Path, panorama: Panorama, capsys: pytest.CaptureFixture
) -> None:
    here = [(4.0, 0.0, 1.7)]
    evaluation, missing = before(panorama, here, here, stray=(1, 4))
    assert missing == 2 and evaluation.scores.clear_mot.frames == STEPS - 2
    assert before(panorama, here, here, stray=range(STEPS)) == (None, STEPS)
    bag = recorded(tmp_path / "a.bag", mounted_until_s=2 * PERIOD_S)
    scores = evaluated(tmp_path, bag, here, IMAGE)["image"]
    assert scores["frames"] == 3 and scores["mota"] == 1.0
    assert "2 annotated instants without the camera's place" in capsys.readouterr().err


def test_a_camera_that_is_never_placed_leaves_nothing_to_score(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    bag = recorded(tmp_path / "a.bag", mounted_until_s=-1.0)
    result = evaluated(tmp_path, bag, [(4.0, 0.0, 1.7)], IMAGE)
    assert result["mota"] == 1.0 and result["image"]["mota"] is None
    assert f"{STEPS} annotated instants without the camera's place" in capsys.readouterr().err


def test_the_camera_is_the_one_that_camera_info_describes(tmp_path: Path) -> None:
    view = read_view(recorded(tmp_path / "a.bag"), IMAGE, PANORAMAS)
    assert (view.topic, view.frame_id, view.camera.width, view.camera.height) == (IMAGE, "camera", WIDTH, HEIGHT)
    np.testing.assert_allclose(view.camera.project(np.array([[1.0, 0.0, 2.0]])), [[319.5 + FOCAL / 2.0, 239.5]])


def test_a_panorama_is_described_by_its_frame(tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.bag")
    view = read_view(path, PANORAMA, PANORAMAS)
    assert isinstance(view.camera, Panorama) and view.topic == f"{PANORAMA}/compressed"
    with pytest.raises(RecordingError, match=r"neither a camera_info nor a panorama describes /panorama/image_raw"):
        read_view(path, PANORAMA, {})


def no_messages(bag: BagBuilder) -> None:
    bag._writer.add_connection("/silent/image_raw", "sensor_msgs/msg/Image", typestore=bag.store)


def uncalibrated(bag: BagBuilder) -> None:
    image(bag, "/blind/image_raw", "camera")
    info(bag, "/blind/camera_info", [0.0] * 9)


@pytest.mark.parametrize(
    "topic, more, complaint",
    [
        ("/eye", None, "no topic /eye; there are /camera/camera_info"),
        ("/ground_truth", None, "/ground_truth (leg_tracker/PersonArray, 5 messages) holds no images"),
        ("/tf", None, "/tf (tf2_msgs/TFMessage, 10 messages) holds no images"),
        ("/silent/image_raw", no_messages, "/silent/image_raw (sensor_msgs/Image, 0 messages) holds"),
        ("/blind/image_raw", uncalibrated, "/blind/camera_info: camera without a calibration"),
    ],
)
def test_what_is_no_camera_is_one_clear_error(
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    topic: str,
    more: Optional[Callable[[BagBuilder], None]],
    complaint: str,
) -> None:
    bag = recorded(tmp_path / "a.bag", more=more)
    tracked(tmp_path / "tracks.bag", [(4.0, 0.0, 1.7)])
    assert evaluate_tracks.main([str(tmp_path / "tracks.bag"), "--truth", str(bag), "--image", topic]) == 1
    assert complaint in capsys.readouterr().err.splitlines()[-1]
    assert replay_bag.main([str(bag), "--image", topic]) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("replay_bag: ")]
    assert complaint in line
