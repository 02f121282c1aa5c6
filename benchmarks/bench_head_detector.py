#!/usr/bin/env python3
"""How fast heads are found by FHOG, against whole bodies by OpenCV's HOG, in images of 640x480 on one core.

End to end: a colour image in, heads from 40 pixels out. OpenCV's HOG people detector looks at the same images with
its default stride and Volkhardt's pyramid step of 1.1. Then what the scores of further models on the same cells cost.
Times are of the process, the median over images and rounds. The photographs are those of `heads` in the directory of
recordings; without them textures take their place. Exits with 1 where the bounds are not held.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.cues.heads.detector import Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHead, FhogHeadConfig
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow, load_head_model
from people_fusion.cues.heads.native import Scorer
from people_fusion.cues.heads.pyramid import pyramid

SIZE, LEAST = (640, 480), 40.0
CAMERA = Pinhole(*SIZE, np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]]))
FRAMES_PER_SECOND, TIMES_AS_FAST, EXTRA = 40.0, 2.0, 0.2
MODELS = (1, 2, 3, 5)


def images(folder, count):
    """(480, 640, 3) each: from the middle of photographs, or textures."""
    paths = sorted(folder.glob("heads/images/*.jpg"))[:count]
    if not paths:
        print(f"no photographs in {folder}: textures instead")
        rng = np.random.default_rng(0)
        noise = [rng.integers(0, 256, (60, 80, 3)).astype(np.uint8) for _ in range(count)]
        return [cv2.resize(small, SIZE, interpolation=cv2.INTER_CUBIC) for small in noise]
    found = []
    for path in paths:
        pixels = cv2.imread(str(path))
        rows, cols = pixels.shape[:2]
        width, height = (cols, cols * 3 // 4) if rows * 4 >= cols * 3 else (rows * 4 // 3, rows)
        top, left = (rows - height) // 2, (cols - width) // 2
        found.append(cv2.resize(pixels[top : top + height, left : left + width], SIZE, interpolation=cv2.INTER_AREA))
    return found


def model_of(name, folder):
    """The model, or where there is none yet one that finds hardly anything."""
    try:
        return load_head_model(name), name
    except ConfigError as error:
        print(f"{error}; weights by chance instead")
    weights = np.random.default_rng(0).normal(0.0, 0.05, (8, 8, 22)).astype(np.float32)
    path = str(folder / "chance.npz")
    HeadModel(HeadWindow(FhogConfig(), 8, 8, (0.0, 0.0, 8.0, 8.0)), weights, -3.0, -1.0, {}).save(path)
    return load_head_model(path), path


def milliseconds(rounds, pieces, call):
    """Median of the process's time for one piece."""
    for piece in pieces[:2]:
        call(piece)
    times = []
    for _ in range(rounds):
        for piece in pieces:
            start = time.process_time()
            call(piece)
            times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    recordings = Path(__file__).resolve().parents[2] / "shared/data"
    parser.add_argument("--recordings", type=Path, default=Path(os.environ.get("PEOPLE_FUSION_DATA", recordings)))
    parser.add_argument("--model", default="heads", help="default: %(default)s")
    parser.add_argument("--images", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    looked_at = images(options.recordings, options.images)
    with tempfile.TemporaryDirectory() as folder:
        model, name = model_of(options.model, Path(folder))
        detector = FhogHead(FhogHeadConfig(model=name))
    search = Search(np.array([[0.0, 0.0, *SIZE]]), np.array([[LEAST, SIZE[1]]]))
    hog = cv2.HOGDescriptor()
    hog.setSVMDetector(cv2.HOGDescriptor.getDefaultPeopleDetector())

    def bodies(pixels):
        return hog.detectMultiScale(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), winStride=(8, 8), scale=1.1)

    whole = milliseconds(options.rounds, looked_at, lambda each: detector.detect(Image(0, "", each, CAMERA), search))
    bodies_ms = milliseconds(1, looked_at, bodies)
    print(f"kernel                       {'in C' if detector.is_native else 'missing: NumPy'}")
    print(f"{model.window.name:<12} heads from {LEAST:.0f}   {whole:7.2f} ms, {1e3 / whole:.0f} images a second")
    print(f"OpenCV's HOG, step 1.1       {bodies_ms:7.2f} ms, {1e3 / bodies_ms:.1f} images a second")
    print(f"ratio                        {bodies_ms / whole:7.2f}")

    greys = [cv2.cvtColor(each, cv2.COLOR_BGR2GRAY) for each in looked_at]
    cells = [pyramid(each, model.window, LEAST, SIZE[1]) for each in greys]
    cells_ms = milliseconds(options.rounds, greys, lambda each: pyramid(each, model.window, LEAST, SIZE[1]))
    print(f"  of it pyramid and cells    {cells_ms:7.2f} ms")
    scores = {}
    for count in MODELS:
        scorer = Scorer([model] * count)
        scores[count] = milliseconds(
            options.rounds, cells, lambda layers, scorer=scorer: [scorer.scores(layer.features) for layer in layers]
        )
        extra = (scores[count] - scores[1]) / max(count - 1, 1) / whole
        each = f", {extra:.1%} of the whole for each further one" if count > 1 else ""
        print(f"  scores of {count} models         {scores[count]:7.2f} ms{each}")
    worst = max((scores[count] - scores[1]) / (count - 1) / whole for count in MODELS[1:])
    held = 1e3 / whole >= FRAMES_PER_SECOND and bodies_ms / whole >= TIMES_AS_FAST and worst < EXTRA
    bounds = f"{FRAMES_PER_SECOND:.0f} images a second, {TIMES_AS_FAST:.0f} times as fast, further models {EXTRA:.0%}"
    print(f"{bounds}: {'held' if held else 'NOT HELD'}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
