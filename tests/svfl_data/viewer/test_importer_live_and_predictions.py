"""Importer, live streaming, networks' predictions, comparison of datasets."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.action_fields import planar_action
from svfl_data.schema.observation import Frame, Observation
from svfl_data.schema.optics import Calibration
from svfl_data.storage import seal
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import DIRECTIONS
from svfl_data.viewer import compare, predictions, rerun_importer, show
from svfl_data.viewer.entities.episode_source import EpisodeSource
from svfl_data.viewer.live import GAP_NS, Live
from svfl_data.viewer.predictions import Prediction
from tests.helpers.builders import make_episode
from tests.helpers.patience import PATIENCE
from tests.helpers.rerun_files import entities, gathered, logged

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _strict(monkeypatch):
    monkeypatch.setenv("CI", "1")
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def run_importer(file, *words):
    program = [sys.executable, "-m", "svfl_data.viewer.rerun_importer"]
    command = [*program, str(file), "--opened-application-id", "x", *words]
    return subprocess.run(command, capture_output=True, check=False)


def test_the_importer_knows_the_seal_and_reruns_exit_code():
    assert (seal.SEAL_MARK, seal.SEAL_SIZE) == (rerun_importer.SEAL_MARK, rerun_importer.SEAL_SIZE)
    assert rerun_importer.FOREIGN == rr.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE


def test_the_importer_writes_a_recording_with_the_names_it_is_given(tmp_path):
    write_episode(make_episode(), tmp_path / "episode_000000.hdf5")
    done = run_importer(tmp_path / "episode_000000.hdf5", "--recording-id", "mine", "--entity-path-prefix", "/ep1")
    assert (done.returncode, done.stderr) == (0, b"")
    (tmp_path / "out.rrd").write_bytes(done.stdout)
    assert "/ep1/wrench/force" in entities(tmp_path / "out.rrd")
    assert RrdReader(tmp_path / "out.rrd").recordings()[0].recording_id == "mine"


def test_the_importer_leaves_foreign_files_to_others_without_loading_anything(tmp_path):
    for name in ("a.png", "a.hdf5", "empty.h5"):
        (tmp_path / name).write_bytes(b"" if "empty" in name else b"x" * 500)
        assert run_importer(tmp_path / name).returncode == rerun_importer.FOREIGN
    code = (
        f"import sys; sys.argv[1:] = [{str(tmp_path / 'a.hdf5')!r}]\n"
        "from svfl_data.viewer import rerun_importer; rerun_importer.main()\n"
    )
    code += "print(*{'numpy', 'h5py', 'rerun'} & sys.modules.keys())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_the_importer_says_in_one_line_what_is_wrong_with_a_damaged_episode(tmp_path):
    file = tmp_path / "episode_000000.hdf5"
    write_episode(make_episode(), file)
    content = bytearray(file.read_bytes())
    content[3000] ^= 1
    file.write_bytes(content)
    done = run_importer(file)
    assert done.returncode == 1
    assert done.stderr.count(b"\n") == 1


class Robot:
    """A robot that replays an episode."""

    def __init__(self, episode):
        self.action, self.declarations = planar_action(), episode.declarations
        camera = episode.cameras["front"]
        scale = float(camera.depth_scale)
        self.cameras = {"front": Calibration(camera.intrinsics, camera.T_base_camera, camera.image_axes, scale)}
        self.episode, self.step, self.given = episode, 0, 0

    def constants(self):
        return {"streams/wrench/tare": self.episode.tare, "workspace": self.episode.workspace}

    def readings(self):
        rows = slice(self.given, int(np.searchsorted(self.episode.wrench_t_ns, self.episode.t_ns[self.step], "right")))
        self.given = rows.stop
        return {"streams/wrench": {"t_ns": self.episode.wrench_t_ns[rows], "wrench": self.episode.wrench[rows]}}

    def observe(self):
        camera, step = self.episode.cameras["front"], self.step
        frame = Frame(camera.color[step], camera.depth[step])
        return Observation(
            int(self.episode.t_ns[step]), {"front": frame}, proprio=self.episode.proprio[step],
            joints=self.episode.joints[step],
        )  # fmt: skip


@pytest.mark.parametrize("period", [0.0, 60.0])
def test_live_sends_every_reading_and_step_once_however_often_it_sends(monkeypatch, tmp_path, period):
    file = tmp_path / "live.rrd"
    monkeypatch.setattr("socket.create_connection", lambda *_, **__: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda self, url: self.save(file))
    episode, live = make_episode(steps=6), Live("127.0.0.1:1", period_s=period, share=1e9)
    for _ in range(2):
        robot = Robot(episode)
        live(robot, robot.observe(), None, robot.readings())
        for step in range(len(episode)):
            robot.step = step + 1
            live(robot, robot.observe(), episode.action[step], robot.readings())
    live.close()
    offset = GAP_NS
    later = GAP_NS + episode.t_ns[-1] + GAP_NS
    for path, clock, values in (
        ("wrench/force", episode.wrench_t_ns, episode.tared_wrench[:, :3]),
        ("motion/commanded", episode.t_ns[:-1], episode.action[:, 1:4]),
        ("motion/achieved", episode.t_ns[:-1], np.diff(episode.proprio[:, 1:4], axis=0)),
        ("scene/cameras/front/depth", episode.t_ns, None),
    ):
        component = "DepthImage:buffer" if values is None else "Scalars:scalars"
        t_ns, rows = gathered(file, path, component)
        if values is not None:
            breaks = np.isnan(rows).all(axis=1)  # a curve does not lead from one episode to the next
            between = (t_ns >= clock[-1] + offset) & (t_ns < clock[0] + later)
            assert (breaks & between).sum() == 1
            t_ns, rows = t_ns[~breaks], np.array(rows)[~breaks]
            np.testing.assert_allclose(rows, np.concatenate([values, values]), atol=1e-6)
        np.testing.assert_array_equal(t_ns, [*(clock + offset), *(clock + later)])


def test_live_without_a_viewer_is_one_line():
    for address in ("127.0.0.1:9", "nowhere"):
        with pytest.raises(UsageError, match=f"--rerun {address}") as caught:
            Live(address)
        assert "\n" not in str(caught.value)


def test_predicted_direction_is_drawn_with_its_probability_beside_the_true_one(tmp_path):
    episode = make_episode(steps=3)
    shares = np.full((4, 4), 0.1)
    shares[:, 2] = 0.7
    prediction = Prediction("tiny", "front", np.zeros((4, 8, 8, 3), np.uint8), shares)
    show.save(show.content([(EpisodeSource.of(episode), prediction)]), tmp_path / "a.rrd")
    camera = "scene/cameras/front"
    t_ns, vectors = logged(tmp_path / "a.rrd", f"{camera}/predicted", "Arrows2D:vectors")
    np.testing.assert_array_equal(t_ns, episode.t_ns)
    assert (vectors[:, 0, 0] < 0).all()  # left is left
    np.testing.assert_allclose(vectors[:, 0, 1], 0)
    _, words = logged(tmp_path / "a.rrd", f"{camera}/predicted", "Arrows2D:labels")
    assert words[0, 0] == f"network: {DIRECTIONS[2]} 70%"
    true = logged(tmp_path / "a.rrd", f"{camera}/true", "Arrows2D:labels", timed=False)
    assert true == [f"true: {DIRECTIONS[int(episode.label_direction)]}"]
    _, probability = logged(tmp_path / "a.rrd", "network/probability", "Scalars:scalars")
    np.testing.assert_allclose(probability, shares)


def test_what_a_policy_would_do_is_drawn_and_where_it_looks(tmp_path):
    episode = make_episode(steps=3, size=20)
    actions = np.arange(20.0).reshape(4, 5)
    crop = np.array([[2, 3, 18, 19]]) + np.arange(4)[:, None]
    prediction = Prediction("tiny", "front", np.zeros((4, 8, 8, 3), np.uint8), actions=actions, crop=crop)
    show.save(show.content([(EpisodeSource.of(episode), prediction)]), tmp_path / "a.rrd")
    for part, columns in (("move", slice(1, 4)), ("turn", slice(4, 5)), ("opening", slice(0, 1))):
        t_ns, values = logged(tmp_path / "a.rrd", f"network/{part}", "Scalars:scalars")
        np.testing.assert_array_equal(t_ns, episode.t_ns)
        np.testing.assert_array_equal(values, actions[:, columns])
    middle, half = (
        logged(tmp_path / "a.rrd", "scene/cameras/front/seen", f"Boxes2D:{part}")[1][:, 0]
        for part in ("centers", "half_sizes")
    )
    np.testing.assert_array_equal(np.hstack([middle - half, middle + half]), crop)


def test_a_checkpoint_that_is_none_is_one_line(tmp_path):
    (tmp_path / "a.txt").touch()
    with pytest.raises(UsageError, match=r"--checkpoint .*a\.txt.*\.ckpt"):
        predictions.load(tmp_path / "a.txt")
    with pytest.raises(FormatError, match=r"a\.ckpt"):
        predictions.load(tmp_path / "a.ckpt")


def test_two_datasets_are_compared_by_the_same_bins(tmp_path):
    datasets = []
    for name, seeds in (("a", (0, 1)), ("b", (2, 3, 4))):
        dataset = Dataset.create_or_resume(tmp_path / name, "centering", 0, {})
        for seed in seeds:
            write_episode(make_episode(seed), dataset.episode_path(seed))
        datasets.append(dataset)
    loads = tuple(map(compare.Loads.of, datasets))
    assert [len(load.peak) for load in loads] == [2, 3]
    edges = compare.bins([load.force for load in loads])
    for load in loads:
        np.testing.assert_allclose(compare.shares(load.force, edges).sum(), 100)
    show.save(compare.content(*datasets), tmp_path / "compared.rrd")
    assert {f"/compare/{what}/{one}" for what in ("force", "torque", "peak") for one in "ab"} <= entities(
        tmp_path / "compared.rrd"
    )


def test_distance_of_distributions_is_zero_for_equal_and_one_for_separate_ones():
    values = np.random.default_rng(0).normal(size=200)
    assert compare.distance(values, values[::-1]) == 0
    assert compare.distance(values, values + 100) == 1
    assert 0 < compare.distance(values, values + 0.5) < 1


def test_the_web_page_is_this_machines_unless_asked_otherwise(monkeypatch):
    called = []
    monkeypatch.setattr(show, "_run", lambda arguments, advice: called.append(arguments))
    content = show.content([(EpisodeSource.of(make_episode()), None)])
    show.serve(content)
    show.serve(content, bind="0.0.0.0", port=7000)
    assert called[0][called[0].index("--bind") + 1] == "127.0.0.1"
    assert called[1][called[1].index("--bind") + 1] == "0.0.0.0"
    assert not any(Path(arguments[-1]).exists() for arguments in called)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_viewer_ends_with_its_command(tmp_path, number):
    """The viewer is a grandchild; it holds our pipe's other end, which closes when the last of the family is gone."""
    viewer = tmp_path / "viewer"
    viewer.write_text("#!/bin/sh\necho ready\nexec sleep 600\n")
    viewer.chmod(0o755)
    code = (
        "import signal, sys; from svfl_data.system import command_line as cli; from svfl_data.viewer import show;"
        "signal.signal(signal.SIGINT, signal.default_int_handler);"
        "sys.exit(cli.run(lambda: show._run([], ''), 'view'))"
    )
    environment = {**os.environ, "RERUN_CLI_PATH": str(viewer)}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as command:
        assert command.stdout.readline() == b"ready\n"
        command.send_signal(number)
        rest, _ = command.communicate(timeout=PATIENCE)
    assert rest == b""
    assert command.returncode == 128 + number
