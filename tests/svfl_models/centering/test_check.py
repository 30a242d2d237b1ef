"""The check passes what is symmetric, fails what is not, and says which."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import nearest_direction
from svfl_models import cli
from svfl_models.centering.check import EXACT, PRECISIONS, check, expect_symmetric
from svfl_models.centering.compatibility import expect_fit
from svfl_models.commands import check as command
from svfl_models.symmetry.groups import GROUPS
from tests.helpers.builders import make_episode
from tests.helpers.command_page import item_keys, json_keys
from tests.helpers.trained import untrained, write

pytestmark = pytest.mark.slow


def checked(samples, precision="32", elements=None, **choices):
    module, config = untrained(samples, **{"image_size": 16} | choices)
    return check(module, samples.take(np.arange(12)), config, elements, precision)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("target", ["direction", "offset"])
def test_a_symmetric_network_passes(samples, precision, target):
    rows = checked(samples, precision=precision, target=target)
    assert len(rows) == 8
    assert {row.expected for row in rows} == {EXACT}
    assert max(row.worst for row in rows) < PRECISIONS[precision].tolerance
    expect_symmetric(rows, precision, "network")
    if precision != "bf16":  # whose rounding may turn a close decision
        assert len({row.accuracy for row in rows}) == 1
    assert [row.name for row in rows][3:5] == ["270 deg", "0 deg, mirrored"]


def test_numbers_are_computed_with_in_the_precision_that_is_asked_for(samples):
    """Whether rounding breaks a symmetry depends on the processor: one that rounds only sums may keep it exactly.

    That inputs and weights are rounded does not: to 2^-9 of their size in bfloat16, to 2^-25 in float32. A factor of
    100 between the outputs leaves 2^9 for errors that cancel.
    """
    module, config = untrained(samples, image_size=16)
    outputs = {}
    for precision in PRECISIONS:
        said = []
        hook = module.classifier.register_forward_hook(lambda *call, said=said: said.append(call[-1]))
        check(module, samples.take(np.arange(12)), config, precision=precision)
        hook.remove()
        outputs[precision] = said[0]
    assert outputs["64"].dtype == torch.float64
    assert outputs["32"].dtype == torch.float32
    error = {name: (values.double() - outputs["64"]).norm() for name, values in outputs.items()}
    assert error["bf16"] > 100 * error["32"] > 0
    assert error["bf16"] < PRECISIONS["bf16"].tolerance * outputs["64"].norm()


def test_a_plain_network_errs_at_everything_but_nothing(samples):
    identity, *others = checked(samples, group="none")
    assert identity.output_error == 0
    assert min(row.output_error for row in others) > 0.1
    assert {(row.expected, row.hidden_error) for row in others} == {("no symmetry", None)}
    expect_symmetric([identity, *others], "32", "network")  # it never promised anything


@pytest.mark.slow
def test_force_is_exact_at_any_angle_and_images_are_not(samples):
    """Between quarter turns there are no scores to compare, but there are features."""
    force = checked(samples, encoder="f", group="D8")
    assert {row.expected for row in force} == {EXACT}
    assert max(row.hidden_error for row in force) < 1e-5
    assert [row.output_error is None for row in force] == [False, True] * 8
    seen = checked(samples, group="D8")
    assert [row.expected for row in seen] == [EXACT, "interpolated"] * 8
    assert 1e-3 < max(row.hidden_error for row in seen) < 1


def test_elements_that_the_network_lacks(samples):
    rows = checked(samples, elements=GROUPS["D4"], group="C4", encoder="f")
    assert [row.expected for row in rows] == [EXACT] * 4 + ["not in C4"] * 4
    assert min(row.output_error for row in rows[4:]) > 0.01
    expect_symmetric(rows, "32", "network")


def test_a_polar_torque_is_told_apart_from_damage(samples):
    module, config = untrained(samples, encoder="f", torque="polar")
    rows = check(module, samples, config)
    assert [row.expected for row in rows] == [EXACT] * 4 + ["polar torque"] * 4
    expect_symmetric(rows, "32", "network")
    with pytest.raises(TrainingError, match=r"liar: .* mirrored"):
        expect_symmetric(check(module, samples, replace(config, torque="axial")), "32", "liar")


def test_directions_turn_with_the_offsets(samples):
    """Between quarter turns the truth is the class of the turned offset."""
    module, config = untrained(samples, encoder="f", group="D8", target="offset")
    accuracies = [row.accuracy for row in check(module, samples, config)]
    assert (nearest_direction(samples.offset) == samples.direction).all()
    assert len(set(accuracies[::2])) == 1
    assert len(set(accuracies[1::2])) == 1  # other samples are near a border there


def damage(module, by):
    """Add to some numbers of the first layer's first kernel."""
    kernels = next(buffer for name, buffer in module.named_buffers() if name.endswith("kernels"))
    kernels[0, 0] += by


