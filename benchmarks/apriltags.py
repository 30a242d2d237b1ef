"""AprilTags: time of a detection, accuracy at 0.6 m, agreement of tag rewards with the true ones, and endurance.

python benchmarks/apriltags.py speed accuracy
python benchmarks/apriltags.py agreement [--task block_pushing] [--episodes 20]
python benchmarks/apriltags.py endurance [--detections 10000]
"""

import argparse
import gc
import resource
import time
from dataclasses import replace

import cv2
import numpy as np

from collectors.apriltags.detector import TagDetector, grayscale
from collectors.apriltags.edges import Edges
from collectors.apriltags.layout import Layout
from collectors.apriltags.pose import body_pose
from collectors.apriltags.tracker import Tracker
from collectors.simulation.bodies import quat_from_yaw
from collectors.simulation.bullet import pybullet
from collectors.simulation.camera import Camera, CameraConfig, calibration
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.sources.tagged_block import largest_tag, wear_tags
from collectors.sources.tagged_expert import watched
from collectors.tasks import task_class
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import MAX_STEPS, attempt_seed
from svfl_data.schema.robot import Calibration

HALF, DISTANCE = 0.025, 0.6  # [m] half of the cube's edge, and distance from the cube to the camera


class Scene:
    """Tagged cube on a table, seen from a random direction above."""

    def __init__(self, seed: int) -> None:
        """Build the scene.

        Args:
            seed: Seed of the random poses and of the noise.
        """
        self.rng = np.random.default_rng(seed)
        self.world = World(WorldConfig(cameras={}))
        self.world.reset(seed=0)
        cube = self.world.add_box((HALF, HALF, HALF), (0.55, 0.0, HALF), 0.0, 0.1, 0.5)
        self.body, self.layout = wear_tags(self.world.client, cube, HALF)
        for link in range(-1, pybullet.getNumJoints(self.world.robot, physicsClientId=self.world.client)):
            pybullet.changeVisualShape(
                self.world.robot, link, rgbaColor=(0, 0, 0, 0), physicsClientId=self.world.client
            )

    def picture(self, cover: float = 0.0):
        """Render a 640 x 480 picture without jagged edges.

        Args:
            cover: Share of the cube's width in the picture that a finger-like bar hides from one side, 0 for none.

        Returns:
            The picture, (480, 640, 3) uint8 RGB, its calibration, the cube's position [m], and the cube's yaw [rad].
        """
        rng, target = self.rng, np.array([0.55, 0.0, HALF])
        elevation, azimuth, yaw = np.radians(rng.uniform(40, 75)), *rng.uniform(-np.pi, np.pi, 2)
        back = np.array([np.cos(azimuth), np.sin(azimuth)])
        eye = target + DISTANCE * np.array([*(np.cos(elevation) * back), np.sin(elevation)])
        place = target + np.array([*rng.uniform(-0.08, 0.08, 2), 0.0])
        pybullet.resetBasePositionAndOrientation(
            self.body, place, quat_from_yaw(yaw), physicsClientId=self.world.client
        )
        config = CameraConfig(480, 640, tuple(eye), tuple(target), (*-back, 0.0), 45.0)
        fine = Camera(replace(config, height=960, width=1280), self.world.client).render().color
        color = cv2.resize(fine, (640, 480), interpolation=cv2.INTER_AREA)
        if cover:
            self._cover(color, calibration(config), place, cover)
        return color, calibration(config), place, yaw

    def _cover(self, color, camera, place, cover: float) -> None:
        T = np.linalg.inv(camera.T_base_camera)
        x, y, z = camera.intrinsics @ (T[:3, :3] @ place + T[:3, 3])
        radius = HALF * np.sqrt(3) * camera.intrinsics[0, 0] / z
        column = int(x / z - radius + 2 * radius * cover) if self.rng.random() < 0.5 else None
        rows = slice(max(0, int(y / z - 3 * radius)), int(y / z + 3 * radius))
        if column is None:
            color[rows, int(x / z + radius - 2 * radius * cover) : int(x / z + 3 * radius)] = (60, 60, 65)
        else:
            color[rows, max(0, column - int(2 * radius)) : column] = (60, 60, 65)


def noisy(picture, rng, noise: float):
    """Return a picture with added Gaussian noise of a standard deviation in grey levels."""
    return np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)


def accuracy(pictures: int) -> None:
    """Print the errors of position and yaw, with and without the knowledge that the cube stands upright."""
    scene = Scene(seed=0)
    print(f"accuracy: cube of 5 cm, tags of 40 mm, {DISTANCE} m, {pictures} pictures each")
    print("| picture | noise | hidden | upright known | seen | place, mm: median, 90 %, largest | yaw, deg: largest |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for width, noise, cover in (
        (640, 0.0, 0.0), (640, 3.0, 0.0), (640, 8.0, 0.0), (640, 3.0, 0.2), (640, 3.0, 0.35), (416, 3.0, 0.0)
    ):  # fmt: skip
        shots = [resized(*scene.picture(cover), width) for _ in range(pictures)]
        shots = [(noisy(color, scene.rng, noise), *truth) for color, *truth in shots]
        for upright in (False, True):
            places, yaws = [], []
            for color, camera, place, yaw in shots:
                track = Tracker(scene.layout, upright).see(color, 0, camera)
                if track is None:
                    continue
                places.append(1e3 * np.linalg.norm(track.pose[:3] - place))
                x, y, z, w = track.pose[3:]
                off = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) - yaw
                yaws.append(np.degrees(abs((off + np.pi) % (2 * np.pi) - np.pi)))
            median, most = np.percentile(places, [50, 90])
            print(
                f"| {width} | {noise:g} | {cover:.0%} | {'yes' if upright else 'no'} | {len(places)} of {pictures} "
                f"| {median:.2f}, {most:.2f}, {max(places):.2f} | {max(yaws):.2f} |"
            )


