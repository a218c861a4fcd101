#!/bin/sh
# Makes .venv, unless it is there. Debian and Ubuntu keep the module for that in a package of its own.
set -eu
[ -x .venv/bin/python ] && .venv/bin/python -m pip --version >/dev/null 2>&1 && exit 0

if ! "$PYTHON" -c 'import ensurepip, venv' 2>/dev/null; then
    version=$("$PYTHON" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
    install="apt-get update && apt-get install -y python$version-venv"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        sh -c "$install" >&2
    else
        echo "Python's venv module is missing. Type: sudo sh -c '$install'" >&2
        exit 1
    fi
fi
"$PYTHON" -m venv .venv
