#!/bin/sh
# Install the Debian packages listed in a file, those that are missing. Needs root or sudo only if any is missing.
# Usage: tools/install-packages.sh packages-debian.txt
set -eu

wanted=$(sed 's/#.*//' "$1")
if ! command -v dpkg-query >/dev/null; then
    echo "Not a Debian system: install the equivalents of these by hand, if you have not:" $wanted
    exit 0
fi

missing=
for package in $wanted; do
    status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$status" = installed ] || missing="$missing $package"
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
run install --yes --no-install-recommends $missing
