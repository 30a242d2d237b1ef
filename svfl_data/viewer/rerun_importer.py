"""``rerun-importer-svfl``: the program with which Rerun opens an episode file.

Rerun calls every program ``rerun-importer-*`` on the search path for every file that it opens, with the name of the
file and the prefix of its entities, and reads a recording from standard output. A file that is not an episode is left
to other importers without delay: no large library is imported before the last bytes of the file have been checked.
"""

import argparse
import os
import sys
from pathlib import Path

FOREIGN = 66
"""Exit code for a file that is not an episode (``rerun.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE``)."""
SUFFIXES = (".hdf5", ".h5")
SEAL_SIZE, SEAL_MARK = 78, b"\nsvfl-sha256:"  # copied from svfl_data.storage.seal to avoid its import; a test compares


def main() -> int:
    """Write the recording of an episode file to standard output, and return the exit code of the program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("file", type=Path, help="file to open")
    add("--application-id", metavar="ID", help="application of the recording (default: that of svfl-data view)")
    add("--recording-id", metavar="ID", help="id of the recording (default: a new one)")
    add("--entity-path-prefix", default="", metavar="PREFIX", help="prefix of all entity paths (default: none)")
    arguments, _ = parser.parse_known_args()
    if not is_ours(arguments.file):
        return FOREIGN
    from svfl_data.system.command_line import run

    asked = (arguments.file, arguments.application_id, arguments.recording_id, arguments.entity_path_prefix)
    return run(lambda: _write(*asked), "rerun-importer-svfl")


def is_ours(file: Path) -> bool:
    """Return whether a file is a sealed episode, which may be damaged.

    Args:
        file: Any file.
    """
    if file.suffix not in SUFFIXES or not file.is_file() or file.stat().st_size < SEAL_SIZE:
        return False
    with file.open("rb") as opened:
        opened.seek(-SEAL_SIZE, os.SEEK_END)
        return opened.read().startswith(SEAL_MARK)


def _write(file: Path, application: str | None, recording_id: str | None, prefix: str) -> None:
    import rerun as rr

    from svfl_data.storage.reader import EpisodeReader
    from svfl_data.viewer import show
    from svfl_data.viewer.entities import names
    from svfl_data.viewer.entities.episode_source import EpisodeSource

    recording = rr.RecordingStream(application or names.APPLICATION, recording_id=recording_id)
    recording.stdout()
    root = prefix.strip("/")
    shown = EpisodeSource.of(EpisodeReader.of_file(file), f"{root}/" if root else "")
    show.content([(shown, None)])(recording)
    recording.flush()
    recording.disconnect()


if __name__ == "__main__":
    sys.exit(main())
