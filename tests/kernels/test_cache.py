"""What lies in the cache of compiled kernels is run: never what is not ours and whole; and what is broken heals."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from symcal.kernels import batch_function, own_folder
from symcal.kernels import compile as compiling
from symcal.kernels import compiler as compilers
from symcal.kernels.compiler import find_compiler

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="these tests need links, pipes and owners of files"),
    pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine"),
]

CHILD = """
import casadi as ca, numpy as np
from symcal.kernels import batch_function
x = ca.SX.sym("x", 3)
q = np.arange(27.0).reshape(9, 3)
f = batch_function(ca.Function("f", [x], [ca.sin(x) * 1.75]), backend="c")
np.testing.assert_allclose(f(q)[0], np.sin(q) * 1.75, rtol=1e-15)
"""


def child(cache: Path | str, where: Path, **environment: str) -> None:
    """The same kernel in a new process; it must come to its end, right and silent."""
    done = subprocess.run(
        [sys.executable, "-P", "-W", "error", "-c", CHILD],  # -P: what lies in its folder is no package
        env={**os.environ, "XDG_CACHE_HOME": str(cache), **environment},
        cwd=where,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert (done.returncode, done.stderr) == (0, "")


def kept(cache: Path) -> Path:
    (library,) = cache.rglob("*.so")
    return library


def c_library(path: Path, text: str) -> bytes:
    source = path.with_suffix(".c")
    source.write_text(text)
    subprocess.run([*find_compiler().command, "-shared", "-fPIC", "-o", str(path), str(source)], check=True)
    return path.read_bytes()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the child's kernel."""
    cache = tmp_path_factory.mktemp("good")
    child(cache, cache)
    return cache


@pytest.fixture
def cache(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "cache"))


@pytest.mark.parametrize("length", [0, 4096, -1])
def test_a_truncated_library_is_compiled_again(cache: Path, tmp_path: Path, length: int) -> None:
    """Loaded, it kills the process with SIGBUS."""
    library = kept(cache)
    whole = library.read_bytes()
    library.write_bytes(whole[:length])
    child(cache, tmp_path)
    assert hashlib.sha256(kept(cache).read_bytes()).hexdigest() in kept(cache).name


def test_a_flipped_byte_is_seen(cache: Path, tmp_path: Path) -> None:
    library = kept(cache)
    content = bytearray(library.read_bytes())
    content[len(content) // 2] ^= 1
    library.write_bytes(content)
    child(cache, tmp_path)
    assert kept(cache).read_bytes() != bytes(content)


@pytest.mark.parametrize("own_hash", [False, True])
def test_a_library_without_the_function_is_compiled_again(cache: Path, tmp_path: Path, own_hash: bool) -> None:
    """With its own hash in its name it is even loaded: then the function is missed, and that heals as well."""
    library = kept(cache)
    other = c_library(tmp_path / "other.so", "int nothing_here;")
    library.unlink()
    key = library.stem.split("-")[0]
    place = library.with_name(f"{key}-{hashlib.sha256(other).hexdigest()}.so") if own_hash else library
    place.write_bytes(other)
    child(cache, tmp_path)
    assert kept(cache).read_bytes() != other


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, lambda path: path.symlink_to("/dev/zero")])
def test_what_is_no_file_is_neither_waited_for_nor_read(
    cache: Path, tmp_path: Path, make: Callable[[Path], None]
) -> None:
    library = kept(cache)
    library.unlink()
    make(library)
    child(cache, tmp_path)
    assert kept(cache).is_file()
    assert not kept(cache).is_symlink()


