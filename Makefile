# The commands of everyday work, around CMake. `make help` lists them; each builds what it needs first.

# The first Python that has OpenMM: that of an environment (conda, pip), else Debian's.
ifndef PYTHON
PYTHON := $(shell for each in python3 /usr/bin/python3; do if $$each -c 'import openmm' 2>/dev/null; then command -v $$each; exit; fi; done; \
    if [ -x /usr/bin/python3 ]; then echo /usr/bin/python3; else echo python3; fi)
endif
PREFIX ?= /usr/local
# Parallel compilations; each takes up to 1.5 GB.
JOBS ?= $(shell nproc)
BUILD := build
# What runs: the platforms' libraries and the Python package with its bindings.
RUNTIME := OpenMMRigidHIReference OpenMMRigidHICPU OpenMMRigidHIAny RigidHIDevices RigidHIPythonPackage
SOURCES = $(shell git ls-files --cached --others --exclude-standard '*.h' '*.cpp')
# A file's tests share what is costly to make. Some wait for other processes, so there are more workers than cores.
PYTEST = -m pytest --numprocesses $$(($(JOBS) + 2)) --dist loadfile
PYTHONPATH_BUILD = PYTHONPATH="$(CURDIR)/$(BUILD)/python$${PYTHONPATH:+:$$PYTHONPATH}"

.PHONY: help deps configure build demo test test-cpp test-python test-scripts test-full install sanitize tsan lint recipes deb format docs site benchmark clean

help:
	@echo "make build              release build; importable package in $(BUILD)/python"
	@echo "make demo               build, then run examples/water_demo/run.py (TIP4P-Ew water, about two minutes)"
	@echo "make test               build, then all quick tests, C++ and Python"
	@echo "make test-scripts       shortened runs of the scripts in validation/ and examples/"
	@echo "make test-full          both, and the tests labelled full (long ones: ctest -L long, pytest -m long)"
	@echo "make install PREFIX=dir libraries, headers and Python package (default $(PREFIX))"
	@echo "make deb                Debian packages in $(BUILD)/deb, of what is committed"
	@echo "make sanitize           quick C++ tests under the address and undefined-behaviour sanitizers"
	@echo "make tsan               quick C++ tests under the thread sanitizer"
	@echo "make lint               checks of the sources, the documentation and the built libraries"
	@echo "make recipes            follow the recipes of CONTRIBUTING.md in a copy, and test what they make"
	@echo "make format             clang-format all C++ files, yapf all Python files, a sentence a line in Markdown"
	@echo "make docs               C++ reference by Doxygen into $(BUILD)/docs"
	@echo "make site               the site, all pages with search and references, into $(BUILD)/site/html (site/packages-debian.txt)"
	@echo "make benchmark          all benchmarks, C++ and Python"
	@echo "make deps               only install the Debian packages that are missing (packages-debian.txt)"
	@echo "make clean              remove all build directories"
	@echo "Variables: PYTHON ($(PYTHON)), PREFIX, JOBS ($(JOBS))"

deps:
	@tools/install-packages.sh packages-debian.txt

configure: deps
	@cmake --preset release -DPython3_EXECUTABLE="$(PYTHON)"

build: configure
	cmake --build $(BUILD) --parallel $(JOBS) --target $(RUNTIME)
	@echo 'Built. To use it: export PYTHONPATH=$(CURDIR)/$(BUILD)/python'

demo: build
	$(PYTHONPATH_BUILD) $(PYTHON) examples/water_demo/run.py

test: test-cpp test-python

test-cpp: configure
	cmake --build $(BUILD) --parallel $(JOBS)
	ctest --preset release --parallel $(JOBS)

test-python: build
	$(PYTHONPATH_BUILD) $(PYTHON) $(PYTEST) -m "not full and not long and not scripts" tests/python

test-scripts: build
	$(PYTHONPATH_BUILD) $(PYTHON) $(PYTEST) -m "scripts and not full and not long" tests/python

test-full: configure
	cmake --build $(BUILD) --parallel $(JOBS)
	ctest --test-dir $(BUILD) -LE long --output-on-failure --no-tests=error --parallel $(JOBS)
	$(PYTHONPATH_BUILD) $(PYTHON) $(PYTEST) -m "not long" tests/python

# The package goes where $(PYTHON), or the Python of the prefix itself, looks for packages, if it looks below the prefix.
install: build
	@directory=$$($(PYTHON) -I tools/python_directory.py "$(PREFIX)") && \
	cmake --preset release -DPython3_EXECUTABLE="$(PYTHON)" -DCMAKE_INSTALL_PREFIX="$(abspath $(PREFIX))" \
	    -DRIGIDHI_PYTHON_INSTALL_DIR="$$directory" > /dev/null && \
	cmake --build $(BUILD) --parallel $(JOBS) --target $(RUNTIME) && \
	cmake --install $(BUILD) > $(BUILD)/install.log && \
	$(PYTHON) -I tools/python_directory.py --advise "$(PREFIX)"

sanitize: deps
	cmake --preset asan
	cmake --build --preset asan --parallel $(JOBS)
	ctest --preset asan --parallel $(JOBS)

tsan: deps
	cmake --preset tsan
	cmake --build --preset tsan --parallel $(JOBS)
	ctest --preset tsan --parallel $(JOBS)

lint: build
	$(PYTHONPATH_BUILD) $(PYTHON) $(PYTEST) --dist load tests/lint

recipes: deps
	$(PYTHON) tools/follow_recipes.py --jobs $(JOBS)

# The committed tree, so that nothing of this machine gets in.
deb:
	@tools/install-packages.sh debian/packages-to-build.txt
	@dpkg-checkbuilddeps debian/control 2>/dev/null || $(MAKE) deps
	@rm -rf $(BUILD)/deb && mkdir -p $(BUILD)/deb/openmm-rigidhi
	git archive HEAD | tar -x -C $(BUILD)/deb/openmm-rigidhi
	cd $(BUILD)/deb/openmm-rigidhi && dpkg-buildpackage --build=binary --no-sign --jobs=$(JOBS)
	@ls $(BUILD)/deb/*.deb

format: deps
	clang-format -i $(SOURCES)
	yapf3 --in-place --parallel $$(git ls-files --cached --others --exclude-standard '*.py')
	tools/format_markdown.py $$(git ls-files --cached --others --exclude-standard '*.md' ':!*/results/*')

docs: deps
	@mkdir -p $(BUILD)/docs
	doxygen Doxyfile
	@echo 'Written: $(BUILD)/docs/html/index.html'

site: build
	@tools/install-packages.sh site/packages-debian.txt
	$(PYTHONPATH_BUILD) $(PYTHON) site/build.py $(BUILD)/site

benchmark: configure
	cmake --preset release -DRIGIDHI_BUILD_BENCHMARKS=ON
	cmake --build $(BUILD) --parallel $(JOBS)
	$(PYTHONPATH_BUILD) $(PYTHON) benchmarks/run.py

clean:
	cmake -E rm -rf build build-debug build-asan build-tsan
