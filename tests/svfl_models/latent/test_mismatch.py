import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_models.latent.mismatch import allowed_pairs, mismatched


def drawn(sequences, frames, episodes, seed):
    rng = torch.Generator().manual_seed(seed)
    episode = torch.randint(0, episodes, (sequences,), generator=rng)
    step = torch.randint(0, 12, (sequences, 1), generator=rng) + torch.arange(frames)
    return episode, step, torch.rand(sequences, frames, generator=rng) > 0.6


@given(st.integers(1, 9), st.integers(1, 4), st.integers(1, 4), st.integers(1, 6), st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_every_pair_is_wrong_and_can_be_seen_to_be(sequences, frames, episodes, gap, seed):
    episode, step, touching = drawn(sequences, frames, episodes, seed)
    pairs = mismatched(episode, step, touching, gap, frames)
    owner, flat = torch.arange(sequences).repeat_interleave(frames), step.flatten()
    for image, wrench in zip(pairs.image.tolist(), pairs.wrench.tolist(), strict=True):
        assert image != wrench
        same = episode[owner[image]] == episode[owner[wrench]]
        assert not same or abs(int(flat[image] - flat[wrench])) >= gap
        assert touching.flatten()[image] or touching.flatten()[wrench]
    for side in (pairs.image, pairs.wrench):  # a derangement: nobody gives or takes twice
        assert len(side.unique()) == len(side)


def test_everyone_has_a_partner_where_that_is_possible():
    episode, step = torch.arange(8), torch.arange(3).expand(8, 3)
    pairs = mismatched(episode, step, torch.ones(8, 3, dtype=torch.bool), 3, 3)
    assert len(pairs.image) == 24
    half = torch.arange(8)[:, None].expand(8, 3) < 4
    assert len(mismatched(episode, step, half, 3, 3).image) == 24  # a touched one for each free one, and the reverse


def test_only_as_many_frames_of_a_sequence_are_drawn_as_asked():
    pairs = mismatched(torch.arange(6), torch.arange(5).expand(6, 5), torch.ones(6, 5, dtype=torch.bool), 5, 2)
    assert (torch.bincount(pairs.image // 5, minlength=6) == 2).all()


@pytest.mark.parametrize("sequences", [1, 2, 40])
def test_where_there_is_no_pair_there_is_no_search(sequences):
    free = torch.zeros(sequences, 3, dtype=torch.bool)
    assert len(mismatched(torch.arange(sequences), torch.arange(3).expand(sequences, 3), free, 3, 3).image) == 0
    alike = torch.zeros(sequences, dtype=torch.int64)  # all of one moment of one episode
    assert len(mismatched(alike, torch.zeros(sequences, 3, dtype=torch.int64), ~free, 1, 3).image) == 0


def test_seeds_decide():
    asked = (*drawn(6, 3, 6, 0), 3, 3)
    torch.manual_seed(1)
    first = mismatched(*asked)
    torch.manual_seed(1)
    assert torch.equal(mismatched(*asked).wrench, first.wrench)
    assert any(not torch.equal(mismatched(*asked).wrench, first.wrench) for _ in range(3))


def test_a_frame_never_keeps_its_own_wrench_however_small_the_gap():
    one = torch.zeros(3, dtype=torch.int64)
    assert not allowed_pairs(one, torch.arange(3), torch.ones(3, dtype=torch.bool), 0).diagonal().any()
