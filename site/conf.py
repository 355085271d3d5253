"""Settings of Sphinx.

site/build.py collects the pages and calls Sphinx. Version, static files and Doxygen's XML come from
there.
"""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import references  # noqa: E402

project = 'openmm-rigidhi'
author = 'The openmm-rigidhi authors'
copyright = 'the openmm-rigidhi authors, MIT licence'
language = 'en'

extensions = [
    'myst_parser', 'breathe', 'sphinx.ext.autodoc', 'sphinx.ext.autosummary', 'sphinx.ext.napoleon',
    'sphinx.ext.mathjax'
]
exclude_patterns = ['_static']

# Markdown as GitHub reads it: anchors of headings, formulas between dollars.
myst_enable_extensions = ['dollarmath', 'colon_fence']
myst_heading_anchors = 5

# Docstrings are in numpy's style.
napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'
autosummary_generate = False
add_module_names = False
toc_object_entries_show_parents = 'hide'

breathe_default_project = 'openmm-rigidhi'
breathe_default_members = ('members',)
breathe_domain_by_extension = {'h': 'cpp'}
cpp_id_attributes = ['OPENMM_EXPORT_RIGIDHI']

html_theme = 'furo'
html_title = 'openmm-rigidhi'
html_css_files = ['katex/katex.css', 'site.css']
html_js_files = ['copy.js', 'versions.js']
html_search_scorer = str(pathlib.Path(__file__).with_name('search.js'))
# Sphinx marks formulas as for MathJax; KaTeX draws what is between the same marks, and is fifty
# times smaller.
mathjax_path = 'formulas.js'
mathjax_options = {'defer': 'defer'}
html_copy_source = False
html_show_sphinx = False
html_theme_options = {
    'light_css_variables': {
        'sidebar-item-font-size': '81%',
        'color-brand-primary': '#00588a',
        'color-brand-content': '#00588a'
    },
    'dark_css_variables': {
        'color-brand-primary': '#6bbdf0',
        'color-brand-content': '#6bbdf0'
    },
}


def setup(app):
    """Names of pages in docstrings become links."""
    def with_links(app, what, name, thing, options, lines):
        lines[:] = [references.with_pages(line) for line in lines]

    app.connect('autodoc-process-docstring', with_links)
