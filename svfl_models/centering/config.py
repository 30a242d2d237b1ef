"""Configuration of a block-centering run, in plain values; importing this module loads no heavy library."""

from dataclasses import dataclass, field
from typing import Annotated, Any

from svfl_data.sampling.centering_samples import VIEWS, View
from svfl_models.configuration.setting import option, plain_values
from svfl_models.networks.inputs import CROP, IMAGE_SIZES, INPUTS, view_help
from svfl_models.networks.presets import PRESET_HELP, PRESETS, Widths, widths_of
from svfl_models.symmetry.groups import GROUPS, TORQUES
from svfl_models.training.schedules import SCHEDULES

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
    """Configuration of one block-centering run; the texts of the fields are also the help of ``svfl-train centering``.

    The default batch size and learning rate are those of the paper (Kohler et al., CoRL 2023, appendix).

    Attributes:
        camera: None stands for the only camera, until `train.with_camera` finds out its name, or for no camera if there
            are no images. Vectors are given in the image-aligned axes of the camera.
        latent: Pretrained encoder that replaces the package's own ones; `group` must be ``none`` then. None for no
            pretrained encoder.

    Example:
        >>> TrainingConfig(data="data/week", encoder="vf", group="D4", train_samples=25).train_samples
        25
    """

    data: Annotated[str, option("dataset folder of svfl-collect centering", metavar="FOLDER")]
    encoder: Annotated[str, option(
        "inputs of the network: v for image, f for wrench (force and torque), vf for both; vfp also for "
        "proprioception, which pretrained latent encoders need", choices=tuple(INPUTS))] = "vf"  # fmt: skip
    group: Annotated[str, option(
        "symmetry group of the network: C for rotations, D for rotations and reflections, and the number of rotations; "
        "none for no symmetry, the baseline of the paper (CNN) that has about as many parameters",
        choices=tuple(GROUPS))] = "D4"  # fmt: skip
    train_samples: Annotated[int, option(
        "number of training samples, balanced over the four directions", ge=1)] = 100  # fmt: skip
    seed: Annotated[int, option(
        "seed of the choice of training samples, the initial weights, the batches and the crops",
        ge=0)] = 0  # fmt: skip
    preset: Annotated[str, option(PRESET_HELP, choices=tuple(PRESETS))] = "default"
    target: Annotated[str, option(
        "quantity to predict: one of four directions, or the offset in m", choices=TARGETS)] = "direction"  # fmt: skip
    torque: Annotated[str, option(
        "how a torque transforms under reflections: axial (correct), or polar as in the paper",
        choices=TORQUES)] = "axial"  # fmt: skip
    camera: Annotated[str, option(
        "camera whose images are used; must be given if there are several", metavar="NAME")] | None = None  # fmt: skip
    view: Annotated[View, option(view_help(VIEWS), choices=VIEWS)] = "camera"
    image_size: Annotated[int, option(
        "height and width of the network's images, px", choices=IMAGE_SIZES)] = 64  # fmt: skip
    augment: Annotated[bool, option(
        "change colours and depth of training images at random, and shift crops further than in the paper; without it "
        "there are only the random crops of the paper")] = True  # fmt: skip
    rotate: Annotated[bool, option(
        "rotate training samples by random quarter turns and mirror them at random, the usual substitute for a "
        "symmetric network")] = False  # fmt: skip
    noise: Annotated[float, option(
        "noise that is added to every wrench reading, in multiples of the simulated sensor's white noise",
        ge=0)] = 0.0  # fmt: skip
    test_samples: Annotated[int, option(
        "number of test samples, the same ones for every seed and number of training samples", ge=1)] = 100  # fmt: skip
    valid_samples: Annotated[int, option(
        "number of samples, beside those for training and testing, by whose accuracy --patience stops a training; 0: "
        "by the accuracy on the test samples, as in the paper", ge=0)] = 0  # fmt: skip
    window: Annotated[int, option("number of readings per wrench window", ge=1)] = 64
    epochs: Annotated[int, option("largest number of epochs to train", ge=1)] = 500
    patience: Annotated[int, option(
        "number of epochs without a better accuracy (--valid-samples) after which a training stops; 0: never",
        ge=0)] = 0  # fmt: skip
    batch_size: Annotated[int, option("number of samples per optimiser step", ge=1)] = 64
    learning_rate: Annotated[float, option("learning rate of Adam at the start of the training", gt=0)] = 1e-3
    latent: Annotated[Latent, option("pretrained latent encoder, as --latent describes it", flag=False)] | None = None
    widths: Annotated[dict[str, Any], option(
        "layers whose sizes differ from those of the preset: numbers of fields of the vision encoder's six layers "
        "(vision), of the force encoder (force) and its attention heads (heads), and of the joint feature (latent)",
        partial=Widths)] = field(default_factory=dict, hash=False)  # fmt: skip
    crop: Annotated[float, option(
        "side of the square that is cut out of the camera's images and scaled to --image-size, as a share of the "
        "image's side; 64/76 in the paper", gt=0, le=1)] = CROP  # fmt: skip
    schedule: Annotated[str, option(
        "course of the learning rate: cosine falls to zero along a cosine over the training, constant stays",
        choices=SCHEDULES)] = "cosine"  # fmt: skip

    def __post_init__(self) -> None:
        if isinstance(self.latent, dict):  # as `plain` wrote it
            object.__setattr__(self, "latent", Latent(**self.latent))

    @property
    def model(self) -> str:
        """Kind of network in the terms of the paper: ``cnn`` if `group` is ``none``, otherwise ``svfl``."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Return the arguments of `classifier.CenteringClassifier`, as plain values, with the sizes of all layers."""
        names = ("encoder", "group", "target", "image_size", "window", "torque", "crop")
        plain = {name: getattr(self, name) for name in names}
        return plain | {"widths": widths_of(self.preset, self.group, self.widths).plain()}

    def plain(self) -> dict[str, Any]:
        """Return the configuration as plain values for files; ``TrainingConfig(**config.plain())`` restores it."""
        plain = plain_values(self)
        return {name: value for name, value in plain.items() if name != "latent" or value is not None}


@dataclass(frozen=True)
class SeparateTest:
    """Second dataset that networks are tested on; it does not tell runs apart."""

    separate_test: Annotated[str, option(
        "second dataset folder of svfl-collect centering, all of whose samples are tested too and none of which is "
        "trained on", metavar="FOLDER")] | None = None  # fmt: skip


@dataclass(frozen=True)
class Sweep:
    """What an experiment of many trainings varies, beside what its kind varies."""

    data: Annotated[str, option("dataset folder of svfl-collect centering", metavar="FOLDER")]
    train_samples: Annotated[list[Annotated[int, option("", ge=1)]], option(
        "numbers of training samples to compare")]  # fmt: skip
    seeds: Annotated[int, option("number of seeds; the seeds are 0 to N-1", ge=1)] = 3


@dataclass(frozen=True)
class LatentSweep:
    """Pretrained encoders that an experiment compares."""

    latents: Annotated[list[str], option("checkpoints of svfl-train latent to compare", metavar="CHECKPOINT")]
    uses: Annotated[list[str], option(
        "how to use the pretrained encoders: frozen trains only the head; fine-tuned trains the encoder as well; "
        "from-scratch trains both from random weights, for comparison",
        choices=USES)] = field(default_factory=lambda: list(USES))  # fmt: skip
