#include "openmmrigidhi/Version.h"

#include <dlfcn.h>
#include <openmm/Platform.h>

using namespace std;

namespace RigidHIPlugin {

namespace {

/** The first two numbers of a version. */
string majorMinor(const string& version) {
    const size_t major = version.find('.');
    const size_t minor =
        version.find_first_not_of("0123456789", major == string::npos ? major : major + 1);
    return version.substr(0, minor);
}

}  // namespace

string getVersion() { return RIGIDHI_VERSION; }

string getOpenMMVersionOfBuild() { return RIGIDHI_OPENMM_VERSION; }

string getLibraryPath() {
    Dl_info place;
    return dladdr(reinterpret_cast<const void*>(&getVersion), &place) != 0 && place.dli_fname
               ? place.dli_fname
               : "";
}

string versionConflict(const string& library, const string& version, const string& openMMVersion) {
    const string loaded = OpenMM::Platform::getOpenMMVersion();
    if (majorMinor(loaded) != openMMVersion)
        return library + ": it was compiled for OpenMM " + openMMVersion +
               ", but the loaded OpenMM has version " + loaded +
               "; a plugin works only with the version of OpenMM that it was compiled for: build "
               "openmm-rigidhi against the loaded OpenMM, or install the other version of OpenMM";
    if (version != getVersion() || openMMVersion != getOpenMMVersionOfBuild())
        return library + ": it is version " + version + " for OpenMM " + openMMVersion + ", and " +
               getLibraryPath() + ", which was loaded before it, is version " + getVersion() +
               " for OpenMM " + getOpenMMVersionOfBuild() +
               "; this process mixes two copies of openmm-rigidhi: remove one of them, or let the "
               "search paths of libraries contain only one";
    return "";
}

}  // namespace RigidHIPlugin
