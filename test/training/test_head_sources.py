"""Reading photographs with marked heads, and dealing them out to folds."""

import numpy as np
import pytest

from people_fusion.core.errors import RecordingError
from people_fusion.training.head_sources import (
    Photograph,
    considered,
    digest,
    folds,
    photographs,
    scenes,
    squares,
    upright,
)

cv2 = pytest.importorskip("cv2")


def write(folder, lines, images):
    (folder / "images").mkdir(exist_ok=True)
    (folder / "annotations.csv").write_text("image,class,xmin,ymin,xmax,ymax\n" + "".join(f"{x}\n" for x in lines))
    for name, pixels in images.items():
        cv2.imwrite(str(folder / "images" / name), pixels)


def photograph(boxes, classes=None, shape=(200, 300), name="a.png", seed=0):
    grey = np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)
    return Photograph(name, grey, np.array(boxes, dtype=float), np.array(classes or ["head"] * len(boxes)))


def test_large_photographs_are_shrunk_and_their_boxes_with_them(tmp_path):
    write(tmp_path, ["a.png,head,10,20,50,80", "b.png,helmet,1,2,3,4"], {
        "a.png": np.zeros((100, 200), dtype=np.uint8), "b.png": np.zeros((10, 20, 3), dtype=np.uint8)
    })  # fmt: skip
    large, small = photographs(tmp_path, largest_side=100)
    assert large.grey.shape == (50, 100) and small.grey.shape == (10, 20)
    assert large.boxes.tolist() == [[5, 10, 25, 40]] and small.boxes.tolist() == [[1, 2, 3, 4]]
    assert [image.name for image in photographs(tmp_path, 100, ["a.png"])] == ["b.png"]


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["a.png,head,5,5,5,9"], "line 2"),
        (["a.png,head,1,1,2,nan"], "line 2"),
        (["a.png,head,1,1,2,x"], "line 2"),
        (["a.png,head,1,1"], "line 2"),
        ([], "nothing is marked"),
        (["gone.png,head,1,1,2,2"], "gone.png"),
    ],
)
def test_damaged_marks_are_named(tmp_path, lines, told):
    write(tmp_path, lines, {"a.png": np.zeros((10, 10), dtype=np.uint8)})
    with pytest.raises(RecordingError, match=told):
        photographs(tmp_path, 100)


def test_missing_column_and_missing_file_are_named(tmp_path):
    with pytest.raises(RecordingError, match=r"annotations\.csv"):
        photographs(tmp_path, 100)
    (tmp_path / "annotations.csv").write_text("image,xmin\n")
    with pytest.raises(RecordingError, match="class"):
        photographs(tmp_path, 100)


def test_squares_enclose_boxes_about_their_middles():
    assert squares(np.array([[0.0, 0.0, 10.0, 30.0], [0.0, 0.0, 8.0, 4.0]])).tolist() == [
        [-10.0, 0.0, 20.0, 30.0],
        [0.0, -2.0, 8.0, 6.0],
    ]


def test_small_cut_lying_and_other_heads_are_ignored():
    image = photograph(
        [[10, 10, 50, 60], [10, 10, 40, 45], [0, 10, 40, 60], [10, 150, 50, 200], [50, 50, 150, 100], [10, 10, 50, 60]],
        ["head"] * 5 + ["helmet"],
    )
    assert considered(image, ["head"], 40.0).tolist() == [True, False, False, False, False, False]
    assert considered(image, ["head", "helmet"], 40.0).tolist() == [True, False, False, False, False, True]
    assert upright(image).tolist() == [True, True, False, False, False, True]


def test_scenes_are_known_again_when_mirrored_and_stay_in_one_fold():
    several = [photograph([[1, 1, 9, 9]], seed=seed, shape=(12, 16)) for seed in range(20)]
    several.append(several[3]._replace(grey=several[3].grey[:, ::-1]))
    number = scenes(several)
    assert number[20] == number[3] and len(np.unique(number)) == 20
    for seed in range(5):
        fold = folds(several, 4, np.random.default_rng(seed))
        assert fold[20] == fold[3]
        assert np.bincount(fold, minlength=4).max() <= 6


def test_digest_changes_with_pixels_boxes_classes_and_names():
    image = photograph([[10, 10, 50, 60]])
    changed = [
        image._replace(name="b"),
        image._replace(boxes=image.boxes + 1),
        image._replace(classes=np.array(["helmet"])),
        image._replace(grey=255 - image.grey),
    ]
    assert len({digest([entry]) for entry in [image, *changed]}) == 5
    assert digest([image]) == digest([image])


def test_recorded_photographs_are_read(recordings):
    images = photographs(recordings / "heads", 640)
    assert len(images) == 406
    assert sum(len(image.boxes) for image in images) == 2021
    assert {kind for image in images for kind in image.classes} == {"head", "helmet"}
    assert sum(considered(image, ["head"], 40.0).sum() for image in images) > 300
    assert len(np.unique(scenes(images))) < len(images)
