import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_models.latent.evaluation.contact import detection
from svfl_models.latent.evaluation.following import gripper_error
from svfl_models.latent.evaluation.probing.probes import Probe, Target, readings
from svfl_models.latent.evaluation.probing.ridge import fit_ridge
from svfl_models.latent.evaluation.reconstruction import fidelity, mean_picture
from svfl_models.latent.evaluation.scores import auroc, f1, psnr, r_squared
from tests.helpers.drawn_frames import drawn_frames


def test_auroc_of_a_perfect_a_reversed_and_a_constant_score():
    truth = np.array([False, True, True, False, True])
    assert auroc(truth.astype(float), truth) == 1
    assert auroc(-truth.astype(float), truth) == 0
    assert auroc(np.ones(5), truth) == 0.5
    assert auroc(np.arange(5), np.ones(5, bool)) is None


def test_auroc_of_a_random_score_is_one_half():
    rng = np.random.default_rng(0)
    assert auroc(rng.normal(size=20_000), rng.random(20_000) < 0.3) == pytest.approx(0.5, abs=0.02)


@given(st.lists(st.tuples(st.integers(-8, 8), st.booleans()), min_size=2, max_size=40))
@settings(max_examples=60, deadline=None)
def test_auroc_is_the_share_of_pairs_in_order_and_does_not_see_monotone_maps(answers):
    score, truth = np.array([one for one, _ in answers], float), np.array([one for _, one in answers])
    found = auroc(score, truth)
    if truth.all() or not truth.any():
        assert found is None
        return
    difference = score[truth][:, None] - score[~truth]
    assert found == pytest.approx(np.mean((difference > 0) + 0.5 * (difference == 0)))
    assert found == auroc(np.exp(score / 3), truth) == auroc(score**3, truth)
    assert found == pytest.approx(1 - auroc(score, ~truth))


def test_f1_by_hand():
    truth = np.array([True, True, False, False, True])
    said = np.array([True, False, True, False, False])
    assert f1(said, truth) == pytest.approx(2 * (1 / 2) * (1 / 3) / (1 / 2 + 1 / 3))
    assert f1(np.zeros(3, bool), np.zeros(3, bool)) is None
    found = detection(torch.tensor([0.9, 0.2, 0.6, 0.1, 0.4]), torch.tensor(truth))
    assert found.f1 == f1(said, truth)
    assert found.base_rate == pytest.approx(0.6)
    assert found.always_f1 == pytest.approx(2 * 0.6 / 1.6)


def test_psnr_by_hand():
    original = np.full((2, 3, 4, 4), 0.5)
    picture = original.copy()
    picture[1] += 0.1
    assert psnr(picture, original) == pytest.approx([np.inf, 20.0])


def test_depth_counts_only_where_it_was_measured():
    original = torch.full((2, 4, 4, 4), 0.5)
    original[0, 3, :2] = 0  # no measurement
    original[1, 3] = 0
    picture = original.clone()
    picture[:, 3] = 0.51
    near = fidelity(picture, original)
    assert near.psnr_db == np.inf
    assert near.depth_mae_mm == pytest.approx(10, rel=1e-4)
    assert fidelity(picture[1:], original[1:]).depth_mae_mm is None


def test_the_mean_picture_knows_depth_where_anyone_has_it():
    frames = drawn_frames(2)
    image = frames.observations["image"]
    image[0, 3, 0, 0] = 0
    mean = mean_picture(frames)
    assert mean[3, 0, 0] == image[1, 3, 0, 0]
    assert torch.allclose(mean[:, 1], image[:, :, 1].mean(dim=0))


def test_r_squared_of_the_truth_the_mean_and_a_constant():
    truth = np.random.default_rng(0).normal(size=(30, 2))
    assert r_squared(truth, truth) == 1
    assert r_squared(np.broadcast_to(truth.mean(axis=0), truth.shape), truth) == pytest.approx(0)
    assert r_squared(truth, np.ones((30, 2))) is None


