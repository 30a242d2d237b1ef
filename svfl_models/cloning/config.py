"""What a behaviour cloning run is made of: plain values, light to import."""

from dataclasses import asdict, dataclass
from typing import Any

ENCODERS = ("v", "f", "p", "vf", "vp", "vfp")
LOSSES = ("action", "likelihood")
VIEWS = ("gripper", "camera")


@dataclass(frozen=True)
class CloningConfig:
    """Configuration of one run.

    Attributes:
        data: Dataset folder with demonstrations.
        episodes: Demonstrations to use: the first so many that succeeded.
        encoder: What the policy looks at: ``v`` image, ``f`` wrench window, ``p`` proprioception, or several.
        group: Symmetry group, see `groups.GROUPS`; ``none`` is the parameter-matched CNN baseline (the paper's CNN).
        seed: Of the held-out episodes, the initial weights, the batches, the crops.
        preset: Sizes of the network, see `presets.PRESETS`.
        loss: How far the policy is from a demonstrated action, see `cloning.loss`.
        augment: Colours and places of training images change at random (`augmentation`); without, only the paper's
            crops.
        view: Where the picture has its middle, one of `VIEWS`: ``gripper``, at the gripper, or ``camera``, as it was
            taken.
        image_size: Height and width of what the network sees, [px].
        camera: Whose images it sees; by default the first one's, in alphabetical order.
        valid: Share of the demonstrations that is held out, to see whether what was learned holds elsewhere.
        epochs: Epochs to train; over them the learning rate falls to zero along a cosine.
        batch_size: Steps of demonstrations per step of the optimiser.
        learning_rate: Of Adam, at the start.

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
    view: str = "gripper"
    image_size: int = 64
    camera: str | None = None
    valid: float = 0.1
    epochs: int = 60
    batch_size: int = 64
    learning_rate: float = 1e-3

    @property
    def model(self) -> str:
        """The paper's name of the kind of network."""
        return "cnn" if self.group == "none" else "svfl"

    def network(self) -> dict[str, Any]:
        """Arguments of `policy.Policy`."""
        return {name: getattr(self, name) for name in ("encoder", "group", "preset", "image_size")}

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files."""
        return asdict(self)
