"""``svfl-collect calibrate``: estimate the pose of a camera from pictures of a board of tags."""

import argparse
from collections.abc import Callable
from pathlib import Path

from svfl_data.commands.arguments import add_episode
from svfl_data.system.command_line import Commands, add_json, between, report

DOUBTFUL_PX, WRONG_PX = 1.0, 5.0  # [px] root mean square reprojection error above which a result is doubtful, or wrong
CAUSES = "another board's file, poses of other pictures, wrong intrinsics, or a bent tag"


def add(commands: Commands) -> None:
    """Add ``calibrate`` to the commands of the command line."""
    parser = commands.add_parser(
        "calibrate",
        help="estimate the pose of a camera from pictures of a board of AprilTags",
        description="Estimate the pose of a camera in base axes, and its uncertainty, from pictures of a board of tags "
        "(svfl-collect tags --board). Either the board has one known pose (--board-pose), or a known pose in each "
        "picture (--board-poses), or the gripper holds the board and the poses of the gripper are known "
        "(--gripper-poses); the gripper must then be tilted differently between the pictures. The pictures must have "
        "no lens distortion. The result is added to the calibration file, which collectors read.",
        example="svfl-collect calibrate pictures/ --layout board.json --intrinsics 605.2,604.8,319.5,239.5 \\\n"
        "    --board-pose 0.45,-0.1,0,90 --camera front --out calibration.json\n"
        "svfl-collect calibrate pictures/ --layout board.json --intrinsics 605.2,604.8,319.5,239.5 \\\n"
        "    --gripper-poses poses.csv --camera front --out calibration.json\n"
        "svfl-collect calibrate data/boards --episode 0 --layout board.json --board-pose 0.45,-0.1,0,90 \\\n"
        "    --camera front --out calibration.json",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="folder of pictures, dataset folder, or episode file (.hdf5)"
    )
    add_episode(parser)
    parser.add_argument(
        "--layout", type=Path, required=True, metavar="FILE",
        help="JSON file of the board, written by svfl-collect tags --board",
    )  # fmt: skip
    parser.add_argument(
        "--printed", type=between(50, 200, "a length in mm"), default=100.0, metavar="MM",
        help="measured length of the 100 mm line on the printed page, mm, between 50 and 200 (default: %(default)g)",
    )  # fmt: skip
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument(
        "--board-pose", type=_numbers(4), metavar="X,Y,Z,DEG",
        help="pose of a board that lies face up: position of its lower left corner in base axes, m, and yaw of its x "
        "axis, deg; if X is negative, write --board-pose=X,Y,Z,DEG",
    )  # fmt: skip
    place.add_argument(
        "--board-poses", type=Path, metavar="CSV",
        help="file with the pose of the board in each picture, in base axes: columns picture,x,y,z,qx,qy,qz,qw, with "
        "x, y, z in m",
    )  # fmt: skip
    place.add_argument(
        "--gripper-poses", type=Path, metavar="CSV",
        help="file with the pose of the gripper that holds the board, in each picture: columns as for --board-poses",
    )  # fmt: skip
    parser.add_argument(
        "--intrinsics", type=_numbers(4), metavar="FX,FY,CX,CY",
        help="focal lengths and principal point of the camera, px, where the centre of the first pixel is 0,0; "
        "required for a folder of pictures (default: those of the episode)",
    )  # fmt: skip
    parser.add_argument(
        "--depth-scale", type=between(1e-6, 1, "a length in m"), metavar="M",
        help="length of one unit of the camera's depth values, m, between 1e-6 and 1 (default: that of the episode, or "
        "0.001)",
    )  # fmt: skip
    parser.add_argument(
        "--camera", default="front", metavar="NAME", help="camera whose pose is estimated (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE",
        help="file to write, the calibration as JSON; the camera is added to an existing file",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Estimate the camera's pose, print the residuals, and write the calibration file.

    Args:
        arguments: Parsed options of the command.

    Raises:
        UsageError: If the options do not fit together.
        CollectError: If the board is seen in too few pictures, the pictures do not determine the camera's pose, or the
            reprojection error is too large.
    """
    import numpy as np

    from collectors.apriltags.calibration import write_calibration
    from collectors.apriltags.calibration_pictures import board_pose, of_episode, of_folder, read_poses
    from collectors.apriltags.detector import MEASURE, TagDetector
    from collectors.apriltags.extrinsics import from_gripper_held_board, from_known_board, view
    from collectors.apriltags.layout import Layout
    from svfl_data.errors import CollectError, UsageError
    from svfl_data.schema.robot import Calibration, image_axes
    from svfl_data.system.progress import progress

    board = Layout.read(arguments.layout).scaled(arguments.printed / 100.0)
    folder = arguments.path.is_dir() and arguments.episode is None and not (arguments.path / "dataset.json").exists()
    source = of_folder(arguments) if folder else of_episode(arguments)
    detector = TagDetector(board.family, find=MEASURE)  # finds small tags too; time does not matter here
    looks = progress(source.checked(), "looking for the board", len(source.pictures))
    found = [view(name, picture, board, source.intrinsics, detector) for name, picture in looks]
    views = [one for one in found if one is not None]
    if not views:
        ids = ", ".join(map(str, board.tags))
        raise CollectError(f"{arguments.path}: tags {ids} of {board.family} are in none of {len(found)} pictures")
    if arguments.board_pose:
        result = from_known_board(views, [board_pose(*arguments.board_pose)] * len(views), source.intrinsics)
    else:
        file = arguments.board_poses or arguments.gripper_poses
        poses = read_poses(file)
        if missing := [one.name for one in views if one.name not in poses]:
            raise UsageError(f"{file}: no row for {missing[0]}; it has {', '.join(list(poses)[:5])}")
        estimate = from_known_board if arguments.board_poses else from_gripper_held_board
        result = estimate(views, [poses[one.name] for one in views], source.intrinsics)
    lines = [f"  {name:<28} {error:6.2f} px" for name, error in result.errors.items()]
    lines.append(f"board seen in {len(views)} of {len(found)} pictures; error {result.error:.2f} px (root mean square)")
    if not result.error <= WRONG_PX:  # also refuses an error that is not a number
        report(arguments.json, {"file": None, "error_px": result.error, "pictures": result.errors}, *lines)
        raise CollectError(
            f"error {result.error:.1f} px, but at most {WRONG_PX:g} px is accepted; possible causes: {CAUSES}; no file "
            "is written"
        )
    if result.error > DOUBTFUL_PX:
        lines.append(f"  an error above {DOUBTFUL_PX:g} px is doubtful; possible causes: {CAUSES}")
    place, turn = result.position_deviation * 1e3, np.degrees(result.rotation_deviation)
    where = result.T_base_camera[:3, 3]
    lines.append(f"camera at x, y, z = {where[0]:.4f}, {where[1]:.4f}, {where[2]:.4f} m")
    lines.append(f"  standard deviation {place[0]:.2f}, {place[1]:.2f}, {place[2]:.2f} mm, turn {turn.max():.3f} deg")
    residuals = {
        "pictures": result.errors,
        "error_px": result.error,
        "position_deviation_m": result.position_deviation.tolist(),
        "rotation_deviation_rad": result.rotation_deviation.tolist(),
    } | ({} if result.T_gripper_board is None else {"T_gripper_board": result.T_gripper_board.tolist()})
    calibration = Calibration(
        source.intrinsics, result.T_base_camera, image_axes(result.T_base_camera), source.depth_scale
    )
    write_calibration(arguments.out, arguments.camera, calibration, residuals)
    facts = {"file": arguments.out, "camera": arguments.camera, "T_base_camera": result.T_base_camera} | residuals
    report(arguments.json, facts, *lines, f"{arguments.out}: camera {arguments.camera}")


def _numbers(count: int) -> Callable[[str], tuple[float, ...]]:
    """Return an argument type that accepts `count` numbers below 1e6 in absolute value, with commas between them."""

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(abs(value) < 1e6 for value in values):
            raise argparse.ArgumentTypeError(f"{text!r} is not {count} numbers with commas between them")
        return values

    return parse
