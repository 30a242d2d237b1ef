"""Square images at the place and the size that a network sees: cropped, then scaled."""

import torch
from torch import Tensor
from torch.nn import functional

from svfl_data.errors import TrainingError

CROP = 64 / 76
"""Share of the image's side that a crop keeps (Kohler et al., CoRL 2023, appendix: 76 px cropped to 64)."""


def crop_side(side: int, size: int) -> int:
    """Side of the crop from which a network of images of `size` pixels gets its image, [px].

    Raises:
        TrainingError: If the images are too small.
    """
    if side < size:
        raise TrainingError(f"images are {side} x {side} pixels, smaller than the network's {size} x {size}")
    return max(size, round(side * CROP))


def centre_crop(image: Tensor, side: int) -> Tensor:
    """The middle of square images: (B, C, H, H) -> (B, C, side, side)."""
    start = (image.shape[-1] - side) // 2
    return image[..., start : start + side, start : start + side]


def random_crop(image: Tensor, side: int, beyond: int = 0) -> Tensor:
    """A part of each square image at its own random place: (B, C, H, H) -> (B, C, side, side).

    Args:
        image: The images.
        side: Height and width of the crops, [px].
        beyond: How far crops may reach beyond the edges, which are continued outwards, [px].
    """
    corner = torch.randint(-beyond, image.shape[-1] - side + beyond + 1, (len(image), 2))
    return crop_at(image, corner, side)


def crop_at(image: Tensor, corner: Tensor, side: int) -> Tensor:
    """A part of each square image at a place of its own, which may reach beyond the edges: they are continued outwards.

    Args:
        image: Shape (B, C, H, H).
        corner: Row and column of the first pixel, shape (B, 2), int64.
        side: Height and width of the crops, [px].

    Returns:
        Shape (B, C, side, side).
    """
    places = corner[..., None] + torch.arange(side, device=image.device)
    places = places.clamp(0, image.shape[-1] - 1)  # (B, 2, side)
    rows, columns = places[:, 0, :, None], places[:, 1, None]
    sample = torch.arange(image.shape[0], device=image.device)[:, None, None]
    return image.movedim(1, -1)[sample, rows, columns].movedim(-1, 1)  # (B, side, side, C) -> (B, C, side, side)


def scaled(image: Tensor, size: int) -> Tensor:
    """Square images at another size: bilinear, all pixels counting; (B, C, H, H) -> (B, C, size, size)."""
    if image.shape[-1] == size:
        return image
    return functional.interpolate(image, (size, size), mode="bilinear", antialias=True)
