"""The 3-D scene of an episode's recording, in base axes: workspace, block, hand, what it feels, where it must go."""

import numpy as np
import rerun as rr

from svfl_data.blueprint import SCENE, TIMELINE
from svfl_data.episode import Episode
from svfl_data.symmetry import DIRECTIONS

METRES_PER_NEWTON = 0.003  # a collision of 30 N draws an arrow of 9 cm, as long as the hand
METRES_PER_NEWTON_METRE = 0.05  # 30 N on a finger 4.5 cm off the axis: 7 cm

# Franka Hand as in panda.urdf, in metres, drawn as boxes. The frame is at the TCP, z up; the fingers open along y,
# which is base y at yaw 0.
WRIST_ABOVE_TCP = 0.105  # the sensor origin
PALM_CENTRE, PALM_HALF = (0.0, 0.0, 0.072), (0.030, 0.100, 0.033)
FINGER_Z, FINGER_HALF = 0.016, (0.010, 0.006, 0.023)
FINGER_TRAVEL = 0.040  # of one finger, from closed to open
BLOCK_HALF = (0.025, 0.025, 0.025)  # where it was not recorded

# Okabe and Ito's palette, made to be told apart by colour-blind people. Axes x, y, z have one colour everywhere.
AXES = ((213, 94, 0), (0, 158, 115), (86, 180, 233))
FORCE, TORQUE, LABEL, BLOCK = (230, 159, 0), (204, 121, 167), (240, 228, 66), (0, 114, 178)
GREY = (150, 150, 150)


def log_scene(recording: rr.RecordingStream, episode: Episode) -> None:
    """Log everything below `SCENE` but the camera; nothing moving is drawn before the first observation."""
    _log_surroundings(recording, episode)
    _log_hand(recording, episode)
    _log_arrows(recording, episode)
    if episode.has("label_offset"):
        _log_label(recording, episode)


def send_stream(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, *columns: rr.ComponentColumnList) -> None:
    """Log a whole stream at once: row k of every column at time `t_ns[k]` of the episode clock."""
    clock = rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]"))
    recording.send_columns(path, [clock], [column for group in columns for column in group])


def _send_boxes(
    recording: rr.RecordingStream,
    path: str,
    t_ns: np.ndarray,
    position: np.ndarray,
    quat_xyzw: np.ndarray,
    half_sizes: np.ndarray,
    centres: np.ndarray | None = None,
) -> None:
    """Log boxes that move together; sizes go with each row so that nothing is drawn before the first one.

    Args:
        recording: Where to log.
        path: Entity.
        t_ns: Time of each row, shape (N,).
        position: Of the frame of the boxes, shape (N, 3), [m], base axes.
        quat_xyzw: Of the frame of the boxes, shape (N, 4).
        half_sizes: Shape (N, boxes, 3), [m].
        centres: In the frame of the boxes, shape (N, boxes, 3), [m]; zero if not given.
    """
    rows, number = half_sizes.shape[:2]
    centres = np.zeros_like(half_sizes) if centres is None else centres
    boxes = rr.Boxes3D.columns(half_sizes=half_sizes.reshape(-1, 3), centers=centres.reshape(-1, 3))
    frame = rr.Transform3D.columns(translation=position, quaternion=quat_xyzw)
    send_stream(recording, path, t_ns, frame, boxes.partition([number] * rows))


