"""A picture of the camera on the gripper, turned into the axes of the base, turns with the simulated world.

Blocks and gripper are turned about the workspace centre; the arm's base and the light stay where they are. The camera
turns with the gripper, so its picture stays the same: an invariant. After `turned`, it is a picture that turns with the
world, which is what a symmetric network takes it for.
"""

import numpy as np
import pytest
import torch
from torch import Tensor

from collectors.robots import OWN, make
from collectors.simulation import NoiseConfig, World, WorldConfig
from collectors.simulation.camera import CAMERAS
from svfl_data.schema.optics import mounted
from svfl_data.signals.camera_poses import frame_axes
from svfl_data.symmetry import element
from svfl_models.networks.image_crops import turned
from svfl_models.symmetry.actions import act_on_image
from tests.helpers.worlds import hold, move

pytestmark = pytest.mark.slow

BLOCKS = [
    ((0.0, 0.0), 0.2, (0.8, 0.1, 0.1)),
    ((0.05, 0.03), 0.7, (0.1, 0.7, 0.1)),
    ((-0.02, 0.07), -0.3, (0.1, 0.1, 0.9)),
]
"""Offset from the workspace centre [m], yaw [rad] and colour of each block."""
YAW, HEIGHT, HALF = -0.6, 0.14, 0.02
TURNS = [30, 60, 90]
"""From a yaw of -34 degrees, as far as the gripper turns."""


@pytest.fixture(scope="module", params=OWN)
def world(request):
    config = WorldConfig(robot=make(request.param), noise=NoiseConfig.none(), cameras={"wrist": CAMERAS["wrist"]})
    with World(config) as world:
        yield world


def seen(world: World, degrees: float) -> tuple[Tensor, np.ndarray]:
    """Picture of a turned scene, colour 0..1, (1, 3, H, H), and its axes, (2, 2)."""
    matrix = element(degrees, False)
    centre = world.workspace[:2].mean(axis=1)
    world.reset(seed=0)
    for offset, yaw, color in BLOCKS:
        xy = centre + matrix @ offset
        world.add_box((HALF,) * 3, (*xy, HALF), yaw + np.radians(degrees), mass=0.0, friction=0.5, color=color)
    move(world, (*(centre + matrix @ (0.01, -0.02)), HEIGHT, YAW + np.radians(degrees)))
    hold(world, 10)
    color = world.observe().frames["wrist"].color
    pose = mounted(world.tcp[None], world.cameras["wrist"].T_tcp_camera)
    return torch.from_numpy(color.astype(np.float32) / 255).permute(2, 0, 1)[None], frame_axes(pose)[0]


def in_base(picture: Tensor, axes: np.ndarray) -> Tensor:
    return turned(picture, torch.from_numpy(axes.T[None]).to(picture))


def difference(one: Tensor, other: Tensor) -> float:
    """Mean absolute difference inside the circle that no turn leaves, as a share of the mean contrast there."""
    side = one.shape[-1]
    place = torch.linspace(-1, 1, side)
    inside = place[:, None] ** 2 + place**2 < 0.9
    contrast = (one - one[..., inside].mean(dim=-1)[..., None, None])[..., inside].abs().mean()
    return float((one - other)[..., inside].abs().mean() / contrast)


@pytest.mark.parametrize("degrees", TURNS)
def test_a_wrist_picture_turns_with_the_world_once_it_is_in_base_axes(world, degrees):
    picture, axes = seen(world, 0)
    other, other_axes = seen(world, degrees)
    matrix = element(degrees, False)
    np.testing.assert_allclose(other_axes, axes @ matrix.T, atol=0.01)  # of radians: the arm is 0.5 degrees compliant
    expected = act_on_image(matrix, in_base(picture, axes))
    assert difference(other, picture) < 0.05  # as it is, the picture is an invariant
    assert difference(in_base(other, other_axes), expected) < 0.1
    assert difference(other, act_on_image(matrix, picture)) > 0.3  # the liar: as if the camera stood still
