"""Crops of the images of many episodes for whole batches; the images stay in their files or are kept in memory."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.sampling.ragged import starts
from svfl_data.storage.reader import StoredArray
from svfl_data.system.progress import progress


@dataclass(frozen=True, eq=False)
class Frames:
    """Images of one kind (colour or depth) of one camera in all episodes, joined end to end after one black image.

    Attributes:
        arrays: Stored images of each episode, shape (F, H, W) or (F, H, W, C) each, where only F may differ between
            episodes. Empty if the images are kept in memory.
        first: First row of each episode in the joined stream, shape (E,), int64. Row 0 is the black image.
        memory: The joined images, shape (1 + sum of F, H, W, ...). None if they are not kept in memory.
    """

    arrays: Sequence[StoredArray]
    first: np.ndarray
    memory: np.ndarray | None

    @classmethod
    def of(cls, arrays: Sequence[StoredArray], keep: bool) -> "Frames":
        """Join the images of all episodes, either by reference to the files or by reading them into memory.

        Args:
            arrays: Stored images of each episode, shape (F, H, W) or (F, H, W, C) each.
            keep: Whether to read all images now and keep them in memory. If false, `cut` reads them from the files.
        """
        first = starts([len(array) for array in arrays])
        if not keep:
            return cls(arrays, first, None)
        memory = np.zeros((1 + sum(len(array) for array in arrays), *arrays[0].shape[1:]), arrays[0].dtype)
        for array, start in zip(progress(arrays, "reading images"), first, strict=True):
            memory[start : start + len(array)] = array[:]
        return cls((), first, memory)

    @property
    def nbytes(self) -> int:
        """Size of the stored images of all episodes when read, [bytes]; 0 if the images are kept in `memory`."""
        return sum(int(np.prod(array.shape)) * array.dtype.itemsize for array in self.arrays)

    def cut(self, episodes: np.ndarray, rows: np.ndarray, corners: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """Cut the same rectangle out of each image of a sample.

        Args:
            episodes: Position of each sample's episode in `first`, shape (B,).
            rows: Rows of each sample's images in the joined stream, shape (B, K). Row 0 is the black image.
            corners: Upper left pixel (row, column) of each sample's rectangle, shape (B, 2), or of one rectangle for
                all samples, shape (1, 2).
            size: Height h and width w of the rectangle, [px].

        Returns:
            Pixels as recorded, shape (B, K, h, w) or (B, K, h, w, C).
        """
        shape, dtype = self._like()
        out = np.empty((*rows.shape, *size, *shape[2:]), dtype)
        (height, width), places = size, np.broadcast_to(corners, (len(rows), 2)).tolist()
        if self.memory is not None:
            for target, images, (top, left) in zip(out, rows.tolist(), places, strict=True):
                for number, image in enumerate(images):
                    target[number] = self.memory[image, top : top + height, left : left + width]
            return out
        for episode in np.unique(episodes).tolist():
            array, first = self.arrays[episode], int(self.first[episode])
            descriptor = array.extent.open()
            try:
                for sample in np.flatnonzero(episodes == episode).tolist():
                    top, left = places[sample]
                    for number, image in enumerate(rows[sample].tolist()):
                        if image == 0:
                            out[sample, number] = 0
                            continue
                        whole = array.placement.rows(array.extent, descriptor, image - first, image - first + 1)[0]
                        out[sample, number] = whole[top : top + height, left : left + width]
            finally:
                os.close(descriptor)
        return out

    def _like(self) -> tuple[tuple[int, ...], np.dtype]:
        """Return the shape and the data type of one image."""
        if self.memory is not None:
            return self.memory.shape[1:], self.memory.dtype
        return self.arrays[0].shape[1:], self.arrays[0].dtype


def corners(height: int, width: int, size: tuple[int, int], fraction: np.ndarray | None) -> np.ndarray:
    """Return the upper left pixels of rectangles inside an image.

    Args:
        height: Height of the image, [px].
        width: Width of the image, [px].
        size: Height and width of the rectangles, [px].
        fraction: Position (vertical, horizontal) of each rectangle within the room that the image leaves for it, from
            0 (top, left) to below 1 (bottom, right), shape (B, 2). None for one rectangle in the middle of the image.

    Returns:
        Upper left pixels (row, column), shape (B, 2), or (1, 2) if `fraction` is None, int64.
    """
    room = np.array([[height, width]]) - size
    return room // 2 if fraction is None else (fraction * (room + 1)).astype(np.int64)


def draws(seed: int, epoch: int, samples: np.ndarray) -> np.ndarray:
    """Draw two random numbers for each sample that depend only on the seed, the epoch and the sample.

    Numbers from a random generator would also depend on the worker process, the batch and the order of the samples.

    Args:
        seed: Seed of the random numbers, at least 0.
        epoch: Number of the epoch, at least 0.
        samples: Numbers of the samples, shape (B,).

    Returns:
        Random numbers in [0, 1), shape (B, 2), float64.

    Source: splitmix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014).
    """
    key = np.random.SeedSequence([seed, epoch]).generate_state(1, np.uint64)
    state = key + np.asarray(samples, np.uint64)[:, None] * np.uint64(2) + np.arange(2, dtype=np.uint64)
    state = (state + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state ^= state >> np.uint64(31)
    return (state >> np.uint64(11)).astype(np.float64) / 2.0**53
