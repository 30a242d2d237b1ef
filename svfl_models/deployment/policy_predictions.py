"""Actions of a cloned policy at every observation of an episode, and the part of the image that the policy sees."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from svfl_data.errors import DatasetError
from svfl_data.sampling.batch import Batch
from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.input_spec import PROPRIO, WRENCH, paper_inputs
from svfl_data.signals.pictures import camera_picture
from svfl_data.viewer.predictions import Network, Prediction
from svfl_models.cloning.acting import ActingPolicy
from svfl_models.cloning.gripper_view import corners
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.image_crops import crop_at, crop_side, scaled
from svfl_models.programs.exported_policy import ExportedPolicy, only_camera

AT_ONCE = 256
"""Number of observations whose images are converted to float and held in memory at a time."""


def of_module(module: CloningModule, name: str, at_once: int = AT_ONCE) -> Network:
    """Return the function that predicts the actions of a policy, as ``svfl-train bc`` has trained it.

    Args:
        module: The trained policy, which has the paper's inputs (`own_predictions` is for others).
        name: Name of the policy in predictions.
        at_once: Largest number of observations that the network takes at a time.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` if the episode lacks the
        policy's camera, or the camera's images have another size than in training.
    """
    policy = ActingPolicy(module.policy, module.deployment, module.view).eval()

    @torch.inference_mode()
    def network(episode: Episode) -> Prediction:
        camera = _camera_of(module, episode)
        parts = []
        for cut in _cuts(episode, module.deployment.camera, module.policy.trunk.window, at_once):
            wrench, proprio = (torch.from_numpy(cut[path]) for path in (WRENCH, PROPRIO))
            image = torch.zeros(len(proprio), 4, module.deployment.image_side, module.deployment.image_side)
            if camera:
                image = torch.from_numpy(camera_picture(cut, camera.name, float(camera.depth_scale)))
            parts.append((policy(image, wrench, proprio), *_looked_at(module, image, proprio)))
        actions, seen, crop = (torch.cat(part).numpy() for part in zip(*parts, strict=True))
        if camera is None or "v" not in module.hparams["network"]["encoder"]:
            return Prediction(name, "", actions=actions)
        return Prediction(name, camera.name, seen, actions=actions, crop=crop)

    return network


def of_program(policy: ExportedPolicy, name: str, at_once: int = AT_ONCE) -> Network:
    """Return the function that predicts the actions of an exported policy.

    Its predictions do not say which part of the image the policy sees, because the file does not state it.

    Args:
        policy: The exported policy.
        name: Name of the policy in predictions.
        at_once: Largest number of observations that are held in memory at a time.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` if the episode lacks the
        policy's camera, or its depth.
    """

    def network(episode: Episode) -> Prediction:
        found = [camera.name for camera in episode.cameras.values() if camera.has("depth")]
        wanted = only_camera(found) if policy.camera is None else policy.camera
        if wanted is None or wanted not in ["", *found]:
            have = ", ".join(found) or "none"
            asked = f"camera {wanted}" if wanted else "exactly one camera"
            raise DatasetError(f"{episode.name}: the policy needs {asked} with depth; recorded with depth: {have}")
        actions = [
            policy.act({path: values[row : row + 1] for path, values in cut.items()}, wanted)
            for cut in _cuts(episode, wanted, policy.window, at_once)
            for row in range(len(cut[PROPRIO]))
        ]
        return Prediction(name, wanted, actions=np.stack(actions))

    return network


def _camera_of(module: CloningModule, episode: Episode) -> Camera | None:
    """Return the camera of an episode whose images a policy takes; None if it takes none.

    Raises:
        DatasetError: If this camera is not recorded with depth, or its images have another size than in training.
    """
    wanted, side = module.deployment.camera, module.deployment.image_side
    if not wanted:
        return None
    found = {name: camera for name, camera in episode.cameras.items() if camera.has("depth")}
    if wanted not in found:
        have = ", ".join(found) or "none"
        raise DatasetError(f"{episode.name}: the policy needs camera {wanted} with depth; recorded with depth: {have}")
    height, width = found[wanted].depth.shape[1:]
    if (height, width) != (side, side):
        raise DatasetError(
            f"{episode.name}: the policy was made for images of {side} x {side} px, {wanted} gave {height} x {width}"
        )
    return found[wanted]


def _cuts(episode: Episode, camera: str, window: int, at_once: int) -> Iterator[Batch]:
    """Yield the paper's inputs of up to `at_once` observations at a time, without images if `camera` is empty."""
    steps = range(len(episode.t_ns))
    for first in steps[::at_once]:
        yield cut_steps(episode, paper_inputs(camera, window=window), steps[first : first + at_once])


def _looked_at(module: CloningModule, image: Tensor, proprio: Tensor) -> tuple[Tensor, Tensor]:
    """Return the part of images that the network sees, and where it lies.

    Args:
        module: The trained policy.
        image: Images of the camera, shape (B, 4, H, H): colour 0..1, then depth in [m].
        proprio: Gripper opening 0..1, TCP x, y, z [m], yaw [rad], in the base frame, shape (B, 5).

    Returns:
        Colours of the cropped and scaled images, shape (B, size, size, 3), uint8, and the left, top, right and bottom
        edges of the crops, shape (B, 4), [px].
    """
    height, size, deployment = image.shape[-1], module.policy.trunk.image_size, module.deployment
    side = crop_side(height, size, module.policy.trunk.crop)
    corner = torch.full((len(image), 2), (height - side) // 2)
    if module.view == "gripper":
        corner = corners(proprio, torch.tensor(deployment.projection), deployment.table, height, side)
    seen = (scaled(crop_at(image[:, :3], corner, side), size).clamp(0, 1) * 255).round().to(torch.uint8)
    edges = torch.cat([corner.flip(1), corner.flip(1) + side], dim=1)
    return seen.movedim(1, -1).contiguous(), edges
