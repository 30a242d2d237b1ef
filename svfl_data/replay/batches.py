"""Functions that cut the observations of a batch out of episodes, and rotate or reflect them."""

from collections.abc import Sequence

import numpy as np

from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.specs.layout import Array, Layout, Picture
from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.replay.symmetry_augmentation import Between, SymmetryAugmentation
from svfl_data.sampling.batch import Batch, age_key, padding_key, transitions
from svfl_data.sampling.frames import corners


class Cuts:
    """Cuts of observations out of stored episodes.

    Args:
        layout: Layout of the episodes.
        config: Settings of the replay buffer, of which `crop`, `rotate` and `group_order` are used.

    Attributes:
        turns: Number of elements of D_N that are drawn from; 1 if nothing is rotated.
    """

    def __init__(self, layout: Layout, config: ReplayConfig) -> None:
        self._layout, self._crop, self._rotate = layout, config.crop, config.rotate
        order = config.group_order
        self._augmentation = SymmetryAugmentation(order, None if layout.axes is None else np.array(layout.axes))
        self.turns = len(self._augmentation) if config.rotate else 1
        self._augmentations = [
            SymmetryAugmentation(order, np.array(one.axes)) if one.axes else SymmetryAugmentation(1)
            for one in layout.pictures
        ]
        images = {plane.name for picture in layout.pictures for plane in picture.planes}
        self._windows = [
            (stream, [one.name for one in stream.arrays if one.name not in images]) for stream in layout.streams
        ]

    def transitions(
        self,
        episodes: Sequence[StoredEpisode],
        steps: Sequence[int],
        later: Sequence[int],
        fraction: np.ndarray,
        elements: np.ndarray,
    ) -> Batch:
        """Return observations s, actions and observations s'.

        Args:
            episodes: Episode of each transition, B in all.
            steps: Number of the observation s of each transition.
            later: Number of its observation s'.
            fraction: Place of the crops of each transition, shape (B, 2), as for `svfl_data.sampling.frames.corners`.
            elements: Number of the element that is applied to each transition, shape (B,), below `turns`.
        """
        pairs, at = [*episodes, *episodes], [*steps, *later]
        sizes = [(one.size, one.cut_size(self._crop)) for one in self._layout.pictures]
        places = [corners(*size, cut, fraction) for size, cut in sizes]
        both, name = self.numbers(pairs, at), self._layout.action.name
        acted = {name: np.stack([one.arrays[name][step] for one, step in zip(episodes, steps, strict=True)])}
        if self._rotate:
            both, acted = self.rotated(both, np.tile(elements, 2)), self.rotated(acted, elements)
        both |= self.images(pairs, at, places, elements)
        constants = {key: np.full(len(steps), value) for key, value in self._layout.constants.items()}
        return transitions(both, len(steps)) | acted | constants

    def numbers(self, episodes: Sequence[StoredEpisode], steps: Sequence[int]) -> Batch:
        """Return windows, vectors, and padding and age of streams.

        Args:
            episodes: Episode of each observation, B in all.
            steps: Number of each observation in its episode, B in all.

        Returns:
            Windows (B, T, ...), which of cameras that move are their image axes, and vectors (B, ...) by the names of
            their arrays; for streams that keep them also the padding (B, T) bool and the age (B,) float32.
        """
        out: Batch = {}
        places = list(zip(episodes, steps, strict=True))
        for stream, names in self._windows:
            if names:
                ends = [int(episode.arrays[stream.end][step]) for episode, step in places]
            for name in names:
                windows = zip(episodes, ends, strict=True)
                out[name] = np.stack([episode.window(name, end, stream.length) for episode, end in windows])
            if stream.padded:
                padded = np.array([episode.arrays[stream.padded][step] for episode, step in places])
                out[padding_key(stream.group)] = np.arange(stream.length) < padded[:, None]
            if stream.age:
                out[age_key(stream.group)] = np.array([episode.arrays[stream.age][step] for episode, step in places])
        for one in self._layout.vectors:
            out[one.name] = np.stack([episode.arrays[one.name][step] for episode, step in places])
        return out

    def rotated(self, batch: Batch, elements: np.ndarray) -> Batch:
        """Rotate or reflect the numbers of each sample; what is invariant stays.

        Args:
            batch: Values by the names of their arrays, each of shape (B, ..., C).
            elements: Number of the element that is applied to each sample, shape (B,).

        Returns:
            The transformed values by the same keys, according to their parts (`svfl_data.symmetry`).
        """
        arrays = [one for stream in self._layout.streams for one in stream.arrays]
        parts = {one.name: one for one in (*arrays, *self._layout.vectors, self._layout.action) if one.parts}
        return {
            name: self._moved(parts[name], values, elements) if name in parts else values
            for name, values in batch.items()
        }

    def images(
        self,
        episodes: Sequence[StoredEpisode],
        steps: Sequence[int],
        corners: Sequence[np.ndarray],
        elements: np.ndarray,
    ) -> Batch:
        """Cut, and rotate or reflect, the images of observations; all images of one transition are treated alike.

        Args:
            episodes: Episode of each observation: of the observations s of B transitions, then of their s'.
            steps: Number of each observation in its episode.
            corners: For each picture of the layout the upper left pixel (row, column) of each transition's crop, shape
                (B, 2).
            elements: Number of the element that is applied to each transition, shape (B,).

        Returns:
            Pictures by key, latest image last: those of the last K rows at or before the observation. Where the episode
            has fewer rows so far, its first image is repeated.
        """
        out: Batch = {}
        for picture, augmentation, places in zip(self._layout.pictures, self._augmentations, corners, strict=True):
            size, stream, planes = picture.cut_size(self._crop), picture.stream, [one.plain for one in picture.planes]
            ends = [
                int(one.arrays[stream.end][step]) if stream.end else step + 1
                for one, step in zip(episodes, steps, strict=True)
            ]
            marks = places.tolist(), elements.tolist() if picture.axes else [0] * len(elements)
            cutters = [augmentation.cutter(corner, element, size) for corner, element in zip(*marks, strict=True)] * 2
            stacks = self._empty(picture, len(episodes), size)
            for stack, episode, end, cut in zip(stacks, episodes, ends, cutters, strict=True):
                if not end:
                    stack[...] = 0  # no image yet
                    continue
                for image, row in zip(stack, range(end - stream.length, end), strict=True):
                    row = max(0, row)
                    for name, where, smooth, last, scale, number in planes:
                        target, pixels = image[where], episode.arrays[name][row]
                        if last and isinstance(cut, Between):
                            target, pixels = target.transpose(2, 0, 1), pixels.transpose(2, 0, 1)
                        elif last:
                            target, pixels = _whole_pixels(target), _whole_pixels(pixels)
                        pixels = cut(pixels, smooth)
                        if scale:
                            target[...] = pixels
                            scale(target, number, target)  # at once, while the pixels are in the cache
                        else:
                            target[...] = pixels if pixels.dtype == target.dtype else np.rint(pixels)
            out[picture.key] = stacks[:, 0] if picture.flat else stacks
        return out

    def _empty(self, picture: Picture, count: int, size: tuple[int, int]) -> np.ndarray:
        sides = iter(size)
        shape = [next(sides) if side < 0 else side for side in picture.shape]
        return np.empty((count, picture.stream.length, *shape), picture.dtype)

    def _moved(self, array: Array, values: np.ndarray, elements: np.ndarray) -> np.ndarray:
        if not array.offset:
            return self._augmentation.numbers(values, array.parts, elements)
        centred = self._augmentation.numbers(values - np.array(array.offset), array.parts, elements)
        return (centred + np.array(array.offset)).astype(values.dtype)


def _whole_pixels(image: np.ndarray) -> np.ndarray:
    """Return an image (H, W, C) as (H, W), whose pixels are moved as one item: twice as fast as channel by channel."""
    return image.view(f"V{image.strides[-2]}")[..., 0]
