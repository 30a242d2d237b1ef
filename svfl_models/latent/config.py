"""Configuration and presets of a latent pretraining, in plain values; importing this module loads no heavy library.

The preset `vtt_2022` is Chen et al. ("Visuo-Tactile Transformers for Manipulation", CoRL 2022) with the sizes and
weights of its published code. `lee_2020` is Lee et al. ("Making Sense of Vision and Touch", T-RO 2020). `svfl_2023` are
the baselines of Kohler et al. (CoRL 2023), which name VTT's architectures and train 10,000 steps of batches of 32 on
expert episodes. `balanced` is this package's own: `svfl_2023` with weights at which contact and alignment rise above
chance beside the image terms (docs/latent.md). `svfl_models.latent` describes what had to change for this package's
observations.
"""

from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any

from svfl_data.errors import TrainingError
from svfl_models.configuration.setting import option, plain_values
from svfl_models.networks.presets import PRESET_HELP
from svfl_models.training.schedules import SCHEDULES

MODELS = ("vtt", "poe", "concat")
MODALITIES = ("image", "wrench", "proprio")
DEEPEST = 64
"""Largest allowed number of self-attention blocks."""
TERMS = (
    "image", "depth", "kl", "expert_kl", "reward", "contact", "next_contact", "alignment", "mismatch", "next_proprio",
)  # fmt: skip
"""Names of the terms of the loss (`losses`), in the order in which metrics files list them."""


@dataclass(frozen=True)
class Sizes:
    """Layer sizes of the networks; defaults are those of VTT's published code where it has such a layer.

    Attributes:
        feature: Length of the feature that an encoder computes from an observation.
        z1: Length of z1, the first part of the latent state.
        z2: Length of z2, the second part of the latent state, which the dynamics pass on to the next step.
        hidden: Units of each hidden layer of the dynamics.
        patch: Side of VTT's image patches, [px].
        readings: Number of consecutive readings in each of VTT's wrench tokens.
        dim: Length of each of VTT's tokens.
        depth: Number of VTT's self-attention blocks.
        heads: Number of heads of VTT's self-attention.
        token: Units of the two layers that reduce each of VTT's tokens before all tokens are joined.
        joined: Units of VTT's layer between the joined tokens and the feature.
        image: Channels after each of the first four convolutions of PoE and concat.
        wrench: Units of each layer of the tree over the wrench window of PoE and concat; each layer halves the number
            of readings.
        proprio: Units of the hidden layers for proprioception of PoE and concat.
        concat: Lengths of the vectors that concat computes from image, wrench and proprioception.
        decoder: Channels at the input of each of the decoder's four transposed convolutions.
        heads_hidden: Units of the hidden layers that predict the reward and the next step.
    """

    feature: int = 288
    z1: int = 32
    z2: int = 256
    hidden: int = 256
    patch: int = 16
    readings: int = 16
    dim: int = 384
    depth: int = 6
    heads: int = 8
    token: tuple[int, int] = (96, 32)
    joined: int = 640
    image: tuple[int, int, int, int] = (16, 32, 64, 128)
    wrench: tuple[int, ...] = (16, 32, 64, 64, 128, 256)
    proprio: tuple[int, ...] = (32, 64, 128, 256)
    concat: tuple[int, int, int] = (256, 32, 32)
    decoder: tuple[int, int, int, int] = (256, 128, 64, 32)
    heads_hidden: int = 128

    def __post_init__(self) -> None:
        if not 1 <= self.depth <= DEEPEST:
            raise TrainingError(f"{self.depth} blocks of self-attention; possible are 1 to {DEEPEST}")


@dataclass(frozen=True)
class Preset:
    """Settings of a preset: those of a publication, or this package's own (``balanced``).

    Attributes:
        weights: Weight in the loss of each of `TERMS`; a term of weight 0 is not computed.
        summed: Terms that are summed over the elements and frames of a sequence; all others are means.
        contact_n: Force above which a frame counts as contact, [N].
        batch_size: Number of sequences per optimiser step.
        sequence: Number S of actions per sequence, which has S + 1 frames.
        negatives: Number of frames of each sequence that are also shown with the wrench of another frame.
        sizes: Layer sizes of the networks.
    """

    weights: dict[str, float]
    summed: tuple[str, ...]
    contact_n: float
    batch_size: int = 32
    sequence: int = 8
    negatives: int = 3
    sizes: Sizes = field(default_factory=Sizes)