def _log_surroundings(recording: rr.RecordingStream, episode: Episode) -> None:
    recording.log(SCENE, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    lower, upper = episode.workspace.T
    recording.log(
        f"{SCENE}/workspace",
        rr.Boxes3D(mins=[lower], sizes=[upper - lower], colors=GREY, radii=0.001, fill_mode="majorwireframe"),
        static=True,
    )
    table = np.array([*(upper - lower)[:2] / 2 + 0.05, 0.005])
    recording.log(
        f"{SCENE}/table",
        rr.Boxes3D(centers=[[*episode.centre, -table[2]]], half_sizes=[table], colors=(90, 90, 90), fill_mode="solid"),
        static=True,
    )
    corner = np.array([*lower[:2], 0.0])
    axes = rr.Arrows3D(
        origins=[corner] * 3,
        vectors=0.06 * np.eye(3),
        colors=AXES,
        radii=0.003,
        labels=["x", "y", "z"],
        show_labels=True,
    )
    recording.log(f"{SCENE}/base_axes", axes, static=True)
    if episode.has("object_pose"):
        pose = episode.object_pose
        half = episode.object_half if episode.has("object_half") else BLOCK_HALF
        boxes = np.tile(half, (len(pose), 1, 1))
        _send_boxes(recording, f"{SCENE}/block", episode.object_t_ns, pose[:, :3], pose[:, 3:], boxes)
        recording.log(f"{SCENE}/block", rr.Boxes3D.from_fields(colors=[BLOCK], fill_mode="solid"), static=True)


def hand_poses(proprio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The hand's frame: origin at the TCP, z up, the fingers open along y.

    Args:
        proprio: Opening, TCP position and yaw as declared in `svfl_data.fields`, shape (N, 5).

    Returns:
        Position, shape (N, 3), [m], and quat_xyzw, shape (N, 4), in base.
    """
    zero, half_yaw = np.zeros(len(proprio)), proprio[:, 4] / 2
    return proprio[:, 1:4], np.stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)], axis=1)


def hand_boxes(opening: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A gripper made of three boxes: palm and two fingers.

    Args:
        opening: Gripper opening, 0 closed to 1 open, shape (N,).

    Returns:
        Half sizes and centres, both of shape (N, 3 boxes, 3), [m], in the hand's frame.
    """
    centres = np.zeros((len(opening), 3, 3))
    centres[:, 0] = PALM_CENTRE
    centres[:, 1:, 1] = np.multiply.outer(opening * FINGER_TRAVEL + FINGER_HALF[1], [1.0, -1.0])
    centres[:, 1:, 2] = FINGER_Z
    return np.tile([PALM_HALF, FINGER_HALF, FINGER_HALF], (len(opening), 1, 1)), centres


def _log_hand(recording: rr.RecordingStream, episode: Episode) -> None:
    path = f"{SCENE}/hand"
    recording.log(path, rr.Boxes3D.from_fields(colors=[(200, 200, 200)], fill_mode="solid"), static=True)
    position, quat_xyzw = hand_poses(episode.proprio)
    _send_boxes(recording, path, episode.t_ns, position, quat_xyzw, *hand_boxes(episode.proprio[:, 0]))
    recording.log(f"{SCENE}/path", rr.LineStrips3D([position], colors=GREY, radii=0.001), static=True)


def _log_arrows(recording: rr.RecordingStream, episode: Episode) -> None:
    wrist = episode.proprio[:, 1:4] + [0.0, 0.0, WRIST_ABOVE_TCP]
    send_stream(recording, f"{SCENE}/wrist", episode.t_ns, rr.Transform3D.columns(translation=wrist))
    placed = episode.wrench_t_ns >= episode.t_ns[0]  # before, where the wrist was is not recorded
    force, torque = np.split(episode.tared_wrench[placed], 2, axis=1)
    newtons = [f"force {size:.1f} N" for size in np.linalg.norm(force, axis=1)]
    for path, vectors, color, labels in (
        (f"{SCENE}/wrist/force", force * METRES_PER_NEWTON, FORCE, newtons),
        (f"{SCENE}/wrist/torque", torque * METRES_PER_NEWTON_METRE, TORQUE, None),
    ):
        style = rr.Arrows3D.from_fields(colors=[color], radii=[0.004], show_labels=True)
        recording.log(path, style, static=True)
        columns = rr.Arrows3D.columns(vectors=vectors, labels=labels)
        send_stream(recording, path, episode.wrench_t_ns[placed], columns)


def _log_label(recording: rr.RecordingStream, episode: Episode) -> None:
    """The label belongs to the final observation: an arrow from the hand to its outline where it must go."""
    end, offset = episode.t_ns[-1:], np.array([*episode.label_offset, 0.0])
    position, quat_xyzw = hand_poses(episode.proprio[-1:])

    arrow, above = f"{SCENE}/label_offset", [0.0, 0.0, WRIST_ABOVE_TCP + 0.02]  # the hand's top would hide it
    recording.log(arrow, rr.Arrows3D.from_fields(colors=[LABEL], radii=[0.004]), static=True)
    send_stream(recording, arrow, end, rr.Arrows3D.columns(origins=position + above, vectors=[offset]))

    target = f"{SCENE}/label_target"
    words = f"move {DIRECTIONS[int(episode.label_direction)]} {np.linalg.norm(offset) * 1e3:.0f} mm"
    outline = rr.Boxes3D.from_fields(colors=[LABEL], radii=[0.0007], labels=[words, "", ""], show_labels=True)
    recording.log(target, outline, static=True)
    _send_boxes(recording, target, end, position + offset, quat_xyzw, *hand_boxes(episode.proprio[-1:, 0]))
