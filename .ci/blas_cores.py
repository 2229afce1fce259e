"""Print the kernels of OpenBLAS that this processor runs, a line each, without the one that
OpenBLAS selects by itself.
"""

import platform
from pathlib import Path

import numpy  # noqa: F401  # loads OpenBLAS
import threadpoolctl

# kernel: the flag of /proc/cpuinfo that it needs, the most different kernels first
KERNELS = {
    "x86_64": {"Haswell": "avx2", "SkylakeX": "avx512vl", "Sandybridge": "avx"},
    "aarch64": {"ARMV8": "asimd", "NEOVERSEN1": "asimddp"},
}
flags = (
    set(Path("/proc/cpuinfo").read_text(encoding="utf-8").split())
    if Path("/proc/cpuinfo").exists()
    else set()
)
selected = {library.get("architecture", "").lower() for library in threadpoolctl.threadpool_info()}
for kernel, flag in KERNELS.get(platform.machine(), {}).items():
    if flag in flags and kernel.lower() not in selected:
        print(kernel)
