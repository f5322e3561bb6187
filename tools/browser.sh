#!/bin/sh
# Sees to it that there is a Chromium for the tests of the page; installs Debian's or Ubuntu's where there is none.
set -eu
if [ -n "${STEREOPSIS_NO_BROWSER:-}" ]; then
  echo "STEREOPSIS_NO_BROWSER is set: the tests of the page are left out"
  exit 0
fi
if [ -n "${STEREOPSIS_BROWSER:-}" ]; then exit 0; fi
for name in chromium chromium-browser google-chrome google-chrome-stable chrome; do
  if command -v "$name" >/dev/null 2>&1; then exit 0; fi
done
if ! command -v apt-get >/dev/null 2>&1; then
  echo "No Chromium is installed, and there is no apt-get to install it with: install one, name it with" >&2
  echo "STEREOPSIS_BROWSER=PATH, or leave the tests of the page out with STEREOPSIS_NO_BROWSER=1." >&2
  exit 1
fi
root=
if [ "$(id -u)" -ne 0 ]; then root="sudo"; fi
$root apt-get update -q
$root env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends chromium
