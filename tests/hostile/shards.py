"""Datasets whose episodes lie in a hostile ZIP file."""

import io
import struct
import zipfile

from tests.hostile.kind import add, episode_file, outside
from tests.hostile.making_episodes import zeros_deflated

SHARD = "shard_000000.zip"
STORED, DEFLATED = zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED
COUNT = 10
OTHER = "episode_000077.hdf5"
NO_EPISODE = "a member of another name is no episode, or refused"
NOT_HERE = 2**32 - 1  # but in the 64-bit fields


def _taken(folder):
    """The episodes' bytes by name; their own files are gone."""
    found = {}
    for index in range(COUNT):
        path = episode_file(folder, index)
        found[path.name] = path.read_bytes()
        path.unlink()
    return found


def _zipped(members, compression=STORED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members:
            archive.writestr(name if isinstance(name, zipfile.ZipInfo) else zipfile.ZipInfo(name), content, compression)
    return buffer.getvalue()


def _shard(change, legal=""):
    """A shard of all episodes; `change` gets their names and bytes, and gives the shard's."""

    def make(folder):
        (folder / SHARD).write_bytes(change(folder, _taken(folder)))

    return make


def _more(name, content=b"x"):
    return lambda folder, found: _zipped([*found.items(), (name, content)])


def _info(name, **attributes):
    info = zipfile.ZipInfo(name)
    for key, value in attributes.items():
        setattr(info, key, value)
    return info


def _patched(edit):
    def change(folder, found):
        content = bytearray(_zipped(found.items()))
        edit(content)
        return bytes(content)

    return change


def _central(content, number=0):
    """Where an entry of the central directory begins."""
    at = content.index(b"PK\x01\x02")
    for _ in range(number):
        at = content.index(b"PK\x01\x02", at + 4)
    return at


def _set32(content, at, value):
    content[at : at + 4] = struct.pack("<I", value)


def _overlapping(content):
    first, second = _central(content), _central(content, 1)
    content[second + 42 : second + 46] = content[first + 42 : first + 46]


def _without_two_entries(content):
    del content[_central(content, 3) : _central(content, 5)]


def _inverted(content):
    content[5000:5010] = bytes(255 - byte for byte in content[5000:5010])


def _commented(content):
    content[-2:] = b"\x05\x00"
    content.extend(b"\x1b[31m")


def _bomb(folder, found):
    """A member that says it is an episode of a few bytes and is two gigabytes of zeros."""
    first = next(iter(found))
    packed = zeros_deflated(2 * 2**30)[2:-4]
    info = _info(first, compress_type=DEFLATED)
    header = struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 8, 0, 33, 0, len(packed), 2**31, len(first), 0)
    local = header + first.encode() + packed
    entry = struct.pack(
        "<4s6H3I5H2I", b"PK\1\2", 20, 20, 0, 8, 0, 33, 0, len(packed), 2**31, len(first), 0, 0, 0, 0, 0, 0
    )
    central = entry + first.encode()
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 1, 1, len(central), len(local), 0)
    assert info.filename == first
    return local + central + end


def _zip64(folder, found):
    """A directory that says, by its 64-bit fields, that the first member is larger than any disk."""
    name, content = next(iter(found.items()))
    extra = struct.pack("<HHQQQ", 1, 24, 2**62, 2**62, 2**61)
    local = struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 0, 0, 33, 0, len(content), len(content), len(name), 0)
    local += name.encode() + content
    entry = struct.pack(
        "<4s6H3I5H2I", b"PK\1\2", 45, 45, 0, 0, 0, 33, 0, NOT_HERE, NOT_HERE, len(name), len(extra), *[0] * 4, NOT_HERE
    )  # fmt: skip
    central = entry + name.encode() + extra
    return local + central + struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 1, 1, len(central), len(local), 0)


def _many(folder, found):
    return _zipped([*found.items(), *((f"note_{number}.txt", b"") for number in range(50_000))])


