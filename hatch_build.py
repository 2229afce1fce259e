"""Build hook: compile the C kernel with the compiler that comes as the wheel ``ziglang``.

Two libraries are made of its sources: the one that Python loads, and the smaller one that an FMU
carries.
An editable or plain install compiles the machine's own target and gives a wheel of that platform;
``AEROMATCH_TARGETS=all`` compiles every target that an FMU can carry and gives a wheel for all of
them (``py3-none-any``);
``AEROMATCH_TARGETS=x86_64-windows`` gives the wheel of that platform.
Run as a script it compiles in place: ``python hatch_build.py``.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent
OUT = ROOT / "flightmech" / "_binaries"


class Target(NamedTuple):
    """One platform: zig target, ending of its libraries, platform tag of a wheel that carries the
    libraries of this one only.
    """

    zig: str
    suffix: str
    tag: str


class Library(NamedTuple):
    """One library: folders and files below ``kernel`` that it is made without, and options of its
    own.
    """

    without: tuple[str, ...]
    options: tuple[str, ...]


# folder (FMI 3.0 platform tuple): target; the oldest system named in the zig target is the one in
# the tag
TARGETS = {
    "x86_64-linux": Target("x86_64-linux-gnu.2.17", ".so", "manylinux_2_17_x86_64"),
    "aarch64-linux": Target("aarch64-linux-gnu.2.17", ".so", "manylinux_2_17_aarch64"),
    "x86_64-windows": Target("x86_64-windows-gnu", ".dll", "win_amd64"),
    "x86_64-darwin": Target("x86_64-macos.11.0", ".dylib", "macosx_11_0_x86_64"),
    "aarch64-darwin": Target("aarch64-macos.11.0", ".dylib", "macosx_11_0_arm64"),
}
# What FMI cannot reach is left out of an FMU: runs side by side and the numerics of estimation as
# folders, the rest of the Python interface (am_*) by AM_FMU, which exports none of it, so that the
# linker drops it.  Python does not use the FMI shell.
LIBRARIES = {
    "aeromatch_kernel": Library(("shell",), ()),
    "aeromatch_fmu": Library(("src/lanes", "src/estimation", "src/runs/batch.c"), ("-DAM_FMU",)),
}
# no contraction, no fast-math: library and FMU must agree bit for bit.  No vectors but those
# written as such: what has just
# been stored number by number and is then loaded as a vector waits for the memory; steps are 5 %
# faster without them.
EXACT = ["-ffp-contract=off", "-fno-math-errno", "-fno-vectorize", "-fno-slp-vectorize"]
FLAGS = [
    "-std=c11",
    "-O2",
    *EXACT,
    "-fno-sanitize=all",
    "-fvisibility=hidden",
    "-ffunction-sections",
    "-fdata-sections",
    "-Wall",
    "-Wextra",
    "-shared",
    "-s",
]


def native() -> str:
    """Return the platform folder of this machine."""
    machine = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}.get(
        platform.machine().lower(), ""
    )
    name = f"{machine}-{platform.system().lower()}"
    if name not in TARGETS:
        raise SystemExit(
            f"no kernel target for {platform.machine()} {platform.system()}; known: "
            f"{', '.join(TARGETS)}"
        )
    return name


def wanted() -> list[str]:
    """Return the platform folders that ``AEROMATCH_TARGETS`` names: ``native`` (default), ``all``
    or one platform.
    """
    choice = os.environ.get("AEROMATCH_TARGETS", "native")
    if choice in TARGETS:
        return [choice]
    if choice not in ("native", "all"):
        raise SystemExit(
            f"AEROMATCH_TARGETS is {choice!r}; allowed: native, all, {', '.join(TARGETS)}"
        )
    return list(TARGETS) if choice == "all" else [native()]


def kernel_sources(without: tuple[str, ...] = ()) -> tuple[list[str], list[str]]:
    """Return the C sources of the kernel and its FMI shell, but for folders and files that are left
    out, and the options that name the folders of all headers.
    """
    kernel = ROOT / "kernel"
    inner = sorted(path for path in (kernel / "src").iterdir() if path.is_dir())
    folders = [kernel / "include", *inner, kernel / "shell"]
    left_out = {kernel / name for name in without}
    sources = [
        str(source)
        for folder in folders
        for source in sorted(folder.glob("*.c"))
        if folder not in left_out and source not in left_out
    ]
    return sources, [f"-I{folder}" for folder in folders]


def compile_library(name: str, library: str) -> Path:
    """Compile one library for one platform folder and return its path."""
    target, made = TARGETS[name], LIBRARIES[library]
    sources, include = kernel_sources(made.without)
    if not sources:
        raise SystemExit(
            f"no C sources under {ROOT / 'kernel'}; build from a whole checkout or source archive"
        )
    file = library + target.suffix
    system = name.split("-")[1]
    linking = {
        "linux": ["-fPIC", "-Wl,--gc-sections", "-lm"],
        "darwin": ["-fPIC", "-Wl,-x", "-Wl,-dead_strip", f"-Wl,-install_name,@rpath/{file}"],
        "windows": ["-Wl,--gc-sections"],
    }[system]
    path = OUT / name / file
    path.parent.mkdir(parents=True, exist_ok=True)
    # a folder of its own: the linker leaves other files next to a Windows library, and two builds
    # may run at once
    with tempfile.TemporaryDirectory(dir=OUT) as folder:
        output = Path(folder) / file
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", target.zig]
        command = [*compiler, *FLAGS, *made.options, *include, *sources, *linking]
        if subprocess.run([*command, "-o", str(output)]).returncode:
            raise SystemExit(
                f"{library} did not compile for {name}; the compiler's messages stand above"
            )
        os.replace(output, path)
    return path


def build() -> list[Path]:
    """Compile what is wanted and return the libraries, those of one platform after the other;
    others are removed, since an FMU must not carry kernels of two builds.

    The compiler keeps what it has made: all targets take minutes the first time, a second when no
    source has changed.
    """
    names = wanted()
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        made = [
            pool.submit(compile_library, name, library) for name in names for library in LIBRARIES
        ]
        libraries = [one.result() for one in made]
    for folder in OUT.iterdir():
        if folder.name in TARGETS and folder.name not in names:
            shutil.rmtree(folder)
    return libraries


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run as a script
    pass
else:

    class KernelBuildHook(BuildHookInterface):
        """Compiles the kernel before the wheel is assembled."""

        def initialize(self, version: str, build_data: dict) -> None:
            """Compile, add the libraries to the wheel and name its platform."""
            libraries = build()
            build_data["artifacts"] += [
                f"/{library.relative_to(ROOT).as_posix()}" for library in libraries
            ]
            platforms = {library.parent.name for library in libraries}
            if len(platforms) == 1:
                build_data["tag"] = f"py3-none-{TARGETS[platforms.pop()].tag}"
                build_data["pure_python"] = False


if __name__ == "__main__":
    build()
