"""replay_bag --misses: pictures of the people whom the tracker did not report."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import walk

from people_fusion.core.errors import RecordingError
from people_fusion.evaluation.clear_mot import Event
from people_fusion.replay import replay_bag
from people_fusion.replay.misses import MOST_PICTURES, Scenes, save_misses
from people_fusion.replay.replay import Selection, replay
from people_fusion.tracking.fusion import load_config

BLIND = {"tracker": {"lifecycle": {"confirm_above": 1.0}}}


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walk(tmp_path_factory.mktemp("bags") / "walk.bag", duration_s=12.0)


def watched(path: Path, overrides):
    scenes = Scenes()
    return replay(path, load_config(None, overrides), Selection(), watch=scenes.watch), scenes


def test_who_is_seen_but_never_reported_is_drawn_with_what_was_near(bag: Path, tmp_path: Path) -> None:
    outcome, scenes = watched(bag, BLIND)
    misses = outcome.evaluation.events.count(Event.MISS)
    assert misses == len(outcome.truth.ids) > MOST_PICTURES
    told, drawn = save_misses(tmp_path / "misses", outcome, scenes)
    assert told.startswith(f"of {misses} misses {misses} have a detection within 0.5 m")
    pictures = sorted((tmp_path / "misses").glob("*.png"))
    assert len(pictures) == MOST_PICTURES and drawn.endswith(f"{MOST_PICTURES} pictures")
    assert pictures[0].name.startswith("0000.00s_person_")
    assert all(picture.stat().st_size > 5000 for picture in pictures)


def test_a_scene_is_what_was_seen_last_before_an_instant(bag: Path) -> None:
    outcome, scenes = watched(bag, BLIND)
    stamp_ns, place = int(outcome.truth.stamps_ns[5]), outcome.truth.points[5]
    scene, later = scenes.at(stamp_ns), scenes.at(stamp_ns + 200_000_000)
    nearest = [np.hypot(*(points - place).T).min() for points in (scene.detections, scene.tracks)]
    assert max(nearest) < 0.15
    assert scene.scanners.shape == (1, 2) and len(scene.hits) >= 8 and not scene.confirmed.any()
    assert not np.array_equal(scene.detections, later.detections)
    assert len(scenes.at(stamp_ns + 10**12).hits) == 0


def test_nobody_missed_is_no_picture(bag: Path, tmp_path: Path) -> None:
    outcome, scenes = watched(bag, {"tracker": {"lifecycle": {"confirm_above": 0.0}}})
    rows = outcome.evaluation.events.kinds == Event.MISS
    told, _ = save_misses(tmp_path / "misses", outcome, scenes)
    assert told.startswith(f"of {int(rows.sum())} misses")
    assert len(list((tmp_path / "misses").glob("*.png"))) == min(int(rows.sum()), MOST_PICTURES) < MOST_PICTURES


def test_without_annotations_nobody_is_missed(tmp_path: Path) -> None:
    outcome, scenes = watched(walk(tmp_path / "a.bag", 1.0, truth=False), {})
    with pytest.raises(RecordingError, match="nothing is annotated"):
        save_misses(tmp_path / "misses", outcome, scenes)


def test_the_command_draws_them(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    blind = ["--set", "tracker/lifecycle/confirm_above=1.0"]
    assert replay_bag.main([str(bag), *blind, "--misses", str(tmp_path / "misses")]) == 0
    assert "12 pictures" in capsys.readouterr().out
    (tmp_path / "file").write_text("")
    assert replay_bag.main([str(bag), "--misses", str(tmp_path / "file")]) == 1
    assert "file" in capsys.readouterr().err
