import numpy as np

from collectors.simulation.reference import Reference


def test_the_moves_of_a_tick_add_up_to_its_action():
    reference, rng = Reference(25, 10), np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, 4)
        np.testing.assert_allclose(reference.moves(action).sum(axis=0), action, atol=1e-12)


def test_equal_actions_become_one_constant_velocity():
    reference, action = Reference(25, 10), np.array([0.01, 0.0, -0.02, 0.1])
    for _ in range(20):
        moves = reference.moves(action)
    np.testing.assert_allclose(moves, np.tile(action / 25, (25, 1)), rtol=1e-6)


def test_the_velocity_never_jumps():
    """Between any two physics steps it changes by no more than its share of the ramp."""
    reference, rng = Reference(25, 10), np.random.default_rng(1)
    moves = [np.zeros((1, 4))]
    changes = []
    for _ in range(10):
        tick = reference.moves(rng.uniform(-1, 1, 4))
        changes.append(np.abs(tick[-1] - moves[-1][-1]))
        moves.append(tick)
    jumps = np.abs(np.diff(np.concatenate(moves), axis=0))
    assert jumps.max() <= np.max(changes) / 10 * (1 + 1e-9)
