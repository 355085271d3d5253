#!/bin/sh
# Install the Debian packages listed in a file, those that are missing. Needs root or sudo only if any is missing.
# Usage: tools/install-packages.sh packages-debian.txt
set -eu

wanted=$(sed 's/#.*//' "$1")
if ! command -v dpkg-query >/dev/null; then
    echo "Not a Debian system: install the equivalents of these by hand, if you have not:" $wanted
    exit 0
fi

is_installed() { [ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" = installed ]; }
missing=
for names in $wanted; do
    found=
    for package in $(echo "$names" | tr '|' ' '); do
        if is_installed "$package"; then found=yes; fi
    done
    [ -n "$found" ] || missing="$missing $names"
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ]; then
    as_root=
elif ! command -v sudo >/dev/null; then
    echo "These packages are missing, and there is neither root nor sudo to install them:$missing" >&2
    exit 1
elif [ -t 0 ]; then
    as_root=sudo
else
    as_root="sudo -n"  # nobody is there to type a password
fi

echo "Installing:$missing"
run() { $as_root env DEBIAN_FRONTEND=noninteractive apt-get -o Acquire::Retries=3 "$@" </dev/null; }
run update
packages=
for names in $missing; do
    package=
    for each in $(echo "$names" | tr '|' ' '); do
        # The release may lack a name, or know it only as something that another package provides.
        if [ -z "$package" ] && apt-cache show "$each" >/dev/null 2>&1; then package=$each; fi
    done
    packages="$packages ${package:-$names}"
done
run install --yes --no-install-recommends $packages
