"""The compiled inner loop computes what its formulas say."""

import numpy as np
import pytest

from collectors.simulation.arms.kinematics import gripper_velocity, jacobian_array, joint_motion


@pytest.mark.parametrize("seed", range(5))
def test_the_damped_pseudo_inverse_is_numpys(seed):
    rng = np.random.default_rng(seed)
    jacobian, motion, posture = rng.normal(size=(6, 7)), rng.normal(size=6), rng.normal(size=7)
    damping = 10.0 ** rng.uniform(-4, 0)
    inverse = jacobian.T @ np.linalg.inv(jacobian @ jacobian.T + damping**2 * np.eye(6))
    expected = inverse @ motion + (np.eye(7) - inverse @ jacobian) @ posture
    before = posture.copy()
    np.testing.assert_allclose(joint_motion(jacobian, motion, posture, damping), expected, rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(posture, before)


def test_a_wish_for_the_posture_does_not_move_the_gripper():
    rng = np.random.default_rng(0)
    jacobian, posture = rng.normal(size=(6, 7)), rng.normal(size=7)
    step = joint_motion(jacobian, np.zeros(6), posture, 1e-6)
    np.testing.assert_allclose(jacobian @ step, 0.0, atol=1e-9)
    assert np.linalg.norm(step) > 0.01


def test_a_singular_arm_stays_finite():
    jacobian = np.zeros((6, 7))
    jacobian[0, 0] = 1.0
    assert np.isfinite(joint_motion(jacobian, np.ones(6), np.ones(7), 1e-3)).all()


def test_the_gripper_moves_as_a_rigid_body():
    rng = np.random.default_rng(1)
    linear, angular = (tuple(map(tuple, rng.normal(size=(3, 9)).tolist())) for _ in range(2))
    rates = tuple(rng.normal(size=9).tolist())
    jacobian = jacobian_array(linear, angular)
    np.testing.assert_array_equal(jacobian, np.array(linear + angular)[:, :7])
    v, w = np.split(jacobian @ rates[:7], 2)
    np.testing.assert_allclose(gripper_velocity(jacobian, rates, 0.04), v + np.cross(w, [0, 0, 0.04]))
