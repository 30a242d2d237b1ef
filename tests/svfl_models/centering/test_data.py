import dataclasses

import numpy as np
import pytest
import torch

from svfl_data.errors import TrainingError
from svfl_data.symmetry import nearest_direction
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.data import CenteringData, Crops
from svfl_models.networks.image_crops import centre_crop, crop_side, random_crop, scaled


def config(encoder="vf", **options):
    return TrainingConfig("drawn", encoder=encoder, **options)


def test_centre_crop_takes_the_middle():
    image = torch.arange(76.0).expand(1, 4, 76, 76)
    assert centre_crop(image, 64)[0, 0, 0].tolist() == list(range(6, 70))


def test_random_crops_are_windows_at_every_place():
    rows, columns = torch.meshgrid(torch.arange(76.0), torch.arange(76.0), indexing="ij")
    image = torch.stack([rows, columns, rows, columns]).expand(2000, 4, 76, 76)
    crops = random_crop(image, 64)
    assert crops.shape == (2000, 4, 64, 64)
    corner = crops[:, :, 0, 0]
    assert set(corner.flatten().tolist()) == set(range(13))
    assert not torch.equal(corner[:, 0], corner[:, 1])
    expected = image[0, :, :64, :64] + corner[..., None, None]
    assert torch.equal(crops, expected)


def test_a_crop_beyond_the_edge_continues_it():
    rows, columns = torch.meshgrid(torch.arange(76.0), torch.arange(76.0), indexing="ij")
    image = torch.stack([rows, columns, rows, columns]).expand(2000, 4, 76, 76)
    crops = random_crop(image, 64, beyond=8)
    middle = crops[:, :, 32, 32]
    assert set(middle.flatten().tolist()) == set(range(24, 53))  # 32 px into crops that begin at -8 to 20
    expected = (middle[..., None] - 32 + torch.arange(64)).clamp(0, 75)
    assert torch.equal(crops[:, 0, :, 0], expected[:, 0])
    assert torch.equal(crops[:, 1, 0, :], expected[:, 1])


def test_an_image_of_the_crops_size_is_kept():
    image = torch.randn(3, 4, 64, 64)
    assert torch.equal(random_crop(image, 64), image)
    assert torch.equal(centre_crop(image, 64), image)


def test_an_epoch_serves_every_sample_once(samples):
    data = CenteringData(samples, samples.take(np.arange(10)), config(batch_size=16))
    batches = list(data.train_dataloader())
    assert [len(batch["direction"]) for batch in batches] == [16, 16, 8]
    served = torch.cat([batch["wrench"] for batch in batches])
    assert sorted(served[:, -1, 2].tolist()) == sorted(samples.wrench[:, -1, 2].tolist())
    test = list(data.val_dataloader()[0])
    assert torch.equal(torch.cat([batch["direction"] for batch in test]), torch.from_numpy(samples.direction[:10]))


@pytest.mark.parametrize(("encoder", "fields"), [("v", {"image"}), ("f", {"wrench"}), ("vf", {"image", "wrench"})])
def test_batches_hold_what_the_encoder_looks_at(encoder, fields, samples):
    batch = next(iter(CenteringData(samples, samples, config(encoder)).train_dataloader()))
    assert set(batch) == fields | {"direction", "offset"}


def test_poisoned_samples_are_refused_by_episode(samples):
    wrench = samples.wrench.copy()
    wrench[7, 3, 2] = np.nan
    with pytest.raises(TrainingError, match=r"wrench .*episode 7 .*NaN or infinity"):
        CenteringData(samples, dataclasses.replace(samples, wrench=wrench), config())
    small = dataclasses.replace(samples, image=samples.image[..., :32, :32])
    with pytest.raises(TrainingError, match=r"32 x 32 .*64 x 64"):
        CenteringData(small, samples, config())
    assert len(CenteringData(small, samples, config(image_size=16)).train_set) == len(samples)
    flat = dataclasses.replace(samples, image=samples.image[..., :70, :])
    with pytest.raises(TrainingError, match=r"70 x 76 .*square"):
        CenteringData(flat, samples, config())


@pytest.mark.parametrize(
    ("side", "size", "crop"), [(76, 64, 64), (76, 32, 64), (76, 8, 64), (152, 128, 128), (70, 64, 64)]
)
def test_the_crop_is_the_papers_share_of_the_image(side, size, crop):
    assert crop_side(side, size) == crop


def test_smaller_images_show_the_same_scene():
    ramp = torch.arange(64.0).expand(1, 4, 64, 64)
    small = scaled(ramp, 16)
    torch.testing.assert_close(small, (torch.arange(16.0) * 4 + 1.5).expand(1, 4, 16, 16), atol=0.5, rtol=0)


def test_rotated_samples_keep_their_meaning(samples):
    """Force, offset and label of a sample turn together: the label stays the direction of the offset."""
    drawn = Crops(samples, ("image", "wrench"), 64, random=True, augment=True, rotate=True)[list(range(40))]
    assert nearest_direction(drawn["offset"].numpy()).tolist() == drawn["direction"].tolist()
    assert not torch.equal(drawn["direction"], torch.from_numpy(samples.direction))
    torch.testing.assert_close(drawn["wrench"][..., 2], torch.from_numpy(samples.wrench[..., 2]))
