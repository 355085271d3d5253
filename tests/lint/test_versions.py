"""The version is that of project() in CMakeLists.txt, wherever else it is written."""
import re

from conftest import read


def test_every_place_has_the_one_version():
    version = re.search(r'project\(openmm-rigidhi VERSION ([0-9.]+)', read('CMakeLists.txt'))[1]
    assert re.search(r'^version: (.*)$', read('CITATION.cff'),
                     flags=re.M)[1] == version, 'CITATION.cff'
    assert re.match(r'openmm-rigidhi \((.*?)\)',
                    read('debian/changelog'))[1] == version, 'debian/changelog'
    assert re.search(r'^## ([0-9.]+)', read('CHANGELOG.md'),
                     flags=re.M)[1] == version, 'CHANGELOG.md'
    assert re.search(r'\*\*Version\*\* ([0-9.]+\d)',
                     read('site/index.md'))[1] == version, 'index.md'
    found = re.search(r'^    find_package\(OpenMMRigidHI|find_package\(OpenMMRigidHI ([0-9.]+)',
                      read('debian/tests/program'))[1]
    assert found == version.rpartition('.')[0], 'debian/tests/program'
