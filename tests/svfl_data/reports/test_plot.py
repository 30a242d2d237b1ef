import dataclasses

import matplotlib.image
import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.maintenance.relabel import relabel, with_annotation, with_success
from svfl_data.reports import plot
from svfl_data.reports.dataset_card import write_card
from svfl_data.reports.plot_strips import tiled
from svfl_data.sampling.split import split_episodes
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.open_episode import OWN, bare_episode, dataset_of, open_arrays, open_episode

pytestmark = pytest.mark.slow

CONTACT = {"name": "contact", "start_ns": 300_000_000, "end_ns": 350_000_000}


def annotated(*annotations, **meta):
    episode = make_episode(steps=8)
    return Episode(dataclasses.replace(episode.meta, annotations=list(annotations), **meta), episode.arrays)


def panels(figure):
    """Axes by their label."""
    return {axis.get_ylabel().split(",")[0]: axis for axis in figure.axes if axis.get_ylabel()}


def line(axis, label):
    return next(line for line in axis.get_lines() if line.get_label() == label)


def test_the_lines_are_the_numbers_of_the_episode():
    episode = annotated()
    shown = panels(plot.overview(episode))
    for panel, offset, names in (("force", 0, ("fx", "fy", "fz")), ("torque", 3, ("mx", "my", "mz"))):
        for column, name in enumerate(names):
            drawn = line(shown[panel], name)
            np.testing.assert_allclose(drawn.get_ydata(), episode.tared_wrench[:, offset + column], atol=1e-5)
            np.testing.assert_allclose(drawn.get_xdata(), episode.wrench_t_ns / 1e9)
    np.testing.assert_allclose(line(shown["action"], "dz, mm").get_ydata()[:-1], episode.action[:, 3] * 1e3)
    np.testing.assert_allclose(line(shown["gripper"], "measured").get_ydata(), episode.proprio[:, 0])


def test_axes_have_units_and_one_time():
    shown = panels(plot.overview(annotated()))
    assert [axis.get_ylabel() for axis in shown.values()] == ["force, N", "torque, N m", "gripper", "action, mm, deg"]
    assert shown["action"].get_xlabel().endswith(", s")
    assert len({axis.get_xlim() for axis in shown.values()}) == 1


@pytest.mark.parametrize(
    ("begin", "end"),
    [(10**9, -(10**18)), (-(2**63), 2**63 - 1), (2**62, 2**63 - 1), (-(2**63), -(2**62)), (10**8, 2**62), (0, 0)],
)
def test_an_annotation_of_any_times_is_drawn_inside_the_picture_or_not_at_all(begin, end, tmp_path):
    figure = plot.overview(annotated({"name": "slip", "start_ns": begin, "end_ns": end}))
    figure.savefig(tmp_path / "episode.png", dpi=60)
    for axis in panels(figure).values():
        low, high = axis.get_xlim()
        bands = [patch for patch in axis.patches if patch.get_alpha()]
        assert all(low <= band.get_x() <= band.get_x() + band.get_width() <= high for band in bands)
        assert bool(bands) == (begin <= end and begin / 1e9 <= high and end / 1e9 >= low)


def test_marks_stand_where_the_annotations_are():
    force = panels(plot.overview(annotated(CONTACT)))["force"]
    (band,) = (patch for patch in force.patches if patch.get_alpha())
    assert band.get_x() == pytest.approx(0.30)
    assert band.get_x() + band.get_width() == pytest.approx(0.35)
    assert "contact" in {text.get_text() for text in force.texts}


def test_recorded_transforms_are_applied_and_named():
    episode = annotated(transforms=[{"name": "tare", "offset": [0, 0, -100, 0, 0, 0]}])
    figure = plot.overview(episode)
    np.testing.assert_allclose(line(panels(figure)["force"], "fz").get_ydata(), episode.wrench[:, 2] + 100, rtol=1e-5)
    assert "tare (offset [0, 0, -100, 0, 0, 0])" in plot.title(episode)


