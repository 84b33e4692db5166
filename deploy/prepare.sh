# Sourced by run, test, fuzz, sanitize and docs/build: installs packages, configures and builds. Not a command of its own.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${SHEARBUS_BUILD_DIR:-$root/build}

say() { printf '\n\033[1m== %s\033[0m\n' "$*"; }

# install_packages LIST...: installs what is missing of packages/LIST.txt.
install_packages() {
  local wanted missing
  mapfile -t wanted < <(cd "$root/deploy/packages" && grep -hEv '^[[:space:]]*(#|$)' "${@/%/.txt}")
  mapfile -t missing < <(for package in "${wanted[@]}"; do
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || echo "$package"
  done)
  [ ${#missing[@]} -eq 0 ] && return
  if [ "$(id -u)" -ne 0 ]; then
    printf 'These packages are missing and only root can install them:\n  sudo apt-get install --no-install-recommends %s\nThen run this command again.\n' "${missing[*]}" >&2
    exit 1
  fi
  say "Installing ${#missing[@]} packages: ${missing[*]}"
  export DEBIAN_FRONTEND=noninteractive
  apt-get update -qq
  apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# build_programs TARGET: what a run needs (run), or all programs (programs). No package of test.txt is looked for. A build
# with tests stays one.
build_programs() {
  [ -f "$build/build.ninja" ] || configure OFF
  cmake --build "$build" --target "$1"
}

# build_with_tests [target...]: everything, or these targets. A build without tests is configured again.
build_with_tests() {
  say "Building in $build"
  grep -qs '^SHEARBUS_TESTS:BOOL=ON$' "$build/CMakeCache.txt" && [ -f "$build/build.ninja" ] || configure ON
  cmake --build "$build" ${1:+--target "$@"}
}

configure() {
  cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DSHEARBUS_UNITY=ON -DSHEARBUS_TESTS="$1" \
    -DSHEARBUS_WARNINGS_AS_ERRORS="$([ -n "${CI:-}" ] && echo ON || echo OFF)"
}
