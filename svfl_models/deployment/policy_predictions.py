"""What a cloned policy would do at every observation of an episode, and which part of the picture it sees there."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from svfl_data.errors import DatasetError
from svfl_data.sampling.windows import latest, wrench_window
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.robot import Frame, Observation
from svfl_data.viewer.predictions import Network, Prediction
from svfl_models.cloning.acting import ActingPolicy
from svfl_models.cloning.gripper_view import corners
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.image_crops import crop_at, crop_side, scaled
from svfl_models.programs.exported_policy import ExportedPolicy

AT_ONCE = 256
"""Observations in memory as numbers at a time."""
NO_JOINTS = np.zeros(0, np.float32)
"""No policy looks at joints."""


def of_module(module: CloningModule, name: str) -> Network:
    """A policy as ``svfl-train bc`` has trained it.

    Args:
        module: The policy.
        name: What to call it.
    """
    policy = ActingPolicy(module.policy, module.deployment, module.view).eval()

    @torch.inference_mode()
    def network(episode: Episode) -> Prediction:
        camera = _camera_of(module, episode)
        parts = [
            (policy(image, wrench, proprio), *_looked_at(module, image, proprio))
            for image, wrench, proprio in _observations(episode, camera)
        ]
        actions, seen, crop = (torch.cat(part).numpy() for part in zip(*parts, strict=True))
        if "v" not in module.hparams["network"]["encoder"]:
            return Prediction(name, "", actions=actions)
        return Prediction(name, camera.name, seen, actions=actions, crop=crop)

    return network


def of_program(policy: ExportedPolicy, name: str) -> Network:
    """A policy that was exported; which part of the picture it sees, the file does not tell.

    Args:
        policy: The policy.
        name: What to call it.
    """

    def network(episode: Episode) -> Prediction:
        camera = next((camera for camera in episode.cameras.values() if camera.has("depth")), None)
        if camera is None:
            raise DatasetError(f"{episode.name}: a policy needs a camera with depth")
        actions = []
        for step, row in enumerate(_rows(episode, camera)):
            frames = {camera.name: Frame(camera.color[row], camera.depth[row])}
            wrench, proprio = wrench_window(episode, step)[0], episode.proprio[step]
            actions.append(policy(Observation(int(episode.t_ns[step]), frames, wrench, proprio, NO_JOINTS)))
        return Prediction(name, camera.name, actions=np.stack(actions))

    return network


def _camera_of(module: CloningModule, episode: Episode) -> Camera:
    """The camera that a policy looks at.

    Raises:
        DatasetError: If it is not recorded, or its pictures are of another size.
    """
    wanted, side = module.deployment.camera, module.deployment.image_side
    found = {name: camera for name, camera in episode.cameras.items() if camera.has("depth")}
    if found and not wanted:  # it does not look
        return next(iter(found.values()))
    if wanted not in found:
        have = ", ".join(found) or "none"
        raise DatasetError(
            f"{episode.name}: the policy looks at camera {wanted} with depth; recorded with depth: {have}"
        )
    height, width = found[wanted].depth.shape[1:]
    if (height, width) != (side, side):
        raise DatasetError(
            f"{episode.name}: the policy was made for images of {side} x {side} px, {wanted} gave {height} x {width}"
        )
    return found[wanted]


def _rows(episode: Episode, camera: Camera) -> list[int]:
    """The latest picture at every observation."""
    return [max(0, latest(camera.t_ns, t_ns)) for t_ns in episode.t_ns]


def _observations(episode: Episode, camera: Camera) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Image, wrench and proprio as `ActingPolicy` takes them, some observations at a time."""
    rows = np.array(_rows(episode, camera))
    for first in range(0, len(rows), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        color, depth = camera.color[rows[some]], camera.depth[rows[some]]
        image = np.empty((len(depth), 4, *depth.shape[1:]), np.float32)
        image[:, :3] = color.transpose(0, 3, 1, 2) / np.float32(255)
        image[:, 3] = depth * np.float32(camera.depth_scale)
        wrench = np.stack([wrench_window(episode, step)[0] for step in range(len(rows))[some]])
        yield torch.from_numpy(image), torch.from_numpy(wrench), torch.tensor(episode.proprio[some])


def _looked_at(module: CloningModule, image: Tensor, proprio: Tensor) -> tuple[Tensor, Tensor]:
    """What the network sees of pictures, (B, H, W, 3), uint8, and its edges left, top, right, bottom, (B, 4), [px]."""
    height, size, deployment = image.shape[-1], module.policy.trunk.image_size, module.deployment
    side = crop_side(height, size)
    corner = torch.full((len(image), 2), (height - side) // 2)
    if module.view == "gripper":
        corner = corners(proprio, torch.tensor(deployment.projection), deployment.table, height, side)
    seen = (scaled(crop_at(image[:, :3], corner, side), size).clamp(0, 1) * 255).round().to(torch.uint8)
    edges = torch.cat([corner.flip(1), corner.flip(1) + side], dim=1)
    return seen.movedim(1, -1).contiguous(), edges
