"""Rotations and reflections of observations; images are interpolated unless pixels move exactly onto pixels."""

from collections.abc import Callable
from functools import cached_property
from itertools import product

import numpy as np

from svfl_data.symmetry import Part, act, act_on_image, dihedral

View = tuple[bool, int, int]
Cutter = Callable[[np.ndarray, bool], np.ndarray]
"""Function that takes an image (..., H, W) and whether to interpolate it, and returns the part (..., h, w) of it."""
EXACT_DIGITS = 12
"""Decimal places to which a product of matrices is rounded, so that quarter turns have exact 0 and 1."""


class SymmetryAugmentation:
    """Elements of the dihedral group D_N, rotations first, applied to images and vectors; element 0 is the identity.

    Quarter turns and their mirror images only change the order of the pixels. Other elements of D_N interpolate colour
    between the four pixels around a point. Depth is taken from the nearest pixel, because a mean of table and block is
    the depth of neither, and a mean with a pixel without a measurement is not a depth. The corners of a rotated crop
    are filled from the recorded image around the crop, and beyond that image from its nearest border pixel. Vectors are
    rotated and reflected exactly at any angle.

    Args:
        order: Number of rotations, N. There are as many reflections.
        axes: Orthogonal matrix from the axes of the images and vectors to those of the group, shape (2, 2). By default
            they are the same.

    Attributes:
        matrices: Matrices of the elements, shape (2, 2) each, in the axes of the images and vectors.
    """

    def __init__(self, order: int, axes: np.ndarray | None = None) -> None:
        group = dihedral(order)
        if axes is not None and not np.array_equal(axes, np.eye(2)):
            group = [np.round(axes.T @ matrix @ axes, EXACT_DIGITS) + 0.0 for matrix in group]
        self.matrices = group
        self._views = [_view_of(matrix) for matrix in self.matrices]

    def __len__(self) -> int:
        return len(self.matrices)

    def cutter(self, corner: list[int], element: int, size: tuple[int, int]) -> Cutter:
        """Return the function that cuts a rectangle out of images, and rotates or reflects it about its middle.

        Args:
            corner: Upper left pixel (row, column) of the rectangle.
            element: Number of the element that is applied; only the identity is possible if the sides differ.
            size: Height h and width w of the rectangle, [px].
        """
        view, (top, left), (height, width) = self._views[element], corner, size
        if view is None:
            return Between(top, left, height, self.matrices[element])
        transposed, down, across = view
        if transposed:
            down, across = across, down
        box = (Ellipsis, _span(top, height, down), _span(left, width, across))
        if transposed:
            return lambda image, smooth: image[box].swapaxes(-2, -1)
        return lambda image, smooth: image[box]

    def numbers(self, values: np.ndarray, parts: tuple[Part, ...], elements: np.ndarray) -> np.ndarray:
        """Rotate or reflect the numbers of each sample.

        Args:
            values: Numbers whose last axis holds C components, shape (B, ..., C).
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


def _span(start: int, length: int, stride: int) -> slice:
    """Return the slice of some rows or columns, forwards or backwards."""
    if stride > 0:
        return slice(start, start + length)
    return slice(start + length - 1, start - 1 if start else None, -1)


def _view_of(matrix: np.ndarray) -> View | None:
    """Return the view that moves pixels as `act_on_image` does, but faster; None if pixels must be interpolated."""
    if not np.array_equal(matrix, np.round(matrix)):
        return None
    tell_tale = np.arange(4).reshape(2, 2)
    wanted = act_on_image(matrix, tell_tale)
    views = product((False, True), (1, -1), (1, -1))
    return next(view for view in views if np.array_equal(seen(tell_tale, view), wanted))


class Between:
    """Cutter of a square out of images, rotated or reflected about its middle by any orthogonal matrix.

    Args:
        top: First row of the square.
        left: First column of the square.
        size: Height and width h of the square, [px].
        matrix: Orthogonal matrix in image-aligned axes, shape (2, 2).
    """

    def __init__(self, top: int, left: int, size: int, matrix: np.ndarray) -> None:
        self._place, self._size, self._matrix = (top, left), size, matrix

    def __call__(self, image: np.ndarray, smooth: bool) -> np.ndarray:
        """Cut the square out of an image.

        Args:
            image: Image, shape (..., H, W).
            smooth: Whether to interpolate bilinearly; if not, the nearest pixel is taken.

        Returns:
            The square, shape (..., h, h): float32 if interpolated, otherwise of the type of the image.
        """
        place_rows, place_columns = self._places
        rows, columns = np.clip(place_rows, 0, image.shape[-2] - 1), np.clip(place_columns, 0, image.shape[-1] - 1)
        if not smooth:
            return np.asarray(image[..., np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)])
        row, column = rows.astype(np.int64), columns.astype(np.int64)
        lower, righter = np.minimum(row + 1, image.shape[-2] - 1), np.minimum(column + 1, image.shape[-1] - 1)
        down, across = (rows - row).astype(np.float32), (columns - column).astype(np.float32)
        above = image[..., row, column] * (1 - across) + image[..., row, righter] * across
        below = image[..., lower, column] * (1 - across) + image[..., lower, righter] * across
        return np.asarray(above * (1 - down) + below * down)

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        """Row and column in the image of each pixel of the square, shape (h, h) each."""
        (top, left), matrix, middle = self._place, self._matrix, (self._size - 1) / 2
        steps = np.arange(self._size) - middle
        right, up = np.meshgrid(steps, -steps)  # position of each pixel of the result, from the middle
        x = matrix[0, 0] * right + matrix[1, 0] * up  # the inverse of R is R^T
        y = matrix[0, 1] * right + matrix[1, 1] * up
        return top + middle - y, left + middle + x
