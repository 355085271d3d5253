# What is installed where. Two layouts (RIGIDHI_INSTALL_LAYOUT):
#   package  all libraries in the Python package, which finds them by itself; a link lib/openmmrigidhi for C++ programs. For a prefix of one's own.
#   system   libraries where OpenMM's own are: libOpenMMRigidHI.so in <libdir>/openmm, the platforms' libraries in <libdir>/openmm/plugins, from where
#            OpenMM loads them by itself. For packages of a distribution, and for a prefix that OpenMM is in.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(RIGIDHI_INSTALL_LAYOUT package CACHE STRING "Where libraries are installed: package (in the Python package) or system (beside OpenMM's)")
set_property(CACHE RIGIDHI_INSTALL_LAYOUT PROPERTY STRINGS package system)
if(NOT RIGIDHI_INSTALL_LAYOUT MATCHES "^(package|system)$")
    message(FATAL_ERROR "RIGIDHI_INSTALL_LAYOUT: got '${RIGIDHI_INSTALL_LAYOUT}'; it must be package or system")
endif()

# The package goes below the prefix, where a Python of this version looks if the prefix is its own or a virtual environment's;
# Debian's Python looks into dist-packages below /usr/local.
if(RIGIDHI_BUILD_PYTHON)
    set(PYTHON_DIRECTORY lib/python${RIGIDHI_PYTHON_VERSION})
    if(EXISTS /etc/debian_version AND CMAKE_INSTALL_PREFIX STREQUAL "/usr/local")
        set(PACKAGES_DIRECTORY ${PYTHON_DIRECTORY}/dist-packages)
    else()
        set(PACKAGES_DIRECTORY ${PYTHON_DIRECTORY}/site-packages)
    endif()
    if(RIGIDHI_PYTHON_INSTALL_DIR MATCHES "^lib/python\\./")
        unset(RIGIDHI_PYTHON_INSTALL_DIR CACHE) # of a build directory from when the version was lost
    endif()
    set(RIGIDHI_PYTHON_INSTALL_DIR ${PACKAGES_DIRECTORY}
        CACHE STRING "Where 'make install' puts the package openmmrigidhi, relative to the prefix")
    set(PACKAGE_DIR ${RIGIDHI_PYTHON_INSTALL_DIR}/openmmrigidhi)
elseif(RIGIDHI_INSTALL_LAYOUT STREQUAL package)
    message(STATUS "Without the Python package the layout of an installation is 'system'")
endif()
if(RIGIDHI_INSTALL_LAYOUT STREQUAL system OR NOT RIGIDHI_BUILD_PYTHON)
    set(API_DIR ${CMAKE_INSTALL_LIBDIR}/openmm)
else()
    set(API_DIR ${PACKAGE_DIR}/lib)
endif()

