"""What a sensor could see of a person, and so what it means that it saw nobody."""

import numpy as np
import pytest

from people_fusion.core.measurements import PERSON_DEPTH_M, Sight

HALF_WIDTH = 0.2
PERSON = np.array([[3.0, 0.0]])


def fan(ranges, yaw=0.0, position=(0.0, 0.0), range_max=30.0, turn=1):
    """A scanner of 181 beams over half a circle; all ranges alike, or one each."""
    return Sight(
        np.array(position), yaw, -turn * np.pi / 2, turn * np.pi / 180, np.broadcast_to(ranges, 181), range_max
    )


def visible(sight, points=PERSON):
    return sight.visible(np.array(points, dtype=float), HALF_WIDTH).tolist()


@pytest.mark.parametrize(
    ("ended_at", "seen"),
    [
        (2.0, 0.0),  # something hides the person
        (3.0 - PERSON_DEPTH_M - 0.01, 0.0),
        (3.0 - PERSON_DEPTH_M + 0.01, 1.0),  # the person, or nobody and something where the person would be
        (3.0, 1.0),
        (3.2, 1.0),  # the background right behind: whoever had stood there would have been hit
        (30.0, 1.0),
        (np.nan, 0.0),  # no information is none of absence
    ],
)
def test_beams_that_end_on_the_background_have_seen_who_is_not_there(ended_at, seen):
    assert visible(fan(ended_at)) == [seen]


def test_background_that_the_cue_could_not_tell_from_a_person_says_nothing_before_it():
    """The cue gives the metres up to which it would have told a person, less the person's depth."""
    wall, dilation = 3.1, 0.2
    sight = fan(wall - dilation - PERSON_DEPTH_M)
    assert visible(sight, [[wall - 0.1, 0.0], [wall - dilation - 0.01, 0.0], [1.0, 0.0]]) == [0.0, 1.0, 1.0]


def test_half_hidden_person_is_half_seen():
    ranges = np.full(181, 30.0)
    ranges[:90] = 1.0
    assert visible(fan(ranges))[0] == pytest.approx(0.5, abs=0.1)


def test_nobody_is_seen_outside_the_field_or_beyond_the_reach():
    assert visible(fan(30.0), [[-3.0, 0.0], [31.0, 0.0], [3.0, 0.0]]) == [0.0, 0.0, 1.0]
    assert visible(fan(np.zeros(181))) == [0.0]
    assert Sight(np.zeros(2), 0.0, 0.0, 0.1, np.zeros(0), 30.0).visible(PERSON, HALF_WIDTH).tolist() == [0.0]
    assert fan(30.0).visible(np.zeros((0, 2)), HALF_WIDTH).tolist() == []


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_sensor_anywhere_looks_its_own_way(yaw, turn):
    ranges = np.full(181, 30.0)
    ranges[:60] = 1.0  # the first third in the sensor's own direction of turning
    sight = fan(ranges, yaw=yaw, position=(5.0, -2.0), turn=turn)
    angles = yaw + turn * np.radians([-60.0, 0.0, 60.0])
    people = np.array([5.0, -2.0]) + 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    assert visible(sight, people) == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("turn", [1, -1])
def test_full_circle_has_no_seam(turn):
    sight = Sight(np.zeros(2), 0.0, -turn * np.pi, turn * np.pi / 20, np.full(40, 30.0), 30.0)
    angles = np.linspace(-np.pi, np.pi, 200)
    assert set(visible(sight, 3.0 * np.column_stack([np.cos(angles), np.sin(angles)]))) == {1.0}


@pytest.mark.parametrize("turn", [1, -1])
def test_beam_stands_for_half_an_increment_to_both_sides(turn):
    ranges = np.full(40, 30.0)
    ranges[[0, 10]] = 1.0
    sight = Sight(np.zeros(2), 0.0, 1.0, turn * np.pi / 20, ranges, 30.0)
    angles = 1.0 + turn * np.pi / 20 * np.array([-0.6, -0.4, 0.4, 0.6, 9.4, 9.6, 10.4, 10.6])
    points = 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    assert sight.visible(points, 1e-3).tolist() == [1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]
