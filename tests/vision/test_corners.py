"""Cameras from lists of corners: OpenCV's numbers for every choice of terms, SciPy's for what it cannot say."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_scenes import board_views
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from symcal.camera.board import parse_board
from symcal.camera.camera import INTRINSIC_NAMES, NUMBER_NAMES, Camera, project_points
from symcal.errors import InputError, RefusedError
from symcal.vision.board import BoardDetection
from symcal.vision.calibrate import calibrate_camera
from symcal.vision.corners import CornerList, load_corners
from symcal.vision.verdict import judge

CAMERA = Camera(1000, 800, 800.0, 804.0, 510.0, 390.0, (-0.25, 0.08, 0.0005, -0.0008, 0.01))
BOARD = parse_board("chessboard:9x6:25mm")
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 1000, 1e-15)
FLAGS = {"p1,p2": cv2.CALIB_ZERO_TANGENT_DIST, "k2": cv2.CALIB_FIX_K2, "k3": cv2.CALIB_FIX_K3}
SUBSETS = [subset for count in range(4) for subset in itertools.combinations(FLAGS, count)]

Seen = list[tuple[np.ndarray, np.ndarray]]


def partial_views(rng: np.random.Generator, camera: Camera = CAMERA, count: int = 7, sigma: float = 0.3) -> Seen:
    """Ids and noisy pixels of views that show part of the board; numbers that float32 holds, as OpenCV wants them."""
    seen = []
    for pose in board_views(Camera(1000, 800, 800.0, 804.0, 510.0, 390.0, (-0.25, 0.08)), BOARD, count, rng):
        ids = np.sort(rng.choice(54, rng.integers(12, 54), replace=False))
        pixels = project_points(camera, BOARD.points[ids] @ pose[:3, :3].T + pose[:3, 3])
        seen.append((ids, (pixels + sigma * rng.standard_normal(pixels.shape)).astype(np.float32).astype(float)))
    return seen


def written(path: Path, points: np.ndarray, seen: Seen, names: str = "X_mm,Y_mm,Z_mm,u_px,v_px") -> Path:
    """The views as a list of corners."""
    rows = [f"view,id,{names}"]
    for view, (ids, pixels) in enumerate(seen):
        for i, (u, v) in zip(ids.tolist(), pixels.tolist(), strict=True):
            x, y, z = points[i].tolist()
            rows.append(f"view {view},{i},{x!r},{y!r},{z!r},{u!r},{v!r}")
    path.write_text("\n".join(rows) + "\n")
    return path


def opencv(
    points: np.ndarray, seen: Seen, flags: int, guess: np.ndarray | None = None
) -> tuple[float, np.ndarray, np.ndarray]:
    """Rms, the nine intrinsics and their standard deviations."""
    objects = [points[ids].astype(np.float32) for ids, _ in seen]
    images = [pixels.astype(np.float32) for _, pixels in seen]
    answer = cv2.calibrateCameraExtended(
        objects, images, (1000, 800), guess, np.zeros(5), flags=flags, criteria=CRITERIA
    )
    k = answer[1]
    return answer[0], np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2], *np.ravel(answer[2])[:5]]), np.ravel(answer[5])[:9]


def residuals(x: np.ndarray, names: tuple[str, ...], seen: Seen) -> np.ndarray:
    """Projected minus measured, written out anew: the camera's numbers by name, then a rotation vector and a shift."""
    given = dict.fromkeys(NUMBER_NAMES, 0.0) | dict(zip(names, x, strict=False))
    fx, fy, cx, cy, k1, k2, p1, p2, k3, skew = given.values()
    out = []
    for pose, (ids, pixels) in zip(x[len(names) :].reshape(-1, 6), seen, strict=True):
        point = Rotation.from_rotvec(pose[:3]).apply(BOARD.points[ids]) + pose[3:]
        a, b = point[:, 0] / point[:, 2], point[:, 1] / point[:, 2]
        s = a**2 + b**2
        radial = 1 + k1 * s + k2 * s**2 + k3 * s**3
        c = a * radial + 2 * p1 * a * b + p2 * (s + 2 * a**2)
        d = b * radial + p1 * (s + 2 * b**2) + 2 * p2 * a * b
        out.append(np.column_stack([fx * c + skew * d + cx, fy * d + cy]) - pixels)
    return np.concatenate(out).ravel()


