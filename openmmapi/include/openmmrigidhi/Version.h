#ifndef RIGIDHI_VERSION_H_
#define RIGIDHI_VERSION_H_

#include <string>

#include "openmmrigidhi/internal/windowsExport.h"

namespace RigidHIPlugin {

/** The version of libOpenMMRigidHI that is loaded, for example "0.1.0". */
OPENMM_EXPORT_RIGIDHI std::string getVersion();

/** The version of OpenMM (major.minor) that libOpenMMRigidHI was compiled for, for example "7.7".
 */
OPENMM_EXPORT_RIGIDHI std::string getOpenMMVersionOfBuild();

/** The file that libOpenMMRigidHI was loaded from. */
OPENMM_EXPORT_RIGIDHI std::string getLibraryPath();

/**
 * The reason why the loaded libraries cannot work together. Either OpenMM has another version than
 * the one that libOpenMMRigidHI was compiled for, or a library of this plugin has another version
 * than libOpenMMRigidHI.
 *
 * @param library         name of the library that asks
 * @param version         its version
 * @param openMMVersion   version of OpenMM (major.minor) that it was compiled for
 * @return the reason and the remedy, or an empty text without a conflict
 */
OPENMM_EXPORT_RIGIDHI std::string versionConflict(const std::string& library,
                                                  const std::string& version,
                                                  const std::string& openMMVersion);

}  // namespace RigidHIPlugin

#endif
