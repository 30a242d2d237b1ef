"""Did the cameras see anything?"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from svfl_data.checks.finding import Finding, error, longest_run, places, seconds, travel_m, warning
from svfl_data.episode import Camera, Episode

HOLES = 0.5  # share of a depth image without measurement that is worth a warning
FROZEN_FRAMES, FROZEN_TRAVEL_M = 5, 0.01  # identical images in a row, while the hand moves this far


def check_color(episode: Episode) -> Iterator[Finding]:
    """No colour image is black or of one colour, and the picture is not frozen while the hand moves."""
    for camera in episode.cameras.values():
        if not camera.color.size:
            continue
        path = f"cameras/{camera.name}/color"
        flat = np.array([frame.min() == frame.max() for frame in camera.color], dtype=bool)
        if flat.any():
            rows = np.flatnonzero(flat)
            black = "all black" if not any(camera.color[row].any() for row in rows) else "of one grey"
            words = f"{len(rows)} of {len(flat)} images are {black}: {places(rows, camera.t_ns)}"
            yield error(episode, path, int(rows[0]), words)
        else:
            yield from _frozen(episode, camera, path)


def _frozen(episode: Episode, camera: Camera, path: str) -> Iterator[Finding]:
    row, repeats = longest_run(np.array([np.array_equal(a, b) for a, b in pairwise(camera.color)], dtype=bool))
    if repeats + 1 < FROZEN_FRAMES:
        return
    start, end = int(camera.t_ns[row]), int(camera.t_ns[row + repeats])
    moved = travel_m(episode, start, end)
    if moved > FROZEN_TRAVEL_M:
        words = (
            f"frozen picture: {repeats + 1} identical images from {seconds(start)} to {seconds(end)}, "
            f"while the hand moved by {moved * 1e3:.0f} mm"
        )
        yield warning(episode, path, row, words)


def check_depth(episode: Episode) -> Iterator[Finding]:
    """Depth images have measurements in most pixels, and differ from pixel to pixel."""
    for camera in episode.cameras.values():
        if not camera.has("depth") or not camera.depth.size:
            continue
        path = f"cameras/{camera.name}/depth"
        if not any(frame.any() for frame in camera.depth):
            yield error(episode, path, 0, "no measurement in any depth image")
            continue
        holes = np.array([np.mean(frame == 0) for frame in camera.depth])
        if (holes > HOLES).any():
            rows, worst = np.flatnonzero(holes > HOLES), int(holes.argmax())
            words = (
                f"depth holes: {len(rows)} of {len(holes)} images lack more than {HOLES:.0%} of their pixels, "
                f"{places(rows, camera.t_ns)}; the worst lacks {holes[worst]:.0%}"
            )
            yield warning(episode, path, int(rows[0]), words)
        flat = np.array([frame.min() == frame.max() and frame.any() for frame in camera.depth], dtype=bool)
        if flat.any():
            rows = np.flatnonzero(flat)
            words = f"{len(rows)} of {len(flat)} depth images are constant: {places(rows, camera.t_ns)}"
            yield error(episode, path, int(rows[0]), words)