@pytest.fixture
def poisoned(cache: Path, tmp_path: Path) -> Callable[[Path], Path]:
    """Fills a folder with a library that leaves a mark when loaded, under every name that the kernel may have."""
    mark = tmp_path / "it_ran"
    text = f'#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fopen("{mark}", "w"); }}\n'
    poison = c_library(tmp_path / "poison.so", text + "void symcal_kernel(void) {}")
    key = kept(cache).stem.split("-")[0]

    def fill(folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        for name in (f"{key}.so", f"{key}-{hashlib.sha256(poison).hexdigest()}.so"):
            (folder / name).write_bytes(poison)
        return mark

    return fill


def test_the_poison_works(cache: Path, poisoned: Callable[[Path], Path]) -> None:
    """The witness of the tests below: in a folder of ours, and with its hash, it is loaded."""
    kept(cache).unlink()
    mark = poisoned(cache / "symcal" / "kernels")
    subprocess.run([sys.executable, "-c", CHILD], env={**os.environ, "XDG_CACHE_HOME": str(cache)}, capture_output=True)
    assert mark.exists()


@pytest.mark.parametrize(("level", "mode"), [("symcal/kernels", 0o770), ("symcal", 0o707), (".", 0o707), (".", 0o770)])
def test_a_folder_that_others_can_write_is_not_used(
    cache: Path, tmp_path: Path, poisoned: Callable[[Path], Path], level: str, mode: int
) -> None:
    mark = poisoned(cache / "symcal" / "kernels")
    (cache / level).chmod(mode)
    child(cache, tmp_path)
    assert not mark.exists()


@pytest.mark.parametrize("level", ["symcal/kernels", "symcal"])
def test_a_folder_that_is_a_link_is_not_used(tmp_path: Path, poisoned: Callable[[Path], Path], level: str) -> None:
    other, elsewhere = tmp_path / "other", tmp_path / "elsewhere"
    other.mkdir()
    mark = poisoned(elsewhere / "symcal" / "kernels")
    (other / level).parent.mkdir(exist_ok=True)
    (other / level).symlink_to(elsewhere / level)
    child(other, tmp_path)
    assert not mark.exists()


def test_a_cache_on_another_disk_may_be_linked(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir(mode=0o700)
    (tmp_path / "linked").symlink_to(tmp_path / "disk")
    child(tmp_path / "linked", tmp_path)
    assert kept(tmp_path / "disk").is_file()


@pytest.mark.parametrize("name", ["", "cache", "../cache"])
def test_a_relative_cache_is_ignored(tmp_path: Path, poisoned: Callable[[Path], Path], name: str) -> None:
    """The current folder may be anybody's."""
    there, home = tmp_path / "there", tmp_path / "home"
    there.mkdir()
    home.mkdir(mode=0o700)
    mark = poisoned(there / name / "symcal" / "kernels")
    child(name, there, HOME=str(home))
    assert not mark.exists()
    assert kept(home).is_relative_to(home / ("Library/Caches" if sys.platform == "darwin" else ".cache"))


def test_a_relative_home_is_ignored(tmp_path: Path, poisoned: Callable[[Path], Path]) -> None:
    mark = poisoned(tmp_path / "home" / ".cache" / "symcal" / "kernels")
    child("", tmp_path, HOME="home")
    assert not mark.exists()


@pytest.mark.parametrize("mode", [0o620])
def test_a_file_that_others_can_write_is_not_loaded(
    cache: Path, tmp_path: Path, poisoned: Callable[[Path], Path], mode: int
) -> None:
    kept(cache).unlink()
    mark = poisoned(cache / "symcal" / "kernels")
    for library in cache.rglob("*.so"):
        library.chmod(mode)
    child(cache, tmp_path)
    assert not mark.exists()


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
@pytest.mark.parametrize("level", ["symcal/kernels", "symcal", "file"])
def test_what_belongs_to_another_user_is_not_loaded(
    cache: Path, tmp_path: Path, poisoned: Callable[[Path], Path], level: str
) -> None:
    kept(cache).unlink()
    mark = poisoned(cache / "symcal" / "kernels")
    for path in cache.rglob("*.so") if level == "file" else [cache / level]:
        os.chown(path, 65534, 65534)
    child(cache, tmp_path)
    assert not mark.exists()


STOPPED = """
import os, sys
import casadi as ca, numpy as np
from symcal.kernels import batch_function
from symcal.kernels.own_folder import cache_folder

EVENTS = {"open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "os.listdir", "shutil.rmtree",
          "subprocess.Popen", "ctypes.dlopen", "tempfile.mkdtemp"}
x = ca.SX.sym("x", 3)
q = np.arange(27.0).reshape(9, 3)
f = batch_function(ca.Function("f", [x], [ca.sin(x) * 1.75]), backend="c")
step, ended = 0, False
while not ended:
    step += 1
    child = os.fork()
    if child == 0:
        count = 0
        def hook(event, _):
            global count
            if event in EVENTS:
                count += 1
                if count == step:
                    os._exit(77)
        sys.addaudithook(hook)
        f(q)
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in (0, 77), status
    ended = status == 0
    again = os.fork()
    if again == 0:
        np.testing.assert_allclose(f(q)[0], np.sin(q) * 1.75, rtol=1e-15)
        os._exit(0)
    assert os.waitpid(again, 0)[1] == 0, f"after a stop at step {step}"
    for file in cache_folder().glob("*.so"):
        file.unlink()
print(step)
"""


def test_a_stop_at_any_step_harms_nobody(good: Path, tmp_path: Path) -> None:
    """The compiler is one that copies what was compiled before: the steps are the same, and a hundred take a second."""
    text = f'[ "$1" = --version ] && exit 0\nwhile [ "$1" != -o ]; do shift; done\ncp {kept(good)} "$2"'
    done = subprocess.run(
        [sys.executable, "-c", STOPPED],
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path), "CC": script(tmp_path, text)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout) > 10


def test_what_a_killed_compilation_left_is_swept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    works(2.01)
    folder = own_folder.cache_folder()
    for name, age in (("buildold", 7200), ("buildnew", 60)):
        (folder / name).mkdir()
        now = (folder / name).stat().st_mtime
        os.utime(folder / name, (now - age, now - age))
    works(2.02)
    assert sorted(path.name for path in folder.glob("build*")) == ["buildnew"]


# ------------------------------------------------------------------------------- compilers, and room to compile in


def works(factor: float) -> None:
    x = ca.SX.sym("x", 2)
    f = batch_function(ca.Function("f", [x], [factor * ca.sin(x)]), backend="c")
    angles = np.linspace(-3, 3, 22).reshape(11, 2)
    np.testing.assert_allclose(f(angles)[0], factor * np.sin(angles), rtol=1e-15)


def script(folder: Path, text: str) -> str:
    path = folder / "mycc"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def alive(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    state = Path(f"/proc/{number}/stat")  # a killed process that nobody waited for still has its number
    return not state.exists() or state.read_text().rpartition(")")[2].split()[0] != "Z"


def test_a_compiler_that_hangs_is_killed_with_its_children_and_not_asked_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    calls, pids = tmp_path / "calls", tmp_path / "pids"
    text = f'[ "$1" = --version ] && exit 0\necho >> {calls}\nsleep 600 &\necho $! >> {pids}\nwait'
    monkeypatch.setenv("CC", script(tmp_path, text))
    monkeypatch.setattr(compilers, "COMPILE_TIMEOUT_S", 0.5)
    for factor in (2.1, 2.2, 2.3):
        works(factor)
    assert calls.read_text().count("\n") == 1
    (pid,) = map(int, pids.read_text().split())
    assert not alive(pid)
    assert [r.levelno for r in caplog.records if "did not finish" in r.message] == [logging.WARNING]


def test_a_compiler_that_does_not_tell_its_version(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", script(tmp_path, "exec sleep 600"))
    monkeypatch.setattr(compilers, "VERSION_TIMEOUT_S", 0.3)
    assert find_compiler() is None
    works(2.4)


def test_a_compiler_that_reads_or_talks_without_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("CC", script(tmp_path, '[ "$1" = --version ] || exec cat\nexec yes'))
    monkeypatch.setattr(compilers, "VERSION_TIMEOUT_S", 0.5)
    works(2.5)
    monkeypatch.setenv("CC", script(tmp_path, '[ "$1" = --version ] && exit\nexec cat') + " -x")
    works(2.6)


@pytest.mark.parametrize("text", ['gcc "-O2', "gcc 'a", "gcc \\"])
def test_a_cc_variable_with_an_odd_quote(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, text: str
) -> None:
    compilers._find_compiler.cache_clear()
    monkeypatch.setenv("CC", text)
    for factor in (2.7, 2.8):
        works(factor)
    assert [r.levelno for r in caplog.records if "CC variable" in r.message] == [logging.WARNING]


@pytest.mark.parametrize("text", ["''", '"" -O2', "/", "gcc\udcff"])
def test_a_cc_variable_without_a_program(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("CC", text)
    assert find_compiler() is None
    works(2.9)


def test_a_compiler_that_writes_a_library_without_the_function(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    real = find_compiler().command[0]
    empty = tmp_path / "empty.c"
    empty.write_text("int nothing_here;")
    text = f'[ "$1" = --version ] && exit 0\nwhile [ "$1" != -o ]; do shift; done\n{real} -shared -fPIC -o "$2" {empty}'
    monkeypatch.setenv("CC", script(tmp_path, text))
    works(3.0)
    assert "has no function symcal_kernel" in caplog.text


def test_a_full_or_missing_tmpdir_does_not_matter_beside_a_good_cache(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("TMPDIR", "/proc/nowhere")
    works(3.1)
    assert kept(tmp_path).is_file()
    assert not caplog.records


def test_no_room_at_all(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    def full(*_: object, **__: object) -> str:
        raise OSError(28, "No space left on device")

    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr(tempfile, "mkdtemp", full)
    own_folder.private_folder.cache_clear()
    compiling._warn_once.cache_clear()
    for factor in (3.2, 3.3):
        works(factor)
    assert [r.levelno for r in caplog.records if "no folder to compile in" in r.message] == [logging.WARNING]
    own_folder.private_folder.cache_clear()


def test_a_disk_that_fills_while_compiling(tmp_path: Path) -> None:
    """No file may grow beyond 1 kB: neither source nor library can be written, in any folder."""
    limited = "import resource, signal\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    limited += "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n" + CHILD
    done = subprocess.run(
        [sys.executable, "-c", limited],
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert done.stderr.count("kernels run without C") == 1


def test_why_the_cache_is_not_used_is_said_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    (tmp_path / "symcal").mkdir(mode=0o700)
    (tmp_path / "symcal").chmod(0o777)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    caplog.set_level(logging.INFO, "symcal.kernels")
    for factor in (3.4, 3.5):
        works(factor)
    assert [r.levelno for r in caplog.records if "others can write in" in r.message] == [logging.INFO]
    assert not list(tmp_path.rglob("*.so"))
