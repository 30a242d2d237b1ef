import dataclasses

import numpy as np
import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_models.data import CenteringData, centre_crop, random_crop


def test_centre_crop_takes_the_middle():
    image = torch.arange(76.0).expand(1, 4, 76, 76)
    assert centre_crop(image)[0, 0, 0].tolist() == list(range(6, 70))


def test_random_crops_are_windows_at_every_place():
    rows, columns = torch.meshgrid(torch.arange(76.0), torch.arange(76.0), indexing="ij")
    image = torch.stack([rows, columns, rows, columns]).expand(2000, 4, 76, 76)
    crops = random_crop(image)
    assert crops.shape == (2000, 4, 64, 64)
    corner = crops[:, :, 0, 0]
    assert set(corner.flatten().tolist()) == set(range(13))
    assert not torch.equal(corner[:, 0], corner[:, 1])
    expected = image[0, :, :64, :64] + corner[..., None, None]
    assert torch.equal(crops, expected)


def test_an_image_of_the_crops_size_is_kept():
    image = torch.randn(3, 4, 64, 64)
    assert torch.equal(random_crop(image), image)
    assert torch.equal(centre_crop(image), image)


def test_an_epoch_serves_every_sample_once(samples):
    data = CenteringData(samples, samples.take(np.arange(10)), "vf", batch_size=16)
    batches = list(data.train_dataloader())
    assert [len(batch["direction"]) for batch in batches] == [16, 16, 8]
    served = torch.cat([batch["wrench"] for batch in batches])
    assert sorted(served[:, -1, 2].tolist()) == sorted(samples.wrench[:, -1, 2].tolist())
    test = list(data.val_dataloader())
    assert torch.equal(torch.cat([batch["direction"] for batch in test]), torch.from_numpy(samples.direction[:10]))


@pytest.mark.parametrize(("encoder", "fields"), [("v", {"image"}), ("f", {"wrench"}), ("vf", {"image", "wrench"})])
def test_batches_hold_what_the_encoder_looks_at(encoder, fields, samples):
    batch = next(iter(CenteringData(samples, samples, encoder).train_dataloader()))
    assert set(batch) == fields | {"direction"}


def test_poisoned_samples_are_refused_by_episode(samples):
    wrench = samples.wrench.copy()
    wrench[7, 3, 2] = np.nan
    with pytest.raises(TrainingError, match="wrench of episode 7 holds NaN or infinity"):
        CenteringData(samples, dataclasses.replace(samples, wrench=wrench), "vf")
    small = dataclasses.replace(samples, image=samples.image[..., :32, :32])
    with pytest.raises(TrainingError, match="images are 32 x 32 pixels; needed: square, at least 64 x 64"):
        CenteringData(small, samples, "vf")
