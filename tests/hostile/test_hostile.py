"""The law for files from strangers: every command refuses them in one line, in bounded time and memory, harmlessly.

``python -m tests.hostile.table`` tries every command on every kind (an hour) and prints what breaks the law; here each
kind meets a few commands, others for every kind, so that each command meets some of every theme.
"""

import pytest

from tests.hostile.campaign import Campaign, in_turn
from tests.hostile.commands import EVERY
from tests.hostile.journals import GOOD
from tests.hostile.kind import episode_file
from tests.hostile.kinds import KINDS
from tests.hostile.sound import sound_dataset

AT_ONCE = 5
"""One kind in so many is tried in the quick suite."""
TURNS = 3
"""Commands that each kind meets in the long campaign."""


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


QUICK = [number for number in range(0, len(KINDS), AT_ONCE) if not KINDS[number].slow]


@pytest.mark.parametrize("number", QUICK, ids=[KINDS[number].name for number in QUICK])
def test_a_hostile_file_is_refused_in_one_line(campaign, number):
    light = [one for one in EVERY if not one.heavy]
    obey(campaign, KINDS[number], in_turn(number // AT_ONCE, KINDS[number], light, 1))


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(KINDS)), ids=[kind.name for kind in KINDS])
def test_the_long_campaign(campaign, number):
    obey(campaign, KINDS[number], in_turn(number, KINDS[number], EVERY, TURNS))


@pytest.mark.parametrize("command", [one for one in EVERY if not one.heavy], ids=lambda command: command.name)
def test_every_command_does_its_work_on_sound_files(campaign, command):
    """Else refusing would prove nothing."""
    ended = campaign.baseline(command)
    assert (ended.code, ended.err, ended.hung) == (0, b"", False)


@pytest.mark.slow
@pytest.mark.parametrize("command", [one for one in EVERY if one.heavy], ids=lambda command: command.name)
def test_every_training_does_its_work_on_sound_files(campaign, command):
    ended = campaign.baseline(command)
    assert (ended.code, ended.err, ended.hung) == (0, b"", False)
