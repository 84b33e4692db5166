# Sourced by run, test, fuzz, sanitize and docs/build: installs packages, configures and builds. Not a command of its own: in the shell of a
# user, set -e would end that shell with the next command that fails.
case $- in *i*) echo "deploy/prepare.sh is a part of the commands in deploy/; to build the programs: deploy/build programs" >&2; return 2 ;; esac
set -euo pipefail

# A command that is asked for --help prints the comment at its beginning.
case ${1:-} in -h | --help) sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0"; exit ;; esac

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
build=${SHEARBUS_BUILD_DIR:-$root/build}

# say TEXT...: a heading, bold on a terminal unless NO_COLOR is set.
say() {
  if [ -t 1 ] && [ -z "${NO_COLOR:-}" ]; then printf '\n\033[1m== %s\033[0m\n' "$*"; else printf '\n== %s\n' "$*"; fi
}

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

# build_programs TARGET: what a run needs (run), or all programs and libraries (programs). No package of test.txt is looked for. A build
# with tests stays one.
build_programs() {
  [ -f "$build/build.ninja" ] || configure release OFF
  cmake --build "$build" --target "$1"
}

# build_with_tests [target...]: everything, or these targets. A build without tests is configured again.
build_with_tests() {
  say "Building in $build"
  grep -qs '^SHEARBUS_TESTS:BOOL=ON$' "$build/CMakeCache.txt" && [ -f "$build/build.ninja" ] || configure "${preset:-release}" ON
  cmake --build "$build" ${1:+--target "$@"}
}

# configure PRESET TESTS: the build directory, with a preset of cmake/presets; TESTS is ON or OFF.
configure() {
  cmake -C "$root/deploy/cmake/presets/$1.cmake" -S "$root" -B "$build" -G Ninja -DSHEARBUS_TESTS="$2" \
    ${CI:+-DSHEARBUS_WARNINGS_AS_ERRORS=ON}
}

# report_coverage BUILD: the coverage of our sources by the counters of a build, also as pages.
report_coverage() {
  mkdir -p "$1/coverage"
  (cd "$1" && gcovr --root "$root" --filter "$root/(proto|server|client|hydro_stub)/" --exclude-unreachable-branches --exclude-throw-branches \
    --gcov-ignore-parse-errors --print-summary --sort-percentage --txt --html-details coverage/index.html .)
}
