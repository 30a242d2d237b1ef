"""Camera images in the viewer: the calibration is logged once, the images as rows, exact or compressed."""

import io
from typing import Any

import numpy as np
import rerun as rr
from PIL import Image

from svfl_data.viewer.entities.names import CAMERAS, GREY, WHITE, send

CROP = 64 / 76
"""Share of the image's side that networks see (Kohler et al., CoRL 2023, appendix: 76 px are cropped to 64 px)."""
JPEG_QUALITY = 90
CHANNELS = {
    name: f"{name[0].upper()}{name.lstrip('abcdefghijklmnopqrstuvwxyz')}"
    for name in ("uint8", "uint16", "uint32", "int8", "int16", "int32", "float16", "float32", "float64")
}
"""Names that Rerun gives to the types of pixels, by those of NumPy."""


def log_camera(
    recording: rr.RecordingStream,
    entity: str,
    intrinsics: np.ndarray,
    T_base_camera: np.ndarray,
    size: tuple[int, int],
) -> None:
    """Log the pose and the field of view of a fixed camera, and the outline of the crop that networks see.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        intrinsics: Pinhole matrix, shape (3, 3), [px]; the centre of the top left pixel is (0, 0).
        T_base_camera: Pose of the camera in base, shape (4, 4), [m]; camera axes x right, y down, z forward.
        size: Height and width of the images, [px].
    """
    frame = rr.Transform3D(translation=T_base_camera[:3, 3], mat3x3=T_base_camera[:3, :3])
    recording.log(entity, frame, static=True)
    log_lens(recording, entity, intrinsics, size)
    log_crop(recording, entity, size)


def log_lens(recording: rr.RecordingStream, entity: str, intrinsics: np.ndarray, size: tuple[int, int]) -> None:
    """Log the field of view of a camera.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        intrinsics: Pinhole matrix, shape (3, 3), [px]; the centre of the top left pixel is (0, 0).
        size: Height and width of the images, [px].
    """
    height, width = size
    pinhole = np.array(intrinsics)
    pinhole[:2, 2] += 0.5  # Rerun's origin is the corner of the top left pixel; here it is the centre of that pixel
    recording.log(
        entity,
        rr.Pinhole(
            image_from_camera=pinhole, resolution=[width, height], camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.12, color=GREY,
        ),
        static=True,
    )  # fmt: skip


