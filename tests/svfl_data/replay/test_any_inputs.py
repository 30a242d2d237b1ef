"""The laws of the replay buffer, for the paper's inputs and for those of a robot with other sensors and actions."""

from dataclasses import replace

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, UsageError
from svfl_data.replay import RecordedSpec, ReplayBuffer, ReplayConfig
from svfl_data.sampling.samples import Samples
from svfl_data.schema.action_fields import joint_action, pose_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import Field
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import act, act_on_image, dihedral
from tests.helpers.own_robot import ACTION, FIELDS, own_dataset, own_episode
from tests.helpers.replay_inputs import (
    INPUTS,
    INVARIANT,
    KINDS,
    MOVING,
    OWN,
    PAPER,
    STEPS,
    T_SIDE,
    own_demo,
    row_of,
)

BEGIN = np.concatenate([[0], np.cumsum(STEPS)])
TACTILE = Field(path="streams/skin/pressure", dtype="float32", shape=("rows", 2))
SIMPLE = InputSpec(cameras=("front",), vectors=("observations/tcp_velocity",))


@pytest.fixture(params=KINDS, ids=lambda kind: kind.name)
def kind(request):
    return request.param


@pytest.fixture
def own(tmp_path) -> Dataset:
    return OWN.dataset(tmp_path / "d")


def place(number: int) -> tuple[int, int]:
    """Episode and step of a transition."""
    index = int(np.searchsorted(BEGIN, number, side="right")) - 1
    return index, int(number - BEGIN[index])


@pytest.mark.parametrize("n_step", [1, 3])
def test_states_are_what_the_one_cut_gives(kind, tmp_path, n_step):
    """Every entry of s, the action and s', also where a stream has not begun, a camera is slow, or is resampled."""
    batch = kind.preload(kind.dataset(tmp_path / "d"), kind.config(n_step=n_step)).sample(60)
    assert set(batch["index"]) == set(range(sum(STEPS)))
    for row, number in enumerate(batch["index"]):
        index, step = place(number)
        episode = kind.make(index)
        later = min(step + n_step, len(episode))
        wanted = kind.expected(episode, step) | kind.acted(episode, step)
        wanted |= {f"next_{key}": values for key, values in kind.expected(episode, later).items()}
        for key, values in wanted.items():
            np.testing.assert_allclose(batch[key][row], values, atol=1e-6, rtol=0, err_msg=key)
        over = later == len(episode)
        assert batch["reward"][row] == pytest.approx(0.99 ** (len(episode) - 1 - step) if over else 0)
        assert (batch["discount"][row] == 0) == over
    told = {"reward", "discount", "weight", "index", "expert", "cameras/front/depth_scale"}
    assert batch.keys() - told == wanted.keys()


@pytest.mark.parametrize("kind", [OWN, MOVING], ids=lambda kind: kind.name)
def test_states_are_those_of_samples(kind, tmp_path):
    """The same keys, types and bytes, but that a transition has one action."""
    dataset = kind.dataset(tmp_path / "d")
    batch = kind.preload(dataset, None).sample(50)
    samples = Samples(dataset, cameras=INPUTS.cameras, frames=2, windows=INPUTS.windows, vectors=INPUTS.vectors)
    others = samples.batch(batch["index"])
    assert others.keys() - batch.keys() == {"episode", "step", "actions/padding"}
    for key in others.keys() & batch.keys():
        other = others[key][:, 0] if key == "actions/action" else others[key]
        assert batch[key].dtype == other.dtype
        np.testing.assert_array_equal(batch[key], other, err_msg=key)
    assert others["cameras/side/padding"].any()
    assert others["streams/left_finger/padding"].all(axis=1).any()


def test_what_is_lived_through_equals_what_was_recorded(kind, tmp_path):
    settings = {"expert_bonus": 0.0, "rotate": True, "crop": 10, "n_step": 2}
    shown = kind.preload(kind.dataset(tmp_path / "d"), kind.config(**settings), capacity=1000)
    lived = kind.lived(**settings)
    batch, other = shown.sample(60), lived.sample(60)
    assert batch.keys() == other.keys()
    for key in batch.keys() - {"expert"}:
        assert batch[key].dtype == other[key].dtype
        np.testing.assert_array_equal(batch[key], other[key], err_msg=key)
    assert lived.nbytes <= shown.nbytes