@pytest.mark.parametrize("fixed", SUBSETS, ids=lambda fixed: "+".join(fixed) or "none")
def test_every_choice_of_fixed_terms_agrees_with_opencv(
    fixed: tuple[str, ...], rng: np.random.Generator, tmp_path: Path
) -> None:
    seen = partial_views(rng)
    corners = load_corners(written(tmp_path / "c.csv", BOARD.points, seen), (1000, 800))
    found = calibrate_camera(corners, fix=",".join(fixed))
    rms, numbers, sigma = opencv(BOARD.points, seen, sum(FLAGS[name] for name in fixed))
    assert found.camera.rms_px == pytest.approx(rms, rel=1e-9)
    assert np.all(np.abs(found.camera.intrinsics - numbers) <= 5e-6 * sigma)  # OpenCV itself varies by 2e-6
    assert found.sigma == pytest.approx(sigma, rel=1e-5, abs=1e-12)
    held = {name for names in fixed for name in names.split(",")}
    assert set(found.free) == set(INTRINSIC_NAMES) - held
    assert set(found.asked) == held
    assert len(found.used) == len(seen)


@pytest.mark.parametrize(
    ("fix", "skew"), [("p1", False), ("p2", False), ("k1", False), ("none", True), ("p2,k3", True)]
)
def test_what_opencv_cannot_say_agrees_with_scipy(fix: str, skew: bool, rng: np.random.Generator) -> None:
    seen = partial_views(rng, Camera(1000, 800, 800.0, 804.0, 510.0, 390.0, (-0.25, 0.08), skew=2.0))
    found = calibrate_camera(corner_list(BOARD.points, seen), fix=fix, skew=skew)
    names = tuple(name for name in NUMBER_NAMES if name not in fix.split(",") and (skew or name != "skew"))
    assert found.free == names
    numbers = dict(zip(NUMBER_NAMES, found.camera.numbers, strict=True))
    assert all(numbers[name] == 0 for name in NUMBER_NAMES if name not in names)
    poses = [
        [*Rotation.from_matrix(view.T_camera_board[:3, :3]).as_rotvec(), *view.T_camera_board[:3, 3]]
        for view in found.views
    ]
    start = np.array([*(numbers[name] for name in names), *np.ravel(poses)])
    moved = start * (1 + 1e-4 * rng.standard_normal(start.shape))
    best = least_squares(residuals, moved, args=(names, seen), x_scale="jac", ftol=1e-15, xtol=1e-15, gtol=1e-15)
    assert 2 * best.cost == pytest.approx(float(np.sum(residuals(start, names, seen) ** 2)), rel=1e-8)
    sigma = dict(zip(NUMBER_NAMES, found.sigma, strict=False))
    for name, value in zip(names, best.x, strict=False):
        assert numbers[name] == pytest.approx(value, abs=2e-3 * sigma[name]), name
    covariance = np.linalg.inv(best.jac.T @ best.jac) * 2 * best.cost / (len(best.fun) - len(best.x))
    expected = np.sqrt(np.diag(covariance))
    assert [sigma[name] for name in names] == pytest.approx(expected[: len(names)], rel=1e-3)


def corner_list(points: np.ndarray, seen: Seen) -> CornerList:
    views = [
        BoardDetection(f"view {i}", (1000, 800), ids, pixels, None, float("nan"), "list")
        for i, (ids, pixels) in enumerate(seen)
    ]
    return CornerList(points, tuple(str(i) for i in range(len(points))), (1000, 800), tuple(views))


