"""Configuration of a behaviour cloning run, in plain values; importing this module loads no heavy library."""

from dataclasses import dataclass, field
from typing import Annotated, Any

from svfl_data.errors import UsageError
from svfl_data.schema.input_spec import WINDOW
from svfl_models.configuration.setting import option, plain_values
from svfl_models.networks.inputs import CROP, IMAGE_SIZES, view_help
from svfl_models.networks.presets import PRESET_HELP, PRESETS, Widths, widths_of
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.schedules import SCHEDULES

ENCODERS = ("v", "f", "p", "vf", "vp", "vfp")
LOSSES = ("action", "likelihood")
VIEWS = ("camera", "gripper")
NETWORKS: dict[str, dict[str, Any]] = {
    "svfl": {"group": "D4", "rotate": False},
    "cnn": {"group": "none", "rotate": False},
    "cnn-rotated": {"group": "none", "rotate": True},
}
"""Settings of the networks that experiments compare, by their names; the last one is trained with rotated samples
instead of being symmetric."""


@dataclass(frozen=True)
class CloningConfig:
    """Configuration of one behaviour cloning run; the texts of the fields are also the help of ``svfl-train bc``.

    Example:
        >>> CloningConfig(data="data/week", group="C4", epochs=5).group
        'C4'
    """

    data: Annotated[str, option("dataset folder with demonstrations, as of svfl-collect expert", metavar="FOLDER")]
    episodes: Annotated[int, option(
        "number of demonstrations to use: the first ones that succeeded, part of which is held out (valid)",
        ge=1)] = 50  # fmt: skip
    encoder: Annotated[str, option(
        "inputs of the network: v for image, f for wrench (force and torque), p for proprioception, or several of them",
        choices=ENCODERS)] = "vfp"  # fmt: skip
    inputs: Annotated[list[str], option(
        "inputs of your own in the place of --encoder: cameras (cameras/front), windows of streams with number of "
        "readings and rate (streams/wrench/wrench=64@500), arrays below observations/; :invariant at the end for a "
        "sensor or camera on the gripper that does not rotate with the scene; images are cropped to their middle",
        metavar="INPUT")] = field(default_factory=list)  # fmt: skip
    window: Annotated[int, option(
        "number of readings per wrench window; --inputs name windows of their own", ge=1)] = WINDOW  # fmt: skip
    action: Annotated[str, option(
        "array with the actions to learn, if --inputs are given", metavar="PATH")] = "actions/action"  # fmt: skip
    group: Annotated[str, option(
        "symmetry group of the network: C for rotations, D for rotations and reflections, and the number of rotations; "
        "none for no symmetry, the baseline of the paper (CNN) that has about as many parameters",
        choices=tuple(GROUPS))] = "D4"  # fmt: skip
    preset: Annotated[str, option(PRESET_HELP, choices=tuple(PRESETS))] = "default"
    widths: Annotated[dict[str, Any], option(
        "layers whose sizes differ from those of the preset: numbers of fields of the vision encoder's six layers "
        "(vision), of the force encoder (force) and its attention heads (heads), of the three layers for vectors "
        "(proprio), and of the joint feature (latent)",
        partial=Widths)] = field(default_factory=dict, hash=False)  # fmt: skip
    image_size: Annotated[int, option(
        "height and width of the network's images, px", choices=IMAGE_SIZES)] = 64  # fmt: skip
    crop: Annotated[float, option(
        "side of the square that is cut out of the camera's images and scaled to --image-size, as a share of the "
        "image's shorter side; 64/76 in the paper", gt=0, le=1)] = CROP  # fmt: skip
    camera: Annotated[str, option(
        "camera whose images are used; must be given if there are several", metavar="NAME")] | None = None  # fmt: skip
    view: Annotated[str, option(view_help(VIEWS), choices=VIEWS)] = "gripper"
    augment: Annotated[bool, option(
        "change colours and depth of training images at random, and shift crops further than in the paper; without it "
        "there are only the random crops of the paper")] = True  # fmt: skip
    rotate: Annotated[bool, option(
        "rotate training steps, observations and actions together, by random quarter turns and mirror them at random, "
        "the usual substitute for a symmetric network")] = False  # fmt: skip
    noise: Annotated[float, option(
        "white noise that is added to the wrench readings of training, in multiples of the simulated sensor's",
        ge=0)] = 0.0  # fmt: skip
    loss: Annotated[str, option(
        "loss: action is the error of the action; likelihood is the negative log-likelihood, with which the standard "
        "deviations of the actions are learned too", choices=LOSSES)] = "action"  # fmt: skip
    valid: Annotated[float, option(
        "share of the demonstrations that is held out to measure how well the policy generalises", gt=0, le=0.5,
        metavar="SHARE")] = 0.1  # fmt: skip
    epochs: Annotated[int, option("number of epochs to train", ge=1)] = 60
    steps: Annotated[int, option(
        "number of optimiser steps to train, rounded up to whole epochs, in the place of --epochs",
        ge=1)] | None = None  # fmt: skip
    batch_size: Annotated[int, option("number of demonstrated steps per optimiser step", ge=1)] = 64
    learning_rate: Annotated[float, option("learning rate of Adam at the start of the training", gt=0)] = 1e-3
    schedule: Annotated[str, option(
        "course of the learning rate: cosine falls to zero along a cosine over the training, constant stays",
        choices=SCHEDULES)] = "cosine"  # fmt: skip
    seed: Annotated[int, option(
        "seed of the choice of held-out episodes, the initial weights, the batches and the crops",
        ge=0)] = 0  # fmt: skip

    def __post_init__(self) -> None:
        if self.inputs and self.window != WINDOW:
            raise UsageError(
                f"--window {self.window} and --inputs contradict each other; inputs name their own windows, such as "
                f"streams/wrench/wrench={self.window}@500"
            )

    @property
    def model(self) -> str:
        """Kind of network in the terms of the paper: ``cnn`` if `group` is ``none``, otherwise ``svfl``."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Return the arguments of `policy.Policy`, as plain values, with the sizes of all layers."""
        plain = {name: getattr(self, name) for name in ("encoder", "group", "image_size", "window", "crop")}
        return plain | {"widths": widths_of(self.preset, self.group, self.widths).plain()}

    def plain(self) -> dict[str, Any]:
        """Return the configuration as a dictionary of plain values for files."""
        return plain_values(self)
