"""What a training run is made of: plain values, light to import."""

from dataclasses import asdict, dataclass
from typing import Any

from svfl_data.sampling.centering_samples import View

MODELS = ("svfl", "cnn")
TARGETS = ("direction", "offset")
USES = ("frozen", "fine-tuned", "from-scratch")


@dataclass(frozen=True)
class Latent:
    """A pretrained latent model whose encoder is the trunk of a classifier; `pretrained.describe` reads it off a file.

    Attributes:
        checkpoint: Where it was.
        sha256: Of the file's content: a newer checkpoint of the same name is another one.
        model: One of `latent.config.MODELS`.
        data: Dataset folder that it was pretrained on.
        preset: Of the pretraining.
        steps: Of the pretraining.
        use: ``frozen``: only the head learns; ``fine-tuned``: the encoder too; ``from-scratch``: likewise, from random
            weights, which tells what the pretraining is worth.
        learning_rate: Of the encoder at the start, where it learns.
    """

    checkpoint: str
    sha256: str
    model: str
    data: str
    preset: str
    steps: int
    use: str = "fine-tuned"
    learning_rate: float = 1e-4

    def __str__(self) -> str:
        return f"{self.model}-{self.use}-{self.sha256[:8]}"


@dataclass(frozen=True)
class TrainingConfig:
    """Configuration of one block-centering run; defaults are the paper's (Kohler et al., CoRL 2023, appendix).

    Attributes:
        data: Dataset folder.
        encoder: What the network looks at: ``v`` image, ``f`` wrench window, ``vf`` both; ``vfp`` proprioception
            besides, as latent encoders do.
        group: Symmetry group, see `groups.GROUPS`; ``none`` is the parameter-matched CNN baseline (the paper's CNN).
        train_samples: Size of the training set, balanced over the classes.
        seed: Of the training set, the initial weights, the batches and the crops.
        preset: Sizes of the network, see `presets.PRESETS`.
        target: What it learns: one of four ``direction`` classes, or the ``offset`` in metres.
        torque: ``axial``, or ``polar`` as the paper types it.
        view: Images as the ``camera`` took them, or as seen from straight above (``top``, `svfl_data.signals.topdown`).
        image_size: Height and width of what the network sees, [px].
        augment: Colours and places of training images change at random (`augmentation`); without, only the paper's
            crops.
        rotate: Turn and mirror every training sample at random: what a plain network can do instead.
        noise: Noise to add to every reading, in multiples of the sensor's own (`sensor_noise.WHITE`).
        test_samples: Size of the test set, the same samples for every seed and training size.
        window: Readings per wrench window.
        epochs: Epochs to train; over them the learning rate falls to zero along a cosine.
        patience: Stop after so many epochs without a better test accuracy, as the paper does; 0 never.
        batch_size: Samples per step.
        learning_rate: Of Adam, at the start.
        latent: Pretrained encoder that takes the place of the package's own ones; `group` is ``none`` then.

    Example:
        >>> TrainingConfig(data="data/week", encoder="vf", group="D4", train_samples=25).train_samples
        25
    """

    data: str
    encoder: str = "vf"
    group: str = "D4"
    train_samples: int = 100
    seed: int = 0
    preset: str = "default"
    target: str = "direction"
    torque: str = "axial"
    view: View = "camera"
    image_size: int = 64
    augment: bool = True
    rotate: bool = False
    noise: float = 0.0
    test_samples: int = 100
    window: int = 64
    epochs: int = 500
    patience: int = 0
    batch_size: int = 64
    learning_rate: float = 1e-3
    latent: Latent | None = None

    def __post_init__(self) -> None:
        if isinstance(self.latent, dict):  # as `plain` wrote it
            object.__setattr__(self, "latent", Latent(**self.latent))

    @property
    def model(self) -> str:
        """The paper's name of the kind of network."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Arguments of `classifier.CenteringClassifier`."""
        names = ("encoder", "group", "preset", "target", "image_size", "window", "torque")
        return {name: getattr(self, name) for name in names}

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files; ``TrainingConfig(**config.plain())`` is the same again."""
        plain = asdict(self)
        return {name: value for name, value in plain.items() if name != "latent" or value is not None}
