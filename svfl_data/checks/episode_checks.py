"""All checks of one episode: first those of its streams, then those of the images of its cameras."""

from collections.abc import Callable, Iterator

from svfl_data.checks.camera_poses import check_poses
from svfl_data.checks.finding import Finding
from svfl_data.checks.images import check_color, check_depth
from svfl_data.checks.motion import check_action, check_assumptions, check_label, check_proprio, check_records
from svfl_data.checks.timestamps import check_coverage, check_gaps, check_jitter, check_order, check_rates
from svfl_data.checks.wrench import check_saturation, check_stuck, check_tare
from svfl_data.schema.episode import Camera, Episode

STREAM_CHECKS: tuple[Callable[[Episode], Iterator[Finding]], ...] = (
    check_order, check_rates, check_gaps, check_jitter, check_coverage,
    check_saturation, check_stuck, check_tare,
    check_action, check_proprio, check_label, check_records, check_assumptions, check_poses,
)  # fmt: skip
IMAGE_CHECKS: tuple[Callable[[Episode, Camera], Iterator[Finding]], ...] = (check_color, check_depth)


def check_episode(episode: Episode) -> list[Finding]:
    """Return everything that the checks find in one episode.

    Example:
        >>> [one.words for one in check_episode(dataset[0]) if one.severity == "error"]
        []
    """
    of_images = [finding for camera in episode.cameras for finding in check_images(episode, camera)]
    return check_streams(episode) + of_images


def check_streams(episode: Episode) -> list[Finding]:
    """Return everything that the checks find in one episode without looking at its images."""
    return [finding for check in STREAM_CHECKS for finding in check(episode)]


def check_images(episode: Episode, camera: str) -> list[Finding]:
    """Return everything that the checks find in the images of one camera of an episode.

    Args:
        episode: Episode to check.
        camera: Name of the camera.
    """
    return [finding for check in IMAGE_CHECKS for finding in check(episode, episode.cameras[camera])]
