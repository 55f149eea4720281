#!/usr/bin/env bash
# Download a Debian or Ubuntu package and unpack it into a folder: no root, nothing installed.
#
#   tools/unpack_debian_package.sh PACKAGE FOLDER
#
# apt's package lists go to a folder of their own, so that the machine's stay as they are.
set -euo pipefail

package=$1
folder=$2

for tool in apt-get dpkg; do
    if ! command -v "$tool" >/dev/null; then
        echo "$tool is not on this machine (it is not Debian or Ubuntu). Fetch the package" \
            "$package on a machine that is and unpack it there with" \
            "'dpkg -x $package*.deb $folder', then copy the folder here." >&2
        exit 1
    fi
done

mkdir -p "$folder"
folder=$(cd "$folder" && pwd)
work=$(mktemp -d "$folder/.unpack.XXXXXX")
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lists/partial" "$work/cache/archives/partial" "$work/unpacked"
options=(-qq -o Dir::State::Lists="$work/lists" -o Dir::Cache="$work/cache"
    -o APT::Sandbox::User="" -o Debug::NoLocking=1)

if ! apt-get "${options[@]}" update || ! (cd "$work" && apt-get "${options[@]}" download "$package"); then
    echo "The package $package could not be downloaded: is there a network, and do the machine's" \
        "apt sources hold the section 'main' (Debian) or 'universe' (Ubuntu)?" >&2
    exit 1
fi
dpkg -x "$work/$package"_*.deb "$work/unpacked"
cp -r "$work/unpacked/." "$folder/"
