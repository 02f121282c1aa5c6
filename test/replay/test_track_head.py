"""track_head: pictures in, boxes, annotated pictures and clear errors out."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np
import pytest
from bags import BagBuilder

from people_fusion.replay import track_head

COUNT, HEIGHT = 12, 60
START = (100, 70)  # middle of the head in the first picture


def ellipse(pixels: np.ndarray, x: float, y: float, axes: Tuple[float, float], shade: int) -> None:
    place, half = [round(16 * (value - 0.5)) for value in (x, y)], [round(16 * value) for value in axes]
    cv2.ellipse(pixels, place, half, 0, 0, 360, (shade, shade, shade), -1, cv2.LINE_AA, 4)


def picture(number: int) -> np.ndarray:
    """(H, W, 3): who walks to the right by 4 pixels a picture."""
    rng = np.random.default_rng(5)
    ground = cv2.resize(rng.integers(120, 160, (16, 20)).astype(np.uint8), (320, 240), interpolation=cv2.INTER_CUBIC)
    pixels = cv2.cvtColor(ground, cv2.COLOR_GRAY2BGR)
    x, y = START[0] + 4.0 * number, float(START[1])
    ellipse(pixels, x, y + 1.25 * HEIGHT, (0.95 * HEIGHT, 0.8 * HEIGHT), 50)
    ellipse(pixels, x, y, (0.4 * HEIGHT, 0.5 * HEIGHT), 215)
    ellipse(pixels, x, y - 0.2 * HEIGHT, (0.38 * HEIGHT, 0.3 * HEIGHT), 30)
    for side in (-1, 1):
        ellipse(pixels, x + 0.16 * HEIGHT * side, y + 0.05 * HEIGHT, (3.0, 2.0), 30)
    ellipse(pixels, x, y + 0.28 * HEIGHT, (7.0, 1.5), 90)
    return cv2.GaussianBlur(pixels, (0, 0), 0.8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures")
    for number in range(COUNT):
        cv2.imwrite(str(path / f"{number:03d}.png"), picture(number))
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "heads.bag"
    with BagBuilder(path) as bag:
        for number in range(COUNT):
            pixels, header = picture(number), bag.header(0.1 * number, "camera")
            data = cv2.imencode(".png", pixels)[1].ravel()
            shape = (*pixels.shape[:2], "bgr8", 0, 3 * pixels.shape[1])
            bag.add("/front/image_raw", "sensor_msgs/Image", 0.1 * number, header, *shape, pixels.ravel())
            bag.add("/rear/image_raw/compressed", "sensor_msgs/CompressedImage", 0.1 * number, header, "png", data)
    return path


BOX = f"{START[0] - HEIGHT / 2},{START[1] - HEIGHT / 2},{HEIGHT},{HEIGHT}"
PAINTED = ["--set", "least=45", "--set", "largest=75", "--set", "detector/threshold=-0.5"]  # a poor likeness


def tracked(path: Path, out: Path, *arguments: str) -> Dict[str, Any]:
    assert track_head.main([str(path), "--json", str(out), *arguments]) == 0
    return json.loads(out.read_text())


def last_offset(result: Dict[str, Any]) -> float:
    last = result["heads"][-1]
    assert last["frame"] == COUNT - 1
    left, top, width, height = last["box"]
    return float(np.hypot(left + 0.5 * width - START[0] - 4.0 * (COUNT - 1), top + 0.5 * height - START[1]))


@pytest.mark.parametrize("tracker", ["particle", "hst"])
@pytest.mark.parametrize("start", [PAINTED, ["--box", BOX]], ids=["detected", "given"])
def test_a_head_is_followed_through_a_folder(folder: Path, tmp_path: Path, tracker: str, start: List[str]) -> None:
    result = tracked(folder, tmp_path / "a.json", "--tracker", tracker, *start)
    assert result["frames"] == COUNT and {row["track"] for row in result["heads"]} == {1}
    assert last_offset(result) < 0.15 * HEIGHT


@pytest.mark.parametrize("topic", ["/front/image_raw", "/rear/image_raw", "rear/image_raw/compressed"])
def test_a_bag_gives_what_its_pictures_give(bag: Path, folder: Path, tmp_path: Path, topic: str) -> None:
    from_bag = tracked(bag, tmp_path / "a.json", "--box", BOX, "--image", topic)
    assert from_bag == tracked(folder, tmp_path / "b.json", "--box", BOX)


def test_a_video_is_written_and_read_again(folder: Path, tmp_path: Path) -> None:
    tracked(folder, tmp_path / "a.json", "--box", BOX, "--out", str(tmp_path / "out" / "a.avi"))
    again = tracked(tmp_path / "out" / "a.avi", tmp_path / "b.json", "--box", BOX, "--tracker", "hst")
    assert again["frames"] == COUNT and last_offset(again) < 0.15 * HEIGHT


def test_annotated_pictures_show_the_box(folder: Path, tmp_path: Path) -> None:
    result = tracked(folder, tmp_path / "a.json", "--box", BOX, "--out", str(tmp_path / "out"))
    names = sorted((tmp_path / "out").iterdir())
    assert [name.name for name in names] == [f"{number + 1:06d}.png" for number in range(COUNT)]
    left, top, _, height = result["heads"][-1]["box"]
    drawn = cv2.imread(str(names[-1])) != picture(COUNT - 1)
    rows, cols = np.nonzero(drawn[round(top) - 1 :].any(axis=2))
    assert abs(cols.min() - left) < 3 and abs(rows.max() + round(top) - 1 - top - height) < 3


@pytest.mark.parametrize("tracker", ["particle", "hst"])
def test_repetition_writes_the_same_bytes_and_a_seed_others(folder: Path, tmp_path: Path, tracker: str) -> None:
    texts = []
    for number, seed in enumerate(("3", "3", "4")):
        out = tmp_path / str(number)
        tracked(folder, out, "--box", BOX, "--seed", seed, "--tracker", tracker, "--out", str(out.with_suffix(".avi")))
        texts.append((out.read_bytes(), out.with_suffix(".avi").read_bytes()))
    assert texts[0] == texts[1] and texts[0] != texts[2]


def test_parameters_are_set_from_outside(folder: Path, tmp_path: Path) -> None:
    result = tracked(folder, tmp_path / "a.json", "--set", "detector/threshold=9")
    assert result["heads"] == []


def test_what_was_followed_is_said(folder: Path, capsys: pytest.CaptureFixture) -> None:
    assert track_head.main([str(folder), "--box", BOX]) == 0
    assert f"head 1: pictures 0 to {COUNT - 1}, {COUNT} of them" in capsys.readouterr().out


WRONG = [
    (["{missing}"], "no such file or folder"),
    (["{empty}"], "no pictures"),
    (["{text}"], "not a video"),
    (["{damaged}"], "not a readable ROS 1 bag"),
    (["{damaged_picture}"], "not a readable picture"),
    (["{bag}"], "which images?"),
    (["{bag}", "--image", "/nowhere"], "no images /nowhere"),
    (["{folder}", "--image", "/front"], "is no bag"),
    (["{folder}", "--box", "1,2,3"], "expected x,y,w,h"),
    (["{folder}", "--box", "1,2,0,5"], "no box"),
    (["{folder}", "--box", "1,2,nan,5"], "no box"),
    (["{folder}", "--box", "900,2,30,30"], "outside of the image"),
    (["{folder}", "--box", "900,2,30,30", "--tracker", "hst"], "outside of the image"),
    (["{folder}", "--set", "particle/particles=0"], "particle/particles"),
    (["{folder}", "--set", "nonsense=1"], "nonsense"),
    (["{folder}", "--set", "detector/model=nowhere.npz"], "nowhere.npz"),
    (["{folder}", "--seed", "-1"], "--seed"),
    (["{folder}", "--out", "{text}/below"], "text"),
    (["{folder}", "--out", "{empty}", "--json", "{missing}/a.json"], "a.json"),
]


@pytest.mark.parametrize("arguments, said", WRONG, ids=[" ".join(arguments) for arguments, _ in WRONG])
def test_what_is_wrong_is_said_in_one_line(
    arguments: List[str], said: str, folder: Path, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    names = ("missing", "empty", "text", "damaged_picture")
    paths = {**{name: tmp_path / name for name in names}, "damaged": tmp_path / "a.bag", "folder": folder, "bag": bag}
    paths["empty"].mkdir()
    paths["text"].write_text("no video")
    paths["damaged"].write_bytes(b"#ROSBAG V2.0\nno bag")
    paths["damaged_picture"].mkdir()
    (paths["damaged_picture"] / "a.png").write_bytes(b"no picture")
    assert track_head.main([argument.format(**paths) for argument in arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("track_head: ") and said in error and error.count("\n") == 1


def test_the_script_ends_with_one_where_it_fails(checkout: Path) -> None:
    script = [sys.executable, str(checkout / "scripts" / "track_head"), "/nowhere"]
    done = subprocess.run(script, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "Traceback" not in done.stderr
