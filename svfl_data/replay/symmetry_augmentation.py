"""Rotations and reflections of observations; images are interpolated unless pixels move exactly onto pixels."""

from itertools import product

import numpy as np

from svfl_data.symmetry import Part, act, act_on_image, dihedral

View = tuple[bool, int, int]


class SymmetryAugmentation:
    """Elements of the dihedral group D_N, rotations first, applied to images and vectors; element 0 is the identity.

    Quarter turns and their mirror images only change the order of the pixels. Other elements of D_N interpolate colour
    between the four pixels around a point. Depth is taken from the nearest pixel, because a mean of table and block is
    the depth of neither, and a mean with a pixel without a measurement is not a depth. The corners of a turned crop are
    filled from the recorded image around the crop, and beyond that image from its nearest border pixel. Vectors are
    rotated and reflected exactly at any angle.

    Args:
        order: Number of rotations, N. There are as many reflections.

    Attributes:
        matrices: Matrices of the elements, shape (2, 2) each, in image-aligned axes.
    """

    def __init__(self, order: int) -> None:
        self.matrices = dihedral(order)
        self._views = [_view_of(matrix) for matrix in self.matrices]

    def __len__(self) -> int:
        return len(self.matrices)

    def image(self, out: np.ndarray, color: np.ndarray, depth: np.ndarray, corner: list[int], element: int) -> None:
        """Cut a square out of an image, and rotate or reflect the square about its middle.

        Args:
            out: Array that the square is written to, shape (4, h, h), float32: colour 0..255, then depth in the units
                of `depth`.
            color: Colour of the image, shape (3, H, W), uint8.
            depth: Depth of the image, shape (H, W), uint16.
            corner: Upper left pixel (row, column) of the square.
            element: Number of the element that is applied.
        """
        view, (top, left), size = self._views[element], corner, out.shape[-1]
        if view is None:
            out[:3], out[3] = between(color, depth, top, left, size, self.matrices[element])
        else:
            box = np.s_[..., top : top + size, left : left + size]
            out[:3], out[3] = seen(color[box], view), seen(depth[box], view)

    def numbers(self, values: np.ndarray, parts: tuple[Part, ...], elements: np.ndarray) -> np.ndarray:
        """Rotate or reflect the numbers of each sample.

        Args:
            values: Numbers in image-aligned axes whose last axis holds C components, shape (B, ..., C).
            parts: Representations of the C components (`svfl_data.symmetry`).
            elements: Number of the element that is applied to each sample, shape (B,).

        Returns:
            The transformed numbers, shape (B, ..., C).
        """
        moved = np.empty_like(values)
        for element in np.unique(elements).tolist():
            chosen = elements == element
            moved[chosen] = act(self.matrices[element], values[chosen], parts)
        return moved


def seen(pixels: np.ndarray, view: View) -> np.ndarray:
    """Return images with rows and columns exchanged or reversed, as a NumPy view without copying.

    Args:
        pixels: Images, shape (..., h, h).
        view: Whether rows and columns are exchanged; then the strides, 1 or -1, along rows and columns.
    """
    transposed, down, across = view
    return (pixels.swapaxes(-2, -1) if transposed else pixels)[..., ::down, ::across]


def _view_of(matrix: np.ndarray) -> View | None:
    """Return the view that moves pixels as `act_on_image` does, but faster; None if pixels must be interpolated."""
    if not np.array_equal(matrix, np.round(matrix)):
        return None
    tell_tale = np.arange(4).reshape(2, 2)
    wanted = act_on_image(matrix, tell_tale)
    views = product((False, True), (1, -1), (1, -1))
    return next(view for view in views if np.array_equal(seen(tell_tale, view), wanted))


def between(
    color: np.ndarray, depth: np.ndarray, top: int, left: int, size: int, matrix: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cut a square out of an image, rotated or reflected about its middle by any orthogonal matrix.

    Colour is interpolated bilinearly; depth is taken from the nearest pixel.

    Args:
        color: Colour of the image, shape (3, H, W).
        depth: Depth of the image, shape (H, W).
        top: First row of the square.
        left: First column of the square.
        size: Height and width h of the square, [px].
        matrix: Orthogonal matrix in image-aligned axes, shape (2, 2).

    Returns:
        Colour (3, h, h), float32, and depth (h, h), in the type of `depth`.
    """
    middle = (size - 1) / 2
    steps = np.arange(size) - middle
    right, up = np.meshgrid(steps, -steps)  # position of each pixel of the result, from the middle
    x, y = matrix[0, 0] * right + matrix[1, 0] * up, matrix[0, 1] * right + matrix[1, 1] * up  # the inverse of R is R^T
    rows = np.clip(top + middle - y, 0, depth.shape[0] - 1)
    columns = np.clip(left + middle + x, 0, depth.shape[1] - 1)
    row, column = rows.astype(np.int64), columns.astype(np.int64)
    lower, righter = np.minimum(row + 1, depth.shape[0] - 1), np.minimum(column + 1, depth.shape[1] - 1)
    down, across = (rows - row).astype(np.float32), (columns - column).astype(np.float32)
    above = color[:, row, column] * (1 - across) + color[:, row, righter] * across
    below = color[:, lower, column] * (1 - across) + color[:, lower, righter] * across
    nearest = depth[np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)]
    return above * (1 - down) + below * down, nearest
