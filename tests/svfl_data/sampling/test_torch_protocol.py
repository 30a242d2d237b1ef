"""Samples are a PyTorch dataset: every ordinary way to load them works, and gives what the own loader gives."""

import itertools

import numpy as np
import pytest
import torch
from torch.utils.data import ConcatDataset, DataLoader, Subset, WeightedRandomSampler, random_split

from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import Samples
from svfl_data.sampling.torch_samples import TorchSamples
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    dataset = Dataset.create_or_resume(tmp_path_factory.mktemp("torch") / "d", "centering", 0, {})
    for index in range(3):
        write_episode(make_episode(index, steps=4), dataset.episode_path(index))
    return Samples(dataset, crop=8, crop_at="random", windows={"streams/wrench/wrench": 5}, labels=["labels/direction"])


@pytest.fixture(params=["torch", "plain"])
def data(samples, request):
    return TorchSamples(samples) if request.param == "torch" else samples


def same(batch, samples, chosen):
    expected = samples.batch(chosen)
    assert batch.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(np.asarray(batch[name]), values, err_msg=name)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_plain_loader_gives_what_the_own_loader_gives(data, samples, workers):
    own = TorchSamples(samples).loader(5, shuffle=False, num_workers=workers)
    plain = DataLoader(data, batch_size=5, num_workers=workers)
    for one, other in itertools.zip_longest(own, plain):
        assert one.keys() == other.keys()
        assert all(torch.equal(one[name], other[name]) and one[name].dtype == other[name].dtype for name in one)


def test_subsets_splits_and_sums(data, samples):
    chosen = [7, 2, 9, 0]
    (batch,) = DataLoader(Subset(data, chosen), batch_size=4)
    same(batch, samples, chosen)
    part, rest = random_split(data, [0.5, 0.5], torch.Generator().manual_seed(0))
    (batch,) = DataLoader(part, batch_size=len(part))
    same(batch, samples, list(part.indices))
    assert sorted([*part.indices, *rest.indices]) == list(range(12))
    last = list(DataLoader(ConcatDataset([data, data]), batch_size=8))[-1]
    same(last, samples, list(range(4, 12)))


def test_weights_single_samples_and_no_batches(data, samples):
    weights = [0.0] * 12
    weights[3] = 1.0
    (batch,) = DataLoader(data, batch_size=4, sampler=WeightedRandomSampler(weights, 4))
    same(batch, samples, [3] * 4)
    for row, batch in enumerate(DataLoader(data, batch_size=1)):
        same(batch, samples, [row])
    for row, one in enumerate(DataLoader(data, batch_size=None)):
        same({name: np.asarray(values)[None] for name, values in one.items()}, samples, [row])


def test_going_through_it_ends(data):
    assert len(list(data)) == len(data) == 12
