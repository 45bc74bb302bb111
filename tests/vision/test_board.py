"""Boards in rendered and photographed images: where the points are, and what is said when there are none."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from board_scenes import board_views, nearest_order, placed, seen
from scipy.spatial.transform import Rotation

from symcal.camera.board import parse_board
from symcal.camera.camera import Camera
from symcal.errors import InputError
from symcal.vision.aprilgrid import tag_bits
from symcal.vision.board import BoardDetection, Refusal, detect_board, detect_boards
from symcal.vision.circles import dot_bias
from symcal.vision.images import read_image
from symcal.vision.render import Look, render_board

CAMERA = Camera(1000, 800, 800.0, 801.0, 510.0, 390.0, (-0.25, 0.08))
TILT = Rotation.from_rotvec([0.35, -0.4, 0.1])
LIMIT_PX = {"chessboard": 0.05, "charuco": 0.10, "circles": 0.02, "asymmetric_circles": 0.02, "aprilgrid": 0.06}


@pytest.mark.parametrize(
    "text",
    [
        "chessboard:9x6:25mm",
        "chessboard:12x13:12mm",
        "circles:8x6:25mm",
        "asymmetric_circles:4x11:15mm",
        "charuco:9x6:25mm:18mm:DICT_4X4_50",
        "aprilgrid:6x4:24mm:8mm",
    ],
)
def test_points_are_found_to_sub_pixel(text: str, rng: np.random.Generator) -> None:
    board = parse_board(text)
    for view in board_views(CAMERA, board, 3, rng):
        found = detect_board(render_board(CAMERA, board, view, rng), board)
        assert isinstance(found, BoardDetection)
        assert len(found.indices) >= (1.0 if board.dictionary is None else 0.9) * len(board.points)
        true = seen(CAMERA, board, view)
        if found.radii is not None:
            radius = float(np.median(found.radii)) * board.square
            true = true + dot_bias(CAMERA, board, view, found.indices, radius)
        errors = nearest_order(found.pixels, found.indices, true)
        assert np.sqrt(np.mean(errors**2)) < LIMIT_PX[board.kind]


@pytest.mark.parametrize("half_turns", [0, 1])
@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", "asymmetric_circles:4x11:15mm"])
def test_a_board_without_symmetry_has_one_order(text: str, half_turns: int, rng: np.random.Generator) -> None:
    board = parse_board(text)
    view = placed(
        TILT * Rotation.from_rotvec([0, 0, np.pi * half_turns]), board.points.mean(axis=0), np.zeros(2), 420.0
    )
    found = detect_board(render_board(CAMERA, board, view, rng), board)
    assert isinstance(found, BoardDetection)
    assert np.abs(found.pixels - seen(CAMERA, board, view)).max() < 1.0


def test_the_bias_of_a_dot_is_that_of_its_ellipse() -> None:
    """Without distortion the image of a dot is a conic, whose centre is known in closed form."""
    camera, board, radius = Camera(1000, 800, 800.0, 800.0, 500.0, 400.0), parse_board("circles:4x4:40mm"), 15.0
    view = placed(TILT, board.points.mean(axis=0), np.array([0.1, -0.05]), 300.0)
    bias = dot_bias(camera, board, view, np.arange(16), radius)
    homography = camera.matrix @ np.column_stack([view[:3, 0], view[:3, 1], view[:3, 3]])
    for point, shift in zip(board.points, bias, strict=True):
        x, y = point[:2]
        circle = np.array([[1, 0, -x], [0, 1, -y], [-x, -y, x * x + y * y - radius**2]])
        dual = homography @ np.linalg.inv(circle) @ homography.T
        centre = homography @ [x, y, 1]
        assert shift == pytest.approx(dual[:2, 2] / dual[2, 2] - centre[:2] / centre[2], abs=1e-3)
        assert np.linalg.norm(shift) > 0.05


def test_the_window_stays_clear_of_neighbouring_corners(rng: np.random.Generator) -> None:
    """Squares of 8 px: a fixed window of 5 would pull corners towards their neighbours."""
    camera, board = Camera(640, 480, 500.0, 500.0, 320.0, 240.0), parse_board("chessboard:9x6:10mm")
    view = placed(Rotation.from_rotvec([0.4, 0.3, 0]), board.points.mean(axis=0), np.array([0.2, 0.1]), 620.0)
    found = detect_board(render_board(camera, board, view, rng, Look(blur_px=0.5)), board)
    assert isinstance(found, BoardDetection)
    assert np.abs(nearest_order(found.pixels, found.indices, seen(camera, board, view))).max() < 0.2


def test_the_sector_based_detector_finds_what_the_classic_one_does_not(rng: np.random.Generator) -> None:
    """Noise of a fifth of full scale tears the outlines of the squares apart, which the classic detector follows."""
    board = parse_board("chessboard:9x6:25mm")
    view = placed(TILT, board.points.mean(axis=0), np.zeros(2), 420.0)
    noisy = render_board(CAMERA, board, view, rng, Look(noise=0.2))
    found = detect_board(noisy, board)
    assert isinstance(found, BoardDetection)
    assert found.method.startswith("sector-based")
    assert np.sqrt(np.mean(nearest_order(found.pixels, found.indices, seen(CAMERA, board, view)) ** 2)) < 0.6


def test_part_of_a_charuco_board_is_enough(rng: np.random.Generator) -> None:
    board = parse_board("charuco:9x6:25mm:18mm:DICT_4X4_50")
    view = placed(TILT, board.points.mean(axis=0), np.array([0.55, 0.1]), 500.0)
    found = detect_board(render_board(CAMERA, board, view, rng), board)
    assert isinstance(found, BoardDetection)
    assert 8 <= len(found.indices) < len(board.points)
    assert np.abs(found.pixels - seen(CAMERA, board, view)[found.indices]).max() < 0.4


def test_an_old_charuco_layout_is_recognised() -> None:
    board = parse_board("charuco:7x6:30mm:22mm:DICT_4X4_50")
    source = cv2.aruco.CharucoBoard((7, 6), 30.0, 22.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    source.setLegacyPattern(True)
    found = detect_board(source.generateImage((700, 600), marginSize=30), board)
    assert isinstance(found, BoardDetection)
    assert "before OpenCV 4.6" in found.method
    assert len(found.indices) == 30


def test_dots_cut_by_the_border_are_left_out(rng: np.random.Generator) -> None:
    camera, board = Camera(1000, 800, 800.0, 800.0, 500.0, 400.0), parse_board("circles:6x5:30mm")
    middle = placed(Rotation.identity(), board.points.mean(axis=0), np.zeros(2), 350.0)
    whole = render_board(camera, board, middle, rng)
    left = int(seen(camera, board, middle)[:, 0].min()) - 3  # a strip of each dot of the first column is lost
    found = detect_board(np.ascontiguousarray(whole[:, left:]), board)
    if isinstance(found, BoardDetection):
        true = seen(camera, board, middle) - [left, 0]
        assert np.abs(nearest_order(found.pixels, found.indices, true)).max() < 0.05
    else:
        assert found.fault == "no board"


@pytest.mark.parametrize("sigma", [0.8, 1.5, 3.0])
@pytest.mark.parametrize("text", ["chessboard:9x6:25mm", "circles:8x6:25mm"])
def test_the_blur_of_the_edges_is_measured(text: str, sigma: float, rng: np.random.Generator) -> None:
    board = parse_board(text)
    view = placed(TILT, board.points.mean(axis=0), np.zeros(2), 420.0)
    found = detect_board(render_board(CAMERA, board, view, rng, Look(blur_px=sigma)), board)
    assert isinstance(found, BoardDetection)
    assert found.blur_px == pytest.approx(np.hypot(sigma, 1 / np.sqrt(12)), rel=0.15)


def test_every_file_ends_as_points_or_with_a_reason(tmp_path: Path, rng: np.random.Generator) -> None:
    board = parse_board("chessboard:9x6:25mm")
    view = placed(TILT, board.points.mean(axis=0), np.zeros(2), 420.0)
    good = render_board(CAMERA, board, view, rng)
    jpeg = cv2.imencode(".jpg", good)[1].tobytes()
    png = cv2.imencode(".png", good)[1].tobytes()
    files = {
        "good1.png": png,
        "good2.jpg": jpeg,
        "black.png": cv2.imencode(".png", np.zeros_like(good))[1].tobytes(),
        "empty.png": cv2.imencode(".png", np.full_like(good, 128))[1].tobytes(),
        "small.png": cv2.imencode(".png", good[::2, ::2])[1].tobytes(),
        "text.png": b"not an image at all",
        "nothing.jpg": b"",
        "half.jpg": jpeg[: len(jpeg) // 2],
        "half.png": png[: len(png) // 2],
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    detections, refusals = detect_boards([tmp_path / name for name in [*files, "absent.png"]], board)
    assert [found.name for found in detections] == ["good1.png", "good2.jpg"]
    assert {refusal.name: refusal.fault for refusal in refusals} == {
        "black.png": "black",
        "empty.png": "no board",
        "small.png": "size",
        "text.png": "unreadable",
        "nothing.jpg": "unreadable",
        "half.jpg": "cut",
        "half.png": "cut",
        "absent.png": "unreadable",
    }
    assert all(len(refusal.reason.split()) > 3 for refusal in refusals)


def test_twelve_bits_in_sixteen_are_scaled_to_eight(tmp_path: Path) -> None:
    ramp = np.tile(np.arange(4096, dtype=np.uint16), (4, 1))
    cv2.imwrite(str(tmp_path / "ramp.png"), ramp)
    image = read_image(tmp_path / "ramp.png")
    assert image.dtype == np.uint8
    assert image.min() == 0
    assert image.max() == 255
    assert np.all(np.diff(image[0].astype(int)) >= 0)


def test_an_unknown_or_too_small_dictionary_is_named(rng: np.random.Generator) -> None:
    noise = rng.integers(0, 255, (200, 200), dtype=np.uint8)
    with pytest.raises(InputError, match="unknown dictionary"):
        detect_board(noise, parse_board("charuco:5x7:30mm:22mm:DICT_9X9_50"))
    with pytest.raises(InputError, match="60 markers"):
        detect_board(noise, parse_board("charuco:12x10:30mm:22mm:DICT_4X4_50"))
    assert isinstance(detect_board(noise, parse_board("charuco:5x7:30mm:22mm:DICT_4X4_50")), Refusal)


KALIBR_36H11 = (0xD5D628584, 0xD97F18B49, 0xDD280910E, 0xE479E9C98)  # codes of tags 0 to 3
KALIBR_FIRST = {"DICT_APRILTAG_16h5": (4, 0x231B), "DICT_APRILTAG_25h9": (5, 0x155CBF1)}


def test_tags_are_those_that_kalibr_prints() -> None:
    """Row by row from the top, the highest bit first, a one is white; two bits of black around."""
    codes = [("DICT_APRILTAG_36h11", number, 6, code) for number, code in enumerate(KALIBR_36H11)]
    codes += [(name, 0, side, code) for name, (side, code) in KALIBR_FIRST.items()]
    for dictionary, number, side, code in codes:
        board = parse_board(f"aprilgrid:3x2:30mm:9mm:{dictionary}")
        bits = np.array([bit == "1" for bit in f"{code:0{side * side}b}"]).reshape(side, side)
        assert np.array_equal(tag_bits(board, number), np.pad(bits, 2))


def test_the_points_of_an_aprilgrid_are_kalibrs() -> None:
    """From Kalibr's GridCalibrationTargetAprilgrid: corners row by row from the lower left, x right, y up."""
    board = parse_board("aprilgrid:3x2:40mm:12mm")
    size, spacing = 40.0, 0.3
    for r in range(4):
        for c in range(6):
            x = (c // 2) * (1 + spacing) * size + (c % 2) * size
            y = (r // 2) * (1 + spacing) * size + (r % 2) * size
            assert board.points[6 * r + c] == pytest.approx([x, y, 0])


def test_every_corner_of_an_aprilgrid_has_its_number(rng: np.random.Generator) -> None:
    """Seen from the front, the first point is the lower left, whatever way the board is turned."""
    board = parse_board("aprilgrid:4x3:30mm:9mm")
    for quarter in range(4):
        turn = Rotation.from_rotvec([0.3, -0.2, 0]) * Rotation.from_rotvec([0, 0, np.pi / 2 * quarter])
        view = placed(turn * Rotation.from_rotvec([np.pi, 0, 0]), board.points.mean(axis=0), np.zeros(2), 420.0)
        found = detect_board(render_board(CAMERA, board, view, rng), board)
        assert isinstance(found, BoardDetection)
        assert np.array_equal(found.indices, np.arange(48))
        assert np.abs(found.pixels - seen(CAMERA, board, view)).max() < 0.25
    upright = placed(Rotation.from_rotvec([np.pi, 0, 0]), board.points.mean(axis=0), np.zeros(2), 420.0)
    u, v = seen(CAMERA, board, upright).T
    assert u[0] < u[7]
    assert v[0] > v[-1]


@pytest.mark.parametrize(("ray", "depth"), [((0.5, 0.1), 420.0), ((0.45, 0.3), 180.0), ((-0.4, -0.35), 260.0)])
def test_part_of_an_aprilgrid_is_enough(ray: tuple[float, float], depth: float, rng: np.random.Generator) -> None:
    board = parse_board("aprilgrid:6x6:30mm:9mm")
    view = placed(TILT * Rotation.from_rotvec([np.pi, 0, 0]), board.points.mean(axis=0), np.array(ray), depth)
    found = detect_board(render_board(CAMERA, board, view, rng), board)
    assert isinstance(found, BoardDetection)
    assert 40 <= len(found.indices) < len(board.points)
    errors = found.pixels - seen(CAMERA, board, view)[found.indices]
    assert np.sqrt(np.mean(errors**2)) < 0.06
    assert np.abs(errors).max() < 0.3


def test_tags_with_a_border_of_one_bit_are_read_too() -> None:
    """A grid of OpenCV's own pictures, without squares between: upside down, as OpenCV keeps them."""
    board = parse_board("aprilgrid:3x3:80mm:20mm")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    page = np.full((400, 400), 255, np.uint8)
    for number in range(9):
        left, bottom = 60 + number % 3 * 100, 340 - number // 3 * 100
        tag = cv2.aruco.generateImageMarker(dictionary, number, 80, borderBits=1)
        page[bottom - 80 : bottom, left : left + 80] = np.rot90(tag, 2)
    found = detect_board(cv2.GaussianBlur(page, (0, 0), 0.7), board)
    assert isinstance(found, BoardDetection)
    assert "border of one bit" in found.method
    assert np.array_equal(found.indices, np.arange(36))
    expected = np.array([59.5, 339.5]) + board.points[:, :2] * [1, -1]
    assert np.abs(found.pixels - expected).max() < 0.5


def test_foreign_tags_and_tags_seen_twice_are_left_out(rng: np.random.Generator) -> None:
    """A smaller board of the same family shows tags of the larger one: those beyond its own are not its corners."""
    large, small = parse_board("aprilgrid:4x3:30mm:9mm"), parse_board("aprilgrid:4x2:30mm:9mm")
    view = placed(TILT * Rotation.from_rotvec([np.pi, 0, 0]), large.points.mean(axis=0), np.zeros(2), 420.0)
    image = render_board(CAMERA, large, view, rng)
    found = detect_board(image, small)
    assert isinstance(found, BoardDetection)
    assert np.array_equal(found.indices, np.arange(32))
    twice = detect_board(np.hstack([image[:, :500], image[:, :500]]), large)
    assert isinstance(twice, Refusal)
    assert "no marker" in twice.reason


def test_a_tag_of_another_family_is_no_board(rng: np.random.Generator) -> None:
    board = parse_board("aprilgrid:4x3:30mm:9mm")
    view = placed(TILT * Rotation.from_rotvec([np.pi, 0, 0]), board.points.mean(axis=0), np.zeros(2), 420.0)
    image = render_board(CAMERA, board, view, rng)
    assert isinstance(detect_board(image, parse_board("aprilgrid:4x3:30mm:9mm:DICT_APRILTAG_36h10")), Refusal)
    with pytest.raises(InputError, match="600 markers"):
        detect_board(image, parse_board("aprilgrid:30x20:30mm:9mm"))
