"""A camera is found again from pictures of a board, and the residuals tell the truth about how well."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from collectors.apriltags import extrinsics
from collectors.apriltags.calibration import read_calibrations
from collectors.apriltags.calibration_pictures import board_pose, read_poses
from collectors.apriltags.detector import TagDetector
from collectors.apriltags.layout import Layout
from collectors.apriltags.pose import fit
from collectors.apriltags.print_layout import cell_mm
from collectors.cli import build_parser
from collectors.simulation.camera import CAMERAS, calibration
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError, DatasetError, FormatError, UsageError
from svfl_data.schema.robot import image_axes
from svfl_data.storage.store import write_episode
from tests.helpers.apriltag_scenes import COLUMNS, ROWS, SIZE_MM, board_picture, camera
from tests.helpers.builders import make_episode
from tests.helpers.command_page import json_keys

TRUE = camera((0.95, 0.15, 0.55), fov_deg=40.0)
BOARD = Layout.grid(COLUMNS, ROWS, 1e-3 * SIZE_MM, 1e-3 * cell_mm("tag36h11", SIZE_MM))
HEADER = "picture,x,y,z,qx,qy,qz,qw"
INTRINSICS = ",".join(str(TRUE.intrinsics[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))


def gripper_poses(tilt):
    """Poses of a gripper that holds the board in front of the camera, and how it holds it."""
    rng = np.random.default_rng(3)
    held = np.eye(4)
    held[:3, :3], held[:3, 3] = cv2.Rodrigues(np.array([0.05, -0.1, 0.2]))[0], (-0.07, -0.06, 0.02)
    grippers = []
    for _ in range(7):
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(rng.uniform(-1, 1, 3) * (tilt, tilt, 0.5))[0]
        T[:3, 3] = np.array([0.55, 0.0, 0.06]) + rng.uniform(-0.05, 0.05, 3)
        grippers.append(T)
    return grippers, held


def table(poses):
    """The poses as CSV."""
    rows = [HEADER]
    for number, T in enumerate(poses):
        vector = cv2.Rodrigues(T[:3, :3])[0][:, 0]
        angle = np.linalg.norm(vector)
        quat_xyzw = [*(np.sin(angle / 2) * vector / max(angle, 1e-12)), np.cos(angle / 2)]
        rows.append(",".join([f"{number}.png", *map(str, [*T[:3, 3], *quat_xyzw])]))
    return "\n".join(rows) + "\n"


def calibrate(folder, poses_of_board, *words):
    """Take pictures, and run the command on them."""
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    base = np.linalg.inv(TRUE.T_base_camera)
    for number, T in enumerate(poses_of_board):
        cv2.imwrite(str(pictures / f"{number}.png"), board_picture(base @ T, TRUE.intrinsics, seed=number))
    BOARD.write(folder / "board.json")
    out = folder / "calibration.json"
    options = ["--layout", folder / "board.json", "--intrinsics", INTRINSICS, "--out", out]
    arguments = build_parser().parse_args(["calibrate", *map(str, [pictures, *options, *words])])
    arguments.command(arguments)
    return out


def off(found):
    """How far a camera is from the true one: mm and deg."""
    place = 1e3 * np.linalg.norm(found.T_base_camera[:3, 3] - TRUE.T_base_camera[:3, 3])
    turn = np.degrees(np.linalg.norm(cv2.Rodrigues(found.T_base_camera[:3, :3] @ TRUE.T_base_camera[:3, :3].T)[0]))
    return place, turn


def test_a_board_on_the_table(tmp_path, capsys):
    out = calibrate(tmp_path, [board_pose(0.47, -0.06, 0.0, 20.0)] * 2, "--board-pose", "0.47,-0.06,0,20")
    found = read_calibrations(out)["front"]
    place, turn = off(found)
    assert place < 3.0
    assert turn < 0.3
    assert found.depth_scale == 0.001
    assert np.allclose(found.image_axes, TRUE.image_axes, atol=0.01)
    assert "board seen in 2 of 2 pictures" in capsys.readouterr().out
    residuals = json.loads(out.read_text())["cameras"]["front"]["residuals"]
    assert 0.02 < residuals["error_px"] < 0.4
    # The liar: a board that lies elsewhere than it is said to gives another camera, or a larger error.
    wrong = calibrate(tmp_path, [], "--board-pose", "0.49,-0.06,0,20", "--camera", "wrong", "--json")
    told = json.loads(capsys.readouterr().out)
    assert told.keys() | {"T_gripper_board"} == json_keys("svfl-collect calibrate")
    assert (told["file"], told["camera"]) == (str(wrong), "wrong")
    cameras = read_calibrations(wrong)
    assert sorted(cameras) == ["front", "wrong"]
    assert off(cameras["wrong"])[0] > 15.0


def test_a_board_in_the_gripper(tmp_path):
    grippers, held = gripper_poses(tilt=0.4)
    (tmp_path / "grippers.csv").write_text(table(grippers))
    out = calibrate(tmp_path, [gripper @ held for gripper in grippers], "--gripper-poses", tmp_path / "grippers.csv")
    place, turn = off(read_calibrations(out)["front"])
    assert place < 2.0
    assert turn < 0.2
    residuals = json.loads(out.read_text())["cameras"]["front"]["residuals"]
    assert np.allclose(residuals["T_gripper_board"], held, atol=0.004)
    assert max(residuals["position_deviation_m"]) < 0.002


def test_a_gripper_that_turns_about_one_axis_only_is_refused(tmp_path):
    grippers, held = gripper_poses(tilt=0.0)
    (tmp_path / "grippers.csv").write_text(table(grippers))
    with pytest.raises(CollectError, match="two axes"):
        calibrate(tmp_path, [gripper @ held for gripper in grippers], "--gripper-poses", tmp_path / "grippers.csv")


def test_known_places_of_the_board_and_what_can_be_wrong(tmp_path):
    boards = [board_pose(0.47, -0.06, 0.0, 0.0), board_pose(0.5, -0.04, 0.03, 10.0)]
    (tmp_path / "boards.csv").write_text(table(boards))
    words = ["--board-poses", tmp_path / "boards.csv"]
    out = calibrate(tmp_path, boards, *words, "--printed", 100)
    assert off(read_calibrations(out)["front"])[0] < 3.0
    (tmp_path / "boards.csv").write_text(table(boards[:1]))
    with pytest.raises(UsageError, match=r"boards\.csv: .*1\.png"):
        calibrate(tmp_path, [], *words)
    (tmp_path / "boards.csv").write_text("picture,x\n0.png,1\n")
    with pytest.raises(FormatError, match=r"boards\.csv.* line 2"):
        calibrate(tmp_path, [], *words)
    (tmp_path / "pictures" / "0.png").write_bytes(b"no picture")
    with pytest.raises(FormatError, match=r"0\.png"):
        calibrate(tmp_path, [], "--board-pose", "0,0,0,0")
    (tmp_path / "calibration.json").write_text("{}")
    with pytest.raises(FormatError, match=r"calibration\.json"):
        read_calibrations(tmp_path / "calibration.json")


def boards(path, pictures):
    """A dataset with one episode, whose camera took these pictures."""
    color = np.repeat(np.stack(pictures)[..., None], 3, axis=-1)
    episode, front = make_episode(), "cameras/front/"
    arrays = {f"{front}color": color, f"{front}depth": np.zeros(color.shape[:3], np.uint16)}
    arrays |= {f"{front}intrinsics": TRUE.intrinsics, f"{front}depth_scale": np.array(0.0005)}
    dataset = Dataset.create_or_resume(path, episode.meta.task, 0, {})
    write_episode(replace(episode, arrays=episode.arrays | arrays), dataset.episode_path(0))
    return path


@pytest.fixture(scope="module")
def episode(tmp_path_factory):
    """A dataset whose episode looks at the board, and the board's file beside it."""
    folder = tmp_path_factory.mktemp("boards")
    BOARD.write(folder / "board.json")
    base = np.linalg.inv(TRUE.T_base_camera)
    count = len(make_episode().cameras["front"].color)
    picture = board_picture(base @ board_pose(0.47, -0.06, 0.0, 20.0), TRUE.intrinsics)
    return boards(folder / "boards", [np.full_like(picture, 120), *[picture] * (count - 1)])


