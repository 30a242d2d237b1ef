"""What a file of a policy says of its inputs is checked when it is opened, not when the policy is first called."""

import pytest
import torch
from torch import nn

from svfl_data.errors import FormatError
from svfl_models.programs import own_policy, policy_file
from svfl_models.programs.own_policy import Facts, InputFacts


class Network(nn.Module):
    """An action of two numbers from whatever it is given."""

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        return values.flatten(1).sum(dim=1, keepdim=True).expand(-1, 2)


def written(path, one: InputFacts):
    facts = Facts([one], ["a", "b"], [-1.0, -1.0], [1.0, 1.0])
    path.write_bytes(own_policy.exported(Network(), facts))
    return path


@pytest.mark.parametrize(
    "one",
    [
        InputFacts("streams/wrench/wrench", (6,)), InputFacts("streams/wrench/wrench", (4, 6, 1)),
        InputFacts("cameras/front", (4, 4), ("grey",)), InputFacts("observations/proprio", (1, 5)),
        InputFacts("observations/\x1b[31m", (5, 1)), InputFacts("cameras/front/image_axes", (2, 2, 1)),
        InputFacts("cameras/front", (2, 4, 4), ("grey",)), InputFacts("cameras/front", (1, 4, 4), ("thermal",)),
        InputFacts("cameras/front", (2, 4, 4), ("grey", "grey")),
    ],
)  # fmt: skip
def test_an_input_of_another_form_is_one_line(one, tmp_path):
    with pytest.raises(FormatError, match="cannot have the shape") as caught:
        policy_file.load(written(tmp_path / "policy.pt2", one))
    assert "\n" not in str(caught.value)
    assert "\x1b" not in str(caught.value)


def test_sound_facts_are_opened(tmp_path):
    loaded = policy_file.load(written(tmp_path / "policy.pt2", InputFacts("streams/wrench/wrench", (4, 6))))
    assert isinstance(loaded, policy_file.RobotPolicy)
