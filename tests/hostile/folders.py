"""Dataset folders with entries that are no episodes: links, pipes, devices, twins, look-alikes, leftovers."""

import os
import shutil

from tests.hostile.kind import SECRET, add, episode_file, hostile, outside

LOOKS = "a name that is no episode's: it is left out, and validate says so"


def _instead(make):
    """Something else under the first episode's name."""

    def spoil(folder):
        path = episode_file(folder)
        path.unlink()
        make(path, folder)

    return spoil


INSTEAD = {
    "link_to_a_secret": lambda path, folder: path.symlink_to(outside(folder)),
    "link_to_a_pipe": lambda path, folder: path.symlink_to(outside(folder, "pipe")),
    "link_to_zeros": lambda path, folder: path.symlink_to("/dev/zero"),
    "link_to_nowhere": lambda path, folder: path.symlink_to("nowhere"),
    "link_to_itself": lambda path, folder: path.symlink_to(path.name),
    "link_to_the_neighbour": lambda path, folder: path.symlink_to(episode_file(folder, 1).name),
    "link_to_a_folder": lambda path, folder: path.symlink_to(outside(folder, "folder")),
    "pipe": lambda path, folder: os.mkfifo(path),
    "folder": lambda path, folder: path.mkdir(),
    "socket": lambda path, folder: _socket(path),
    "no_permission": lambda path, folder: (shutil.copy(episode_file(folder, 1), path), path.chmod(0))[0],
}


def _socket(path):
    import socket

    here = os.getcwd()
    os.chdir(path.parent)  # names of sockets are short
    try:
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(path.name)
    finally:
        os.chdir(here)


for name, make in INSTEAD.items():
    legal = "root reads everything; its number is another one, which is a finding" if name == "no_permission" else ""
    add("folder", f"episode_{name}", "damage", _instead(make), legal)


@hostile("damage")
def episode_behind_a_link(folder):
    """A whole sealed episode, but it lies outside."""
    path = episode_file(folder)
    there = outside(folder, "folder") / path.name
    os.rename(path, there)
    path.symlink_to(there)


def _link(name, target, legal=""):
    def make(folder):
        path = folder / name
        shutil.rmtree(path, ignore_errors=True)
        path.symlink_to(outside(folder, target))

    add("folder", f"{name.strip('.')}_is_a_link_to_{target}", "folder", make, legal)


for name in ("splits", ".inflight", "damaged"):
    for target in ("folder", "secret", "pipe", "nothing"):
        _link(name, target, legal="only what has to do with it must refuse")


@hostile("folder", legal="only what has to do with it must refuse")
def card_pictures_elsewhere(folder):
    (folder / "README_files").symlink_to(outside(folder, "folder"))
    (folder / "README.md").symlink_to(outside(folder))


@hostile("damage")
def damage_and_its_place_elsewhere(folder):
    path = episode_file(folder)
    path.write_bytes(path.read_bytes()[:-1000])
    (folder / "damaged").symlink_to(outside(folder, "folder"))


@hostile("folder", legal="only what has to do with it must refuse")
def journals_elsewhere(folder):
    place = outside(folder, "folder")
    (place / "episode_000070.journal").write_bytes(SECRET)
    (folder / ".inflight").symlink_to(place)


@hostile("index", legal="the index is a cache")
def index_appended_outside(folder):
    path = folder / "index.jsonl"
    path.unlink()
    path.symlink_to(outside(folder, "lines"))


@hostile("index", legal="the index is a cache")
def index_made_outside(folder):
    path = folder / "index.jsonl"
    path.unlink()
    path.symlink_to(outside(folder, "folder") / "made")


TWINS = ("episode_0.hdf5", "episode_0000000.hdf5", "episode_00.hdf5")


def _twin(name, source):
    def make(folder):
        shutil.copy(episode_file(folder, source), folder / name)

    return make


for name in TWINS:
    add("twins", name.partition(".")[0], "folder", _twin(name, 0), legal=LOOKS)
add(
    "twins",
    "same_content_another_number",
    "folder",
    _twin("episode_000077.hdf5", 1),
    legal="a check calls it a finding",
)
add("twins", "another_script", "folder", _twin("episode_٣.hdf5", 0), legal=LOOKS)
add("twins", "endless_number", "folder", _twin("episode_" + "9" * 200 + ".hdf5", 0), legal=LOOKS)
add("twins", "int64", "folder", _twin(f"episode_{2**63}.hdf5", 0), legal=LOOKS)
add(
    "twins", "link", "folder", lambda folder: (folder / "episode_0.hdf5").symlink_to("episode_000000.hdf5"), legal=LOOKS
)


@hostile("folder", slow=True)
def thousands_of_empty_episodes(folder):
    for number in range(1000, 4000):
        episode_file(folder, number).touch()


@hostile("folder", legal=LOOKS)
def look_alikes(folder):
    for number in range(500):
        (folder / f"episode_{number:06d}.hdf5~").touch()
        (folder / f"episode_{number:06d}.hdf").touch()
    for name in ("episode_.hdf5", "Episode_000001.hdf5", "episode_-1.hdf5", "episode_1.hdf5\n", "episode_000000.h5"):
        (folder / name).touch()


@hostile("folder", legal=LOOKS)
def hostile_names(folder):
    for name in (
        "\x1b[31mred",
        "a\nb",
        "a\u202eb",
        b"\xff\xfe".decode(errors="surrogateescape"),
        "-rf",
        "$(id)",
        "%s%n",
    ):
        (folder / name).touch()
        (folder / f"{name}.hdf5").touch()
        (folder / f"shard_{name}.txt").touch()


@hostile("folder", legal="leftovers are told from living files and removed, or left alone")
def leftovers(folder):
    for name in (".dataset.json.x.part", ".episode_000000.hdf5.y.part", ".a\nb.part", ".\x1b[31m.part"):
        (folder / name).write_bytes(b"left")
    (folder / ".folder.part").mkdir()
    (folder / ".folder.part" / "inner").touch()
    (folder / ".link.part").symlink_to(outside(folder, "folder"))
    (folder / ".secret.part").symlink_to(outside(folder))
    os.mkfifo(folder / ".pipe.part")


@hostile("folder", legal="folders inside a dataset are somebody's")
def episodes_in_folders(folder):
    (folder / "more").mkdir()
    shutil.copy(episode_file(folder), folder / "more")
    (folder / "again").symlink_to(".")


@hostile("info")
def folder_of_nothing(folder):
    shutil.rmtree(folder)
    folder.mkdir()


@hostile("damage", legal="a dataset in which nothing is recorded yet looks the same")
def no_episodes(folder):
    for path in folder.glob("episode_*"):
        path.unlink()