def of_episode(path, *words):
    """Run the command on the pictures of an episode."""
    options = ["--layout", path.parent / "board.json", "--out", path.parent / "calibration.json"]
    arguments = build_parser().parse_args(["calibrate", *map(str, [path, *options, *words])])
    arguments.command(arguments)
    return path.parent / "calibration.json"


def test_the_pictures_of_an_episode(episode, capsys):
    out = of_episode(episode, "--episode", 0, "--board-pose", "0.47,-0.06,0,20")
    found = read_calibrations(out)["front"]
    assert off(found)[0] < 3.0
    assert off(found)[1] < 0.3
    assert found.depth_scale == 0.0005  # the episode's
    assert np.array_equal(found.intrinsics, TRUE.intrinsics)
    assert "board seen in 4 of 5 pictures" in capsys.readouterr().out
    of_episode(episode, "--board-pose", "0.47,-0.06,0,20", "--camera", "front", "--intrinsics", "660,660,320,240")
    assert read_calibrations(out)["front"].intrinsics[0].tolist() == [660.0, 0.0, 320.0]


@pytest.mark.parametrize(
    ("words", "error", "facts"),
    [
        (["--camera", "wrist"], UsageError, "camera 'wrist'.* front"),
        (["--episode", "7"], DatasetError, "episode 7"),
        (["--intrinsics", "0,0,0,0"], UsageError, "0,0,0,0 .*640 x 480 px"),
        (["--intrinsics", "660,660,700,240"], UsageError, "660,660,700,240 .*640 x 480 px"),
    ],
)
def test_options_that_do_not_fit_an_episode(episode, words, error, facts):
    with pytest.raises(error, match=facts):
        of_episode(episode, "--board-pose", "0.47,-0.06,0,20", *words)