def test_the_skew_is_found_and_reported(rng: np.random.Generator) -> None:
    truth = Camera(1000, 800, 800.0, 804.0, 510.0, 390.0, (-0.25, 0.08), skew=1.5)
    found = calibrate_camera(corner_list(BOARD.points, partial_views(rng, truth, 10, 0.1)), fix="k3", skew=True)
    assert found.free[-1] == "skew"
    assert found.camera.covariance is not None
    assert found.camera.covariance.shape == (10, 10)
    free = found.sigma > 0
    assert np.abs((found.camera.numbers - truth.numbers)[free] / found.sigma[free]).max() < 4
    assert abs(found.camera.skew) > 5 * found.sigma[-1]


@pytest.mark.parametrize("count", [1, 4])
def test_a_solid_target_agrees_with_opencv_from_a_guess(count: int, rng: np.random.Generator, tmp_path: Path) -> None:
    points = rng.uniform(-90, 90, (50, 3)).astype(np.float32).astype(float)
    seen = []
    for _ in range(count):
        ids = np.sort(rng.choice(50, 35, replace=False))
        turn, shift = Rotation.random(rng=rng), np.array([*rng.uniform(-40, 40, 2), 480.0])
        pixels = project_points(CAMERA, turn.apply(points[ids]) + shift)
        seen.append((ids, (pixels + 0.2 * rng.standard_normal(pixels.shape)).astype(np.float32).astype(float)))
    found = calibrate_camera(load_corners(written(tmp_path / "c.csv", points, seen), (1000, 800)))
    guess = np.array([[900.0, 0, 500], [0, 900, 400], [0, 0, 1]])
    rms, numbers, _ = opencv(points, seen, cv2.CALIB_USE_INTRINSIC_GUESS, guess)
    assert found.camera.rms_px == pytest.approx(rms, rel=1e-9)
    assert found.camera.intrinsics == pytest.approx(numbers, rel=1e-6, abs=1e-6)
    assert not any("frontal" in finding for finding in judge(found).findings)


def test_where_the_plane_of_a_flat_target_lies_does_not_matter(rng: np.random.Generator) -> None:
    seen = partial_views(rng)
    turned = Rotation.random(rng=rng).apply(BOARD.points) + np.array([50.0, -20.0, 300.0])
    here, there = (calibrate_camera(corner_list(points, seen)) for points in (BOARD.points, turned))
    assert there.camera.numbers == pytest.approx(here.camera.numbers, rel=1e-6, abs=1e-6)
    for a, b in zip(here.views, there.views, strict=True):
        first = BOARD.points @ a.T_camera_board[:3, :3].T + a.T_camera_board[:3, 3]
        assert turned @ b.T_camera_board[:3, :3].T + b.T_camera_board[:3, 3] == pytest.approx(first, abs=1e-3)


def test_a_bad_view_of_a_list_is_used_and_named_unless_asked(rng: np.random.Generator) -> None:
    seen = partial_views(rng, sigma=0.1)
    seen[2] = (seen[2][0], seen[2][1] + 2.0 * rng.standard_normal(seen[2][1].shape))
    corners = corner_list(BOARD.points, seen)
    whole = calibrate_camera(corners)
    assert len(whole.used) == len(seen)
    assert [name for name, why in judge(whole).retake if "times the median" in why] == ["view 2"]
    less = calibrate_camera(corners, keep_all=False)
    assert [view.name for view in less.views if not view.used] == ["view 2"]
    assert "more than 3 times the median" in less.views[2].reason


def test_exact_corners_leave_no_warning(rng: np.random.Generator) -> None:
    found = calibrate_camera(corner_list(BOARD.points, partial_views(rng, sigma=0.0)))
    assert found.camera.numbers == pytest.approx(CAMERA.numbers, rel=1e-5, abs=1e-4)
    assert judge(found).retake == ()


