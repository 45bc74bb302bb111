"""Run the exported C under emulators of the processors that it is for, and count what it costs there.

    python tests/export/cross.py [--require]

For every target whose compiler and emulator are installed: the exported self-test of several robots must pass, and for
the handling robot and an arm with joint terms instructions per call, code bytes and stack are measured; the budgets are
the handling robot's. Targets that are not installed are named,
and are an error only with --require. Exit code 0 if all that ran is well and inside the budgets, else 1.

Debian: apt-get install --no-install-recommends gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
        gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))  # run as a script: the tests' own folder
from arms_with_terms import puma_with_terms
from c_robots import arm, handling

from symcal.export.c import CExport, export_c

BOARD = Path(__file__).resolve().parent / "board"
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
FUNCTIONS = ("forward", "jacobian", "compensate")
MEASURED = ("handling_robot", "puma_with_terms")
CALLS = 24  # one for each test vector
DOUBLE_HELPERS = re.compile(r"__aeabi_(?:d|cd|f2d|i2d|ui2d|l2d)\w*|(?:sin|cos|sqrt|atan2|fmin|fmax)")


@dataclass(frozen=True)
class Target:
    name: str
    tools: str  # what the compiler's relatives start with
    flags: tuple[str, ...]
    link: tuple[str, ...]
    emulator: tuple[str, ...]
    system: bool  # a whole board, or a process
    single: bool
    budget: dict[str, int]  # instructions, and bytes of stack
    sources: tuple[str, ...] = ()

    @property
    def missing(self) -> str | None:
        """The first program that is not installed."""
        needed = (f"{self.tools}gcc", f"{self.tools}size", f"{self.tools}nm", self.emulator[0])
        return next((program for program in needed if shutil.which(program) is None), None)


def cortex(name: str, cpu: tuple[str, ...], board: str, single: bool, budget: dict[str, int]) -> Target:
    return Target(
        name=name,
        tools="arm-none-eabi-",
        flags=(*cpu, "-mthumb", "-mfloat-abi=hard"),
        link=("-T", str(BOARD / "mps2.ld"), "--specs=rdimon.specs", "-Wl,--gc-sections"),
        emulator=("qemu-system-arm", "-M", board, "-nographic", "-semihosting-config", "enable=on,target=native"),
        system=True,
        single=single,
        budget=budget,
        sources=(str(BOARD / "startup.c"),),
    )


TARGETS = (
    cortex(
        "Cortex-M4F float",
        ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"),
        "mps2-an386",
        True,
        {"forward": 700, "compensate": 4000, "stack": 512},
    ),
    cortex("Cortex-M7 double", ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"), "mps2-an500", False, {}),
    Target(
        name="aarch64 double",
        tools="aarch64-linux-gnu-",
        flags=(),
        link=("-static",),
        emulator=("qemu-aarch64",),
        system=False,
        single=False,
        budget={},
    ),
)


def say(text: str) -> None:
    sys.stdout.write(text + "\n")


class Failed(Exception):
    """A target did not do what it must; the message says what."""


def run(*command: object, timeout: float = 60.0) -> str:
    done = subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, errors="replace", timeout=timeout, check=False
    )
    if done.returncode != 0:
        raise Failed(f"{' '.join(str(c) for c in command[:1])} failed ({done.returncode}):\n{done.stdout}{done.stderr}")
    return done.stdout


class Build:
    """One export built for one target in a folder of its own."""

    def __init__(self, target: Target, export: CExport, folder: Path) -> None:
        self.target, self.export, self.folder = target, export, folder
        folder.mkdir()
        define = ["-DSYMCAL_FLOAT"] if target.single else []
        # sections let the linker drop what is not called, and show the size of each function
        self.flags = ["-std=c99", "-O2", "-ffunction-sections", *define, *target.flags]
        self.include = [f"-I{export.folder}", f"-I{export.folder / 'test'}"]
        self.library = folder / "kinematics.o"
        source = export.folder / f"{export.prefix}_kinematics.c"
        self._compiler("-c", *WARNINGS, "-fstack-usage", source, "-o", self.library)

    def _compiler(self, *arguments: object) -> None:
        run(f"{self.target.tools}gcc", *self.flags, *self.include, *arguments)

    def program(self, name: str, *arguments: object) -> Path:
        path = self.folder / name
        self._compiler(*arguments, self.library, *self.target.sources, *self.target.link, "-o", path, "-lm")
        return path

    def emulate(self, program: Path, *options: str) -> str:
        end = ("-kernel", program) if self.target.system else (program,)
        return run(*self.target.emulator, *options, *end)

    def self_test(self) -> None:
        output = self.emulate(self.program("selftest", *WARNINGS, self.export.folder / "test" / "selftest.c"))
        if "self-test passed" not in output:
            raise Failed(output)

    def bench(self, function: str, calls: int) -> Path:
        (self.folder / "kinematics.h").write_text(f'#include "{self.export.prefix}_kinematics.h"\n')
        defines = [f"-DPREFIX={self.export.prefix}", f"-DFUNCTION={function}", f"-DCALLS={calls}"]
        return self.program("bench", f"-I{self.folder}", *defines, BOARD / "bench.c")

    def instructions(self, function: str) -> float:
        """Mean number per call over the test vectors, libm and the call itself included."""
        log = self.folder / "log"
        counts = []
        for calls in (0, CALLS):
            step = single_stepping(self.target)
            self.emulate(self.bench(function, calls), *step, "-d", "exec,nochain", "-D", str(log))
            with log.open(encoding="utf-8", errors="replace") as lines:
                counts.append(sum(line.startswith("Trace") for line in lines))
        return (counts[1] - counts[0]) / CALLS

    def stack(self, function: str) -> int:
        """Bytes of stack that a call writes to at its deepest, libm included."""
        return int(self.emulate(self.bench(function, -1)).split()[-1])

    def frames(self) -> dict[str, int]:
        """Bytes of stack of each function by itself, as the compiler states them."""
        rows = (line.split("\t") for line in self.library.with_suffix(".su").read_text().splitlines())
        return {row[0].rpartition(":")[2]: int(row[1]) for row in rows}

    def code_bytes(self, function: str) -> int:
        """Machine code of a public function with the static ones that it may call."""
        text = run(f"{self.target.tools}size", "-A", self.library)
        sections = {n: int(s) for n, s in re.findall(r"^\.text\.(\S+)\s+(\d+)", text, re.MULTILINE)}
        end = "_f" if self.target.single else ""
        helpers = {n: s for n, s in sections.items() if not n.startswith(f"{self.export.prefix}_")}
        own = sections[f"{self.export.prefix}_{function}{end}"]
        kind = ("_with", "_pose") if function == "compensate" else ()
        used = (s for n, s in helpers.items() if function == "compensate" and not any(k in n for k in kind))
        return own + sum(used)

    def doubles(self) -> set[str]:
        """Functions of double precision that the object asks for."""
        undefined = {line.split()[-1] for line in run(f"{self.target.tools}nm", "-u", self.library).splitlines()}
        return {name for name in undefined if DOUBLE_HELPERS.fullmatch(name)}


def single_stepping(target: Target) -> tuple[str, ...]:
    """The options with which this emulator logs every instruction on its own; their names changed in QEMU 8.1."""
    text = run(target.emulator[0], "--help")
    if "one-insn-per-tb" not in text:
        return ("-singlestep",)
    return ("-accel", "tcg,one-insn-per-tb=on") if target.system else ("-one-insn-per-tb",)


def measure(target: Target, exports: dict[str, CExport], folder: Path) -> list[str]:
    """Self-tests of all exports and the figures of some; what is outside the first one's budget, in words."""
    wrong: list[str] = []
    for name, export in exports.items():
        build = Build(target, export, folder / f"{target.name.replace(' ', '_')}_{name}")
        build.self_test()
        say(f"{target.name:18} {name:16} self-test passed")
        if name in MEASURED:
            wrong += figures(target, build, target.budget if name == MEASURED[0] else {})
    return wrong


