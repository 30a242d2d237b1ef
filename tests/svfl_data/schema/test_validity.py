"""One module decides what an episode may hold: memory, files, journals, the writer and validate say the same of it."""

import numpy as np
import pytest

from svfl_data.checks import check_file
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.declarations import STANDARD
from svfl_data.schema.episode import Camera, Episode, Meta
from svfl_data.schema.fields import FIELDS
from svfl_data.schema.validity import faults
from svfl_data.storage.reader import EpisodeReader
from tests.helpers.builders import make_episode
from tests.helpers.sealed import META, dataset_of
from tests.helpers.spoiled import INVALID, fresh

EVERY = pytest.mark.parametrize(("spoil", "field", "words"), INVALID.values(), ids=INVALID)


def test_a_sound_episode_has_no_faults():
    assert list(faults(fresh())) == []
    assert {field.possible[0] < field.possible[1] for field in FIELDS} == {True}


@EVERY
def test_memory_file_and_validate_refuse_alike(spoil, field, words, tmp_path):
    arrays = fresh()
    spoil(arrays)
    with pytest.raises(FieldError) as in_memory:
        Episode(META, arrays, name="e.hdf5")
    assert field in str(in_memory.value)
    assert words in str(in_memory.value)
    path = Dataset.open(dataset_of(tmp_path / "d", arrays)).episode_path(0)
    for read in (lambda reader: reader.load(), lambda reader: reader.paths, lambda reader: reader.meta):
        with pytest.raises(FieldError) as in_file:
            read(EpisodeReader.of_file(path))
        assert str(in_file.value) == str(in_memory.value).replace("e.hdf5", str(path), 1)
    (found,) = check_file(path)
    assert (found.severity, found.field) == ("error", field)
    assert words in found.words


def record(dataset, arrays):
    """Gripper arrays to the writer, group by group."""
    constants = {path: array for path, array in arrays.items() if not STANDARD.at(path).grows}
    late = {path: constants.pop(path) for path in list(constants) if path.startswith("labels/")}
    groups: dict[str, dict[str, np.ndarray]] = {}
    for path in sorted(arrays.keys() - constants.keys() - late.keys()):
        group, _, name = path.rpartition("/")
        groups.setdefault(group, {})[name] = arrays[path]
    with EpisodeWriter(dataset, Meta("centering", NEXT, 0, "robot", False), constants) as writer:
        for group, columns in groups.items():
            writer.append(group, **columns)
        writer.seal(success=True, constants=late)


@EVERY
def test_the_writer_refuses_the_same(spoil, field, words, tmp_path):
    arrays = fresh()
    spoil(arrays)
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    with pytest.raises(FieldError, match=field):
        record(dataset, arrays)
    assert not dataset.own_files()


def test_images_are_checked_by_shape_only():
    class Unread:
        """Gives no number away."""

        def __init__(self, array):
            self.dtype, self.shape = array.dtype, array.shape

    arrays = fresh()
    arrays |= {path: Unread(arrays[path]) for path in ("cameras/front/color", "cameras/front/depth")}
    assert list(faults(arrays)) == []


def test_a_property_that_lacks_what_it_is_made_of_says_what():
    camera = Camera("front", {"depth": np.ones((1, 2, 2), np.uint16)})
    with pytest.raises(AttributeError, match=r"front.*depth_scale"):
        camera.depth_m  # noqa: B018
    with pytest.raises(AttributeError, match=r"'deep'.*\bdepth\b"):
        camera.deep  # noqa: B018
    episode = make_episode()
    object.__setattr__(episode, "arrays", {})
    with pytest.raises(AttributeError, match="streams/wrench/wrench"):
        episode.tared_wrench  # noqa: B018
