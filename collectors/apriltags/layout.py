"""Layouts of the tags on a rigid body, such as a block with a tag on each face or a page with a grid of tags."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.native import CORRECTED
from svfl_data.errors import FormatError, StorageError, UsageError
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.side_files import read_json

CORNERS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
"""Corners of a tag of size 1 in the tag's own axes, (4, 3).

Their order is that of a detection: counterclockwise from the lower left."""
FACES = {
    "+z": ((1, 0, 0), (0, 1, 0)),
    "+x": ((0, 1, 0), (0, 0, 1)),
    "+y": ((-1, 0, 0), (0, 0, 1)),
    "-x": ((0, -1, 0), (0, 0, 1)),
    "-y": ((1, 0, 0), (0, 0, 1)),
    "-z": ((1, 0, 0), (0, -1, 0)),
}
"""Axes x and y of the tag on each face of a block, in the block's axes; the tags on the side faces stand upright."""


@dataclass(frozen=True)
class Tag:
    """Tag on a body.

    Attributes:
        id: Id of the tag in its family.
        size: Edge of the square between the tag's corners, [m].
        T_body_tag: Pose of the tag in the body's axes, (4, 4), [m].
    """

    id: int
    size: float
    T_body_tag: NDArray[np.float64]

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the tag in the body's axes, (4, 3), [m]."""
        scaled: NDArray[np.float64] = self.size * CORNERS @ self.T_body_tag[:3, :3].T + self.T_body_tag[:3, 3]
        return scaled


@dataclass(frozen=True)
class Layout:
    """Layout of the tags on one rigid body.

    Attributes:
        family: Family of all tags.
        tags: Tags by id.
    """

    family: str
    tags: dict[int, Tag]

    @classmethod
    def of(cls, family: str, tags: list[Tag]) -> "Layout":
        """Return the layout of tags of one family, whose ids must differ.

        Args:
            family: Family of all tags.
            tags: Tags on the body.

        Raises:
            UsageError: If there is no such family, there are no tags, two tags have one id, or a size is not a positive
                number.
        """
        if family not in CORRECTED:
            raise UsageError(f"no tag family {family!r}; the families are {', '.join(CORRECTED)}")
        ids = [tag.id for tag in tags]
        if not tags or len(set(ids)) < len(ids):
            raise UsageError(f"a body needs tags with different ids, got ids {ids}")
        if wrong := [tag.id for tag in tags if not 0 < tag.size < np.inf]:
            raise UsageError(
                f"the size of a tag must be positive, tag {wrong[0]} has {tags[ids.index(wrong[0])].size} m"
            )
        return cls(family, dict(zip(ids, tags, strict=True)))

    @classmethod
    def cube(cls, half: float, size: float, first: int = 0, family: str = "tag36h11") -> "Layout":
        """Return the layout of a cube with a tag in the middle of each face, with ids in the order of `FACES`.

        Args:
            half: Half of the cube's edge, [m].
            size: Size of the tags, [m].
            first: Id of the tag on top; the others follow it.
            family: Family of the tags.
        """
        tags = []
        for number, (x, y) in enumerate(FACES.values()):
            T = np.eye(4)
            T[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
            T[:3, 3] = half * T[:3, 2]
            tags.append(Tag(first + number, size, T))
        return cls.of(family, tags)

    @classmethod
    def grid(
        cls, columns: int, rows: int, size: float, pitch: float, first: int = 0, family: str = "tag36h11"
    ) -> "Layout":
        """Return the layout of a flat board of square cells with a tag in the middle of each.

        The ids run along rows from the upper left. The origin is the lower left corner of the lower left cell.

        Args:
            columns: Number of tags beside each other.
            rows: Number of tags above each other.
            size: Size of the tags, [m].
            pitch: Edge of a cell, [m].
            first: Id of the upper left tag.
            family: Family of the tags.
        """
        tags = []
        for number in range(columns * rows):
            row, column = divmod(number, columns)
            T = np.eye(4)
            T[:2, 3] = pitch * (column + 0.5), pitch * (rows - row - 0.5)
            tags.append(Tag(first + number, size, T))
        return cls.of(family, tags)

    def scaled(self, factor: float) -> "Layout":
        """Return the layout of the same body, enlarged by `factor`; the tags and their positions scale alike."""
        tags = [
            Tag(tag.id, factor * tag.size, _moved(tag.T_body_tag, factor * tag.T_body_tag[:3, 3]))
            for tag in self.tags.values()
        ]
        return Layout.of(self.family, tags)

    def write(self, path: Path) -> None:
        """Write the layout to a JSON file.

        Args:
            path: File to write.

        Raises:
            StorageError: If the file cannot be written.
        """
        tags = [{"id": tag.id, "size": tag.size, "T_body_tag": tag.T_body_tag.tolist()} for tag in self.tags.values()]
        write_atomically(path, (json.dumps({"family": self.family, "tags": tags}, indent=1) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> "Layout":
        """Read a layout from a JSON file.

        Args:
            path: File to read.

        Raises:
            StorageError: If the file does not exist or cannot be read.
            FormatError: If the file does not hold a layout.
        """
        try:
            found: dict[str, Any] = read_json(path)
            tags = [
                Tag(int(tag["id"]), float(tag["size"]), _pose(tag["T_body_tag"])) for tag in found["tags"]
            ]  # fmt: skip
            return cls.of(str(found["family"]), tags)
        except OSError as error:
            raise StorageError(f"cannot read {path}: {error.strerror}") from error
        except (FormatError, ValueError, KeyError, TypeError, UsageError) as error:
            words = "it needs family and tags with id, size [m] and T_body_tag (4 x 4)"
            raise FormatError(f"{path} is no layout of tags; {words}: {type(error).__name__}: {error}") from error


def _moved(T: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    moved = T.copy()
    moved[:3, 3] = to
    return moved


def _pose(rows: list[list[float]]) -> NDArray[np.float64]:
    T = np.array(rows, np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all() or not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise ValueError(f"{rows} is not a pose")
    R = T[:3, :3]
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
        raise ValueError(f"{rows} is not a pose: its upper left 3 x 3 is not a rotation")
    return T
