"""Checks that camera images have content. Images are read one by one, so that at most two of them are in memory."""

from collections.abc import Iterator

import numpy as np

from svfl_data.checks.finding import Finding, error, longest_run, places, seconds, travel_m, warning
from svfl_data.schema.episode import Camera, Episode

HOLES = 0.5  # share of pixels without measurement in a depth image above which a warning is given
FROZEN_FRAMES, FROZEN_TRAVEL_M = 5, 0.01  # a camera is frozen if so many images are equal while the TCP moves so far


def check_color(episode: Episode, camera: Camera) -> Iterator[Finding]:
    """Check that no colour or grey image is all black or of one grey, and that none freezes while the gripper moves."""
    for path in episode.declarations.image_paths(camera.name, episode.arrays):
        if not path.endswith("/depth"):
            yield from _seen(episode, camera, path)


def _seen(episode: Episode, camera: Camera, path: str) -> Iterator[Finding]:
    flat, black, repeated = [], True, []
    previous: np.ndarray | None = None
    for frame in _images(camera, path.rpartition("/")[2]):
        flat.append(frame.min() == frame.max())
        black = black and not (flat[-1] and frame.any())
        if previous is not None:
            repeated.append(np.array_equal(frame, previous))
        previous = frame
    if any(flat):
        rows = np.flatnonzero(flat)
        words = f"{len(rows)} of {len(flat)} images are {'all black' if black else 'of one grey'}"
        yield error(episode, path, int(rows[0]), f"{words}: {places(rows, camera.t_ns)}")
    else:
        yield from _frozen(episode, camera, path, np.array(repeated, dtype=np.bool_))


def _images(camera: Camera, kind: str) -> Iterator[np.ndarray]:
    """Yield the images of a camera one at a time, whether they are in memory or on disk."""
    stored = camera.arrays[kind]
    return (stored[row] for row in range(stored.shape[0]))


def _frozen(episode: Episode, camera: Camera, path: str, repeated: np.ndarray) -> Iterator[Finding]:
    row, repeats = longest_run(repeated)
    if repeats + 1 < FROZEN_FRAMES:
        return
    start, end = int(camera.t_ns[row]), int(camera.t_ns[row + repeats])
    moved = travel_m(episode, start, end)
    if moved is not None and moved > FROZEN_TRAVEL_M:
        words = (
            f"frozen picture: {repeats + 1} identical images from {seconds(start)} to {seconds(end)}, "
            f"while the gripper moved by {moved * 1e3:.0f} mm"
        )
        yield warning(episode, path, row, words)


def check_depth(episode: Episode, camera: Camera) -> Iterator[Finding]:
    """Check that most pixels of each depth image have a measurement, and that no depth image is constant."""
    if not camera.has("depth") or not camera.arrays["depth"].shape[0]:
        return
    path = f"cameras/{camera.name}/depth"
    looks = [(np.mean(frame == 0), frame.min() == frame.max()) for frame in _images(camera, "depth")]
    holes, constant = (np.array(column) for column in zip(*looks, strict=True))
    if (holes == 1).all():
        yield error(episode, path, 0, "no measurement in any depth image")
        return
    if (holes > HOLES).any():
        rows, worst = np.flatnonzero(holes > HOLES), int(holes.argmax())
        words = (
            f"depth holes: {len(rows)} of {len(holes)} images lack more than {HOLES:.0%} of their pixels, "
            f"{places(rows, camera.t_ns)}; the worst lacks {holes[worst]:.0%}"
        )
        yield warning(episode, path, int(rows[0]), words)
    if len(rows := np.flatnonzero(constant & (holes < 1))):
        words = f"{len(rows)} of {len(holes)} depth images are constant: {places(rows, camera.t_ns)}"
        yield error(episode, path, int(rows[0]), words)
