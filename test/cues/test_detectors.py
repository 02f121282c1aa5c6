"""The contract of all detectors there are: whatever the image, boxes in it, where they were wanted, and only there."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from camera_scenes import Ideal

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.images import Image
from people_fusion.core.resources import directory
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.detector import DETECTORS, Search

MODELS = {"dnn_face": "yunet_n_320_320.onnx", "dnn_body": "yolo-fastest-1.1_body.weights"}
NAMES = [name for name in DETECTORS.names() if DETECTORS.class_of(name).__module__.startswith("people_fusion.")]
PHOTOGRAPHS = ("0001", "0002", "0004", "0007", "0010", "0020")  # of `heads`
FRAMES = ((44, 50), (144, 150))  # of `pets09_s2l1`, that follow each other
SHIFT = 20
SAME = 0.6  # intersection over union
SIZES = [(1, 1), (2, 1), (1, 2), (7, 5), (33, 31), (95, 33), (129, 65), (241, 323), (64, 8192)]
FILLINGS = ["black", "white", "noise"]


class Scene(NamedTuple):
    """An image and the one before it."""

    before: np.ndarray
    now: np.ndarray

    def of(self, change):
        return Scene(change(self.before), change(self.now))


@pytest.fixture(scope="module", params=NAMES)
def detector(request):
    name = request.param
    mapping = {}
    if name in MODELS:
        recordings = request.getfixturevalue("recordings")
        if name == "dnn_face" and tuple(int(part) for part in cv2.__version__.split(".")[:2]) < (4, 8):
            pytest.skip(f"{name}: needs OpenCV 4.8, here is {cv2.__version__}")
        mapping["model"] = str(recordings / "models" / MODELS[name])
    if name == "fhog_head" and not (directory("config") / "models" / "heads.npz").is_file():
        pytest.skip("fhog_head: no model has been trained yet")
    return DETECTORS.build(parse(DETECTORS.config_of(name, name), mapping))


@pytest.fixture(scope="module")
def scene(detector, recordings):
    """A photograph on which the detector finds somebody, away from its edges."""
    for each in photographs(recordings):
        boxes = look(detector, each, everywhere(each.now))
        rows, columns = each.now.shape[:2]
        inner = (boxes.corners > 2 * SHIFT).all(axis=1)
        inner &= (boxes.corners < [columns - 2 * SHIFT, rows - 2 * SHIFT] * 2).all(axis=1)
        if inner[np.argmax(boxes.scores)] if len(boxes.scores) else False:
            return each
    pytest.fail("finds nobody on any photograph")
    return None


@lru_cache(maxsize=1)
def photographs(recordings):
    stills = [cv2.imread(str(recordings / f"heads/images/{name}.jpg")) for name in PHOTOGRAPHS]
    pairs = [[cv2.imread(str(recordings / f"pets09_s2l1/img1/{n:06d}.jpg")) for n in pair] for pair in FRAMES]
    return [Scene(*pair) for pair in pairs] + [Scene(still, still) for still in stills]


def everywhere(pixels, least=16.0):
    return Search(np.array([[0.0, 0.0, pixels.shape[1], pixels.shape[0]]]), np.array([[least, pixels.shape[0]]]))


def look(detector, scene, search, panorama=False):
    """Finds in the scene's image; what compares images has seen the one before."""
    rows, columns = scene.now.shape[:2]
    camera = Panorama(PanoramaConfig(width=columns, height=rows)) if panorama else Ideal(columns, rows)
    detector.reset()
    if detector.needs_rest:
        detector.detect(Image(0, "camera", scene.before, camera), search)
    return detector.detect(Image(1, "camera", scene.now, camera), search)


def surest(boxes):
    return boxes.corners[[np.argmax(boxes.scores)]]


def filled(size, filling, colour):
    shape = (*size, 3) if colour else size
    if filling == "noise":
        return np.random.default_rng(5).integers(0, 256, shape).astype(np.uint8)
    return np.full(shape, {"black": 0, "white": 255}[filling], dtype=np.uint8)


def check(boxes, scene, panorama=False):
    rows, columns = scene.now.shape[:2]
    count = len(boxes.scores)
    assert boxes.corners.shape == (count, 4) and boxes.scores.shape == boxes.confidences.shape == (count,)
    assert np.isfinite(boxes.corners).all() and np.isfinite(boxes.scores).all()
    assert ((boxes.confidences >= 0.0) & (boxes.confidences <= 1.0)).all()
    assert (boxes.corners[:, 2:] > boxes.corners[:, :2]).all()
    assert (boxes.corners[:, [1, 3]] >= 0.0).all() and (boxes.corners[:, [1, 3]] <= rows).all()
    middles = 0.5 * (boxes.corners[:, 0] + boxes.corners[:, 2])
    assert ((middles >= 0.0) & (middles <= columns)).all()
    assert panorama or ((boxes.corners[:, [0, 2]] >= 0.0) & (boxes.corners[:, [0, 2]] <= columns)).all()


