"""Complete latent model: encoder, dynamics, decoder and prediction heads."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from svfl_data.errors import TrainingError
from svfl_models.latent.config import MODELS, Sizes
from svfl_models.latent.inputs import PROPRIO, Inputs
from svfl_models.latent.networks.concat import ConcatEncoder
from svfl_models.latent.networks.decoder import DEPTH_UNIT, Decoder
from svfl_models.latent.networks.dynamics import ACTION, LatentDynamics, States
from svfl_models.latent.networks.encoder import Encoder, Encoding, Parts
from svfl_models.latent.networks.poe import PoEEncoder
from svfl_models.latent.networks.portion import Portion
from svfl_models.latent.networks.trunks import perceptron
from svfl_models.latent.networks.vtt import VTTEncoder
from svfl_models.symmetry.actions import Batch

ENCODERS: dict[str, type[VTTEncoder] | type[PoEEncoder] | type[ConcatEncoder]] = {
    "vtt": VTTEncoder, "poe": PoEEncoder, "concat": ConcatEncoder,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class LatentOutput:
    """Output of a latent model for B sequences of T frames and S = T - 1 actions.

    Attributes:
        parts: What the encoder computes from each modality of each frame alone, with batch dimension B T.
        encoding: Output of the encoder for each frame, with batch dimension B T.
        states: Latent states of the frames.
        reward: Logit of a reward for each action, shape (B, S).
        next_contact: Logit of contact between each frame and the next, shape (B, S).
        next_proprio: Predicted proprioception of the next frame, scaled as by `Inputs`, shape (B, S, 6).
    """

    parts: Parts
    encoding: Encoding
    states: States
    reward: Tensor
    next_contact: Tensor
    next_proprio: Tensor


class LatentNetwork(nn.Module):
    """Encoder, dynamics, decoder and the heads that predict the reward and the next step.

    Args:
        model: Kind of encoder, one of `config.MODELS`.
        sizes: Layer sizes of the networks, as `config.plain` returns them; None for the defaults of `config.Sizes`.

    Raises:
        TrainingError: If `model` is not one of `config.MODELS`.
    """

    def __init__(self, model: str, sizes: dict[str, Any] | None = None) -> None:
        super().__init__()
        if model not in ENCODERS:
            raise TrainingError(f"no model {model!r}; there are {', '.join(MODELS)}")
        self.sizes = Sizes(**(sizes or {}))
        state, hidden = self.sizes.z1 + self.sizes.z2, self.sizes.heads_hidden
        self.inputs = Inputs()
        self.encoder: Encoder = ENCODERS[model](self.sizes)
        self.dynamics = LatentDynamics(self.sizes)
        self.decoder = Decoder(self.sizes)
        self.reward = perceptron(2 * state + ACTION, (hidden, hidden), 1)
        self.next_step = perceptron(state + ACTION, (hidden, hidden), 1 + PROPRIO)

    def encode(self, batch: Mapping[str, Tensor]) -> Encoding:
        """Encode physical observations with one leading dimension; PoE accepts any subset of the modalities."""
        return self.encoder(self.inputs(batch, [name for name in ("image", "wrench", "proprio") if name in batch]))

    def forward(self, batch: Batch, portion: Portion | None = None) -> LatentOutput:
        """Compute the encodings, latent states and predictions of sequences.

        Args:
            batch: Physical values: ``image`` (B, T, 4, 64, 64), ``wrench`` (B, T, 64, 6), ``proprio`` (B, T, 5) and
                ``action`` (B, S, 5), see `data.Sequences`.
            portion: Part of a batch that the sequences are; None for a whole batch.
        """
        inputs, action = self.inputs(batch), self.inputs.action(batch["action"])
        parts = self.encoder.parts({name: values.flatten(0, 1) for name, values in inputs.items()})
        encoding = self.encoder.join(parts, portion)
        states = self.dynamics(encoding.feature.unflatten(0, batch["proprio"].shape[:2]), action, portion)
        now, after = states.state[:, :-1], states.state[:, 1:]
        following = self.next_step(torch.cat([now, action], dim=-1))
        reward = self.reward(torch.cat([now, action, after], dim=-1))
        return LatentOutput(parts, encoding, states, reward[..., 0], following[..., 0], following[..., 1:])

    def picture(self, state: Tensor) -> Tensor:
        """Decode states (..., Z) to images (..., 4, 64, 64): colour 0..1 (approximately) and depth in [m]."""
        mean = self.inputs.normalization.mean("image")[:, None, None]
        unit = mean.new_tensor([1.0, 1.0, 1.0, DEPTH_UNIT])[:, None, None]
        return (mean + unit * self.decoder(state.flatten(0, -2))).unflatten(0, state.shape[:-1])
