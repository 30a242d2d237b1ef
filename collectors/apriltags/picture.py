"""Pictures of tags in modules, the squares that are the bits, the border and the margin of a tag."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.native import native
from svfl_data.errors import UsageError


@dataclass(frozen=True)
class Shape:
    """Measures of a tag family.

    Attributes:
        count: Number of tags in the family; ids run from 0.
        border: Number of modules along the edge that the size of a tag refers to.
        total: Number of modules along the edge of the whole picture. For families with a black border this includes a
            white margin of one module; the other families have bits outside their border.
    """

    count: int
    border: int
    total: int


def shape(family: str) -> Shape:
    """Return the measures of a tag family.

    Raises:
        UsageError: If there is no such family.
    """
    c = native(family).family
    return Shape(c.ncodes, c.width_at_border, c.total_width)


def modules(family: str, tag: int) -> NDArray[np.bool_]:
    """Return the picture of a tag, upright and with one pixel for each module, (total, total), True for black.

    The picture is drawn here because the library's own ``apriltag_to_image`` draws the white margin in the wrong place,
    and OpenCV's pictures are turned by 180 degrees against what the library means by upright.

    Raises:
        UsageError: If there is no such family or tag.
    """
    c = native(family).family
    if not 0 <= tag < c.ncodes:
        raise UsageError(f"{family} has no tag {tag}; its ids are 0 to {c.ncodes - 1}")
    start = (c.total_width - c.width_at_border) // 2
    black = np.ones((c.total_width, c.total_width), np.bool_)
    ring, edge = (start, c.width_at_border) if c.reversed_border else (start - 1, c.width_at_border + 2)
    last = ring + edge - 1
    black[[ring, last], ring : last + 1] = False
    black[ring : last + 1, [ring, last]] = False
    bits = np.array([int(c.codes[tag]) >> bit & 1 for bit in reversed(range(c.nbits))])
    # The places are signed, whatever the binding says: families with bits outside their border count those below 0.
    x, y = (np.ctypeslib.as_array(place, (c.nbits,)).astype(np.int32) for place in (c.bit_x, c.bit_y))
    black[y + start, x + start] = bits == 0
    return black
