"""The view from above is exact under D4 for any point set, shows known scenes, and is empty where they are hidden.

The pictures are those of `tests.helpers.box_scenes`, which are exact but for the unit of depth. A pixel of the view is
5.3 mm wide. The pixels of the front camera cover about 8 x 11 mm of the table, those of the sharp one 2 x 3 mm.
"""

import dataclasses

import matplotlib.image
import numpy as np
import pytest

from svfl_data.errors import FieldError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.schema.robot import Frame, image_axes
from svfl_data.signals.top_view import EYE_M, TopView
from svfl_data.signals.topdown import topdown, topdown_frame
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import act_on_image, dihedral
from tests.helpers.box_scenes import FACES, GREY, Box, Scene, look_at, moved_camera
from tests.helpers.builders import IMAGE_AXES, episode_arrays, make_episode

WORKSPACE = np.array([[0.35, 0.75], [-0.2, 0.2], [-0.01, 0.25]])
CENTRE = np.array([0.55, 0.0])
D4 = dihedral(4)
UNIT = 1e-4
"""Metres per unit of depth, of the cameras and of the view."""
ROUNDED = 2 * UNIT
"""Bound on the error of a height. The camera's depth contributes half a unit, and another half where the surface is
extended by half a step beyond its edge; rounding the points of the view and their mean contributes half a unit each."""
FINE = (304, 304)
FRONT = look_at()
"""This camera stands obliquely in front of the robot, in the workspace's mirror plane."""
SHARP = look_at(shape=FINE)
"""This is the front camera with four times the pixels along each side, so that its own sampling has little effect."""

BLOCKS = Scene(
    [
        Box((0.03, 0.02, 0.025), (0.63, -0.05, 0.025), 0.3),
        Box((0.025, 0.025, 0.025), (0.51, 0.06, 0.025), -0.5),
        Box((0.02, 0.04, 0.015), (0.6, 0.09, 0.015), 1.1),
        Box((0.015, 0.015, 0.06), (0.45, -0.1, 0.06), 0.2),
    ]
)
GRIPPER = Box((0.05, 0.1, 0.05), (0.62, -0.03, 0.25), 0.2, (200, 90, 200))
"""This box is above the table, where a gripper would be."""
BENEATH = dataclasses.replace(BLOCKS, boxes=[*BLOCKS.boxes, GRIPPER])


def view(size=76, axes=IMAGE_AXES):
    return TopView(CENTRE, axes, size, 0.4, UNIT)


def in_base(matrix):
    """Return the map of base (x, y) that belongs to an element of D4 in image-aligned axes."""
    return IMAGE_AXES.T @ matrix @ IMAGE_AXES


def differing(one, other):
    """Return the share of pixels in which two views, each a colour image and a depth image, differ."""
    return ((one[1] != other[1]) | (one[0] != other[0]).any(axis=-1)).mean()


def acted(matrix, picture):
    return act_on_image(matrix, picture[0], axes=(0, 1)), act_on_image(matrix, picture[1])


@pytest.mark.parametrize("matrix", D4)
@pytest.mark.parametrize("size", [76, 75, 8])
def test_a_turned_point_set_is_exactly_the_turned_picture(matrix, size):
    rng = np.random.default_rng(0)
    places = np.concatenate([rng.uniform(-0.22, 0.22, (2, 5000)), rng.uniform(0.7, 1.0, (1, 5000))])
    colors = rng.integers(0, 256, (3, 5000), dtype=np.uint8)
    color, depth = view(size).splat(places, colors)
    moved = np.concatenate([matrix @ places[:2], places[2:]])[:, order := rng.permutation(5000)]
    moved_color, moved_depth = view(size).splat(moved, colors[:, order])
    np.testing.assert_array_equal(moved_depth, act_on_image(matrix, depth))
    np.testing.assert_array_equal(moved_color, act_on_image(matrix, color, axes=(0, 1)))


