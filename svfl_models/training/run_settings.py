"""Settings that every training has beside its configuration, and that do not distinguish runs."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any

from svfl_models.configuration.setting import option
from svfl_models.training.hardware import Hardware
from svfl_models.training.trackers.names import TRACKERS


@dataclass(frozen=True)
class RunSettings:
    """Hardware and experiment trackers of a training."""

    hardware: Annotated[Hardware, option("devices, number format and threads of the training")] = field(
        default_factory=Hardware
    )
    logger: Annotated[list[str], option(
        "experiment trackers to log to, beside the file metrics.csv, which is always written", choices=TRACKERS,
        metavar="NAME")] = field(default_factory=list)  # fmt: skip


def settings_of_run(hardware: Hardware, loggers: Sequence[str]) -> dict[str, Any]:
    """Return the fields of `RunSettings` as plain values, for the folder of a run."""
    return {"hardware": asdict(hardware), "logger": list(loggers)}
