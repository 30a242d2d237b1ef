"""Pictures as networks take them, made from recorded images: the same in training, acting and environments."""

from collections.abc import Mapping

import numpy as np

BRIGHTEST = {"color": 255, "grey": 255, "grey16": 65535}
"""Number of the brightest pixel of each kind of image that a network takes, by the last part of its path."""
DEPTH = "depth"


def picture(images: Mapping[str, np.ndarray], depth_scale: float = 1.0) -> np.ndarray:
    """Return images as the channels of one picture: colour and grey 0..1, depth in [m].

    Args:
        images: Images with the same leading axes, in the order of the channels, by the last part of their path: a key
            of `BRIGHTEST` or ``depth``. Shape (..., H, W, 3) for ``color``, and (..., H, W) for others.
        depth_scale: Metres per unit of depth.

    Returns:
        The picture, shape (..., C, H, W), float32.
    """
    planes = {leaf: image.swapaxes(-1, -2).swapaxes(-2, -3) if leaf == "color" else image[..., None, :, :]
              for leaf, image in images.items()}  # colour (..., H, W, 3) -> (..., 3, H, W)  # fmt: skip
    *lead, _, height, width = next(iter(planes.values())).shape
    out = np.empty((*lead, sum(plane.shape[-3] for plane in planes.values()), height, width), np.float32)
    first = 0
    for leaf, plane in planes.items():
        channels = out[..., first : first + plane.shape[-3], :, :]
        if leaf == DEPTH:
            np.multiply(plane, np.float32(depth_scale), out=channels, dtype=np.float32)
        else:
            np.divide(plane, np.float32(BRIGHTEST[leaf]), out=channels, dtype=np.float32)
        first += plane.shape[-3]
    return out


def camera_picture(seen: Mapping[str, np.ndarray], camera: str, depth_scale: float) -> np.ndarray:
    """Return the latest RGB-D pictures of a camera in a cut, the paper's image input: RGB 0..1, then depth in [m].

    Args:
        seen: Values at S observations, as `svfl_data.sampling.cut.cut` returns them.
        camera: Name of the camera.
        depth_scale: Metres per unit of depth.

    Returns:
        The pictures, shape (S, 4, H, W), float32. One is black where there was no frame yet.
    """
    return picture({leaf: seen[f"cameras/{camera}/{leaf}"][:, -1] for leaf in ("color", DEPTH)}, depth_scale)
