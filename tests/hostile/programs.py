"""What can be run on a dataset: the three commands, Rerun's importer, and the library as a user's own program calls it.

The library's functions stand in `LIBRARY`; they end as a command does, so that one law holds for both.
"""

import sys
from pathlib import Path

import svfl_data.cli
import svfl_data.viewer.rerun_importer
from svfl_data.datasets.dataset import Dataset
from svfl_data.system.command_line import run


def samples(path):
    """Every sample as arrays."""
    from svfl_data.sampling.samples import Samples

    found = Samples(Dataset.open(path))
    for number in range(len(found)):
        found[number]


def torch_samples(path):
    """Every sample as tensors."""
    from svfl_data.sampling.samples import Samples
    from svfl_data.sampling.torch_samples import TorchSamples

    found = TorchSamples(Samples(Dataset.open(path)))
    found.__getitems__(list(range(len(found))))


def buffer(path):
    """A replay buffer with demonstrations."""
    from svfl_data.replay import ReplayBuffer

    ReplayBuffer.from_demos(Dataset.open(path), 6)


def buffer_of_inputs(path):
    """A replay buffer with everything that the episodes have, as recorded."""
    from svfl_data.replay import ReplayBuffer
    from svfl_data.schema.input_spec import InputSpec

    dataset = Dataset.open(path)
    first = dataset.episode(dataset.indices[0])
    ReplayBuffer.from_demos(dataset, 6, inputs=InputSpec.of(first.paths, first.declarations)).sample(2)


def load_buffer(path):
    """A replay buffer from its file."""
    from svfl_data.replay import ReplayBuffer

    ReplayBuffer.load(path).sample(2)


def words(path):
    """A dataset and its episodes as an interactive session shows them."""
    dataset = Dataset.open(path)
    print(repr(dataset))
    print(repr(dataset.episode(0)))


def load_statistics(path):
    """Stored statistics."""
    from svfl_data.sampling.split import load_split
    from svfl_data.sampling.statistics import load_statistics

    dataset = Dataset.open(path)
    load_statistics(dataset, load_split(dataset, "default"))


LIBRARY = {
    one.__name__: one for one in (samples, torch_samples, buffer, buffer_of_inputs, load_buffer, words, load_statistics)
}


def library():
    """``library FUNCTION PATH``."""
    function, path = sys.argv[1:]
    return run(lambda: LIBRARY[function](Path(path)), "library")


def collect():
    from collectors.cli import main

    return main()


def train():
    from svfl_models.cli import main

    return main()


PROGRAMS = {
    "svfl-data": svfl_data.cli.main,
    "svfl-collect": collect,
    "svfl-train": train,
    "rerun-importer-svfl": svfl_data.viewer.rerun_importer.main,
    "library": library,
}
