"""Episodes whose arrays lie elsewhere: in other files, devices and pipes, behind links."""

import h5py
import numpy as np

from svfl_data.storage.seal import SEAL_SIZE
from tests.hostile.kind import add, content_of, episode_file, hostile, outside, write_resealed
from tests.hostile.making_episodes import reopened, replace

COLOR = "cameras/front/color"
ELSEWHERE = {
    "secret": lambda folder: str(outside(folder)),
    "relative": lambda folder: "outside/secret",
    "passwords": lambda folder: "/etc/passwd",
    "zeros": lambda folder: "/dev/zero",
    "pipe": lambda folder: str(outside(folder, "pipe")),
    "environment": lambda folder: "/proc/self/environ",
}


def _external(name):
    def make(folder):
        with reopened(folder) as file:
            shape = file[COLOR].shape
            size = int(np.prod(shape))
            replace(file, COLOR, shape=shape, dtype="u1", external=[(ELSEWHERE[name](folder), 0, size)])

    return make


for place in ELSEWHERE:
    add("hdf5", f"external_storage_{place}", "episode", _external(place))


@hostile("episode")
def external_storage_in_extra(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/notes", shape=(1000,), dtype="u1", external=[(str(outside(folder)), 0, 1000)])


@hostile("episode")
def external_storage_of_a_constant(folder):
    with reopened(folder) as file:
        replace(file, "streams/wrench/tare", shape=(6,), dtype="f8", external=[(str(outside(folder)), 24, 48)])


@hostile("episode")
def external_storage_many_files(folder):
    with reopened(folder) as file:
        places = [(str(outside(folder)), 24 + 10 * k, 10) for k in range(500)]
        file.create_dataset("extra/notes", shape=(5000,), dtype="u1", external=places)


@hostile("episode")
def external_link(folder):
    twin = outside(folder, "folder") / "other.hdf5"
    twin.write_bytes(content_of(episode_file(folder, 1)))
    with reopened(folder) as file:
        del file[COLOR]
        file[COLOR] = h5py.ExternalLink(str(twin), COLOR)


@hostile("episode")
def external_link_to_the_neighbour(folder):
    with reopened(folder) as file:
        del file["cameras"]
        file["cameras"] = h5py.ExternalLink("data/episode_000001.hdf5", "/cameras")


@hostile("episode")
def external_link_to_a_pipe(folder):
    with reopened(folder) as file:
        file["extra/x"] = h5py.ExternalLink(str(outside(folder, "pipe")), "/")


@hostile("episode")
def external_link_dangling(folder):
    with reopened(folder) as file:
        file["extra/x"] = h5py.ExternalLink("nowhere.hdf5", "/")


@hostile("episode")
def user_defined_link(folder):
    name = b"a_link_of_a_kind_that_no_one_knows"
    with reopened(folder) as file:
        file.create_group("extra")[name.decode()] = h5py.ExternalLink("nowhere.hdf5", "/")
    path = episode_file(folder)
    content = bytearray(content_of(path))
    at = content.index(name)
    for back in range(1, 12):
        if content[at - back] == 64:  # the type of an external link; those of users begin at 65
            content[at - back] = 77
            break
    else:
        raise AssertionError("the link's type was not found")
    write_resealed(path, bytes(content))


@hostile("episode")
def soft_link_dangling(folder):
    with reopened(folder) as file:
        file["extra/x"] = h5py.SoftLink("/nowhere")


@hostile("episode")
def soft_link_for_a_field(folder):
    with reopened(folder) as file:
        file.move(COLOR, "extra/color")
        file[COLOR] = h5py.SoftLink("/extra/color")


@hostile("episode")
def soft_link_to_itself(folder):
    with reopened(folder) as file:
        del file["cameras/front/depth"]
        file["cameras/front/depth"] = h5py.SoftLink("/cameras/front/depth")


@hostile("episode")
def soft_link_to_the_root(folder):
    with reopened(folder) as file:
        file["extra/again"] = h5py.SoftLink("/")


@hostile("episode")
def hard_link_cycle(folder):
    with reopened(folder) as file:
        file.create_group("extra/a")
        file["extra/a/root"] = file["/"]


@hostile("episode")
def hard_link_to_itself(folder):
    with reopened(folder) as file:
        group = file.create_group("extra/a")
        group["a"] = group


@hostile("episode")
def virtual_dataset(folder):
    twin = outside(folder, "folder") / "other.hdf5"
    twin.write_bytes(content_of(episode_file(folder, 1)))
    _virtual(folder, str(twin))


@hostile("episode")
def virtual_dataset_of_its_own_file(folder):
    _virtual(folder, ".")


@hostile("episode")
def virtual_dataset_of_the_sealed_neighbour(folder):
    _virtual(folder, "data/episode_000001.hdf5")


def _virtual(folder, source):
    with reopened(folder) as file:
        shape = file[COLOR].shape
        layout = h5py.VirtualLayout(shape=shape, dtype="u1")
        layout[...] = h5py.VirtualSource(source, COLOR, shape=shape)
        kept = dict(file[COLOR].attrs)
        del file[COLOR]
        file.create_virtual_dataset(COLOR, layout)
        for name, value in kept.items():
            file[COLOR].attrs[name] = value


@hostile("episode")
def content_outside_the_file(folder):
    """A contiguous array whose address lies in the seal: what is read is not what was sealed."""
    mark = 0x123456789ABCDEF0
    with reopened(folder) as file:
        replace(file, "streams/wrench/tare", data=np.full(6, mark, "<u8").view("<f8"))
        offset = file["streams/wrench/tare"].id.get_offset()
    path = episode_file(folder)
    content = content_of(path)
    address = offset.to_bytes(8, "little")
    assert content.count(address) == 1
    write_resealed(path, content.replace(address, (len(content) + SEAL_SIZE - 60).to_bytes(8, "little")))


@hostile("episode")
def object_references(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", data=np.array([file["cameras"].ref] * 3, dtype=h5py.ref_dtype))


@hostile("episode")
def region_references(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", data=np.array([file[COLOR].regionref[0:1]], dtype=h5py.regionref_dtype))


@hostile("episode")
def committed_type(folder):
    with reopened(folder) as file:
        file["extra/type"] = np.dtype("f8")


@hostile("episode")
def committed_type_for_a_field(folder):
    with reopened(folder) as file:
        del file["streams/joints/position"]
        file["streams/joints/position"] = np.dtype("f4")


@hostile("episode")
def group_for_a_field(folder):
    with reopened(folder) as file:
        del file["workspace"]
        file.create_group("workspace/workspace")


@hostile("episode")
def dataset_for_a_group(folder):
    with reopened(folder) as file:
        del file["streams"]
        file["streams"] = np.zeros(3)
