#!/usr/bin/env python3
"""Build the site: `make site`. Neither this script nor the pages need a network.

Every warning of Sphinx and everything that check.py finds is an error.
"""
import argparse
import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys

import apipages
import check
import collect
import gallery
import notebooks
import references

ROOT = pathlib.Path(__file__).resolve().parents[1]
#: The directory where Debian has what browsers need.
SCRIPTS = pathlib.Path('/usr/share/javascript')
KATEX = SCRIPTS/'katex'


def version():
    """The version in CMakeLists.txt, which is the one place of it."""
    return re.search(r'project\(openmm-rigidhi VERSION ([0-9.]+)',
                     (ROOT/'CMakeLists.txt').read_text())[1]


def describe_cpp(folder):
    """Let Doxygen write its XML of the public headers."""
    folder.mkdir(parents=True, exist_ok=True)
    headers = ' '.join(f'{ROOT}/{name}'
                       for name in collect.git_files('openmmapi/include/openmmrigidhi/*.h')
                       if '/internal/' not in name)
    settings = (ROOT/'Doxyfile').read_text() + f"""
OUTPUT_DIRECTORY = {folder}
INPUT = {headers}
STRIP_FROM_PATH = {ROOT}
GENERATE_HTML = NO
JAVADOC_AUTOBRIEF = NO
GENERATE_XML = YES
XML_PROGRAMLISTING = NO
"""
    subprocess.run(['doxygen', '-'], input=settings, cwd=ROOT, text=True, check=True)
    return folder/'xml'


def copy_formula_fonts(folder):
    """Copy what draws formulas, without the files for old browsers."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(KATEX/'katex.min.js', folder/'katex.js')
    shutil.copy(KATEX/'contrib'/'auto-render.js', folder)
    shutil.copy(KATEX/'katex.min.css', folder/'katex.css')
    (folder/'fonts').mkdir(exist_ok=True)
    for font in (KATEX/'fonts').iterdir():
        shutil.copy(font, folder/'fonts')


def mend_theme(html):
    """Correct three things in Debian's furo, which differs from the bundle of its authors."""
    styles, scripts = html/'_static'/'styles', html/'_static'/'scripts'
    # A style sheet of another package is fetched from a server. Pages that are read from files need
    # it beside them.
    shutil.copy(SCRIPTS/'normalize.css'/'normalize.css', styles)
    style = (styles/'furo.css').read_text().replace(
        '@import url(/javascript/normalize.css/normalize.css)', '@import url(normalize.css)')
    # The colours of readers whose system prefers dark pages were lost, as a query within a query.
    if 'prefers-color-scheme' not in style:
        dark = re.search(r'body\[data-theme="dark"\] \{(.*?)\}', style, flags=re.S)[1]
        style += ('\n@media (prefers-color-scheme: dark) '
                  f'{{ body:not([data-theme="light"]) {{{dark}}} }}\n')
    (styles/'furo.css').write_text(style)
    # The script is a module that imports another one, but pages load it as a plain script.
    script = (scripts/'furo.js').read_text()
    if found := re.match(r'import Gumshoe from "./(gumshoe-patched.js)";', script):
        (scripts/'furo.js').write_text((scripts/found[1]).read_text() +
                                       script.removeprefix(found[0]))


def check_notebooks(source):
    """Raise an error if a notebook is not what Jupyter reads."""
    import nbformat
    for file in sorted(source.rglob('*.ipynb')):
        nbformat.validate(nbformat.read(file, as_version=4))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        'output', type=pathlib.Path,
        help='directory for everything that is made; pages come into its folder html')
    output = parser.parse_args().output.resolve()
    if missing := [
            name for name in ('sphinx', 'myst_parser', 'breathe', 'furo', 'nbformat')
            if importlib.util.find_spec(name) is None
    ]:
        sys.exit(f'{sys.executable} lacks {", ".join(missing)}: install the packages of '
                 f'site/packages-debian.txt, or call make with PYTHON=/usr/bin/python3')
    source, html = output/'source', output/'html'
    for old in (source, html, output/'cpp'):
        shutil.rmtree(old, ignore_errors=True)
    xml = describe_cpp(output/'cpp')
    known = references.names()

    def change(text, page):
        text = references.with_references(text, known) + references.to_the_reference(page)
        return notebooks.offer(text, page, source)

    pages = collect.copy_pages(source, change)
    check_notebooks(source)
    gallery.write(source)
    pages += apipages.write(source, xml)
    collect.write_contents(source, pages)
    copy_formula_fonts(source/'_static'/'katex')
    shutil.copytree(ROOT/'site'/'static', source/'_static', dirs_exist_ok=True)
    command = [
        sys.executable, '-m', 'sphinx', '-b', 'html', '-W', '--keep-going', '-q', '-c',
        str(ROOT/'site'), '-d',
        str(output/'doctrees'), '-D', f'html_static_path={source / "_static"}', '-D',
        f'breathe_projects.openmm-rigidhi={xml}', '-D', f'release={version()}', '-D',
        f'version={version()}',
        str(source),
        str(html)
    ]
    if subprocess.run(command, cwd=ROOT).returncode:
        sys.exit('The site has warnings of Sphinx, see above.')
    mend_theme(html)
    faults = check.faults(html)
    if faults:
        sys.exit('\n'.join(faults) + f'\nThe site has {len(faults)} faults, see above.')
    print(f'Written: {html / "index.html"}')


if __name__ == '__main__':
    main()
