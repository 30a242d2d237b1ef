"""The bytes of HDF5 chunks as HDF5's own filters would make them, but in any thread: shuffled, then deflated.

HDF5 compresses in one thread and with one effort. Most of what sealing costs is compression, and the pictures of a real
camera at 640 x 480 lose a third of their size by it at best, at 40 MB/s. So a large chunk is compressed only where a
sample of it says that it is worth it, and stored by the same format otherwise, which every HDF5 reader undoes without
being told. Either way the chunk carries the Adler-32 of its content. What is chosen depends on the content only, so
that equal episodes are equal bytes on any number of cores.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np

LEVEL = 1  # higher levels cost more time than they save bytes on rendered images
WORTH = 0.5
"""Compressed size of a sample, as a share of its size, up to which a large chunk is compressed."""
LARGE = 2**16
"""Bytes of a chunk from which a sample decides; smaller ones are always compressed."""
SAMPLES, SAMPLE_BYTES = 6, 2**12
"""Pieces of a chunk that are tried, evenly spread, and the size of each."""

BLOCK = 2**16 - 1
"""Bytes that a stored block has at most."""


@dataclass(frozen=True)
class Encoding:
    """How the chunks of one array are encoded.

    Attributes:
        dtype: Of the array.
        chunk: Shape of its chunks; whole rows.
    """

    dtype: np.dtype
    chunk: tuple[int, ...]

    @property
    def shuffled(self) -> bool:
        """Whether the bytes of an element are parted, as HDF5's shuffle filter does."""
        return self.dtype.itemsize > 1

    def encode(self, rows: np.ndarray) -> list[bytes]:
        """Encode consecutive chunks.

        Args:
            rows: Rows of the array, beginning with a chunk; the last chunk is filled up with zeros.

        Returns:
            The bytes of each chunk.
        """
        step = self.chunk[0]
        return [self._chunk(rows[start : start + step]) for start in range(0, len(rows), step)]

    def _chunk(self, rows: np.ndarray) -> bytes:
        if len(rows) < self.chunk[0]:
            rows = np.concatenate([rows, np.zeros((self.chunk[0] - len(rows), *rows.shape[1:]), rows.dtype)])
        content = np.ascontiguousarray(rows).reshape(-1).view(np.uint8)
        if self.shuffled:  # all first bytes of the elements, then all second bytes, and so on
            content = np.ascontiguousarray(content.reshape(-1, self.dtype.itemsize).T).reshape(-1)
        return self._compressed(content) if len(content) < LARGE or self._worth(content) else stored(content)

    def _worth(self, content: np.ndarray) -> bool:
        starts = np.linspace(0, len(content) - SAMPLE_BYTES, SAMPLES).astype(int)
        sample = np.concatenate([content[start : start + SAMPLE_BYTES] for start in starts])
        return len(self._compressed(sample)) <= WORTH * len(sample)

    def _compressed(self, content: np.ndarray) -> bytes:
        # Of depth images runs of one byte are nearly all that deflate finds, and finding only them takes half the time.
        strategy = zlib.Z_RLE if self.dtype.kind in "iu" and self.dtype.itemsize == 2 else zlib.Z_DEFAULT_STRATEGY
        packer = zlib.compressobj(LEVEL, zlib.DEFLATED, zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, strategy)
        return packer.compress(content.data) + packer.flush()


def stored(content: np.ndarray) -> bytes:
    """A zlib stream (RFC 1950) of stored blocks (RFC 1951, 3.2.4): zlib's own takes three times as long to copy.

    Args:
        content: Bytes, shape (K,), uint8.
    """
    pieces: list[bytes | memoryview] = [b"\x78\x01"]  # deflate with a window of 32 KiB, fastest
    for start in range(0, max(1, len(content)), BLOCK):
        piece = content[start : start + BLOCK]
        last = start + BLOCK >= len(content)
        pieces += [struct.pack("<BHH", last, len(piece), len(piece) ^ 0xFFFF), piece.data]
    return b"".join([*pieces, zlib.adler32(content.data).to_bytes(4, "big")])
