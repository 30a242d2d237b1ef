"""The same data from a Ray cluster of two nodes, with and without a shared file system, and when a worker dies."""

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
import ray
from ray._private import ray_constants
from ray.cluster_utils import Cluster

from collectors.recording.collection import collect_dataset
from collectors.recording.ray import Ray
from collectors.sources.expert import ExpertCollector
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError
from tests.helpers.collecting import contents
from tests.helpers.collectors import SMALL, Made
from tests.helpers.patience import PATIENCE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cluster():
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    ray_constants.ENABLE_RAY_CLUSTER = False  # the only way to have it take 127.0.0.1 for this machine's address
    node = {"num_cpus": 1, "include_dashboard": False, "node_ip_address": "127.0.0.1"}
    running = Cluster(initialize_head=True, head_node_args=node)
    running.add_node(num_cpus=1, node_ip_address="127.0.0.1")
    yield Ray(running.address)
    ray.shutdown()
    running.shutdown()


def test_ray_gives_the_same_bytes(cluster, picked, tmp_path):
    collector = ExpertCollector(0, "block_picking", world=SMALL)
    dataset = Dataset.create_or_resume(tmp_path / "ray", "block_picking", 0, collector.config())
    done = collect_dataset(dataset, 3, 2, collector, cluster)
    assert sorted(finished.index for finished in done) == [0, 1, 2]
    assert contents(tmp_path / "ray") == contents(picked)


def test_files_of_other_machines_are_fetched_and_stay_there(cluster, tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "here", "made", 0, {})
    collect_dataset(dataset, 4, 2, Made(), Ray(cluster.address, folder=tmp_path / "there"))
    assert len(dataset) == 4
    assert contents(tmp_path / "here") == contents(tmp_path / "there")


def test_a_worker_that_dies_is_replaced(cluster, tmp_path, capfd):
    dataset = Dataset.create_or_resume(tmp_path / "data", "made", 0, {})
    collect_dataset(dataset, 4, 2, Made(dies_at=1, dies_once=tmp_path / "died"), cluster)
    assert dataset.indices == [0, 1, 2, 3]
    assert dataset.read(1).meta.index == 1
    errors = capfd.readouterr().err
    assert errors.count("episode 1 will be redone") == 1


def test_workers_that_keep_dying_end_it(cluster, tmp_path, capfd):
    dataset = Dataset.create_or_resume(tmp_path / "data", "made", 0, {})
    with pytest.raises(CollectError, match=r"3 times .* episode 1\b"):
        collect_dataset(dataset, 2, 1, Made(dies_at=1), cluster)
    assert dataset.indices == [0]


def test_a_collectors_error_arrives_in_one_line(cluster, tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "data", "made", 0, {})
    with pytest.raises(CollectError, match=r"^episode 0 cannot be made$"):
        collect_dataset(dataset, 1, 1, Made(fails_at=0), cluster)


def listening(processes: list[psutil.Process]) -> dict[str, list[str]]:
    """Addresses on which TCP sockets of processes wait for others, by process name."""
    found: dict[str, list[str]] = {}
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
            for socket in process.net_connections("inet"):
                if socket.status == psutil.CONN_LISTEN:
                    found.setdefault(process.name(), []).append(socket.laddr.ip)
    return found


def test_a_cluster_of_its_own_is_heard_by_this_machine_only_and_ends_with_sigterm(tmp_path):
    """While a command collects: sockets on the loopback interface alone. At SIGTERM: one line, 143, nobody left."""
    command = (
        "from collectors.cli import main; import sys; sys.argv[1:] = ['centering', '--episodes', '1000', "
        f"'--image-size', '64', '--executor', 'ray', '--out', {str(tmp_path / 'x')!r}]; sys.exit(main())"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    running = subprocess.Popen(
        [sys.executable, "-c", command], cwd=Path(__file__).parents[3], env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    begun = ""  # how many samples the first line of progress counts depends on the machine
    while "/1000" not in begun and (line := running.stdout.readline()):
        begun += line
    assert "/1000" in begun
    family = [psutil.Process(running.pid), *psutil.Process(running.pid).children(recursive=True)]
    heard = listening(family)
    running.send_signal(signal.SIGTERM)
    output, _ = running.communicate(timeout=PATIENCE)
    assert {"raylet", "gcs_server"} <= heard.keys()
    assert {ip.removeprefix("::ffff:") for ips in heard.values() for ip in ips} == {"127.0.0.1"}
    assert running.returncode == 128 + signal.SIGTERM
    said = [line for line in output.splitlines() if line and not line.startswith("centering: ")]
    assert said == ["svfl-collect: interrupted; everything finished so far is on disk"]
    _, alive = psutil.wait_procs(family, timeout=PATIENCE)
    assert not [process for process in alive if process.status() != psutil.STATUS_ZOMBIE]


def test_without_ray_it_says_what_to_install(tmp_path):
    code = (
        "import sys; sys.modules['ray'] = None; sys.argv[1:] = ['expert', '--task', 'block_picking', '--episodes', '1',"
        f" '--executor', 'ray', '--out', {str(tmp_path / 'x')!r}]; from collectors.cli import main; sys.exit(main())"
    )
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "Ray" in done.stderr
    assert done.stderr.endswith("pip install 'svfl[ray]'\n")


def test_no_cluster_is_one_clear_line(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "data", "made", 0, {})
    ray.shutdown()
    with pytest.raises(CollectError, match=r"127\.0\.0\.1:1\b"):
        collect_dataset(dataset, 1, 1, Made(), Ray("127.0.0.1:1"))