@pytest.mark.parametrize(
    ("box", "front"),
    [
        (Box((0.02, 0.11, 0.05), (0.605, 0.09, 0.05)), FACES[1]),
        (Box((0.11, 0.02, 0.05), (0.605, 0.09, 0.05), np.pi / 2), FACES[2]),
    ],
)
def test_the_pictures_of_these_tests_are_as_computed_by_hand(box, front):
    """From 1 m straight above, with a focal length of 100 px; the box is from x 0.585 to 0.625 and y -0.02 to 0.2.

    Rows run along base x and columns along base y from the centre, (50, 50). The box's top is at a depth of 0.9 m: rows
    59.4 to 63.9, columns 47.8 to 72.2. Row 59 sees the front, whose lower edge is at row 58.5, 0.085 / 0.09 m deep.
    """
    camera = look_at((0.5, 0.0, 1.0), (0.5, 0.0, 0.0), fov_deg=2 * np.degrees(np.arctan(0.505)), shape=(101, 101))
    np.testing.assert_allclose(camera.intrinsics, [[100, 0, 50], [0, 100, 50], [0, 0, 1]], atol=1e-9)
    frame = Scene([box]).render(camera, (101, 101))
    assert frame.depth[[50, 58, 59, 60, 63, 64], 50].tolist() == [10000, 10000, 9444, 9000, 9000, 10000]
    assert frame.depth[61, [47, 48, 72, 73]].tolist() == [10000, 9000, 9000, 10000]
    assert frame.color[[50, 59, 60], 50].tolist() == [list(GREY), list(front), list(FACES[4])]
    assert not Scene([box], table=None).render(camera, (101, 101)).depth[:59].any()
    height, color = Scene([box]).from_above(np.array([[0.62, 0.19], [0.63, 0.19]]))
    np.testing.assert_allclose(height, [0.1, 0.0], atol=1e-12)
    assert color.tolist() == [list(FACES[4]), list(GREY)]
    # The ray over the far upper edge, (0.625, 0, 0.1), meets the table at 0.5 + 0.125 / 0.9 = 0.6389.
    points = np.array([[0.638, 0.0, 0.0], [0.64, 0.0, 0.0], [0.62, 0.0, 0.1]])
    assert Scene([box]).shows(camera, points).tolist() == [False, True, True]


@pytest.mark.parametrize("eye", [(1.1, 0.0, 0.6), (0.3, 0.4, 0.7), (0.2, 0.1, -0.5)])
def test_the_image_axes_of_these_tests_are_those_of_the_package(eye):
    for up in ((-1.0, 0.0, 0.0), (0.3, 1.0, 0.2)):
        camera = look_at(eye, up=up)
        np.testing.assert_allclose(camera.image_axes, image_axes(camera.T_base_camera), atol=1e-12)


@pytest.mark.parametrize("matrix", D4)
def test_a_turned_scene_is_the_turned_picture(matrix):
    """Camera and scene are turned together. Rounding moves points over the border of at most 1 in 1000 pixels."""
    camera = moved_camera(FRONT, in_base(matrix), CENTRE)
    expected = topdown_frame(BENEATH.render(FRONT), FRONT, WORKSPACE)
    turned = BENEATH.moved(in_base(matrix), CENTRE).render(camera)
    assert differing(topdown_frame(turned, camera, WORKSPACE), acted(matrix, expected)) <= 1e-3


def test_a_mirrored_picture_of_the_camera_gives_the_mirrored_picture():
    """The camera stands in the workspace's mirror plane, so that flipping its image mirrors the scene."""
    frame = BENEATH.render(FRONT)
    expected = acted(np.diag([-1.0, 1.0]), topdown_frame(frame, FRONT, WORKSPACE))
    flipped = Frame(frame.color[:, ::-1], frame.depth[:, ::-1])
    mirrored = BENEATH.moved(np.diag([1.0, -1.0]), CENTRE).render(FRONT)
    assert (mirrored.depth != flipped.depth).mean() <= 1e-3
    for seen in (flipped, mirrored):
        assert differing(topdown_frame(seen, FRONT, WORKSPACE), expected) <= 1e-3


