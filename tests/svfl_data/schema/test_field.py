"""A declaration is the same however it was written: as tuples or lists, with integers, floats or numbers of NumPy."""

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.action_fields import joint_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Meta
from svfl_data.schema.field import MEANING, Field, parsed
from svfl_data.symmetry import Part

NAMES = ("pan", "lift", "gripper")
AS_FLOATS = joint_action(((-3.0, 3.0), (-3.0, 3.0), (0.0, 1.0)), NAMES)
ALIKE = {
    "integers": joint_action(((-3, 3), (-3, 3), (0, 1)), NAMES),
    "lists": joint_action([[-3, 3], [-3, 3], [0, 1]], list(NAMES)),
    "NumPy": joint_action(np.array([[-3, 3], [-3, 3], [0, 1]], np.float32), NAMES),
}


@pytest.mark.parametrize("kind", ALIKE)
def test_equal_declarations_are_equal_and_come_back_equal(kind):
    field = ALIKE[kind]
    assert field == AS_FLOATS
    assert hash(field) == hash(AS_FLOATS)
    assert Declarations([field]) == Declarations([AS_FLOATS])
    assert field.texts == AS_FLOATS.texts
    assert Declarations([parsed(field.path, field.dtype, [field.attributes[name] for name in MEANING])]).own[0] == field


@pytest.mark.parametrize("kind", ALIKE)
def test_the_second_episode_of_a_program_agrees_with_the_first(tmp_path, kind):
    """The setup of the first one is read from its file, that of the second one from its program."""
    dataset = Dataset.create_or_resume(tmp_path / "mine", "wiping", 0, {})
    for _ in range(2):
        with EpisodeWriter(dataset, Meta("wiping", NEXT, 0, "robot", True), {}, [ALIKE[kind]]) as writer:
            writer.append("observations", t_ns=np.array([0, 50_000_000]))
            writer.append("actions", action=np.zeros((1, 3), np.float32))
            writer.seal()
    assert Dataset.open(dataset.path).indices == [0, 1]


def test_lists_of_a_field_of_ones_own_come_back():
    field = Field(path="observations/wind", dtype="float32", shape=["N+1", 2], components=["x", "y"],
                  parts=[Part("vector", [0, 1])], assumed=["unit"])  # fmt: skip
    assert parsed(field.path, field.dtype, field.texts) == field


@pytest.mark.parametrize("bounds", [(0.0, 1.0, 2.0), ((0, 1, 2),) * 3, ("ab", "cd", "ef")])
def test_bounds_that_are_no_pairs_are_said_to_be_none(bounds):
    with pytest.raises(FieldError, match="bounds are pairs of a lower and an upper one"):
        Declarations([joint_action(bounds, NAMES)])
