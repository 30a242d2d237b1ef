"""What a training run is made of: plain values, light to import."""

from dataclasses import asdict, dataclass
from typing import Any

ENCODERS = ("v", "f", "vf")
MODELS = ("svfl", "cnn")
TORQUES = ("axial", "polar")


@dataclass(frozen=True)
class TrainingConfig:
    """Configuration of one block-centering run; defaults are the paper's (Kohler et al., CoRL 2023, appendix).

    Attributes:
        data: Dataset folder.
        encoder: What the network looks at: ``v`` image, ``f`` wrench window, ``vf`` both.
        model: ``svfl`` (equivariant to D4) or ``cnn`` (its plain twin).
        train_samples: Size of the training set, balanced over the classes.
        seed: Of the training set, the initial weights, the batches and the crops.
        preset: Sizes of the network, see `presets.PRESETS`.
        torque: ``axial``, or ``polar`` as the paper types it.
        test_samples: Size of the test set, the same samples for every seed and training size.
        window: Readings per wrench window.
        epochs: Most epochs to train.
        patience: Stop after so many epochs without a better test accuracy.
        batch_size: Samples per step.
        learning_rate: Of Adam.
    """

    data: str
    encoder: str = "vf"
    model: str = "svfl"
    train_samples: int = 100
    seed: int = 0
    preset: str = "default"
    torque: str = "axial"
    test_samples: int = 100
    window: int = 64
    epochs: int = 500
    patience: int = 50
    batch_size: int = 64
    learning_rate: float = 1e-3

    def network(self) -> dict[str, Any]:
        """Arguments of `classifier.CenteringClassifier`."""
        return {name: getattr(self, name) for name in ("encoder", "model", "preset", "window", "torque")}

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files."""
        return asdict(self)
