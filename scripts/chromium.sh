#!/bin/sh
# Sees to it that the tests find a Chromium that starts: the system's, else from apt (as root), else Playwright's own.
set -u
works() {
    for name in chromium chromium-browser google-chrome; do
        # On Ubuntu chromium-browser may be a stub that only points to a snap.
        command -v "$name" >/dev/null && "$name" --version >/dev/null 2>&1 && return 0
    done
    "$PYTHON" - <<'PYTHON_END' 2>/dev/null
from pathlib import Path
from playwright.sync_api import sync_playwright
with sync_playwright() as playwright:
    raise SystemExit(not Path(playwright.chromium.executable_path).exists())
PYTHON_END
}

works && exit 0
echo "No Chromium found; installing one for the tests." >&2
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    { apt-get update && apt-get install -y --no-install-recommends chromium; } >&2
    works && exit 0
    "$PYTHON" -m playwright install --with-deps chromium >&2
else
    "$PYTHON" -m playwright install chromium >&2
fi
works && exit 0
echo "Chromium could not be installed. Type: sudo apt-get install chromium   (or: make test BROWSER=no)" >&2
exit 1
