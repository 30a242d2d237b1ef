"""Tags are found, whoever looks and however often, and their corners give the one right pose."""

import gc
import signal
import threading

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from collectors.apriltags import native as natives
from collectors.apriltags.detector import Detection, TagDetector
from collectors.apriltags.layout import Layout
from collectors.apriltags.picture import modules, shape
from collectors.apriltags.pose import body_pose, fit, project, readings, reprojection_error
from svfl_data.errors import FormatError, StorageError, UsageError
from tests.helpers.child import in_child

K = np.array([[600.0, 0.0, 319.5], [0.0, 600.0, 239.5], [0.0, 0.0, 1.0]])
CUBE = Layout.cube(0.025, 0.04)
SMALL_FAMILIES = ["tag36h11", "tag25h9", "tag16h5", "tagCircle21h7"]  # the tables of the others take seconds


def tag_picture(family="tag36h11", tag=3, pixels=10):
    """A tag on white, (H, W) uint8, and the row and column of its upper left corner."""
    black = np.pad(modules(family, tag), 3)
    measures = shape(family)
    if family != "tag36h11":
        black[:3] = black[-3:] = False
    start = (3 + (measures.total - measures.border) // 2) * pixels
    return np.kron(np.where(black, 0, 255), np.ones((pixels, pixels))).astype(np.uint8), start


def pose(vector, place):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.array(vector, float))[0], place
    return T


def seen(T, layout=CUBE, noise=0.0, rng=None):
    """Detections of the tags of a body that face the camera."""
    found = []
    for tag in layout.tags.values():
        points = tag.corners
        middle, out = (T @ tag.T_body_tag)[:3, 3], (T @ tag.T_body_tag)[:3, 2]
        if out @ middle < -0.2 * np.linalg.norm(middle):
            corners = project(T, points, K) + (rng.normal(0, noise, (4, 2)) if rng is not None else 0.0)
            found.append(Detection(layout.family, tag.id, corners, 100.0, 0))
    return found


@pytest.mark.parametrize("family", SMALL_FAMILIES)
def test_a_printed_tag_is_found_where_it_is(family):
    measures, pixels = shape(family), 10
    for tag in (0, measures.count - 1):
        image, start = tag_picture(family, tag, pixels)
        (found,) = TagDetector(family)(image)
        assert (found.family, found.id, found.hamming) == (family, tag, 0)
        low, high = start - 0.5, start + measures.border * pixels - 0.5
        assert np.abs(found.corners - [[low, high], [high, high], [high, low], [low, low]]).max() < 0.25


def test_colour_views_and_turned_pictures():
    image, _ = tag_picture()
    detect = TagDetector()
    (upright,) = detect(image)
    (colour,) = detect(np.repeat(image[..., None], 3, axis=2))
    assert np.allclose(colour.corners, upright.corners)
    (turned,) = detect(np.rot90(image, 2))
    assert np.allclose(turned.corners, len(image) - 1 - upright.corners, atol=0.5)
    assert detect(image[:, ::-1]) == []  # the liar: a mirrored tag is none
    assert detect(np.full((60, 80), 130, np.uint8)) == []


@pytest.mark.parametrize("wrong", [np.zeros((20, 20), np.float32), np.zeros((20, 20, 4), np.uint8)])
def test_other_arrays_are_refused(wrong):
    with pytest.raises(UsageError, match="uint8"):
        TagDetector()(wrong)


def test_unknown_families_and_tags_are_named():
    with pytest.raises(UsageError, match=r"tag36h12.*tag36h11"):
        TagDetector("tag36h12")
    with pytest.raises(UsageError, match="0 to 586"):
        modules("tag36h11", 587)


@pytest.mark.slow
def test_detectors_come_and_go_ten_thousand_times():
    image, _ = tag_picture(pixels=4)
    for number in range(10_000):
        family = SMALL_FAMILIES[number % 4 if number % 10 == 0 else 0]
        detect = TagDetector(family)
        assert len(detect(image)) == (family == "tag36h11")
        del detect
        gc.collect() if number % 1000 == 0 else None


def test_threads_take_turns():
    image, _ = tag_picture(pixels=6)
    counts = []

    def work():
        counts.append(sum(len(TagDetector()(image)) for _ in range(40)))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counts == [40] * 4


