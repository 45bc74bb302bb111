"""Boards in images: points against the truth, and everything that can be wrong with a folder of images, in one sentence
each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from board_images import ARM, BOARD, LENS, LOOK, images, shots, views

from symcal.camera.board import parse_board
from symcal.errors import RefusedError
from symcal.images.boards import measure_boards
from symcal.vision.render import render_board


@pytest.fixture(scope="module")
def hand():
    """Fourteen views by a camera in the hand of an arm with errors."""
    rng = np.random.default_rng(3)
    found = views(14, rng)
    return found, images(found, rng)


def measured(q, pictures, board=BOARD, lens=LENS, **keywords):
    return measure_boards(shots(q, pictures), ARM, lens, board, **keywords)


def test_points_are_those_of_the_truth(hand):
    found, pictures = hand
    result = measured(found.q, pictures)
    assert result.failures == result.notes == ()
    assert result.found.mount == "hand"
    error = result.data.z.reshape(14, -1, 2) - found.pixels
    seen = np.isfinite(error[..., 0])
    assert 8 <= seen.sum(axis=1).min() < len(BOARD.points)  # in part
    assert np.sqrt(np.nanmean(error**2)) < 0.05
    assert np.nanmax(np.abs(error)) < 0.3
    assert result.data.only.features == tuple(str(i) for i in range(len(BOARD.points)))


def test_a_board_on_the_robot_and_a_camera_beside_it():
    rng = np.random.default_rng(4)
    found = views(8, rng, hand=False)
    result = measured(found.q, images(found, rng))
    assert result.found.mount == "world"
    assert result.failures == ()
    assert "beside the robot" in result.where


def test_swapped_names_are_named_and_left_out(hand):
    found, pictures = hand
    order = np.arange(14)
    order[[2, 9]], order[[5, 11]] = (9, 2), (11, 5)
    result = measured(found.q, [pictures[i] for i in order])
    assert {name for name, _ in result.failures} == {"02.png", "09.png", "05.png", "11.png"}
    assert dict(result.failures)["02.png"] == "its name is swapped with that of 09.png"
    assert (
        "image 02.png fits the joints of pose 9 and 09.png those of pose 2: the two names are swapped" in result.notes
    )
    assert len(result.data) == 10
    error = result.data.z.reshape(10, -1, 2) - found.pixels[np.setdiff1d(np.arange(14), [2, 9, 5, 11])]
    assert np.nanmax(np.abs(error)) < 0.3


def test_shifted_names_are_named(hand):
    found, pictures = hand
    order = np.arange(14)
    order[4:8] += 1
    order[8] = 4
    result = measured(found.q, [pictures[i] for i in order])
    assert "images 04.png to 07.png are shifted by one: each fits the joints of the next pose" in result.notes
    assert dict(result.failures)["08.png"].startswith("it fits the joints of pose 4, not those of its name")
    assert len(result.data) == 9


def test_names_that_are_all_shifted_are_refused(hand):
    found, pictures = hand
    with pytest.raises(RefusedError, match=r"13 of 13 images do not fit .* shifted by one: each fits .* the next pose"):
        measured(found.q[:-1], pictures[1:])


@pytest.mark.parametrize("sign", [np.full(6, np.rad2deg(1.0)), np.array([1, 1, -1, 1, 1, 1])])
def test_joint_readings_of_another_unit_or_sign_are_refused(hand, sign):
    found, pictures = hand
    with pytest.raises(RefusedError, match="images and joint readings do not belong together"):
        measured(found.q * sign, pictures)


def test_a_board_of_another_size_is_refused(hand):
    found, pictures = hand
    smaller = parse_board("charuco:8x6:33.333mm:25mm:DICT_4X4_50")
    with pytest.raises(
        RefusedError, match=r"about 1\.20 times as large as said: .* measure \d+\.?\d* mm and not 33\.333 mm"
    ):
        measured(found.q, pictures, smaller)


def test_a_board_of_other_columns_is_refused(hand):
    found, pictures = hand
    other = parse_board("charuco:9x6:40mm:30mm:DICT_4X4_50")
    with pytest.raises(RefusedError, match="show a ChArUco board of 8 squares a row and at least 6 rows"):
        measured(found.q, pictures, other)


def test_copies_are_named_and_the_true_one_is_kept(hand):
    found, pictures = hand
    result = measured(found.q, [*pictures[:5], pictures[2], *pictures[6:]])
    assert result.failures == (("05.png", "it is a copy of 02.png"),)
    assert result.notes == ("02.png and 05.png are one image",)
    few = measured(found.q[:4], [*pictures[:3], pictures[2]])
    assert dict(few.failures)["03.png"] == "it is a copy of 02.png, and their joint readings differ"
    assert len(few.data) == 2
    same = measured(found.q[[0, 1, 2, 2]], [*pictures[:3], pictures[2]])
    assert same.failures == (("03.png", "it is a copy of 02.png"),)


def test_images_of_two_cameras_are_told_apart(hand):
    found, pictures = hand
    rng = np.random.default_rng(9)
    longer = replace(LENS, fx=1.2 * LENS.fx, fy=1.2 * LENS.fy)
    other = [render_board(longer, BOARD, pose, rng, LOOK) for pose in found.poses[:4]]
    result = measured(found.q, [*other, *pictures[4:]])
    assert "4 images of 14 tell 1.20 times the file's focal length" in result.notes[0]
    assert {name for name, _ in result.failures} == {f"0{i}.png" for i in range(4)}
    with pytest.raises(RefusedError, match=r"about 0\.83 times the focal length of the camera file"):
        measured(found.q, pictures, lens=longer)


def test_images_of_two_sizes_are_told_apart(hand):
    found, pictures = hand
    result = measured(found.q, [*(picture[:300] for picture in pictures[:3]), *pictures[3:]])
    assert len(result.data) == 11
    assert dict(result.failures)["00.png"].startswith("another camera: the image is 480 x 300 px")
    assert "3 of 14 images have another size than the camera file says: two cameras in one folder" in result.notes
    with pytest.raises(RefusedError, match="10 of 14 images are not of this camera"):
        measured(found.q, [*(picture[:300] for picture in pictures[:10]), *pictures[10:]])


def test_images_without_a_board_are_named_or_refused(hand):
    found, pictures = hand
    blank = np.full_like(pictures[0], 128)
    result = measured(found.q, [blank, *pictures[1:]])
    assert result.failures[0][0] == "00.png"
    assert "no marker" in result.failures[0][1]
    with pytest.raises(RefusedError, match="no image could be measured"):
        measured(found.q[:3], [blank] * 3)


def test_few_images_are_not_judged_and_it_says_so(hand):
    found, pictures = hand
    result = measured(found.q[:4], pictures[:4])
    assert len(result.data) == 4
    assert result.notes == ("it was not checked that images and joint readings belong together: fewer than 6 of them",)


def test_a_chessboard_that_looks_the_same_turned_has_its_points_named_alike():
    """Seven by five inner corners: no detector can tell which corner is the first, the robot's motion can."""
    rng = np.random.default_rng(6)
    board = parse_board("chessboard:7x5:30mm")
    found = views(9, rng, board=board, least=1.0, spread=0.25)
    result = measured(found.q, images(found, rng, board=board), board)
    error = [np.abs(result.data.z.reshape(-1, 35, 2) - truth) for truth in (found.pixels, found.pixels[:, ::-1])]
    assert min(each.max() for each in error) < 0.3  # one order for all, though maybe the other one


def test_a_chessboard_of_another_size_is_refused_at_once():
    rng = np.random.default_rng(6)
    board = parse_board("chessboard:7x6:30mm")
    found = views(3, rng, board=board, least=1.0, spread=0.2)
    with pytest.raises(RefusedError, match="a chessboard of 7 x 6 inner corners, and the board is said to be chessb"):
        measured(found.q, images(found, rng, board=board), parse_board("chessboard:9x6:30mm"))
