"""The law for files from strangers: every command refuses them in one line, in bounded time and memory, harmlessly.

``SVFL_HOSTILE=all`` tries every command on every kind, which takes hours. Otherwise a part of the kinds meets one
command each, others from kind to kind. ``python -m tests.hostile.table`` does any part of it and prints a table.
"""

import os

import pytest

from tests.hostile.campaign import Campaign, in_turn, targets
from tests.hostile.commands import EVERY
from tests.hostile.journals import GOOD
from tests.hostile.kind import episode_file
from tests.hostile.kinds import KINDS
from tests.hostile.sound import sound_dataset

WHOLE = os.environ.get("SVFL_HOSTILE") == "all"
QUICK, LONG = 199, 1 if WHOLE else 23
"""One kind in so many is tried in the quick suite, and in the long campaign; primes, or families would hide in them."""


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    place = tmp_path_factory.mktemp("hostile")
    made = Campaign(place, sound_dataset(place / "sound"))
    yield made
    made.close()


def obey(campaign, kind, commands):
    campaign.prepare(kind)
    broken = {}
    for command in commands:
        if command.name not in campaign.peaks:
            campaign.baseline(command)
            campaign.prepare(kind)
        _, words = campaign.attack(kind, command)
        if command.name == "repair" and kind.concern == "journal":
            words += [] if episode_file(campaign.box / "data", GOOD).exists() else ["the good journal was not saved"]
        if words:
            broken[command.name] = words
    assert not broken


LIGHT = [one for one in EVERY if not one.heavy]
FEW = [number for number in range(0, len(KINDS), QUICK) if not KINDS[number].slow and targets(KINDS[number], LIGHT)]
MANY = range(0, len(KINDS), LONG)


@pytest.mark.slow
@pytest.mark.parametrize("number", FEW, ids=[KINDS[number].name for number in FEW])
def test_a_hostile_file_is_refused_in_one_line(campaign, number):
    obey(campaign, KINDS[number], in_turn(number // QUICK, KINDS[number], LIGHT, 1))


@pytest.mark.slow
@pytest.mark.parametrize("number", MANY, ids=[KINDS[number].name for number in MANY])
def test_the_long_campaign(campaign, number):
    kind = KINDS[number]
    obey(campaign, kind, targets(kind, EVERY) if WHOLE else in_turn(number // LONG, kind, EVERY, 1))


@pytest.mark.slow
@pytest.mark.parametrize("command", LIGHT, ids=lambda command: command.name)
def test_every_command_does_its_work_on_sound_files(campaign, command):
    """Else refusing would prove nothing."""
    ended = campaign.baseline(command)
    assert (ended.code, ended.err, ended.hung) == (0, b"", False)


@pytest.mark.slow
@pytest.mark.parametrize("command", [one for one in EVERY if one.heavy], ids=lambda command: command.name)
def test_every_training_does_its_work_on_sound_files(campaign, command):
    ended = campaign.baseline(command)
    assert (ended.code, ended.err, ended.hung) == (0, b"", False)
