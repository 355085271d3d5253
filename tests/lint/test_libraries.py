"""The shared libraries export only the intended symbols, and depend only on the intended libraries.
"""
import subprocess

import pytest

#: Exported by the API library, after demangling: the public classes, and the functions that OpenMM
#: runs when it loads the library.
API_CLASSES = ('RigidHIPlugin::CustomRigidHIIntegrator', 'RigidHIPlugin::MobilityForce',
               'RigidHIPlugin::CustomBodyForce', 'RigidHIPlugin::CustomBodyMotion',
               'RigidHIPlugin::BodyExpressions', 'registerRigidHISerializationProxies')
#: Exported for the platforms' libraries: state of which a process has one instance.
SHARED_STATE = ('RigidHIPlugin::blasThreads()', 'RigidHIPlugin::fourierPlanner()')
#: Functions of openmmrigidhi/Version.h.
VERSIONS = ('RigidHIPlugin::getVersion[abi:cxx11]()',
            'RigidHIPlugin::getOpenMMVersionOfBuild[abi:cxx11]()',
            'RigidHIPlugin::getLibraryPath[abi:cxx11]()', 'RigidHIPlugin::versionConflict')
ENTRY_POINTS = {'registerPlatforms', 'registerKernelFactories'}
#: Emitted by the compiler for templates and classes of the standard library and OpenMM that are
#: used by value.
FOREIGN = ('std::', 'OpenMM::', 'void std::', '__gnu_cxx::', 'mu::')


def exported(library):
    listing = subprocess.run(['nm', '-D', '--defined-only', '-C', library], capture_output=True,
                             text=True, check=True)
    return [line.split(maxsplit=2)[2] for line in listing.stdout.splitlines()]


def needed(library):
    listing = subprocess.run(['readelf', '-d', library], capture_output=True, text=True,
                             check=True).stdout
    return [line.split('[')[1].rstrip(']') for line in listing.splitlines() if '(NEEDED)' in line]


@pytest.fixture(params=['Reference', 'CPU', 'Any'])
def platform_library(request, package_directory):
    return package_directory/'lib'/'plugins'/f'libOpenMMRigidHI{request.param}.so'


def unexpected(symbols, own):
    """Symbols that belong neither to the given names nor to templates of other libraries."""
    result = []
    for symbol in symbols:
        name = symbol
        for prefix in ('typeinfo for ', 'typeinfo name for ', 'vtable for ', 'guard variable for ',
                       'non-virtual thunk to '):
            name = name.removeprefix(prefix)
        if not name.startswith(tuple(own)) and not any(foreign in name for foreign in FOREIGN):
            result.append(symbol)
    return result


def test_api_library_exports_the_public_classes(package_directory):
    symbols = exported(package_directory/'lib'/'libOpenMMRigidHI.so')
    own = [symbol for symbol in symbols if symbol.startswith(API_CLASSES)]
    assert any('addRigidBody' in symbol for symbol in own)
    assert set(SHARED_STATE) <= set(symbols)
    assert unexpected(symbols, API_CLASSES + SHARED_STATE + VERSIONS) == []


def test_platform_library_exports_its_entry_points(platform_library):
    symbols = exported(platform_library)
    # describe() of the Python package asks the CPU platform's library about the numerics.
    entries = ENTRY_POINTS | ({'describeRigidHI'} if 'CPU' in platform_library.name else set())
    assert entries <= set(symbols)
    # Copies of the API's classes are implicitly defined, so the compiler may emit them wherever
    # they are used.
    copies = {f'{name}::{name.split("::")[1]}({name} const&)' for name in API_CLASSES[:-1]}
    assert unexpected([symbol for symbol in symbols if symbol not in entries | copies], ()) == []


def test_platform_library_needs_the_api_library(platform_library):
    # Otherwise the serialization proxies would not be registered when OpenMM loads only the
    # platform library.
    assert 'libOpenMMRigidHI.so' in needed(platform_library)
    assert 'libOpenMMCPU.so' not in needed(platform_library)


def test_binding_module_exports_its_initialiser(package_directory):
    (module,) = package_directory.glob('_openmmrigidhi*.so')
    own = [
        symbol for symbol in exported(module) if not any(foreign in symbol for foreign in FOREIGN)
    ]
    assert own == ['PyInit__openmmrigidhi']
