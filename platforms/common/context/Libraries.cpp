#include "context/Libraries.h"

#include <fftw3.h>
#include <hwy/highway.h>
#include <muParser.h>

#include <Eigen/Core>
#include <sstream>

#include "host/SimdBodyLoops.h"

extern "C" char* openblas_get_config(void);

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

}  // namespace RigidHIPlugin
