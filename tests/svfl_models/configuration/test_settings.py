"""Settings come from defaults, a file, --set and flags, and are checked alike wherever they come from."""

import dataclasses
import re
from dataclasses import dataclass, field
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from svfl_data.errors import UsageError
from svfl_models import cli
from svfl_models.commands import bc, bc_table, centering, experiments, latent
from svfl_models.configuration.program import command_line, flags_of
from svfl_models.configuration.resolving import build, complete, resolve
from svfl_models.configuration.setting import UNSET, option, plain_values, settings_of
from svfl_models.configuration.yaml_file import read_yaml, text_of

PROGRAMS = [bc.PROGRAM, bc_table.PROGRAM, centering.PROGRAM, latent.PROGRAM]
PROGRAMS += [experiments.program_of(name) for name in experiments.COMMANDS]


@dataclass(frozen=True)
class Layers:
    latent: Annotated[int, option("units", ge=1)] = 8
    vision: tuple[int, int] = (1, 2)


@dataclass(frozen=True)
class Machine:
    device: Annotated[str, option("where to compute", choices=("auto", "cpu"))] = "auto"
    threads: Annotated[int, option("threads", ge=1)] | None = None


@dataclass(frozen=True)
class Example:
    data: Annotated[str, option("folder")]
    epochs: Annotated[int, option("epochs", ge=1)] = 60
    rate: Annotated[float, option("rate", gt=0)] = 1e-3
    group: Annotated[str, option("group", choices=("D4", "none"))] = "D4"
    camera: Annotated[str, option("camera")] | None = None
    augment: Annotated[bool, option("change images")] = True
    inputs: Annotated[list[str], option("inputs")] = field(default_factory=list)
    widths: Annotated[dict[str, Any], option("layers", partial=Layers)] = field(default_factory=dict)
    weights: Annotated[dict[str, float], option("terms", keys=("image", "kl"))] = field(default_factory=dict)
    machine: Annotated[Machine, option("machine")] = field(default_factory=Machine)


SETTINGS = tuple(settings_of(Example))
FILE = """\
data: data/a
epochs: 5   # not many
rate: 1e-4
widths:
  latent: 12
machine: {threads: 2}
"""


def written(folder, text):
    file = folder / "run.yaml"
    file.write_text(text)
    return file


def test_the_line_has_precedence_over_the_file_and_the_file_over_the_defaults(tmp_path):
    file = written(tmp_path, FILE)
    given = resolve(SETTINGS, file, ["widths.vision=[3, 4]", "rate=2e-3"], {"epochs": 7, "machine.device": "cpu"})
    found = build(Example, complete(SETTINGS, given))
    assert found == Example(
        "data/a", epochs=7, rate=2e-3, widths={"latent": 12, "vision": (3, 4)}, machine=Machine("cpu", 2)
    )  # fmt: skip


@pytest.mark.parametrize(
    ("line", "facts"),
    [
        ("epoch: 3", r"run.yaml:2: no setting epoch; did you mean epochs\?"),
        ("zzz: 3", "run.yaml:2: no setting zzz; there are data, epochs"),
        ("epochs: 0", "run.yaml:2: epochs: 0 is not an integer of at least 1"),
        ("epochs: 1.5", "run.yaml:2: epochs: 1.5 is not an integer"),
        ("epochs: '5'", "run.yaml:2: epochs: '5' is not an integer"),
        ("rate: .nan", "run.yaml:2: rate: nan is not a number above 0"),
        ("rate: .inf", "run.yaml:2: rate: inf is not a number"),
        ("group: d4", r"run.yaml:2: group: 'd4' is not one of D4, none; did you mean D4\?"),
        ("inputs: [1]", r"run.yaml:2: inputs: \[1\] is not a list, each a text"),
        ("augment: 1", "run.yaml:2: augment: 1 is not true or false"),
        ("camera: [a]", "run.yaml:2: camera: .* is not a text, or null"),
        ("widths: 3", "run.yaml:2: widths: 3 is not a mapping of latent, vision"),
        ("widths:\n  latnt: 3", r"run.yaml:3: no setting latnt; did you mean latent\?"),
        ("widths:\n  latent: 0", "run.yaml:3: latent: 0 is not an integer of at least 1"),
        ("widths: {vision: [1]}", "run.yaml:2: vision: .* is not a list of 2"),
        ("weights: {image: x}", "run.yaml:2: image: 'x' is not a number"),
        ("machine: {device: gpu}", "run.yaml:2: device: 'gpu' is not one of auto, cpu"),
        ("epochs: 3\nepochs: 4", "run.yaml:3: epochs is there twice, also in line 2"),
        ("epochs: &a 3\nrate: *a", "run.yaml:3: not YAML: an alias"),
        ("epochs: !!python/object/apply:os.system [id]", "run.yaml:2: not YAML"),
        ("epochs: [1", r"run.yaml:\d: not YAML"),
        ("1: 3", "run.yaml:2: 1 is not the name of a setting"),
        ("widths: " + "[" * 20 + "]" * 20, "run.yaml:2: more than 8 levels"),
        ("program: latent", "run.yaml: holds the settings of svfl-train latent, not of bc"),
        ('"\\e[31m": 3', r"run.yaml:2: no setting \\x1b"),
    ],
)  # fmt: skip
def test_a_wrong_line_of_a_file_is_named_with_its_number(tmp_path, line, facts):
    file = written(tmp_path, f"data: a\n{line}\n")
    with pytest.raises(UsageError, match=facts) as refused:
        resolve(SETTINGS, file, program="bc")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "facts"),
    [
        ("epochs", "must be NAME=VALUE"),
        ("=3", "must be NAME=VALUE"),
        ("epochs.x=3", "epochs is an integer of at least 1, it has nothing inside"),
        ("widths.latent=0", "latent: 0 is not an integer of at least 1"),
        ("widths.x.y=0", "no setting x"),
        ("epochs=[1", "is not a value"),
    ],
)
def test_a_wrong_assignment_is_named(text, facts):
    with pytest.raises(UsageError, match=facts):
        resolve(SETTINGS, None, [text])


