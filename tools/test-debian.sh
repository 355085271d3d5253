#!/bin/sh
# What is committed, on a Debian made from nothing: the tree (built, tested, demonstrated), its packages (made there,
# tried on another Debian made from nothing), and a wheel (Debian 13, which has scikit-build-core).
# Usage: tools/test-debian.sh 12|13 [directory for the chroots, default build/debian] [all|tree|packages|wheel, default all]
# Needs root (chroot, mount), debootstrap, git, 6 GB, and an hour of two processors for the tree, a third of that for the
# packages. The summaries go to tests/reports/debian-<release>.txt and debian-<release>-packages.txt.
set -eu
cd "$(dirname "$0")/.."
release=${1:?usage: tools/test-debian.sh 12|13 [directory] [all|tree|packages]}
part=${3:-all}
case $part in
all | tree | packages | wheel) ;;
*) echo "test-debian.sh: got part '$part'; it must be all, tree, packages or wheel" >&2; exit 2 ;;
esac
case $release in
12) suite=bookworm ;;
13) suite=trixie ;;
*) echo "test-debian.sh: got release '$release'; it must be 12 or 13" >&2; exit 2 ;;
esac
[ "$(id -u)" = 0 ] || { echo "test-debian.sh: chroot and mount need root: run it as root" >&2; exit 2; }
command -v debootstrap >/dev/null || { echo "test-debian.sh: debootstrap is missing: apt install debootstrap" >&2; exit 2; }
where=$(realpath "${2:-build/debian}")
log=$where/$release.log
# The mirror that this machine uses itself.
mirror=${MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep -v security | head -1)}
mkdir -p "$where" tests/reports
: > "$log"

say() { echo "$*" | tee -a "$log" >> "$where/$release.report"; echo "$*"; }

release_mounts() { # directory
    for each in "$1/proc" "$1/sys" "$1/ccache"; do if mountpoint -q "$each"; then umount "$each"; fi; done
}

