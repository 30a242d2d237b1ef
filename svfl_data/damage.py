"""Which arrays of a damaged episode file cannot be read any more.

The seal says that a file is damaged, not where. HDF5 knows more, but given damaged metadata it may crash or never
return; so it is asked in a process of its own, with a time limit.
"""

import io
import subprocess
import sys
from pathlib import Path

import h5py

from svfl_data.fields import FIELDS
from svfl_data.seal import SEAL_MARK, SEAL_SIZE

PATIENCE_S = 10.0


def damaged_arrays(path: Path) -> list[str]:
    """Ask HDF5 which arrays of a file it cannot read.

    Args:
        path: An episode file that does not match its seal.

    Returns:
        Dataset paths of arrays that cannot be read or that are gone, as far as HDF5 gets; empty if the damage is
        elsewhere (in metadata), or so bad that HDF5 does not return.
    """
    command = [sys.executable, "-m", "svfl_data.damage", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    except subprocess.TimeoutExpired:
        return []
    return done.stdout.split() if done.returncode == 0 else []


def _print_damaged_arrays(path: Path) -> None:
    content = path.read_bytes()
    if content[-SEAL_SIZE:].startswith(SEAL_MARK):
        content = content[:-SEAL_SIZE]
    expected = [field.path for field in FIELDS if not field.optional and not field.path.startswith("cameras/")]
    with h5py.File(io.BytesIO(content), "r") as file:
        found: list[str] = []
        file.visit(found.append)
        gone = [name for name in expected if name not in found]
        if gone == expected:
            return  # nothing of ours: a file of other software
        print(*gone, *(name for name in found if not _reads(file, name)), sep="\n")


def _reads(file: h5py.File, name: str) -> bool:
    try:
        item = file[name]
        if isinstance(item, h5py.Dataset):
            item[()]
    except Exception:  # damaged metadata makes h5py raise nearly anything
        return False
    return True


if __name__ == "__main__":
    _print_damaged_arrays(Path(sys.argv[1]))
