"""Small synthetic episodes for tests: valid, seeded, with a wrench that a real contact would give."""

import numpy as np

from svfl_data.schema.episode import Episode, Meta
from svfl_data.symmetry import OFFSET_PARTS, act, nearest_direction

IMAGE_AXES = np.array([[0.0, 1.0], [-1.0, 0.0]])


def episode_arrays(
    rng: np.random.Generator, steps: int = 4, size: int = 16, angle: float | None = None
) -> dict[str, np.ndarray]:
    """Arrays of a centering episode whose final readings feel a finger on a block in the direction `angle` (base)."""
    angle = rng.uniform(-np.pi, np.pi) if angle is None else angle
    t_ns = (np.arange(steps + 1) * 25 + 100) * 2_000_000
    wrench_t_ns = np.arange(1, steps * 25 + 101) * 2_000_000
    finger = 0.045 * np.array([np.cos(angle), np.sin(angle)])
    force = np.zeros((len(wrench_t_ns), 3))
    force[-25:] = [0.0, 0.0, 20.0]
    lever = np.array([*finger, -0.1])
    tare = np.array([0.1, -0.2, -8.0, 0.01, 0.02, 0.0])
    wrench = np.concatenate([force, np.cross(lever, force)], axis=1) + tare + rng.normal(0, 0.02, (len(force), 6))
    camera = np.eye(4)
    camera[:3, :3] = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]
    camera[:3, 3] = [1.0, 0.0, 0.2]
    proprio = np.stack([np.array([1.0, 0.55, 0.0, 0.2 - 0.01 * k, angle - np.pi / 2]) for k in range(steps + 1)])
    block = np.array([0.55 + finger[0], finger[1], 0.025, 0.0, 0.0, 0.0, 1.0])
    return {
        "observations/t_ns": t_ns,
        "cameras/front/t_ns": t_ns.copy(),
        "cameras/front/color": rng.integers(0, 256, (steps + 1, size, size, 3), dtype=np.uint8),
        "cameras/front/depth": rng.integers(4000, 12000, (steps + 1, size, size), dtype=np.uint16),
        "observations/proprio": proprio.astype(np.float32),
        "streams/joints/t_ns": t_ns.copy(),
        "streams/joints/position": rng.uniform(-1, 1, (steps + 1, 9)).astype(np.float32),
        "streams/object/t_ns": t_ns.copy(),
        "streams/object/pose": np.repeat(block[None], steps + 1, axis=0),
        "streams/tags/t_ns": t_ns.copy(),
        "streams/tags/pose": np.repeat(block[None], steps + 1, axis=0),
        "streams/tags/age": np.zeros(steps + 1),
        "streams/tags/error": np.full(steps + 1, 0.2),
        "streams/tags/margin": np.full(steps + 1, 100.0),
        "streams/tags/count": np.ones(steps + 1, dtype=np.int64),
        "actions/action": np.tile(np.array([1.0, 0.0, 0.0, -0.01, 0.0], dtype=np.float32), (steps, 1)),
        "actions/expert_action": np.tile(np.array([1.0, 0.0, 0.0, -0.02, 0.0], dtype=np.float32), (steps, 1)),
        "streams/wrench/t_ns": wrench_t_ns,
        "streams/wrench/wrench": wrench.astype(np.float32),
        "streams/wrench/tare": tare,
        "cameras/front/depth_scale": np.array(1e-4),
        "cameras/front/intrinsics": np.array([[20.0, 0.0, 7.5], [0.0, 20.0, 7.5], [0.0, 0.0, 1.0]]),
        "cameras/front/T_base_camera": camera,
        "cameras/front/image_axes": IMAGE_AXES.copy(),
        "workspace": np.array([[0.35, 0.75], [-0.2, 0.2], [-0.01, 0.25]]),
        "streams/object/half_extents": np.full(3, 0.025),
        "labels/offset": finger,
        "labels/direction": np.asarray(nearest_direction(act(IMAGE_AXES, finger, OFFSET_PARTS))),
    }


def make_episode(index: int = 0, seed: int = 0, **kwargs) -> Episode:
    """A valid centering episode; the same arguments give the same bytes."""
    arrays = episode_arrays(np.random.default_rng([seed, index]), **kwargs)
    meta = Meta("centering", index, seed, "expert", True, config={"size": 16}, software={"svfl": "0"})
    return Episode(meta, arrays)