@pytest.mark.parametrize("value", [1e-3, torch.nan])
def test_damage_is_found(samples, value):
    module, config = untrained(samples, encoder="f")
    damage(module, value)
    with pytest.raises(TrainingError, match="damaged"):
        expect_symmetric(check(module, samples, config), "32", "network")


@pytest.mark.parametrize(
    ("name", "components", "factor", "quantity"),
    [
        ("wrench", slice(0, 3), 1000, "force"),
        ("wrench", slice(3, 6), 1e-3, "torque"),
        ("image", slice(3, 4), 1000, "depth"),
        ("image", slice(0, 3), 255, "colour"),
    ],
)
def test_statistics_of_another_dataset(samples, name, components, factor, quantity):
    module, config = untrained(samples)
    normalization = module.classifier.trunk.normalization
    expect_fit(normalization, samples, config.encoder, "run", "data")
    values = getattr(samples, name).copy()
    (np.moveaxis(values, 1, -1) if name == "image" else values)[..., components] *= factor
    other = replace(samples, **{name: values})
    with pytest.raises(TrainingError, match=rf"^data: .*{quantity} .*[\d.]+ times .*\brun\b"):
        expect_fit(normalization, other, config.encoder, "run", "data")
    expect_fit(normalization, other, "f" if name == "image" else "v", "run", "data")  # it does not look there


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(6):
        write_episode(make_episode(index, steps=3, size=76), folder / f"episode_{index:06d}.hdf5")
    return folder


@pytest.fixture(scope="module")
def module(dataset):
    return untrained(load_centering(dataset), image_size=16)[0]


@pytest.mark.slow
def test_the_command(dataset, module, tmp_path, capsys):
    file = write(module, tmp_path / "checkpoint.ckpt")
    assert cli.main(["check", str(file), "--data", str(dataset), "--episodes", "4"]) == 0
    printed = capsys.readouterr().out
    assert "group D4, 4 episodes" in printed
    assert printed.count("exact") == 8
    assert "270 deg, mirrored" in printed
    assert max(map(len, printed.splitlines()[1:])) <= 80
    assert cli.main(["check", str(file), "--data", str(dataset), "--episodes", "4", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told.keys() == json_keys("svfl-train check")
    assert [one.keys() for one in told["elements"]] == [item_keys("svfl-train check")] * 8


@pytest.mark.slow
def test_the_command_fails_on_damage_and_on_other_data(dataset, module, samples, tmp_path, capsys):
    damaged = copy.deepcopy(module)
    damage(damaged, 1)
    file = write(damaged, tmp_path / "damaged.ckpt")
    assert cli.main(["check", str(file), "--data", str(dataset)]) == 1
    streams = capsys.readouterr()
    assert "exact" in streams.out
    assert streams.err.startswith(f"svfl-train: {file}: ")
    assert "damaged" in streams.err

    other = untrained(replace(samples, wrench=samples.wrench / 1000), encoder="f")[0]
    assert cli.main(["check", str(write(other, tmp_path / "other.ckpt")), "--data", str(dataset)]) == 1
    error = capsys.readouterr().err
    assert str(dataset) in error
    assert "force" in error
    assert "other.ckpt" in error
    assert error.count("\n") == 1


def test_the_command_offers_what_there_is():
    assert tuple(PRECISIONS) == command.PRECISIONS
