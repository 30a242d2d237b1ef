"""The sealed episode file: how one is written, examined, judged and read."""