def standing(places, half=(0.025, 0.025, 0.025)):
    """Return a scene with boxes of one kind that stand on the table at (x, y, yaw)."""
    return Scene([Box(half, (x, y, half[2]), yaw) for x, y, yaw in places])


def from_above(scene, camera, shape=(76, 76), eye=EYE_M):
    """Return the view of a scene that one camera sees, its colour image and its depth image."""
    above = TopView.over(WORKSPACE, camera, eye=eye)
    return above, *above.draw([(scene.render(camera, shape), camera)])


def top_of(above, depth, at, height):
    """Return the mean (row, column) of the pixels around a place that show the box's top, and their heights, [m]."""
    z = above.height_m(depth)
    rows, columns = np.nonzero(np.abs(z - height) < 0.004)
    row, column = above.pixel(np.asarray(at))
    near = np.hypot(rows - row, columns - column) < 12
    return np.array([rows[near].mean(), columns[near].mean()]), z[rows[near], columns[near]]


def errors_of_tops(above, depth, places, height):
    """Return the errors of the centres of tops, (row, column), [px], after a check of their heights."""
    errors = []
    for x, y, _ in places:
        centre, heights = top_of(above, depth, (x, y), height)
        errors.append(centre - above.pixel(np.array([x, y])))
        assert abs(np.median(heights) - height) <= ROUNDED
    return np.array(errors)


def test_boxes_stand_where_they_are_and_are_as_high_as_they_are():
    """An edge may be off by half a pixel of the camera, which is 1 px of the view, and by half a pixel of the view."""
    places = [(0.65, 0.1, 0.3), (0.65, -0.1, 0.3), (0.55, 0.0, 0.3), (0.5, 0.12, 0.3), (0.7, 0.0, 0.3)]
    above, _, depth = from_above(standing(places), FRONT)
    errors = errors_of_tops(above, depth, places, 0.05)
    assert np.abs(errors).max() < 1.5
    assert np.abs(errors.mean(axis=0)).max() < 0.4


def test_with_a_sharper_camera_a_box_is_right_to_half_a_pixel():
    """An edge may be off by a quarter plus half a pixel of the view; the centre is the mean of two opposite edges."""
    half, places = (0.03, 0.02, 0.015), [(0.65, 0.1, 0.3), (0.55, 0.0, 0.3), (0.5, -0.12, 0.3)]
    above, _, depth = from_above(standing(places, half), SHARP, FINE)
    assert np.abs(errors_of_tops(above, depth, places, 0.03)).max() < 0.5
    pixel = above.metres_per_pixel  # one in which any part of the box is seen shows it: half a pixel more on each side
    area = (2 * half[0] + pixel) * (2 * half[1] + pixel)
    for x, y, _ in places:
        assert len(top_of(above, depth, (x, y), 0.03)[1]) * pixel**2 == pytest.approx(area, rel=0.1)


def test_a_camera_straight_above_shows_no_half_pixel_error():
    """An edge appears at the border of the first pixel that it touches. These errors average out over several boxes."""
    camera = look_at((0.55, 0.0, 1.2), fov_deg=25.0, shape=FINE)
    places = [(0.68, 0.1, 0.3), (0.66, -0.03, 0.3), (0.7, -0.14, 0.3), (0.54, 0.13, 0.3), (0.43, 0.06, 0.3)]
    above, _, depth = from_above(standing(places), camera, FINE)
    assert np.abs(errors_of_tops(above, depth, places, 0.05).mean(axis=0)).max() < 0.25


