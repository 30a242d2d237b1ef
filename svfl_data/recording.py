"""An episode as a Rerun recording: what the camera saw, what the wrist felt, where the hand was and should be."""

import numpy as np
import rerun as rr

from svfl_data.blueprint import ABOUT, ACTION, CAMERAS, WRENCH, arrange
from svfl_data.episode import Camera, Episode
from svfl_data.scene import (
    AXES,
    FORCE,
    GREY,
    METRES_PER_NEWTON,
    METRES_PER_NEWTON_METRE,
    TORQUE,
    log_scene,
    send_stream,
)
from svfl_data.symmetry import DIRECTIONS


def recording_bytes(episode: Episode) -> bytes:
    """The episode, with the arrangement of the viewer's window, as the content of an ``.rrd`` file."""
    recording = rr.RecordingStream("svfl")
    memory = recording.memory_recording()
    recording.send_blueprint(arrange(episode))
    recording.send_recording_name(f"{episode.meta.task} {episode.meta.index}")
    for camera in episode.cameras.values():
        _log_camera(recording, camera)
    log_scene(recording, episode)
    _log_wrench(recording, episode)
    _log_action(recording, episode)
    recording.log(ABOUT, rr.TextDocument(about(episode), media_type=rr.MediaType.MARKDOWN), static=True)
    return memory.drain_as_bytes()


def _log_camera(recording: rr.RecordingStream, camera: Camera) -> None:
    entity = f"{CAMERAS}/{camera.name}"
    rows, height, width = camera.color.shape[:3]
    intrinsics = np.array(camera.intrinsics)
    intrinsics[:2, 2] += 0.5  # Rerun's origin is the corner of the top left pixel, ours its centre
    pose = camera.T_base_camera
    recording.log(entity, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), static=True)
    recording.log(
        entity,
        rr.Pinhole(
            image_from_camera=intrinsics, resolution=[width, height], camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.12, color=GREY,
        ),
        static=True,
    )  # fmt: skip
    color_format = rr.components.ImageFormat(width=width, height=height, color_model="RGB", channel_datatype="U8")
    recording.log(f"{entity}/color", rr.Image.from_fields(format=color_format), static=True)
    send_stream(recording, f"{entity}/color", camera.t_ns, rr.Image.columns(buffer=camera.color.reshape(rows, -1)))
    if camera.has("depth"):
        _log_depth(recording, f"{entity}/depth", camera)


def _log_depth(recording: rr.RecordingStream, entity: str, camera: Camera) -> None:
    rows, height, width = camera.depth.shape
    measured = camera.depth[camera.depth > 0]
    near, far = np.percentile(measured, [1, 99]) if measured.size else (0, 1)
    depth = rr.DepthImage.from_fields(
        format=rr.components.ImageFormat(width=width, height=height, channel_datatype="U16"),
        meter=1 / float(camera.depth_scale), colormap="viridis", depth_range=(near, far),
    )  # fmt: skip
    recording.log(entity, depth, static=True)
    buffer = np.ascontiguousarray(camera.depth).view(np.uint8).reshape(rows, -1)
    send_stream(recording, entity, camera.t_ns, rr.DepthImage.columns(buffer=buffer))


def _log_wrench(recording: rr.RecordingStream, episode: Episode) -> None:
    force, torque = np.split(episode.tared_wrench, 2, axis=1)
    for name, values, names in (
        ("force", force, ["fx, N", "fy, N", "fz, N"]),
        ("torque", torque, ["mx, N m", "my, N m", "mz, N m"]),
    ):
        recording.log(f"{WRENCH}/{name}", rr.SeriesLines(names=names, colors=AXES, widths=1.5), static=True)
        send_stream(recording, f"{WRENCH}/{name}", episode.wrench_t_ns, rr.Scalars.columns(scalars=values))


def _log_action(recording: rr.RecordingStream, episode: Episode) -> None:
    t_ns = episode.t_ns[:-1]  # each is commanded right after its observation and held until the next
    for name, index, names, colors in (
        ("displacement", [1, 2, 3], ["dx, m", "dy, m", "dz, m"], AXES),
        ("opening_and_turn", [0, 4], ["opening, 0 to 1", "dtheta, rad"], (FORCE, TORQUE)),
    ):
        lines = rr.SeriesLines(names=names, colors=colors, widths=1.5, interpolation_mode="StepAfter")
        recording.log(f"{ACTION}/{name}", lines, static=True)
        send_stream(recording, f"{ACTION}/{name}", t_ns, rr.Scalars.columns(scalars=episode.action[:, index]))


def about(episode: Episode) -> str:
    """What a person should know before looking, in Markdown."""
    meta = episode.meta
    seconds = (episode.t_ns[-1] - episode.t_ns[0]) / 1e9
    size = "" if episode.has("object_half") else " (size not recorded, drawn as a 5 cm cube)"
    versions = ", ".join(f"{name} {version}" for name, version in meta.software.items())
    lines = [
        f"**Origin:** seed {meta.seed}, source {meta.source}, {len(episode)} steps, {seconds:.2f} s; "
        f"recorded with {versions or 'unknown software'}.",
    ]
    if episode.has("label_offset"):
        dx, dy = episode.label_offset * 1e3
        direction = DIRECTIONS[int(episode.label_direction)]
        lines.append(
            f"**Label:** the hand must move **{direction}** as the image shows it; exactly "
            f"({dx:+.1f}, {dy:+.1f}) mm along base x, y."
        )
    lines += [
        f"**Scene:** hand grey, block blue{size}, label yellow (the outline is where the hand must go); "
        "zoom out to see the camera.",
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
