"""What all recordings of a dataset have in common, so that a changed camera or rate never slips in unseen.

The first recording writes its cameras, nominal rates and row shapes into ``dataset.json`` under ``recording``; every
later one, in whichever process, is compared with it before it stores a byte.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from svfl_data.atomically import write_atomically
from svfl_data.claims import inflight, locked
from svfl_data.dataset import INFO, Dataset
from svfl_data.errors import DatasetError

KEY = "recording"


def agree(folder: Path, facts: Mapping[str, Any]) -> None:
    """Compare facts about a recording with those of the dataset's earlier ones, and remember what is new.

    Args:
        folder: The dataset.
        facts: Name to JSON value, e.g. ``{"cameras/front/color": ["uint8", [76, 76, 3]]}``.

    Raises:
        DatasetError: If an earlier recording says otherwise.
        FormatError: If the folder is not a dataset.
        StorageError: If the disk refuses.
    """
    with locked(inflight(folder)):
        info = Dataset.open(folder).info
        known = info.get(KEY, {})
        for name, value in facts.items():
            if known.get(name, value) != value:
                raise DatasetError(
                    f"{folder}: {name} is {json.dumps(value)}, but the dataset was recorded with "
                    f"{json.dumps(known[name])}; record into a new dataset, or say that it varies between episodes"
                )
        if not facts.keys() <= known.keys():
            info[KEY] = {**known, **facts}
            write_atomically(folder / INFO, (json.dumps(info, indent=2, sort_keys=True) + "\n").encode())
