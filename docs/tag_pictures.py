"""Draw docs/images/tag_board.png and docs/images/tagged_cube.png: a page to print, and poses found from tags.

.venv/bin/python docs/tag_pictures.py
"""

from pathlib import Path

import cv2
import numpy as np

from collectors.apriltags.print_files import picture
from collectors.apriltags.print_layout import board_page
from collectors.apriltags.watch import Watch
from collectors.simulation import PandaConfig, World, WorldConfig
from collectors.simulation.bullet import pybullet
from collectors.sources.tagged_expert import watched
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.gripper import Gripper
from svfl_data.errors import CollectError
from svfl_data.schema.robot import Calibration

FOLDER = Path(__file__).parent / "images"
AXES = ((220, 40, 40), (40, 170, 40), (60, 90, 255))  # RGB of x, y, z
LENGTH = 0.045  # [m] of an axis that is drawn
DPI = 72  # pixels per inch of the page
SIDE = 320  # [px] of each picture of the block
FINE = 2  # pixels that are drawn for a pixel of the camera, along each edge
SCENES = (0, 13)  # steps of the episode: before the gripper comes, and while it grasps


def page() -> np.ndarray:
    """Return a picture of the board of ``svfl-collect tags --board 4x5 --size 30``, (H, W) uint8."""
    fine = picture(board_page("tag36h11", 4, 5, 30.0, 0, "a4"), 4 * DPI)
    return np.asarray(cv2.resize(fine, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA))


def cube() -> np.ndarray:
    """Return pictures of a block that is picked, with the axes of the pose from its tags, (H, W, 3) RGB.

    The pictures are those of tag cameras, side by side, one for each of `SCENES`.
    """
    with World(WorldConfig(cameras={}, robot=PandaConfig(full_meshes=True))) as world:
        task = BlockPicking.begin(world, np.random.SeedSequence([2]))
        watch, moves, seen = watched(task), task.expert(Gripper(world, np.random.default_rng(2))), []
        for step in range(max(SCENES) + 1):
            if step in SCENES:
                seen.append(tracked(watch))
            world.step(next(moves))
    return np.concatenate(seen, axis=1)


def tracked(watch: Watch) -> np.ndarray:
    """Return the picture of the first camera that sees the block, with the axes of the pose that it gives.

    Args:
        watch: Watch with the tracker of the block and the cameras.

    Raises:
        CollectError: If no camera sees the block.
    """
    for camera in watch.cameras.values():
        t_ns, color = camera()
        track = watch.tracker.see(color, t_ns, camera.calibration)
        if track is not None and track.age == 0.0:
            return drawn(color, camera.calibration, track.pose)
    raise CollectError("no camera sees the block")


def drawn(color: np.ndarray, known: Calibration, pose: np.ndarray) -> np.ndarray:
    """Return a picture that is cropped around the block, with the axes of a pose drawn into it.

    Args:
        color: Picture of the camera, (H, W, 3) uint8 RGB.
        known: Calibration of the camera.
        pose: Pose of the block: position [m], quat_xyzw, base axes, (7,).

    Returns:
        The picture, (SIDE, SIDE, 3) uint8 RGB.
    """
    image = cv2.resize(color, None, fx=FINE, fy=FINE, interpolation=cv2.INTER_CUBIC)
    R = np.reshape(pybullet.getMatrixFromQuaternion(pose[3:]), (3, 3))
    points = np.concatenate([pose[None, :3], pose[:3] + LENGTH * R.T])
    T = np.linalg.inv(known.T_base_camera)
    pixels = (points @ T[:3, :3].T + T[:3, 3]) @ known.intrinsics.T
    pixels = FINE * (pixels[:, :2] / pixels[:, 2:] + 0.5) - 0.5
    start, *ends = np.round(pixels).astype(int)
    for end, rgb in zip(ends, AXES, strict=True):
        cv2.arrowedLine(image, start, end, rgb, 3, cv2.LINE_AA, tipLength=0.15)
    x, y = np.clip(start - SIDE // 2, 0, np.array(image.shape[1::-1]) - SIDE)
    return np.asarray(image[y : y + SIDE, x : x + SIDE])


def main() -> None:
    """Write both pictures."""
    cv2.imwrite(str(FOLDER / "tag_board.png"), page(), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    cv2.imwrite(str(FOLDER / "tagged_cube.png"), cube()[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
