"""Trained policy as collectors and environments call it: whole images and base axes as input, base axes as output."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svfl_data.errors import StorageError, TrainingError, UsageError
from svfl_data.schema.observation import Observation
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_data.system.atomic_io import write_atomically
from svfl_models.cloning import own_acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.gripper_view import corners
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.action_space import PLANAR
from svfl_models.networks.image_crops import centre_crop, crop_at, crop_side, scaled
from svfl_models.networks.policy import Policy
from svfl_models.programs import exported_policy
from svfl_models.programs.policy_file import RobotPolicy
from svfl_models.programs.program import TOLERANCE, from_bytes
from svfl_models.symmetry.ordinary import plain

TRIALS = 8
"""Number of random inputs that an exported file is tested with."""


class ActingPolicy(nn.Module):
    """Policy that maps whole camera images, wrench windows and proprioception in base axes to commands in base axes.

    It contains all steps between a camera and a command: cropping, the change of axes, the workspace centre and the
    gripper. The command is the mode of the policy's distribution of actions. If the demonstrations only ever opened or
    shut the gripper (`DeploymentSpec.switch`), the gripper command is set to 0 or 1, because no demonstration shows a
    half-open gripper.

    Args:
        policy: The network, which works in image-aligned axes.
        deployment: What the demonstrations of the policy have in common.
        view: Centre of the images, one of `cloning.config.VIEWS`: ``gripper`` or ``camera``.
    """

    wrench_map: Tensor
    proprio_map: Tensor
    action_map: Tensor
    centre: Tensor
    turn: Tensor
    projection: Tensor

    def __init__(self, policy: Policy, deployment: DeploymentSpec, view: str) -> None:
        super().__init__()
        self.policy, self.deployment, self.view = policy, deployment, view
        axes = np.array(deployment.image_axes)
        turn = act(axes, np.zeros(5), PROPRIO_PARTS)  # constant added to the yaw; the maps below are linear
        maps = {
            "wrench_map": act(axes, np.eye(6), WRENCH_PARTS),
            "proprio_map": act(axes, np.eye(5), PROPRIO_PARTS) - turn,
            "action_map": act(axes.T, np.eye(5), ACTION_PARTS) * deployment.unit,
            "centre": np.array([0.0, *deployment.centre, 0.0, 0.0]),
            "turn": turn,
            "projection": np.array(deployment.projection),
        }
        for name, values in maps.items():
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32))

    def forward(self, image: Tensor, wrench: Tensor, proprio: Tensor) -> Tensor:
        """Return the commands, shape (B, 5): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes.

        Args:
            image: Colour 0..1, then depth in [m], shape (B, 4, H, H).
            wrench: Tared wrench windows, shape (B, T, 6), [N] and [N m], base axes, about the sensor origin.
            proprio: Gripper opening 0..1, TCP x, y, z [m] and yaw [rad] in base axes, shape (B, 5).
        """
        batch = {
            "image": self._cropped(image, proprio) if self.deployment.camera else image,
            "wrench": wrench @ self.wrench_map,
            "proprio": (proprio - self.centre) @ self.proprio_map + self.turn,
        }
        action = self.policy(batch).mode @ self.action_map
        if self.deployment.switch:
            action = torch.cat([(action[:, :1] > 0.5).to(action), action[:, 1:]], dim=1)
        return action

    def _cropped(self, image: Tensor, proprio: Tensor) -> Tensor:
        size, height = self.policy.trunk.image_size, image.shape[-1]
        side = crop_side(height, size, self.policy.trunk.crop)
        if self.view == "camera":
            return scaled(centre_crop(image, side), size)
        return scaled(
            crop_at(image, corners(proprio, self.projection, self.deployment.table, height, side), side), size
        )


def acting(module: CloningModule) -> ActingPolicy:
    """Return a trained policy in the form that acts, in eval mode and made of ordinary layers.

    Args:
        module: The trained policy; it is not changed.
    """
    return ActingPolicy(plain(module.policy), module.deployment, module.view).eval()  # type: ignore[arg-type] # a copy of a Policy


def load(file: Path | str) -> Callable[[Observation], NDArray[np.float32]]:
    """Load a checkpoint of ``svfl-train bc`` onto this machine's device, for ``svfl-collect policy``.

    Args:
        file: The checkpoint file.

    Returns:
        Function that returns the action for an observation; it must be given all observations of an episode in order.

    Raises:
        FormatError: If the file is not a sound checkpoint of a policy.
    """
    module = load_policy(file)
    if module.deployment.inputs:
        return RobotPolicy(own_acting.opened(module, str(file)))
    return exported_policy.opened(_exported(module), str(file))


def _exported(module: CloningModule, texts: Mapping[str, str] | None = None) -> bytes:
    known = module.deployment
    size = known.image_side, known.image_side
    hz = known.wrench_hz or None
    window = module.policy.trunk.window
    return exported_policy.exported(acting(module), size, known.depth_scale, known.camera, hz, texts, window)


def export(module: CloningModule, file: Path, texts: Mapping[str, str] | None = None) -> float:
    """Write a trained policy as a program that runs without this package (`svfl_models.programs.exported_policy`).

    Args:
        module: The trained policy.
        file: File to write, whose name ends in ``.pt2``. An existing file is replaced only after the new program has
            been tested.
        texts: Further texts to keep in the file, by name, such as its provenance; None for none.

    Returns:
        Largest difference between the actions of the program and of the network on random inputs, as a share of the
        action bounds.

    Raises:
        UsageError: If the name of the file does not end in ``.pt2``.
        TrainingError: If the actions differ by more than rounding.
        StorageError: If the folder does not exist or the file cannot be written.
    """
    if file.suffix != ".pt2":
        raise UsageError(f"{file}: cannot export a policy to {file.suffix or 'a file without suffix'}; possible: .pt2")
    if not file.parent.is_dir():
        raise StorageError(f"{file}: no such folder")
    if module.deployment.inputs:
        return own_acting.export(module, file, texts)
    content = _exported(module, texts)
    worst = _difference(module, content)
    if not worst < TOLERANCE:
        raise TrainingError(f"{file}: not written, its actions differ from the network's by {worst:.1g}")
    write_atomically(file, content)
    return worst


@torch.no_grad()
def _difference(module: CloningModule, content: bytes) -> float:
    """Return the largest difference between the actions of a program and of its network, as a share of the bounds."""
    network = ActingPolicy(module.policy, module.deployment, module.view).eval()
    program, _ = from_bytes(content, exported_policy.FACTS)
    generator = torch.Generator().manual_seed(0)
    unit = torch.from_numpy(module.deployment.unit)
    worst = torch.zeros(())
    for _ in range(TRIALS):
        inputs = _inputs(module, lambda *shape: torch.rand(shape, generator=generator))
        (told,) = program(*inputs)
        said, expected = (PLANAR.to_unit(answer / unit) for answer in (told, network(*inputs)))
        worst = torch.maximum(worst, (said - expected).abs().max())
    return float(worst)


def _inputs(module: CloningModule, fill: Callable[..., Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    side = module.deployment.image_side
    return fill(1, 4, side, side), fill(1, module.policy.trunk.window, 6), fill(1, 5)
