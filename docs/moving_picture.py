"""Film an episode of block centering in the viewer, with force arrow, wrench and a network's prediction, as WebP.

.venv/bin/python docs/moving_picture.py data/centering --episode 0 --checkpoint out/centering/checkpoint.ckpt

The episode is one of the test split of that training. Rerun draws without a window and without a graphics card where
Vulkan is (Debian: mesa-vulkan-drivers).
"""

import argparse
import io
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient

from svfl_data import open_dataset
from svfl_data.viewer.entities import names
from svfl_data.viewer.entities.episode_source import PROPRIO, TIMES, EpisodeSource
from svfl_data.viewer.predictions import Prediction, load
from svfl_data.viewer.recording import Summary, log_episode
from svfl_data.viewer.show import save
from svfl_data.viewer.views import COLORS, DARK, pictures, plot, wrench_plot

WIDTH, HEIGHT = 800, 540
EYE, TARGET = np.array([0.26, -0.34, 0.18]), np.array([0.0, 0.0, 0.07])
"""Places of the eye and of what it looks at, relative to the gripper at the end of the episode, [m]."""
HIDDEN = ("workspace", "cameras/**", "path/**")
FRAMES_A_STEP, FRAME_MS, LAST_MS, QUALITY = 2, 160, 2500, 80
"""Frames between two observations; how long a frame and the last one are shown, slower than the 50 ms of a step."""
LOADING_S, TOASTS_S, TRIES = 120.0, 20.0, 8
"""Longest time until the viewer has loaded, how long its first messages stay, and pictures until one stays the same."""
TOP_BAR = 36
"""Height of the empty bar at the top, [px]."""


def layout(shown: EpisodeSource, summary: Summary, prediction: Prediction) -> rrb.Blueprint:
    """Return the layout of a small window: scene and camera on the left, three plots on the right.

    Args:
        shown: Episode that is shown.
        summary: What was found while it was logged.
        prediction: What a classifier of directions says of it.
    """
    gripper, low, high = shown[PROPRIO][-1, 1:4].astype(float), summary.loads.low, summary.loads.high
    scene = rrb.Spatial3DView(
        origin=names.SCENE,
        contents=["$origin/**", *(f"- $origin/{name}" for name in HIDDEN)],
        name="Orange: force at the wrist",
        background=DARK,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=gripper + EYE, look_target=gripper + TARGET, eye_up=(0.0, 0.0, 1.0)),
    )
    plots = [
        wrench_plot(shown, names.FORCE_PLOT, f"Force, N: {COLORS}", low[:3], high[:3]),
        wrench_plot(shown, names.TORQUE_PLOT, f"Torque, N m: {COLORS}", low[3:], high[3:]),
        plot(shown, [f"{names.PREDICTION}/probability"], "Network: probability", np.zeros(1), np.ones(1)),
    ]
    colour, *_, seen = pictures(shown, prediction)
    seen.name = "as seen"
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, rrb.Horizontal(colour, seen), row_shares=[3, 2]),
            rrb.Vertical(*plots, row_shares=[4, 4, 5]),
            column_shares=[1, 1],
        ),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="hidden"),
    )


def frames(recording: Path, times_s: np.ndarray, port: int) -> Iterator[Image.Image]:
    """Yield what the viewer shows of a recording.

    Args:
        recording: File of the recording.
        times_s: Times of the frames on the clock of the episode, [s].
        port: Port for the viewer to listen on.
    """
    command = [sys.executable, "-m", "rerun", "--headless", "--window-size", f"{WIDTH}x{HEIGHT}"]
    command += ["--bind", "127.0.0.1", "--port", str(port), str(recording)]
    # Rerun's Python program starts the viewer as a child process; one process group lets both be ended together.
    with subprocess.Popen(command, start_new_session=True) as viewer:
        try:
            client = loaded(f"rerun+http://127.0.0.1:{port}/proxy", times_s[-1])
            until = time.monotonic() + TOASTS_S
            while time.monotonic() < until:
                still(client)
            for at in times_s:
                client.set_time(names.TIMELINE, duration=float(at), play_state="paused")
                picture = Image.open(io.BytesIO(still(client))).convert("RGB")
                yield picture.crop((0, TOP_BAR, *picture.size))
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)


def loaded(address: str, last_s: float) -> ViewerClient:
    """Return a connection to the viewer once it shows a recording until a time, [s]."""
    until = time.monotonic() + LOADING_S
    while time.monotonic() < until:
        with suppress(OSError, RuntimeError):
            client = ViewerClient.connect(address)
            timelines = [one for recording in client.get_state().recordings for one in recording.timelines]
            if any(one.name == names.TIMELINE and one.end >= last_s * 1e9 for one in timelines):
                return client
        time.sleep(1.0)
    raise SystemExit(f"the viewer did not load the recording within {LOADING_S:.0f} s")


def still(client: ViewerClient) -> bytes:
    """Return a picture as PNG once the viewer has drawn the same one twice; a slow renderer may miss the first ones."""
    last = b""
    for _ in range(TRIES):
        with suppress(OSError, RuntimeError):
            picture = client.take_screenshot()
            if picture == last:
                return picture
            last = picture
    raise SystemExit(f"the viewer did not draw the same picture twice in {TRIES} tries")


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--episode", type=int, default=0)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--port", type=int, default=9877)
    parser.add_argument("--out", type=Path, default=Path("docs/images/moving_episode.webp"))
    asked = parser.parse_args()
    dataset = open_dataset(asked.data)
    prediction = load(asked.checkpoint)(dataset.read(asked.episode))
    shown = EpisodeSource.of(dataset.episode(asked.episode))

    def content(recording: rr.RecordingStream) -> None:
        summary = log_episode(recording, shown, prediction)
        bare = rr.Arrows3D.from_fields(radii=[0.006], show_labels=False)  # a number would cover the arrow
        recording.log(f"{names.SCENE}/wrist/force", bare, static=True)
        recording.send_blueprint(layout(shown, summary, prediction))

    t_s = shown[TIMES] / 1e9
    times_s = np.linspace(t_s[0], t_s[-1], FRAMES_A_STEP * len(shown) + 1)
    with tempfile.TemporaryDirectory() as folder:
        save(content, Path(folder) / "episode.rrd")
        first, *others = frames(Path(folder) / "episode.rrd", times_s, asked.port)
    lasts = [FRAME_MS] * len(others) + [LAST_MS]
    first.save(asked.out, save_all=True, append_images=others, duration=lasts, loop=0, quality=QUALITY, method=4)


if __name__ == "__main__":
    main()
