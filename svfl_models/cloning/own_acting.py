"""Trained policy with inputs and an action of the user's own: recorded values and base axes in, base axes out."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_data.schema.action_fields import ACTION
from svfl_data.symmetry import act
from svfl_data.system.atomic_io import write_atomically
from svfl_models.cloning.deployment_spec import DeploymentSpec
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.own_data import square
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.networks.action_space import ActionSpace
from svfl_models.networks.image_crops import centre_crop, crop_side, scaled, turned
from svfl_models.networks.policy import Policy
from svfl_models.programs import own_policy
from svfl_models.programs.program import TOLERANCE, from_bytes
from svfl_models.symmetry.ordinary import plain

TRIALS = 8
"""Number of random inputs that an exported file is tested with."""


class OwnActingPolicy(nn.Module):
    """Policy that maps its inputs, in the order of `DeploymentSpec.inputs`, to commands in base axes.

    After the images of a camera that moves comes the matrix of its image axes.

    It contains all steps between a sensor and a command: cropping, the change of axes, the workspace centre and the
    gripper. The command is the mode of the policy's distribution of actions.

    Args:
        policy: The network, which works in image-aligned axes.
        deployment: What the demonstrations of the policy have in common.
    """

    def __init__(self, policy: Policy, deployment: DeploymentSpec) -> None:
        super().__init__()
        assert deployment.action is not None
        self.policy, self.deployment = policy, deployment
        self.inputs, self.space = of_plain(deployment.inputs), ActionSpace.of_plain(deployment.action)
        axes = np.array(deployment.image_axes)
        self.register_buffer("axes", torch.tensor(axes, dtype=torch.float32))
        for number, one in enumerate(self.inputs):
            if one.kind != "image":
                for name, values in zip(("matrix", "offset", "turn"), one.maps(axes), strict=True):
                    self.register_buffer(f"{name}_{number}", torch.tensor(values, dtype=torch.float32))
        action_map = act(axes.T, np.eye(len(self.space)), self.space.parts)
        self.register_buffer("action_map", torch.tensor(action_map, dtype=torch.float32))

    def forward(self, *values: Tensor) -> Tensor:
        """Return the commands, shape (B, C), in base axes and the units of the action.

        Args:
            values: Values of each input: images (B, channels, H, W), colour and grey 0..1, depth in [m]; the matrices
                from base (x, y) to image (right, up) of a camera that moves (B, 2, 2); windows (B, T, C), tared, and
                vectors (B, C), as recorded.
        """
        batch, rest = {}, iter(values)
        for number, one in enumerate(self.inputs):
            given = next(rest)
            if one.kind == "image":
                image = square(given)
                if one.axes:
                    image = turned(image, self.get_buffer("axes") @ next(rest).transpose(1, 2))
                batch[one.path] = self._cropped(image)
                continue
            matrix, offset, turn = (self.get_buffer(f"{name}_{number}") for name in ("matrix", "offset", "turn"))
            batch[one.path] = (given - offset) @ matrix + turn
        action = self.policy(batch).mode @ self.get_buffer("action_map")
        if self.deployment.switch and self.space.opening is not None:
            at = self.space.opening
            shut = (action[:, at : at + 1] > 0.5).to(action)
            action = torch.cat([action[:, :at], shut, action[:, at + 1 :]], dim=1)
        return action

    def facts(self, action: str) -> own_policy.Facts:
        """Return what the policy takes and gives, for the file of an exported policy.

        Args:
            action: Path of the action in episodes.
        """
        names = self.space.names or tuple(map(str, range(len(self.space))))
        taken = []
        for one in self.inputs:
            taken.append(own_policy.InputFacts(one.path, one.shape, one.images, one.depth_scale, one.rate_hz))
            if one.axes:
                taken.append(own_policy.InputFacts(one.axes, (2, 2)))
        low, high = list(self.space.low), list(self.space.high)
        return own_policy.Facts(taken, list(names), low, high, self.deployment.step_ms, action)

    def _cropped(self, image: Tensor) -> Tensor:
        size = self.policy.trunk.image_size
        return scaled(centre_crop(image, crop_side(image.shape[-1], size, self.policy.trunk.crop)), size)


def action_path(module: CloningModule) -> str:
    """Return the path of the action that a policy has learned.

    Args:
        module: The trained policy.
    """
    return str((module.hparams["training"] or {}).get("action", ACTION))


def acting(module: CloningModule) -> OwnActingPolicy:
    """Return a trained policy in the form that acts, in eval mode and made of ordinary layers.

    Args:
        module: The trained policy; it is not changed.
    """
    return OwnActingPolicy(plain(module.policy), module.deployment).eval()  # type: ignore[arg-type] # a copy of a Policy


def export(module: CloningModule, file: Path, texts: Mapping[str, str] | None = None) -> float:
    """Write a trained policy as a program that runs without this package (`svfl_models.programs.own_policy`).

    Args:
        module: The trained policy.
        file: File to write. An existing file is replaced only after the new program has been tested.
        texts: Further texts to keep in the file, by name; None for none.

    Returns:
        Largest difference between the actions of the program and of the network on random inputs, as a share of the
        action bounds.

    Raises:
        TrainingError: If the actions differ by more than rounding.
        StorageError: If the file cannot be written.
    """
    content = _exported(module, texts)
    own_policy.opened(content, str(file))
    worst = _difference(OwnActingPolicy(module.policy, module.deployment).eval(), content)
    if not worst < TOLERANCE:
        raise TrainingError(f"{file}: not written, its actions differ from the network's by {worst:.1g}")
    write_atomically(file, content)
    return worst


def opened(module: CloningModule, name: str) -> own_policy.OwnPolicy:
    """Return a trained policy as its exported program acts, without a file.

    Args:
        module: The trained policy.
        name: Name of the policy in messages.
    """
    return own_policy.opened(_exported(module), name)


def _exported(module: CloningModule, texts: Mapping[str, str] | None = None) -> bytes:
    policy = acting(module)
    return own_policy.exported(policy, policy.facts(action_path(module)), texts)


@torch.no_grad()
def _difference(network: OwnActingPolicy, content: bytes) -> float:
    program, _ = from_bytes(content, own_policy.FACTS)
    generator, worst = torch.Generator().manual_seed(0), torch.zeros(())
    for _ in range(TRIALS):
        inputs = [torch.rand(1, *one.shape, generator=generator) for one in network.facts("").inputs]
        (told,) = program(*inputs)
        said, expected = (network.space.to_unit(answer) for answer in (told, network(*inputs)))
        worst = torch.maximum(worst, (said - expected).abs().max())
    return float(worst)