def send_poses(recording: rr.RecordingStream, entity: str, t_ns: np.ndarray, T_base_camera: np.ndarray) -> None:
    """Log the poses of a camera that moves.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        t_ns: Timestamps of the poses, shape (F,), [ns].
        T_base_camera: Poses of the camera in base, shape (F, 4, 4), [m]; where they are NaN, nothing below the entity
            is drawn.
    """
    known = np.isfinite(T_base_camera).all(axis=(1, 2))
    quat_xyzw = np.full((len(t_ns), 4), np.nan)
    quat_xyzw[known] = quaternions(T_base_camera[known, :3, :3])
    frame = rr.Transform3D.columns(translation=T_base_camera[:, :3, 3], quaternion=quat_xyzw)
    send(recording, entity, t_ns, frame)


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """Return rotation matrices as quat_xyzw, shape (F, 4).

    Args:
        rotation: Rotation matrices, shape (F, 3, 3).

    Source: Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", J. Guidance 23 (2000): the
    quaternion is the eigenvector of the largest eigenvalue of a symmetric matrix.
    """
    ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)) = np.moveaxis(rotation, 0, -1)
    rows = [
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    return np.asarray(np.linalg.eigh(np.moveaxis(np.array(rows), -1, 0) / 3)[1][:, :, -1])


def log_crop(recording: rr.RecordingStream, entity: str, size: tuple[int, int]) -> None:
    """Log the outline of the crop that networks see.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        size: Height and width of the images, [px].
    """
    height, width = size
    (left, right), (top, bottom) = crop_range(width), crop_range(height)
    box = rr.Boxes2D(mins=[[left, top]], sizes=[[right - left, bottom - top]], colors=WHITE, radii=0.15)
    recording.log(f"{entity}/crop", box, static=True)


def crop_range(side: int) -> tuple[float, float]:
    """Return the first and the last edge of the middle part of an image that networks see, [px].

    Args:
        side: Height or width of the image, [px].
    """
    kept = round(side * CROP)
    start = (side - kept) // 2
    return float(start), float(start + kept)


def send_color(recording: rr.RecordingStream, entity: str, t_ns: np.ndarray, color: np.ndarray, small: bool) -> None:
    """Log colour images.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        t_ns: Timestamps of the images, shape (F,), [ns].
        color: Images, shape (F, H, W, 3), uint8.
        small: Whether to log the images as JPEG, with about a tenth of the size, instead of the exact pixels.
    """
    send_images(recording, f"{entity}/color", t_ns, color, small)


def send_images(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, pixels: np.ndarray, small: bool) -> None:
    """Log images of any type.

    Args:
        recording: Recording to log to.
        path: Entity of the images.
        t_ns: Timestamps of the images, shape (F,), [ns].
        pixels: Images, shape (F, H, W) or (F, H, W, channels): grey, or red, green, blue (and opacity). Other
            numbers of channels are shown side by side.
        small: Whether images of 8 bits are logged as JPEG, and others of integers as PNG, instead of the plain pixels.
    """
    pixels = pixels.astype(np.uint8) * 255 if pixels.dtype.kind == "b" else pixels
    if pixels.ndim == 4 and pixels.shape[3] not in (3, 4):
        pixels = np.concatenate(list(np.moveaxis(pixels, 3, 0)), axis=2)
    datatype: Any = CHANNELS.get(pixels.dtype.name)
    if datatype is None:
        pixels, datatype = pixels.real.astype(np.float32), "F32"
    rows, height, width = pixels.shape[:3]
    model: Any = {3: "L", 4: "RGB"}[pixels.ndim] + ("A" if pixels.shape[3:] == (4,) else "")
    if small and (datatype == "U8" or (datatype == "U16" and model == "L")):
        kind, options = ("JPEG", {"quality": JPEG_QUALITY}) if datatype == "U8" else ("PNG", {"compress_level": 1})
        kind, options = (kind, options) if model != "RGBA" else ("PNG", {"compress_level": 1})
        blobs = [_encoded(picture, kind, **options) for picture in pixels]
        columns = rr.EncodedImage.columns(blob=blobs, media_type=[f"image/{kind.lower()}"] * rows)
        send(recording, path, t_ns, columns)
        return
    layout = rr.components.ImageFormat(width=width, height=height, color_model=model, channel_datatype=datatype)
    buffer = np.ascontiguousarray(pixels).view(np.uint8).reshape(rows, -1)
    send(recording, path, t_ns, rr.Image.columns(buffer=buffer, format=[layout] * rows))


def log_depth_style(
    recording: rr.RecordingStream, entity: str, depth: np.ndarray, depth_scale: float, small: bool
) -> None:
    """Log the unit and the colour range of the depth images of a camera.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        depth: Some depth images from which the colour range is taken, shape (F, H, W), uint16; 0 means no measurement.
        depth_scale: Metres per unit of depth.
        small: Whether the depth images will be logged as PNG, as for `send_depth`.
    """
    height, width = depth.shape[1:]
    measured = depth[depth > 0]
    near, far = np.percentile(measured, [1, 99]) if measured.size else (0, 1)
    style: dict[str, Any] = {
        "meter": 1 / depth_scale,
        "colormap": "viridis",
        "depth_range": (near, max(far, near + 1)),
        "point_fill_ratio": 0.25,
    }
    if small:
        recording.log(f"{entity}/depth", rr.EncodedDepthImage.from_fields(**style), static=True)
        return
    layout = rr.components.ImageFormat(width=width, height=height, channel_datatype="U16")
    recording.log(f"{entity}/depth", rr.DepthImage.from_fields(format=layout, **style), static=True)


def send_depth(recording: rr.RecordingStream, entity: str, t_ns: np.ndarray, depth: np.ndarray, small: bool) -> None:
    """Log depth images, whose pixels are exact with and without compression.

    Args:
        recording: Recording to log to.
        entity: Entity of the camera.
        t_ns: Timestamps of the images, shape (F,), [ns].
        depth: Images, shape (F, H, W), uint16.
        small: Whether to compress the images as PNG.
    """
    path = f"{entity}/depth"
    if small:
        pictures = [_encoded(picture, "PNG", compress_level=1) for picture in depth]
        kinds = ["image/png"] * len(pictures)
        send(recording, path, t_ns, rr.EncodedDepthImage.columns(blob=pictures, media_type=kinds))
        return
    buffer = np.ascontiguousarray(depth).view(np.uint8).reshape(len(depth), -1)
    send(recording, path, t_ns, rr.DepthImage.columns(buffer=buffer))


def camera_entity(root: str, camera: str) -> str:
    """Return the entity of a camera.

    Args:
        root: Prefix of the episode's entities.
        camera: Name of the camera.
    """
    return f"{root}{CAMERAS}/{camera}"


def _encoded(picture: np.ndarray, kind: str, **options: int) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, kind, **options)
    return file.getvalue()
