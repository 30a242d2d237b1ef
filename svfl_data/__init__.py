"""The episode file: what an episode is, and how to write, read and look at it."""

from svfl_data.system.extras import explain_missing

explain_missing()
