"""Printed boards: the page is read back at a known resolution, and shows the board that the detector expects, in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from symcal.camera.board import Board, parse_board
from symcal.cli import app
from symcal.errors import InputError
from symcal.plots.board import board_sheet
from symcal.runs.board import print_board
from symcal.vision.board import BoardDetection, detect_board
from symcal.vision.patterns import board_plate
from symcal.vision.printed import artwork

BOARDS = [
    "chessboard:9x6:25mm",
    "circles:9x7:20mm",
    "asymmetric_circles:4x11:15mm",
    "charuco:12x9:30mm:22mm",
    "charuco:5x8:22mm:15mm:DICT_5X5_50",
    "aprilgrid:6x6:30mm:9mm",
    "aprilgrid:5x3:35mm:7mm:DICT_APRILTAG_25h9",
]
DPI = 200


def read_back(file: Path) -> np.ndarray:
    """The first page as grey levels."""
    pdfium = pytest.importorskip("pypdfium2", reason="pypdfium2, which draws PDF files, is not installed")
    document = pdfium.PdfDocument(file)
    image = np.asarray(document[0].render(scale=DPI / 72, grayscale=True).to_numpy())
    document.close()
    return np.ascontiguousarray(image.reshape(image.shape[:2]))


@pytest.mark.parametrize("text", BOARDS)
def test_the_printed_board_is_the_one_that_is_detected(text: str, tmp_path: Path) -> None:
    board = parse_board(text)
    sheet = print_board(board, tmp_path / "board.pdf")
    image = read_back(tmp_path / "board.pdf")
    assert image.shape == pytest.approx((sheet.height * DPI / 25.4, sheet.width * DPI / 25.4), abs=1)
    found = detect_board(image, board)
    assert isinstance(found, BoardDetection)
    assert np.array_equal(found.indices, np.arange(len(board.points)))
    # the drawn page has a whole number of pixels: its size is that of the page all the same
    mm = (found.pixels + 0.5) * [sheet.width, sheet.height] / image.shape[::-1] - [sheet.left, sheet.top]
    expected = artwork(board).points
    if board.kind in ("chessboard", "circles") and np.abs(mm - expected).max() > 1:
        expected = expected[::-1]  # these two look the same after half a turn
    assert np.abs(mm - expected).max() < 0.05
    apart = np.linalg.norm(mm[1:] - mm[:-1], axis=1)
    assert apart == pytest.approx(np.linalg.norm(np.diff(board.points, axis=0), axis=1), abs=0.05)


@pytest.mark.parametrize("text", BOARDS)
def test_the_shapes_are_those_of_the_rendered_pattern(text: str, rng: np.random.Generator) -> None:
    board = parse_board(text)
    art, face = artwork(board), board_plate(board).pattern
    paper = rng.uniform(0, 1, (4000, 2)) * [art.width, art.height]
    left, top, width, height = art.rectangles.T
    x, y = paper[:, :1], paper[:, 1:]
    black = ((x >= left) & (x < left + width) & (y >= top) & (y < top + height)).any(axis=1)
    for u, v, radius in art.discs:
        black |= np.hypot(paper[:, 0] - u, paper[:, 1] - v) < radius
    on_board = (paper - art.points[0]) * [1, -board.facing] + board.points[0, :2]
    assert np.mean((face(on_board[:, 0], on_board[:, 1]) < 0.5) == black) == 1
    assert 0.2 < black.mean() < 0.8


def test_the_bar_is_100_mm_and_nothing_stands_near_the_pattern(tmp_path: Path) -> None:
    board = parse_board("charuco:12x9:30mm:22mm")
    sheet = print_board(board, tmp_path / "board.pdf")
    assert sheet.page == "A3"
    art, image = artwork(board), read_back(tmp_path / "board.pdf")
    ink = image < 128
    rows = int((sheet.top + art.height) * DPI / 25.4) + 2
    runs = ink[rows:].sum(axis=1)
    assert runs.max() * 25.4 / DPI == pytest.approx(100, abs=0.2)
    top, left = (np.array([sheet.top, sheet.left]) * DPI / 25.4).round().astype(int)
    assert not ink[: top - 1].any()
    assert not ink[:, : left - 1].any()
    quiet = int(7.0 * DPI / 25.4)
    assert not ink[rows : rows + quiet].any()


def test_the_page_has_its_size_and_its_text(tmp_path: Path) -> None:
    pypdf = pytest.importorskip("pypdf", reason="pypdf, which reads PDF files back, is not installed")
    print_board(parse_board("chessboard:9x6:25mm"), tmp_path / "board.pdf")
    (page,) = pypdf.PdfReader(tmp_path / "board.pdf").pages
    assert [float(n) / 72 * 25.4 for n in page.mediabox[2:]] == pytest.approx([297, 210], abs=0.01)
    text = page.extract_text()
    assert "measure me: 100 mm" in text
    assert "chessboard:9x6:25mm" in text


def test_the_same_board_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.pdf", "b.pdf"):
        print_board(parse_board("aprilgrid:2x2:30mm:9mm"), tmp_path / name)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


@pytest.mark.parametrize(
    ("text", "page", "name", "size"),
    [
        ("chessboard:9x6:25mm", None, "A4", (297, 210)),
        ("chessboard:6x9:25mm", None, "A4", (210, 297)),
        ("chessboard:9x6:25mm", "A2", "A2", (420, 594)),
        ("chessboard:3x3:5mm", "exact", "exact", (110, 40.5)),
        ("chessboard:11x8:100mm", "exact", "exact", (1230, 940.5)),
    ],
)
def test_pages(text: str, page: str | None, name: str, size: tuple[float, float]) -> None:
    sheet = board_sheet(parse_board(text), page)
    assert sheet.page == name
    assert (sheet.width, sheet.height) == pytest.approx(size)


@pytest.mark.parametrize(
    ("text", "page", "words"),
    [
        ("chessboard:11x8:100mm", None, "no page up to A0"),
        ("charuco:12x9:30mm:22mm", "A4", "A3 holds it"),
        ("charuco:12x9:30mm:22mm", "A5", "no such page"),
        ("chessboard:11x8:1m", "exact", "too large"),
    ],
)
def test_what_fits_no_page_is_refused(text: str, page: str | None, words: str) -> None:
    with pytest.raises(InputError, match=words):
        board_sheet(parse_board(text), page)


def test_board_command(tmp_path: Path) -> None:
    out = tmp_path / "board.pdf"
    done = CliRunner().invoke(app, ["board", "charuco:12x9:30mm:22mm", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "charuco:12x9:30mm:22mm:DICT_4X4_100 on A3" in done.output
    assert out.read_bytes().startswith(b"%PDF")
    done = CliRunner().invoke(
        app, ["board", "charuco:12x9:30mm:22mm", "--out", str(tmp_path / "a4.pdf"), "--page", "A4"]
    )
    assert isinstance(done.exception, InputError)
    assert not (tmp_path / "a4.pdf").exists()


def test_a_charuco_board_finds_its_dictionary() -> None:
    sizes = {"5x7": "50", "10x10": "50", "12x9": "100", "20x20": "250", "40x30": "1000"}
    for size, count in sizes.items():
        board = parse_board(f"charuco:{size}:30mm:22mm")
        assert board.dictionary == f"DICT_4X4_{count}"
        assert parse_board(str(board)) == board
    with pytest.raises(InputError, match="1250 markers"):
        parse_board("charuco:50x50:30mm:22mm")
    assert str(parse_board("aprilgrid:6x6:30mm:9mm")) == "aprilgrid:6x6:30mm:9mm:DICT_APRILTAG_36h11"
    assert parse_board("aprilgrid:6x5:88mm:26.4mm") == Board(
        "aprilgrid", 6, 5, 88.0, dictionary="DICT_APRILTAG_36h11", gap=26.4
    )