def test_a_board_that_is_not_seen(episode):
    file, out = episode.parent / "other.json", episode.parent / "none.json"
    Layout.grid(COLUMNS, ROWS, 1e-3 * SIZE_MM, 0.05, first=100).write(file)
    with pytest.raises(CollectError, match=r"tags 100, 101, .* 5 pictures"):
        of_episode(episode, "--board-pose", "0,0,0,0", "--layout", file, "--out", out)
    assert not out.exists()


def test_a_board_file_that_does_not_fit_the_pictures_gives_no_camera(tmp_path):
    Layout.grid(COLUMNS, ROWS, 1e-3 * SIZE_MM, 0.05, first=2).write(tmp_path / "other.json")
    with pytest.raises(CollectError, match=r"error [\d.]+ px.* board"):
        calibrate(
            tmp_path,
            [board_pose(0.47, -0.06, 0.0, 20.0)],
            "--board-pose",
            "0,0,0,0",
            "--layout",
            tmp_path / "other.json",
        )
    assert not (tmp_path / "calibration.json").exists()


def test_a_wrong_board_file_takes_no_longer_than_the_right_one(monkeypatch):
    """Its tags agree in no way; leaving some out in turn would fit thousands of poses."""
    picture = board_picture(np.linalg.inv(TRUE.T_base_camera) @ board_pose(0.47, -0.06, 0.0, 20.0), TRUE.intrinsics)
    counts = []
    for board in (BOARD, Layout.grid(ROWS, COLUMNS, 1e-3 * SIZE_MM, 0.0375)):
        calls = []
        monkeypatch.setattr(extrinsics, "fit", lambda *given, calls=calls: calls.append(1) or fit(*given))
        assert extrinsics.view("0", picture, board, TRUE.intrinsics, TagDetector()) is not None
        counts.append(len(calls))
    assert counts[0] == counts[1] == extrinsics.TRIED


