"""Finding the arrays of a damaged episode file that cannot be read any more.

The seal shows that a file is damaged, but not where. The HDF5 library can tell more. As for every file, it is asked in
a separate process (`svfl_data.storage.examination`).
"""

import os
from pathlib import Path

from svfl_data.errors import SvflError
from svfl_data.schema.validity import OBSERVED
from svfl_data.storage.examination import Unanswered, ask
from svfl_data.storage.seal import SEAL_MARK, SEAL_SIZE
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import open_regular


def damaged_arrays(path: Path) -> list[str]:
    """Ask HDF5 which arrays of a file it cannot read.

    Args:
        path: Path of an episode file that does not match its seal, or has no seal.

    Returns:
        Dataset paths of the arrays that cannot be read or are gone, as far as HDF5 gets. The list is empty if the
        damage is elsewhere (in metadata), if the file cannot be opened, or if the damage is so bad that HDF5 does not
        return.
    """
    expected = [OBSERVED]
    try:
        descriptor = open_regular(path)
    except (OSError, SvflError):
        return []
    try:
        size = os.fstat(descriptor).st_size
        sealed = os.pread(descriptor, SEAL_SIZE, max(0, size - SEAL_SIZE)).startswith(SEAL_MARK)
        question = {"offset": 0, "size": size - SEAL_SIZE if sealed else size, "expected": expected}
        return [printable(line) for line in ask(descriptor, question).decode(errors="replace").splitlines()]
    except (OSError, Unanswered):
        return []
    finally:
        os.close(descriptor)
