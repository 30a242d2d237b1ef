"""A camera is found again from pictures of a board, and the residuals tell the truth about how well."""

import json

import cv2
import numpy as np
import pytest

from collectors.apriltags.calibration import image_axes, read_calibrations
from collectors.apriltags.calibration_pictures import board_pose
from collectors.apriltags.layout import Layout
from collectors.apriltags.sheet import cell_mm
from collectors.cli import build_parser
from collectors.simulation.camera import CAMERAS, calibration
from svfl_data.errors import CollectError, FormatError, UsageError
from tests.collectors.apriltag_scenes import COLUMNS, ROWS, SIZE_MM, board_picture, camera

TRUE = camera((0.95, 0.15, 0.55), fov_deg=40.0)
INTRINSICS = ",".join(str(TRUE.intrinsics[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))


def hand_poses(tilt):
    """Poses of a hand that holds the board in front of the camera, and how it holds it."""
    rng = np.random.default_rng(3)
    held = np.eye(4)
    held[:3, :3], held[:3, 3] = cv2.Rodrigues(np.array([0.05, -0.1, 0.2]))[0], (-0.07, -0.06, 0.02)
    hands = []
    for _ in range(7):
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(rng.uniform(-1, 1, 3) * (tilt, tilt, 0.5))[0]
        T[:3, 3] = np.array([0.55, 0.0, 0.06]) + rng.uniform(-0.05, 0.05, 3)
        hands.append(T)
    return hands, held


def table(poses):
    """The poses as CSV."""
    rows = ["picture,x,y,z,qx,qy,qz,qw"]
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
    Layout.grid(COLUMNS, ROWS, 1e-3 * SIZE_MM, 1e-3 * cell_mm("tag36h11", SIZE_MM)).write(folder / "board.json")
    out = folder / "calibration.json"
    options = ["--board", folder / "board.json", "--intrinsics", INTRINSICS, "--out", out]
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
    wrong = calibrate(tmp_path, [], "--board-pose", "0.49,-0.06,0,20", "--camera", "wrong")
    cameras = read_calibrations(wrong)
    assert sorted(cameras) == ["front", "wrong"]
    assert off(cameras["wrong"])[0] > 15.0


def test_a_board_in_the_hand(tmp_path):
    hands, held = hand_poses(tilt=0.4)
    (tmp_path / "hands.csv").write_text(table(hands))
    out = calibrate(tmp_path, [hand @ held for hand in hands], "--hand-poses", tmp_path / "hands.csv")
    place, turn = off(read_calibrations(out)["front"])
    assert place < 2.0
    assert turn < 0.2
    residuals = json.loads(out.read_text())["cameras"]["front"]["residuals"]
    assert np.allclose(residuals["T_hand_board"], held, atol=0.004)
    assert max(residuals["position_deviation_m"]) < 0.002


def test_a_hand_that_turns_about_one_axis_only_is_refused(tmp_path):
    hands, held = hand_poses(tilt=0.0)
    (tmp_path / "hands.csv").write_text(table(hands))
    with pytest.raises(CollectError, match="two axes"):
        calibrate(tmp_path, [hand @ held for hand in hands], "--hand-poses", tmp_path / "hands.csv")


def test_known_places_of_the_board_and_what_can_be_wrong(tmp_path):
    boards = [board_pose(0.47, -0.06, 0.0, 0.0), board_pose(0.5, -0.04, 0.03, 10.0)]
    (tmp_path / "boards.csv").write_text(table(boards))
    words = ["--board-poses", tmp_path / "boards.csv"]
    out = calibrate(tmp_path, boards, *words, "--printed", 100)
    assert off(read_calibrations(out)["front"])[0] < 3.0
    (tmp_path / "boards.csv").write_text(table(boards[:1]))
    with pytest.raises(UsageError, match=r"no row for 1\.png"):
        calibrate(tmp_path, [], *words)
    (tmp_path / "boards.csv").write_text("picture,x\n0.png,1\n")
    with pytest.raises(FormatError, match="line 2"):
        calibrate(tmp_path, [], *words)
    (tmp_path / "pictures" / "0.png").write_bytes(b"no picture")
    with pytest.raises(FormatError, match="no picture"):
        calibrate(tmp_path, [], "--board-pose", "0,0,0,0")
    (tmp_path / "calibration.json").write_text("{}")
    with pytest.raises(FormatError, match="no calibration file"):
        read_calibrations(tmp_path / "calibration.json")


@pytest.mark.parametrize("name", CAMERAS)
def test_image_axes_are_the_simulations(name):
    known = calibration(CAMERAS[name])
    assert np.allclose(image_axes(known.T_base_camera), known.image_axes)