def test_contradictory_options_are_refused_and_equal_ones_are_not():
    with pytest.raises(UsageError, match="--epochs 7 and --set epochs=5 contradict each other"):
        resolve(SETTINGS, None, ["epochs=5"], {"epochs": 7})
    assert resolve(SETTINGS, None, ["epochs=5"], {"epochs": 5}) == {"epochs": 5}


def test_texts_stay_texts():
    assert resolve(SETTINGS, None, ["data=5", "camera=1e3"]) == {"data": "5", "camera": "1e3"}
    assert resolve(SETTINGS, None, ["camera=null"]) == {"camera": None}


def test_what_has_no_default_is_asked_for():
    with pytest.raises(UsageError, match="data is missing: give --data, or data: in --config"):
        complete(SETTINGS, {})


@pytest.mark.parametrize("content", [b"\xff\xfe", b"[]", b"5", b"- a", b"\0"])
def test_files_of_something_else_are_refused(tmp_path, content):
    (tmp_path / "run.yaml").write_bytes(content)
    with pytest.raises(UsageError, match=r"run\.yaml"):
        resolve(SETTINGS, tmp_path / "run.yaml")


def test_an_absent_file_and_a_folder_are_refused(tmp_path):
    for path in (tmp_path, tmp_path / "absent"):
        with pytest.raises(UsageError, match=re.escape(str(path))):
            read_yaml(path)


EXAMPLES = st.builds(
    Example,
    data=st.text(max_size=9),
    epochs=st.integers(1, 9**9),
    rate=st.floats(1e-300, 1e300),
    camera=st.none() | st.text(max_size=9) | st.sampled_from(["null", "1e5", "yes", "0x1f", "1_000", "2026-12-01"]),
    augment=st.booleans(),
    inputs=st.lists(st.text(max_size=5), max_size=3),
    widths=st.dictionaries(st.just("latent"), st.integers(1, 9)),
    weights=st.dictionaries(st.sampled_from(["image", "kl"]), st.floats(-1e9, 1e9)),
    machine=st.builds(Machine, threads=st.none() | st.integers(1, 9)),
)


@given(example=EXAMPLES)
def test_what_is_written_is_what_is_read(example, tmp_path_factory):
    file = written(tmp_path_factory.mktemp("run"), text_of("bc", plain_values(example), SETTINGS))
    values = complete(SETTINGS, resolve(SETTINGS, file, program="bc"))
    assert build(Example, values) == example


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_every_setting_has_help_and_a_possible_default(program):
    names = [setting.name for setting in program.settings]
    assert len(names) == len(set(names))
    for setting in program.settings:
        assert setting.help
        assert not setting.help.endswith(".")
        if setting.default is not UNSET:
            plain = list(setting.default) if isinstance(setting.default, tuple) else setting.default
            if not dataclasses.is_dataclass(plain):
                assert setting.checked(plain) == setting.default


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_the_printed_settings_are_those_that_a_file_gives_back(program, tmp_path, capsys):
    """The whole way: print, read, print again."""
    needed = [word for one in program.settings if one.default is UNSET for word in (f"--{one.name}", sample(one))]
    assert cli.main([program.name, *needed, "--print-config"]) == 0
    printed = capsys.readouterr().out
    file = written(tmp_path, printed)
    assert cli.main([program.name, "--config", str(file), "--print-config"]) == 0
    assert capsys.readouterr().out == printed
    assert {path for path, _ in flags_of(program.settings)} >= {"data", "seeds" if "seeds" in printed else "seed"}


def sample(setting):
    return str(setting.choices[0]) if setting.choices else "x"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.name)
def test_a_mistake_in_the_settings_is_one_line_with_exit_code_2(program, tmp_path, capsys):
    file = written(tmp_path, "sead: 3\n")
    assert cli.main([program.name, "--config", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "run.yaml:1: no setting sead" in error


def test_the_command_line_of_some_settings_gives_them():
    values = complete(SETTINGS, {"data": "a b", "epochs": 3, "augment": False, "widths": {"vision": (3, 4)}})
    words = command_line("bc", values, SETTINGS)
    assert words == "svfl-train bc --data 'a b' --epochs 3 --no-augment --set 'widths.vision=[3,4]'"