def places_around(above, radius):
    """Return base (x, y) of the centre of each pixel of a view and of points around it, shape (P, S, S, 2), [m]."""
    middle = (np.arange(above.size) - (above.size - 1) / 2) * above.metres_per_pixel
    centres = np.stack(np.meshgrid(middle, -middle), axis=-1) @ above.image_axes + above.centre
    angle = np.arange(12) * np.pi / 6
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return centres + np.concatenate([[[0.0, 0.0]], ring])[:, None, None]


class Truth:
    """True surface around each pixel of a view, within half a pixel of the view and half a pixel of the camera.

    Attributes:
        low: Lowest height that is visible from the eye of the view, shape (S, S), [m].
        high: Highest such height, shape (S, S), [m].
        color: Colour of the surface at the centre of the pixel, shape (S, S, 3).
        plain: Whether the surface has one colour, shape (S, S).
        seen: Whether one of the cameras sees all of the surface, shape (S, S).
        hidden: Whether no camera sees any of the surface, shape (S, S).
    """

    def __init__(self, scene, above, *cameras):
        # A pixel at distance r that is seen from height h covers at most r / f by r / f * r / h of the table.
        corners = above.centre + above.extent / 2 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        radius = 0.0
        for camera in cameras:
            x, y, h = camera.T_base_camera[:3, 3]
            r = np.hypot(np.hypot(*(corners - [x, y]).T).max(), h)
            radius = max(radius, r / camera.intrinsics[0, 0] * np.hypot(1.0, r / h) / 2)
        xy = places_around(above, radius + above.metres_per_pixel / np.sqrt(2))
        height, colors = scene.from_above(xy, above.eye)
        self.low, self.high = height.min(axis=0), height.max(axis=0)
        self.color, self.plain = colors[0], (colors == colors[0]).all(axis=(0, -1))
        shown = [scene.shows(camera, np.concatenate([xy, height[..., None]], axis=-1)) for camera in cameras]
        self.seen = np.any([one.all(axis=0) for one in shown], axis=0)
        self.hidden = ~np.any(shown, axis=(0, 1))


def assert_true(above, color, depth, truth):
    """Check that a view shows the true surface where it was seen, and nothing where it was hidden."""
    shown = depth > 0
    height = above.height_m(depth)[shown]
    assert (height >= truth.low[shown] - ROUNDED).all()
    assert (height <= truth.high[shown] + ROUNDED).all()
    np.testing.assert_array_equal(color[shown & truth.plain], truth.color[shown & truth.plain])
    assert shown[truth.seen].all()
    assert not shown[truth.hidden].any()


MOVES = {"as it is": D4[0], "turned": D4[1], "mirrored": np.diag([-1.0, 1.0])}
"""A quarter turn and a reflection generate D4."""


@pytest.mark.parametrize("matrix", MOVES.values(), ids=MOVES)
def test_every_pixel_shows_what_is_there_and_nothing_where_it_was_hidden(matrix):
    scene = BLOCKS.moved(in_base(matrix), CENTRE)
    above, color, depth = from_above(scene, SHARP, FINE)
    truth = Truth(scene, above, SHARP)
    assert_true(above, color, depth, truth)
    assert truth.seen.mean() > 0.8
    assert truth.hidden.sum() > 150  # the table behind the blocks
    assert (truth.low > 0.02).sum() > 150  # tops


def test_every_pixel_of_the_view_of_a_wide_rolled_camera_is_true():
    """The camera has 240 x 320 pixels, stands beyond a corner of the workspace and is rolled."""
    camera = look_at((0.1, 0.4, 0.6), (0.53, 0.02, 0.0), (0.2, 0.1, 1.0), 45.0, (240, 320))
    above, color, depth = from_above(BLOCKS, camera, (240, 320))
    truth = Truth(BLOCKS, above, camera)
    assert_true(above, color, depth, truth)
    assert min((truth.low > 0.02).sum(), truth.hidden.sum()) > 150