def test_detections_take_fixed_terms_too(rng: np.random.Generator) -> None:
    views = corner_list(BOARD.points, partial_views(rng)).views
    free = {fix: calibrate_camera(views, BOARD, fix=fix).free for fix in (None, "none", "k3", ("p1", "p2"))}
    assert "k3" not in free[None]  # not determined by these views
    assert free["none"] == INTRINSIC_NAMES
    assert free["k3"] == INTRINSIC_NAMES[:-1]
    assert set(INTRINSIC_NAMES) - set(free["p1", "p2"]) == {"p1", "p2"}
    with pytest.raises(InputError, match="need the board"):
        calibrate_camera(views)
    with pytest.raises(InputError, match="held at zero"):
        calibrate_camera(views, BOARD, fix="p3")


HEAD = "view,id,X_mm,Y_mm,u,v\n"
GOOD = "".join(
    f"{view},{3 * j + i},{25 * i},{25 * j},{100 + 60 * i + 3 * view * j},{90 + 55 * j + 2 * view * i}\n"
    for view in range(3)
    for i in range(3)
    for j in range(3)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD + GOOD + "0,0,0,0,100,90\n", "view '0' has id '0' twice"),
        (HEAD + GOOD + "4,0,1,0,100,90\n", "other coordinates"),
        (HEAD + GOOD + "4,0,0,0,nan,90\n", "not a finite number"),
        (HEAD + GOOD + "4,0,0,0,,90\n", "empty cell"),
        (HEAD + GOOD + ",0,0,0,100,90\n", "empty cell"),
        (HEAD + GOOD + "4,0,0,0,90,700\n", "outside the image of 640 x 480 px: is its size another one"),
        (HEAD + GOOD + "4,0,0,0,90,600\n", "u and v look swapped"),
        ("view,id,X_mm,Y_mm,u_mm,v\n" + GOOD, "has the unit 'mm'"),
        ("view,id,X_px,Y_mm,u,v\n" + GOOD, "has the unit 'px'"),
        ("view,id,X,Y_mm,u,v\n" + GOOD, "some have none"),
        ("view,id,X_mm,u,v\n0,0,0,100,90\n", "no column for 'Y'"),
        ("id,X_mm,Y_mm,u,v\n0,0,0,100,90\n", "no column 'view'"),
        (HEAD, "no rows"),
        ("view,id,X_um,Y_mm,x_mm,u,v\n0,0,0,0,0,100,90\n", "same quantity twice"),
        (
            HEAD + "".join(f"0,{i},{0.025 * i},{0.025 * (i % 3)},{100 + i},{90 + i % 3}\n" for i in range(9)),
            "are they in m",
        ),
        ("view,id,X_m,Y_m,u,v\n" + GOOD, "are they in mm"),
    ],
)
def test_a_list_that_cannot_be_used_is_named_in_a_sentence(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "corners.csv"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_corners(file, (640, 480))
    assert words in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_views_that_show_too_little_are_listed(tmp_path: Path) -> None:
    file = tmp_path / "corners.csv"
    few = "few,0,0,0,100,90\nfew,1,25,0,160,90\nfew,3,0,25,100,150\n"
    ids = (0, 1, 2, 9, 10)
    line = "".join(f"line,{name},{25 * i},0,{100 + 60 * i},90\n" for i, name in enumerate(ids))
    but_one = line.replace("line", "but one") + "but one,3,0,25,100,150\n"
    same = "".join(
        f"same,{3 * j + i},{25 * i},{25 * j},100,{90 + 10 * i + 30 * j}\n" for i in range(3) for j in range(3)
    )
    file.write_text(HEAD + GOOD + few + line + but_one + same)
    corners = load_corners(file, (640, 480))
    assert [view.name for view in corners.views] == ["0", "1", "2"]
    assert {refusal.name: refusal.reason for refusal in corners.refusals} == {
        "few": "it has 3 points: at least 4 are needed",
        "line": "its 5 points lie on one line",
        "but one": "all but one of its 6 points lie on one line",
        "same": "its 9 image points lie on one line",
    }
    with pytest.raises(RefusedError, match="2 views can be used, 3 or more are needed; few: it has 3 points"):
        calibrate_camera(replace(corners, views=corners.views[:2]))


def test_a_unit_less_length_is_taken_as_mm_and_said(tmp_path: Path) -> None:
    files = [tmp_path / "plain.csv", tmp_path / "mm.csv"]
    files[0].write_text(HEAD.replace("X_mm,Y_mm", "x,y") + GOOD)
    files[1].write_text(HEAD + GOOD)
    plain, mm = (load_corners(file, (640, 480)) for file in files)
    assert np.array_equal(plain.points, mm.points)
    assert "taken as mm" in plain.note
    assert mm.note == ""


def test_opencvs_photographs_give_the_published_numbers(symcal_data: Path) -> None:
    """left01..14, half window 5: rms 0.19542, fx 532.8272 and so on, in SOURCE.md beside them."""
    folder = symcal_data / "opencv_left_right"
    if not folder.is_dir():
        pytest.skip(f"OpenCV's photographs are not in {symcal_data}")
    views = []
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    for file in sorted(folder.glob("left*.jpg")):
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        found, corners = cv2.findChessboardCorners(image, (9, 6))
        assert found
        pixels = cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), criteria).reshape(-1, 2).astype(float)
        views.append(BoardDetection(file.name, (640, 480), np.arange(54), pixels, None, float("nan"), "list"))
    names = tuple(str(i) for i in range(54))
    found = calibrate_camera(CornerList(BOARD.points, names, (640, 480), tuple(views)))
    assert len(found.used) == 13
    published = [532.8272, 532.9460, 342.4868, 233.8557, -0.280882, 0.025179, 0.001217, -0.000136, 0.163433]
    digits = [4, 4, 4, 4, 6, 6, 6, 6, 6]
    assert [round(float(n), d) for n, d in zip(found.camera.intrinsics, digits, strict=True)] == published
    assert round(found.camera.rms_px or 0.0, 5) == 0.19542


