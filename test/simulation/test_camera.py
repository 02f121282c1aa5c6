"""Simulated cameras: heads are where the camera's model says, hide each other, and are found by real detectors."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.core.pixels import compressed_pixels
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.detector import DETECTORS, Search
from people_fusion.cues.heads.head_model import read_poschmann_model
from people_fusion.cues.heads.people import heads_of_boxes
from people_fusion.replay.recording import Recording
from people_fusion.simulation.bag import HEAD_CHANNELS, write_bag
from people_fusion.simulation.camera import CameraConfig
from people_fusion.simulation.rendering import Painter
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import Simulation, simulate

HALL = {"walls": [{"points": [[-6, -6], [6, -6], [6, 6], [-6, 6]], "closed": True}]}
CLEAR = {"blur": 0.0, "noise_std": 0.0, "stitch_shift": 0.0, "stitch_gain": 0.0, "encoding": "bgr8"}
DISTORTED = {
    "model": "pinhole",
    "frame": "camera_optical",
    "topic": "/camera/image_raw",
    "at": [0.1, 0.0, 1.4],
    "pitch": 0.1,
    "pinhole": {"field": 1.2, "distortion": [-0.25, 0.08, 0.002, -0.002]},
}
CAMERAS = {"panorama": {}, "pinhole": DISTORTED}


def people_at(places, camera, seed=1, facing=(0.0, 0.0), **others):
    """A simulation of people who stand and look at the robot, with one camera."""
    people = [{"start": list(map(float, place)), "facing": list(facing)} for place in places]
    mapping = {"duration_s": 0.5, "room": HALL, "people": people, "cameras": [camera], "scanners": []}
    return Simulation(parse(ScenarioConfig, {**mapping, "looks": {"glance_std": 0.0}, **others}), seed)


def taken(simulation, time_s=0.1):
    return simulation.cameras[0].picture(simulation.history, time_s, 5)


@pytest.mark.parametrize("place", [(2.0, 0.6), (1.2, -0.3), (-2.0, 0.01), (-1.5, -0.02), (0.3, 2.5)])
@pytest.mark.parametrize("kind", CAMERAS)
def test_heads_are_painted_where_the_model_projects_them(place, kind, monkeypatch):
    if kind == "pinhole" and place[0] < 1.0:
        place = (1.6, 0.7 * np.sign(place[1]))
    patches = []
    paint = Painter._patch
    monkeypatch.setattr(Painter, "_patch", lambda *given: patches.append(paint(*given)) or patches[-1])
    simulation = people_at([place], {**CAMERAS[kind], **CLEAR})
    heads = taken(simulation).heads
    (patch,) = patches
    camera = simulation.cameras[0].camera
    (row,) = camera.project(heads.positions)[:, 1]
    (column,) = camera.project(heads.positions)[:, 0]
    columns = patch.columns - np.round((patch.columns - column) / camera.width) * camera.width * camera.wraps
    middle = np.array([(patch.head.sum(axis=0) * columns).sum(), (patch.head.sum(axis=1) * patch.rows).sum()])
    middle = middle / patch.head.sum()
    # Hair stands up, the jaw is before the neck.
    tall = heads.corners[0, 3] - heads.corners[0, 1]
    assert np.abs(middle - [column, row]).max() < max(1.0, 0.06 * tall)
    seen = np.flatnonzero(patch.head.sum(axis=1) > 0.25)
    assert patch.rows[seen[0]] == pytest.approx(heads.corners[0, 1], abs=0.06 * tall + 1.0)
    assert patch.rows[seen[-1]] + 1 == pytest.approx(heads.corners[0, 3], abs=0.1 * tall + 1.0)


def test_person_on_the_seam_is_painted_on_both_edges_of_a_panorama():
    empty, full = (taken(people_at(places, CLEAR)) for places in ([], [(-1.5, 0.0)]))
    changed = np.flatnonzero((empty.pixels != full.pixels).any(axis=(0, 2)))
    assert changed.min() == 0 and changed.max() == 1405
    assert changed[changed < 703].max() < 60 and changed[changed > 703].min() > 1345
    (left, _, right, _) = full.heads.corners[0]
    assert -0.5 <= 0.5 * (left + right) < 1405.5
    assert full.heads.visibility[0] == pytest.approx(1.0, abs=0.02)


def test_nearer_people_hide_farther_ones():
    alone, behind, beside = (
        taken(people_at(places, {**DISTORTED, **CLEAR})).heads.visibility
        for places in ([(3.0, 0.0)], [(3.0, 0.0), (1.5, 0.0)], [(3.0, 0.0), (1.5, 0.35)])
    )
    assert alone[0] > 0.97 and behind[1] > 0.97 and beside[0] > 0.97
    assert behind[0] < 0.3


@pytest.mark.parametrize("pillar, least, most", [(0.3, 0.0, 0.01), (0.05, 0.2, 0.8)])
def test_pillars_hide_heads_as_far_as_they_are_wide(pillar, least, most):
    room = {**HALL, "pillars": [{"at": [1.2, 0.06], "radius": pillar}]}
    (visibility,) = taken(people_at([(2.4, 0.0)], {**DISTORTED, **CLEAR}, room=room)).heads.visibility
    assert least <= visibility <= most


def box(front, height):
    outline = [[front, -1.0], [front + 0.5, -1.0], [front + 0.5, 1.0], [front, 1.0]]
    return {"points": outline, "closed": True, "height": height}


@pytest.mark.parametrize("kind", ["box", "pedestal"])
def test_cameras_look_over_what_is_low_and_lasers_do_not(kind):
    def seen(height):
        low = (
            {"walls": HALL["walls"] + [box(1.0, height)]}
            if kind == "box"
            else {**HALL, "pillars": [{"at": [1.2, 0.0], "radius": 0.3, "height": height}]}
        )
        return taken(people_at([(2.0, 0.0)], {**CAMERAS["panorama"], **CLEAR}, room=low)).heads.visibility[0]

    assert seen(1.2) == pytest.approx(1.0, abs=0.01)
    assert seen(2.8) == 0.0
    assert 0.05 < seen(1.67) < 0.95


def test_a_low_box_has_a_front_and_a_top_and_ends_where_it_ends():
    room = {"walls": HALL["walls"] + [box(2.0, 1.0)]}
    camera = people_at([(-3.0, 0.0)], {**CAMERAS["panorama"], **CLEAR}, room=room).cameras[0]
    bare = people_at([(-3.0, 0.0)], {**CAMERAS["panorama"], **CLEAR}).cameras[0]
    pose = np.zeros(3)
    hidden = camera._room.paint(pose).distances
    column = camera.camera.width // 2
    heights = camera._height + hidden[:, column] * camera._room._slopes[:, column]
    on_front, on_top = (
        np.isclose(hidden[:, column], 2.0, atol=0.01),
        np.isclose(heights, 1.0, atol=0.01) & (hidden[:, column] < 5.0),
    )
    assert on_front.any() and on_top.any()
    assert hidden[on_top, column].max() < 2.51 and hidden[on_top, column].min() > 1.99
    over = ~(on_front | on_top)
    np.testing.assert_allclose(hidden[over, column], bare._room.paint(pose).distances[over, column])


def test_heads_at_the_image_edge_are_seen_in_part_and_those_behind_not_at_all():
    half = {**DISTORTED, **CLEAR, "yaw": 0.6, "pitch": 0.0, "pinhole": {"field": 1.2}}
    heads = taken(people_at([(2.0, 0.0), (-2.0, 1.0)], half)).heads
    assert heads.ids.tolist() == [1]
    assert 0.1 < heads.visibility[0] < 0.9


def test_yaw_is_that_of_the_face_towards_the_camera():
    for facing, yaw in (((0.0, 0.0), 0.0), ((2.0, 9.0), -np.pi / 2), ((2.0, -9.0), np.pi / 2)):
        (found,) = taken(people_at([(2.0, 0.0)], {}, facing=facing)).heads.yaws
        assert found == pytest.approx(yaw, abs=0.15)


def test_heads_turn_as_people_glance_about():
    looks = {"glance_std": 0.5, "glance_s": 0.5}
    simulation = people_at([(2.0, 0.0)], {}, looks=looks, duration_s=20.0)
    yaws = simulation._cast.gazes[:, 0] - simulation.history.headings[:, 0]
    assert 0.3 < yaws.std() < 0.6
    assert np.abs(np.diff(yaws)).max() <= 3.0 * 0.02 + 1e-9


def test_same_seed_gives_the_same_bytes_and_another_seed_others():
    first, again, other = (taken(people_at([(2.0, 0.0)], {}, seed=seed)).pixels for seed in (1, 1, 2))
    assert first.tobytes() == again.tobytes() != other.tobytes()


def test_cameras_leave_all_other_topics_alone():
    def others(name):
        scenario = dataclasses.replace(load_scenario(name), duration_s=1.0)
        events = [event for event in simulate(scenario, 1) if event[0].startswith(("/scan", "/odom", "/ground_truth"))]
        return [(topic, arrival) for topic, arrival, _ in events if "heads" not in topic], [
            item.ranges.tobytes() for topic, _, item in events if topic.startswith("/scan")
        ]

    assert others("museum") == others("museum_cameras")


def test_stitched_cameras_stand_apart():
    cameras = (CLEAR, {**CLEAR, "stitch_gain": 0.2})
    exact, stitched = (taken(people_at([(2.0, 0.0)], camera)).pixels for camera in cameras)
    gains = stitched.mean(axis=(0, 2)) / exact.mean(axis=(0, 2))
    steps = np.flatnonzero(np.abs(np.diff(gains)) > 0.01)
    assert np.abs(steps[:, None] - [351, 702, 1053]).min(axis=1).max() <= 1  # there and nowhere else
    assert len(steps) >= 3


def test_bag_holds_images_calibration_and_the_truth(tmp_path):
    scenario = dataclasses.replace(load_scenario("camera_test"), duration_s=0.6)
    write_bag(tmp_path / "a.bag", simulate(scenario, 1))
    with Recording(tmp_path / "a.bag") as recording:
        stamps = {}
        for topic in recording.of_kind("Image", "CompressedImage", "CameraInfo", "PointCloud"):
            for message in recording.messages([topic]):
                read = message.read()
                stamps.setdefault(topic.name, []).append((read.header.stamp.sec, read.header.stamp.nanosec))
                assert message.arrival_ns - (read.header.stamp.sec * 10**9 + read.header.stamp.nanosec) > 5e7
                if topic.kind == "CompressedImage":
                    assert compressed_pixels(bytes(read.data)).shape == (240, 1406, 3)
                elif topic.kind == "Image":
                    assert (read.height, read.width, read.step, len(read.data)) == (240, 320, 960, 240 * 960)
                elif topic.kind == "PointCloud":
                    assert tuple(channel.name for channel in read.channels) == HEAD_CHANNELS
                    assert {len(channel.values) for channel in read.channels} == {len(read.points)}
    images, panoramas = stamps["/camera/image_raw"], stamps["/panorama/image_raw/compressed"]
    assert len(images) == len(panoramas) == 6
    assert stamps["/camera/camera_info"] == stamps["/ground_truth/heads/camera_optical"] == images
    assert stamps["/ground_truth/heads/panorama"] == panoramas


def test_two_cameras_in_one_frame_are_refused():
    with pytest.raises(ConfigError, match="a frame of its own"):
        parse(ScenarioConfig, {"cameras": [{}, {"topic": "/b/image_raw"}]})
    with pytest.raises(ConfigError, match="folds the image"):
        parse(CameraConfig, {"model": "pinhole", "pinhole": {"distortion": [-1e6, 0.0, 0.0, 0.0]}})


def gallery(count):
    """Pictures of people who look at the camera more or less."""
    rng = np.random.default_rng(3)
    for number in range(count):
        sides = [(rng.uniform(0.9, 1.6), -0.35), (rng.uniform(1.7, 3.0), rng.uniform(-0.1, 0.3)), (2.4, 0.95)]
        simulation = people_at(sides, {**DISTORTED, "pitch": 0.0}, seed=number, looks={"glance_std": 0.3})
        yield taken(simulation), simulation.cameras[0]


def found_and_nees(name, parameters):
    """Of frontal heads of 40 pixels and more, which are found; of finds, how wrong the head is by its covariance."""
    detector = DETECTORS.build(parse(DETECTORS.config_of(name, ""), parameters))
    found, nees = [], []
    for picture, simulated in gallery(15):
        image = Image(0, "", picture.pixels, simulated.camera)
        boxes = detector.detect(image, Search.everywhere(image, 20.0, 480.0)).corners
        truth = picture.heads
        tall = truth.corners[:, 3] - truth.corners[:, 1]
        shared = overlaps(truth.corners, boxes)
        hit = shared.max(axis=1, initial=0.0) > 0.3
        found.extend(hit[(tall >= 40) & (truth.visibility > 0.9) & (np.abs(truth.yaws) < 0.5)])
        level = picture.config.level_from_camera
        heads = heads_of_boxes(boxes[shared.argmax(axis=1)[hit]], simulated.camera, level, detector.box)
        errors = heads.positions - truth.positions[hit] @ level.T
        nees.extend(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(heads.covariances), errors))
    assert len(found) > 20
    return np.mean(found), np.mean(nees)


@pytest.mark.slow
def test_rendered_faces_are_found_by_a_detector_trained_on_photographs_and_their_heads_are_as_sure_as_said():
    found, nees = found_and_nees("haar_face", {})
    assert found >= 0.7
    assert 1.5 < nees < 6.0


@pytest.mark.slow
def test_rendered_heads_are_found_by_the_model_of_this_package_and_are_as_sure_as_said():
    found, nees = found_and_nees("fhog_head", {})
    assert found >= 0.7
    assert 1.5 < nees < 6.0


@pytest.mark.slow
def test_rendered_heads_are_found_by_poschmanns_own_detector_trained_on_photographs(recordings, tmp_path):
    model = read_poschmann_model(recordings / "head_svm_reference" / "svm-frontal-fhog6-4x10")
    model.save(tmp_path / "heads.npz")
    found, _ = found_and_nees("fhog_head", {"model": str(tmp_path / "heads.npz")})
    assert found >= 0.7


def test_faces_are_found_and_backs_of_heads_are_not():
    detector = DETECTORS.build(parse(DETECTORS.config_of("haar_face", ""), {}))
    for facing, count in (((0.0, 0.0), 1), ((9.0, 0.0), 0)):
        simulation = people_at([(1.5, 0.0)], {**DISTORTED, "pitch": 0.0}, facing=facing)
        image = Image(0, "", taken(simulation).pixels, simulation.cameras[0].camera)
        assert len(detector.detect(image, Search.everywhere(image, 20.0, 480.0)).corners) == count