_RAISED = 1000.0
"""Weight in `balanced` of the terms that are means. The image terms are sums over the 150,000 pixels and channels of a
sequence, and pretraining lowers each of these by about a twentieth of a nat, so that a mean needs a weight of this size
to count beside them."""
_VTT_SUMMED = ("image", "depth", "kl", "expert_kl", "reward")
PRESETS = {
    "vtt_2022": Preset(
        {"image": 1.0, "depth": 1.0, "kl": 1.0, "expert_kl": 0.0, "reward": 1.0, "contact": 1.0, "next_contact": 0.0,
         "alignment": 1.0, "mismatch": 1.0, "next_proprio": 0.0},
        _VTT_SUMMED, contact_n=15.0, negatives=9,
    ),
    "lee_2020": Preset(
        {"image": 10.0, "depth": 10.0, "kl": 1.0, "expert_kl": 0.05, "reward": 0.0, "contact": 0.0, "next_contact": 1.0,
         "alignment": 0.5, "mismatch": 0.5, "next_proprio": 1.0},
        ("expert_kl",), contact_n=0.5, batch_size=64, sequence=1, negatives=1, sizes=Sizes(feature=128),
    ),
    "svfl_2023": Preset(
        {"image": 1.0, "depth": 1.0, "kl": 1.0, "expert_kl": 1e-3, "reward": 1.0, "contact": 1.0, "next_contact": 1.0,
         "alignment": 1.0, "mismatch": 1.0, "next_proprio": 1.0},
        _VTT_SUMMED, contact_n=0.5,
    ),
    "balanced": Preset(
        {"image": 1.0, "depth": 1.0, "kl": 1.0, "expert_kl": 1e-3, "reward": 1.0, "contact": _RAISED,
         "next_contact": _RAISED, "alignment": _RAISED, "mismatch": _RAISED, "next_proprio": _RAISED},
        _VTT_SUMMED, contact_n=0.5,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class LatentConfig:
    """Configuration of one latent pretraining; the texts of the fields are also the help of ``svfl-train latent``.

    Example:
        >>> LatentConfig("data/week", "poe", steps=100).model
        'poe'
    """

    data: Annotated[str, option("dataset folder of svfl-collect expert", metavar="FOLDER")]
    model: Annotated[str, option(
        "kind of network: vtt is a transformer, poe a product of experts, concat concatenates features",
        choices=MODELS)]  # fmt: skip
    preset: Annotated[str, option(
        f"{PRESET_HELP} and the weights of its loss terms, from the publication that it is called after; balanced are "
        "this package's own",
        choices=tuple(PRESETS))] = "svfl_2023"  # fmt: skip
    steps: Annotated[int, option("number of optimiser steps", ge=1)] = 10_000
    batch_size: Annotated[int, option(
        "number of sequences per optimiser step; --preset lee_2020 has 64", ge=1)] = 32  # fmt: skip
    sequence: Annotated[int, option("number of actions per sequence; --preset lee_2020 has 1", ge=1)] = 8
    camera: Annotated[str, option(
        "camera whose images are used; must be given if there are several", metavar="NAME")] | None = None  # fmt: skip
    seed: Annotated[int, option("seed of everything random in the training", ge=0)] = 0
    split: Annotated[str, option(
        "split that svfl-data split has stored in the dataset; without one a new split is drawn with 4 of 5 episodes "
        "to train on", metavar="NAME")] = ""  # fmt: skip
    contact_n: Annotated[float, option(
        "force above which a frame counts as contact, N; --preset vtt_2022 has 15", gt=0,
        metavar="F")] = 0.5  # fmt: skip
    mixed: Annotated[bool, option(
        "allow episodes of different tasks, or with different limits of the actions")] = False  # fmt: skip
    checkpoint_every: Annotated[int, option("number of optimiser steps between two checkpoints", ge=1)] = 250
    learning_rate: Annotated[float, option("learning rate of Adam at the start of the training", gt=0)] = 1e-4
    schedule: Annotated[str, option(
        "course of the learning rate: cosine falls to zero along a cosine over the training, whose --steps cannot be "
        "raised afterwards, constant stays", choices=SCHEDULES)] = "constant"  # fmt: skip
    sizes: Annotated[dict[str, Any], option(
        "layers whose sizes differ from those of the preset", partial=Sizes)] = field(default_factory=dict)  # fmt: skip
    weights: Annotated[dict[str, float], option(
        "terms of the loss whose weights differ from those of the preset",
        keys=TERMS)] = field(default_factory=dict)  # fmt: skip

    @staticmethod
    def of_preset(preset: str) -> dict[str, Any]:
        """Return the settings that a preset gives beside layer sizes and loss weights, by name.

        Args:
            preset: Name of the preset, a key of `PRESETS`.
        """
        return {name: getattr(PRESETS[preset], name) for name in ("batch_size", "sequence", "contact_n")}

    def network(self) -> dict[str, Any]:
        """Return the arguments of `network.LatentNetwork`, as plain values."""
        return {"model": self.model, "sizes": plain(replace(PRESETS[self.preset].sizes, **self.sizes))}

    def objective(self) -> dict[str, Any]:
        """Return the arguments of `losses.Objective`, as plain values."""
        preset = PRESETS[self.preset]
        return {"weights": preset.weights | self.weights, "summed": list(preset.summed), "negatives": preset.negatives}

    def plain(self) -> dict[str, Any]:
        """Return the configuration as a dictionary of plain values for files."""
        return plain_values(self)


def plain(sizes: Sizes) -> dict[str, Any]:
    """Return layer sizes as plain values for a checkpoint; ``Sizes(**plain(sizes))`` builds the same networks."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(sizes).items()}
