"""A picture is the recorded images in units that a network takes, whatever else there is around them."""

import numpy as np
import pytest

from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.input_spec import paper_inputs
from svfl_data.signals.pictures import BRIGHTEST, camera_picture, picture
from tests.helpers.builders import make_episode

RNG = np.random.default_rng(0)
IMAGES = {
    "color": RNG.integers(0, 256, (2, 5, 6, 7, 3), np.uint8), "grey": RNG.integers(0, 256, (2, 5, 6, 7), np.uint8),
    "grey16": RNG.integers(0, 65536, (2, 5, 6, 7), np.uint16), "depth": RNG.integers(0, 65536, (2, 5, 6, 7), np.uint16),
}  # fmt: skip


def test_every_number_is_the_recorded_one_in_its_unit():
    """To the last bit: one division or product in float32, so that networks see the same wherever they are."""
    made = picture(IMAGES, 1e-4)
    assert (made.shape, made.dtype) == ((2, 5, 6, 6, 7), np.float32)
    for channel in range(3):
        np.testing.assert_array_equal(made[:, :, channel], IMAGES["color"][..., channel] / np.float32(255))
    for channel, leaf in ((3, "grey"), (4, "grey16")):
        np.testing.assert_array_equal(made[:, :, channel], IMAGES[leaf] / np.float32(BRIGHTEST[leaf]))
    np.testing.assert_array_equal(made[:, :, 5], IMAGES["depth"] * np.float32(1e-4))


@pytest.mark.parametrize("axes", [(), (0,), (1, 0)])
def test_many_pictures_are_each_of_them(axes):
    one = picture({leaf: image[axes] for leaf, image in IMAGES.items()}, 0.001)
    np.testing.assert_array_equal(one, picture(IMAGES, 0.001)[axes])


def test_channels_come_in_the_order_in_which_they_are_asked_for():
    turned = picture(dict(reversed(IMAGES.items())))
    np.testing.assert_array_equal(turned[:, :, [3, 4, 5, 2, 1, 0]], picture(IMAGES))


def test_the_picture_of_a_cut_is_of_the_latest_frame():
    episode = make_episode(steps=3)
    camera = episode.cameras["front"]
    made = camera_picture(cut_steps(episode, paper_inputs("front")), "front", float(camera.depth_scale))
    rows = np.searchsorted(camera.t_ns, episode.t_ns, side="right") - 1
    np.testing.assert_array_equal(made[:, 3], camera.depth_m[rows])
    np.testing.assert_array_equal(made[:, :3], camera.color[rows].transpose(0, 3, 1, 2) / np.float32(255))
