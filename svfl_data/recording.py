"""An episode as a Rerun recording: what the camera saw, what the wrist felt, where the hand was and should be."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from svfl_data.blueprint import ABOUT, ACTION, CAMERA, SCENE, TIMELINE, WRENCH, arrange
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
BLOCK_HALF = (0.025, 0.025, 0.025)  # where the configuration does not say

# Okabe and Ito's palette, made to be told apart by colour-blind people. Axes x, y, z have one colour everywhere.
AXES = ((213, 94, 0), (0, 158, 115), (86, 180, 233))
FORCE, TORQUE, LABEL, BLOCK = (230, 159, 0), (204, 121, 167), (240, 228, 66), (0, 114, 178)
GREY = (150, 150, 150)


def recording_bytes(episode: Episode) -> bytes:
    """The episode, with the arrangement of the viewer's window, as the content of an ``.rrd`` file."""
    recording = rr.RecordingStream("svfl")
    memory = recording.memory_recording()
    recording.send_blueprint(arrange(episode))
    recording.send_recording_name(f"{episode.meta.task} {episode.meta.index}")
    _log_camera(recording, episode)
    _log_surroundings(recording, episode)
    _log_hand(recording, episode)
    _log_wrench(recording, episode)
    _log_action(recording, episode)
    if "label_offset" in episode.arrays:
        _log_label(recording, episode)
    recording.log(ABOUT, rr.TextDocument(about(episode), media_type=rr.MediaType.MARKDOWN), static=True)
    return memory.drain_as_bytes()


def _send(recording: rr.RecordingStream, path: str, t_ns: np.ndarray, *columns: rr.ComponentColumnList) -> None:
    """Log a whole stream at once: row k of every column at time `t_ns[k]` of the episode clock."""
    clock = rr.TimeColumn(TIMELINE, duration=t_ns.astype("timedelta64[ns]"))
    recording.send_columns(path, [clock], [column for group in columns for column in group])


