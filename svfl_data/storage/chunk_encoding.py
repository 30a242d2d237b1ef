"""Encoding of HDF5 chunks in any thread: the bytes are shuffled, then deflated, as HDF5's own filters do it.

HDF5 compresses in one thread and with one level of effort. Compression takes most of the time of sealing, and it saves
at most a third of the size of real camera images of 640 x 480 pixels, at 40 MB/s. So a large chunk is compressed only
if a sample of its bytes shrinks enough. Otherwise it is stored uncompressed in the same zlib format, which every HDF5
reader decodes without further information. In both cases the chunk carries the Adler-32 of its content. The choice
depends on the content only, so equal episodes give equal bytes on any number of cores.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np

LEVEL = 1  # higher levels cost more time than they save bytes on rendered images
WORTH = 0.5
"""Largest ratio of compressed to original size of a sample at which a large chunk is compressed."""
LARGE = 2**16
"""Size of a chunk from which a sample decides whether to compress it, [bytes]. Smaller chunks are always compressed."""
SAMPLES, SAMPLE_BYTES = 6, 2**12
"""Number of evenly spread pieces of a chunk that make up its sample, and the size of each piece, [bytes]."""

BLOCK = 2**16 - 1
"""Largest size of a stored block of a deflate stream, [bytes]."""


@dataclass(frozen=True)
class Encoding:
    """Encoding of the chunks of one array.

    Attributes:
        dtype: NumPy dtype of the array.
        chunk: Shape of one chunk of the array. A chunk consists of whole rows.
    """

    dtype: np.dtype
    chunk: tuple[int, ...]

    @property
    def shuffled(self) -> bool:
        """Whether the bytes of the elements are separated by their position, as HDF5's shuffle filter does."""
        return self.dtype.itemsize > 1

    def encode(self, rows: np.ndarray) -> list[bytes]:
        """Encode consecutive chunks.

        Args:
            rows: Rows of the array. The first row must be the first of a chunk. The last chunk is filled up with
                zeros.

        Returns:
            Encoded bytes of each chunk, in order.
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
        # In depth images, nearly all that deflate finds are runs of one byte. Finding only those takes half the time.
        strategy = zlib.Z_RLE if self.dtype.kind in "iu" and self.dtype.itemsize == 2 else zlib.Z_DEFAULT_STRATEGY
        packer = zlib.compressobj(LEVEL, zlib.DEFLATED, zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, strategy)
        return packer.compress(content.data) + packer.flush()


def stored(content: np.ndarray) -> bytes:
    """Return a zlib stream (RFC 1950) that holds its content in stored blocks (RFC 1951, 3.2.4), not compressed.

    The zlib library itself takes three times as long for such a copy.

    Args:
        content: Bytes to store, shape (K,), uint8.
    """
    pieces: list[bytes | memoryview] = [b"\x78\x01"]  # deflate with a window of 32 KiB, fastest
    for start in range(0, max(1, len(content)), BLOCK):
        piece = content[start : start + BLOCK]
        last = start + BLOCK >= len(content)
        pieces += [struct.pack("<BHH", last, len(piece), len(piece) ^ 0xFFFF), piece.data]
    return b"".join([*pieces, zlib.adler32(content.data).to_bytes(4, "big")])