def test_padding_and_age_may_be_left_out(own):
    """Then nothing is padded, and everything is of now."""
    buffer = ReplayBuffer(10, OWN.spec(own_demo(0)), OWN.config())
    plain = [
        {
            key: values
            for key, values in row_of(own_demo(0), INPUTS, step).items()
            if "/padding" not in key and "/age" not in key
        }
        for step in range(2)
    ]
    buffer.begin_episode(plain[0])
    buffer.add(own_demo(0).arrays["actions/action"][0], plain[1], 0.0, False, True)
    batch = buffer.sample(2)
    assert not batch["streams/left_finger/padding"].any()
    assert not batch["cameras/side/age"].any()


def axes_of(camera: str) -> np.ndarray:
    return np.asarray(own_demo(0).arrays[f"cameras/{camera}/image_axes"])


def explained(plain: dict, turned: dict, key: str, row: int, order: int) -> set[int]:
    """Elements of D_N that explain how an entry was turned; they are of the axes of the front camera's image."""
    before, after, found = plain[key][row], turned[key][row], set()
    path, reference = key.removeprefix("next_"), axes_of("front")
    declared = Declarations(FIELDS).at(path)
    for number, element in enumerate(dihedral(order)):
        world = reference.T @ element @ reference
        if path.startswith("cameras/"):
            axes = axes_of(path.split("/")[1])
            matrix = np.round(axes @ world @ axes.T, 9)
            pixels = act_on_image(matrix, before, axes=(1, 2))
            found |= {number} if np.array_equal(pixels, after) else set()
            continue
        middle = np.array([0.5, 0.1, 0]) if declared.about == "base origin" else 0.0
        wanted = act(world, before.astype(np.float64) - middle, declared.parts) + middle
        found |= {number} if np.allclose(wanted, after, atol=1e-6) else set()
    return found


@pytest.mark.parametrize("order", [4, 8])
def test_a_transition_is_turned_as_a_whole(own, order):
    """One element of D_N explains all that turns in s, a and s'; what was said to stay stays; all elements occur."""
    cropped = {"crop": 10, "n_step": 2, "group_order": order}
    plain = OWN.preload(own, OWN.config(**cropped)).sample(80)
    turned = OWN.preload(own, OWN.config(rotate=True, **cropped)).sample(80)
    numbers = ["streams/wrench/wrench", *INPUTS.vectors]
    images = ["cameras/front/color", "cameras/front/depth", "cameras/side/color"] if order == 4 else []
    turning = [prefix + key for prefix in ("", "next_") for key in (*numbers, *images)] + ["actions/action"]
    occurred = set()
    for row in range(80):
        elements = explained(plain, turned, "streams/wrench/wrench", row, order)
        assert len(elements) == 1
        for key in turning:
            assert elements <= explained(plain, turned, key, row, order), key
        occurred |= elements
    assert occurred == set(range(2 * order))
    interpolated = {key for key in plain if key.removeprefix("next_").startswith(("cameras/front/", "cameras/side/"))}
    for key in plain.keys() - set(turning) - {key for key in interpolated if key.endswith(("color", "depth"))}:
        np.testing.assert_array_equal(plain[key], turned[key], err_msg=key)


def test_interpolated_pictures_stay_integers_and_no_depth_is_invented(own):
    batch = OWN.preload(own, OWN.config(rotate=True, group_order=12, crop=10)).sample(60)
    assert batch["cameras/front/color"].dtype == np.uint8
    measured = np.concatenate([own_demo(index).arrays["cameras/front/depth"].ravel() for index in range(len(STEPS))])
    assert np.isin(batch["cameras/front/depth"], measured).all()
    np.testing.assert_array_equal(batch["cameras/front/depth_scale"], 0.001)


def test_nothing_is_kept_twice(tmp_path):
    """Images once per frame, readings once: within a tenth of what was recorded, however long windows are."""
    folder = Dataset.create_or_resume(tmp_path / "d", "wiping", 0, {})
    write_episode(own_episode(0, 40), folder.episode_path(0))
    inputs = replace(INPUTS, cameras=("front", "wrist"), windows={"streams/wrench/wrench": Window(100)}, frames=3)
    buffer = ReplayBuffer.from_demos(folder, 1, capacity=40, inputs=inputs)
    paths = [*inputs.windows, *inputs.vectors, "actions/action"]
    paths += ["cameras/front/color", "cameras/front/depth", "cameras/wrist/color"]
    raw = sum(own_episode(0, 40).arrays[path].nbytes for path in paths)
    assert sum(episode.nbytes for episode in buffer._ring.episodes) < 1.1 * raw