def resized(color, camera: Calibration, place, yaw, width: int):
    """Return a picture reduced to a width [px], its calibration, and the unchanged position and yaw of the cube."""
    factor = width / color.shape[1]
    intrinsics = np.diag([factor, factor, 1.0]) @ camera.intrinsics
    intrinsics[:2, 2] += 0.5 * (factor - 1)  # the centre of the first pixel is at 0
    size = (width, round(factor * color.shape[0]))
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA) if factor < 1 else color
    return small, replace(camera, intrinsics=intrinsics), place, yaw


def speed(pictures: int) -> None:
    """Print the CPU times of finding tags, of the pose from corners, and of the pose from edges, in noisy pictures."""
    scene, detect = Scene(seed=1), TagDetector()
    edges, times = Edges(scene.layout), []
    for _ in range(pictures):
        color, camera, *_ = scene.picture()
        color, up = noisy(color, scene.rng, 3.0), camera.T_base_camera[2, :3]
        marks = [time.process_time()]
        gray = grayscale(color)
        tags = detect(gray)
        marks.append(time.process_time())
        found = body_pose(tags, scene.layout, camera.intrinsics, up)
        marks.append(time.process_time())
        edges.meet(found.T_camera_body, gray, camera.intrinsics, up)
        marks.append(time.process_time())
        times.append(1e3 * np.diff(marks))
    for name, values in zip(
        ("detection", "corners", "edges", "all"), [*np.transpose(times), np.sum(times, 1)], strict=True
    ):
        low, median, high = np.percentile(values, [10, 50, 90])
        print(f"speed: {name} in 640 x 480, CPU ms: median {median:.1f} ({low:.1f}..{high:.1f}) of {pictures}")


def agreement(task_name: str, episodes: range, noise: float) -> None:
    """Print how often the reward from tags equals the true one, over all steps of experts' episodes.

    Args:
        task_name: Name of the task.
        episodes: Numbers of the episodes.
        noise: Standard deviation of the noise on the pictures, in grey levels.
    """
    world = World(WorldConfig(cameras={}))
    agree, steps, ages, errors = 0, 0, [], []
    for index in episodes:
        task = task_class(task_name).begin(world, attempt_seed(7, index, 0))
        watch = watched(task, noise, index)
        moves = task.expert(Gripper(world, np.random.default_rng(index)))
        for _ in range(MAX_STEPS):
            move = next(moves, None)
            if move is None:
                break
            world.step(move)
            told, true = watch.done(), task.success()
            steps, agree = steps + 1, agree + (told == true)
            track = watch.tracker.at(int(world.wrench_t_ns[-1]))
            ages.append(np.inf if track is None else track.age)
            if track is not None and track.age == 0:
                errors.append(1e3 * np.linalg.norm(track.pose[:3] - world.pose(task.body)[:3]))
            if told != true:
                print(f"  episode {index}: tags say {told}, truth {true}, age {ages[-1]:.2f} s", flush=True)
            if told and true:
                break
        print(f"  episode {index}: {steps} steps so far, {agree} agree", flush=True)
    place = np.percentile(errors, [50, 99, 100])
    print(
        f"agreement: {task_name}, {len(episodes)} episodes, {agree} of {steps} steps ({agree / steps:.2%}); hidden in "
        f"{np.mean(np.array(ages) > 0):.1%} of them; place, mm: median {place[0]:.2f}, 99 % {place[1]:.2f}, "
        f"largest {place[2]:.2f}"
    )


def endurance(detections: int) -> None:
    """Create and drop detectors very often, to show that nothing crashes and memory does not grow.

    Args:
        detections: Number of detectors, each of which detects once.
    """
    layout, rng = Layout.cube(HALF, largest_tag(HALF)), np.random.default_rng(0)
    scene = Scene(seed=2)
    pictures = [noisy(scene.picture()[0][180:300, 240:400], rng, 4.0) for _ in range(4)]
    found, first = 0, 0
    for number in range(detections):
        family = ("tag36h11", "tag25h9", "tag16h5", "tagCircle21h7")[number % 4 if number % 10 == 0 else 0]
        detect = TagDetector(family)
        found += any(one.id in layout.tags for one in detect(pictures[number % 4]))
        del detect
        if number % 1000 == 999:
            gc.collect()
            first = first or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - first) / 1024
    print(
        f"endurance: {detections} detections, a new detector for each, {found} found tags; memory grew by "
        f"{grown:.1f} MB"
    )


def main() -> None:
    """Run the measurements that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="+", choices=["speed", "accuracy", "agreement", "endurance"])
    parser.add_argument("--pictures", type=int, default=40)
    parser.add_argument("--task", default="block_pushing", choices=["block_pushing", "block_picking"])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first episode")
    parser.add_argument("--noise", type=float, default=3.0, help="standard deviation of the noise, grey levels")
    parser.add_argument("--detections", type=int, default=10_000)
    args = parser.parse_args()
    runs = {
        "speed": lambda: speed(args.pictures),
        "accuracy": lambda: accuracy(args.pictures),
        "agreement": lambda: agreement(args.task, range(args.first, args.first + args.episodes), args.noise),
        "endurance": lambda: endurance(args.detections),
    }
    for what in args.what:
        runs[what]()


if __name__ == "__main__":
    main()