def test_the_title_says_success_and_label():
    assert "episode 0: success; label (yellow arrow): " in plot.title(annotated())
    assert "no success" in plot.title(annotated(success=False))


def test_the_label_arrow_leads_from_the_tcp_to_the_goal():
    """With the camera straight above the workspace centre, the arrow's direction is the label's in the image."""
    episode = annotated()
    arrays = dict(episode.arrays)
    camera = np.eye(4)
    camera[:3, :3] = np.stack([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], axis=1)  # x right = base y
    camera[:3, 3] = [0.55, 0.0, 1.0]
    arrays["cameras/front/T_base_camera"] = camera
    arrays["cameras/front/image_axes"] = np.array([[0.0, 1.0], [-1.0, 0.0]])
    figure = plot.overview(Episode(episode.meta, arrays))
    insets = [inset for axis in figure.axes for inset in axis.child_axes]
    (arrow,) = (text for inset in insets for text in inset.texts)
    right, down = np.array(arrow.xy) - np.array(arrow.xyann)
    assert np.array([right, -down]) == pytest.approx(
        np.array([episode.label_offset[1], -episode.label_offset[0]]) * np.hypot(right, down)
        / np.linalg.norm(episode.label_offset), rel=1e-3
    )  # fmt: skip


@pytest.mark.parametrize(("height", "width"), [(16, 16), (48, 64), (64, 48)])
def test_the_pictures_of_a_strip_fill_it(height, width):
    """Enough of them that each is as wide as its place, if there are as many observations."""
    arrays = episode_arrays(np.random.default_rng(0), steps=20)
    arrays["cameras/front/color"] = np.zeros((21, height, width, 3), dtype=np.uint8)
    arrays["cameras/front/depth"] = np.zeros((21, height, width), dtype=np.uint16)
    strip = plot.overview(Episode(make_episode().meta, arrays)).axes[0]
    pictures = [picture for picture in strip.child_axes if picture.images]
    for picture in pictures:
        place = picture.get_position()
        picture.apply_aspect()
        drawn = picture.get_position()
        assert drawn.width == pytest.approx(place.width, rel=0.01) or len(pictures) == plot.FRAMES


def bare():
    arrays = {path: array for path, array in episode_arrays(np.random.default_rng(0)).items() if "cameras" not in path}
    return Episode(make_episode().meta, {path: array for path, array in arrays.items() if "labels" not in path})


def empty():
    arrays = episode_arrays(np.random.default_rng(0), steps=0)
    for path in ("streams/wrench/t_ns", "streams/wrench/wrench", *(f"cameras/front/{n}" for n in ("t_ns", "color"))):
        arrays[path] = arrays[path][:0]
    del arrays["cameras/front/depth"], arrays["cameras/front/depth_scale"]
    return Episode(make_episode().meta, arrays)


def wide():
    arrays = episode_arrays(np.random.default_rng(0))
    arrays["cameras/front/color"] = np.zeros((5, 16, 400, 3), dtype=np.uint8)
    arrays["cameras/front/depth"] = np.zeros((5, 16, 400), dtype=np.uint16)
    return Episode(make_episode().meta, arrays)


def opened(**changes):
    """The episode with many sensors, some of whose arrays are replaced, or left out where None."""
    changed = {path.replace("__", "/"): array for path, array in changes.items()}
    arrays = {path: array for path, array in (open_arrays() | changed).items() if array is not None}
    return Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=OWN)


def names(figure, start):
    """Curves of the panel whose name starts so."""
    (axis,) = (axis for axis in figure.axes if axis.get_ylabel().startswith(start))
    return {line.get_label(): line for line in axis.lines if not line.get_label().startswith("_")}


