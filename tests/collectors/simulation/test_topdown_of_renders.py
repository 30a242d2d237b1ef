"""The simulation's pictures and the views from above of them are equal to those of `tests.helpers.box_scenes`.

The view from above itself is tested in `tests/svfl_data/signals/test_topdown.py`, on exact pictures.
"""

import dataclasses

import numpy as np
import pytest

from collectors.simulation import CameraConfig, NoiseConfig, World, WorldConfig
from collectors.simulation.camera import CAMERAS, calibration
from svfl_data.schema.robot import Calibration
from svfl_data.signals.top_view import TopView
from tests.helpers.box_scenes import Box, Scene, look_at

WORKSPACE = np.array([[0.35, 0.75], [-0.2, 0.2], [-0.01, 0.25]])
SEEN_BY = {
    "front": CameraConfig(height=304, width=304),
    "low": CameraConfig(152, 200, (0.9, 0.35, 0.25), (0.66, 0.0, 0.02), (0.0, 0.0, 1.0), 30.0),
}
BOXES = Scene([Box((0.03, 0.02, 0.025), (0.66, -0.05, 0.025), 0.4), Box((0.02, 0.02, 0.01), (0.66, 0.08, 0.01), -0.7)])
"""The boxes stand beside the gripper, which is above the workspace's centre when the arm is home."""


def exact(config: CameraConfig) -> Calibration:
    """Return the calibration that the exact pictures use for a camera of the simulation."""
    return look_at(
        config.eye, config.target, config.up, config.fov_deg, (config.height, config.width), config.depth_scale
    )


@pytest.fixture(scope="module")
def seen():
    """Return frames without boxes, frames with boxes, and the calibrations of the cameras."""
    config = dataclasses.replace(WorldConfig(), cameras=SEEN_BY, noise=NoiseConfig.none())
    with World(config) as world:
        world.reset(seed=0)
        bare = world.observe().frames
        for box in BOXES.boxes:
            world.add_box(box.half, box.centre, yaw=box.yaw, mass=0.0, friction=0.5)
        return bare, world.observe().frames, world.cameras


@pytest.mark.parametrize("config", [one for one in (*CAMERAS.values(), *SEEN_BY.values()) if not one.mounted])
def test_the_simulation_and_the_exact_pictures_have_the_same_calibrations(config):
    ours, theirs = exact(config), calibration(config)
    for name in ("intrinsics", "T_base_camera", "image_axes"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=0.0, atol=1e-9)
    assert theirs.depth_scale == ours.depth_scale


@pytest.mark.parametrize("name", SEEN_BY)
def test_the_simulation_sees_boxes_where_they_are(seen, name):
    """Depths may differ by a unit because of single precision, and by more where an edge meets a pixel's centre."""
    bare, frames, _ = seen
    shape = frames[name].depth.shape
    expected = BOXES.render(exact(SEEN_BY[name]), shape).depth
    boxed = (frames[name].depth != bare[name].depth) | (expected != Scene().render(exact(SEEN_BY[name]), shape).depth)
    assert boxed.sum() > 1500
    assert (np.abs(frames[name].depth[boxed].astype(int) - expected[boxed]) > 1).mean() < 0.01


def test_the_view_from_above_of_a_render_shows_boxes_as_that_of_an_exact_picture(seen):
    """The eye is below the gripper. Heights may differ by a unit, and rounding may move few points over a border."""
    _, frames, cameras = seen
    camera = exact(SEEN_BY["front"])
    above = TopView.over(WORKSPACE, cameras["front"], eye=0.1)
    _, depth = above.draw([(frames["front"], cameras["front"])])
    _, expected = above.draw([(BOXES.render(camera, frames["front"].depth.shape), camera)])
    for box in BOXES.boxes:
        row, column = np.rint(above.pixel(np.array(box.centre[:2]))).astype(int)
        around = np.s_[row - 8 : row + 9, column - 8 : column + 9]
        assert above.height_m(depth)[row, column] == pytest.approx(2 * box.half[2], abs=2e-4)
        assert (np.abs(depth[around].astype(int) - expected[around]) > 1).mean() < 0.02