def test_a_forked_child_detects_even_if_another_thread_was_detecting():
    image, _ = tag_picture(pixels=6)
    detect = TagDetector()
    detect(image)
    busy = natives.native("tag36h11", 2.0)
    with busy.lock:  # as another thread would hold it
        assert in_child(lambda: signal.alarm(20) or (0 if len(detect(image)) == 1 else 1)) == 0
    assert len(detect(image)) == 1


angles = st.floats(-0.5, 0.5)


@given(st.tuples(angles, angles, st.floats(-3, 3)), st.tuples(*[st.floats(-0.1, 0.1)] * 2, st.floats(0.3, 1.0)))
@settings(max_examples=25, deadline=None)
def test_exact_corners_give_the_exact_pose(turn, place):
    top_towards_camera = pose([np.pi, 0, 0], [0, 0, 0])
    T = pose([turn[0], turn[1], 0], place) @ top_towards_camera @ pose([0, 0, turn[2]], [0, 0, 0])
    for up in (None, T[:3, 2]):
        found = body_pose(seen(T), CUBE, K, up)
        assert found.error < 1e-6
        assert np.allclose(found.T_camera_body, T, atol=1e-7)


def test_what_is_up_decides_between_two_readings():
    one_tag = Layout.of("tag36h11", [CUBE.tags[0]])
    right = wrong_without = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        T = pose([0.25, 0, 0], [0.02, 0.01, 0.6]) @ pose([np.pi, 0, 0], [0, 0, 0]) @ pose([0, 0, seed], [0, 0, 0])
        tags = seen(T, one_tag, 0.6, rng)
        first, second = readings(tags[0], 0.04, K)
        assert np.arccos(first[:3, 2] @ second[:3, 2]) > 0.05
        free, upright = (body_pose(tags, one_tag, K, up).T_camera_body for up in (None, T[:3, 2]))
        wrong_without += free[:3, 2] @ T[:3, 2] < np.cos(0.2)
        right += upright[:3, 2] @ T[:3, 2] > np.cos(0.02)
    assert right == 25
    assert wrong_without > 1  # else the law would say nothing


def test_one_bad_corner_pulls_little():
    T = pose([2.5, 0.3, 0.2], [0.02, -0.01, 0.6])
    tags = seen(T)
    points = np.concatenate([CUBE.tags[tag.id].corners for tag in tags])
    pixels = np.concatenate([tag.corners for tag in tags])
    pixels[0] += (6.0, 4.0)
    assert len(tags) > 1
    off = fit(T @ pose([0.05, 0, 0], [0.01, 0, 0]), points, pixels, K)[:3, 3] - T[:3, 3]
    assert np.linalg.norm(off) < 0.004
    assert reprojection_error(T, points, pixels, K) > 1.0  # which the tracker refuses


def test_tags_of_other_bodies_are_left_aside():
    other = Layout.cube(0.025, 0.04, first=100)
    T = pose([2.5, 0.3, 0.2], [0.0, 0.0, 0.6])
    assert body_pose(seen(T, other), CUBE, K) is None
    both = body_pose(seen(T) + seen(pose([2.0, 0.3, 0.2], [0.1, 0.0, 0.6]), other), CUBE, K)
    assert np.allclose(both.T_camera_body, T, atol=1e-7)


def test_layouts_round_trip_and_are_checked(tmp_path):
    file = tmp_path / "cube.json"
    CUBE.write(file)
    again = Layout.read(file)
    assert again.family == CUBE.family
    assert all(np.array_equal(again.tags[id].corners, tag.corners) for id, tag in CUBE.tags.items())
    assert np.allclose(CUBE.scaled(1.01).tags[2].corners, 1.01 * CUBE.tags[2].corners)
    with pytest.raises(UsageError, match=r"ids .*\[0, 0\]"):
        Layout.of("tag36h11", [CUBE.tags[0], CUBE.tags[0]])
    with pytest.raises(StorageError, match=r"none\.json"):
        Layout.read(tmp_path / "none.json")
    file.write_text('{"family": "tag36h11", "tags": [{"id": 1}]}')
    with pytest.raises(FormatError, match=r"cube\.json"):
        Layout.read(file)
