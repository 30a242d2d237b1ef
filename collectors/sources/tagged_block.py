"""A simulated cube with AprilTags on its faces, for one PyBullet world."""

import tempfile
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.layout import FACES, Layout
from collectors.apriltags.picture import modules, shape
from collectors.simulation.bullet import pybullet

MODULE_PX = 4  # texture pixels along a module; the renderer does not blend pixels, so more would only cost memory


def largest_tag(half: float, family: str = "tag36h11") -> float:
    """Return the size of the largest tag, [m], that fits with its margin on a face of a cube.

    Args:
        half: Half the edge of the cube, [m].
        family: Family of the tag.
    """
    measures = shape(family)
    return 2.0 * half * measures.border / measures.total


def wear_tags(client: int, body: int, half: float, first: int = 0, family: str = "tag36h11") -> tuple[int, Layout]:
    """Replace a cube by an equal cube that has a tag on each face, as large as fits.

    Args:
        client: PyBullet client id of the world.
        body: Body id of the cube, which is removed.
        half: Half the edge of the cube, [m].
        first: Id of the tag on top. The other tags have the ids that follow.
        family: Family of the tags.

    Returns:
        The body id of the tagged cube, and the layout of its tags.
    """
    (x, y, z), quat_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
    mass, friction, *_ = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)
    pybullet.removeBody(body, physicsClientId=client)
    layout = Layout.cube(half, largest_tag(half, family), first, family)
    box = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=(half, half, half), physicsClientId=client)
    tagged: int = pybullet.createMultiBody(
        mass, box, _visual(client, half), (x, y, z), quat_xyzw, physicsClientId=client
    )
    pybullet.changeDynamics(tagged, -1, lateralFriction=friction, physicsClientId=client)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tags.png"
        cv2.imwrite(str(file), _texture(layout))
        texture = pybullet.loadTexture(str(file), physicsClientId=client)
    pybullet.changeVisualShape(tagged, -1, textureUniqueId=texture, physicsClientId=client)
    return tagged, layout


def _visual(client: int, half: float) -> int:
    """Return the visual shape of a cube, whose texture holds the faces side by side in the order of `FACES`."""
    points, places, normals, triangles = [], [], [], []
    for number, (x, y) in enumerate(FACES.values()):
        right, up = np.array(x, float), np.array(y, float)
        out = np.cross(right, up)
        for u, v in ((0, 0), (1, 0), (1, 1), (0, 1)):
            points.append((half * (out + (2 * u - 1) * right + (2 * v - 1) * up)).tolist())
            places.append(((number + u) / len(FACES), v))
            normals.append(out.tolist())
        triangles += [4 * number + corner for corner in (0, 1, 2, 0, 2, 3)]
    visual: int = pybullet.createVisualShape(
        pybullet.GEOM_MESH, vertices=points, indices=triangles, uvs=places, normals=normals,
        rgbaColor=(1.0, 1.0, 1.0, 1.0), physicsClientId=client,
    )  # fmt: skip
    return visual


def _texture(layout: Layout) -> NDArray[np.uint8]:
    """Return a texture that holds the faces side by side in the order of `FACES`, grey levels (H, W) uint8."""
    faces = [np.where(modules(layout.family, tag), 0, 255).astype(np.uint8) for tag in layout.tags]
    return np.asarray(np.kron(np.concatenate(faces, axis=1), np.ones((MODULE_PX, MODULE_PX))), np.uint8)
