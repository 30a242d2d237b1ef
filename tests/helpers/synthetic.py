"""Drawn block-centering samples: physics in a few lines, so that model tests need no simulator."""

import numpy as np

from svfl_data.sampling.centering_samples import CenteringSamples
from svfl_data.symmetry import nearest_direction

SPAN = 0.4  # side of the image, [m]
FINGER = 0.04  # finger from the TCP along the gripper's closing axis, [m]
SENSOR_HEIGHT = 0.2  # sensor origin above the contact, [m]


def centering_samples(count: int, seed: int, size: int = 76, window: int = 64) -> CenteringSamples:
    """Grippers that have pressed one finger onto a block, seen from above; classes take turns."""
    rng = np.random.default_rng(seed)
    yaw = np.arange(count) % 4 * (np.pi / 2) + rng.uniform(-0.6, 0.6, count)
    axis = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    tcp = rng.uniform(-0.08, 0.08, (count, 2))
    offset = axis * rng.uniform(0.02, 0.05, (count, 1)) + rng.normal(0, 0.003, (count, 2))
    return CenteringSamples(
        image=np.stack([draw(tcp[i], yaw[i], tcp[i] + offset[i], size, rng) for i in range(count)]),
        wrench=np.stack([feel(axis[i], window, rng) for i in range(count)]),
        proprio=np.concatenate(
            [np.ones((count, 1)), tcp, np.full((count, 1), 0.05), yaw[:, None]], axis=1, dtype=np.float32
        ),
        offset=offset.astype(np.float32),
        direction=nearest_direction(offset),
        episode=np.arange(count),
    )


def feel(axis: np.ndarray, window: int, rng: np.random.Generator) -> np.ndarray:
    """Wrench of a finger at `axis` * FINGER pressing down ever harder: torque = r x F about the sensor, (T, 6)."""
    lever = np.array([*(axis * FINGER), -SENSOR_HEIGHT])
    press = np.linspace(0, rng.uniform(10, 40), window)[:, None]
    force = press * np.array([*rng.normal(0, 0.1, 2), 1.0])
    wrench = np.concatenate([force, np.cross(lever, force)], axis=-1)
    return (wrench + rng.normal(0, [0.3] * 3 + [0.02] * 3, wrench.shape)).astype(np.float32)


def draw(tcp: np.ndarray, yaw: float, block: np.ndarray, size: int, rng: np.random.Generator) -> np.ndarray:
    """RGB-D picture from 1 m above, (4, size, size)."""
    place = (np.arange(size) + 0.5) / size * SPAN - SPAN / 2
    x, y = np.meshgrid(place, -place)  # rows run downwards
    image = np.broadcast_to(np.array([0.8, 0.8, 0.8, 1.0])[:, None, None], (4, size, size)).copy()
    turn = rng.uniform(0, np.pi)
    image[:, box(x, y, block, turn, 0.025, 0.025)] = np.array([0.8, 0.2, 0.2, 0.95])[:, None]
    image[:, box(x, y, tcp, yaw, 0.05, 0.015)] = np.array([0.3, 0.3, 0.3, 0.8])[:, None]
    noise = rng.normal(0, 0.01, image.shape) * np.array([1, 1, 1, 0.2])[:, None, None]
    return (image + noise).astype(np.float32)


def box(x: np.ndarray, y: np.ndarray, centre: np.ndarray, yaw: float, long: float, short: float) -> np.ndarray:
    """Mask of a rectangle of half lengths `long` and `short`."""
    dx, dy = x - centre[0], y - centre[1]
    along, across = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
    return (np.abs(along) < long) & (np.abs(across) < short)


def gripper_states(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Proprioception, (x, y) about the workspace centre, and actions within their bounds, both (count, 5)."""
    rng = np.random.default_rng(seed)
    proprio = rng.uniform([0, -0.2, -0.2, 0.0, -np.pi], [1, 0.2, 0.2, 0.25, np.pi], (count, 5))
    action = rng.uniform([0.1, -0.02, -0.02, -0.02, -0.15], [0.9, 0.02, 0.02, 0.02, 0.15], (count, 5))
    return proprio.astype(np.float32), action.astype(np.float32)
