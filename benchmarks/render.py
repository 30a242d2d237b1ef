"""Cost of an image: the arm with coarse meshes against the arm with full meshes, in the same run.

python benchmarks/render.py [--size 76] [--images 100]
"""

import argparse
import time

import numpy as np

from collectors.simulation import CameraConfig, PandaConfig, World, WorldConfig


def cost(full_meshes: bool, size: int, images: int) -> list[float]:
    """Return the CPU milliseconds of each RGB-D image with the arm and a block in view.

    Args:
        full_meshes: Whether the arm has its full meshes.
        size: Height and width of the image, [px].
        images: Number of images.
    """
    config = WorldConfig(
        cameras={"front": CameraConfig(height=size, width=size)}, robot=PandaConfig(full_meshes=full_meshes)
    )
    with World(config) as world:
        world.reset(seed=0)
        world.add_box((0.025, 0.025, 0.025), (0.55, 0.03, 0.025), yaw=0.4, mass=0.1, friction=0.5)
        for _ in range(6):
            world.step([1.0, 0.0, 0.0, -0.02, 0.1])
        times = []
        for _ in range(images):
            start = time.process_time()
            world.observe()
            times.append(1e3 * (time.process_time() - start))
        return times


def main() -> None:
    """Print the median, and the 10th and 90th percentile, for both arms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=76, help="height and width, px")
    parser.add_argument("--images", type=int, default=100)
    args = parser.parse_args()
    print(f"RGB-D image {args.size} x {args.size}, CPU ms: median (10th..90th percentile) of {args.images}")
    for name, full_meshes in (("coarse arm", False), ("full meshes", True)):
        low, median, high = np.percentile(cost(full_meshes, args.size, args.images), [10, 50, 90])
        print(f"{name:12} {median:6.2f} ({low:.2f}..{high:.2f})")


if __name__ == "__main__":
    main()
