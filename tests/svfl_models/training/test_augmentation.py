import torch

from svfl_models.training.augmentation import DEPTH, recoloured


def test_other_colours_keep_what_is_alike_alike():
    """Two pixels of one colour keep one colour, and depth differences stay."""
    image = torch.rand(50, 4, 8, 8)
    image[..., 0, 0] = image[..., 3, 5]
    other = recoloured(image)
    torch.testing.assert_close(other[..., 0, 0], other[..., 3, 5])
    shift = other[:, 3] - image[:, 3]
    torch.testing.assert_close(shift, shift[:, :1, :1].expand_as(shift))
    assert shift.abs().max() <= DEPTH
    assert (other[:, :3] - image[:, :3]).abs().amax(dim=(1, 2, 3)).min() > 0


def test_every_order_of_the_channels_occurs():
    image = torch.zeros(600, 4, 1, 1)
    image[:, :3, 0, 0] = torch.tensor([0.0, 10.0, 20.0])
    orders = {tuple(row.argsort().tolist()) for row in recoloured(image)[:, :3, 0, 0]}
    assert len(orders) == 6
