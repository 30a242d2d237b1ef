"""Saved buffers of inputs of one's own from strangers: refused in one line, or sound enough to be drawn from."""

import copy
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from svfl_data.errors import FormatError
from svfl_data.replay import ReplayBuffer
from tests.helpers.replay_inputs import MOVING
from tests.hostile.buffers import BUFFERS

ODD = [None, -1, 0, 2, 10**6, 10**15, 1e308, 0.5, "", "x", "float64", "invariant", [], [0], {}, True]


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    file = tmp_path_factory.mktemp("saved") / "own.replay"
    buffer = MOVING.lived(capacity=20, rotate=True, crop=10)
    buffer.sample(4)
    buffer.save(file)
    return file


def leaves(value, path=()):
    """Paths of all values inside of JSON, those of lists and objects too."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in inner:
        yield from leaves(item, (*path, key))


def forged(saved: Path, change) -> Path:
    """A copy whose header is another one."""
    other = saved.with_name("forged.replay")
    with zipfile.ZipFile(saved) as archive, zipfile.ZipFile(other, "w") as target:
        for name in archive.namelist():
            content = archive.read(name)
            target.writestr(name, json.dumps(change(json.loads(content))) if name == "replay.json" else content)
    return other


def refused_or_sound(file: Path) -> bool:
    """Whether a file was refused; in one line, or else it can be drawn from."""
    words = ""
    try:
        ReplayBuffer.load(file).sample(3)
    except FormatError as error:
        words = str(error)
    assert "\n" not in words
    assert not words or words.startswith(f"{file}: ")
    return bool(words)


@settings(deadline=None, max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_value_of_the_specification_may_be_another(saved, data):
    with zipfile.ZipFile(saved) as archive:
        header = json.loads(archive.read("replay.json"))
    path = data.draw(st.sampled_from([("spec", *path) for path in leaves(header["spec"])]))
    odd = data.draw(st.sampled_from(ODD))

    def change(found):
        owner = found
        for key in path[:-1]:
            owner = owner[key]
        if data.draw(st.booleans()):
            del owner[path[-1]]
        else:
            owner[path[-1]] = copy.deepcopy(odd)
        return found

    refused_or_sound(forged(saved, change))


@pytest.mark.parametrize(
    ("moving", "facts"),
    [
        (["front", "side", "wrist"], r"cameras/front/T_base_camera is of a camera that moves"),
        (["side", "wrist", "top"], r"moving.*top.*front.*side.*wrist"),
        (["wrist", "side"], "moving"),
        (["side", "wrist", "wrist"], "moving"),
        (["wrist"], r"rotate: cameras/side has no fixed pose"),
        ([], r"rotate: cameras/side has no fixed pose"),
        ("wrist", "moving"),
        ([["wrist"]], "moving"),
        ({"wrist": True}, "moving"),
        (None, "moving"),
    ],
)
def test_cameras_that_are_said_to_move_are_those_that_do(saved, moving, facts):
    other = forged(saved, lambda found: found | {"spec": found["spec"] | {"moving": moving}})
    with pytest.raises(FormatError, match=rf"forged\.replay: [^\n]*{facts}[^\n]*$"):
        ReplayBuffer.load(other)


def test_fixed_axes_of_a_camera_that_moves_are_refused(saved):
    def change(found):
        found["spec"]["constants"]["cameras/wrist/image_axes"] = np.eye(2).tolist()
        return found

    with pytest.raises(FormatError, match=r"cameras/wrist/image_axes is of a camera that moves[^\n]*$"):
        ReplayBuffer.load(forged(saved, change))


@pytest.mark.parametrize("name", BUFFERS)
def test_hostile_files_are_refused(saved, name, tmp_path):
    BUFFERS[name](saved, tmp_path / "b.replay", tmp_path)
    assert refused_or_sound(tmp_path / "b.replay")


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_refused_or_changes_nothing(saved, data):
    """One bit anywhere: an error of one line, or a bit that means nothing (the date of a member)."""
    whole = saved.read_bytes()
    place = data.draw(st.integers(len(whole) - 4000 if data.draw(st.booleans()) else 0, len(whole) - 1))
    damaged, other = bytearray(whole), saved.with_name("damaged.replay")
    damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    other.write_bytes(damaged)
    if not refused_or_sound(other):
        ReplayBuffer.load(other).save(other)
        assert other.read_bytes() == whole


@pytest.mark.parametrize("array", ["rows/streams/wrench", "padded/cameras/front", "age/streams/tactile"])
def test_rows_that_are_not_there_are_refused(saved, array, tmp_path):
    def change(value):
        def made(content):
            found = np.load(io.BytesIO(content))
            found[1] = value
            np.lib.format.write_array(target := io.BytesIO(), found, (1, 0))
            return target.getvalue()

        return made

    for value in (-1, 10**6 if not array.startswith("age") else np.nan):
        other = tmp_path / "rows.replay"
        with zipfile.ZipFile(saved) as archive, zipfile.ZipFile(other, "w") as target:
            for name in archive.namelist():
                content = archive.read(name)
                target.writestr(name, change(value)(content) if name == f"0/{array}.npy" else content)
        with pytest.raises(FormatError, match=f"rows\\.replay: [^\\n]*{array}[^\\n]*$"):
            ReplayBuffer.load(other)
