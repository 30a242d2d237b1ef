"""Files that somebody made to do harm, sealed correctly, are refused in one line, whatever HDF5 would do with them."""

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError, FormatError, SvflError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.storage import examination, header_cache
from svfl_data.storage.admission import VARIABLE
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import forget, header, know_own
from svfl_data.storage.reader import EpisodeReader, read_episode, read_unsealed
from svfl_data.storage.seal import SEAL_SIZE, seal
from svfl_data.storage.store import episode_bytes, write_episode
from tests.helpers.builders import make_episode
from tests.helpers.child import exit_code, fork, in_child

pytestmark = pytest.mark.slow

SECRET = b"root:x:0:0:a line of the password file\n"
MIB = 2**20


@pytest.fixture
def file(tmp_path):
    write_episode(make_episode(), tmp_path / "episode_000000.hdf5")
    (tmp_path / "secret").write_bytes(SECRET * 4)
    return tmp_path / "episode_000000.hdf5"


def changed(path: Path, change) -> Path:
    """An episode file that was changed with plain h5py, and sealed again."""
    content = path.read_bytes()[:-SEAL_SIZE]
    path.write_bytes(content)
    with h5py.File(path, "a") as opened:
        change(opened)
    content = path.read_bytes()
    path.write_bytes(content + seal(content))
    return path


def replaced(opened: h5py.File, path: str, **options) -> h5py.Dataset:
    """A declared array made anew, with the attributes that it had."""
    attributes = dict(opened[path].attrs)
    del opened[path]
    dataset = opened.create_dataset(path, **options)
    dataset.attrs.update(attributes)
    return dataset


def external(opened):
    secret = str(Path(opened.filename).parent / "secret")
    replaced(opened, "streams/wrench/tare", shape=(6,), dtype="f8", external=[(secret, 0, 48)])


def external_and_unknown(opened):
    secret = str(Path(opened.filename).parent / "secret")
    opened.create_dataset("later/version", shape=(6,), dtype="f8", external=[(secret, 0, 48)])


def virtual(opened):
    layout = h5py.VirtualLayout((6,), "f8")
    layout[:] = h5py.VirtualSource("other.hdf5", "streams/wrench/tare", shape=(6,))
    attributes = dict(opened["streams/wrench/tare"].attrs)
    del opened["streams/wrench/tare"]
    opened.create_virtual_dataset("streams/wrench/tare", layout).attrs.update(attributes)


def gzip_before_shuffle(opened):
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_chunk((3,))
    plan.set_deflate(1)
    plan.set_shuffle()
    place = h5py.h5g.create(opened.id, b"extra")
    h5py.h5d.create(place, b"own", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((3,)), plan)
    opened["extra/own"][:] = 1.0


def deep(opened):
    opened["extra/" + "/".join("a" * 9) + "/x"] = 1.0


def wide(opened):
    for number in range(1001):
        opened.create_group(f"other/{number}")


def loop(opened):
    opened["extra/all"] = opened["/"]


def pieces(opened):
    wrench = opened["streams/wrench/wrench"][()]
    replaced(opened, "streams/wrench/wrench", data=wrench, chunks=(10, 3))


def with_attribute(name, value, path="/"):
    return lambda opened: opened[path].attrs.__setitem__(name, value)


def with_extra(**options):
    return lambda opened: opened.create_dataset("extra/own", **options)


def named_type(opened):
    opened["extra/kind"] = np.dtype("f8")


def of_named_type(opened):
    opened["kind"] = np.dtype("f8")
    opened.create_dataset("extra/own", (3,), opened["kind"])