@pytest.mark.parametrize("panorama", [False, True], ids=["flat", "panorama"])
@pytest.mark.parametrize("colour", [False, True], ids=["grey", "colour"])
@pytest.mark.parametrize("filling", FILLINGS)
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_any_image_is_looked_at(detector, size, filling, colour, panorama):
    now = filled(size, filling, colour)
    before = now.copy()
    before[: size[0] // 4, : size[1] // 4] //= 2
    scene = Scene(before, now)
    search = everywhere(now, 1.0)
    boxes = look(detector, scene, search, panorama)
    check(boxes, scene, panorama)
    assert search.wanted(boxes.corners).all()
    if filling != "noise" and not detector.needs_rest:
        assert len(boxes.scores) == 0


def test_nothing_is_found_where_nothing_is_searched(detector, scene):
    nowhere = Search(np.zeros((0, 4)), np.zeros((0, 2)))
    check(look(detector, scene, nowhere), scene)
    assert len(look(detector, scene, nowhere).scores) == 0


def test_boxes_of_photographs_are_sound(detector, recordings):
    for each in photographs(recordings)[::3]:
        for panorama in (False, True):
            check(look(detector, each, everywhere(each.now), panorama), each, panorama)


def test_grey_photographs_will_do(detector, scene):
    grey = scene.of(lambda pixels: cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    found = look(detector, scene, everywhere(scene.now)), look(detector, grey, everywhere(grey.now))
    assert overlaps(surest(found[0]), found[1].corners).max(initial=0.0) > SAME


def test_same_image_has_the_same_finds(detector, scene):
    search = everywhere(scene.now)
    first, second = look(detector, scene, search), look(detector, scene, search)
    assert all(np.array_equal(*columns) for columns in zip(first, second))


def test_what_is_searched_elsewhere_or_in_another_size_is_not_found(detector, scene):
    best = surest(look(detector, scene, everywhere(scene.now)))[0]
    rows, columns = scene.now.shape[:2]
    height = best[3] - best[1]
    beside = Search(np.array([[0.0, 0.0, best[0], rows], [best[2], 0.0, columns, rows]]), np.array([[16.0, rows]] * 2))
    smaller = Search(np.array([[0.0, 0.0, columns, rows]]), np.array([[0.2 * height, 0.6 * height]]))
    larger = Search(np.array([[0.0, 0.0, columns, rows]]), np.array([[1.6 * height, 8.0 * height]]))
    for search in (beside, smaller, larger):
        boxes = look(detector, scene, search)
        assert search.wanted(boxes.corners).all()
        assert overlaps(best[None], boxes.corners).max(initial=0.0) < SAME


def test_what_is_searched_where_it_is_is_found(detector, scene):
    best = surest(look(detector, scene, everywhere(scene.now)))[0]
    middle, height = 0.5 * (best[:2] + best[2:]), best[3] - best[1]
    reach = 0.3 * height
    search = Search(np.array([[*(middle - reach), *(middle + reach)]]), np.array([[0.7 * height, 1.4 * height]]))
    boxes = look(detector, scene, search)
    assert search.wanted(boxes.corners).all()
    assert overlaps(best[None], boxes.corners).max(initial=0.0) > SAME


def test_finds_go_with_the_image(detector, scene):
    views = [scene.of(lambda pixels, a=a: np.ascontiguousarray(pixels[a:, a:])) for a in (0, SHIFT)]
    first, second = (look(detector, view, everywhere(view.now)) for view in views)
    assert overlaps(surest(first) - SHIFT, second.corners).max(initial=0.0) > SAME


def test_person_at_a_panoramas_seam_is_found_as_elsewhere_and_once(detector, scene):
    columns = scene.now.shape[1]
    whole = look(detector, scene, everywhere(scene.now), panorama=True)
    best = surest(whole)
    turn = round(0.5 * (best[0, 0] + best[0, 2]))
    turned = scene.of(lambda pixels: np.ascontiguousarray(np.roll(pixels, -turn, axis=1)))
    boxes = look(detector, turned, everywhere(turned.now), panorama=True)
    check(boxes, turned, panorama=True)
    there = [best - [turn - lap, 0.0, turn - lap, 0.0] for lap in (0, columns)]
    shared = np.maximum(*(overlaps(place, boxes.corners)[0] for place in there))
    assert (shared > SAME).sum() == 1


def test_nobody_is_found_twice_across_a_panoramas_seam(detector, scene):
    columns = scene.now.shape[1]
    best = surest(look(detector, scene, everywhere(scene.now), panorama=True))
    for part in (0.2, 0.5, 0.8):
        turn = round(best[0, 0] + part * (best[0, 2] - best[0, 0]))
        turned = scene.of(lambda pixels, turn=turn: np.ascontiguousarray(np.roll(pixels, -turn, axis=1)))
        corners = look(detector, turned, everywhere(turned.now), panorama=True).corners
        shared = overlaps(corners, corners + [columns, 0.0, columns, 0.0])
        assert shared.max(initial=0.0) <= 0.5


def moving(rows=240, columns=320, left=100, contrast=100):
    """A body of 100 x 40 before a still noise, that moves by 6 pixels."""
    rng = np.random.default_rng(1)
    still = rng.integers(90, 110, (rows, columns)).astype(np.uint8)
    body = np.kron(rng.integers(160 - contrast // 2, 161 + contrast // 2, (20, 8)), np.ones((5, 5))).astype(np.uint8)
    images = []
    for step in (0, 6):
        pixels = still.copy()
        pixels[80:180, np.arange(left + step, left + step + 40) % columns] = body
        images.append(pixels)
    return Scene(*images)


def motion():
    return DETECTORS.build(parse(DETECTORS.config_of("motion", ""), {}))


@pytest.mark.parametrize("contrast", [0, 100], ids=["plain", "patterned"])
def test_moving_body_is_found_in_full(contrast):
    scene = moving(contrast=contrast)
    boxes = look(motion(), scene, everywhere(scene.now))
    assert np.abs(boxes.corners - [100.0, 80.0, 146.0, 180.0]).max() < 3.0


def test_still_body_is_no_motion():
    scene = moving()
    assert len(look(motion(), Scene(scene.now, scene.now), everywhere(scene.now)).scores) == 0


def test_light_that_changes_is_counted_and_no_motion_and_the_next_image_is_as_good_as_ever():
    scene, finder = moving(), motion()
    camera, search = Ideal(320, 240), everywhere(scene.now)
    finder.detect(Image(0, "camera", scene.now // 2, camera), search)
    with pytest.raises(DataError, match="light changed"):
        finder.detect(Image(1, "camera", scene.before, camera), search)
    assert len(finder.detect(Image(2, "camera", scene.now, camera), search).scores) == 1


def test_nothing_moves_in_the_first_image_after_a_reset():
    scene, finder = moving(), motion()
    look(finder, scene, everywhere(scene.now))
    finder.reset()
    assert len(finder.detect(Image(2, "camera", scene.before, Ideal(320, 240)), everywhere(scene.now)).scores) == 0


def test_body_that_the_edge_cuts_is_no_motion_but_at_a_panoramas_seam_it_is_one():
    scene = moving(left=297)
    assert len(look(motion(), scene, everywhere(scene.now)).scores) == 0
    assert len(look(motion(), scene, everywhere(scene.now), panorama=True).scores) == 1


def test_small_people_are_found_in_an_enlarged_image(recordings):
    before, _ = photographs(recordings)[0]
    config = DETECTORS.config_of("hog_body", "")
    found = [
        look(DETECTORS.build(parse(config, {"enlarge": enlarge})), Scene(before, before), everywhere(before)).corners
        for enlarge in (1.0, 2.0)
    ]
    small = [(corners[:, 3] - corners[:, 1] < 85.0).sum() for corners in found]
    assert small[0] == 0 and small[1] >= 2


@pytest.mark.parametrize("name", sorted(MODELS))
def test_model_that_is_not_named_not_there_or_another_is_refused(name, tmp_path):
    if name == "dnn_face" and tuple(int(part) for part in cv2.__version__.split(".")[:2]) < (4, 8):
        pytest.skip(f"{name}: needs OpenCV 4.8, here is {cv2.__version__}")
    config = DETECTORS.config_of(name, "")
    with pytest.raises(ConfigError, match="model: names no file"):
        DETECTORS.build(parse(config, {}))
    with pytest.raises(ConfigError, match=r"model: .*nowhere: No such file"):
        DETECTORS.build(parse(config, {"model": str(tmp_path / "nowhere")}))
    other = tmp_path / "other"
    other.write_bytes(b"no network")
    with pytest.raises(ConfigError, match=r"other has SHA-256 [0-9a-f]{64}, expected [0-9a-f]{64}"):
        DETECTORS.build(parse(config, {"model": str(other)}))
    anything = {"model": str(other), "sha256": ""}
    if name == "dnn_body":
        anything.update(layers=str(other), layers_sha256="")
    with pytest.raises(ConfigError, match=r"model: .*other"):
        DETECTORS.build(parse(config, anything))


def test_opencv_too_old_for_the_face_network_is_named(monkeypatch):
    monkeypatch.setattr(cv2, "__version__", "4.6.0")
    with pytest.raises(ConfigError, match=r"dnn_face: needs OpenCV 4\.8 or newer, here is 4\.6\.0"):
        DETECTORS.build(parse(DETECTORS.config_of("dnn_face", ""), {}))
