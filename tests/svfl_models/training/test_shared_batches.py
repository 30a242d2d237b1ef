"""Several processes that share every batch train as one process does, and end together."""

import os

import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_models.training.distributed.shared_batches import share
from tests.helpers.small_training import die, diverge, trained


@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_shares_are_all_rows_once_and_as_equal_as_they_can_be(processes):
    for rows in range(processes, 40):
        shares = [range(rows)[share(rows, rank, processes)] for rank in range(processes)]
        assert [row for one in shares for row in one] == list(range(rows))
        sizes = {len(one) for one in shares}
        assert max(sizes) - min(sizes) <= 1


def test_a_batch_of_too_few_rows_goes_to_all():
    assert [share(2, rank, 3) for rank in range(3)] == [slice(0, 2)] * 3


@pytest.mark.slow
@pytest.mark.parametrize("rows", [9, 11])
def test_two_processes_do_the_steps_of_one(rows, tmp_path):
    """Batches of four, and a last one of one row or three, which cannot be split evenly.

    In float64, and with steps that are proportional to the gradient, what is left of the other order of the sums is
    some units in the last place.
    """
    alone, alone_rows = trained(tmp_path / "1", 1, rows)
    shared, shared_rows = trained(tmp_path / "2", 2, rows)
    for one, other in zip(alone.parameters(), shared.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-13, atol=1e-13)
    for one, other in zip(alone_rows, shared_rows, strict=True):
        names = ("valid_loss", "train_loss") if rows % 4 != 1 else ("valid_loss",)  # that row counts once per process
        assert [one[name] for name in names] == pytest.approx([other[name] for name in names], rel=1e-6)
    assert [file.name for file in sorted((tmp_path / "2").iterdir())] == ["checkpoint.ckpt", "metrics.csv"]


@pytest.mark.slow
def test_the_environment_stays_as_it_was(tmp_path, monkeypatch):
    """A second training in this process, alone or shared, finds nothing of the first."""
    for name in ("MASTER_ADDR", "MASTER_PORT", "LOCAL_RANK", "WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    first = [trained(tmp_path / "a", processes, epochs=1)[1][0]["train_loss"] for processes in (2, 1)]
    again = [trained(tmp_path / "b", processes, epochs=1)[1][0]["train_loss"] for processes in (2, 1)]
    assert first == again
    assert not {"MASTER_ADDR", "MASTER_PORT", "LOCAL_RANK", "WORLD_SIZE"} & os.environ.keys()
    assert not torch.distributed.is_initialized()


@pytest.mark.slow
@pytest.mark.parametrize(("act", "words"), [(diverge, "process 1 became nan"), (die, "died")])
def test_an_end_of_another_process_is_one_line(act, words, tmp_path):
    with pytest.raises(TrainingError, match=words):
        trained(tmp_path, 2, act=act)
