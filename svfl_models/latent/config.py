"""What a latent pretraining is made of: plain values, light to import; presets of three publications, and ours.

`vtt_2022` is Chen et al. ("Visuo-Tactile Transformers for Manipulation", CoRL 2022) with the sizes and weights of its
published code, `lee_2020` Lee et al. ("Making Sense of Vision and Touch", T-RO 2020), `svfl_2023` the baselines of
Kohler et al. (CoRL 2023), which name VTT's architectures and train 10,000 steps of batches of 32 on expert episodes.
`balanced` is ours: the same with weights at which contact and alignment rise above chance beside the pictures
(docs/latent.md). What had to change for this package's observations is written in `svfl_models.latent`.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

from svfl_data.errors import TrainingError

MODELS = ("vtt", "poe", "concat")
MODALITIES = ("image", "wrench", "proprio")
DEEPEST = 64
"""Most blocks of self-attention."""
TERMS = (
    "image", "depth", "kl", "expert_kl", "reward", "contact", "next_contact", "alignment", "mismatch", "next_proprio",
)  # fmt: skip
"""Terms of the loss (`losses`), in the order in which they are written down."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the networks; defaults are those of VTT's published code, as far as it has such a layer.

    Attributes:
        feature: Numbers that an encoder makes of an observation.
        z1: First part of the latent state.
        z2: Second part, the one that the dynamics carry on.
        hidden: Units of the dynamics' hidden layers.
        patch: Edge of VTT's image patches, [px].
        readings: Consecutive readings of VTT's wrench tokens.
        dim: Numbers per token.
        depth: Blocks of self-attention.
        heads: Of the attention.
        token: Units that each token is reduced to before all are joined, two layers.
        joined: Units between the joined tokens and the feature.
        image: Channels of the convolutions of PoE and concat.
        wrench: Units of the tree over their wrench window; each layer halves the readings.
        proprio: Units of their proprioception's layers.
        concat: Numbers that concat makes of image, wrench and proprioception.
        decoder: Channels of the decoder.
        heads_hidden: Units of the layers that predict the next step.
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
    """What a publication prescribes.

    Attributes:
        weights: Of each of `TERMS`; a term of weight 0 is not computed.
        summed: Terms that are summed over the elements and frames of a sequence; the others are means.
        contact_n: Force above which a frame counts as contact, [N].
        batch_size: Sequences per step.
        sequence: Actions per sequence, S; it has S + 1 frames.
        negatives: Frames of each sequence that are also shown with the wrench of another one.
        sizes: Of the networks.
    """

    weights: dict[str, float]
    summed: tuple[str, ...]
    contact_n: float
    batch_size: int = 32
    sequence: int = 8
    negatives: int = 3
    sizes: Sizes = field(default_factory=Sizes)


_RAISED = 1000.0
"""Weight of a mean beside sums over the 150,000 pixels and channels of a sequence, of which pretraining saves about a
twentieth of a nat each."""
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
    """Configuration of one pretraining.

    Attributes:
        data: Dataset folder.
        model: One of `MODELS`.
        preset: One of `PRESETS`.
        steps: Steps of the optimiser.
        batch_size: Sequences per step.
        sequence: Actions per sequence.
        seed: Of the initial weights, and with the number of the step of all that is drawn in it.
        split: Name of a split stored with the dataset; by default one that is drawn, 4 of 5 episodes to train on.
        contact_n: Force above which a frame counts as contact, [N].
        mixed: Whether episodes may be of different tasks or action spaces.
        checkpoint_every: Steps between two checkpoints.
        learning_rate: Of Adam.

    Example:
        >>> LatentConfig("data/week", "poe", steps=100).model
        'poe'
    """

    data: str
    model: str
    preset: str = "svfl_2023"
    steps: int = 10_000
    batch_size: int = PRESETS["svfl_2023"].batch_size
    sequence: int = PRESETS["svfl_2023"].sequence
    seed: int = 0
    split: str = ""
    contact_n: float = PRESETS["svfl_2023"].contact_n
    mixed: bool = False
    checkpoint_every: int = 250
    learning_rate: float = 1e-4

    def network(self) -> dict[str, Any]:
        """Arguments of `network.LatentNetwork`, plain values."""
        return {"model": self.model, "sizes": plain(PRESETS[self.preset].sizes)}

    def objective(self) -> dict[str, Any]:
        """Arguments of `losses.Objective`, plain values."""
        preset = PRESETS[self.preset]
        return {"weights": dict(preset.weights), "summed": list(preset.summed), "negatives": preset.negatives}

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files."""
        return asdict(self)


def plain(sizes: Sizes) -> dict[str, Any]:
    """Sizes as a checkpoint keeps them; ``Sizes(**plain(sizes))`` builds the same networks."""
    return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(sizes).items()}