def test_views_that_do_not_determine_the_camera_are_refused(rng: np.random.Generator) -> None:
    board, frontal = BOARD.points - BOARD.points.mean(axis=0), []
    for k, depth in enumerate((300.0, 350.0, 420.0, 500.0)):
        turn = Rotation.from_rotvec(np.deg2rad(1.0) * np.array([np.cos(k), np.sin(k), 0.0]))
        pixels = project_points(CAMERA, turn.apply(board) + np.array([0, 0, depth]))
        frontal.append((np.arange(54), pixels + 0.1 * rng.standard_normal(pixels.shape)))
    with pytest.raises(RefusedError, match="do not determine the focal length"):
        calibrate_camera(corner_list(board, frontal), fix="k1,k2,k3,p1,p2")
    with pytest.raises(RefusedError, match="do not determine"):
        calibrate_camera(corner_list(board, [frontal[0]] * 3))
    few = [(ids[[0, 8, 45, 53]], pixels[[0, 8, 45, 53]]) for ids, pixels in frontal[:3]]
    with pytest.raises(RefusedError, match="24 coordinates of points for 27 unknowns"):
        calibrate_camera(corner_list(board, few))


def test_numbers_of_any_precision_and_unit_give_opencvs_numbers(rng: np.random.Generator, tmp_path: Path) -> None:
    """OpenCV rounds to float32, in the unit that it is given."""
    inches = BOARD.points[:, :2] / 25.4 + 1 / 3
    seen = [(ids, pixels + 1e-5 * rng.standard_normal(pixels.shape)) for ids, pixels in partial_views(rng)]
    points = np.column_stack([inches, np.zeros(len(inches))])
    file = written(tmp_path / "c.csv", points, seen, "X_in,Y_in,Z_in,u,v")
    found = calibrate_camera(load_corners(file, (1000, 800)), fix="p1,p2,k3")
    rms, numbers, sigma = opencv(points, seen, cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3)
    assert found.camera.rms_px == pytest.approx(rms, rel=1e-9)
    assert np.all(np.abs(found.camera.intrinsics - numbers) <= 5e-6 * sigma)
