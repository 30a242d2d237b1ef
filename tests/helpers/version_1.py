"""A dataset of episode format 1.0, and what is in it.

``tests/data/version_1.tar.xz`` was written by the code of commit e5e85af, the last one that wrote 1.0: `episode` with
its own `Episode`, ``svfl-data split``, ``stats`` and ``pack``, then an array that no reader of 1.0 knew, put into
episode 1 with h5py and sealed again.

    episode_000000.hdf5, episode_000001.hdf5, shard_000000.zip (episodes 2 and 3), failures/ (episode 4),
    splits/default.json with statistics, dataset.json (varies: workspace), index.jsonl
"""

import dataclasses
import os
import tarfile
from pathlib import Path

import numpy as np

from svfl_data.schema.episode import Meta
from tests.helpers.builders import make_episode

ARCHIVE = Path(__file__).parents[1] / "data" / "version_1.tar.xz"
CONFIGS = (
    {"size": 4},
    {"max_move": 0.1, "max_turn": 0.5},
    {"world": {"max_move": 0.05, "max_turn": 0.25}, "size": 4},
    {"max_move": 0.025, "max_turn": np.pi / 16},
    {"size": 4},
)
"""Of the episodes, by index: without bounds, with some, those of a simulated world, and those of the paper."""
UNKNOWN = "streams/later/value"
"""The array of episode 1 that no reader of 1.0 knew."""
SEALS = {
    0: "dbfd38e4e3f1a76c8725768d441c94e4654a3c2f7dad23209a5e797f6328d932",
    1: "c671c05d72accbe98d5cd1d60399f5ad9fb94ca2c13c8395f42bbbe606d8deae",
    2: "439488febc4dff5075be4cc973fe9d29ed63ad88834baf4139a23ae7f34fd96b",
    3: "0b23c3a27b051329bb1e7a5c07e9b31d77c122a033bfb24d870572c2466f8e09",
    4: "1cbf97ab6ec6227415eba53c53685a810e84ba251cc8811ca7058cb8a5a35588",
}
"""What the old code gave as `EpisodeReader.seal`."""


def version_1(folder: Path, indexed: bool = False) -> Path:
    """Lay the dataset out in a folder.

    Args:
        folder: Folder that is made.
        indexed: Whether the lines of its index count, as they do where the dataset was made.
    """
    folder.mkdir()
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(folder, filter="data")
    for line in (folder / "index.jsonl").read_text().splitlines() if indexed else ():
        time_ns = int(line.partition('"mtime_ns":')[2].partition(",")[0])
        name = line.partition('"name":"')[2].partition('"')[0].partition("/")[0]
        os.utime(folder / name, ns=(time_ns, time_ns))
    return folder


def episode(index: int) -> tuple[Meta, dict[str, np.ndarray]]:
    """Metadata and arrays of an episode, as they were given to the old code."""
    made = make_episode(index, steps=2, size=4)
    extra = {
        "extra/nan": np.array([np.nan, 1.0, np.inf]),
        "extra/text": np.array([b"one", b"three"]),
        "extra/deep/flag": np.array(True),
        "extra/none": np.zeros((0, 2), np.int16),
        "extra/complex": np.array([1j, 2]),
    }
    arrays = made.arrays | (extra if index in (0, 2) else {})
    if index == 3:
        lacks = ("cameras/", "labels/", "actions/expert")
        arrays = {path: array for path, array in arrays.items() if not path.startswith(lacks)}
    meta = dataclasses.replace(
        made.meta,
        config=CONFIGS[index],
        success=index != 4,
        annotations=[{"name": "slip", "start_ns": 10, "end_ns": 20, "by": {"tool": "hand"}}],
        transforms=[{"name": "tare", "offset": [0.0] * 6}, {"name": "low_pass", "cutoff_hz": 20.0}],
        history=[{"tool": "repair", "salvaged": True, "rows": {"a": index}}],
        software={"svfl": "0", "h5py": "3.12"},
    )
    return meta, arrays
