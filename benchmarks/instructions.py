"""Keep a benchmark from AVX-512, to time on one machine what others without it would take."""
import ctypes
import os
import sys

HELP = 'keep all programs from AVX-512, where the machine has it'
#: Processes read it when they start, as run.py --avx2 wants.
VARIABLE = 'RIGIDHI_BENCHMARKS_AVX2'
#: OpenBLAS and numba read these when they are loaded.
ENVIRONMENT = {
    VARIABLE: '1',
    'OPENBLAS_CORETYPE': 'Haswell',
    'NUMBA_CPU_NAME': 'haswell',
    'NUMBA_CPU_FEATURES': '+sse4.2,+popcnt,+avx,+avx2,+fma,+f16c,+bmi,+bmi2,+lzcnt'
}


def keptToAvx2():
    return '--avx2' in sys.argv or VARIABLE in os.environ


def keepToAvx2IfAsked():
    """With --avx2 this process, and the ones it starts, use nothing beyond AVX2 but in FFTW.

    OpenBLAS and numba read the environment when they are loaded, so this comes before numpy.
    """
    if not keptToAvx2():
        return
    os.environ.update(ENVIRONMENT)
    # Highway: hwy::DisableTargets, whose better instruction sets have lower bits (AVX2 has 9).
    disable = ctypes.CDLL('libhwy.so.1')['_ZN3hwy14DisableTargetsEl']
    disable.argtypes = [ctypes.c_int64]
    disable((1 << 9) - 1)
