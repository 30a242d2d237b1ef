"""The view from above: exact under D4 for any point set, true against renders, honest about what was hidden."""

import dataclasses

import matplotlib.image
import numpy as np
import pytest

from collectors.simulation import World, WorldConfig
from collectors.simulation.camera import CameraConfig, calibration
from svfl_data.errors import FieldError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.signals.top_view import EYE_M, TopView
from svfl_data.signals.topdown import topdown, topdown_frame
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import act_on_image, dihedral
from tests.helpers.builders import IMAGE_AXES, episode_arrays, make_episode

WORKSPACE = np.array([[0.35, 0.75], [-0.2, 0.2], [-0.01, 0.25]])
CENTRE = np.array([0.55, 0.0])
D4 = dihedral(4)


@dataclasses.dataclass
class Shot:
    color: np.ndarray
    depth: np.ndarray


def view(size=76, axes=IMAGE_AXES):
    return TopView(CENTRE, axes, size, 0.4, 1e-4)


def turned(camera, matrix):
    """A camera moved by a group element (in image-aligned axes) about the workspace's centre: what it saw moves too."""
    in_base = IMAGE_AXES.T @ matrix @ IMAGE_AXES
    move = np.eye(4)
    move[:2, :2], move[:2, 3] = in_base, CENTRE - in_base @ CENTRE
    return dataclasses.replace(camera, T_base_camera=move @ camera.T_base_camera)


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


@pytest.fixture(scope="module")
def seen():
    """A table with a block and the gripper above, as the default camera sees it."""
    with World(WorldConfig()) as world:
        world.reset(seed=0)
        block = world.add_box((0.03, 0.02, 0.025), (0.62, -0.05, 0.025), yaw=0.4, mass=0.1, friction=0.5)
        frame = world.observe(render=True).frames["front"]
        assert world.pose(block)[2] == pytest.approx(0.025, abs=1e-3)
        return frame, world.camera


@pytest.mark.parametrize("matrix", D4)
def test_a_turned_scene_is_the_turned_picture(seen, matrix):
    """Camera and scene turned together: all but points that rounding moves over a pixel's border, at most 1 in 1000."""
    frame, camera = seen
    color, depth = topdown_frame(frame, camera, WORKSPACE)
    moved_color, moved_depth = topdown_frame(frame, turned(camera, matrix), WORKSPACE)
    differs = (moved_depth != act_on_image(matrix, depth)) | (
        moved_color != act_on_image(matrix, color, axes=(0, 1))
    ).any(axis=-1)
    assert differs.mean() <= 1e-3


def test_a_mirrored_picture_of_the_camera_gives_the_mirrored_picture(seen):
    """The default camera stands in the workspace's mirror plane: flipping what it sees mirrors the scene."""
    frame, camera = seen
    flipped = Shot(frame.color[:, ::-1], frame.depth[:, ::-1])
    color, depth = topdown_frame(frame, camera, WORKSPACE)
    mirrored_color, mirrored_depth = topdown_frame(flipped, camera, WORKSPACE)
    differs = (mirrored_depth != depth[:, ::-1]) | (mirrored_color != color[:, ::-1]).any(axis=-1)
    assert differs.mean() <= 1e-3


def boxes_from_above(places, half=(0.025, 0.025, 0.025), camera=None):
    """View, colour and depth of boxes on a table. The gripper is home, above the centre: the eye is below it."""
    cameras = {"front": camera or CameraConfig()}
    with World(dataclasses.replace(WorldConfig(), cameras=cameras)) as world:
        world.reset(seed=0)
        for x, y, yaw in places:
            world.add_box(half, (x, y, half[2]), yaw=yaw, mass=0.1, friction=0.5)
        frame = world.observe().frames["front"]
        above = TopView.over(WORKSPACE, world.camera, eye=0.1)
        color, depth = above.draw([(frame, world.camera)])
    return above, color, depth


def top_of(above, depth, at, height):
    """Mean (row, column) of the pixels around a place that show the box's top, and their heights, [m]."""
    z = above.height_m(depth)
    rows, columns = np.nonzero(np.abs(z - height) < 0.004)
    row, column = above.pixel(np.asarray(at))
    near = np.hypot(rows - row, columns - column) < 12
    return np.array([rows[near].mean(), columns[near].mean()]), z[rows[near], columns[near]]


