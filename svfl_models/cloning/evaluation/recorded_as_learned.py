"""Refuses recordings that differ from the training data of a policy."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.system.printable import printable
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.deployment_spec import OTHER_RATE, DeploymentSpec, deployment_of, deployment_of_own
from svfl_models.cloning.module import CloningModule


def expect_fitting(
    module: CloningModule, dataset: Dataset, episodes: Sequence[int], config: CloningConfig
) -> DeploymentSpec:
    """Return the conditions under which a policy is given recorded observations, after a comparison with its own.

    Args:
        module: The trained policy.
        dataset: Dataset of the recordings.
        episodes: Indices of the episodes that are used.
        config: Configuration of the policy's training.

    Returns:
        The policy's own conditions, as it keeps them when it acts, with the recordings' unit of depth.

    Raises:
        DatasetError: If the recordings have another camera, other inputs, another action or another control rate, or an
            episode is not usable.
        FieldError: If an episode lacks a field.
    """
    learned = module.deployment
    found = (_own if learned.inputs else _paper)(learned, dataset, episodes, config)
    rate = found.step_ms / learned.step_ms if found.step_ms and learned.step_ms else 1.0
    if not 1 / OTHER_RATE < rate < OTHER_RATE:
        _refuse(dataset, "step_ms", learned.step_ms, found.step_ms)
    return replace(learned, depth_scale=found.depth_scale)


def _paper(learned: DeploymentSpec, dataset: Dataset, episodes: Sequence[int], config: CloningConfig) -> DeploymentSpec:
    uses = ["streams/wrench"] if "f" in config.encoder else []
    uses += [f"cameras/{learned.camera}"] if learned.camera else []
    found = deployment_of(dataset, episodes, learned.camera or None, config.encoder)
    check_usable(dataset, episodes, uses)
    if learned.camera:
        if found.image_side != learned.image_side:
            _refuse(dataset, f"image_side of {learned.camera}", learned.image_side, found.image_side)
        if not np.allclose(found.image_axes, learned.image_axes):
            _refuse(dataset, f"image_axes of {learned.camera}", learned.image_axes, found.image_axes)
    return found


def _own(learned: DeploymentSpec, dataset: Dataset, episodes: Sequence[int], config: CloningConfig) -> DeploymentSpec:
    symmetric = config.group != "none" or config.rotate
    found = deployment_of_own(dataset, episodes, config.inputs, config.action, symmetric)
    for one, other in zip(learned.inputs, found.inputs, strict=True):
        for name, value in one.items():
            if name != "offset" and not _same(other[name], value):
                _refuse(dataset, f"{name} of {one['path']}", value, other[name])
    assert learned.action is not None
    assert found.action is not None
    for name, value in learned.action.items():
        if not _same(found.action[name], value):
            _refuse(dataset, f"{name} of {config.action}", value, found.action[name])
    if not np.allclose(found.image_axes, learned.image_axes):
        _refuse(dataset, "image_axes", learned.image_axes, found.image_axes)
    groups = {one["path"] if one["kind"] == "image" else one["path"].rpartition("/")[0] for one in learned.inputs}
    check_usable(dataset, episodes, sorted(groups))
    return found


def _same(one: Any, other: Any) -> bool:  # noqa: ANN401 - plain values of a checkpoint
    """Return whether two plain values are the same, where lists and tuples are."""
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)


def _refuse(dataset: Dataset, what: str, learned: object, found: object) -> None:
    raise DatasetError(
        f"{dataset.path}: the policy learned from {printable(what, 60)} {printable(learned, 80)}, the recordings have "
        f"{printable(found, 80)}"
    )
