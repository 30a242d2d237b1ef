"""The 3-D scene in base axes: workspace, object, gripper, wrench at the wrist, path of the TCP, and label."""

import numpy as np
import rerun as rr

from svfl_data.symmetry import DIRECTIONS
from svfl_data.viewer.entities.names import AXES, BLOCK, FORCE, GREY, LABEL, SCENE, TORQUE, send

METRES_PER_NEWTON = 0.003  # a collision of 30 N gives an arrow of 9 cm, as long as the gripper
METRES_PER_NEWTON_METRE = 0.05  # a force of 30 N on a finger 4.5 cm off the axis gives an arrow of 7 cm

# Franka Gripper as in panda.urdf, in metres, drawn as boxes. The frame is at the TCP, z up; the fingers open along y,
# which is base y at yaw 0.
WRIST_ABOVE_TCP = 0.105  # height of the sensor origin
PALM_CENTRE, PALM_HALF = (0.0, 0.0, 0.072), (0.030, 0.100, 0.033)
FINGER_Z, FINGER_HALF = 0.016, (0.010, 0.006, 0.023)
FINGER_TRAVEL = 0.040  # travel of one finger, from closed to open
BLOCK_HALF = (0.025, 0.025, 0.025)  # half edges of the object if they were not recorded
PATH_COLORS = np.array([(70, 80, 110), FORCE, (255, 255, 210)], dtype=np.float64)
"""Colours (red, green, blue) of the TCP's path, from zero force to the largest force."""


def log_environment(recording: rr.RecordingStream, root: str, workspace: np.ndarray | None) -> None:
    """Log the workspace box, the table and the base axes, and the colours and sizes of everything that moves.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        workspace: Lower and upper bounds of the TCP's x, y, z in base, shape (3, 2), [m]. None if it was not recorded:
            then neither box nor table is drawn, and the base axes are drawn at their origin.
    """
    scene = root + SCENE
    if workspace is not None:
        _log_workspace(recording, scene, *workspace.T)
    corner = np.zeros(3) if workspace is None else np.append(workspace[:2, 0], 0.0)
    for path, shape in {
        "": rr.ViewCoordinates.RIGHT_HAND_Z_UP,
        "/base_axes": rr.Arrows3D(
            origins=[corner] * 3, vectors=0.06 * np.eye(3), colors=AXES, radii=0.003, labels=["x", "y", "z"],
            show_labels=True,
        ),
        "/tcp": rr.Arrows3D.from_fields(vectors=0.03 * np.eye(3), colors=AXES, radii=[0.0012]),
        "/gripper": rr.Boxes3D.from_fields(colors=[(200, 200, 200)], fill_mode="solid"),
        "/object": rr.Boxes3D.from_fields(colors=[BLOCK], fill_mode="solid"),
    }.items():  # fmt: skip
        recording.log(scene + path, shape, static=True)
    log_arrow_style(recording, f"{scene}/wrist")


def log_arrow_style(recording: rr.RecordingStream, entity: str) -> None:
    """Log how the arrows of a wrench look.

    Args:
        recording: Recording to log to.
        entity: Entity of the arrows.
    """
    force = rr.Arrows3D.from_fields(colors=[FORCE], radii=[0.004], show_labels=True)
    recording.log(f"{entity}/force", force, static=True)
    recording.log(f"{entity}/torque", rr.Arrows3D.from_fields(colors=[TORQUE], radii=[0.004]), static=True)


def _log_workspace(recording: rr.RecordingStream, scene: str, lower: np.ndarray, upper: np.ndarray) -> None:
    extent = np.array([*(upper - lower)[:2] / 2 + 0.05, 0.005])
    centre = [*(lower + upper)[:2] / 2, -extent[2]]
    for path, shape in {
        "/workspace": rr.Boxes3D(
            mins=[lower], sizes=[upper - lower], colors=GREY, radii=0.001, fill_mode="majorwireframe"
        ),
        "/table": rr.Boxes3D(centers=[centre], half_sizes=[extent], colors=(90, 90, 90), fill_mode="solid"),
    }.items():
        recording.log(scene + path, shape, static=True)