SHARP = CameraConfig(height=304, width=304)
"""The default camera with four times the pixels: what is left is not the camera's own sampling."""


def test_boxes_stand_where_they_are_and_are_as_high_as_they_are():
    """The default camera's pixels cover 8 x 11 mm of the table: twice a pixel of the view is what an edge is worth."""
    errors = []
    for at in [(0.65, 0.1), (0.65, -0.1), (0.55, 0.0), (0.5, 0.12), (0.7, 0.0)]:
        above, _, depth = boxes_from_above([(*at, 0.3)])
        centre, heights = top_of(above, depth, at, 0.05)
        errors.append(centre - above.pixel(np.array(at)))
        assert abs(np.median(heights) - 0.05) < 0.001
    assert np.abs(errors).max() < 2.0
    assert np.abs(np.mean(errors, axis=0)).max() < 0.4


@pytest.mark.parametrize("at", [(0.65, 0.1), (0.55, 0.0), (0.5, -0.12)])
def test_with_a_sharper_camera_a_box_is_right_to_half_a_pixel(at):
    half = (0.03, 0.02, 0.015)
    above, _, depth = boxes_from_above([(*at, 0.3)], half, camera=SHARP)
    centre, heights = top_of(above, depth, at, 0.03)
    assert np.abs(centre - above.pixel(np.array(at))).max() < 0.5
    assert np.abs(np.median(heights) - 0.03) < 0.001
    pixel = above.metres_per_pixel  # one in which any part of the box is seen shows it: half a pixel more on each side
    area = (2 * half[0] + pixel) * (2 * half[1] + pixel)
    assert len(heights) * pixel**2 == pytest.approx(area, rel=0.1)


def test_a_camera_straight_above_shows_no_half_pixel_error():
    """An edge is where the first pixel begins that it touches; over several boxes that averages out."""
    camera = CameraConfig(height=304, width=304, eye=(0.55, 0.0, 1.2), fov_deg=25.0)
    errors = []
    for at in [(0.66, 0.1), (0.66, -0.1), (0.7, -0.12), (0.7, 0.12), (0.68, 0.06)]:
        above, _, depth = boxes_from_above([(*at, 0.3)], camera=camera)
        errors.append(top_of(above, depth, at, 0.05)[0] - above.pixel(np.array(at)))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.25


@pytest.mark.parametrize("matrix", D4[1:])
def test_a_rendered_scene_that_is_turned_is_the_turned_picture_where_both_are_seen(matrix):
    """Blocks turned about the centre below the fixed camera; what differs is one pixel along edges."""
    places = np.array([(0.08, -0.05, 0.3), (-0.04, 0.06, -0.5)])
    turn = np.linalg.det(matrix)
    in_base = IMAGE_AXES.T @ matrix @ IMAGE_AXES
    angle = np.arctan2(in_base[1, 0], in_base[0, 0])
    one, _, depth = boxes_from_above([(*(CENTRE + p[:2]), p[2]) for p in places], camera=SHARP)
    _, _, moved = boxes_from_above([(*(CENTRE + in_base @ p[:2]), turn * p[2] + angle) for p in places], camera=SHARP)
    expected = one.height_m(act_on_image(matrix, depth))
    found = one.height_m(moved)
    rows, columns = np.mgrid[:76, :76] - 37.5
    near = (np.hypot(rows, columns) < 25) & np.isfinite(expected) & np.isfinite(found)
    assert near.sum() > 1500
    assert (np.abs(expected - found)[near] > 0.005).mean() < 0.03


def plane(camera, z=0.0, where=None):
    """What a camera sees of a horizontal plane; `where` says which base (x, y) belong to it, the rest is unseen."""
    rows, columns = np.mgrid[: 2 * camera.intrinsics[1, 2] + 1, : 2 * camera.intrinsics[0, 2] + 1]
    rays = np.stack([columns, rows, np.ones_like(rows)], axis=-1) @ np.linalg.inv(camera.intrinsics).T
    rays = rays @ camera.T_base_camera[:3, :3].T
    depth = (z - camera.T_base_camera[2, 3]) / rays[..., 2]
    xy = camera.T_base_camera[:2, 3] + rays[..., :2] * depth[..., None]
    there = np.ones(depth.shape, bool) if where is None else where(xy)
    return Shot(np.full((*depth.shape, 3), 100, np.uint8), np.where(there, np.rint(depth / 1e-4), 0).astype(np.uint16))