def test_what_is_loaded_goes_on_exactly_as_what_was_saved(kind, tmp_path):
    """Bit for bit, in the file too."""
    buffer = kind.lived(rotate=True, crop=10, n_step=2)
    for _ in range(3):
        batch = buffer.sample(16)
        buffer.update_priorities(batch["index"], batch["reward"] + batch["weight"] * 3)
    buffer.save(tmp_path / "one.replay")
    loaded = ReplayBuffer.load(tmp_path / "one.replay", kind.spec(kind.make(0)))
    loaded.save(tmp_path / "two.replay")
    assert (tmp_path / "one.replay").read_bytes() == (tmp_path / "two.replay").read_bytes()
    for _ in range(3):
        batch, same = buffer.sample(16), loaded.sample(16)
        assert batch.keys() == same.keys()
        for key in batch:
            np.testing.assert_array_equal(batch[key], same[key], err_msg=key)
        for one in (buffer, loaded):
            one.update_priorities(batch["index"], batch["reward"] - batch["weight"])
            kind.live(one, kind.make(1))


def test_priorities_know_nothing_of_the_inputs(tmp_path):
    """Equal lengths, seeds and errors: the same transitions are drawn with the same weights."""
    buffers = [kind.preload(kind.dataset(tmp_path / kind.name), kind.config()) for kind in KINDS]
    for _ in range(4):
        one, *others = (buffer.sample(20) for buffer in buffers)
        for key in ("index", "weight", "reward", "discount", "expert"):
            for other in others:
                np.testing.assert_array_equal(one[key], other[key], err_msg=key)
        for buffer in buffers:
            buffer.update_priorities(one["index"], one["weight"] * 5)


@pytest.mark.parametrize(
    ("other", "facts"),
    [
        ({"inputs": replace(INPUTS, frames=1)}, r"inputs.*frames=1.*frames=2"),
        ({"invariant": INVARIANT[:1]}, r"invariant"),
        ({"moving": ("wrist",)}, r"cameras that move.*wrist"),
        ({"task": "pushing"}, r"task.*pushing.*wiping"),
        ({"centre": (0.0, 0.0)}, r"centre.*0\.0.*0\.5"),
        ({"constants": {}}, r"cameras/front/T_base_camera.*None"),
        ({"fields": OWN.spec(own_demo(0)).fields[1:]}, r"input.*without it.*actions/action"),
        ({"fields": (*OWN.spec(own_demo(0)).fields, TACTILE)}, r"input.*streams/skin/pressure.*without it"),
    ],
)
def test_a_saved_buffer_of_other_inputs_is_refused(tmp_path, other, facts):
    spec, file = OWN.spec(own_demo(0)), tmp_path / "b.replay"
    OWN.lived().save(file)
    changed = replace(spec, **other)
    with pytest.raises(DatasetError, match=r"b\.replay.*"):
        ReplayBuffer.load(file, changed)
    with pytest.raises(DatasetError, match=f"^the environment: [^\n]*{facts}[^\n]*replay buffer[^\n]*$"):
        ReplayBuffer.load(file).begin_episode(OWN.observation(own_demo(0), 0), spec=changed)


def test_the_papers_inputs_and_others_do_not_mix(tmp_path):
    for kind, other in ((PAPER, OWN), (OWN, PAPER)):
        kind.lived().save(tmp_path / "b.replay")
        with pytest.raises(DatasetError, match=r"b\.replay[^\n]*input[^\n]*paper[^\n]*$"):
            ReplayBuffer.load(tmp_path / "b.replay", other.spec(other.make(0)))


def written(folder, *episodes: Episode) -> Dataset:
    dataset = Dataset.create_or_resume(folder, "wiping", 0, {})
    for index, episode in enumerate(episodes):
        write_episode(replace(episode, meta=replace(episode.meta, index=index)), dataset.episode_path(index))
    return dataset


def without(episode: Episode, *paths: str) -> Episode:
    return replace(episode, arrays={path: array for path, array in episode.arrays.items() if path not in paths})


