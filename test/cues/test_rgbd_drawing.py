"""What the RGB-D cue did, to be looked at."""

from __future__ import annotations

import dataclasses

import numpy as np
from camera_scenes import Ideal
from depth_scenes import Box, Person, Stand, image_of, pose_of

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.rgbd.drawing import FLOOR, PEOPLE, PERSON, annotated, coloured_cloud
from people_fusion.cues.rgbd.rgbd import RgbdCue, RgbdCueConfig

POSE = pose_of(1.5, 5.0)
TWO = [Person(1.8, -0.5, 1.6), Person(3.0, 0.8, 1.85)]
POST = Box((3.2, -1.5, 0.0), (3.6, -1.1, 1.5))


def looked_at(image):
    cue = RgbdCue(RgbdCueConfig(), name="kinect", frames=FramesConfig())
    cue.measure(image, Stand(POSE))
    return cue.look


def of(colour, colours):
    return (colours == colour).all(axis=1)


def test_floor_and_people_have_colours_of_their_own_in_the_cloud():
    image = image_of(POSE, TWO, [POST])
    cloud = coloured_cloud(image, looked_at(image))
    places = POSE.apply(cloud.points)
    is_floor = of(FLOOR, cloud.colours)
    assert np.abs(places[is_floor, 2]).max() < 0.12 and np.mean(is_floor) > 0.1
    people = [of(PEOPLE[n], cloud.colours) for n in range(2)]
    middles = [np.median(places[each, :2], axis=0) for each in people]
    for person in TWO:
        assert min(np.hypot(*(middle - person.head[:2])) for middle in middles) < 0.2, person
    rest = ~(is_floor | people[0] | people[1])
    assert (np.abs(places[rest, 0] - 3.2) < 0.05).sum() > 500  # the post


def test_the_picture_shows_each_person_in_a_box():
    image = image_of(POSE, TWO, [POST])
    shown = annotated(image, looked_at(image))
    assert shown.shape == (480, 640, 3) and shown.dtype == np.uint8
    heads = image.camera.project((np.array([person.head for person in TWO]) - POSE.translation) @ POSE.rotation)
    rows, columns = np.nonzero((shown == PERSON).all(axis=2))
    for column, row in heads:
        for side in (-1, 1):  # of the head's box
            beside = (np.abs(rows - row) < 5) & (side * (columns - column) > 10) & (side * (columns - column) < 80)
            assert beside.any(), (column, row, side)


def test_what_is_neither_floor_nor_a_person_is_shown_as_it_looks():
    image = image_of(POSE, TWO)
    colour = np.random.default_rng(1).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    image = dataclasses.replace(image, colour=colour)
    before = colour.copy()
    look = looked_at(image)
    same = (annotated(image, look) == colour).all(axis=2)
    assert same[:100].mean() > 0.9 and same[-50:].mean() < 0.3  # the wall above everybody; floor and feet
    np.testing.assert_array_equal(colour, before)
    rows = slice(0, 40, 2)
    cloud = coloured_cloud(image, look)
    np.testing.assert_array_equal(cloud.colours[: 20 * 320].reshape(20, 320, 3), colour[rows, ::2])


def test_an_image_without_depths_is_a_picture_without_a_cloud():
    camera = Ideal(161, 121, 130.0)  # of odd numbers of rows and columns
    image = DepthImage(1, "depth", np.full((121, 161), np.nan, dtype=np.float32), camera)
    look = looked_at(image)
    assert not annotated(image, look).any()
    assert len(coloured_cloud(image, look).points) == 0
