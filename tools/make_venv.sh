#!/usr/bin/env bash
# Make a virtual environment with pip, without root, also where Debian's python3-venv is missing.
#
#   PYTHON=python3 tools/make_venv.sh FOLDER
set -euo pipefail

python=${PYTHON:-python3}
folder=$1

if [[ -x $folder/bin/python ]] && "$folder/bin/python" -m pip --version >/dev/null 2>&1; then
    exit 0
fi
if "$python" -c 'import venv, ensurepip' 2>/dev/null; then
    exec "$python" -m venv "$folder"
fi

# Debian and Ubuntu keep pip's wheel in packages of their own: python3-venv needs root to install,
# but the wheel itself can be unpacked anywhere.
wheels=$(mktemp -d)
trap 'rm -rf "$wheels"' EXIT
if "$python" -m venv --without-pip "$folder" 2>/dev/null &&
    "$(dirname "$0")/unpack_debian_package.sh" python3-pip-whl "$wheels" 2>/dev/null; then
    wheel=$(find "$wheels" -name 'pip-*.whl' | head -n 1)
    if "$folder/bin/python" "$wheel/pip" install --quiet --no-index "$wheel"; then
        exit 0
    fi
fi
rm -rf "$folder"
echo "Python's module venv is incomplete here and could not be completed without root." \
    "Install it (Debian, Ubuntu: apt install python3-venv) and run make again." >&2
exit 1
