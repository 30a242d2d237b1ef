"""Checkpoints of a training are written seldom, but none is lost when the training ends."""

from collections import OrderedDict

import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_models.training import checkpoint_plugin
from svfl_models.training.checkpoint_io import read
from svfl_models.training.checkpoint_plugin import WholeCheckpoints


def test_a_checkpoint_soon_after_another_is_written_at_the_end_as_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint_plugin, "SELDOM_S", float("inf"))
    file, plugin, weight = tmp_path / "checkpoint.ckpt", WholeCheckpoints(), torch.zeros(2)
    content = {"state_dict": OrderedDict(a=weight), "rows": [{"epoch": 0}], "none": None}
    plugin.save_checkpoint(content, file)
    for epoch in (1, 2):
        weight += 1
        content["rows"].append({"epoch": epoch})
        plugin.save_checkpoint(content, file)
    weight += 1
    content["rows"].append({"epoch": 3})
    assert read(file)["state_dict"]["a"].tolist() == [0, 0]
    plugin.finish()
    kept = read(file)
    assert kept["state_dict"]["a"].tolist() == [2, 2]
    assert kept["rows"] == [{"epoch": epoch} for epoch in range(3)]
    file.unlink()
    plugin.finish()
    assert not file.exists()  # it was written once


def test_what_pytorch_keeps_beside_a_state_dict_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint_plugin, "SELDOM_S", float("inf"))
    plugin, state = WholeCheckpoints(), torch.nn.BatchNorm1d(2).state_dict()
    for _ in range(2):
        plugin.save_checkpoint({"state_dict": state}, tmp_path / "x.ckpt")
    plugin.finish()
    assert read(tmp_path / "x.ckpt")["state_dict"]._metadata == state._metadata


def test_only_the_resumed_checkpoint_is_read(tmp_path):
    with pytest.raises(TrainingError, match=r"x\.ckpt exists"):
        WholeCheckpoints().load_checkpoint(tmp_path / "x.ckpt")