def _log_camera(recording: rr.RecordingStream, episode: Episode) -> None:
    height, width = episode.depth.shape[1:]
    intrinsics = np.array(episode.intrinsics)
    intrinsics[:2, 2] += 0.5  # Rerun's origin is the corner of the top left pixel, ours its centre
    pose = episode.T_base_camera
    recording.log(CAMERA, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    recording.log(
        CAMERA,
        rr.Pinhole(
            image_from_camera=intrinsics, resolution=[width, height], camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.12, color=GREY,
        ),
        static=True,
    )  # fmt: skip
    color_format = rr.components.ImageFormat(width=width, height=height, color_model="RGB", channel_datatype="U8")
    recording.log(f"{CAMERA}/color", rr.Image.from_fields(format=color_format), static=True)
    rows = len(episode.t_ns)
    _send(recording, f"{CAMERA}/color", episode.t_ns, rr.Image.columns(buffer=episode.color.reshape(rows, -1)))

    measured = episode.depth[episode.depth > 0]
    near, far = np.percentile(measured, [1, 99]) if measured.size else (0, 1)
    depth = rr.DepthImage.from_fields(
        format=rr.components.ImageFormat(width=width, height=height, channel_datatype="U16"),
        meter=1 / float(episode.depth_scale), colormap="viridis", depth_range=(near, far),
    )  # fmt: skip
    recording.log(f"{CAMERA}/depth", depth, static=True)
    buffer = np.ascontiguousarray(episode.depth).view(np.uint8).reshape(rows, -1)
    _send(recording, f"{CAMERA}/depth", episode.t_ns, rr.DepthImage.columns(buffer=buffer))


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
    if "object_pose" in episode.arrays:
        pose = episode.object_pose
        block = rr.Boxes3D(half_sizes=[block_half_size(episode) or BLOCK_HALF], colors=BLOCK, fill_mode="solid")
        recording.log(f"{SCENE}/block", block, static=True)
        moving = rr.Transform3D.columns(translation=pose[:, :3], quaternion=pose[:, 3:])
        _send(recording, f"{SCENE}/block", episode.t_ns, moving)


def block_half_size(episode: Episode) -> Sequence[float] | None:
    """Half the block's edges, shape (3,), [m], if the configuration says it: ``config["block"]["half_extents"]``."""
    block = episode.meta.config.get("block")
    return block.get("half_extents") if isinstance(block, dict) else None


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
        Centres, shape (N, 3 boxes, 3), and half sizes, shape (3 boxes, 3), [m], in the hand's frame.
    """
    centres = np.zeros((len(opening), 3, 3))
    centres[:, 0] = PALM_CENTRE
    centres[:, 1:, 1] = np.multiply.outer(opening * FINGER_TRAVEL + FINGER_HALF[1], [1.0, -1.0])
    centres[:, 1:, 2] = FINGER_Z
    return centres, np.array([PALM_HALF, FINGER_HALF, FINGER_HALF])


def _log_hand(recording: rr.RecordingStream, episode: Episode) -> None:
    position, quat_xyzw = hand_poses(episode.proprio)
    centres, half_sizes = hand_boxes(episode.proprio[:, 0])
    path = f"{SCENE}/hand"
    hand = rr.Boxes3D.from_fields(half_sizes=half_sizes, colors=[(200, 200, 200)], fill_mode="solid")
    recording.log(path, hand, static=True)
    boxes = rr.Boxes3D.columns(centers=centres.reshape(-1, 3)).partition([3] * len(centres))
    _send(recording, path, episode.t_ns, rr.Transform3D.columns(translation=position, quaternion=quat_xyzw), boxes)
    recording.log(f"{SCENE}/path", rr.LineStrips3D([position], colors=GREY, radii=0.001), static=True)


def _log_wrench(recording: rr.RecordingStream, episode: Episode) -> None:
    force, torque = np.split(episode.tared_wrench, 2, axis=1)
    wrist = episode.proprio[:, 1:4] + [0.0, 0.0, WRIST_ABOVE_TCP]
    _send(recording, f"{SCENE}/wrist", episode.t_ns, rr.Transform3D.columns(translation=wrist))
    for name, symbol, values, unit, scale, color in (
        ("force", "f", force, "N", METRES_PER_NEWTON, FORCE),
        ("torque", "m", torque, "N m", METRES_PER_NEWTON_METRE, TORQUE),
    ):
        lines = rr.SeriesLines(names=[f"{symbol}{axis}, {unit}" for axis in "xyz"], colors=AXES, widths=1.5)
        recording.log(f"{WRENCH}/{name}", lines, static=True)
        _send(recording, f"{WRENCH}/{name}", episode.wrench_t_ns, rr.Scalars.columns(scalars=values))
        size = np.linalg.norm(values, axis=1)
        arrow = f"{SCENE}/wrist/{name}"
        labels = [f"{name} {value:.1f} {unit}" for value in size]
        arrows = rr.Arrows3D.from_fields(
            colors=[color], radii=[0.004], show_labels=name == "force"
        )  # one text is enough
        recording.log(arrow, arrows, static=True)
        _send(recording, arrow, episode.wrench_t_ns, rr.Arrows3D.columns(vectors=values * scale, labels=labels))


def _log_action(recording: rr.RecordingStream, episode: Episode) -> None:
    t_ns = episode.t_ns[:-1]  # each is commanded right after its observation and held until the next
    for name, index, names, colors in (
        ("displacement", [1, 2, 3], ["dx, m", "dy, m", "dz, m"], AXES),
        ("opening_and_turn", [0, 4], ["opening, 0 to 1", "dtheta, rad"], (FORCE, TORQUE)),
    ):
        lines = rr.SeriesLines(names=names, colors=colors, widths=1.5, interpolation_mode="StepAfter")
        recording.log(f"{ACTION}/{name}", lines, static=True)
        _send(recording, f"{ACTION}/{name}", t_ns, rr.Scalars.columns(scalars=episode.action[:, index]))


def _log_label(recording: rr.RecordingStream, episode: Episode) -> None:
    """The label belongs to the final observation: an arrow from the hand to its outline where it must go."""
    end, offset = episode.t_ns[-1:], np.array([*episode.label_offset, 0.0])
    position, quat_xyzw = hand_poses(episode.proprio[-1:])
    centres, half_sizes = hand_boxes(episode.proprio[-1:, 0])
    words = f"move {DIRECTIONS[int(episode.label_direction)]} {np.linalg.norm(offset) * 1e3:.0f} mm"

    arrow, above = f"{SCENE}/label_offset", [0.0, 0.0, WRIST_ABOVE_TCP + 0.02]  # the hand's top would hide it
    recording.log(arrow, rr.Arrows3D.from_fields(colors=[LABEL], radii=[0.004]), static=True)
    _send(recording, arrow, end, rr.Arrows3D.columns(origins=position + above, vectors=[offset]))

    target = f"{SCENE}/label_target"
    outline = rr.Boxes3D.from_fields(
        half_sizes=half_sizes, colors=[LABEL], radii=[0.0007], labels=[words, "", ""], show_labels=True
    )
    recording.log(target, outline, static=True)
    pose = rr.Transform3D.columns(translation=position + offset, quaternion=quat_xyzw)
    _send(recording, target, end, pose, rr.Boxes3D.columns(centers=centres[0]).partition([3]))


def about(episode: Episode) -> str:
    """What a person should know before looking, in Markdown."""
    meta = episode.meta
    seconds = (episode.t_ns[-1] - episode.t_ns[0]) / 1e9
    size = "" if block_half_size(episode) else " (size not recorded, drawn as a 5 cm cube)"
    versions = ", ".join(f"{name} {version}" for name, version in meta.software.items())
    lines = [
        f"**Origin:** seed {meta.seed}, source {meta.source}, {len(episode)} steps, {seconds:.2f} s; "
        f"recorded with {versions or 'unknown software'}.",
    ]
    if "label_offset" in episode.arrays:
        dx, dy = episode.label_offset * 1e3
        direction = DIRECTIONS[int(episode.label_direction)]
        lines.append(
            f"**Label:** the hand must move **{direction}** as the image shows it; exactly "
            f"({dx:+.1f}, {dy:+.1f}) mm along base x, y."
        )
    lines += [
        f"**Scene:** hand grey, block blue{size}, label yellow (the outline is where the hand must go).",
        f"**Arrows at the wrist:** force orange, {METRES_PER_NEWTON * 1e3:.0f} mm per N; "
        f"torque pink, {METRES_PER_NEWTON_METRE * 1e3:.0f} mm per N m.",
        "**Wrench:** load of the surroundings on the hand in base axes, torque about the sensor origin; "
        f"{_stream_words(episode)}",
        f"**Tare** (subtracted): {_vector_words(episode.tare[:3])} N, {_vector_words(episode.tare[3:])} N m.",
    ]
    title = f"## {meta.task}, episode {meta.index}: {'success' if meta.success else 'no success'}\n\n"
    return title + "\n".join(f"- {line}" for line in lines)


def _stream_words(episode: Episode) -> str:
    t_ns, force = episode.wrench_t_ns, np.linalg.norm(episode.tared_wrench[:, :3], axis=1)
    if len(t_ns) < 2:
        return f"{len(t_ns)} readings."
    rate = 1e9 / float(np.median(np.diff(t_ns)))
    peak = int(force.argmax())
    return f"{len(t_ns)} readings at {rate:.0f} Hz; largest force {force[peak]:.1f} N at {t_ns[peak] / 1e9:.3f} s."


def _vector_words(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.2f}" for value in vector) + ")"
