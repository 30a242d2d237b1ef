"""Configuration of a block-centering run, in plain values; importing this module loads no heavy library."""

from dataclasses import asdict, dataclass
from typing import Any

from svfl_data.sampling.centering_samples import View

MODELS = ("svfl", "cnn")
TARGETS = ("direction", "offset")
USES = ("frozen", "fine-tuned", "from-scratch")


@dataclass(frozen=True)
class Latent:
    """Pretrained latent model whose encoder is the trunk of a classifier; `pretrained.describe` reads it from a file.

    Attributes:
        checkpoint: Path of the checkpoint file at the time of `pretrained.describe`.
        sha256: SHA-256 of the file's content, which tells a newer checkpoint of the same name from this one.
        model: Kind of latent model, one of `latent.config.MODELS`.
        data: Dataset folder that the model was pretrained on.
        preset: Name of the preset of the pretraining.
        steps: Number of optimiser steps of the pretraining.
        use: Training of the encoder. ``frozen``: only the head is trained. ``fine-tuned``: the encoder is trained as
            well. ``from-scratch``: the same from random initial weights, a control that shows what the pretraining is
            worth.
        learning_rate: Learning rate of the encoder at the start of the training; unused if `use` is ``frozen``.
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
    """Configuration of one block-centering run.

    The default batch size and learning rate are those of the paper (Kohler et al., CoRL 2023, appendix).

    Attributes:
        data: Path of the dataset folder.
        encoder: Inputs of the network: ``v`` image, ``f`` wrench window, ``vf`` both, or ``vfp`` both and
            proprioception, which latent encoders need.
        group: Name of the symmetry group, a key of `groups.GROUPS`; ``none`` is the parameter-matched CNN baseline (the
            paper's CNN).
        train_samples: Size of the training set, which is balanced over the classes.
        seed: Seed of the choice of training samples, the initial weights, the batches and the crops.
        preset: Name of the network's layer sizes, a key of `presets.PRESETS`.
        target: Quantity that the network learns: one of four ``direction`` classes, or the ``offset`` in metres.
        torque: How torques transform under reflections: ``axial``, or ``polar`` as in the paper (see
            `representations.wrench_parts`).
        camera: Name of the camera whose images are used, and in whose image-aligned axes vectors are given. None stands
            for the only camera, until `train.with_camera` finds out its name, or for no camera if there are no images.
        view: Viewpoint of the images: ``camera``, as the camera took them, or ``top``, as seen from straight above
            (`svfl_data.signals.topdown`).
        image_size: Height and width of the images that the network gets, [px].
        augment: Whether the colours and positions of training images are changed at random (`training.augmentation`).
            False leaves only the random crops of the paper.
        rotate: Whether every training sample is rotated and mirrored by a random element of D4, the usual substitute
            for a symmetric network.
        noise: Level of the noise that is added to every wrench reading, in multiples of `sensor_noise.WHITE`.
        test_samples: Size of the test set, which holds the same samples for every seed and training size.
        window: Number of readings per wrench window.
        epochs: Number of epochs to train, over which the learning rate falls to zero along a cosine.
        patience: Number of epochs without a better test accuracy after which the training stops, as in the paper. 0
            turns this off.
        batch_size: Number of samples per optimiser step.
        learning_rate: Learning rate of Adam at the start of the training.
        latent: Pretrained encoder that replaces the package's own ones; `group` must be ``none`` then. None for no
            pretrained encoder.

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
    camera: str | None = None
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
        """Kind of network in the terms of the paper: ``cnn`` if `group` is ``none``, otherwise ``svfl``."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Return the arguments of `classifier.CenteringClassifier`, as plain values."""
        names = ("encoder", "group", "preset", "target", "image_size", "window", "torque")
        return {name: getattr(self, name) for name in names}

    def plain(self) -> dict[str, Any]:
        """Return the configuration as plain values for files; ``TrainingConfig(**config.plain())`` restores it."""
        plain = asdict(self)
        return {name: value for name, value in plain.items() if name != "latent" or value is not None}
