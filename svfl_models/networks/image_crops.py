"""Cropping and scaling of square images to the part and the size that a network sees."""

import torch
from torch import Tensor
from torch.nn import functional

from svfl_data.errors import TrainingError
from svfl_models.networks.inputs import CROP, IMAGE_SIZES


def crop_side(side: int, size: int, crop: float = CROP) -> int:
    """Return the side of the crop that is scaled to the input image of a network, [px].

    Args:
        side: Height and width of the camera's images, [px].
        size: Height and width of the images that the network takes, [px].
        crop: Share of the camera image's side that the crop keeps, above 0 and at most 1.

    Returns:
        Height and width of the crop, at least `size`, [px].

    Raises:
        TrainingError: If `side` is smaller than `size`.
    """
    if side < size:
        fits = [str(one) for one in IMAGE_SIZES if one <= side]
        raise TrainingError(
            f"images are {side} x {side} pixels, smaller than the network's {size} x {size}; "
            + (f"--image-size {' or '.join(fits)} fits" if fits else f"at least {min(IMAGE_SIZES)} are needed")
        )
    return max(size, round(side * crop))


def centre_crop(image: Tensor, side: int) -> Tensor:
    """Return the middle of square images.

    Args:
        image: Images, shape (B, C, H, H).
        side: Height and width of the crops, [px].

    Returns:
        The crops, shape (B, C, side, side).
    """
    start = (image.shape[-1] - side) // 2
    return image[..., start : start + side, start : start + side]


def random_crop(image: Tensor, side: int, beyond: int = 0) -> Tensor:
    """Return a crop of each square image, at a random place that is drawn for each image.

    Args:
        image: Images, shape (B, C, H, H).
        side: Height and width of the crops, [px].
        beyond: How far a crop may reach beyond the edges of its image, [px]. There it repeats the pixels of the edge.

    Returns:
        The crops, shape (B, C, side, side).
    """
    corner = torch.randint(-beyond, image.shape[-1] - side + beyond + 1, (len(image), 2))
    return crop_at(image, corner, side)


def crop_at(image: Tensor, corner: Tensor, side: int) -> Tensor:
    """Return a crop of each square image, at a place that is given for each image.

    A crop may reach beyond the edges of its image, where it repeats the pixels of the edge.

    Args:
        image: Images, shape (B, C, H, H).
        corner: Row and column of the first pixel of each crop, shape (B, 2), int64.
        side: Height and width of the crops, [px].

    Returns:
        The crops, shape (B, C, side, side).
    """
    places = corner[..., None] + torch.arange(side, device=image.device)
    places = places.clamp(0, image.shape[-1] - 1)  # (B, 2, side)
    rows, columns = places[:, 0, :, None], places[:, 1, None]
    sample = torch.arange(image.shape[0], device=image.device)[:, None, None]
    return image.movedim(1, -1)[sample, rows, columns].movedim(-1, 1)  # (B, side, side, C) -> (B, C, side, side)


def turned(image: Tensor, matrix: Tensor) -> Tensor:
    """Rotate or reflect the contents of square images about their middle, with bilinear interpolation.

    Args:
        image: Images, shape (B, C, H, H).
        matrix: Orthogonal matrix from directions (right, up) in an image to those in its result, shape (B, 2, 2).

    Returns:
        The images, shape (B, C, H, H): what was seen in direction d from the middle is in direction ``matrix @ d``.
        Where an image has nothing to show, the result is 0. A matrix that permutes pixels, such as a turn by 90
        degrees, moves them exactly up to rounding.
    """
    (a, b), (c, d) = matrix.permute(1, 2, 0)
    back = torch.stack([a, -c, -b, d], dim=-1).unflatten(-1, (2, 2))  # the inverse, with y downwards as in the grid
    grid = functional.affine_grid(functional.pad(back, (0, 1)), list(image.shape), align_corners=False)
    return functional.grid_sample(image, grid, mode="bilinear", padding_mode="zeros", align_corners=False)


def scaled(image: Tensor, size: int) -> Tensor:
    """Scale square images bilinearly, with antialiasing.

    Args:
        image: Images, shape (B, C, H, H).
        size: Height and width of the result, [px].

    Returns:
        The scaled images, shape (B, C, size, size). Images of this size already are returned unchanged.
    """
    if image.shape[-1] == size:
        return image
    return functional.interpolate(image, (size, size), mode="bilinear", antialias=True)
