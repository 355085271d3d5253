# Bodies on the device: a library for each of OpenMM's platforms OpenCL, CUDA and HIP whose headers and library are found. A platform without
# one is served by OpenMMRigidHIAny, which moves bodies on the host.

option(RIGIDHI_BUILD_DEVICES "Build the libraries of OpenCL, CUDA and HIP, where OpenMM has them" ON)
set(RIGIDHI_DEVICE_PLATFORMS)

# The files of kernels/ become strings.
file(GLOB KERNEL_FILES CONFIGURE_DEPENDS platforms/device/kernels/*.cc)
set(KERNEL_SOURCES)
foreach(file ${KERNEL_FILES})
    get_filename_component(name ${file} NAME_WE)
    file(READ ${file} text)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${file})
    string(APPEND KERNEL_SOURCES "inline const std::string ${name} = R\"KERNEL(\n${text})KERNEL\";\n")
endforeach()
configure_file(platforms/device/KernelSources.h.in ${CMAKE_BINARY_DIR}/generated/KernelSources.h @ONLY)

# What the scheme's kernels say, which needs no OpenMM.
file(GLOB TEXT_SOURCES CONFIGURE_DEPENDS platforms/device/text/*.cpp)
rigidhi_unite(TEXT_SOURCES text ${CMAKE_SOURCE_DIR}/platforms/device ${TEXT_SOURCES})
add_library(RigidHIKernelText STATIC ${TEXT_SOURCES})
target_include_directories(RigidHIKernelText PUBLIC platforms/device)
target_link_libraries(RigidHIKernelText PUBLIC RigidHICommon)

if(NOT RIGIDHI_BUILD_DEVICES OR RIGIDHI_SANITIZE)
    add_custom_target(RigidHIDevices)  # compilers of device code are not built for sanitizers
    return()
endif()

# Debian's packages have OpenMM's headers for OpenCL, but not those of the library for expressions, which they include and this plugin
# does not use.
if(NOT EXISTS "${OPENMM_INCLUDE_DIR}/lepton/ParsedExpression.h")
    set(LEPTON_STUB ${CMAKE_BINARY_DIR}/generated/lepton-stub)
    file(WRITE ${LEPTON_STUB}/lepton/CompiledExpression.h "namespace Lepton {\nclass CompiledExpression {};\n}\n")
    file(WRITE ${LEPTON_STUB}/lepton/ExpressionProgram.h "namespace Lepton {\nclass ExpressionProgram {};\n}\n")
    file(WRITE ${LEPTON_STUB}/lepton/ExpressionTreeNode.h "namespace Lepton {\nclass ExpressionTreeNode {};\n}\n")
    file(WRITE ${LEPTON_STUB}/lepton/ParsedExpression.h "namespace Lepton {\nclass ParsedExpression {};\n}\n")
    file(WRITE ${LEPTON_STUB}/lepton/CustomFunction.h "namespace Lepton {\nclass CustomFunction {};\n}\n")
endif()

get_filename_component(OPENMM_LIBRARY_DIR "${OPENMM_LIBRARY}" DIRECTORY)
file(GLOB DEVICE_SOURCES CONFIGURE_DEPENDS platforms/device/*.cpp)
function(rigidhi_add_device platform directory header)
    unset(OPENMM_${platform}_LIBRARY CACHE)
    find_library(OPENMM_${platform}_LIBRARY OpenMM${platform} NO_DEFAULT_PATH
                 PATHS ${OPENMM_LIBRARY_DIR}/plugins ${OPENMM_LIBRARY_DIR}/openmm/plugins)
    if(NOT OPENMM_${platform}_LIBRARY OR NOT EXISTS "${OPENMM_INCLUDE_DIR}/${header}")
        message(STATUS "OpenMM's platform ${platform}: not here with its headers")
        return()
    endif()
    # The headers include those of the device's own software.
    set(CMAKE_REQUIRED_INCLUDES ${OPENMM_INCLUDE_DIR} ${LEPTON_STUB} ${ARGN})
    set(definitions)
    if(platform STREQUAL HIP)
        set(definitions __HIP_PLATFORM_AMD__)
        set(CMAKE_REQUIRED_DEFINITIONS -D${definitions})
    endif()
    set(CMAKE_REQUIRED_QUIET ON)
    set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
    include(CheckCXXSourceCompiles)
    unset(RIGIDHI_COMPILES_${platform} CACHE)
    check_cxx_source_compiles("#include <${header}>\nint main() { return 0; }" RIGIDHI_COMPILES_${platform})
    if(NOT RIGIDHI_COMPILES_${platform})
        message(STATUS "OpenMM's platform ${platform}: the headers that its own include are not here; the host will move bodies there")
        return()
    endif()
    file(GLOB PLATFORM_SOURCES CONFIGURE_DEPENDS platforms/${directory}/*.cpp)
    rigidhi_unite(united ${directory} ${CMAKE_SOURCE_DIR}/platforms/device ${DEVICE_SOURCES})
    add_library(OpenMMRigidHI${platform} SHARED ${PLATFORM_SOURCES} ${united})
    target_compile_definitions(OpenMMRigidHI${platform} PRIVATE ${definitions})
    target_include_directories(OpenMMRigidHI${platform} PRIVATE platforms/device)
    target_include_directories(OpenMMRigidHI${platform} SYSTEM PRIVATE ${LEPTON_STUB} ${ARGN})
    target_link_libraries(OpenMMRigidHI${platform} PRIVATE RigidHIKernelText ${OPENMM_${platform}_LIBRARY})
    target_link_options(OpenMMRigidHI${platform} PRIVATE -Wl,--no-as-needed)
    set_target_properties(OpenMMRigidHI${platform} PROPERTIES
        LIBRARY_OUTPUT_DIRECTORY ${RIGIDHI_LIB_DIR}/plugins BUILD_RPATH_USE_ORIGIN ON INSTALL_RPATH "$ORIGIN/..")
    set(RIGIDHI_DEVICE_PLATFORMS ${RIGIDHI_DEVICE_PLATFORMS} ${platform} PARENT_SCOPE)
    set(RIGIDHI_${platform}_INCLUDES ${ARGN} PARENT_SCOPE)
    message(STATUS "OpenMM's platform ${platform}: ${OPENMM_${platform}_LIBRARY}")
endfunction()

find_path(CUDA_INCLUDE_DIR cuda.h PATHS $ENV{CUDA_HOME}/include /usr/local/cuda/include /usr/include)
find_path(HIP_INCLUDE_DIR hip/hip_runtime.h PATHS $ENV{ROCM_PATH}/include /opt/rocm/include)
rigidhi_add_device(OpenCL opencl openmm/opencl/OpenCLContext.h)
rigidhi_add_device(CUDA cuda openmm/cuda/CudaContext.h ${CUDA_INCLUDE_DIR})
rigidhi_add_device(HIP hip openmm/hip/HipContext.h ${HIP_INCLUDE_DIR})

# All of them by one name.
add_custom_target(RigidHIDevices)
foreach(platform ${RIGIDHI_DEVICE_PLATFORMS})
    add_dependencies(RigidHIDevices OpenMMRigidHI${platform})
endforeach()
