import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.simulation.floor import Floor
from people_fusion.simulation.plan import Plan, RoomConfig, read_map

ROOM = {
    "walls": [
        {"points": [[-3, -2], [3, -2], [3, 2], [-3, 2]], "closed": True},
        {"points": [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], "closed": True},
    ],
    "pillars": [{"at": [2, 1], "radius": 0.2}, {"at": [-2, 1], "radius": 0.2, "mapped": False}],
    "furniture": [{"at": [-2, -1]}],
}
START = np.array([1.5, 0.0])


def plan(room=ROOM):
    return Plan(parse(RoomConfig, room))


def cell(grid, x, y):
    column, row = np.floor((np.array([x, y]) - grid.origin.translation[:2]) / grid.resolution).astype(int)
    return grid.occupancy[row, column]


def test_map_has_what_is_mapped_and_nothing_else():
    grid = plan().grid(START)
    assert cell(grid, 3.0, 0.5) == 100
    assert cell(grid, 2.0, 1.2) == 100
    assert cell(grid, 1.5, 0.0) == 0
    for unmapped in ((-2.0, 1.2), (-2.2, 1.0), (-1.775, -0.775)):
        assert cell(grid, *unmapped) == 0


def test_map_is_unknown_where_the_robot_cannot_come():
    grid = plan().grid(START)
    for hidden in ((0.0, 0.0), (2.0, 1.0), (3.3, 0.0)):
        assert cell(grid, *hidden) == -1


def test_robot_within_a_wall_is_refused():
    with pytest.raises(ConfigError, match="not on free floor"):
        plan().grid(np.array([3.0, 0.0]))


def test_empty_room_and_wall_of_one_point_are_refused():
    with pytest.raises(ConfigError, match="nothing in it"):
        plan({})
    with pytest.raises(ConfigError, match="two points"):
        plan({"walls": [{"points": [[0, 0]]}]})


def test_unknown_key_is_named_with_its_path():
    with pytest.raises(ConfigError, match=r"pillars\[0\]/radus"):
        plan({"pillars": [{"radus": 1.0}]})


def test_push_out_moves_points_to_the_clearance():
    room = plan()
    points = np.array([[2.95, 0.0], [2.0, 1.3], [1.0, -1.0]])
    moved = points + room.push_out(points, np.full(3, 0.3))
    np.testing.assert_allclose(room.gap(moved)[:2], 0.3, atol=1e-9)
    np.testing.assert_array_equal(moved[2], points[2])


def test_route_leads_round_obstacles():
    room = plan()
    floor = Floor(room, START, clearance=0.3)
    start, goal = np.array([-1.5, 0.0]), np.array([1.5, 0.0])
    way = np.concatenate([start[None], floor.route(start, goal)])
    np.testing.assert_array_equal(way[-1], goal)
    share = np.linspace(0.0, 1.0, 50)[:, None, None]
    assert room.gap((way[:-1] + share * (way[1:] - way[:-1])).reshape(-1, 2)).min() > 0.2


def test_random_places_are_free():
    room = plan()
    floor = Floor(room, START, clearance=0.3)
    rng = np.random.default_rng(0)
    places = np.array([floor.random_place(rng) for _ in range(200)])
    assert room.gap(places).min() > 0.2
    assert (np.abs(places) < [3.0, 2.0]).all()


def write_map(folder, image, yaml="image: room.pgm\nresolution: 0.1\norigin: [-1.0, -2.0, 0.0]\n"):
    (folder / "room.pgm").write_bytes(image)
    (folder / "room.yaml").write_text(yaml)
    return str(folder / "room.yaml")


def walled_image(kind):
    pixels = np.full((20, 30), 254, np.uint8)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    pixels[3:5, 10:12] = 0  # third and fourth row from the top
    body = pixels.tobytes() if kind == b"P5" else b" ".join(b"%d" % value for value in pixels.ravel())
    return kind + b"\n# made for a test\n30 20\n255\n" + body


@pytest.mark.parametrize("kind", [b"P5", b"P2"])
def test_room_from_an_occupancy_grid_has_walls_at_the_borders_of_its_cells(tmp_path, kind):
    room = plan({"grid": write_map(tmp_path, walled_image(kind))})
    np.testing.assert_allclose(room.gap(np.array([[0.5, -1.0], [0.4, -0.45]])), [np.hypot(0.3, 0.5), 0.2])
    np.testing.assert_allclose(room.bounds, [[-1.0, -2.0], [2.0, 0.0]])
    grid = room.grid(np.array([1.0, -1.0]))
    assert cell(grid, 1.5, -1.0) == 0
    assert cell(grid, 0.02, -0.4) == 100  # left border of the block, x = 0, between y = -0.5 and -0.3


def test_missing_map_is_one_clear_error(tmp_path):
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: No such file"):
        read_map(str(tmp_path / "nowhere.yaml"))
    (tmp_path / "room.yaml").write_text("image: gone.pgm")
    with pytest.raises(ConfigError, match=r"gone\.pgm: No such file"):
        read_map(str(tmp_path / "room.yaml"))


@pytest.mark.parametrize(
    "image", [b"", b"P5\n30 20\n", b"P5\n30 20\n255\n123", b"P6\n1 1\n255\nabc", b"\x89PNG\r\n\x1a\n"]
)
def test_damaged_map_image_is_one_clear_error(tmp_path, image):
    with pytest.raises(ConfigError, match=r"room\.pgm: not an 8 bit PGM"):
        read_map(write_map(tmp_path, image))
