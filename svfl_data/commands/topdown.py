"""``svfl-data topdown``: draw one step of an episode as seen from straight above."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from svfl_data.commands.arguments import add_episode, add_path
from svfl_data.commands.source import read
from svfl_data.errors import UsageError
from svfl_data.schema.episode import Episode
from svfl_data.signals.top_view import SIZE
from svfl_data.signals.topdown import TopDown, latest_frame, topdown
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.command_line import Commands, add_json, natural, positive, report
from svfl_data.system.printable import printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANEL_IN = 3.6
HIDDEN = "#cc79a7"  # colour of areas that no camera saw; neither the table nor the scale of heights has this colour


def add(commands: Commands) -> None:
    """Add the command ``topdown`` and its arguments to the command line."""
    parser = commands.add_parser(
        "topdown",
        help="draw one step of an episode as seen from straight above the workspace",
        description="Draw one step of an episode and write the picture as a PNG file. It shows the images of the "
        "cameras, and the colour and height of the workspace as seen from straight above, computed from all cameras "
        "that have depth.",
        example="svfl-data topdown data/centering --episode 3 --out above.png",
    )
    add_path(parser)
    add_episode(parser)
    parser.add_argument(
        "--step", type=natural, metavar="T",
        help="number of the observation, from 0 to the number of steps of the episode (default: the last one)",
    )  # fmt: skip
    parser.add_argument(
        "--image-size", type=positive, default=SIZE, metavar="PX",
        help="height and width of the view from above, px (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.png",
        help="file to write, a PNG picture; its name ends in .png",
    )
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Draw the picture and write it to a PNG file."""
    if arguments.out.suffix != ".png":
        raise UsageError(f"--out {arguments.out}: the name must end in .png")
    from svfl_data.reports.plot import png

    episode = read(arguments.path, arguments.episode)
    step = len(episode) if arguments.step is None else arguments.step
    seen = topdown(episode, step, size=arguments.image_size)
    write_atomically(arguments.out, png(_figure(episode, step, seen)))
    share = float((seen.depth > 0).mean())
    facts = {"file": arguments.out, "step": step, "seen": share}
    report(arguments.json, facts, f"wrote {arguments.out}: {share:.1%} of the square was seen")


def _figure(episode: Episode, step: int, seen: TopDown) -> "Figure":
    """Draw the cameras' latest images, then colour and height from above with scales in mm and the TCP as a cross."""
    from matplotlib.figure import Figure

    frames = [(camera, latest_frame(episode, camera, step)) for camera in episode.cameras.values()]
    frames = [(camera, row) for camera, row in frames if row is not None]
    figure = Figure(figsize=(PANEL_IN * (len(frames) + 2.3), PANEL_IN + 0.6), layout="constrained")
    axes = figure.subplots(1, len(frames) + 2, squeeze=False)[0]
    for axis, (camera, row) in zip(axes, frames, strict=False):
        axis.imshow(camera.color[row])
        axis.set_title(printable(f"camera {camera.name}", 60), fontsize=9, parse_math=False)
        axis.set_axis_off()
    view, edge = seen.view, 500 * seen.view.extent
    tcp = view.pixel(episode.proprio[step, 1:3])[::-1] + 0.5  # (right, down) from the upper left corner, px
    right, down = tcp * view.metres_per_pixel * 1e3 - edge
    hidden = seen.depth == 0
    color, height = axes[-2:]
    color.imshow(np.where(hidden[..., None], _rgb(HIDDEN), seen.color), extent=(-edge, edge, -edge, edge))
    heights = height.imshow(np.ma.masked_invalid(seen.height_m * 1e3), extent=(-edge, edge, -edge, edge))
    height.set_facecolor(HIDDEN)
    figure.colorbar(heights, ax=height, label="height above base z = 0, mm", shrink=0.8)
    for axis, title in ((color, "colour"), (height, "height")):
        axis.plot(right, -down, "+", color="black", markersize=9)
        axis.set(
            title=f"{title} from above", xlabel="right, mm", ylabel="up, mm", xlim=(-edge, edge), ylim=(-edge, edge)
        )
        axis.title.set_fontsize(9)
    figure.suptitle(
        f"{printable(episode.meta.task)}, episode {episode.meta.index}, step {step} of {len(episode)}: "
        f"{view.metres_per_pixel * 1e3:.1f} mm per pixel; + TCP; pink: hidden from the cameras",
        fontsize=10, parse_math=False,  # a dollar sign in a name must not start a formula
    )  # fmt: skip
    return figure


def _rgb(color: str) -> np.ndarray:
    """Return the three bytes of a colour written as #rrggbb."""
    return np.frombuffer(bytes.fromhex(color[1:]), np.uint8)
