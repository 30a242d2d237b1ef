"""The form of a batch, and the names of its entries, for samples, cuts of one episode and transitions alike.

The key of a recorded value is the dataset path of its field, such as ``streams/wrench/wrench`` or ``actions/action``.
Beside the values of a group, which is a camera or a stream, stand ``GROUP/padding`` and ``GROUP/age``, and of a camera
that moves ``GROUP/image_axes``. The observation that follows in a transition has the same keys with the prefix `NEXT`.
The paper's inputs (image, wrench, proprioception), which networks take in image-aligned axes, have the short names
``image``, ``wrench`` and ``proprio``.
"""

import numpy as np

Batch = dict[str, np.ndarray]
"""Arrays by key; the first axis of each is that of the samples."""
NEXT = "next_"
"""Prefix of the entries of the observation s' of a transition."""


def padding_key(group: str) -> str:
    """Return the key of the mask that is true where a group, such as ``cameras/front``, had no frame or reading yet."""
    return f"{group}/padding"


def age_key(group: str) -> str:
    """Return the key of the time from the newest frame or reading of a group to the observation, [s]."""
    return f"{group}/age"


def axes_key(group: str) -> str:
    """Return the key of the matrices from base (x, y) to image (right, up) at each frame of a camera that moves."""
    return f"{group}/image_axes"


def transitions(both: Batch, count: int) -> Batch:
    """Return the observations s and s' of transitions as entries of one batch.

    Args:
        both: Observations s of all transitions, then the observations s' of all transitions, shape (2 B, ...) each.
        count: Number of transitions, B.
    """
    before = {key: values[:count] for key, values in both.items()}
    return before | {f"{NEXT}{key}": values[count:] for key, values in both.items()}