fresh() { # directory
    release_mounts "$1"
    rm -rf --one-file-system "$1"
    if [ ! -d "$where/$suite" ]; then
        debootstrap --variant=minbase "$suite" "$where/$suite.new" "$mirror" >> "$log" 2>&1
        rm -rf "$where/$suite.new/var/cache/apt/archives"/*.deb
        mv "$where/$suite.new" "$where/$suite"
    fi
    cp -a "$where/$suite" "$1"
    mount -t proc proc "$1/proc"
    # Without it pocl 6 finds no memory, and ends the process that asks for an OpenCL device.
    mount -t sysfs -o ro sysfs "$1/sys"
}

inside() { # directory, command
    if [ -n "${CCACHE_DIR:-}" ] && mountpoint -q "$1/ccache"; then cached=yes; else cached=; fi
    chroot "$1" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 HOME=/root DEBIAN_FRONTEND=noninteractive \
        ${cached:+CMAKE_CXX_COMPILER_LAUNCHER=ccache CCACHE_DIR=/ccache CCACHE_BASEDIR=/source CCACHE_NOHASHDIR=1} sh -c "$2"
}

failed=0
step() { # name, directory, command: a line of the summary, with the last lines of what a failure said
    began=$(date +%s)
    echo "==== $1" >> "$log"
    if inside "$2" "cd /source 2>/dev/null; $3" > "$where/$release-step.log" 2>&1 </dev/null; then outcome=passed; else outcome=FAILED; failed=1; fi
    cat "$where/$release-step.log" >> "$log"
    say "$1: $outcome, $(($(date +%s) - began)) s$(grep -hoE '^(100% tests passed.*|[0-9]+% tests passed.*|=* ?[0-9]+ (passed|failed).*)' "$where/$release-step.log" | tail -2 | sed 's/=//g' | paste -sd ';' | sed -n 's/^\(.\)/; \1/p')"
    [ $outcome = passed ] || tail -40 "$where/$release-step.log"
}

begin() { # name of the report: a new one
    report=$PWD/tests/reports/$1.txt
    rm -f "$where/$release.report"
    say "Debian $release ($suite), made by debootstrap; tools/test-debian.sh $release; $(date -u +%Y-%m-%d); $(nproc) processors"
    say "commit $(git rev-parse --short HEAD)"
}

finish() {
    mv "$where/$release.report" "$report"
    echo "Written: $report; everything that was printed: $log"
}

source_in() { # directory: a fresh Debian with the committed source, make and git
    fresh "$1"
    if [ -n "${CCACHE_DIR:-}" ]; then mkdir -p "$1/ccache"; mount --bind "$CCACHE_DIR" "$1/ccache"; fi
    git clone -q --no-hardlinks . "$1/source"
}

versions() { # directory
    say "$(inside "$1" 'echo "$(g++ --version | head -1); $(cmake --version | head -1); $(swig -version | grep Version); $(python3 --version); NumPy $(python3 -c "import numpy; print(numpy.__version__)"); OpenMM $(python3 -c "import openmm; print(openmm.Platform.getOpenMMVersion())" 2>/dev/null)"')"
}

tree() {
    begin "debian-$release"
    one=$where/$release-build
    source_in "$one"
    step 'packages' "$one" 'apt-get update -qq && apt-get install -qq -y --no-install-recommends make git ca-certificates ccache && make deps'
    versions "$one"
    step 'make build' "$one" 'make build'
    say "compiler warnings: $(grep -c 'warning:' "$where/$release-step.log" || true)"
    step 'make test' "$one" 'make test'
    step 'make lint' "$one" 'make lint'
    step 'make demo' "$one" 'make demo'
    release_mounts "$one"
    finish
}

packages() {
    begin "debian-$release-packages"
    one=$where/$release-packaging
    source_in "$one"
    # With what the package needs to be built, and nothing else.
    step 'make deb' "$one" 'apt-get update -qq && apt-get install -qq -y --no-install-recommends make git ca-certificates ccache dpkg-dev && apt-get build-dep -qq -y --no-install-recommends ./ && make deb'
    versions "$one"
    step 'lintian' "$one" 'lintian --allow-root --fail-on error,warning --pedantic build/deb/*.changes'
    two=$where/$release-packages
    fresh "$two"
    mkdir -p "$two/packages" "$two/tests"
    cp "$one"/source/build/deb/*.deb "$two/packages"
    cp debian/tests/script debian/tests/program README.md "$two/tests"
    cat > "$two/tests/readme.py" <<'END'
import re
exec('\n'.join(re.findall(r'^```python\n(.*?)^```', open('/tests/README.md').read(), flags=re.S | re.M)))
END
    step 'apt install of the packages alone' "$two" 'apt-get update -qq && apt-get install -qq -y --no-install-recommends /packages/python3-openmm-rigidhi*.deb /packages/libopenmm-rigidhi*.deb'
    step 'debian/tests/script' "$two" '/tests/script'
    step "the README's scripts" "$two" 'cd /tmp && python3 /tests/readme.py'
    step 'apt install of the headers' "$two" 'apt-get install -qq -y --no-install-recommends /packages/openmm-rigidhi-dev*.deb g++ cmake make'
    step 'debian/tests/program' "$two" '/tests/program'
    release_mounts "$one"
    release_mounts "$two"
    finish
}

wheel() {
    begin "debian-$release-wheel"
    one=$where/$release-wheel
    source_in "$one"
    step 'packages' "$one" 'apt-get update -qq && apt-get install -qq -y --no-install-recommends make git ca-certificates ccache && make deps && apt-get install -qq -y --no-install-recommends python3-scikit-build-core python3-pip python3-venv ninja-build'
    versions "$one"
    step 'pip wheel' "$one" 'python3 -m pip wheel --no-deps --no-build-isolation --no-index --wheel-dir build/wheels .'
    step 'tools/check_wheel.py' "$one" 'python3 tools/check_wheel.py build/wheels/openmm_rigidhi-*.whl'
    cat "$where/$release-step.log" >> "$where/$release.report"
    release_mounts "$one"
    finish
}

trap 'for each in build packaging packages wheel; do release_mounts "$where/$release-$each"; done' EXIT
case $part in all | tree) tree ;; esac
case $part in all | packages) packages ;; esac
case $part in all | wheel) if [ "$release" = 13 ] || [ "$part" = wheel ]; then wheel; fi ;; esac
exit $failed
