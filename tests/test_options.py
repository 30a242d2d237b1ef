"""All options of all commands, from the parsers: one word means one thing, and every option says its default."""

import pytest

import collectors.cli
import svfl_data.cli
import svfl_models.cli
from collectors.commands.options import CAMERAS
from svfl_data.system.command_line.options_table import commands_of, options_table
from svfl_data.system.command_line.suggestions import OTHER_WORDS
from tests.helpers.command_page import OPTIONS

ROOTS = [module.build_parser() for module in (svfl_data.cli, collectors.cli, svfl_models.cli)]
TABLE = [option for root in ROOTS for option in options_table(root)]
TRAINING = {"centering", "latent", "bc", "bc-table", "rerun"}
"""Commands whose options are those of a training's configuration, as are those of ``centering-table`` and the like."""
OF_THEIR_OWN = {
    ("svfl-train bc", "--episodes"), ("svfl-train bc-table", "--episodes"),  # demonstrations, as numbers of them
}  # fmt: skip
"""Options that mean something else in one command than the page says."""
SEVERAL = {("svfl-data view", "--episode")}
"""Options that one command takes several values of, and the others one."""


def name(option):
    return f"{option.program} {option.command}"


def trains(option):
    return option.program == "svfl-train" and (option.command in TRAINING or option.command.startswith("centering-"))


def declared(option):
    """What the page says about an option: the beginning of its help, for each placeholder."""
    return {values: words for known, values, words in OPTIONS if known == option.name}


def test_the_table_has_every_option_of_every_command():
    for root in ROOTS:
        below = commands_of(root)
        assert set(below) - {""} == {option.command for option in TABLE if option.program == root.prog} - {""}
        for command, parser in below.items():
            shown = parser.format_help()
            for option in TABLE:
                if (option.program, option.command) == (root.prog, command):
                    assert option.name in shown, option
    assert {"--version"} <= {option.name for option in TABLE if not option.command}


@pytest.mark.parametrize("option", TABLE, ids=lambda option: f"{name(option)} {option.name}")
def test_every_option_says_what_it_is_and_its_default(option):
    assert option.help
    if option.name.startswith("-") and not option.required and option.name != "--version":
        assert "(default: " in option.help or "(no default)" in option.help  # which a configuration file may state


@pytest.mark.parametrize("option", TABLE, ids=lambda option: f"{name(option)} {option.name}")
def test_an_option_means_what_the_page_says(option):
    said = declared(option)
    if not said or (name(option), option.name) in OF_THEIR_OWN:
        return
    assert any(option.help.startswith(words) for words in said.values()), option.help
    if trains(option):
        return
    values = option.values.split(" ")[0].split(".")[0] if option.name == "--out" else option.values
    if (name(option), option.name) in SEVERAL:
        values = values.split(" ")[0]
    if option.kind == "flag" or (option.choices and option.values.startswith("{")):
        assert set(said) == {""}
    else:
        written = {one.replace("yes/no", "yes|no"): words for one, words in said.items()}
        placeholder = values if values in written else values.split(" ")[0]
        assert placeholder in written, option
        assert option.help.startswith(written[placeholder]), option.help


def test_an_option_of_several_commands_stands_on_the_page():
    """And has the same kind of value in all of them."""
    elsewhere = [option for option in TABLE if option.name.startswith("--") and not trains(option)]
    shared = {option.name for option in elsewhere if sum(one.name == option.name for one in elsewhere) > 1}
    assert shared - {"--version"} <= {known for known, *_ in OPTIONS}
    for one in shared - {"--task"}:  # which has a list where an expert is needed
        assert len({option.kind for option in elsewhere if option.name == one}) == 1, one


def test_the_page_names_no_option_that_is_gone():
    assert {known for known, *_ in OPTIONS} <= {option.name for option in TABLE}


def test_arguments_without_an_option_have_one_word():
    """The dataset or episode that a command is about, and the dataset that it makes."""
    meanings = {
        "PATH": "dataset folder, or episode file (.hdf5)", "DATASET": "dataset folder",
        "NEW": "folder of the new dataset: ", "CHECKPOINT": "checkpoint.ckpt of svfl-train", "SHELL": "shell: ",
        "NETWORK": "checkpoint.ckpt of svfl-train", "FOLDER": "folder of the run",
    }  # fmt: skip
    for option in TABLE:
        if not option.name.startswith("-"):
            said = option.help.removeprefix("folder of pictures, ")
            assert said.startswith(meanings.get(option.name, "?")), option


def test_every_command_can_be_quiet_and_every_one_that_reports_speaks_json():
    silent = {"svfl-data view", "svfl-data completion", "svfl-train rerun"} | {
        name(option) for option in TABLE if trains(option)
    }
    for root in ROOTS:
        for command, parser in commands_of(root).items():
            if command:
                assert "--quiet" in parser.options
                assert ("--json" in parser.options) == (f"{root.prog} {command}" not in silent), command


def test_other_words_lead_to_options_that_there_are():
    names = {option.name for option in TABLE}
    assert OTHER_WORDS.keys() <= names


def test_the_cameras_that_a_shell_offers_are_those_that_there_are():
    from collectors.simulation import camera

    assert tuple(camera.CAMERAS) == CAMERAS