def test_pictures_of_different_sizes(tmp_path):
    picture = board_picture(np.linalg.inv(TRUE.T_base_camera) @ board_pose(0.47, -0.06, 0.0, 20.0), TRUE.intrinsics)
    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures" / "a.png"), picture)
    cv2.imwrite(str(tmp_path / "pictures" / "b.png"), picture[:400])
    with pytest.raises(UsageError, match=r"b\.png .*640 x 400 .*a\.png .*640 x 480"):
        calibrate(tmp_path, [], "--board-pose", "0.47,-0.06,0,20")
    cv2.imwrite(str(tmp_path / "pictures" / "b.png"), picture)
    with pytest.raises(FormatError, match=str(tmp_path / "pictures")):  # a folder of pictures has no episodes
        calibrate(tmp_path, [], "--board-pose", "0.47,-0.06,0,20", "--episode", 0)


def test_one_or_two_pictures_of_a_board_in_the_gripper_are_too_few(tmp_path):
    grippers, held = gripper_poses(tilt=0.4)
    (tmp_path / "grippers.csv").write_text(table(grippers))
    for count in (1, 2):
        with pytest.raises(CollectError, match=f"in {count} of the pictures.* 3 "):
            calibrate(
                tmp_path, [gripper @ held for gripper in grippers[:count]], "--gripper-poses", tmp_path / "grippers.csv"
            )


@pytest.mark.parametrize(
    ("content", "facts"),
    [
        (f"{HEADER}\n0,nan,0,0,0,0,0,1\n", r"line 2: .*\bnan\b"),
        (f"{HEADER}\n0,inf,0,0,0,0,0,1\n", r"line 2: .*\binf\b"),
        (f"{HEADER}\n0,0,0,0,0,0,0.5,1\n", r"norm 1\.12"),
        (f"{HEADER}\n0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1\n", "line 3: .* 0"),
        (f"{HEADER}\n0,0,0\n", "no z"),
        (f"{HEADER}\n0,x,0,0,0,0,0,1\n", "line 2: .*'x'"),
        ("picture,x,y,z,qx,qy,qz\n0,0,0,0,0,0,0\n", "no qw"),
        ("", r"poses\.csv .*picture,x,y,z,"),
        ("\x89", r"poses\.csv .*picture,x,y,z,"),
    ],
)
def test_tables_that_are_wrong(tmp_path, content, facts):
    (tmp_path / "poses.csv").write_bytes(content.encode("latin-1"))
    with pytest.raises(FormatError, match=facts):
        read_poses(tmp_path / "poses.csv")


def test_a_table_from_a_spreadsheet(tmp_path):
    (tmp_path / "poses.csv").write_text(f"\ufeff{HEADER}\n0.png, 0.1, 0.2, 0.3, 0, 0, 1, 0\n")
    assert np.allclose(
        read_poses(tmp_path / "poses.csv")["0.png"],
        [[-1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]],
    )


@pytest.mark.parametrize(
    "T",
    [
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]],
        [[1, 0, 0, float("nan")], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0.02, 1]],
        [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]],
    ],
)
def test_a_board_file_with_something_else_than_a_pose(tmp_path, T):
    tags = [{"id": 0, "size": 0.03, "T_body_tag": T}]
    (tmp_path / "board.json").write_text(json.dumps({"family": "tag36h11", "tags": tags}))
    with pytest.raises(FormatError, match=r"board\.json"):
        Layout.read(tmp_path / "board.json")


def test_a_board_file_that_is_another_file_is_named_in_one_short_line(tmp_path):
    (tmp_path / "board.json").write_bytes(b"\x89HDF" * 1000)
    with pytest.raises(FormatError, match=r"board\.json") as raised:
        Layout.read(tmp_path / "board.json")
    assert len(str(raised.value)) < 400


@pytest.mark.parametrize("name", [name for name, camera in CAMERAS.items() if not camera.mounted])
def test_image_axes_are_the_simulations(name):
    known = calibration(CAMERAS[name])
    assert np.allclose(image_axes(known.T_base_camera), known.image_axes)
