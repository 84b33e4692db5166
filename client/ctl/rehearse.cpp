#include "client/ctl/rehearse.hpp"

#include <cstdlib>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "proto/program/python.hpp"

namespace shearbus::ctl {
namespace {

constexpr const char* kKit =
    "import sys\n"
    "try:\n"
    "    from shearbus.conformity.__main__ import main\n"
    "except ImportError as fault:\n"
    "    sys.exit(f'shearbus-ctl: the rehearsal is part of the Python client, which cannot be loaded: {fault}. '\n"
    "             'Install the component python, with numpy, pyzmq and xxhash, or name its place in PYTHONPATH.')\n"
    "sys.exit(main(sys.argv[1:]))\n";

}  // namespace

void rehearse(std::span<char* const> arguments) {
  namespace fs = std::filesystem;
  // The Python package that was installed together with this program, or that of the sources around build/bin.
  const fs::path programs = fs::read_symlink("/proc/self/exe").parent_path();
  for (const char* place : {"../lib/python3/dist-packages", "../../client/python"}) {
    const fs::path packages = programs / place;
    if (!fs::exists(packages / "shearbus")) continue;
    const char* given = std::getenv("PYTHONPATH");  // NOLINT(concurrency-mt-unsafe)
    const std::string path = packages.lexically_normal().string() + (given == nullptr ? "" : std::string(":") + given);
    ::setenv("PYTHONPATH", path.c_str(), 1);  // NOLINT(concurrency-mt-unsafe)
    break;
  }
  std::vector<std::string> words = {"-P", "-c", kKit};
  words.insert(words.end(), arguments.begin(), arguments.end());
  program::become_python(std::move(words));
}

}  // namespace shearbus::ctl