REFUSED = {
    "external storage": (external, "streams/wrench/tare.*external storage"),
    "external storage in what is not read": (external_and_unknown, "later/version.*external storage"),
    "virtual": (virtual, "streams/wrench/tare.*virtual"),
    "external link": (lambda o: o.__setitem__("extra/x", h5py.ExternalLink("secret", "/a")), "extra/x.*external link"),
    "soft link": (lambda o: o.__setitem__("extra/x", h5py.SoftLink("/workspace")), "extra/x.*soft link"),
    "loop": (loop, "extra/all.*second name"),
    "second name": (lambda o: o.__setitem__("extra/x", o["workspace"]), "workspace.*second name"),
    "named type": (named_type, "extra/kind.*neither"),
    "of a named type": (of_named_type, ": kind.*neither|extra/own.*named type"),
    "reference": (with_extra(shape=(2,), dtype=h5py.ref_dtype), "extra/own.*type.*numbers"),
    "region": (with_extra(shape=(2,), dtype=h5py.regionref_dtype), "extra/own.*type.*numbers"),
    "vlen": (with_extra(shape=(2,), dtype=h5py.vlen_dtype("i4")), "extra/own.*type.*numbers"),
    "vlen text": (with_extra(shape=(2,), dtype=h5py.string_dtype()), "extra/own.*type.*numbers"),
    "compound": (with_extra(data=np.zeros(2, "f4,i4")), "extra/own.*type.*numbers"),
    "lzf": (with_extra(data=np.zeros((9, 9)), compression="lzf"), r"extra/own.*\[32000\].*shuffle, gzip, fletcher32"),
    "scale offset": (
        with_extra(data=np.zeros((9, 9), int), scaleoffset=0),
        r"extra/own.*\[6\].*shuffle, gzip, fletcher32",
    ),
    "order of filters": (gzip_before_shuffle, r"extra/own.*\[1, 2\].*shuffle, gzip, fletcher32"),
    "unwritten": (with_extra(shape=(9,), dtype="f4"), "extra/own.*declared.*never written"),
    "unwritten chunks": (
        with_extra(shape=(9,), chunks=(3,), dtype="f4"),
        "extra/own.*chunks.*never written",
    ),
    "pieces": (pieces, "streams/wrench/wrench.*pieces.*rows"),
    "empty": (with_extra(data=h5py.Empty("f8")), "extra/own.*no shape"),
    "deep": (deep, r"extra/a/a.*\b8 groups"),
    "wide": (wide, r"\b1000 objects"),
    "list of texts": (with_attribute("task", ["a", "b"]), "task.*single text or number"),
    "reference as text": (lambda o: o.attrs.__setitem__("task", o["workspace"].ref), "task.*single text or number"),
    "numbers as unit": (with_attribute("unit", np.zeros(3), "workspace"), "workspace.*unit.*single text or number"),
    "no UTF-8": (with_attribute("task", np.bytes_(b"\xff\xfe")), "task.*UTF-8"),
    "huge text": (with_attribute("config", "{" + " " * (9 * MIB) + "}"), f"config.*{8 * MIB}"),
    "control character": (lambda o: o.__setitem__("extra/\x1b[2J", 1.0), r"extra/.*\\x1b\[2J"),
    "dots": (lambda o: h5py.h5g.create(o["workspace"].parent.id, b"..\x07"), r"\.\.\\x07"),
    "claims chunks": (
        with_extra(shape=(200_000_000,), chunks=(1,), dtype="u1"),
        r"extra/own.*\b200000000 chunks",
    ),
    "claims rows": (with_extra(shape=(2**40,), chunks=(2**27,), dtype="u1"), "extra/own.*chunks"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_no_episode_of_ours_has_is_refused_in_one_line(file, kind, command):
    change, facts = REFUSED[kind]
    changed(file, change)
    with pytest.raises(FormatError, match=facts) as refusal:
        read_episode(file)
    assert str(file) in str(refusal.value)
    for words in (("info", file), ("validate", file, "--json"), ("info", file, "--json")):
        code, out, err = command(*words)
        assert code == 1, words
        assert len((out + err).splitlines()) <= 30, words  # validate's JSON
        assert "password" not in out + err, words
        assert "\x1b" not in out + err, words


def test_numbers_of_another_file_are_never_copied(file, tmp_path, command):
    """`merge` once made a whole episode of them."""
    changed(file, external)
    folder = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {}).path
    file.rename(folder / file.name)
    (folder / "secret").write_bytes(SECRET * 4)
    code, out, err = command("merge", folder, tmp_path / "merged")
    assert (code, out) == (1, "")
    assert "external storage" in err
    assert not (tmp_path / "merged").exists()


def test_what_other_tools_add_is_still_read(file):
    own = {"table": np.arange(12.0).reshape(3, 4), "tiles": np.arange(64).reshape(8, 8), "note": np.bytes_(b"left")}

    def add(opened):
        opened["extra/table"] = own["table"]
        opened.create_dataset("extra/tiles", data=own["tiles"], chunks=(3, 5), compression="gzip")
        opened["extra/note"] = own["note"]
        replaced(opened, "streams/wrench/wrench", data=opened["streams/wrench/wrench"][()])
        opened.attrs["anything"] = np.arange(3)

    changed(file, add)
    episode = read_episode(file)
    for name, array in own.items():
        np.testing.assert_array_equal(episode.arrays[f"extra/{name}"], array)
    np.testing.assert_array_equal(episode.wrench, make_episode().wrench)
    wrench = EpisodeReader.of_file(file)["streams/wrench/wrench"]
    np.testing.assert_array_equal(wrench[-7:], make_episode().wrench[-7:])


def black_pictures(opened, frames=20_000):
    replaced(
        opened,
        "cameras/front/t_ns",
        data=np.arange(frames) * 50_000_000,
        chunks=(min(1024, frames),),
        compression="gzip",
    )
    for name, shape in (("color", (frames, 300, 300, 3)), ("depth", (frames, 300, 300))):
        dtype, one = opened[f"cameras/front/{name}"].dtype, np.zeros((1, *shape[1:]))
        pictures = replaced(
            opened, f"cameras/front/{name}", shape=shape, dtype=dtype, chunks=one.shape, compression="gzip"
        )
        pictures[0] = one
        packed = pictures.id.read_direct_chunk((0,) + (0,) * (len(shape) - 1))[1]
        for frame in range(1, frames):
            pictures.id.write_direct_chunk((frame,) + (0,) * (len(shape) - 1), packed)


def black_pictures_within_limits(opened):
    black_pictures(opened, frames=650)


def still_wrench(opened):
    rows = 40 * MIB
    replaced(opened, "streams/wrench/t_ns", shape=(rows,), dtype="i8", chunks=(MIB,), compression="gzip", fillvalue=0)
    wrench = replaced(opened, "streams/wrench/wrench", shape=(rows, 6), dtype="f4", chunks=(MIB, 6), compression="gzip")
    for dataset, columns in ((opened["streams/wrench/t_ns"], ()), (wrench, (0,))):
        dataset[:1] = 0
        packed = dataset.id.read_direct_chunk((0, *columns))[1]
        for row in range(0, rows, MIB):
            dataset.id.write_direct_chunk((row, *columns), packed)


def one_chunk(opened):
    opened.create_dataset("extra/own", data=np.zeros(300 * MIB, "u1"), chunks=(300 * MIB,), compression="gzip")


def small_declared_large_inside(opened):
    """A chunk that inflates to a thousand times what its shape says."""
    proprio = opened["observations/proprio"]
    packed = h5py.File(opened.filename + ".aside", "w", driver="core", backing_store=False)
    big = packed.create_dataset("x", data=np.zeros(200 * MIB, "u1"), chunks=(200 * MIB,), compression="gzip")
    attributes = dict(proprio.attrs)
    shape = proprio.shape
    del opened["observations/proprio"]
    small = opened.create_dataset("observations/proprio", shape, "f4", chunks=shape, compression="gzip")
    small.attrs.update(attributes)
    small.id.write_direct_chunk((0, 0), big.id.read_direct_chunk((0,))[1])


def empty_chunks(opened):
    opened.create_dataset("extra/own", shape=(200_000_000,), chunks=(1,), dtype="u1")


def huge_text(opened):
    opened.attrs["config"] = "[" * (9 * MIB)


BOMBS = [
    black_pictures,
    black_pictures_within_limits,
    still_wrench,
    one_chunk,
    small_declared_large_inside,
    empty_chunks,
    huge_text,
]

MEASURE = """
import json, resource, sys
sys.stdout = sys.stderr = open(sys.argv[1], "w")
from svfl_data.cli import main
codes = []
for words in json.loads(sys.argv[2]):
    sys.argv = ["svfl-data", *words]
    try:
        codes.append(main())
    except SystemExit as exit_:
        codes.append(exit_.code)
own = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
peak = max(own, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
print(json.dumps({"codes": codes, "peak": 1024 * peak}), file=sys.__stdout__)
"""


def measured(words, output: Path) -> dict:
    """Exit codes of commands, and the peak memory [bytes] of the one process that ran them and of its examiner."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, output, json.dumps([[str(word) for word in one] for one in words])],
        capture_output=True, text=True, check=True, env=os.environ | {"CI": "1"},
    )  # fmt: skip
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("bomb", BOMBS, ids=lambda bomb: bomb.__name__)
def test_a_file_takes_no_more_memory_than_it_is_worth(tmp_path, bomb):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    file = dataset.episode_path(0)
    write_episode(make_episode(), file)
    words = [("info", dataset.path), ("info", file), ("validate", dataset.path), ("merge", dataset.path, dataset.path)]
    usual = measured(words, tmp_path / "usual")["peak"]
    changed(file, bomb)
    words[-1] = ("merge", dataset.path, tmp_path / "merged")
    found = measured(words, tmp_path / "output")
    expected = {
        black_pictures_within_limits: ([0, 0, 1, 0],),
        small_declared_large_inside: ([0, 0, 1, 1], [0, 1, 1, 1]),
    }
    assert found["codes"] in expected.get(bomb, ([0, 1, 1, 1],)), (tmp_path / "output").read_text()
    assert found["peak"] - usual < 2 * file.stat().st_size + 200 * MIB
    assert "Traceback" not in (tmp_path / "output").read_text()


def test_the_limit_can_be_raised_and_the_message_says_how(tmp_path, monkeypatch):
    arrays = make_episode().arrays
    rows = 3 * MIB
    arrays["streams/wrench/t_ns"] = np.arange(rows) * 2_000_000
    arrays["streams/wrench/wrench"] = np.zeros((rows, 6), np.float32)
    episode = make_episode()
    object.__setattr__(episode, "arrays", arrays)
    write_episode(episode, tmp_path / "e.hdf5")
    with pytest.raises(FormatError, match=rf"streams/wrench/wrench.*{VARIABLE}.* \d+$") as refusal:
        read_episode(tmp_path / "e.hdf5")
    monkeypatch.setenv(VARIABLE, str(refusal.value).split()[-1])
    forget()
    assert len(EpisodeReader.of_file(tmp_path / "e.hdf5")["streams/wrench/wrench"]) == rows
    monkeypatch.setenv(VARIABLE, "much")
    forget()
    with pytest.raises(UsageError, match=f"{VARIABLE}.*'much'"):
        read_episode(tmp_path / "e.hdf5")


@pytest.mark.slow
def test_mutated_metadata_crashes_and_hangs_nobody(tmp_path):
    """Sealed correctly, so that HDF5 gets to see it; many of these end its process or never return."""
    whole = bytearray(episode_bytes(make_episode(steps=1, size=8))[:-SEAL_SIZE])
    rng = np.random.default_rng(0)
    path = tmp_path / "e.hdf5"
    read = 0
    for _ in range(150):
        content = whole.copy()
        for position in rng.integers(len(content), size=rng.integers(1, 4)):
            content[position] = rng.choice([0, 1, 255, content[position] ^ 1 << rng.integers(8)])
        path.write_bytes(content + seal(bytes(content)))
        words = refusal(path)
        read += not words
        assert not words or (str(path) in words and "\n" not in words), words
    assert read < 150


def refusal(path: Path) -> str:
    """What is said of a file; empty if it is an episode."""
    try:
        read_episode(path)
    except SvflError as error:
        return str(error)
    return ""


def test_a_killed_examiner_is_replaced(tmp_path, file):
    header(Extent.of_file(file))
    for number in range(3):
        os.kill(examination._examiner.process.pid, signal.SIGKILL)
        write_episode(make_episode(number + 1), tmp_path / f"{number}.hdf5")
        with pytest.raises(FormatError, match=rf"{number}\.hdf5.*ended"):
            read_episode(tmp_path / f"{number}.hdf5")
        forget()
        assert read_episode(tmp_path / f"{number}.hdf5").meta.index == number + 1


def test_the_examiner_ends_with_whoever_asked(file):
    code = (
        "import os, sys; from svfl_data.storage import examination; from svfl_data.storage.reader import read_episode;"
        "read_episode(sys.argv[1]); print(examination._examiner.process.pid, flush=True); os.kill(os.getpid(), 9)"
    )
    done = subprocess.run([sys.executable, "-c", code, file], stdout=subprocess.PIPE, text=True, check=False)
    pid = int(done.stdout)
    while Path(f"/proc/{pid}").exists() and "zombie" not in Path(f"/proc/{pid}/status").read_text():
        time.sleep(0.01)


def test_forks_threads_and_pickled_readers_each_find_an_examiner(tmp_path):
    files = []
    for number in range(12):
        files.append(tmp_path / f"{number}.hdf5")
        write_episode(make_episode(number), files[-1])
    read_episode(files[0])

    def read_others() -> int:
        found = [read_episode(file).meta.index for file in files[1:4]]
        other = pickle.loads(pickle.dumps(EpisodeReader.of_file(files[4]))).meta.index
        return 0 if [*found, other] == [1, 2, 3, 4] else 1

    child = fork(read_others)
    with ThreadPoolExecutor(4) as pool:
        assert [one.meta.index for one in pool.map(read_episode, files * 3)] == list(range(12)) * 3
    assert exit_code(child) == 0


@pytest.mark.slow
def test_a_fork_while_another_thread_asks(tmp_path):
    files = []
    for number in range(30):
        files.append(tmp_path / f"{number}.hdf5")
        write_episode(make_episode(number), files[-1])
    asking = threading.Thread(target=lambda: [read_episode(file) for file in files])
    asking.start()
    for file in files[:3]:
        assert in_child(lambda file=file: 0 if read_episode(file).meta.task == "centering" else 1) == 0
    asking.join()


def test_the_program_loads_nothing_from_the_current_folder(tmp_path, file):
    (tmp_path / "numpy.py").write_text("open('ran', 'w')")
    (tmp_path / "h5py.py").write_text("open('ran', 'w')")
    code = "import sys; from svfl_data.storage.reader import read_episode; print(read_episode(sys.argv[1]).meta.index)"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, file], cwd=tmp_path, env=environment, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert done.stdout == "0\n"
    assert not (tmp_path / "ran").exists()


def test_no_other_file_can_be_opened_while_examining(file):
    """Not even if a crafted file makes the library do what it wants."""
    code = (
        "import os; from svfl_data.storage import examiner; pid = os.fork();\n"
        "if pid == 0:\n"
        "    examiner._confine(0)\n"
        "    try: open('/etc/hostname')\n"
        "    except OSError: os._exit(7)\n"
        "    os._exit(0)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "7\n"


@pytest.mark.parametrize(
    ("kind", "found"), [("link", "symbolic link"), ("pipe", "named pipe"), ("folder", r"\bfolder")]
)
def test_members_of_a_dataset_are_ordinary_files(tmp_path, kind, found, file):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    member = dataset.episode_path(0)
    if kind == "link":
        member.symlink_to(file)
    elif kind == "pipe":
        os.mkfifo(member)
    else:
        member.mkdir()
    with pytest.raises(FormatError, match=f"{member}.*{found}"):
        dataset.read(0)


def test_a_file_that_the_user_names_may_be_a_link(tmp_path, file):
    (tmp_path / "mine.hdf5").symlink_to(file)
    assert read_episode(tmp_path / "mine.hdf5").meta.index == 0
    (tmp_path / "dead.hdf5").symlink_to(tmp_path / "absent")
    with pytest.raises(FormatError, match=r"dead\.hdf5"):
        read_episode(tmp_path / "dead.hdf5")


def shard_with(*names, content=b"x" * 100, attribute=0, compress=zipfile.ZIP_STORED):
    def write(archive):
        for name in names:
            info = zipfile.ZipInfo(name)
            info.compress_type, info.external_attr = compress, attribute
            archive.writestr(info, content)

    return write


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("write", "facts"),
    [
        (shard_with("../episode_000001.hdf5"), r": \.\./episode_000001\.hdf5.*name"),
        (shard_with("/episode_000001.hdf5"), r": /episode_000001\.hdf5.*name"),
        (shard_with("a/../../b"), r"a/\.\./\.\./b.*name"),
        (shard_with("episode_000003.hdf5", "episode_000003.hdf5"), r"episode_000003\.hdf5.*second episode 3\b"),
        (shard_with("episode_000003.hdf5", attribute=0o120777 << 16), r"episode_000003\.hdf5.*\blink\b"),
        (shard_with("episode_000003.hdf5", compress=zipfile.ZIP_DEFLATED), r"episode_000003\.hdf5.*compressed"),
    ],
)
def test_a_shard_that_is_not_plain_is_refused(tmp_path, write, facts):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    with zipfile.ZipFile(dataset.path / "shard_000000.zip", "w") as archive:
        write(archive)
    with pytest.raises(FormatError, match=rf"shard_000000\.zip.*{facts}"):
        dataset.read(3)


def test_members_that_overlap_or_lie_are_refused(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    shard = dataset.path / "shard_000000.zip"
    with zipfile.ZipFile(shard, "w") as archive:
        shard_with("episode_000000.hdf5", "episode_000001.hdf5", content=episode_bytes(make_episode()))(archive)
    whole = shard.read_bytes()
    second = whole.index(b"episode_000001", 100) - 30
    directory = whole.index(b"PK\x01\x02")
    entry = whole.index(b"PK\x01\x02", directory + 4)
    for position, value in (
        (entry + 42, 0),  # the second begins where the first does
        (directory + 20, len(whole)),  # the first is as large as the shard, in both sizes
        (directory + 8, 1),  # encrypted
        (second, 0),  # no local header
    ):
        bad = bytearray(whole)
        bad[position : position + 4] = value.to_bytes(4, "little")
        if position == directory + 20:
            bad[directory + 24 : directory + 28] = value.to_bytes(4, "little")
        shard.write_bytes(bad)
        with pytest.raises(FormatError, match=r"shard_000000\.zip"):
            [dataset.read(index) for index in (0, 1)]


@pytest.fixture
def cache(tmp_path, monkeypatch, file):
    """An empty cache, and an episode file old enough to be remembered."""
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(header_cache, "SETTLED_NS", 0)
    forget()
    header(Extent.of_file(file))
    forget()
    (entry,) = (tmp_path / "cache" / "headers").iterdir()
    return entry


def no_examiner(monkeypatch):
    monkeypatch.setattr("svfl_data.storage.header.ask", lambda *_: pytest.fail("examined again"))


def test_an_unchanged_file_is_neither_hashed_nor_examined_again(cache, file, monkeypatch):
    no_examiner(monkeypatch)
    monkeypatch.setattr(Extent, "blocks", lambda self: pytest.fail("hashed again"))
    reader = EpisodeReader.of_file(file)
    np.testing.assert_array_equal(reader["cameras/front/color"][()], make_episode().arrays["cameras/front/color"])
    assert reader.meta == make_episode().meta
    assert not header(reader.extent).hashed


def test_whole_episodes_are_hashed_whatever_is_remembered(cache, file):
    before = file.stat()
    content = bytearray(file.read_bytes())
    content[-SEAL_SIZE - 9] ^= 1
    extent = Extent.of_file(file)
    header(extent)
    with open(file, "r+b") as same:
        same.write(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(FormatError, match=rf"{file.name}.*\b{len(content)} bytes.*seal"):
        EpisodeReader(extent).load()


@pytest.mark.parametrize("change", ["content", "times", "name"])
def test_a_changed_file_is_not_taken_for_the_remembered_one(cache, file, change):
    if change == "content":
        write_episode(make_episode(7), file)
    elif change == "times":
        os.utime(file, ns=(1, 1))
    else:
        write_episode(make_episode(7), file.with_name("other"))
        os.replace(file.with_name("other"), file)
    assert header(Extent.of_file(file)).hashed
    assert EpisodeReader.of_file(file).meta.index == (0 if change == "times" else 7)


@pytest.mark.parametrize("harm", ["cut", "flipped", "emptied", "replaced", "folder"])
def test_a_damaged_cache_is_no_cache(cache, file, harm):
    content = bytearray(cache.read_bytes())
    content[len(content) // 2] ^= 4
    cache.unlink()
    if harm == "folder":
        cache.mkdir()
    else:
        cache.write_bytes({"cut": content[:99], "flipped": content, "emptied": b"", "replaced": b"x" * 999}[harm])
    assert header(Extent.of_file(file)).hashed
    assert read_episode(file).meta.index == 0


def test_what_was_refused_or_is_fresh_is_not_remembered(tmp_path, monkeypatch, file):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    header(Extent.of_file(file))
    changed(file, external)
    monkeypatch.setattr(header_cache, "SETTLED_NS", 0)
    with pytest.raises(FormatError):
        header(Extent.of_file(file))
    assert not list((tmp_path / "cache").rglob("*.*"))
    assert not [found for found in (tmp_path / "cache").rglob("*") if found.is_file()]


def test_the_cache_drops_its_oldest(tmp_path, monkeypatch):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    for name, value in (("SETTLED_NS", 0), ("ENTRIES", 3), ("STORED_BETWEEN_SWEEPS", 1)):
        monkeypatch.setattr(header_cache, name, value)
    for number in range(8):
        write_episode(make_episode(number), tmp_path / f"{number}.hdf5")
        header(Extent.of_file(tmp_path / f"{number}.hdf5"))
    assert len(list((tmp_path / "cache" / "headers").iterdir())) <= 4


@pytest.mark.parametrize("array", [np.zeros(2, "f4,i4"), np.array(["a", None]), np.array(["text"])])
def test_nothing_is_written_that_could_not_be_read(array):
    with pytest.raises(FieldError, match=r"extra/own.*numbers"):
        Episode(make_episode().meta, make_episode().arrays | {"extra/own": array})


def test_an_own_file_needs_no_examiner(file, monkeypatch):
    forget()
    no_examiner(monkeypatch)
    know_own(Extent.of_file(file))
    assert read_episode(file).meta.index == 0


def test_an_unsealed_file_is_examined_as_any_other(file):
    whole = file.read_bytes()[:-SEAL_SIZE]
    file.write_bytes(whole)
    assert read_unsealed(file).meta == make_episode().meta
    with h5py.File(file, "a") as opened:
        external(opened)
    with pytest.raises(FormatError, match=r"streams/wrench/tare.*external storage"):
        read_unsealed(file)
    placement = header(Extent.of_file(rewritten(file))).placements["cameras/front/color"]
    offset, size, _ = placement.chunks[1]
    content = bytearray(whole)
    content[offset + size - 2] ^= 1  # of the checksum that HDF5 alone looks at
    file.write_bytes(content)
    with pytest.raises(FormatError, match=f"{file.name}.*cameras/front/color"):
        read_unsealed(file)


def rewritten(file: Path) -> Path:
    write_episode(make_episode(), file)
    return file