FORMS = {
    "dots": (_more("../outside/episode_000077.hdf5"), ""),
    "dots_within": (_more("a/../../x"), ""),
    "absolute": (_more("/tmp/episode_000077.hdf5"), ""),
    "backslashes": (_more("..\\..\\x"), ""),
    "drive": (_more("C:/x"), ""),
    "folder": (_more("more/episode_000077.hdf5"), NO_EPISODE),
    "other_file": (_more("README.md"), NO_EPISODE),
    "escapes": (_more("\x1b[31m\nsvfl-data: fine"), NO_EPISODE),
    "link": (
        lambda folder, found: _zipped(
            [*found.items(), (_info(OTHER, external_attr=0o120777 << 16, create_system=3), str(outside(folder)))]
        ),
        "",
    ),
    "duplicate": (lambda folder, found: _zipped([*found.items(), *list(found.items())[:1]]), ""),
    "duplicate_other": (
        lambda folder, found: _zipped([*found.items(), ("episode_000000.hdf5", found["episode_000001.hdf5"])]), "",
    ),
    "same_number": (_more("episode_0.hdf5", b"x"), NO_EPISODE),
    "endless_number": (_more("episode_" + "9" * 5000 + ".hdf5", b"x"), NO_EPISODE),
    "compressed": (lambda folder, found: _zipped(found.items(), DEFLATED), ""),
    "encrypted": (_patched(lambda content: content.__setitem__(_central(content) + 8, 1)), ""),
    "overlapping": (_patched(_overlapping), ""),
    "offset_beyond": (_patched(lambda content: _set32(content, _central(content) + 42, 2**32 - 2)), ""),
    "size_beyond": (_patched(lambda content: _set32(content, _central(content) + 24, 2**31)), ""),
    "size_zero": (_patched(lambda content: _set32(content, _central(content) + 24, 0)), ""),
    "sizes_differ": (_patched(lambda content: _set32(content, _central(content) + 24, 100)), ""),
    "local_name_other": (_patched(lambda content: content.__setitem__(slice(30, 37), b"eXisode")), ""),
    "local_extra_long": (_patched(lambda content: content.__setitem__(slice(28, 30), b"\xff\xff")), ""),
    "no_local_header": (_patched(lambda content: content.__setitem__(slice(0, 4), b"XXXX")), ""),
    "no_directory": (_patched(lambda content: content.__delitem__(slice(_central(content), None))), ""),
    "half_a_directory": (_patched(_without_two_entries), ""),
    "truncated": (_patched(lambda content: content.__delitem__(slice(len(content) // 2, None))), ""),
    "count_lies": (_patched(lambda content: content.__setitem__(slice(-12, -10), b"\xff\xff")), "it is counted again"),
    "zip64_lies": (_zip64, "an episode that lies beyond its shard is listed as one that cannot be read"),
    "bomb": (_bomb, ""),
    "prepended": (lambda folder, found: b"#!/bin/sh\n" * 100 + _zipped(found.items()), "a ZIP file may begin later"),
    "a_secret_between": (lambda folder, found: _zipped(found.items()) + b"x" * 100, "a ZIP file may have a tail"),
    "empty": (lambda folder, found: b"", ""),
    "empty_archive": (lambda folder, found: _zipped([]), ""),
    "text": (lambda folder, found: b"hello", ""),
    "damaged_member": (_patched(_inverted), ""),
    "comment": (_patched(_commented), "a ZIP file may have a comment"),
}  # fmt: skip
for name, (change, legal) in FORMS.items():
    add("shards", name, "shard", _shard(change), legal)
add("shards", "many_members", "shard", _shard(_many), NO_EPISODE, slow=True)
add("shards", "escapes_and_damage", "folder", _shard(_more("episode_000077.hdf5", b"\x1b[31m")))


def _link(target):
    def make(folder):
        _taken(folder)
        (folder / SHARD).symlink_to(target(folder))

    return make


def _whole_behind_a_link(folder):
    there = outside(folder, "folder") / "shard.zip"
    there.write_bytes(_zipped(_taken(folder).items()))
    (folder / SHARD).symlink_to(there)


def _pipe(folder):
    import os

    _taken(folder)
    os.mkfifo(folder / SHARD)


def _folder(folder):
    _taken(folder)
    (folder / SHARD).mkdir()


add("shards", "link_to_a_secret", "shard", _link(outside))
add("shards", "link_to_zeros", "shard", _link(lambda folder: "/dev/zero"))
add("shards", "link_to_a_pipe", "shard", _link(lambda folder: outside(folder, "pipe")))
add("shards", "link_to_nowhere", "shard", _link(lambda folder: "nowhere"))
add("shards", "whole_behind_a_link", "shard", _whole_behind_a_link)
add("shards", "pipe", "shard", _pipe)
add("shards", "folder_of_its_name", "shard", _folder)


def _beside(folder):
    """Whole episodes, and beside them a shard that is none."""
    (folder / "shard_x.zip").write_bytes(b"hello")


def _names(folder):
    for name in ("shard_.zip", "shard_\x1b[31m.zip", "shard_a\nb.zip"):
        (folder / name).write_bytes(_zipped([("episode_000055.hdf5", b"x")]))


add("shards", "beside", "shard", _beside)
add("shards", "names", "folder", _names)
