"""What owns a file, a thread or a lock works in the process that made it, and nowhere else."""

import copy
import os
import pickle
import re
from dataclasses import dataclass

import pytest

from svfl_data.errors import UsageError
from svfl_data.system.own_process import OwnProcess
from tests.helpers.child import in_child


@dataclass(frozen=True)
class Frozen(OwnProcess):
    value: list


class Plain(OwnProcess):
    instead = "ask its owner"

    def __init__(self, value):
        self.value = value
        self.given_up = False

    def forked(self):
        self.given_up = True


@pytest.mark.parametrize("kind", [Frozen, Plain])
@pytest.mark.parametrize("carry", [copy.copy, copy.deepcopy, pickle.dumps, lambda owner: pickle.dumps([owner], 2)])
def test_it_is_neither_pickled_nor_copied(kind, carry):
    with pytest.raises(UsageError, match=f"{kind.__name__}.*process {os.getpid()} "):
        carry(kind([1]))


def test_a_fork_of_its_process_may_not_use_it():
    owner = Plain([1])
    owner.check_process()

    def use() -> int:
        try:
            owner.check_process()
        except UsageError as error:
            words = f"Plain belongs to process {os.getppid()} .* {os.getpid()}, a fork of it; ask its owner"
            return 3 if owner.given_up and not owner.in_own_process and re.search(words, str(error)) else 4
        return 5

    assert in_child(use) == 3
    assert owner.in_own_process
    assert not owner.given_up
