"""Predictions of a trained network at every observation of an episode, for ``svfl-data view --checkpoint``."""

from pathlib import Path

import torch
from torch import Tensor

from svfl_data.sampling.centering_samples import View, camera_of_axes, pictures
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.named_camera import camera_with_depth
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.input_spec import WRENCH, InputSpec, Window
from svfl_data.symmetry import PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_data.viewer.predictions import Network, Prediction
from svfl_models.centering.checkpoint import configuration, load_classifier
from svfl_models.centering.module import CenteringModule, directions
from svfl_models.cloning.checkpoint import is_policy, load_policy
from svfl_models.deployment import own_predictions
from svfl_models.deployment import policy_predictions as cloning
from svfl_models.networks.image_crops import centre_crop, crop_side, scaled
from svfl_models.programs import exported_policy, own_policy
from svfl_models.symmetry.actions import Batch


def load(file: Path) -> Network:
    """Open a checkpoint of ``svfl-train centering`` or of ``svfl-train bc``.

    Args:
        file: File of the checkpoint.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` or `FieldError` if the
        episode lacks the camera that the network was trained on, or its depth.

    Raises:
        FormatError: If the file is neither kind of checkpoint.
    """
    if is_policy(file):
        policy = load_policy(file)
        return (own_predictions if policy.deployment.inputs else cloning).of_module(policy, _name(file))
    module = load_classifier(file)
    return lambda episode: _directions(module, episode, _name(file))


def load_exported(file: Path) -> Network:
    """Open a policy that was exported as a ``.pt2`` file.

    Args:
        file: File of the policy.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` if the episode lacks what
        the policy takes.

    Raises:
        FormatError: If the file is not an exported policy.
    """
    if own_policy.is_own(file):
        return own_predictions.of_program(own_policy.load(file), _name(file))
    return cloning.of_program(exported_policy.load(file), _name(file))


def _name(file: Path) -> str:
    """Return the last two parts of a file's path, which are enough to tell runs apart."""
    return "/".join(file.parts[-2:])


@torch.inference_mode()
def _directions(module: CenteringModule, episode: Episode, name: str) -> Prediction:
    """Predict directions by a classifier; one that predicts offsets gives a direction, but no probabilities."""
    trained = configuration(module)
    sees = "v" in trained.encoder
    camera = camera_with_depth(episode, trained.camera) if sees else camera_of_axes(episode, trained.camera)
    batch = _vectors(episode, camera, trained.window)
    if sees:
        batch["image"] = _images(episode, camera, trained.view, trained.image_size)
    output = module(batch)
    shares = output.softmax(dim=1) if output.shape[1] == 4 else torch.eye(4)[directions(output)]
    words = name + ("" if output.shape[1] == 4 else " (gives offsets, no probabilities)")
    if not sees:
        return Prediction(words, camera.name, probabilities=shares.numpy())
    seen = (batch["image"][:, :3].clamp(0, 1) * 255).round().to(torch.uint8).permute(0, 2, 3, 1)  # (N+1, H, W, 3)
    return Prediction(words, camera.name, seen.contiguous().numpy(), shares.numpy())


def _vectors(episode: Episode, camera: Camera, window: int) -> Batch:
    """Return the vectors of all observations, as `centering_samples` gives those of an episode's last one."""
    axes = camera.image_axes
    wrench = cut_steps(episode, InputSpec(windows={WRENCH: Window(window)}))[WRENCH]
    proprio = episode.proprio.copy()
    proprio[:, 1:3] -= episode.centre
    return {
        "wrench": torch.from_numpy(act(axes, wrench, WRENCH_PARTS)).float(),
        "proprio": torch.from_numpy(act(axes, proprio, PROPRIO_PARTS)).float(),
    }


def _images(episode: Episode, camera: Camera, view: View, size: int) -> Tensor:
    """Return the images of all observations, shape (N+1, 4, size, size), cropped as for testing."""
    images = torch.from_numpy(pictures(episode, camera, view))
    cropped: Tensor = scaled(centre_crop(images, crop_side(images.shape[-1], size)), size)
    return cropped