def test_fields_nobody_knows_are_drawn_with_their_names_and_units():
    episode = open_episode()
    figure = plot.overview(episode)
    velocity = names(figure, "observations/tcp_velocity\nm/s")
    assert list(velocity) == ["vx, m/s", "vy, m/s", "vz, m/s"]
    np.testing.assert_array_equal(velocity["vy, m/s"].get_ydata(), episode["observations/tcp_velocity"][:, 1])
    assert list(names(figure, "left_finger\nforce, N\nnot tared")) == ["fx, N", "fy, N", "fz, N"]
    assert list(names(figure, "actions/action\nrad")) == ["rx, rad", "ry, rad", "rz, rad"]
    assert list(names(figure, "tcp/pose\nm")) == ["x, m", "y, m", "z, m"]
    beside = [text.get_text() for axis in figure.axes for text in axis.texts]
    assert any("tactile/pressure" in words and "kPa" in words for words in beside)
    assert any(words.startswith("wrist\ncolour\n(on the gripper)") for words in beside)
    assert '"put the cup on the plate", ur5e' in plot.title(episode)


def test_a_second_wrench_with_a_tare_is_tared():
    own = Declarations([*OWN.own, wrench_stream("left_finger", doc="Sensor in the left finger.")[1]])
    arrays = open_arrays() | {"streams/left_finger/tare": np.arange(6.0)}
    figure = plot.overview(Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=own))
    force = names(figure, "left_finger\nforce, N")
    assert "not tared" not in " ".join(axis.get_ylabel() for axis in figure.axes)
    np.testing.assert_allclose(force["fz, N"].get_ydata(), arrays["streams/left_finger/wrench"][:, 2] - 2.0)


def test_tactile_rows_are_pictures_side_by_side():
    row = open_arrays()["streams/tactile/pressure"][-1]
    picture = tiled(row)
    assert picture.shape == (16, 33)
    np.testing.assert_array_equal(picture[:, 17:], row[1])


@pytest.mark.parametrize(
    "episode",
    [
        bare_episode,
        open_episode,
        lambda: opened(streams__wrench__tare=None),
        lambda: opened(cameras__wrist__color=None, cameras__wrist__grey=open_arrays()["cameras/wrist/color"][..., 0]),
        lambda: opened(cameras__front__T_base_camera=None),
        lambda: opened(**{path.replace("/", "__"): None for path in open_arrays() if path.startswith("streams/")}),
        bare,
        empty,
        wide,
        lambda: annotated({"note": "malformed"}),
        lambda: annotated(CONTACT, task=r"$\frac$ _^ Würfel"),
    ],
)
def test_any_valid_episode_can_be_drawn(episode, tmp_path):
    plot.save(episode(), tmp_path / "e.png")
    height, width = matplotlib.image.imread(tmp_path / "e.png").shape[:2]
    assert height > 300
    assert width > 1000


def test_equal_episodes_are_equal_pictures(tmp_path):
    assert plot.png(plot.overview(annotated())) == plot.png(plot.overview(annotated()))


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "secret" / "week", "centering", 0, {})
    for index in range(4):
        write_episode(make_episode(index, steps=4 + index), dataset.episode_path(index))
    return dataset


def test_a_card_says_what_the_dataset_holds_and_links_its_pictures(dataset):
    relabel(dataset, 1, with_success(False))
    relabel(dataset, 2, with_annotation("slip", 0.1, 0.2))
    split_episodes(dataset.indices, {"train": 0.5, "test": 0.5}, 0, "halves").save(dataset)
    out = dataset.path / "README.md"
    *pictures, written = write_card(dataset, out)
    text = out.read_text()
    assert written == out
    for said in (
        "# week", "4 episodes of centering: 22 steps", "| success | 3 of 4 (75.0%) |", "| annotations | slip (1) |",
        "| splits | halves |", "| 0 errors, 0 warnings |", "| wrench | 500 |", "16 x 16 px", "[N, N, N, N m, N m, N m]",
    ):  # fmt: skip
        assert said in text
    for picture in pictures:
        assert f"]({picture.relative_to(dataset.path)})" in text
        assert matplotlib.image.imread(picture).size
    assert "secret" not in text