def test_yaws_of_a_gripper_are_half_a_turn_from_themselves():
    truth = np.array([[1.0, 0.1, 0.2, 0.3, 1.5]])
    guess = np.array([[0.5, 0.103, 0.204, 0.301, -1.6]])  # turned by 3.1 rad: nearly pi
    off = gripper_error(guess, truth)
    assert (off.opening, off.xy_mm, off.z_mm) == pytest.approx((0.5, 5.0, 1.0))
    assert off.yaw_deg == pytest.approx(np.rad2deg(np.pi - 3.1))


def test_a_probe_finds_a_linear_target_and_none_in_noise():
    rng = np.random.default_rng(0)
    x, episode = rng.normal(size=(400, 10)) * 10.0 ** np.linspace(-2, 2, 10), np.arange(400) // 20
    linear, noise = x @ rng.normal(size=(10, 2)) + 3, rng.normal(size=(400, 2))
    probe = fit_ridge(x[:300], np.concatenate([linear, noise], axis=1)[:300], episode[:300])
    guess = probe(x[300:])
    assert r_squared(guess[:, :2], linear[300:]) == pytest.approx(1, abs=1e-9)
    assert r_squared(guess[:, 2:], noise[300:]) == pytest.approx(0, abs=0.1)


def test_an_input_that_hardly_ever_changes_does_not_spoil_a_probe():
    rng = np.random.default_rng(0)
    x, episode = rng.normal(size=(400, 10)), np.arange(400) // 20
    x[:, 9] = 1e-7 * rng.normal(size=400)
    y = x[:, :1] + rng.normal(size=(400, 1))
    held = rng.normal(size=(100, 10))  # here it does change
    assert r_squared(fit_ridge(x, y, episode)(held), held[:, :1]) > 0.9


def test_frames_of_one_episode_do_not_vouch_for_each_other():
    rng = np.random.default_rng(0)
    episode = np.repeat(np.arange(80), 10)
    x = rng.normal(size=(80, 30))[episode] + 0.01 * rng.normal(size=(800, 30))  # says which episode it is, no more
    y = rng.normal(size=(80, 1))[episode]
    learned, other = episode < 40, episode >= 40
    by_episode = fit_ridge(x[learned], y[learned], episode[learned])
    by_frame = fit_ridge(x[learned], y[learned], np.arange(400))
    assert r_squared(by_episode(x[other]), y[other]) > -0.2
    assert r_squared(by_frame(x[other]), y[other]) < -0.5


def test_errors_of_probes_are_in_units_and_angles_periodic():
    angle = np.linspace(-3, 3, 50)
    quarter = np.stack([np.cos(4 * angle), np.sin(4 * angle)], axis=1)
    turned = np.stack([np.cos(4 * (angle + np.pi / 2 + 0.1)), np.sin(4 * (angle + np.pi / 2 + 0.1))], axis=1)
    assert Target("yaw", "deg", quarter, 4).error(turned) == pytest.approx(np.rad2deg(0.1))
    place = Target("x, y", "mm", np.zeros((4, 2)))
    assert place.error(np.tile([3.0, 4.0], (4, 1))) == pytest.approx(5)


def test_readings_beside_those_of_raw_inputs_and_of_the_mean():
    rng = np.random.default_rng(0)
    x, episode = rng.normal(size=(60, 3)), torch.arange(60) // 6
    targets = [Target("a", "N", x[:, :1] * 2), Target("b", "mm", rng.normal(size=(60, 2)))]
    probe, blind = Probe.fit(x, targets, episode), Probe.fit(np.zeros((60, 1)), targets, episode)
    first, second = readings(probe, x, blind, np.zeros((60, 1)), targets)
    assert first.r2 == pytest.approx(1)
    assert first.raw_error == pytest.approx(first.mean_error)  # nothing to read: the mean is the best guess
    assert second.r2 < 0.5
