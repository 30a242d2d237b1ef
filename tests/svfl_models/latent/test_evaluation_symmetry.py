import numpy as np
import pytest
import torch

from svfl_models.latent.evaluation.frames import Encoded
from svfl_models.latent.evaluation.symmetry import CYCLIC, MOVES, symmetry
from svfl_models.symmetry.actions import act_on_batch
from svfl_models.symmetry.groups import GROUPS
from tests.helpers.drawn_frames import drawn_frames


def forces(batch):
    return batch["wrench"].mean(dim=1)[:, :3]


def said(feature, contact, alignment=None):
    return Encoded(feature, contact, contact if alignment is None else alignment)


def measured(encode):
    return symmetry(encode, drawn_frames(160), drawn_frames(48, seed=1))


def test_the_moves_are_those_of_d4_without_the_identity():
    assert len(MOVES) == 7
    assert len({matrix.tobytes() for matrix in MOVES.values()}) == 7
    rotations = list(MOVES.values())[:CYCLIC]
    assert all(np.linalg.det(matrix) > 0 for matrix in rotations)
    assert {matrix.tobytes() for matrix in rotations} <= {matrix.tobytes() for matrix in GROUPS["C4"].elements}


def test_what_transforms_linearly_is_symmetric_and_moves():
    found = measured(lambda batch: said(forces(batch), torch.zeros(len(batch["wrench"]))))
    for one in found.elements.values():
        assert one.not_linear == pytest.approx(0, abs=1e-6)
        assert one.change > 0.1
        assert one.contact == one.alignment == 0
    assert found.groups["C4"].not_linear == pytest.approx(0, abs=1e-6)


def test_what_is_invariant_does_not_change():
    def encode(batch):
        force = forces(batch)
        size = torch.stack([force[:, :2].norm(dim=1), force[:, 2]], dim=1)
        return said(size, size[:, 0].sigmoid())

    found = measured(encode)
    for one in found.elements.values():
        assert one.not_linear == pytest.approx(0, abs=1e-6)
        assert one.change == pytest.approx(0, abs=1e-5)
        assert one.contact == pytest.approx(0, abs=1e-5)


def test_a_liar_is_caught():
    weights = torch.randn(6, 5, generator=torch.Generator().manual_seed(0)) * 40

    def encode(batch):
        wrench = batch["wrench"].mean(dim=1)
        return said((wrench @ weights).sin(), (wrench[:, 0] * 20).sigmoid())  # likes one direction

    found = measured(encode)
    assert found.groups["D4"].not_linear > 0.3
    assert found.groups["D4"].change > 0.3
    assert found.groups["D4"].contact > 0.05


def test_only_mirrors_are_told_from_rotations_by_what_is_chiral():
    def encode(batch):
        twist = batch["wrench"].mean(dim=1)[:, 5:]  # a pseudoscalar
        return said(twist, (20 * twist[:, 0]).sigmoid())

    found = measured(encode)
    assert found.groups["C4"].contact == pytest.approx(0, abs=1e-6)
    assert found.elements["flip"].contact > 0.01
    assert found.elements["flip"].not_linear == pytest.approx(0, abs=1e-6)


def test_a_constant_feature_has_nothing_to_map():
    found = measured(lambda batch: said(torch.ones(len(batch["wrench"]), 2), torch.zeros(len(batch["wrench"]))))
    assert found.groups["D4"].not_linear is None
    assert found.groups["D4"].change == 0


def test_the_whole_observation_moves():
    batch = drawn_frames(2).observations
    for matrix in MOVES.values():
        moved = act_on_batch(matrix, batch)
        assert all(not torch.equal(moved[name], batch[name]) for name in ("image", "wrench", "proprio"))
