"""Build hook: compile the C kernel with the compiler that comes as the wheel ``ziglang``.

An editable or plain install compiles the machine's own target; ``AEROMATCH_TARGETS=all`` compiles every target that an
FMU can carry.  Run as a script it compiles in place: ``python hatch_build.py``.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent
OUT = ROOT / "flightmech" / "_binaries"

# folder (FMI 3.0 platform tuple): zig target, file name
TARGETS = {
    "x86_64-linux": ("x86_64-linux-gnu.2.17", "aeromatch_kernel.so"),
    "aarch64-linux": ("aarch64-linux-gnu.2.17", "aeromatch_kernel.so"),
    "x86_64-windows": ("x86_64-windows-gnu", "aeromatch_kernel.dll"),
    "x86_64-darwin": ("x86_64-macos", "aeromatch_kernel.dylib"),
    "aarch64-darwin": ("aarch64-macos", "aeromatch_kernel.dylib"),
}
# no contraction, no fast-math: library and FMU must agree bit for bit
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-sanitize=all", "-fvisibility=hidden", "-Wall", "-Wextra", "-shared", "-s"]


def native() -> str:
    """Return the platform folder of this machine."""
    machine = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}.get(platform.machine().lower(), "")
    name = f"{machine}-{platform.system().lower()}"
    if name not in TARGETS:
        raise SystemExit(f"no kernel target for {platform.machine()} {platform.system()}; known: {', '.join(TARGETS)}")
    return name


def compile_kernel(name: str) -> Path:
    """Compile the shared library for one platform folder and return its path."""
    target, file = TARGETS[name]
    sources = sorted(map(str, [*(ROOT / "kernel" / "src").glob("*.c"), *(ROOT / "kernel" / "shell").glob("*.c")]))
    include = [f"-I{ROOT / 'kernel' / folder}" for folder in ("include", "src", "shell")]
    (OUT / name).mkdir(parents=True, exist_ok=True)
    library = OUT / name / file
    position = [] if "windows" in name else ["-fPIC"]
    libm = ["-lm"] if "linux" in name else []
    partial = library.with_suffix(".partial")
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target, *FLAGS, *position, *include, *sources, *libm, "-o", str(partial)]
    subprocess.run(command, check=True)
    os.replace(partial, library)
    return library


def compile_all() -> None:
    """Compile this machine's target, or every target when ``AEROMATCH_TARGETS`` is ``all``."""
    for name in TARGETS if os.environ.get("AEROMATCH_TARGETS") == "all" else [native()]:
        compile_kernel(name)


try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ImportError:  # run as a script
    pass
else:

    class KernelBuildHook(BuildHookInterface):
        """Compiles the kernel before the wheel is assembled."""

        def initialize(self, version: str, build_data: dict) -> None:
            """Compile and add the libraries to the wheel."""
            compile_all()
            build_data["artifacts"].append("flightmech/_binaries/**")
            if os.environ.get("AEROMATCH_TARGETS") != "all":
                build_data["infer_tag"] = False
                build_data["pure_python"] = False


if __name__ == "__main__":
    compile_all()
