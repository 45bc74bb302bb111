"""Files that wait, never end, or mean more than they weigh: one error at once, for every reader."""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from fuzz.readers import ARM, READERS, TABLES, URDF, arm
from hypothesis import given
from hypothesis import strategies as st

import symcal as sc
from symcal.config.conversion import load_experiment
from symcal.documents.document import LARGEST, Strict, read_document, validate
from symcal.documents.read import read_bytes, read_text
from symcal.errors import InputError
from symcal.vision.image_size import image_size
from symcal.vision.images import read_image

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes and devices, and a signal as clock")

# words of a command line; and what is looked for beside other files, and is not there if it is no file
FILES = sorted(set(READERS) - {"set", "board", "results", "manifest"})


class TooLong(BaseException):
    pass


@pytest.fixture(autouse=True)
def clock() -> Iterator[None]:
    """Half a minute for a test, most of which take none."""

    def late(*_: object) -> None:
        raise TooLong

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, 30.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


def refused(reader: str, path: Path) -> str:
    with pytest.raises(InputError) as caught:
        READERS[reader].read(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("reader", FILES)
def test_what_is_no_file_is_named(reader: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "this is a pipe: an ordinary file is needed" in refused(reader, tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    assert "this is a device" in refused(reader, tmp_path / "zero")
    assert "this is a folder" in refused(reader, tmp_path)
    assert "there is no such" in refused(reader, tmp_path / "nothing")
    (tmp_path / "loop").symlink_to("loop")
    assert "cannot be read" in refused(reader, tmp_path / "loop")
    assert "cannot be read" in refused(reader, tmp_path / ("x" * 300))
    assert "cannot be read" in refused(reader, Path("a\0b"))
    with socket.socket(socket.AF_UNIX) as plug:
        plug.bind(str(tmp_path / "s"))
        assert "this is a socket" in refused(reader, tmp_path / "s")


def test_a_file_has_a_largest_size(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"x" * 100)
    assert read_bytes(path, 100) == b"x" * 100
    with pytest.raises(InputError, match="too large"):
        read_bytes(path, 99)
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match="UTF-8"):
        read_text(path, 100)


BOMBS = """
import resource, sys, time
from pathlib import Path
from fuzz.readers import ROOT, READERS, arm
from fuzz.worker import limit_memory
from symcal.errors import InputError
arm(), READERS["image"].seeds(Path())
limit_memory()
for reader, name in zip(sys.argv[1::2], sys.argv[2::2]):
    began = time.process_time()
    try:
        READERS[reader].read(Path(name))
        said = "read"
    except InputError as error:
        said = str(error)
    print(f"{time.process_time() - began:.2f}|{said}")
"""


def png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(bytes(1 + width) * 100)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_small_files_that_mean_much_are_read_or_refused_within_a_gigabyte(tmp_path: Path) -> None:
    signal.setitimer(signal.ITIMER_REAL, 120.0)
    row = b"p,1.5,2.5,3.5,100.25,200.25,300.25\n"
    head = b"pose,q1_deg,q2_mm,q3_deg,x_mm,y_mm,z_mm\n"
    rows = [b"%d,%d.5,2.5,%d.25,%d.25,200.25,300.25\n" % (i, i % 90, i % 77, i % 500) for i in range(30_000)]
    points = [b"%d,P%d,1.5,2.5,3.5,100.25,200.25,300.25\n" % (i, i) for i in range(20_000)]
    cases = [
        ("robot", b"name: arm\nlinks:\n" + b"- 1\n" * 250_000, "more than 200000 values"),
        ("robot", b"- 1234567\n" * 950_000, "too large"),
        ("robot", ARM.replace(b"standard", b"x" * 3_900_000), "not one of the allowed values"),
        ("robot", b"a: " + b"[" * 3_900_000, "nested too deeply"),
        ("robot", b"name: arm\nlinks:\n" + b"- 1\n" * 30_000, "more problem"),
        ("urdf", b"<robot>" + b"<a/>" * 150_000 + b"</robot>", "more than 100000 elements"),
        ("urdf", b"<robot>" + b"<a>" * 100_000, "nested too deeply"),
        ("position", head + row * 400_000, "stands twice"),
        ("position", head + b"".join(rows), "read"),
        ("position", b"point," + head + b"".join(points), "20000 poses of 20000 points"),
        ("position", b",".join(b"c%d" % i for i in range(500_000)) + b"\n1\n", "500000 columns"),
        ("position", head + b"a," + b"1" * 100_000 + b"x,2,3,4,5,6\n", "not a finite number"),
        ("plan", head + b"".join(rows), "read"),
        ("shots", b"image,q1_deg,q2_mm,q3_deg\n" + b"".join(b"%d.png,1,2,3\n" % i for i in range(20_000)), "read"),
        ("image", png(30_000, 30_000), "30000 x 30000"),
    ]
    arguments = []
    for i, (reader, content, _) in enumerate(cases):
        path = tmp_path / str(i)
        path.write_bytes(content)
        arguments += [reader, str(path)]
    done = subprocess.run(
        [sys.executable, "-c", BOMBS, *arguments],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    for (reader, _, words), line in zip(cases, done.stdout.splitlines(), strict=True):
        seconds, _, said = line.partition("|")
        assert words in said, (reader, said[:200])
        assert float(seconds) < 5, (reader, said[:200])


# ------------------------------------------------------------------------------------------------------------- numbers


@pytest.mark.parametrize("kind", ["position", "pose", "distance", "pixels"])
@pytest.mark.parametrize("value", ["1e308", "-1e13", "1e-400e", "1e999"])
def test_a_number_beyond_all_lengths_is_named_with_its_place(kind: str, value: str, tmp_path: Path) -> None:
    head, *rows = TABLES[kind][0].decode().splitlines()
    cells = rows[2].split(",")
    for i in range(1, len(head.split(","))):
        if head.split(",")[i] == "point":
            continue
        path = tmp_path / "m.csv"
        path.write_text("\n".join([head, *rows[:2], ",".join([*cells[:i], value, *cells[i + 1 :]]), *rows[3:]]))
        with pytest.raises(InputError) as caught:
            sc.load_measurements(path, arm(), kind)
        assert (caught.value.line, caught.value.column) == (4, head.split(",")[i])


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        (b"d: 300", b"d: 1e308", "links[0].d"),
        (b"alpha: 90", b"alpha: -2e15", "links[2].alpha"),
        (b"[0, 700]", b"[0, 900000000000000000]", "links[1].limits[1]"),
        (b"alpha_2: 2", b"alpha_2: 1e200", "scales.alpha_2"),
    ],
)
def test_a_number_beyond_all_lengths_in_a_robot_file(old: bytes, new: bytes, key: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    assert old in ARM
    path.write_bytes(ARM.replace(old, new))
    with pytest.raises(InputError, match="larger than 1e") as caught:
        sc.load_robot(path)
    assert caught.value.key == key
    assert caught.value.line is not None


def test_a_number_beyond_all_lengths_in_a_urdf_file(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(URDF.replace(b'xyz="0 0 0.3"', b'xyz="0 0 1e308"'))
    with pytest.raises(InputError, match="of at most 1e") as caught:
        READERS["urdf"].read(path)
    assert caught.value.line == 8


def test_a_seed_may_be_large(configs: Path) -> None:
    file, _ = load_experiment(configs / "simulated_arm.yaml", [f"seed={int(LARGEST) * 10}"])
    assert file.seed == int(LARGEST) * 10


# ------------------------------------------------------------------------------------------------ --set, boards, words


@pytest.mark.parametrize(
    "text",
    [
        ".".join(["a"] * 5000) + "=1",
        "title=" + "[" * 5000,
        "title=" + "{a: " * 5000,
        "title=&x [*x]",
        "title=!!python/object/apply:os.system [ls]",
        "title=\udcff",
        "seed=" + "9" * 5000,
        "data.truth.sigma_length=1e308",
        "title='" + "x" * 100_000,
    ],
)
def test_a_hostile_option(text: str, configs: Path) -> None:
    with pytest.raises(InputError) as caught:
        load_experiment(configs / "simulated_arm.yaml", [text])
    assert len(str(caught.value)) < 1000
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "text",
    ["chessboard:99999999x99999999:25mm", f"circles:{'9' * 5000}x3:25mm", f"circles:4x3:{'9' * 500}mm", "a:٣x٣:1mm"],
)
def test_a_hostile_board(text: str) -> None:
    with pytest.raises(InputError, match="board"):
        sc.parse_board(text)


class Named(Strict):
    title: str
    notes: dict[str, str] = {}


@pytest.mark.parametrize(
    "text", ['title: "\\e[2Jgone"', 'title: x\nnotes: {a: "\\u202e"}', 'title: x\nnotes: {"\\x9b": a}']
)
def test_a_text_that_steers_a_terminal_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="control character") as caught:
        validate(read_document(path), Named)
    assert caught.value.line == text.count("\n") + 1
    assert str(caught.value).isprintable()


def test_a_text_that_steers_a_terminal_in_other_files(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(TABLES["position"][0].replace(b"p2", b"\x1b[2J"))
    assert f"{path}:4: a control character" in refused("position", path)
    path.write_bytes(URDF.replace(b'name="turn"', b'name="&#x9b;2J"'))
    assert f"{path}:7: " in refused("urdf", path)


@given(st.text(), st.text(), st.lists(st.text(), max_size=3))
def test_an_error_can_always_be_shown(found: str, key: str, allowed: list[str]) -> None:
    said = str(InputError("x", key=key, found=found, allowed=allowed))
    assert said.isprintable()
    said.encode()


def test_an_error_about_much_is_short_and_quick() -> None:
    said = str(InputError("x", found="y" * 5_000_000, allowed=[f"name {i}" for i in range(300_000)]))
    assert len(said) < 5000
    assert "299900 more" in said


printable = st.text(st.characters(exclude_categories=("C", "Zl", "Zp")), min_size=1).filter(str.isprintable)


@given(st.lists(printable, min_size=4, max_size=4, unique=True))
def test_names_in_a_urdf_file_are_read_by_another_parser(tmp_path: Path, names: list[str]) -> None:
    """Python's own XML reader is the witness."""
    links = tuple(
        replace(link, joint=replace(link.joint, name=name)) for link, name in zip(arm().links, names[1:], strict=True)
    )
    sc.save_urdf(replace(arm(), name=names[0], links=links), tmp_path / "arm.urdf")
    root = ElementTree.parse(tmp_path / "arm.urdf").getroot()
    assert root.get("name") == names[0]
    assert [joint.get("name") for joint in root.iter("joint")][:3] == names[1:]


# -------------------------------------------------------------------------------------------------------------- images

FORMATS = (".png", ".jpg", ".bmp", ".tiff", ".pgm", ".ppm", ".webp")


@given(st.integers(1, 300), st.integers(1, 300), st.sampled_from(FORMATS), st.booleans(), st.integers(0, 2**32 - 1))
def test_the_size_in_the_header_is_that_of_the_pixels(
    width: int, height: int, kind: str, deep: bool, seed: int
) -> None:
    """OpenCV, which decodes the whole, is the witness."""
    picture = np.random.default_rng(seed).integers(0, 255, (height, width, 3) if kind == ".ppm" else (height, width))
    picture = picture.astype(np.uint16 if deep and kind in (".png", ".tiff", ".pgm") else np.uint8)
    content = cv2.imencode(kind, picture, [cv2.IMWRITE_WEBP_QUALITY, 101 if deep else 80] if kind == ".webp" else [])[1]
    assert image_size(content.tobytes()) == cv2.imdecode(content, cv2.IMREAD_UNCHANGED).shape[1::-1] == (width, height)


@given(st.sampled_from(FORMATS), st.integers(0, 60), st.binary(max_size=8))
def test_any_header_has_a_size_or_none(kind: str, at: int, new: bytes) -> None:
    picture = np.zeros((5, 7, 3) if kind == ".ppm" else (5, 7), np.uint8)
    content = cv2.imencode(kind, picture)[1].tobytes()
    for broken in (content[:at] + new + content[at + len(new) :], content[:at]):
        size = image_size(broken)
        assert size is None or min(size) >= 0


@pytest.mark.parametrize(
    "content", [b"P5 99999 99999 255 ", b"GIF89a\xff\xff\xff\xff", b"v/1\x01", b"\0\0\0\x0cjP  ", b""]
)
def test_other_pictures_are_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "x.png"
    path.write_bytes(content)
    with pytest.raises(InputError, match="image"):
        read_image(path)


def test_deep_grey_is_scaled_as_a_whole(tmp_path: Path) -> None:
    """12 bits in 16: divided by 16 and rounded, whatever the rows."""
    deep = np.random.default_rng(0).integers(0, 4096, (40, 30)).astype(np.uint16)
    deep[3, 3] = 4095
    cv2.imwrite(str(tmp_path / "x.png"), deep)
    np.testing.assert_array_equal(read_image(tmp_path / "x.png"), np.rint(deep * 255.0 / 4096))


# ---------------------------------------------------------------------------------------------------- a terminal's end


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_an_output_that_is_full(tmp_path: Path) -> None:
    signal.setitimer(signal.ITIMER_REAL, 120.0)
    (tmp_path / "arm.yaml").write_bytes(ARM)
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "symcal.cli", "check", str(tmp_path / "arm.yaml")],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert (done.returncode, done.stderr) == (
        1,
        "symcal: standard output cannot be written: No space left on device; what went to files is there\n",
    )
