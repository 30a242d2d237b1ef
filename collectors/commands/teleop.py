"""``svfl-collect teleop``: record demonstrations by a person."""

import argparse
from pathlib import Path

from collectors.commands.options import ANY, add_rerun, add_world, real_robot, tell_datasets, world
from collectors.tasks import TASKS, task_class
from collectors.teleop.devices.by_name import DEVICES, SCRIPT, check_device, open_device
from svfl_data.system.command_line import Commands, add_json, between, complete_with, natural, positive
from svfl_data.system.printable import say
from svfl_data.system.progress import progress_line


def add(commands: Commands) -> None:
    """Add ``teleop`` to the commands of the command line."""
    parser = commands.add_parser(
        "teleop",
        help="record demonstrations by a person with keyboard, gamepad or SpaceMouse",
        description="Open a window with the picture of the first camera, in which a person moves the gripper, and "
        "record demonstrations, in simulation at 20 Hz or on a robot at its own rate. The window shows the keys. A "
        "simulated episode ends by itself when the task is achieved. The same command adds episodes to those of "
        "earlier sessions. The device script repeats the inputs of a log file without a window, as fast as possible "
        "(docs/teleoperation.md).",
        example="svfl-collect teleop --task block_picking --input-device keyboard --out data/mine\n"
        "svfl-collect teleop --task peg_insertion --input-device gamepad --operator ada --log ada.log --out data/pegs\n"
        "svfl-collect teleop --task peg_insertion --input-device script ada.log --out data/pegs_again\n"
        "svfl-collect teleop --task wiping --robot my_arm --input-device spacemouse --out data/wiped",
    )
    task = parser.add_argument(
        "--task", required=True, metavar="TASK",
        help=f"task: {', '.join(TASKS)}; or any name, with a robot that is not simulated",
    )  # fmt: skip
    complete_with(task, lambda: TASKS)
    device = parser.add_argument(
        "--input-device", nargs="+", required=True, metavar=("DEVICE", "FILE"),
        help=f"input device: {', '.join(DEVICES)}, or {SCRIPT} followed by a FILE that --log has written",
    )  # fmt: skip
    complete_with(device, lambda: [*DEVICES, SCRIPT])
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FOLDER",
        help="folder to write the dataset to; a dataset of the same command in it is continued",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=natural, default=0, metavar="S", help="seed of the dataset, at least 0 (default: %(default)s)"
    )
    parser.add_argument(
        "--pace", type=between(0.05, 1, "a number"), default=0.5, metavar="X",
        help="largest speed of the gripper as a fraction of full speed, which follows from the bounds of the action "
        "(in simulation 0.5 m/s); between 0.05 and 1 (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--seconds", type=positive, default=120, metavar="N",
        help="longest duration of an episode, s, an integer of at least 1 (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--operator", metavar="ID", help="name of the person, which is stored in the episodes (default: none is stored)"
    )
    parser.add_argument(
        "--log", type=Path, metavar="FILE",
        help="file to write all inputs of the device to, for --input-device script (default: none)",
    )  # fmt: skip
    add_rerun(parser)
    add_world(parser, ANY)
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Open the screen and the device, and record demonstrations."""
    check_device(arguments.input_device)
    robot = real_robot(arguments)
    if robot is None:
        task_class(arguments.task)
    from collectors.recording.live_view import viewer
    from collectors.teleop.clock import Clock
    from collectors.teleop.devices.script import InputLog
    from collectors.teleop.screen import NoScreen, Screen
    from collectors.teleop.session import Session
    from collectors.teleop.setting import RobotTeleoperation, Setting, Teleoperation
    from svfl_data.datasets.dataset import Dataset

    if arguments.rerun:
        viewer(arguments.rerun)  # an error in the viewer is reported before a window opens
    seed, task = arguments.seed, arguments.task
    what: Setting = RobotTeleoperation(seed, task, robot) if robot else Teleoperation(seed, task, world(arguments))
    screen: Screen = NoScreen()
    scripted = arguments.input_device[0] == SCRIPT
    if not scripted:
        from collectors.teleop.window import Window

        screen = Window()
    device = log = None
    try:
        device = open_device(arguments.input_device)
        screen.present(device)
        dataset = Dataset.create_or_resume(arguments.out, task, seed, what.config())
        if arguments.log:
            log = InputLog(arguments.log, device=device.name, task=task, seed=seed)
        about = {"operator": arguments.operator} if arguments.operator else {}
        rate_hz = what.opened.rate_hz
        steps = round(rate_hz * arguments.seconds)
        clock, pace = Clock(not scripted, period_ns=round(1e9 / rate_hz)), arguments.pace
        tell = progress_line if arguments.json else say
        session = Session(dataset, what, device, screen, clock, pace, steps, about, log, arguments.rerun, tell)
        collected = session.run()
    finally:
        for opened in (what, log, device, screen):
            if opened:
                opened.close()
    successes = sum(dataset.episode(index).meta.success for index in dataset.indices)
    facts = {"path": dataset.path, "task": task, "episodes": len(dataset.indices), "successes": successes}
    tell_datasets(arguments, [(facts | {"collected": collected}, [])])