# A wheel goes to other machines, so its libraries name no directory of this one. Where OpenMM is in the environment of the Python that builds
# the wheel, they look there, relative to themselves. Elsewhere they take the OpenMM that Python has loaded when it imports them.
if(SKBUILD)
    # packaging/openmm_series.py has told the wheel's metadata which OpenMM it needs, and does not see CMake's variables.
    if(NOT OPENMM_DIR STREQUAL "$ENV{OPENMM_DIR}")
        message(FATAL_ERROR "OPENMM_DIR: got '${OPENMM_DIR}' as a variable of CMake and '$ENV{OPENMM_DIR}' in the environment; for a wheel it must be "
                            "an environment variable: OPENMM_DIR=prefix pip wheel .")
    endif()
    execute_process(COMMAND ${Python3_EXECUTABLE} -c "import sysconfig; print(sysconfig.get_path('data')); print(sysconfig.get_path('platlib'))"
                    OUTPUT_VARIABLE PYTHON_PATHS OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
    string(REPLACE "\n" ";" PYTHON_PATHS "${PYTHON_PATHS}")
    list(GET PYTHON_PATHS 0 PYTHON_PREFIX)
    list(GET PYTHON_PATHS 1 PYTHON_PACKAGES)
endif()

# Libraries of installed targets look in a directory, too.
function(rigidhi_also_look_in directory)
    if(NOT SKBUILD)
        set_property(TARGET ${ARGN} APPEND PROPERTY INSTALL_RPATH ${directory})
        return()
    endif()
    string(FIND ${directory}/ ${PYTHON_PREFIX}/ position)
    if(NOT position EQUAL 0)
        return()
    endif()
    foreach(target ${ARGN})
        set(place ${PYTHON_PACKAGES}/openmmrigidhi/lib)
        if(NOT target STREQUAL OpenMMRigidHI)
            string(APPEND place /plugins)
        endif()
        file(RELATIVE_PATH path ${place} ${directory})
        set_property(TARGET ${target} APPEND PROPERTY INSTALL_RPATH $ORIGIN/${path})
    endforeach()
endfunction()

set(PLATFORM_LIBRARIES OpenMMRigidHIReference OpenMMRigidHICPU OpenMMRigidHIAny)
foreach(platform ${RIGIDHI_DEVICE_PLATFORMS})
    list(APPEND PLATFORM_LIBRARIES OpenMMRigidHI${platform})
endforeach()
install(TARGETS OpenMMRigidHI EXPORT OpenMMRigidHI LIBRARY DESTINATION ${API_DIR} COMPONENT libraries)
install(TARGETS ${PLATFORM_LIBRARIES} LIBRARY DESTINATION ${API_DIR}/plugins COMPONENT libraries)
# Below a prefix of its own OpenMM is not where the system's loader looks.
get_filename_component(OPENMM_LIBRARY_DIRECTORY ${OPENMM_LIBRARY} DIRECTORY)
if(NOT OPENMM_LIBRARY_DIRECTORY IN_LIST CMAKE_CXX_IMPLICIT_LINK_DIRECTORIES)
    rigidhi_also_look_in(${OPENMM_LIBRARY_DIRECTORY} OpenMMRigidHI ${PLATFORM_LIBRARIES})
endif()
foreach(platform ${RIGIDHI_DEVICE_PLATFORMS})
    get_filename_component(DIRECTORY ${OPENMM_${platform}_LIBRARY} DIRECTORY)
    # In a package of the system the library lies beside OpenMM's. Debian's policy is against names of directories in libraries.
    if(DIRECTORY STREQUAL ${CMAKE_INSTALL_PREFIX}/${API_DIR}/plugins)
        set(DIRECTORY $ORIGIN)
    endif()
    rigidhi_also_look_in(${DIRECTORY} OpenMMRigidHI${platform})
endforeach()

if(RIGIDHI_BUILD_PYTHON)
    install(DIRECTORY python/openmmrigidhi/ DESTINATION ${PACKAGE_DIR} COMPONENT python
            FILES_MATCHING PATTERN "*.py" PATTERN "*.html" PATTERN "py.typed" PATTERN "__pycache__" EXCLUDE)
    install(FILES ${RIGIDHI_PACKAGE_DIR}/_bindings.py ${RIGIDHI_PACKAGE_DIR}/_bindings.pyi
                  ${RIGIDHI_PACKAGE_DIR}/_enumerations.pyi DESTINATION ${PACKAGE_DIR} COMPONENT python)
    install(TARGETS _openmmrigidhi LIBRARY DESTINATION ${PACKAGE_DIR} COMPONENT python)
    file(RELATIVE_PATH FROM_PACKAGE /${PACKAGE_DIR} /${API_DIR})
    set_target_properties(_openmmrigidhi PROPERTIES INSTALL_RPATH "$ORIGIN/${FROM_PACKAGE}")
endif()

# For C++ programs: headers, find_package(OpenMMRigidHI), and the libraries under a path that does not depend on Python.
install(DIRECTORY openmmapi/include/openmmrigidhi DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT headers)
set(CONFIG_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/OpenMMRigidHI)
install(EXPORT OpenMMRigidHI NAMESPACE OpenMMRigidHI:: FILE OpenMMRigidHITargets.cmake DESTINATION ${CONFIG_DIR} COMPONENT headers)
configure_package_config_file(cmake/OpenMMRigidHIConfig.cmake.in OpenMMRigidHIConfig.cmake INSTALL_DESTINATION ${CONFIG_DIR}
                              PATH_VARS API_DIR)
write_basic_package_version_file(OpenMMRigidHIConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/OpenMMRigidHIConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/OpenMMRigidHIConfigVersion.cmake
              cmake/FindOpenMM.cmake DESTINATION ${CONFIG_DIR} COMPONENT headers)
if(NOT API_DIR STREQUAL ${CMAKE_INSTALL_LIBDIR}/openmm)
    file(RELATIVE_PATH FROM_LIBDIR /${CMAKE_INSTALL_LIBDIR} /${API_DIR})
    install(CODE "file(MAKE_DIRECTORY \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_LIBDIR}\")
                  file(CREATE_LINK \"${FROM_LIBDIR}\"
                       \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_LIBDIR}/openmmrigidhi\" SYMBOLIC)" COMPONENT headers)
endif()
