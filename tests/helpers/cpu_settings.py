"""The suite as other processors would run it: `make test-cpus`, or ``python -m tests.helpers.cpu_settings [WORDS]``.

Libraries choose their machine code by what the processor has, and each has a variable to have less. What a processor
lacks cannot be had this way: the settings stand for older machines than the one they run on.
"""

import os
import subprocess
import sys

OLD = {
    "ATEN_CPU_CAPABILITY": "default",  # PyTorch's own kernels: SSE
    "ONEDNN_MAX_CPU_ISA": "SSE41",  # its convolutions
    "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",  # its matrix products
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Prescott",  # NumPy's and SciPy's matrix products
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
}
SETTINGS = {
    "old": OLD | {"OMP_NUM_THREADS": "1"},
    "avx2": {"ATEN_CPU_CAPABILITY": "avx2", "ONEDNN_MAX_CPU_ISA": "AVX2", "MKL_ENABLE_INSTRUCTIONS": "AVX2"}
    | {"OPENBLAS_CORETYPE": "Haswell", "OMP_NUM_THREADS": "2"},
    "mixed": {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "AVX2", "OMP_NUM_THREADS": "2"},
    "no-fma": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX2_Usable,-FMA_Usable"},  # the C library
}
"""Name of a setting and its environment variables."""


def main(arguments: list[str]) -> int:
    """Run pytest under each setting; returns 1 if one of them fails."""
    failed = []
    for name, setting in SETTINGS.items():
        print(f"== {name}: {' '.join(f'{key}={value!r}' for key, value in setting.items())}", flush=True)
        done = subprocess.run([sys.executable, "-m", "pytest", *arguments], env=os.environ | setting, check=False)
        failed += [name] if done.returncode else []
    print(f"== fails under {', '.join(failed)}" if failed else "== passes under all settings")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or ["-m", "not slow", "-n", "2"]))
