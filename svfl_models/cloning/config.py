"""Configuration of a behaviour cloning run, in plain values; importing this module loads no heavy library."""

from dataclasses import asdict, dataclass, field
from typing import Any

ENCODERS = ("v", "f", "p", "vf", "vp", "vfp")
LOSSES = ("action", "likelihood")
VIEWS = ("gripper", "camera")
NETWORKS: dict[str, dict[str, Any]] = {
    "svfl": {"group": "D4", "rotate": False},
    "cnn": {"group": "none", "rotate": False},
    "cnn-rotated": {"group": "none", "rotate": True},
}
"""Settings of the networks that experiments compare, by their names; the last one is trained with rotated samples
instead of being symmetric."""


@dataclass(frozen=True)
class CloningConfig:
    """Configuration of one behaviour cloning run.

    Attributes:
        data: Path of the dataset folder with the demonstrations.
        episodes: Number of demonstrations to use: the first ones of the dataset that succeeded.
        encoder: Inputs of the policy, one of `ENCODERS`: ``v`` image, ``f`` wrench window, ``p`` proprioception, or a
            combination of them.
        group: Name of the symmetry group, a key of `groups.GROUPS`; ``none`` is the parameter-matched CNN baseline (the
            paper's CNN).
        seed: Seed of the choice of held-out episodes, the initial weights, the batches and the crops.
        preset: Name of the network's layer sizes, a key of `presets.PRESETS`.
        loss: Distance between the policy and a demonstrated action, one of `LOSSES`: ``action`` or ``likelihood`` (see
            `cloning.loss`).
        augment: Whether the colours and positions of training images are changed at random (`training.augmentation`).
            False leaves only the random crops.
        rotate: Whether every training step, observation and action together, is rotated and mirrored by a random
            element of D4, the usual substitute for a symmetric network.
        view: Centre of the images, one of `VIEWS`: ``gripper``, cropped around the gripper, or ``camera``, cropped from
            the middle of the camera image.
        image_size: Height and width of the images that the network gets, [px].
        camera: Name of the camera whose images are used. May be None if there is one camera.
        inputs: Inputs of the user's own, in the place of `encoder`, see `cloning.recorded_inputs`; empty for `encoder`.
        action: Path of the action that is learned, if `inputs` are given.
        valid: Share of the demonstrations that is held out to measure how well the policy generalises, 0..1.
        epochs: Number of epochs to train, over which the learning rate falls to zero along a cosine.
        batch_size: Number of demonstrated steps per optimiser step.
        learning_rate: Learning rate of Adam at the start of the training.

    Example:
        >>> CloningConfig(data="data/week", group="C4", epochs=5).group
        'C4'
    """

    data: str
    episodes: int = 50
    encoder: str = "vfp"
    group: str = "D4"
    seed: int = 0
    preset: str = "default"
    loss: str = "action"
    augment: bool = True
    rotate: bool = False
    view: str = "gripper"
    image_size: int = 64
    camera: str | None = None
    inputs: list[str] = field(default_factory=list)
    action: str = "actions/action"
    valid: float = 0.1
    epochs: int = 60
    batch_size: int = 64
    learning_rate: float = 1e-3

    @property
    def model(self) -> str:
        """Kind of network in the terms of the paper: ``cnn`` if `group` is ``none``, otherwise ``svfl``."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Return the arguments of `policy.Policy`, as plain values."""
        return {name: getattr(self, name) for name in ("encoder", "group", "preset", "image_size")}

    def plain(self) -> dict[str, Any]:
        """Return the configuration as a dictionary of plain values for files."""
        return asdict(self)