@pytest.mark.parametrize(
    ("inputs", "more", "error", "facts"),
    [
        (replace(SIMPLE, cameras=("top",)), {}, FieldError, r"episode_000000\.hdf5.*'top'.*front, wrist"),
        (replace(SIMPLE, vectors=("observations/mood",)), {}, FieldError, r"episode_000000\.hdf5.*observations/mood"),
        (SIMPLE, {"action": "actions/left"}, FieldError, r"episode_000000\.hdf5.*actions/left.*actions/action"),
        (SIMPLE, {"invariant": ["cameras/wrist"]}, UsageError, r"invariant.*cameras/wrist.*cameras/front"),
        (SIMPLE, {"invariant": ["actions/action"]}, UsageError, r"invariant.*actions/action"),
        (SIMPLE, {"invariant": ["cameras/front/color"]}, UsageError, r"invariant.*cameras/front/color.*cameras/front,"),
        (SIMPLE, {"camera": "front"}, UsageError, r"front.*InputSpec"),
        (SIMPLE, {"config": ReplayConfig()}, UsageError, r"64 px.*cameras/front/color.*10 x 12"),
        (SIMPLE, {"config": ReplayConfig(crop=None, frames=2)}, UsageError, r"frames.*InputSpec"),
        (SIMPLE, {"config": ReplayConfig(crop=None, rotate=True)}, UsageError, r"square.*10 x 12.*crop"),
        (
            InputSpec(windows={"streams/tactile/pressure": Window(4, rate_hz=500)}), {}, DatasetError,
            r"episode_000000\.hdf5.*streams/tactile.*100 Hz.*500 Hz",
        ),
        (None, {"action": "actions/left"}, UsageError, r"action.*inputs"),
    ],
)  # fmt: skip
def test_what_does_not_fit_the_episodes_is_named(tmp_path, inputs, more, error, facts):
    with pytest.raises(error, match=facts) as refused:
        ReplayBuffer.from_demos(own_dataset(tmp_path / "d", 1), 1, inputs=inputs, **more)
    assert "\n" not in str(refused.value)


def test_an_episode_without_a_field_is_named(tmp_path):
    dataset = written(tmp_path / "d", own_episode(0), without(own_episode(1), "observations/tcp_velocity"))
    with pytest.raises(FieldError, match=r"episode_000001\.hdf5[^\n]*observations/tcp_velocity[^\n]*$"):
        ReplayBuffer.from_demos(dataset, 2, inputs=SIMPLE)


def test_what_an_agent_cannot_add_is_named_and_not_kept():
    demo = own_demo(0)
    seen, action = row_of(demo, INPUTS, 0), demo.arrays["actions/action"][0]
    buffer = ReplayBuffer(10, OWN.spec(demo), OWN.config())
    for key, values, facts in (
        (
            "cameras/front/color",
            seen["cameras/front/color"][0],
            r"cameras/front/color.*\(12, 12, 3\).*\(2, 12, 12, 3\)",
        ),
        ("cameras/front/color", seen["cameras/front/color"] + 0.5, r"cameras/front/color.*float64.*uint8"),
        ("streams/wrench/wrench", np.full((64, 6), np.inf), r"streams/wrench/wrench.*finite"),
        ("streams/wrench/wrench", np.full((64, 6), 1e300), r"streams/wrench/wrench.*float32"),
        ("streams/wrench/padding", np.arange(64) > 3, r"streams/wrench/padding.*64 booleans"),
        ("streams/wrench/age", -1.0, r"streams/wrench/age.*0"),
    ):
        with pytest.raises(FieldError, match=facts):
            buffer.begin_episode(seen | {key: values})
    with pytest.raises(FieldError, match=r"streams/tactile/pressure is missing"):
        buffer.begin_episode({key: values for key, values in seen.items() if key != "streams/tactile/pressure"})
    buffer.begin_episode(seen)
    for wrong, facts in ((action[:5], r"actions/action.*\(5,\).*\(7,\)"), (action * 100, r"actions/action.*outside")):
        with pytest.raises(FieldError, match=facts):
            buffer.add(wrong, seen, 0.0, False, True)
    assert len(buffer) == 0


@pytest.mark.parametrize(
    ("inputs", "facts"),
    [
        (InputSpec(cameras=("wrist",)), r"cameras/wrist.*pose.*invariant=\['cameras/wrist'\]"),
        (
            InputSpec(windows={"streams/tactile/pressure": Window(4)}),
            r"streams/tactile/pressure.*parts.*invariant=\['streams/tactile/pressure'\]",
        ),
        (InputSpec(windows={"streams/left_finger/wrench": Window(4)}), r"streams/left_finger/wrench.*parts"),
    ],
)
def test_what_does_not_say_how_it_turns_is_not_turned(tmp_path, inputs, facts):
    dataset, turn = own_dataset(tmp_path / "d", 1), ReplayConfig(crop=None, rotate=True)
    with pytest.raises(UsageError, match=f"^rotate: [^\n]*{facts}[^\n]*$"):
        ReplayBuffer.from_demos(dataset, 1, inputs=inputs, config=turn)
    path = next(iter([*inputs.windows, *(f"cameras/{name}" for name in inputs.cameras)]))
    assert ReplayBuffer.from_demos(dataset, 1, inputs=inputs, config=turn, invariant=[path]).sample(3)
    assert ReplayBuffer.from_demos(dataset, 1, inputs=inputs).sample(3)


