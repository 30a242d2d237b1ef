"""Rotations and reflections of what was seen: exact where pixels fall on pixels, interpolated where they do not."""

from itertools import product

import numpy as np

from svfl_data.symmetry import Part, act, act_on_image, dihedral

View = tuple[bool, int, int]


class SymmetryAugmentation:
    """The elements of D_N, rotations first; number 0 leaves everything as it is.

    Quarter turns and their mirror images only change the order of pixels. Other elements of a D_N interpolate colour
    between the four pixels around a point. Depth is that of the nearest pixel: a mean of table and block would be the
    depth of neither, and a mean with "nothing measured" no depth at all. What a turned crop sees beyond its own borders
    comes from the recorded image around it, and beyond that image from its nearest border pixel. Numbers are turned
    exactly, whatever the angle.

    Args:
        order: Rotations, N; there are as many reflections.

    Attributes:
        matrices: The elements, shape (2, 2) each, in image-aligned axes.
    """

    def __init__(self, order: int) -> None:
        self.matrices = dihedral(order)
        self._views = [_view_of(matrix) for matrix in self.matrices]

    def __len__(self) -> int:
        return len(self.matrices)

    def image(self, out: np.ndarray, color: np.ndarray, depth: np.ndarray, corner: list[int], element: int) -> None:
        """Cut a square out of an image and turn it about its middle.

        Args:
            out: Where to write it, shape (4, h, h), float32: colour 0..255, then depth in units.
            color: Shape (3, H, W).
            depth: Shape (H, W).
            corner: Upper left pixel (row, column) of the square.
            element: Which element.
        """
        view, (top, left), size = self._views[element], corner, out.shape[-1]
        if view is None:
            out[:3], out[3] = between(color, depth, top, left, size, self.matrices[element])
        else:
            box = np.s_[..., top : top + size, left : left + size]
            out[:3], out[3] = seen(color[box], view), seen(depth[box], view)

    def numbers(self, values: np.ndarray, parts: tuple[Part, ...], elements: np.ndarray) -> np.ndarray:
        """Turn the numbers of each sample, shape (B, ..., C), by the element of the sample, shape (B,)."""
        moved = np.empty_like(values)
        for element in np.unique(elements).tolist():
            chosen = elements == element
            moved[chosen] = act(self.matrices[element], values[chosen], parts)
        return moved


def seen(pixels: np.ndarray, view: View) -> np.ndarray:
    """Images (..., h, h) seen another way round, without copying them.

    Args:
        pixels: The images.
        view: Whether rows become columns; then the strides, 1 or -1, along rows and columns.
    """
    transposed, down, across = view
    return (pixels.swapaxes(-2, -1) if transposed else pixels)[..., ::down, ::across]


def _view_of(matrix: np.ndarray) -> View | None:
    """The view that moves pixels as `act_on_image` does, in a fraction of its time; None if they would be mixed."""
    if not np.array_equal(matrix, np.round(matrix)):
        return None
    tell_tale = np.arange(4).reshape(2, 2)
    wanted = act_on_image(matrix, tell_tale)
    views = product((False, True), (1, -1), (1, -1))
    return next(view for view in views if np.array_equal(seen(tell_tale, view), wanted))


def between(
    color: np.ndarray, depth: np.ndarray, top: int, left: int, size: int, matrix: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """A square of an image turned about its middle by any angle: colour bilinear, depth of the nearest pixel.

    Args:
        color: Shape (3, H, W).
        depth: Shape (H, W).
        top: First row of the square.
        left: First column of the square.
        size: Its height and width h, [px].
        matrix: Orthogonal matrix, shape (2, 2), image-aligned axes.

    Returns:
        Colour (3, h, h) float32 and depth (h, h).
    """
    middle = (size - 1) / 2
    steps = np.arange(size) - middle
    right, up = np.meshgrid(steps, -steps)  # of each pixel of the result, from the middle
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
