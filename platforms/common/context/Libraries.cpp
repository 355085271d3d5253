#include "context/Libraries.h"

#include <fftw3.h>
#include <hwy/highway.h>
#include <muParser.h>

#include <Eigen/Core>
#include <sstream>

#include "host/SimdBodyLoops.h"

extern "C" char* openblas_get_config(void);
extern "C" char* openblas_get_corename(void);

using namespace std;

namespace RigidHIPlugin {

string describeLibraries() {
    ostringstream text;
    text << "instruction set: " << simdTargetName() << "; compiler: " << __VERSION__ << "\n"
         << "Eigen " << EIGEN_WORLD_VERSION << "." << EIGEN_MAJOR_VERSION << "."
         << EIGEN_MINOR_VERSION << "; " << openblas_get_config() << "; " << fftw_version
         << "; Highway " << HWY_MAJOR << "." << HWY_MINOR << "." << HWY_PATCH << "; muParser "
         << mu::ParserVersion;
    return text.str();
}

string adviceOnLinearAlgebra() {
#if defined(__x86_64__)
    const string kernels = openblas_get_corename();
    for (const char* old :
         {"Prescott", "Core2", "Penryn", "Dunnington", "Atom", "Nehalem", "Generic"})
        if (kernels == old && __builtin_cpu_supports("avx2"))
            return "OpenBLAS takes its kernels for " + kernels +
                   ", which leave out this processor's AVX2, so that dense matrices take about "
                   "twice the time; set the environment variable OPENBLAS_CORETYPE to Haswell "
                   "before the program starts, or install a newer OpenBLAS";
#endif
    return "";
}

}  // namespace RigidHIPlugin