@pytest.mark.parametrize("matrix", D4[1:])
def test_a_scene_that_is_turned_below_the_camera_is_the_turned_picture_where_both_are_seen(matrix):
    """Two blocks are turned about the centre. The pictures differ in at most one pixel along edges."""
    scene = standing([(0.63, -0.05, 0.3), (0.51, 0.06, -0.5)])
    above, _, depth = from_above(scene, SHARP, FINE)
    _, _, moved = from_above(scene.moved(in_base(matrix), CENTRE), SHARP, FINE)
    expected = above.height_m(act_on_image(matrix, depth))
    found = above.height_m(moved)
    rows, columns = np.mgrid[:76, :76] - 37.5
    near = (np.hypot(rows, columns) < 25) & np.isfinite(expected) & np.isfinite(found)
    assert near.sum() > 1500
    differs = near & (np.abs(expected - found) > 0.005)
    assert differs[near].mean() < 0.03
    truth, _ = scene.moved(in_base(matrix), CENTRE).from_above(places_around(above, 1.5 * above.metres_per_pixel))
    assert (np.ptp(truth, axis=0)[differs] > 0.049).all()


@pytest.mark.parametrize("azimuth", [0.0, 0.4, np.pi / 4, np.pi / 2])
def test_a_table_has_no_gaps_and_one_height(azimuth):
    away = np.array([np.cos(azimuth), np.sin(azimuth)])
    camera = look_at((*(CENTRE + 0.55 * away), 0.6), up=(*-away, 0.0))
    camera = dataclasses.replace(camera, image_axes=IMAGE_AXES)
    _, depth = topdown_frame(Scene().render(camera), camera, WORKSPACE)
    assert (depth > 0).all()
    np.testing.assert_allclose(EYE_M - depth * UNIT, 0.0, atol=ROUNDED)


def test_what_was_not_seen_stays_unseen_and_black():
    half_a_table = Scene([Box((1.0, 0.5, 0.01), (0.55, 0.5, -0.01))], table=None)  # y from 0 to 1 m, its top at 0
    _, color, depth = from_above(half_a_table, FRONT)
    assert (depth[:, 40:] > 0).all()  # right is +y
    assert (depth[:, :36] == 0).all()
    assert (color[depth == 0] == 0).all()
    assert not from_above(Scene(table=None), FRONT)[2].any()


def test_behind_a_block_the_table_is_hidden_and_a_second_camera_fills_it():
    scene = standing([(0.65, 0.0, 0.0)])
    above = TopView.over(WORKSPACE, SHARP)
    side = look_at(eye=(0.55, 0.6, 0.6), up=(0.0, -1.0, 0.0), shape=FINE)
    pictures = [(scene.render(camera, FINE), camera) for camera in (SHARP, side)]
    _, alone = above.draw(pictures[:1])
    color, both = above.draw(pictures)
    row, column = np.rint(above.pixel(np.array([0.605, 0.0]))).astype(int)  # 20 mm behind the block
    assert alone[row, column] == 0
    assert above.height_m(both)[row, column] == pytest.approx(0.0, abs=ROUNDED)
    hidden, truth = Truth(scene, above, SHARP).hidden, Truth(scene, above, SHARP, side)
    assert_true(above, color, both, truth)
    assert not alone[hidden].any()
    assert (hidden & truth.seen).sum() > 10


def test_the_highest_point_is_drawn():
    places = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.8]])
    colors = np.array([[10, 200]] * 3, np.uint8)
    color, depth = view(75).splat(places, colors)
    assert color[37, 37].tolist() == [200] * 3
    assert depth[37, 37] == 8000
    assert np.count_nonzero(depth) == 1


def test_a_low_eye_looks_beneath():
    low = TopView.over(WORKSPACE, FRONT, eye=0.1)
    _, depth = low.draw([(Scene(table=z).render(FRONT), FRONT) for z in (0.0, 0.2)])
    np.testing.assert_allclose(low.height_m(depth), 0.0, atol=ROUNDED)


