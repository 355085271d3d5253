# Finds OpenMM: the target OpenMM::OpenMM, and OPENMM_VERSION (major.minor of the library that was found, by asking it).
#
# Where it looks: OPENMM_DIR (a CMake variable or an environment variable), the prefix in which OpenMM is installed, with include/OpenMM.h and
# lib/libOpenMM.so; CMAKE_PREFIX_PATH and the system's directories; and at last the directories that the Python module openmm names,
# which is where packages of pip and conda have their libraries.

set(OPENMM_DIR "$ENV{OPENMM_DIR}" CACHE PATH "Prefix in which OpenMM is installed; empty: the system's directories, or those of the Python module openmm")
# In a build directory that is there, too, another OPENMM_DIR is another OpenMM. (Without the environment variable the directory goes on as it is.)
if(DEFINED OPENMM_DIR_OF_ENVIRONMENT AND NOT "$ENV{OPENMM_DIR}" STREQUAL "" AND NOT "$ENV{OPENMM_DIR}" STREQUAL "${OPENMM_DIR_OF_ENVIRONMENT}")
    set_property(CACHE OPENMM_DIR PROPERTY VALUE "$ENV{OPENMM_DIR}")
endif()
if(NOT "$ENV{OPENMM_DIR}" STREQUAL "" OR NOT DEFINED OPENMM_DIR_OF_ENVIRONMENT)
    set(OPENMM_DIR_OF_ENVIRONMENT "$ENV{OPENMM_DIR}" CACHE INTERNAL "")
endif()
if(DEFINED OPENMM_FOUND_IN AND NOT OPENMM_FOUND_IN STREQUAL "${OPENMM_DIR}")
    unset(OPENMM_INCLUDE_DIR CACHE)
    unset(OPENMM_LIBRARY CACHE)
endif()
set(OPENMM_FOUND_IN "${OPENMM_DIR}" CACHE INTERNAL "")
if(OPENMM_DIR)
    # What the user names is taken, or nothing.
    set(PLACES PATHS "${OPENMM_DIR}" NO_DEFAULT_PATH)
else()
    set(PLACES)
endif()
find_path(OPENMM_INCLUDE_DIR OpenMM.h ${PLACES} PATH_SUFFIXES include)
find_library(OPENMM_LIBRARY OpenMM ${PLACES} PATH_SUFFIXES lib lib64 lib/${CMAKE_LIBRARY_ARCHITECTURE})
if(NOT OPENMM_DIR AND NOT (OPENMM_INCLUDE_DIR AND OPENMM_LIBRARY))
    find_package(Python3 QUIET COMPONENTS Interpreter)
    if(Python3_Interpreter_FOUND)
        execute_process(COMMAND ${Python3_EXECUTABLE} -c "import openmm.version as v; print(v.openmm_library_path)"
                        OUTPUT_VARIABLE DIRECTORY OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
        if(DIRECTORY)
            find_path(OPENMM_INCLUDE_DIR OpenMM.h PATHS "${DIRECTORY}/../include" NO_DEFAULT_PATH)
            find_library(OPENMM_LIBRARY OpenMM PATHS "${DIRECTORY}" NO_DEFAULT_PATH)
        endif()
    endif()
endif()
if(NOT OPENMM_INCLUDE_DIR OR NOT OPENMM_LIBRARY)
    message(FATAL_ERROR "OpenMM was not found (header OpenMM.h: ${OPENMM_INCLUDE_DIR}, library: ${OPENMM_LIBRARY}; OPENMM_DIR: '${OPENMM_DIR}'). "
                        "Install it with its headers (Debian: libopenmm-dev), or name the prefix in which it is: -DOPENMM_DIR=prefix.")
endif()

if(NOT EXISTS "${OPENMM_INCLUDE_DIR}/openmm/Platform.h")
    # The compiler would take those of another OpenMM, in the system's directories.
    message(FATAL_ERROR "OpenMM: ${OPENMM_INCLUDE_DIR} has OpenMM.h, but not the headers that it includes (openmm/Platform.h is missing). "
                        "Install OpenMM there with all its headers, or name another prefix: -DOPENMM_DIR=prefix.")
endif()

add_library(OpenMM::OpenMM UNKNOWN IMPORTED)
set_target_properties(OpenMM::OpenMM PROPERTIES IMPORTED_LOCATION ${OPENMM_LIBRARY})
target_include_directories(OpenMM::OpenMM SYSTEM INTERFACE ${OPENMM_INCLUDE_DIR})

# No header has the version.
if(NOT OPENMM_VERSION OR NOT OPENMM_VERSION_IS_OF STREQUAL OPENMM_LIBRARY)
    get_filename_component(DIRECTORY ${OPENMM_LIBRARY} DIRECTORY)
    file(WRITE ${CMAKE_BINARY_DIR}/openmm-version/version.cpp
         "#include <iostream>\n#include <openmm/Platform.h>\nint main() { std::cout << OpenMM::Platform::getOpenMMVersion(); }\n")
    try_run(STATUS COMPILED ${CMAKE_BINARY_DIR}/openmm-version ${CMAKE_BINARY_DIR}/openmm-version/version.cpp
            CMAKE_FLAGS -DINCLUDE_DIRECTORIES=${OPENMM_INCLUDE_DIR} -DCMAKE_BUILD_RPATH=${DIRECTORY}
            LINK_LIBRARIES ${OPENMM_LIBRARY}
            COMPILE_OUTPUT_VARIABLE COMPILER_SAYS RUN_OUTPUT_VARIABLE VERSION)
    if(NOT COMPILED OR NOT STATUS EQUAL 0 OR NOT VERSION MATCHES "^([0-9]+\\.[0-9]+)")
        message(FATAL_ERROR "OpenMM: a program of three lines against ${OPENMM_INCLUDE_DIR} and ${OPENMM_LIBRARY} does not work; are header and "
                            "library of one version and for this compiler?\n${COMPILER_SAYS}\n${VERSION}")
    endif()
    set(OPENMM_VERSION ${CMAKE_MATCH_1} CACHE INTERNAL "major.minor of OpenMM")
    set(OPENMM_VERSION_IS_OF ${OPENMM_LIBRARY} CACHE INTERNAL "")
endif()
if(OPENMM_VERSION VERSION_LESS OpenMM_FIND_VERSION)
    message(FATAL_ERROR "OpenMM ${OPENMM_VERSION} (${OPENMM_LIBRARY}) is too old: openmm-rigidhi needs ${OpenMM_FIND_VERSION} or newer. "
                        "Install a newer one, or name the prefix of one: -DOPENMM_DIR=prefix.")
endif()
set(OpenMM_FOUND TRUE)
message(STATUS "OpenMM ${OPENMM_VERSION}: ${OPENMM_LIBRARY}")
