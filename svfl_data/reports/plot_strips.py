"""Rows of pictures in the picture of an episode: what cameras saw, and arrays whose rows are pictures."""

import math
import textwrap

import numpy as np
from matplotlib.axes import Axes

from svfl_data.reports.plot_curves import MOST_CURVES
from svfl_data.reports.plot_style import GREY, LABEL, NAME
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.field import Field
from svfl_data.schema.field_words import camera_pose, clock_of, own, title
from svfl_data.system.printable import printable

FRAMES = 8  # images in a strip
WIDEST = 6  # largest width of a picture of rows of one axis, in its heights
PICTURE = 0.9  # share of a strip's height that the images take; the rest is for the times above them
KINDS = {"color": "colour", "grey": "grey", "grey16": "grey, 16 bits"}


def camera_strip(axis: Axes, episode: Episode, camera: Camera, kind: str) -> None:
    """Draw evenly chosen images of a camera in a row, and the label into the last colour image.

    Args:
        axis: Axes to draw into.
        episode: Episode of the camera.
        camera: Camera with at least one frame.
        kind: Last part of the path of the images, such as ``color``.
    """
    images = camera.depth_m if kind == "depth" else _drawable(np.asarray(camera.arrays[kind]))
    insets = _row(axis, images, camera.t_ns, holes=kind == "depth")
    if kind == "color":
        _label(insets[-1], episode, camera)
    near, far = _range(images, holes=kind == "depth")
    pose = camera_pose(camera.name, episode.arrays)
    depth = f"depth, m:\ndark {near:.2f}\nbright {far:.2f}"
    words = depth if kind == "depth" else KINDS.get(kind, printable(kind, NAME))
    place = f"\n({pose})" if pose and kind != "depth" else ""
    axis.text(
        1.01, 0.45, f"{printable(camera.name, NAME)}\n{words}{place}", transform=axis.transAxes, fontsize=8, va="center"
    )


def field_strip(axis: Axes, episode: Episode, field: Field) -> None:
    """Draw evenly chosen rows of an array as pictures in a row, those of more than two axes side by side.

    Rows of one axis, such as sound, are the columns of one picture.

    Args:
        axis: Axes to draw into.
        episode: Episode with the array.
        field: Declaration of the array, which has rows of many numbers.
    """
    values = np.asarray(episode.arrays[field.path])
    t_ns = episode.arrays[clock_of(field.path)][: len(values)]
    if field.image:
        _row(axis, _drawable(values), t_ns)
        words = title(field)
    elif values.ndim == 2:
        columns = np.linspace(0, len(values) - 1, min(len(values), WIDEST * values.shape[1])).round().astype(int)
        _row(axis, values[columns].T[None], t_ns[:1])
        low, high = _range(values)
        words = f"{title(field)}:\na column each\ndark {low:.3g}\nbright {high:.3g}"
    else:
        rows = np.linspace(0, len(values) - 1, min(len(values), FRAMES)).round().astype(int)
        _row(axis, np.stack([tiled(values[row]) for row in rows]), t_ns[rows])
        low, high = _range(values)
        words = f"{title(field)}:\ndark {low:.3g}\nbright {high:.3g}"
    words = "\n".join(textwrap.wrap(words.partition(":")[0], 20)) + "".join(words.partition("\n")[1:])
    axis.text(1.01, 0.45, words, transform=axis.transAxes, fontsize=8, va="center")


def pictured(episode: Episode) -> list[Field]:
    """Return the fields of the user's own whose rows are drawn as pictures.

    Args:
        episode: Episode to draw.
    """
    found = []
    for field in own(episode.arrays, episode.declarations):
        array = episode.arrays[field.path]
        large = array.ndim > 1 and int(np.prod(array.shape[1:])) > MOST_CURVES and array.dtype.kind in "biuf"
        if field.grows and array.size and (field.image or large) and not field.path.startswith("cameras/"):
            found.append(field)
    return found


def tiled(row: np.ndarray) -> np.ndarray:
    """Return a row of at least two axes as one picture: the pictures of its last two axes in a line, with gaps.

    Args:
        row: Numbers of the row, shape (..., H, W).
    """
    pictures = np.asarray(row, np.float64).reshape(-1, *row.shape[-2:])
    gap = np.full((row.shape[-2], 1), np.nan)
    return np.concatenate([part for picture in pictures for part in (gap, picture)][1:], axis=1)


def _drawable(images: np.ndarray) -> np.ndarray:
    """Return images of other than 1, 3 or 4 channels as grey ones with their channels side by side.

    Args:
        images: Images, shape (F, H, W) or (F, H, W, channels).
    """
    if images.ndim == 3 or images.shape[3] in (3, 4):
        return images
    frames, height = images.shape[:2]
    return np.moveaxis(images, 3, 2).reshape(frames, height, -1)


def _row(axis: Axes, images: np.ndarray, t_ns: np.ndarray, holes: bool = False) -> list[Axes]:
    """Draw evenly chosen images in a row, from the first to the last, as many as leave no gaps."""
    height, width = images.shape[1:3]
    axis.set_axis_off()
    box, figure = axis.get_position(), axis.get_figure(root=True)
    assert figure is not None
    figure_width, figure_height = figure.get_size_inches()
    room = box.width * figure_width / (PICTURE * box.height * figure_height * width / height)
    count = min(max(1, math.ceil(room)), FRAMES, len(images))
    rows = np.linspace(0, len(images) - 1, count).round().astype(int)
    low, high = _range(images, holes)
    insets = []
    for column, row in enumerate(rows):
        inset = axis.inset_axes((column / len(rows), 0.0, 0.97 / len(rows), PICTURE))
        inset.set_axis_off()
        inset.imshow(images[row], cmap="viridis" if holes or images.dtype.kind == "f" else "gray", vmin=low, vmax=high)
        inset.set_title(f"{t_ns[row] / 1e9:.2f} s", fontsize=7, pad=2, color=GREY)
        insets.append(inset)
    return insets


def _range(images: np.ndarray, holes: bool = False) -> tuple[float, float]:
    """Return the numbers that are drawn darkest and brightest; zeros of depth images are no measurements."""
    measured = images[images > 0] if holes else images[np.isfinite(images)]
    if not measured.size or images.dtype.kind == "b":
        return 0.0, 1.0
    low, high = (float(end) for end in np.percentile(measured, [1, 99] if holes else [0, 100]))
    return low, high if high > low else low + 1.0


def _label(axis: Axes, episode: Episode, camera: Camera) -> None:
    """Draw an arrow from the TCP to the position to which the label says that it must move."""
    known = episode.has("label_offset") and episode.has("proprio")
    if not known or not camera.has("T_base_camera") or not camera.has("intrinsics"):
        return
    tcp = episode.proprio[-1, 1:4].astype(np.float64)
    goal = tcp + np.append(episode.label_offset, 0.0)
    points = np.stack([tcp, goal]) - camera.T_base_camera[:3, 3]
    rays = points @ camera.T_base_camera[:3, :3] @ camera.intrinsics.T
    if (rays[:, 2] <= 0).any():
        return
    start, end = rays[:, :2] / rays[:, 2:]
    arrow = {"arrowstyle": "-|>", "color": LABEL, "mutation_scale": 7, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", end, start, arrowprops=arrow, annotation_clip=True)