def gripper_poses(proprio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses of the gripper's frame, whose origin is at the TCP, with z up; the fingers open along y.

    Args:
        proprio: Opening, TCP position and yaw as declared in `svfl_data.schema.fields`, shape (N, 5).

    Returns:
        Positions, shape (N, 3), [m], and quat_xyzw, shape (N, 4), in base.
    """
    zero, half_yaw = np.zeros(len(proprio)), proprio[:, 4] / 2
    return proprio[:, 1:4], np.stack([zero, zero, np.sin(half_yaw), np.cos(half_yaw)], axis=1)


def gripper_boxes(opening: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return three boxes that show the gripper: the palm and two fingers.

    Args:
        opening: Gripper opening, from 0 (closed) to 1 (open), shape (N,).

    Returns:
        Half sizes and centres, both of shape (N, 3 boxes, 3), [m], in the gripper's frame.
    """
    centres = np.zeros((len(opening), 3, 3))
    centres[:, 0] = PALM_CENTRE
    centres[:, 1:, 1] = np.multiply.outer(opening * FINGER_TRAVEL + FINGER_HALF[1], [1.0, -1.0])
    centres[:, 1:, 2] = FINGER_Z
    return np.tile([PALM_HALF, FINGER_HALF, FINGER_HALF], (len(opening), 1, 1)), centres


def send_gripper(recording: rr.RecordingStream, root: str, t_ns: np.ndarray, proprio: np.ndarray, boxes: bool) -> None:
    """Log the poses of the TCP and the wrist.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the observations, shape (N,), [ns].
        proprio: Proprioception at each observation, shape (N, 5).
        boxes: Whether to draw the gripper as boxes as well, which is needed if no arm is drawn.
    """
    position, quat_xyzw = gripper_poses(proprio)
    wrist = position + np.array([0.0, 0.0, WRIST_ABOVE_TCP])
    send(recording, f"{root}{SCENE}/wrist", t_ns, rr.Transform3D.columns(translation=wrist))
    pose = rr.Transform3D.columns(translation=position, quaternion=quat_xyzw)
    send(recording, f"{root}{SCENE}/tcp", t_ns, pose)
    if boxes:
        send_boxes(recording, f"{root}{SCENE}/gripper", t_ns, position, quat_xyzw, *gripper_boxes(proprio[:, 0]))


def send_tcp(recording: rr.RecordingStream, root: str, t_ns: np.ndarray, pose: np.ndarray) -> None:
    """Log the measured poses of the TCP, at which the wrench is drawn because the position of its sensor is unknown.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the poses, shape (K,), [ns].
        pose: Position [m] and quat_xyzw of the TCP in base, shape (K, 7).
    """
    send(recording, f"{root}{SCENE}/wrist", t_ns, rr.Transform3D.columns(translation=pose[:, :3]))
    frame = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, 3:])
    send(recording, f"{root}{SCENE}/tcp", t_ns, frame)


def send_boxes(
    recording: rr.RecordingStream,
    path: str,
    t_ns: np.ndarray,
    position: np.ndarray,
    quat_xyzw: np.ndarray,
    half_sizes: np.ndarray,
    centres: np.ndarray | None = None,
) -> None:
    """Log boxes that move together; each row has their sizes, so that nothing is drawn before the first row.

    Args:
        recording: Recording to log to.
        path: Entity of the boxes.
        t_ns: Time of each row, shape (N,), [ns].
        position: Position of the frame of the boxes, shape (N, 3), [m], base axes.
        quat_xyzw: Orientation of the frame of the boxes in base, shape (N, 4).
        half_sizes: Half edges of the boxes, shape (N, boxes, 3), [m].
        centres: Centres of the boxes in their frame, shape (N, boxes, 3), [m]. None for zero.
    """
    rows, number = half_sizes.shape[:2]
    centres = np.zeros_like(half_sizes) if centres is None else centres
    boxes = rr.Boxes3D.columns(half_sizes=half_sizes.reshape(-1, 3), centers=centres.reshape(-1, 3))
    frame = rr.Transform3D.columns(translation=position, quaternion=quat_xyzw)
    send(recording, path, t_ns, frame, boxes.partition([number] * rows))


