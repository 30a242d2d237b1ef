"""Actions of a cloned policy at every observation of an episode, and the part of the image that the policy sees."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from svfl_data.errors import DatasetError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.windows import latest, wrench_window
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.input_spec import WINDOW, WRENCH, InputSpec, Window
from svfl_data.schema.robot import Frame, Observation
from svfl_data.viewer.predictions import Network, Prediction
from svfl_models.cloning.acting import ActingPolicy
from svfl_models.cloning.gripper_view import corners
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.image_crops import crop_at, crop_side, scaled
from svfl_models.programs.exported_policy import ExportedPolicy, only_camera

AT_ONCE = 256
"""Number of observations whose images are converted to float and held in memory at a time."""
WRENCH_WINDOW = InputSpec(windows={WRENCH: Window(WINDOW)})


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
        parts = [
            (policy(image, wrench, proprio), *_looked_at(module, image, proprio))
            for image, wrench, proprio in _observations(episode, camera, at_once)
        ]
        actions, seen, crop = (torch.cat(part).numpy() for part in zip(*parts, strict=True))
        if "v" not in module.hparams["network"]["encoder"]:
            return Prediction(name, "", actions=actions)
        return Prediction(name, camera.name, seen, actions=actions, crop=crop)

    return network


def of_program(policy: ExportedPolicy, name: str) -> Network:
    """Return the function that predicts the actions of an exported policy.

    Its predictions do not say which part of the image the policy sees, because the file does not state it.

    Args:
        policy: The exported policy.
        name: Name of the policy in predictions.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` if the episode has no
        camera with depth.
    """

    def network(episode: Episode) -> Prediction:
        found = {name: camera for name, camera in episode.cameras.items() if camera.has("depth")}
        blind = policy.camera == ""  # any camera then, since only the times of its frames matter
        wanted = next(iter(found), None) if blind else policy.camera or only_camera(found)
        if wanted not in found:
            have = ", ".join(found) or "none"
            asked = f"camera {wanted}" if wanted else "exactly one camera"
            raise DatasetError(f"{episode.name}: the policy needs {asked} with depth; recorded with depth: {have}")
        camera = found[wanted]
        actions = []
        for step, row in enumerate(_rows(episode, camera)):
            frames = {camera.name: Frame(camera.color[row], camera.depth[row])}
            wrench, proprio = wrench_window(episode, step)[0], episode.proprio[step]
            actions.append(policy(Observation(int(episode.t_ns[step]), frames, wrench, proprio)))
        return Prediction(name, camera.name, actions=np.stack(actions))

    return network


def _camera_of(module: CloningModule, episode: Episode) -> Camera:
    """Return the camera of an episode whose images a policy takes.

    Raises:
        DatasetError: If this camera is not recorded with depth, or its images have another size than in training.
    """
    wanted, side = module.deployment.camera, module.deployment.image_side
    found = {name: camera for name, camera in episode.cameras.items() if camera.has("depth")}
    if found and not wanted:  # the policy uses no images
        return next(iter(found.values()))
    if wanted not in found:
        have = ", ".join(found) or "none"
        raise DatasetError(f"{episode.name}: the policy needs camera {wanted} with depth; recorded with depth: {have}")
    height, width = found[wanted].depth.shape[1:]
    if (height, width) != (side, side):
        raise DatasetError(
            f"{episode.name}: the policy was made for images of {side} x {side} px, {wanted} gave {height} x {width}"
        )
    return found[wanted]


def _rows(episode: Episode, camera: Camera) -> list[int]:
    """Return the index of the camera's latest frame at every observation."""
    return [max(0, latest(camera.t_ns, t_ns)) for t_ns in episode.t_ns]


def _observations(episode: Episode, camera: Camera, at_once: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Yield image, wrench and proprio as `ActingPolicy` takes them, for up to `at_once` observations at a time."""
    rows = np.array(_rows(episode, camera))
    for first in range(0, len(rows), at_once):
        some = slice(first, first + at_once)
        color, depth = camera.color[rows[some]], camera.depth[rows[some]]
        image = np.empty((len(depth), 4, *depth.shape[1:]), np.float32)
        image[:, :3] = color.transpose(0, 3, 1, 2) / np.float32(255)
        image[:, 3] = depth * np.float32(camera.depth_scale)
        wrench = cut_steps(episode, WRENCH_WINDOW, range(len(rows))[some])[WRENCH]
        yield torch.from_numpy(image), torch.from_numpy(wrench), torch.tensor(episode.proprio[some])


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