def test_a_low_eye_shows_what_the_camera_saw_beneath_a_gripper():
    """From 1 m the gripper hides the block beneath it. From 0.15 m the view shows what the camera saw of that block."""
    for eye, height in ((EYE_M, 0.3), (0.15, 0.05)):
        above, color, depth = from_above(BENEATH, SHARP, FINE, eye)
        assert_true(above, color, depth, Truth(BENEATH, above, SHARP))
        row, column = np.rint(above.pixel(np.array(BLOCKS.boxes[0].centre[:2]))).astype(int)
        assert above.height_m(depth)[row, column] == pytest.approx(height, abs=ROUNDED)


def test_an_episode_shows_the_latest_frame_at_each_observation():
    arrays = episode_arrays(np.random.default_rng(0), size=76)
    arrays |= {f"cameras/front/{name}": getattr(FRONT, name) for name in ("intrinsics", "T_base_camera")}
    heights = [0.0, 0.02, 0.04]  # frames at the first, the third and after the last observation
    arrays["cameras/front/depth"] = np.stack([Scene(table=z).render(FRONT).depth for z in heights])
    arrays["cameras/front/color"] = np.zeros((3, 76, 76, 3), np.uint8)
    t_ns = arrays["observations/t_ns"]
    arrays["cameras/front/t_ns"] = np.array([t_ns[1], t_ns[3], t_ns[-1] + 1])
    episode = Episode(make_episode().meta, arrays)
    seen = topdown(episode, size=38)
    assert seen.color.shape == (5, 38, 38, 3)
    assert not seen.depth[0].any()  # there was no frame yet
    assert [round(float(z), 3) for z in seen.height_m[1:, 19, 19]] == [0.0, 0.0, 0.02, 0.02]
    for steps in (3, np.int64(3)):
        one = topdown(episode, steps, size=38)
        np.testing.assert_array_equal(one.depth, seen.depth[3])
    assert seen.view.metres_per_pixel == pytest.approx(0.4 / 38)


def test_bad_requests_are_one_clear_line():
    episode = make_episode()
    for wrong, facts in (
        ({"steps": 9}, r"step 9\b.*\b0 to 4\b"),
        ({"steps": -1}, r"step -1\b.*\b0 to 4\b"),
        ({"cameras": ["side"]}, "'side'.*front"),
        ({"size": 0}, r"size.*\b0 px.*\b1\b"),
        ({"extent": -0.1}, r"extent.*-0\.1 m.*positive"),
    ):
        with pytest.raises(UsageError, match=facts) as caught:
            topdown(episode, **wrong)
        assert "\n" not in str(caught.value)
    flat = {path: array for path, array in episode.arrays.items() if "depth" not in path}
    for cameras in (None, ["front"]):
        with pytest.raises(FieldError, match="without depth"):
            topdown(Episode(episode.meta, flat), cameras=cameras)


def test_names_are_drawn_as_they_are_and_not_as_formulas(command, tmp_path):
    episode = make_episode()
    arrays = {path.replace("cameras/front/", r"cameras/$\frac$/"): array for path, array in episode.arrays.items()}
    meta = dataclasses.replace(episode.meta, task=r"$\frac$")
    write_episode(Episode(meta, arrays), tmp_path / "e.hdf5")
    assert command("topdown", tmp_path / "e.hdf5", "--out", tmp_path / "above.png")[0] == 0


def test_the_command_draws_and_refuses(command, tmp_path):
    file, out = tmp_path / "e.hdf5", tmp_path / "above.png"
    write_episode(make_episode(), file)
    code, said, _ = command("topdown", file, "--step", 2, "--out", out)
    assert (code, said.startswith(f"wrote {out}: ")) == (0, True)
    assert matplotlib.image.imread(out).shape[1] > 800
    for wrong, complaint in ((["--step", "9"], "no step 9"), (["--out", "a.jpg"], "must end in .png")):
        code, _, err = command("topdown", file, "--out", out, *wrong)
        assert code != 0
        assert complaint in err
        assert err.count("\n") == 1
