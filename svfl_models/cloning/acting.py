"""A trained policy as collectors and environments know it: whole pictures and base axes in, base axes out."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.errors import StorageError, TrainingError, UsageError
from svfl_data.sampling.windows import WINDOW
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_data.system.atomic_io import write_atomically
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.gripper_view import corners
from svfl_models.cloning.module import CloningModule
from svfl_models.networks.image_crops import centre_crop, crop_at, crop_side, scaled
from svfl_models.networks.policy import Policy
from svfl_models.networks.squashed_gaussian import to_unit
from svfl_models.programs import exported_policy
from svfl_models.programs.program import TOLERANCE, from_bytes
from svfl_models.symmetry.ordinary import plain

TRIALS = 8
"""Random inputs that an exported file is tried with."""


class ActingPolicy(nn.Module):
    """A policy from a camera's picture to a command, with all that lies between: crop, axes, centre, the gripper.

    What a policy says most probably is what is done. Where demonstrations only opened or shut the gripper, so does
    this: a gripper half open, because both were likely, is what nobody has shown.

    Args:
        policy: The network, in image-aligned axes.
        deployment: Of its demonstrations.
        view: One of `cloning.config.VIEWS`.
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
        turn = act(axes, np.zeros(5), PROPRIO_PARTS)  # of the yaw; the rest of all this is linear
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
        """What to command, (B, 5): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes.

        Args:
            image: Shape (B, 4, H, H): colour 0..1, then depth in [m].
            wrench: Shape (B, T, 6), tared, [N] and [N m], base axes, about the sensor origin.
            proprio: Shape (B, 5): gripper opening 0..1, TCP x, y, z [m], yaw [rad], base.
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
        side = crop_side(height, size)
        if self.view == "camera":
            return scaled(centre_crop(image, side), size)
        return scaled(
            crop_at(image, corners(proprio, self.projection, self.deployment.table, height, side), side), size
        )


def acting(module: CloningModule) -> ActingPolicy:
    """A trained policy, ready to act, made of ordinary layers."""
    return ActingPolicy(plain(module.policy), module.deployment, module.view).eval()  # type: ignore[arg-type] # a copy of a Policy


def load(file: Path | str) -> exported_policy.ExportedPolicy:
    """Load a checkpoint of ``svfl-train bc`` onto this machine's device, for ``svfl-collect policy``.

    Raises:
        FormatError: If the file is not one.
    """
    module = load_policy(file)
    return exported_policy.opened(_exported(module), str(file))


def _exported(module: CloningModule) -> bytes:
    side = module.deployment.image_side
    return exported_policy.exported(acting(module), (side, side), module.deployment.depth_scale)


def export(module: CloningModule, file: Path) -> float:
    """Write a trained policy as a program that runs without this package (`svfl_models.programs.exported_policy`).

    Args:
        module: The policy.
        file: Where to; replaced if it exists, once the new one has been tried.

    Returns:
        Largest difference between the actions of file and network on random inputs, in units of the bounds.

    Raises:
        UsageError: If the file's name does not end in ``.pt2``.
        TrainingError: If the actions differ by more than rounding.
        StorageError: If the disk refuses.
    """
    if file.suffix != ".pt2":
        raise UsageError(f"{file}: cannot export a policy to {file.suffix or 'a file without suffix'}; possible: .pt2")
    if not file.parent.is_dir():
        raise StorageError(f"{file}: no such folder")
    content = _exported(module)
    worst = _difference(module, content)
    if not worst < TOLERANCE:
        raise TrainingError(f"{file}: not written, its actions differ from the network's by {worst:.1g}")
    write_atomically(file, content)
    return worst


@torch.no_grad()
def _difference(module: CloningModule, content: bytes) -> float:
    """How far the actions of a program are from its network's, component by component, in units of the bounds."""
    network = ActingPolicy(module.policy, module.deployment, module.view).eval()
    program, _ = from_bytes(content, exported_policy.FACTS)
    generator = torch.Generator().manual_seed(0)
    unit = torch.from_numpy(module.deployment.unit)
    worst = torch.zeros(())
    for _ in range(TRIALS):
        inputs = _inputs(module, lambda *shape: torch.rand(shape, generator=generator))
        (told,) = program(*inputs)
        said, expected = (to_unit(answer / unit) for answer in (told, network(*inputs)))
        worst = torch.maximum(worst, (said - expected).abs().max())
    return float(worst)


def _inputs(module: CloningModule, fill: Callable[..., Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    side = module.deployment.image_side
    return fill(1, 4, side, side), fill(1, WINDOW, 6), fill(1, 5)