def send_object(
    recording: rr.RecordingStream, root: str, t_ns: np.ndarray, pose: np.ndarray, half: np.ndarray | None
) -> None:
    """Log the task's object as a box.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the poses, shape (P,), [ns].
        pose: Position [m] and quat_xyzw of the object in base, shape (P, 7).
        half: Half edges of the object, shape (3,), [m]. None if they were not recorded.
    """
    boxes = np.tile(BLOCK_HALF if half is None else half, (len(pose), 1, 1))
    send_boxes(recording, f"{root}{SCENE}/object", t_ns, pose[:, :3], pose[:, 3:], boxes)


def send_arrows(
    recording: rr.RecordingStream, root: str, t_ns: np.ndarray, wrench: np.ndarray, place: str = "wrist"
) -> None:
    """Log force and torque as arrows at the wrist.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Timestamps of the readings, shape (M,), [ns].
        wrench: Wrenches, shape (M, 6), [N] and [N m], base axes.
        place: Entity of the arrows in the scene; those below ``wrist`` move with it.
    """
    force, torque = np.split(wrench, 2, axis=1)
    newtons = [f"{size:.1f} N" for size in np.linalg.norm(force, axis=1)]
    arrow = rr.Arrows3D.columns(vectors=force * METRES_PER_NEWTON, labels=newtons)
    send(recording, f"{root}{SCENE}/{place}/force", t_ns, arrow)
    arrow = rr.Arrows3D.columns(vectors=torque * METRES_PER_NEWTON_METRE)
    send(recording, f"{root}{SCENE}/{place}/torque", t_ns, arrow)


def log_path(recording: rr.RecordingStream, root: str, position: np.ndarray, force: np.ndarray, top: float) -> None:
    """Log the path of the TCP, coloured by force.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        position: Position of the TCP at each observation, shape (N+1, 3), [m], base axes.
        force: Largest force between each observation and the next, shape (N,), [N].
        top: Force that has the brightest colour, [N].
    """
    pieces = np.stack([position[:-1], position[1:]], axis=1)  # (N, 2 ends, 3)
    shade = np.clip(force / max(top, 1e-9), 0, 1)
    stops = np.linspace(0, 1, len(PATH_COLORS))
    colors = np.stack([np.interp(shade, stops, channel) for channel in PATH_COLORS.T], axis=1).astype(np.uint8)
    recording.log(f"{root}{SCENE}/path", rr.LineStrips3D(pieces, colors=colors, radii=0.002), static=True)


def log_label(
    recording: rr.RecordingStream, root: str, t_ns: int, proprio: np.ndarray, offset: np.ndarray, direction: int
) -> None:
    """Log the label of the final observation: an arrow for the displacement, and the gripper's outline at its target.

    Args:
        recording: Recording to log to.
        root: Prefix of the episode's entities.
        t_ns: Time of the final observation, [ns].
        proprio: Proprioception at the final observation, shape (5,).
        offset: Displacement that centres the gripper, base (x, y), shape (2,), [m].
        direction: Direction class of the displacement, an index into `svfl_data.symmetry.DIRECTIONS`.
    """
    end, move = np.array([t_ns]), np.array([*offset, 0.0])
    position, quat_xyzw = gripper_poses(proprio[None])
    arrow, above = f"{root}{SCENE}/label_offset", [0.0, 0.0, WRIST_ABOVE_TCP + 0.02]  # above the gripper's top
    recording.log(arrow, rr.Arrows3D.from_fields(colors=[LABEL], radii=[0.004]), static=True)
    send(recording, arrow, end, rr.Arrows3D.columns(origins=position + above, vectors=[move]))
    target = f"{root}{SCENE}/label_target"
    words = f"move {DIRECTIONS[direction]} {np.linalg.norm(move) * 1e3:.0f} mm"
    outline = rr.Boxes3D.from_fields(colors=[LABEL], radii=[0.0007], labels=[words, "", ""], show_labels=True)
    recording.log(target, outline, static=True)
    send_boxes(recording, target, end, position + move, quat_xyzw, *gripper_boxes(proprio[None, 0]))