def test_a_card_says_what_was_to_be_done_by_whom_and_what_every_field_means(tmp_path):
    write_card(dataset_of(tmp_path / "cups", open_episode), tmp_path / "card.md")
    text = (tmp_path / "card.md").read_text()
    for said in (
        "Instruction: put the cup on the plate (3).", "Robot: ur5e (3).", "| tactile | 100 | 303 | pressure [kPa] |",
        "| observations | each step | 63 | tcp_velocity [m/s], axes base; assumed: axes, parts |", "on the gripper",
        "bounds dx, dy, dz -0.02 to 0.02 m",
    ):  # fmt: skip
        assert said in text
    write_card(dataset_of(tmp_path / "bare", bare_episode), tmp_path / "bare.md")
    text = (tmp_path / "bare.md").read_text()
    assert "largest force of an episode" not in text
    assert "Instruction" not in text


def test_a_card_does_not_get_in_the_way_of_the_dataset(dataset):
    before = dataset.indices
    write_card(dataset, dataset.path / "README.md")
    assert Dataset.open(dataset.path).indices == before
    Dataset.create_or_resume(dataset.path, "centering", 0, {})


def test_a_card_of_nothing_or_of_damage_is_refused(dataset, tmp_path):
    dataset.episode_path(2).write_bytes(b"")
    with pytest.raises(DatasetError, match=r"episode_000002\.hdf5.*svfl-data repair"):
        write_card(dataset, tmp_path / "card.md")
    with pytest.raises(DatasetError, match=r"empty.*no episodes"):
        write_card(Dataset.create_or_resume(tmp_path / "empty", "centering", 0, {}), tmp_path / "card.md")
    assert not (tmp_path / "card.md").exists()


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("place", ["cameras/front", "streams/skin"])
def test_images_of_any_number_of_channels_are_drawn(channels, place, tmp_path):
    path = f"{place}/spectrum"
    rows = "F" if place.startswith("cameras") else "T"
    field = Field(path=path, dtype="uint8", shape=(rows, 8, 9, channels), unit="1", image=True)
    episode, arrays = open_episode(), open_arrays()
    t_ns = arrays["cameras/front/t_ns"]
    pixels = np.arange(len(t_ns) * 8 * 9 * channels).reshape(len(t_ns), 8, 9, channels).astype(np.uint8)
    made = {**arrays, path: pixels, f"{place}/t_ns": t_ns}
    figure = plot.overview(Episode(episode.meta, made, declarations=OWN.with_own([field])))
    figure.savefig(tmp_path / "episode.png", dpi=40)
    wide = 9 if channels in (3, 4) else 9 * channels
    drawn = [image.get_array() for axis in figure.axes for inset in axis.child_axes for image in inset.get_images()]
    assert any(one.shape[:2] == (8, wide) for one in drawn)


def test_rows_of_many_numbers_are_one_picture():
    """Such as sound: no reading is left out of the picture in silence."""
    sound = np.random.default_rng(0).integers(-3000, 3000, (40, 160), np.int16)
    field = Field(path="streams/mic/sound", dtype="int16", shape=("T", 160), unit="-")
    own = Declarations([*OWN.own, field])
    arrays = open_arrays() | {"streams/mic/sound": sound, "streams/mic/t_ns": np.arange(40) * 10_000_000}
    figure = plot.overview(Episode(Meta("cups", 0, 0, "teleop", True), arrays, declarations=own))
    (axis,) = (axis for axis in figure.axes if any("mic/sound" in text.get_text() for text in axis.texts))
    (inset,) = axis.child_axes
    np.testing.assert_array_equal(inset.images[0].get_array(), sound.T)


@pytest.mark.parametrize("bare", [False, True])
def test_a_card_names_only_what_its_pictures_show(bare, dataset, tmp_path):
    shown = dataset_of(tmp_path / "bare", bare_episode) if bare else dataset
    write_card(shown, tmp_path / "card.md")
    text = (tmp_path / "card.md").read_text()
    assert ("![Histograms of duration and largest force and labels]" in text) != bare
    assert ("![Histograms of duration]" in text) == bare
    assert ("Wrench readings are raw" in text) != bare


def test_a_card_counts(tmp_path):
    one = dataset_of(tmp_path / "one", open_episode, count=1)
    write_card(one, tmp_path / "card.md")
    assert "1 episode of" in (tmp_path / "card.md").read_text()