@pytest.mark.parametrize("azimuth", [0.0, 0.4, np.pi / 4, np.pi / 2])
def test_a_table_has_no_gaps_and_one_height(azimuth):
    away = np.array([np.cos(azimuth), np.sin(azimuth)])
    eye = (*(CENTRE + 0.55 * away), 0.6)
    camera = calibration(CameraConfig(eye=eye, up=(*-away, 0.0)))
    camera = dataclasses.replace(camera, image_axes=IMAGE_AXES)
    _, depth = topdown_frame(plane(camera), camera, WORKSPACE)
    assert (depth > 0).all()
    np.testing.assert_allclose(EYE_M - depth * 1e-4, 0.0, atol=1.5e-4)


def test_what_was_not_seen_stays_unseen_and_black():
    camera = calibration(CameraConfig())
    color, depth = topdown_frame(plane(camera, where=lambda xy: xy[..., 1] > 0.0), camera, WORKSPACE)
    assert (depth[:, 40:] > 0).all()  # right is +y
    assert (depth[:, :36] == 0).all()
    assert (color[depth == 0] == 0).all()
    nothing = Shot(np.zeros((76, 76, 3), np.uint8), np.zeros((76, 76), np.uint16))
    assert not topdown_frame(nothing, camera, WORKSPACE)[1].any()


def test_behind_a_block_the_table_is_hidden_and_a_second_camera_fills_it():
    cameras = {"front": CameraConfig(), "side": CameraConfig(eye=(0.55, 0.6, 0.6), up=(0.0, -1.0, 0.0))}
    with World(dataclasses.replace(WorldConfig(), cameras=cameras)) as world:
        world.reset(seed=0)
        world.add_box((0.025, 0.025, 0.025), (0.65, 0.0, 0.025), yaw=0.0, mass=0.1, friction=0.5)
        frames = world.observe().frames
        above = TopView.over(WORKSPACE, world.camera)
        _, alone = above.draw([(frames["front"], world.cameras["front"])])
        _, both = above.draw([(frames[name], world.cameras[name]) for name in cameras])
    row, column = np.rint(above.pixel(np.array([0.605, 0.0]))).astype(int)  # 20 mm behind the block
    assert alone[row, column] == 0
    assert above.height_m(both)[row, column] == pytest.approx(0.0, abs=1e-3)


def test_the_highest_wins_and_a_low_eye_looks_beneath():
    places = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.8]])
    colors = np.array([[10, 200]] * 3, np.uint8)
    color, depth = view(75).splat(places, colors)
    assert color[37, 37].tolist() == [200] * 3
    assert depth[37, 37] == 8000
    assert np.count_nonzero(depth) == 1
    camera = calibration(CameraConfig())
    low = TopView.over(WORKSPACE, camera, eye=0.1)
    _, depth = low.draw([(plane(camera), camera), (plane(camera, z=0.2), camera)])
    np.testing.assert_allclose(low.height_m(depth), 0.0, atol=1.5e-4)


def test_an_episode_shows_the_latest_frame_at_each_observation():
    arrays = episode_arrays(np.random.default_rng(0), size=76)
    camera = calibration(CameraConfig())
    arrays |= {f"cameras/front/{name}": getattr(camera, name) for name in ("intrinsics", "T_base_camera")}
    heights = [0.0, 0.02, 0.04]  # frames at the first, the third and after the last observation
    arrays["cameras/front/depth"] = np.stack([plane(camera, z).depth for z in heights])
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
    for wrong, said in (
        ({"steps": 9}, "no step 9; there are 0 to 4"),
        ({"steps": -1}, "no step -1"),
        ({"cameras": ["side"]}, "no camera 'side'; there are front"),
        ({"size": 0}, "size is 0 px"),
        ({"extent": -0.1}, "extent is -0.1 m"),
    ):
        with pytest.raises(UsageError, match=said) as caught:
            topdown(episode, **wrong)
        assert "\n" not in str(caught.value)
    flat = {path: array for path, array in episode.arrays.items() if "depth" not in path}
    for cameras in (None, ["front"]):
        with pytest.raises(FieldError, match="was recorded without depth"):
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