def figures(target: Target, build: Build, budget: dict[str, int]) -> list[str]:
    """Says instructions, bytes of code and stack of one export; what is outside the budget, in words."""
    wrong = [f"{target.name}: calls {name} in single precision" for name in build.doubles() if target.single]
    end = "_f" if target.single else ""
    deepest = 0
    for function in FUNCTIONS:
        count, stack = build.instructions(function), build.stack(function)
        frame = build.frames()[f"{build.export.prefix}_{function}{end}"]
        deepest = max(deepest, stack, frame)
        say(
            f"{target.name:18} {build.export.prefix:16} {function:10} {count:7.0f} instructions"
            f" {build.code_bytes(function):6d} bytes of code {frame:4d} bytes of frame {stack:4d} bytes of stack in all"
        )
        if count > budget.get(function, count):
            wrong.append(f"{target.name}: {function} takes {count:.0f} instructions, {budget[function]} allowed")
    if deepest > budget.get("stack", deepest):
        wrong.append(f"{target.name}: {deepest} bytes of stack, {budget['stack']} allowed")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--require", action="store_true", help="targets that are not installed are an error")
    options = parser.parse_args()
    wrong: list[str] = []
    with tempfile.TemporaryDirectory(prefix="cross") as scratch:
        folder = Path(scratch)
        robots = {
            "handling_robot": handling(),
            "franka_fr3": arm("franka_fr3"),
            "tiago": arm("tiago"),
            "puma_with_terms": puma_with_terms(),
        }
        exports = {name: export_c(robot, folder / name) for name, robot in robots.items()}
        for target in TARGETS:
            if target.missing:
                say(f"{target.name:18} not run: {target.missing} is not installed")
                wrong += [f"{target.name}: {target.missing} is not installed"] if options.require else []
                continue
            try:
                wrong += measure(target, exports, folder)
            except (Failed, subprocess.TimeoutExpired) as error:
                wrong.append(f"{target.name}: {error}")
    for line in wrong:
        sys.stderr.write(line + "\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
