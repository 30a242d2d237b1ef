"""TensorBoard: event files in the folder ``tensorboard`` of a training."""

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from PIL import Image
from tensorboard.compat.proto.summary_pb2 import Summary
from torch.utils.tensorboard.writer import FileWriter, SummaryWriter

FOLDER = "tensorboard"
COLOUR_CHANNELS = 3


class TensorBoardEvents:
    """Event files of one training.

    Args:
        out: Folder of the training.
        go_on: Whether the training or its evaluation continues; otherwise events of an earlier training are removed,
            because TensorBoard would draw both as one.
    """

    def __init__(self, out: Path, go_on: bool) -> None:
        folder = out / FOLDER
        if not go_on and folder.is_dir():
            shutil.rmtree(folder)
        self._writer = SummaryWriter(str(folder))
        assert isinstance(self._writer.file_writer, FileWriter)
        self._files: FileWriter = self._writer.file_writer

    def configuration(self, values: Mapping[str, Any]) -> None:
        """Log the configuration as a text."""
        self._writer.add_text("configuration", "\n".join(f"    {line}" for line in _lines(values)))

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """Log numbers as scalars."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def picture(self, name: str, file: Path) -> None:
        """Log a PNG or GIF file as it is; TensorBoard plays an animated GIF among its images."""
        with Image.open(file) as image:
            width, height = image.size
        shown = Summary.Image(
            height=height, width=width, colorspace=COLOUR_CHANNELS, encoded_image_string=file.read_bytes()
        )
        self._files.add_summary(Summary(value=[Summary.Value(tag=name, image=shown)]), 0)

    def close(self, succeeded: bool) -> None:
        """Write what is left."""
        self._writer.close()


def _lines(values: Mapping[str, Any]) -> list[str]:
    return json.dumps(values, indent=2).splitlines()
