"""All kinds: importing a module registers what it makes."""

from tests.hostile import (  # noqa: F401
    buffers,
    checkpoints,
    declarations,
    folders,
    hdf5_elsewhere,
    hdf5_form,
    hdf5_size,
    journals,
    json_attributes,
    models,
    policies,
    replayed,
    shards,
    side_files,
    urdfs,
    values,
)
from tests.hostile.kind import KINDS as KINDS