def acting(action, values=None) -> Episode:
    """An episode with another action than a change of pose."""
    episode = own_episode(0)
    declared = Declarations([action, *(field for field in FIELDS if field.path != "actions/action")])
    low, high = np.array(action.bounds).T
    values = np.random.default_rng(0).uniform(low, high, (len(episode), len(low)))
    return Episode(episode.meta, episode.arrays | {"actions/action": values.astype(np.float32)}, declarations=declared)


def test_joint_space_is_kept_and_not_turned(tmp_path):
    """Joint commands have no planar parts, and cannot be said to stay."""
    joints = joint_action([(-3.0, 3.0)] * 6, [f"joint_{number}" for number in range(6)])
    dataset = written(tmp_path / "d", acting(joints))
    batch = ReplayBuffer.from_demos(dataset, 1, inputs=SIMPLE).sample(5)
    np.testing.assert_array_equal(batch["actions/action"], dataset.read(0)["actions/action"][batch["index"]])
    with pytest.raises(UsageError, match=r"^rotate: actions/action [^\n]*parts[^\n]*do without$"):
        ReplayBuffer.from_demos(dataset, 1, inputs=SIMPLE, config=ReplayConfig(crop=8, rotate=True))


def test_an_absolute_action_turns_about_the_workspace_centre(tmp_path):
    """A commanded position is measured from the base origin, a change of position from nowhere."""
    absolute = replace(
        pose_action(0.02, 0.1),
        about="base origin",
        delta=(False,) * 7,
        bounds=((0.3, 0.7), (-0.2, 0.4), *ACTION.bounds[2:]),
    )
    dataset = written(tmp_path / "d", acting(absolute))
    buffers = [
        ReplayBuffer.from_demos(dataset, 1, inputs=SIMPLE, config=ReplayConfig(crop=8, rotate=turn))
        for turn in (False, True)
    ]
    plain, turned = (buffer.sample(64) for buffer in buffers)
    offset = np.array([0.5, 0.1, 0, 0, 0, 0, 0])
    distance = [np.linalg.norm((batch["actions/action"] - offset)[:, :2], axis=1) for batch in (plain, turned)]
    np.testing.assert_allclose(*distance, atol=1e-6)
    assert np.abs(plain["actions/action"] - turned["actions/action"]).max() > 0.01
    for matrix in dihedral(4):
        world = axes_of("front").T @ matrix @ axes_of("front")
        wanted = act(world, plain["actions/action"] - offset, ACTION.parts) + offset
        assert np.isclose(wanted, turned["actions/action"], atol=1e-6).all(axis=1).any()
    lonely = written(tmp_path / "lonely", without(acting(absolute), "workspace"))
    with pytest.raises(UsageError, match=r"^rotate: actions/action [^\n]*base origin[^\n]*workspace$"):
        ReplayBuffer.from_demos(lonely, 1, inputs=SIMPLE, config=ReplayConfig(crop=8, rotate=True))


def test_inputs_without_any_camera_or_none_at_all_are_possible(tmp_path):
    dataset = own_dataset(tmp_path / "d", 2)
    for inputs in (InputSpec(), InputSpec(windows={"streams/wrench/wrench": Window(8)})):
        buffer = ReplayBuffer.from_demos(dataset, 2, inputs=inputs, config=ReplayConfig(crop=None, rotate=True))
        batch = buffer.sample(4)
        assert {key for key in batch if "/" in key and not key.endswith(("padding", "age"))} == {
            *inputs.windows, *(f"next_{path}" for path in inputs.windows), "actions/action",
        }  # fmt: skip


def test_a_spec_may_come_from_an_episode_alone():
    spec = RecordedSpec.of_episode(own_demo(0), INPUTS)
    assert spec == RecordedSpec.of_episode(own_demo(1), INPUTS)
    assert spec.constants["cameras/side/T_base_camera"] == T_SIDE.tolist()
